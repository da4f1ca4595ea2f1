"""Output error: the exact fit of the simulated to the measured motion, over several runs at once.

Maximum likelihood for measurement noise on position and velocity: the parameters ``(b, a, c, d, delay)`` of
:mod:`gcs_autotune.models.simulation` are shared, every stretch has its own initial state, each kind of signal
its own noise level, estimated from the residuals (not below a coarse sensor's rounding, ``step/sqrt(12)``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.least_squares import Minimum, covariance_of, minimise
from gcs_autotune.identify.record import Record, Signal
from gcs_autotune.models.simulation import simulate_explicit

__all__ = ["SHARED", "Bounds", "Residual", "Solution", "first_states", "noise_floor", "residuals_of", "solve"]

Array = NDArray[np.float64]

SHARED = ("b", "a", "c", "d", "delay")
"""The parameters all runs share, in this order."""

NOISE_ROUNDS = 4
"""Rounds of re-estimating the noise levels when two kinds of signal are weighed against each other."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """What the data can resolve at all.

    Largest drag rate [1/s] (``a``, and ``c`` at the typical *speed* [rad/s or m/s]), largest delay [s].
    """

    rate: float
    delay: float
    speed: float


@dataclass(frozen=True, slots=True, eq=False)
class Residual:
    """One signal of one stretch: measured minus simulated, and the Jacobian of the simulation (n, 7)."""

    record: int
    signal: Signal
    error: Array
    jacobian: Array


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """A fitted set of parameters.

    ``theta`` (5,) as :data:`SHARED`; ``free`` (5,) which were fitted; ``initial`` (runs, 2) states;
    ``covariance`` (5, 5) of theta from the Fisher information (zero for what was not free);
    ``noise`` per signal name; ``residuals`` at the solution, ``rows`` their weighted Jacobians in all fitted
    columns (those of theta first) and ``whole`` the covariance of these; ``n`` samples; ``at_bound`` names.
    """

    theta: Array
    free: NDArray[np.bool_]
    initial: Array
    covariance: Array
    noise: dict[str, float]
    residuals: tuple[Residual, ...]
    rows: tuple[Array, ...]
    whole: Array
    log_likelihood: float
    n: int
    parameters: int
    converged: bool
    at_bound: tuple[str, ...]

    def rms(self, name: str) -> float:
        """Return the root mean square residual of all signals called *name*."""
        errors = np.concatenate([r.error for r in self.residuals if r.signal.name == name])
        return float(np.sqrt(np.mean(errors**2)))


def residuals_of(
    records: Sequence[Record], names: Sequence[str], theta: Array, initial: Array
) -> list[Residual] | None:
    """Simulate every record and compare the signals called *names*; None when a simulation runs away."""
    found = []
    for i, record in enumerate(records):
        signals = [s for s in record.signals if s.name in names]
        stamps = signals[0].t if len(signals) == 1 else np.union1d(signals[0].t, signals[1].t)
        motion = simulate_explicit(np.concatenate([theta, initial[i]]), record.t_in, record.tau, stamps)
        if not motion.finite:
            return None
        for signal in signals:
            at = np.searchsorted(stamps, signal.t)
            is_position = signal.name == record.dof.position
            value, slope = (motion.eta, motion.eta_by) if is_position else (motion.nu, motion.nu_by)
            found.append(Residual(i, signal, signal.values - value[at], slope[at]))
    return found


def solve(
    records: Sequence[Record],
    names: Sequence[str],
    theta: Array,
    free: NDArray[np.bool_],
    bounds: Bounds,
    *,
    initial: Array | None = None,
    noise: dict[str, float] | None = None,
    robust: bool = False,
) -> Solution | None:
    """Fit the *free* parameters from *theta* on; None when no simulation from there is possible.

    Parameters
    ----------
    names : signals to fit, e.g. ``("psi",)`` or ``("psi", "r")``; every record must have one of them.
    initial : (runs, 2) states to start from; guessed from the first samples otherwise.
    noise : noise levels to start from, one per name.
    robust : soft-L1 weights, for records with outliers.
    """
    start = first_states(records, names) if initial is None else initial
    levels = dict(noise) if noise is not None else _first_levels(records, names)
    found: Minimum | None = None
    for _ in range(NOISE_ROUNDS if len(levels) > 1 or robust else 1):
        task = _Task(records, names, theta, free, levels, robust)
        low, high = task.limits(bounds)
        found = minimise(task.weighted, task.pack(theta, start), low, high)
        if found is None:
            return None
        theta, start = task.unpack(found.x)
        again = _levels(records, names, theta, start)
        settled = all(abs(again[n] / levels[n] - 1.0) < 0.01 for n in levels)
        levels = again
        if settled:
            break
    return (
        None
        if found is None
        else _solution(_Task(records, names, theta, free, levels, robust), theta, start, found, bounds)
    )


class _Task:
    """The weighted residuals of one choice of free parameters, as a function of one vector."""

    def __init__(
        self,
        records: Sequence[Record],
        names: Sequence[str],
        theta: Array,
        free: NDArray[np.bool_],
        levels: dict[str, float],
        robust: bool,
    ) -> None:
        self.records, self.names, self.theta, self.free = records, names, theta, free
        self.levels, self.robust = levels, robust
        velocity_only = [all(s.name != r.dof.position or s.name not in names for s in r.signals) for r in records]
        state = np.array([[not v, True] for v in velocity_only])
        self.state = state.ravel()

    def pack(self, theta: Array, initial: Array) -> Array:
        return np.concatenate([theta[self.free], initial.ravel()[self.state]])

    def unpack(self, x: Array) -> tuple[Array, Array]:
        theta, k = self.theta.copy(), int(self.free.sum())
        theta[self.free] = x[:k]
        initial = np.zeros(2 * len(self.records))
        initial[self.state] = x[k:]
        return theta, initial.reshape(-1, 2)

    def limits(self, bounds: Bounds) -> tuple[Array, Array]:
        steep = bounds.rate / bounds.speed
        low = np.array([-np.inf, -bounds.rate, -steep, -np.inf, 0.0])
        high = np.array([np.inf, bounds.rate, steep, np.inf, bounds.delay])
        k = int(self.state.sum())
        return (
            np.concatenate([low[self.free], np.full(k, -np.inf)]),
            np.concatenate([high[self.free], np.full(k, np.inf)]),
        )

    def weighted(self, x: Array) -> tuple[Array, Array] | None:
        found = residuals_of(self.records, self.names, *self.unpack(x))
        if found is None:
            return None
        rows, errors = [], []
        for residual in found:
            scale = 1.0 / self.levels[residual.signal.name]
            weight = np.full(len(residual.error), scale)
            if self.robust:
                weight /= (1.0 + (residual.error * scale / 2.0) ** 2) ** 0.25
            errors.append(-weight * residual.error)
            rows.append(weight[:, None] * self.spread(residual))
        return np.concatenate(errors), np.concatenate(rows)

    def spread(self, residual: Residual) -> Array:
        """Return a residual's Jacobian in the columns of the packed vector."""
        states = np.zeros((len(residual.error), 2 * len(self.records)))
        states[:, 2 * residual.record : 2 * residual.record + 2] = residual.jacobian[:, 5:]
        return np.hstack([residual.jacobian[:, :5][:, self.free], states[:, self.state]])


def first_states(records: Sequence[Record], names: Sequence[str]) -> Array:
    """Return initial states read off the first samples."""
    states = np.zeros((len(records), 2))
    for i, record in enumerate(records):
        for signal in record.signals:
            if signal.name == record.dof.position:
                states[i, 0] = signal.values[0]
                states[i, 1] = np.polyfit(signal.t[:5] - signal.t[0], signal.values[:5], 1)[0]
        if record.velocity is not None and record.velocity.name in names:
            states[i, 1] = record.velocity.values[0]
    return states


def _first_levels(records: Sequence[Record], names: Sequence[str]) -> dict[str, float]:
    """Return noise levels to begin with: the scatter about a parabola through five neighbours."""
    levels = {}
    for name in names:
        rough = [_roughness(s) for r in records for s in r.signals if s.name == name]
        if rough:
            levels[name] = max(float(np.mean(rough)), 1e-9)
    return levels


def _roughness(signal: Signal) -> float:
    third = np.diff(signal.values, n=3)
    return max(
        float(np.sqrt(np.mean(third**2) / 20.0)),
        signal.step / math.sqrt(12.0),
        1e-6 * float(np.ptp(signal.values)),
    )


def noise_floor(residuals: Sequence[Residual], name: str) -> float:
    """Return the rounding error of the coarsest sensor called *name*: ``step/sqrt(12)``."""
    return max((r.signal.step for r in residuals if r.signal.name == name), default=0.0) / math.sqrt(12.0)


def _levels(records: Sequence[Record], names: Sequence[str], theta: Array, initial: Array) -> dict[str, float]:
    found = residuals_of(records, names, theta, initial)
    assert found is not None
    return _levels_of(found)


def _levels_of(residuals: Sequence[Residual], spent: float = 0.0) -> dict[str, float]:
    """Return the noise level per signal, *spent* degrees of freedom shared out by sample counts."""
    total = sum(len(r.error) for r in residuals)
    levels = {}
    for name in dict.fromkeys(r.signal.name for r in residuals):
        errors = np.concatenate([r.error for r in residuals if r.signal.name == name])
        left = max(len(errors) * (1.0 - spent / total), 1.0)
        swing = max(float(np.ptp(r.signal.values)) for r in residuals if r.signal.name == name)
        rms = math.sqrt(float(errors @ errors) / left)
        levels[name] = max(rms, noise_floor(residuals, name), 1e-12 * swing, 1e-300)
    return levels


def _solution(task: _Task, theta: Array, initial: Array, found: Minimum, bounds: Bounds) -> Solution:
    residuals = residuals_of(task.records, task.names, theta, initial)
    assert residuals is not None
    at_bound = _at_bound(task.free, theta, bounds)
    noise = _levels_of(residuals, spent=float(len(found.x)))
    rows = tuple(task.spread(r) / noise[r.signal.name] for r in residuals)
    k = int(task.free.sum())
    held = np.array([n in at_bound for n in np.array(SHARED)[task.free]] + [False] * (len(found.x) - k))
    whole = np.zeros((len(held), len(held)))
    whole[np.ix_(~held, ~held)] = covariance_of(np.vstack(rows)[:, ~held])
    covariance = np.zeros((5, 5))
    covariance[np.ix_(task.free, task.free)] = whole[:k, :k]
    n = sum(len(r.error) for r in residuals)
    return Solution(
        theta=theta,
        free=task.free,
        initial=initial,
        covariance=covariance,
        noise=noise,
        residuals=tuple(residuals),
        rows=rows,
        whole=whole,
        log_likelihood=_log_likelihood(residuals),
        n=n,
        parameters=len(found.x),
        converged=found.converged,
        at_bound=at_bound,
    )


def _log_likelihood(residuals: Sequence[Residual]) -> float:
    """Return the Gaussian log-likelihood at the noise levels that maximise it."""
    levels = _levels_of(residuals)
    total = 0.0
    for r in residuals:
        level = levels[r.signal.name]
        total -= len(r.error) * (math.log(level) + 0.5 * math.log(2.0 * math.pi))
        total -= 0.5 * float(r.error @ r.error) / level**2
    return total


def _at_bound(free: NDArray[np.bool_], theta: Array, bounds: Bounds) -> tuple[str, ...]:
    names = []
    if free[1] and abs(theta[1]) >= 0.999 * bounds.rate:
        names.append("a")
    if free[2] and abs(theta[2]) * bounds.speed >= 0.999 * bounds.rate:
        names.append("c")
    if free[4] and (theta[4] <= 0.0 or theta[4] >= 0.999 * bounds.delay):
        names.append("delay")
    return tuple(names)
