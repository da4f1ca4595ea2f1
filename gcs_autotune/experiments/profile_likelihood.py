"""Profile likelihood of one parameter: the best fit as the parameter moves away from its estimate.

At every value all other parameters and initial states are fitted again; the rise of minus twice the log-likelihood
over its minimum is chi-squared with one degree of freedom (Wilks), so the values below 3.84 make the 95 % interval. It
need not be symmetric, and it need not close: a side on which the fit does not degrade enough is reported as open
(Raue2009, "practically non-identifiable"). For coloured residuals the deviance is
divided by the square of the factor on the fit's standard error.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gcs_autotune import chi_square
from gcs_autotune.errors import NotInformative
from gcs_autotune.experiments.scales import scales_of
from gcs_autotune.identify import (
    Fit,
    FittedModel,
    Limits,
    Model,
    NoiseModel,
    Objective,
    Problem,
    alternate,
    descend,
    fitted_model_of,
    gaussian_noise,
    information_on,
)
from gcs_autotune.registry import lookup
from gcs_autotune.trial import Trial

__all__ = ["Profile", "profile"]

Array = NDArray[np.float64]

ROUNDS = 4
"""Rounds of parameters, then noise, for the fit the profile starts from."""

FARTHEST = 20.0
"""Distance, in sizes of the parameter, at which a side is given up as open."""

GROWTH, FIRST = 1.6, 0.5
"""Steps outwards grow by this factor, from this many standard errors on."""

POLISH, CLOSE = 12, 0.01
"""Most steps to locate an interval's end, and its tolerance relative to the parameter. Chosen."""


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """``values`` (k,) increasing and ``deviance`` (k,) over the minimum; the interval at ``level``.

    ``low`` or ``high`` infinite: that side is open, the runs do not bound the parameter there. ``estimate`` is where
    the likelihood is largest.
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
        """One sentence."""
        if self.closed:
            return f"{self.name} is between {self.low:.4g} and {self.high:.4g} {self.unit} ({100 * self.level:.0f} %)"
        if not (math.isfinite(self.low) or math.isfinite(self.high)):
            return f"{self.name} is not bounded by these runs"
        side, bound = ("above", self.low) if math.isfinite(self.low) else ("below", self.high)
        other = "upwards" if side == "above" else "downwards"
        return f"{self.name} is {side} {bound:.4g} {self.unit}; these runs do not bound it {other}"


def profile(fit: Fit[Model], trials: Trial | Sequence[Trial], name: str, *, level: float = 0.95) -> Profile:
    """Return the profile likelihood of one fitted parameter.

    Raises
    ------
    UnknownName
        *name* was not fitted.
    UsageError, NotInformative
        As :func:`gcs_autotune.identify.information.fitted_model_of`.
    """
    subject = fitted_model_of(fit, trials)
    place = lookup({n: i for i, n in enumerate(subject.names)}, name, "fitted parameter")
    subject, laws, least = _likeliest(subject)
    std, size = float(information_on(subject).std[place]), float(scales_of(subject).size[place])
    raised = (fit.parameters[name].std / std) ** 2
    walker = _Walker(subject, place, laws, least, max(1.0, raised))
    threshold = chi_square.quantile(level, 1)
    estimate = float(subject.values[place])
    first = FIRST * min(std, size)
    low, below = walker.walk(estimate, -first, size, threshold)
    high, above = walker.walk(estimate, first, size, threshold)
    points = sorted({estimate: 0.0, **below, **above}.items())
    values, deviance = np.array(points).T
    return Profile(name, subject.units[place], estimate, level, threshold, values, deviance, low, high)


def _likeliest(subject: FittedModel) -> tuple[FittedModel, dict[str, NoiseModel], float]:
    """Return the subject at its maximum of likelihood, the noise there, and the least cost."""
    objective = subject.objective()
    wide = np.full(objective.size, np.inf)
    found = alternate(objective, objective.pack(), gaussian_noise(subject.noise), -wide, wide, ROUNDS)
    if found is None:
        raise NotInformative(f"the model '{subject.form.name}' diverges on its runs")
    minimum, laws = found
    theta, _, initial, _ = objective.unpack(minimum.x)
    local = objective.at(minimum.x, laws)
    assert local is not None
    return replace(subject, theta=theta, initial=initial), laws, local.cost


@dataclass(slots=True)
class _Walker:
    """Moves one parameter and fits all the rest."""

    subject: FittedModel
    place: int
    laws: dict[str, NoiseModel]
    least: float
    raised: float

    def walk(self, estimate: float, step: float, size: float, threshold: float) -> tuple[float, dict[float, float]]:
        """Return the end of the interval on one side (infinite: open) and the points visited."""
        points: dict[float, float] = {}
        state: tuple[Array, tuple[Array, ...]] | None = (self.subject.theta, self.subject.initial)
        inner, value = (estimate, 0.0), estimate
        while True:
            value += step
            step *= GROWTH
            if abs(value - estimate) > FARTHEST * size:
                return math.copysign(math.inf, step), points
            deviance, after = self.at(value, state or (self.subject.theta, self.subject.initial))
            if math.isfinite(deviance):
                points[value] = deviance
            if deviance > threshold:
                break
            inner, state = (value, deviance), after
        outer = (value, deviance)
        for _ in range(POLISH):
            middle = _crossing(inner, outer, threshold)
            deviance, after = self.at(middle, state or (self.subject.theta, self.subject.initial))
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
        """Return the deviance with the parameter at *value* (infinite when no fit runs), and the fit."""
        subject = self.subject
        theta, initial = near[0].copy(), near[1]
        own = subject.free[self.place]
        theta[subject.form.parameters.index(own)] = value * subject.signs[self.place]
        others = tuple(n for n in subject.free if n != own)
        objective = Objective(Problem(subject.form, subject.records, None, Limits({}, {}), others), theta, initial)
        wide = np.full(objective.size, np.inf)
        found = descend(partial(objective.at, noise=self.laws), objective.pack(), -wide, wide)
        if found is None:
            return math.inf, None
        there, _, states, _ = objective.unpack(found.x)
        return max(0.0, found.cost - self.least) / self.raised, (there, states)


def _crossing(inner: tuple[float, float], outer: tuple[float, float], threshold: float) -> float:
    """Return where the square root of the deviance, nearly a straight line, meets that of the threshold."""
    (a, below), (b, above) = inner, outer
    if not math.isfinite(above):
        return 0.5 * (a + b)
    low, high = math.sqrt(below), math.sqrt(above)
    return a + (b - a) * (math.sqrt(threshold) - low) / (high - low)
