"""Output error: the exact fit of the simulated to the measured motion, over several runs at once.

Maximum likelihood for measurement noise on position and velocity: the parameters ``(b, a, c, d, delay)`` of
:mod:`gcs_autotune.models.simulation` are shared, every stretch has its own initial state, each kind of signal
its own noise level, estimated with them. A coarse sensor's rounding enters the likelihood exactly when its step is
given (:mod:`gcs_autotune.identify.likelihood`), started from the Gaussian fit; otherwise the noise level is not
taken below ``step/sqrt(12)``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.least_squares import Local, Minimum, descend, inverse_of
from gcs_autotune.identify.likelihood import Law, Rounded, gaussian_laws
from gcs_autotune.identify.record import Record
from gcs_autotune.identify.residuals import Residual, first_levels, first_states, residuals_of, rounding_error

__all__ = ["SHARED", "Bounds", "Solution", "information_of", "solve"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SHARED = ("b", "a", "c", "d", "delay")
"""The parameters all runs share, in this order."""

NOISE_ROUNDS = 4
"""Rounds of re-estimating the noise levels when two kinds of signal are weighed against each other."""

ROUNDING_ROUNDS = 20
"""Rounds of parameters, then noise, for a rounding sensor; the noise comes down from the Gaussian fit's residuals."""

SETTLED = 0.01
"""Relative change of every noise level at which the rounds end."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """What the data can resolve at all: largest drag rate ``a`` [1/s] and largest delay [s]."""

    rate: float
    delay: float


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """A fitted set of parameters.

    ``theta`` (5,) as :data:`SHARED`; ``free`` (5,) which were fitted; ``initial`` (runs, 2) states;
    ``covariance`` (5, 5) of theta from the expected information (zero for what was not free);
    ``laws`` per signal name; ``residuals`` at the solution, ``scores`` their log-likelihood's derivative by the
    simulated value times the noise (for Gaussian noise: error over noise), ``rows`` their Jacobians over the noise
    in all fitted columns (those of theta first) and ``whole`` the covariance of these; ``n`` samples;
    ``at_bound`` names.
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
        return float(np.sqrt(np.mean(_errors(self.residuals, name) ** 2)))


def solve(
    records: Sequence[Record],
    names: Sequence[str],
    theta: Array,
    free: Mask,
    bounds: Bounds,
    *,
    initial: Array | None = None,
    noise: Mapping[str, float] | None = None,
    quanta: Mapping[str, float] | None = None,
    robust: bool = False,
) -> Solution | None:
    """Fit the *free* parameters from *theta* on; None when no simulation from there is possible.

    Parameters
    ----------
    names : signals to fit, e.g. ``("psi",)`` or ``("psi", "r")``; every record must have one of them.
    initial : (runs, 2) states to start from; guessed from the first samples otherwise.
    noise : noise levels to start from, one per name.
    quanta : steps of the signals to be taken as rounded, per name; see :func:`residuals.quanta_of`.
    robust : soft-L1 weights, for records with outliers (signals taken as rounded bear them anyway).
    """
    start = first_states(records, names) if initial is None else initial
    levels = dict(noise) if noise is not None else first_levels(records, names)
    task = _Task(records, names, theta, free)
    rounds = NOISE_ROUNDS if len(levels) > 1 or robust else 1
    fitted = task.alternate(task.pack(theta, start), gaussian_laws(levels, robust=robust), bounds, rounds)
    if fitted is not None and quanta:
        laws = {n: _law(fitted[1][n], quanta.get(n, 0.0), _span(records, n)) for n in fitted[1]}
        fitted = task.alternate(fitted[0].x, laws, bounds, ROUNDING_ROUNDS)
    return None if fitted is None else _solution(task, *fitted, bounds)


def _law(gaussian: Law, quantum: float, span: float) -> Law:
    return Rounded(gaussian.sigma, quantum, span) if quantum > 0.0 else gaussian


def _span(records: Sequence[Record], name: str) -> float:
    return max(float(np.ptp(s.values)) for r in records for s in r.signals if s.name == name)


@dataclass(frozen=True, slots=True, eq=False)
class _Task:
    """The likelihood of one choice of free parameters, as a function of one packed vector."""

    records: Sequence[Record]
    names: Sequence[str]
    theta: Array
    free: Mask
    state: Mask = field(init=False)

    def __post_init__(self) -> None:
        has_position = [any(s.name == r.dof.position and s.name in self.names for s in r.signals) for r in self.records]
        object.__setattr__(self, "state", np.array([[p, True] for p in has_position]).ravel())

    def pack(self, theta: Array, initial: Array) -> Array:
        return np.concatenate([theta[self.free], initial.ravel()[self.state]])

    def unpack(self, x: Array) -> tuple[Array, Array]:
        theta, k = self.theta.copy(), int(self.free.sum())
        theta[self.free] = x[:k]
        initial = np.zeros(2 * len(self.records))
        initial[self.state] = x[k:]
        return theta, initial.reshape(-1, 2)

    def limits(self, bounds: Bounds) -> tuple[Array, Array]:
        low = np.array([-np.inf, -bounds.rate, -np.inf, -np.inf, 0.0])
        high = np.array([np.inf, bounds.rate, np.inf, np.inf, bounds.delay])
        k = int(self.state.sum())
        return (
            np.concatenate([low[self.free], np.full(k, -np.inf)]),
            np.concatenate([high[self.free], np.full(k, np.inf)]),
        )

    def residuals(self, x: Array) -> list[Residual] | None:
        return residuals_of(self.records, self.names, *self.unpack(x))

    def alternate(
        self, x: Array, laws: Mapping[str, Law], bounds: Bounds, rounds: int
    ) -> tuple[Minimum, dict[str, Law]] | None:
        """Fit the parameters, then the noise, until the noise settles; None when nothing can be simulated."""
        found: Minimum | None = None
        for _ in range(rounds):
            found = self.minimum(x, laws, bounds)
            residuals = None if found is None else self.residuals(found.x)
            if found is None or residuals is None:
                return None
            before, x = laws, found.x
            laws = _likeliest(residuals, before)
            if all(abs(laws[n].sigma / before[n].sigma - 1.0) < SETTLED for n in laws):
                break
        return None if found is None else (found, dict(laws))

    def minimum(self, x: Array, laws: Mapping[str, Law], bounds: Bounds) -> Minimum | None:
        def local(x: Array) -> Local | None:
            found = self.residuals(x)
            return None if found is None else self.local(found, laws)

        return descend(local, x, *self.limits(bounds))

    def local(self, residuals: Sequence[Residual], laws: Mapping[str, Law]) -> Local:
        columns = int(self.free.sum()) + int(self.state.sum())
        cost, gradient, curvature = 0.0, np.zeros(columns), np.zeros((columns, columns))
        for residual in residuals:
            terms, J = laws[residual.signal.name].terms(residual.error), self.spread(residual)
            cost += float(terms.deviance.sum())
            gradient -= J.T @ terms.slope
            curvature += J.T @ (terms.curvature[:, None] * J)
        return Local(cost, gradient, curvature)

    def spread(self, residual: Residual) -> Array:
        """Return a residual's Jacobian in the columns of the packed vector."""
        states = np.zeros((len(residual.error), 2 * len(self.records)))
        states[:, 2 * residual.record : 2 * residual.record + 2] = residual.jacobian[:, 5:]
        return np.hstack([residual.jacobian[:, :5][:, self.free], states[:, self.state]])


def information_of(residuals: Sequence[Residual], columns: Sequence[Array], laws: Mapping[str, Law]) -> Array:
    """Return the expected information (p, p) of parameters whose Jacobians are *columns* (n, p) each.

    The noise levels are unknown too: what they take away, ``I_ps I_ss^-1 I_sp``, is taken off.
    """
    p = columns[0].shape[1]
    total = np.zeros((p, p))
    for name, law in laws.items():
        mixed, own = np.zeros(p), 0.0
        for residual, J in zip(residuals, columns, strict=True):
            if residual.signal.name == name:
                by_truth, by_both, by_sigma = law.information(residual.error).T
                total += J.T @ (by_truth[:, None] * J)
                mixed += J.T @ by_both
                own += float(by_sigma.sum())
        if own > 0.0:
            total -= np.outer(mixed, mixed) / own
    return total


def _errors(residuals: Sequence[Residual], name: str) -> Array:
    return np.concatenate([r.error for r in residuals if r.signal.name == name])


def _likeliest(residuals: Sequence[Residual], laws: Mapping[str, Law], spent: float = 0.0) -> dict[str, Law]:
    """Return the laws with their noise re-estimated, *spent* degrees of freedom shared out by sample counts."""
    levels = _levels_of(residuals, spent)
    return {name: law.likeliest(_errors(residuals, name), levels[name]) for name, law in laws.items()}


def _levels_of(residuals: Sequence[Residual], spent: float) -> dict[str, float]:
    """Return the noise level per signal, *spent* degrees of freedom shared out by sample counts."""
    total = sum(len(r.error) for r in residuals)
    levels = {}
    for name in dict.fromkeys(r.signal.name for r in residuals):
        errors = _errors(residuals, name)
        left = max(len(errors) * (1.0 - spent / total), 1.0)
        swing = max(float(np.ptp(r.signal.values)) for r in residuals if r.signal.name == name)
        rms = math.sqrt(float(errors @ errors) / left)
        levels[name] = max(rms, rounding_error(residuals, name), 1e-12 * swing, 1e-300)
    return levels


def _solution(task: _Task, found: Minimum, laws: Mapping[str, Law], bounds: Bounds) -> Solution:
    theta, initial = task.unpack(found.x)
    residuals = task.residuals(found.x)
    assert residuals is not None
    at_bound = _at_bound(task.free, theta, bounds)
    laws = _likeliest(residuals, laws, spent=float(len(found.x)))
    columns = [task.spread(r) for r in residuals]
    k = int(task.free.sum())
    held = np.array([n in at_bound for n in np.array(SHARED)[task.free]] + [False] * (len(found.x) - k))
    whole = np.zeros((len(held), len(held)))
    whole[np.ix_(~held, ~held)] = inverse_of(information_of(residuals, [J[:, ~held] for J in columns], laws))
    covariance = np.zeros((5, 5))
    covariance[np.ix_(task.free, task.free)] = whole[:k, :k]
    own = [laws[r.signal.name] for r in residuals]
    return Solution(
        theta=theta,
        free=task.free,
        initial=initial,
        covariance=covariance,
        laws=laws,
        residuals=tuple(residuals),
        scores=tuple(law.std * law.terms(r.error).slope for r, law in zip(residuals, own, strict=True)),
        rows=tuple(J / law.std for J, law in zip(columns, own, strict=True)),
        whole=whole,
        log_likelihood=_log_likelihood(residuals, _likeliest(residuals, laws)),
        n=sum(len(r.error) for r in residuals),
        parameters=len(found.x),
        converged=found.converged,
        at_bound=at_bound,
    )


def _log_likelihood(residuals: Sequence[Residual], laws: Mapping[str, Law]) -> float:
    return sum(law.log_likelihood(_errors(residuals, name)) for name, law in laws.items())


def _at_bound(free: Mask, theta: Array, bounds: Bounds) -> tuple[str, ...]:
    names = []
    if free[1] and abs(theta[1]) >= 0.999 * bounds.rate:
        names.append("a")
    if free[4] and (theta[4] <= 0.0 or theta[4] >= 0.999 * bounds.delay):
        names.append("delay")
    return tuple(names)
