"""Profile likelihood of one parameter: the best fit as the parameter moves away from its estimate.

At every value all other parameters and initial states are fitted again. The rise of minus twice the log-likelihood over
its minimum is chi-squared with one degree of freedom (Wilks). The parameter values with a rise below 3.84 therefore
form the 95 % interval. The interval need not be symmetric or closed. A side on which the rise stays smaller is reported
as open (Raue2009, "practically non-identifiable"). For coloured residuals the deviance is divided by the square of the
factor on the fit's standard error.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune import chi_square
from gcs_autotune.experiments.scales import scales_of
from gcs_autotune.identify import Fit, Model
from gcs_autotune.identify.problems import MostLikely, fitted_model_of, information_on
from gcs_autotune.notebook import Displayed
from gcs_autotune.registry import lookup
from gcs_autotune.trial import Trial

__all__ = ["Profile", "profile"]

Array = NDArray[np.float64]

ROUNDS = 4
"""Number of iterations of parameters, then noise, in the fit from which the profile starts. Project choice."""

FARTHEST = 20.0
"""Distance from the estimate, in sizes of the parameter, beyond which a side counts as open. Project choice."""

GROWTH, FIRST = 1.6, 0.5
"""Steps away from the estimate: ratio of successive steps, and first step in standard errors. Project choice."""

POLISH, CLOSE = 12, 0.01
"""Maximum number of steps to locate an end of the interval, and tolerance of the end relative to the parameter.

Project choice.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Profile(Displayed):
    """Profile likelihood of one parameter.

    - ``values`` (k,): values of the parameter, increasing.
    - ``deviance`` (k,): rise of minus twice the log-likelihood over its minimum.
    - ``low``, ``high``: ends of the interval at ``level``. An infinite end means that the runs do not bound the
      parameter on that side.
    - ``estimate``: the value with the largest likelihood.
    """

    name: str
    unit: str
    estimate: float
    level: float
    threshold: float
    values: Array
    deviance: Array
    low: float
    high: float

    @property
    def closed(self) -> bool:
        """Whether the runs bound the parameter on both sides."""
        return math.isfinite(self.low) and math.isfinite(self.high)

    @property
    def words(self) -> str:
        """The interval in one sentence."""
        if self.closed:
            return f"{self.name} is between {self.low:.4g} and {self.high:.4g} {self.unit} ({100 * self.level:.0f} %)"
        if not (math.isfinite(self.low) or math.isfinite(self.high)):
            return f"{self.name} is not bounded by these runs"
        side, bound = ("above", self.low) if math.isfinite(self.low) else ("below", self.high)
        other = "upwards" if side == "above" else "downwards"
        return f"{self.name} is {side} {bound:.4g} {self.unit}; these runs give no bound {other}"


def profile(fit: Fit[Model], trials: Trial | Sequence[Trial], name: str, *, level: float = 0.95) -> Profile:
    """Return the profile likelihood of the fitted parameter *name*.

    Raises
    ------
    UnknownName
        *name* was not fitted.
    UsageError, NotInformative
        :func:`gcs_autotune.identify.problems.information.fitted_model_of` raised the error.
    """
    subject = fitted_model_of(fit, trials)
    place = lookup({n: i for i, n in enumerate(subject.names)}, name, "fitted parameter")
    likeliest = MostLikely.of(subject, ROUNDS)
    subject = likeliest.subject
    std, size = float(information_on(subject).std[place]), float(scales_of(subject).size[place])
    raised = (fit.parameters[name].std / std) ** 2
    walker = _Walker(likeliest, place, max(1.0, raised))
    threshold = chi_square.quantile(level, 1)
    estimate = float(subject.values[place])
    first = FIRST * min(std, size)
    low, below = walker.walk(estimate, -first, size, threshold)
    high, above = walker.walk(estimate, first, size, threshold)
    points = sorted({estimate: 0.0, **below, **above}.items())
    values, deviance = np.array(points).T
    return Profile(name, subject.units[place], estimate, level, threshold, values, deviance, low, high)


@dataclass(slots=True)
class _Walker:
    """Search that moves one parameter step by step and fits all others."""

    likeliest: MostLikely
    place: int
    raised: float

    def walk(self, estimate: float, step: float, size: float, threshold: float) -> tuple[float, dict[float, float]]:
        """Return the end of the interval on one side, infinite if open, and the evaluated points (value ->
        deviance).
        """
        points: dict[float, float] = {}
        begin = (self.likeliest.subject.theta, self.likeliest.subject.initial)
        state: tuple[Array, tuple[Array, ...]] | None = begin
        inner, value = (estimate, 0.0), estimate
        while True:
            value += step
            step *= GROWTH
            if abs(value - estimate) > FARTHEST * size:
                return math.copysign(math.inf, step), points
            deviance, after = self.at(value, state or begin)
            if math.isfinite(deviance):
                points[value] = deviance
            if deviance > threshold:
                break
            inner, state = (value, deviance), after
        outer = (value, deviance)
        for _ in range(POLISH):
            middle = _crossing(inner, outer, threshold)
            deviance, after = self.at(middle, state or begin)
            if math.isfinite(deviance):
                points[middle] = deviance
            if deviance > threshold:
                outer = (middle, deviance)
            else:
                inner, state = (middle, deviance), after
            if abs(deviance - threshold) < CLOSE * threshold or abs(outer[0] - inner[0]) < CLOSE * size:
                break
        return _crossing(inner, outer, threshold), points

    def at(
        self, value: float, near: tuple[Array, tuple[Array, ...]]
    ) -> tuple[float, tuple[Array, tuple[Array, ...]] | None]:
        """Return the deviance with the parameter at *value*, and the fit.

        The deviance is infinite if no fit converges.
        """
        found = self.likeliest.holding(self.place, value, *near)
        if found is None:
            return math.inf, None
        cost, theta, initial = found
        return max(0.0, cost - self.likeliest.cost) / self.raised, (theta, initial)


def _crossing(inner: tuple[float, float], outer: tuple[float, float], threshold: float) -> float:
    """Return the crossing of the threshold, from linear interpolation of the square root of the deviance."""
    (a, below), (b, above) = inner, outer
    if not math.isfinite(above):
        return 0.5 * (a + b)
    low, high = math.sqrt(below), math.sqrt(above)
    return a + (b - a) * (math.sqrt(threshold) - low) / (high - low)
