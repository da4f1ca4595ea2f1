"""Output error: the exact fit of the simulated to the measured motion, over several runs at once.

Maximum likelihood for measurement noise on position and velocity: the parameters ``(b, a, c, d, delay)`` of
:mod:`gcs_autotune.models.simulation` are shared, every stretch has its own initial state, each kind of signal
its own noise level, estimated with them. A coarse sensor's rounding enters the likelihood exactly when its step is
given (:mod:`gcs_autotune.identify.axis.likelihood`), started from the Gaussian fit; otherwise the noise level is not
taken below ``step/sqrt(12)``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.axis.likelihood import Law, Rounded, gaussian_laws
from gcs_autotune.identify.axis.objective import DELAY, SHARED, Bounds, Mask, Objective, Timing, information_of
from gcs_autotune.identify.axis.residuals import Residual, first_levels, first_states
from gcs_autotune.identify.least_squares import Minimum, inverse_of
from gcs_autotune.identify.rounds import NOISE_ROUNDS, alternate, errors_of, likeliest
from gcs_autotune.identify.segment import Segment

__all__ = ["Solution", "solve"]

Array = NDArray[np.float64]

ROUNDING_ROUNDS = 20
"""Rounds of parameters, then noise, for a rounding sensor; the noise comes down from the Gaussian fit's residuals."""


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """A fitted set of parameters.

    ``theta`` (5,) as :data:`SHARED`; ``free`` (5,) which were fitted; ``initial`` (runs, 2) states;
    ``covariance`` (5, 5) of theta from the expected information (zero for what was not free);
    ``laws`` per signal name; ``residuals`` at the solution, ``scores`` their log-likelihood's derivative by the
    simulated value times the noise (for Gaussian noise: error over noise), ``rows`` their Jacobians over the noise
    in all fitted columns (those of theta first) and ``whole`` the covariance of these; ``n`` samples;
    ``parameters`` how many were fitted, a time shift not counted; ``at_bound`` names; ``timing`` what was known
    about the time shift that ``theta[4]`` then is.
    """

    theta: Array
    free: Mask
    initial: Array
    covariance: Array
    laws: Mapping[str, Law]
    residuals: tuple[Residual, ...]
    scores: tuple[Array, ...]
    rows: tuple[Array, ...]
    whole: Array
    log_likelihood: float
    n: int
    parameters: int
    converged: bool
    at_bound: tuple[str, ...]
    timing: Timing | None = None

    @property
    def delay_fitted(self) -> bool:
        """Whether a delay of the craft was fitted, rather than a shift of the stamps."""
        return bool(self.free[DELAY]) and self.timing is None

    @property
    def craft(self) -> Array:
        """Theta with the craft's own delay, any shift of the stamps taken off."""
        theta = self.theta.copy()
        if self.timing is not None:
            theta[DELAY] = self.timing.mean
        return theta

    @property
    def noise(self) -> dict[str, float]:
        """Standard deviation of measured minus true per signal name, rounding included."""
        return {name: law.std for name, law in self.laws.items()}

    @property
    def quanta(self) -> dict[str, float]:
        """Steps of the signals whose rounding entered the likelihood."""
        return {name: law.quantum for name, law in self.laws.items() if law.quantum > 0.0}

    def rms(self, name: str) -> float:
        """Return the root mean square residual of all signals called *name*."""
        return float(np.sqrt(np.mean(errors_of(self.residuals, name) ** 2)))


def solve(
    records: Sequence[Segment],
    names: Sequence[str],
    theta: Array,
    free: Mask,
    bounds: Bounds,
    *,
    initial: Array | None = None,
    noise: Mapping[str, float] | None = None,
    quanta: Mapping[str, float] | None = None,
    timing: Timing | None = None,
    robust: bool = False,
) -> Solution | None:
    """Fit the *free* parameters from *theta* on; None when no simulation from there is possible.

    Parameters
    ----------
    names : signals to fit, e.g. ``("psi",)`` or ``("psi", "r")``; every record must have one of them.
    initial : (runs, 2) states to start from; guessed from the first samples otherwise.
    noise : noise levels to start from, one per name.
    quanta : steps of the signals to be taken as rounded, per name; see :func:`residuals.quanta_of`.
    timing : what is known about the time from input stamp to motion, when the stamps are not exact.
    robust : soft-L1 weights, for records with outliers (signals taken as rounded bear them anyway).
    """
    start = first_states(records, names) if initial is None else initial
    levels = dict(noise) if noise is not None else first_levels(records, names)
    objective = Objective(records, names, theta, free, timing)
    rounds = NOISE_ROUNDS if len(levels) > 1 or robust else 1
    low, high = objective.limits(bounds)
    laws = gaussian_laws(levels, robust=robust)
    fitted = alternate(objective, objective.pack(theta, start), laws, low, high, rounds)
    if fitted is not None and quanta:
        laws = {n: _law(fitted[1][n], quanta.get(n, 0.0), _span(records, n)) for n in fitted[1]}
        fitted = alternate(objective, fitted[0].x, laws, low, high, ROUNDING_ROUNDS)
    return None if fitted is None else _solution(objective, *fitted, bounds)


def _law(gaussian: Law, quantum: float, span: float) -> Law:
    return Rounded(gaussian.sigma, quantum, span) if quantum > 0.0 else gaussian


def _span(records: Sequence[Segment], name: str) -> float:
    return max(float(np.ptp(s.values)) for r in records for s in r.signals.values() if s.name == name)


def _solution(objective: Objective, found: Minimum, laws: Mapping[str, Law], bounds: Bounds) -> Solution:
    theta, initial = objective.unpack(found.x)
    residuals = objective.residuals(found.x)
    assert residuals is not None
    laws = likeliest(residuals, laws, spent=float(len(found.x)))
    own = [laws[r.signal.name] for r in residuals]
    columns = [objective.columns(r) for r in residuals]
    at_bound = _at_bound(objective, theta, bounds)
    whole = _covariance(objective, residuals, columns, laws, at_bound)
    covariance, k = np.zeros((5, 5)), objective.shared
    covariance[np.ix_(objective.free, objective.free)] = whole[:k, :k]
    return Solution(
        theta=theta,
        free=objective.free,
        initial=initial,
        covariance=covariance,
        laws=laws,
        residuals=tuple(residuals),
        scores=tuple(law.std * law.terms(r.error).slope for r, law in zip(residuals, own, strict=True)),
        rows=tuple(J / law.std for J, law in zip(columns, own, strict=True)),
        whole=whole,
        log_likelihood=_log_likelihood(residuals, likeliest(residuals, laws)),
        n=sum(len(r.error) for r in residuals),
        parameters=len(found.x) - (objective.timing is not None),
        converged=found.converged,
        at_bound=at_bound,
        timing=objective.timing,
    )


def _covariance(
    objective: Objective,
    residuals: Sequence[Residual],
    columns: Sequence[Array],
    laws: Mapping[str, Law],
    at_bound: Sequence[str],
) -> Array:
    """Return the covariance of the packed vector; what stands at a bound is taken as known."""
    size = columns[0].shape[1]
    names = np.array(SHARED)[objective.free].tolist() + [""] * (size - objective.shared)
    loose = np.array([n not in at_bound for n in names])
    information = information_of(residuals, columns, laws) + objective.known(size)
    whole = np.zeros((size, size))
    whole[np.ix_(loose, loose)] = inverse_of(information[np.ix_(loose, loose)])
    return whole


def _log_likelihood(residuals: Sequence[Residual], laws: Mapping[str, Law]) -> float:
    return sum(law.log_likelihood(errors_of(residuals, name)) for name, law in laws.items())


def _at_bound(objective: Objective, theta: Array, bounds: Bounds) -> tuple[str, ...]:
    names = []
    if objective.free[1] and abs(theta[1]) >= 0.999 * bounds.rate:
        names.append("a")
    if objective.free[2] and abs(theta[2]) * bounds.speed >= 0.999 * bounds.rate:
        names.append("c")
    delay_is_free = objective.free[DELAY] and objective.timing is None
    if delay_is_free and (theta[DELAY] <= 0.0 or theta[DELAY] >= 0.999 * bounds.delay):
        names.append("delay")
    return tuple(names)
