"""Calculate the likelihood of a fit with process noise, its gradient and its information.

Derivatives are differences of filter passes.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from gcs_autotune.effects import EffectInstance
from gcs_autotune.identify.kalman.noise_filter import NoiseFilter
from gcs_autotune.identify.kalman.process_noise import LEAST_DAMPING, LONGEST_WAVE, MOST_DAMPING, ProcessNoise
from gcs_autotune.identify.problems.free_numbers import FreeNumbers

__all__ = ["NoisyObjective", "log_density"]

Array = NDArray[np.float64]

Innovations = tuple[tuple[Array, Array, Array], ...]
"""Stamps, innovations and variances of the innovations, each (n,), for every segment."""

STEP = 0.3
"""Length of a finite difference, in standard errors that apply with all other unknowns fixed.

For correlated unknowns this is a small fraction of their total error. A step of 0.02 was too short. Because of
rounding, one fit ended 1.3 nats early and its errors were half the true ones. Project choice.
"""

LONGEST_MOVE = 2.0
"""Largest change of the logarithm of a noise parameter in one step of the search. Project choice."""

LEAST_SMOOTHING, MOST_SMOOTHING = 0.2, 8.0
"""Limits of the time constant of a smoother, in sampling intervals of the record. Project choice."""

SHORTEST_MEMORY = 2.0
"""Shortest time constant of the drifting force, in sampling intervals.

A faster force cannot be distinguished from sensor noise. Project choice.
"""


class Point:
    """Innovations at one point ``x`` (q,), and their cost.

    The cost is minus twice the log-likelihood. Its derivatives are calculated on demand, by differences of filter
    passes. If an earlier trial made the filter's steps finer, the point is first evaluated again.

    - ``innovations``: stamps, innovations and variances of every segment.
    - ``each`` (segments,): log-likelihood of each segment.
    - ``total``: log-likelihood of all segments.
    """

    def __init__(self, objective: NoisyObjective, x: Array, innovations: Innovations, each: Array) -> None:
        self.objective, self.x, self.innovations, self.each = objective, x, innovations, each
        self.total = float(each.sum())

    @property
    def cost(self) -> float:
        """Minus twice the log-likelihood of the innovations."""
        return -2.0 * self.total

    @property
    def gradient(self) -> Array:
        """Half the gradient (q,) of the cost by the unknowns."""
        return self._slopes[0]

    @property
    def curvature(self) -> Array:
        """Expected information (q, q) on the unknowns."""
        return self._slopes[1]

    @cached_property
    def _slopes(self) -> tuple[Array, Array]:
        eased = self.objective.eased(self.x, self)
        self.innovations, self.each, self.total = eased.innovations, eased.each, eased.total
        return self.objective.slopes(self)


class NoisyObjective(FreeNumbers):
    """Minus the log-likelihood of the innovations, as a function of all unknowns.

    The unknowns are the base parameters, the parameters of effects, and the logarithms of the noise parameters
    (:attr:`ProcessNoise.unknowns`).

    held : parameters of effects that stay fixed, as (slug, place, name).
    """

    def __init__(
        self,
        problem: NoiseFilter,
        theta: Array,
        effects: Sequence[EffectInstance],
        noise: ProcessNoise,
        held: Collection[tuple[str, str, str]] = (),
    ) -> None:
        super().__init__(problem, theta, np.arange(len(theta)), effects, held=held)
        self.problem, self.noise = problem, noise
        self.names = noise.unknowns
        self.levels = len(self.names)
        longest = 10.0 * max(float(s.stamps[-1]) - s.start for s in problem.segments)
        step = max((next(iter(s.signals.values())).step for s in problem.segments), default=0.0)
        rates = np.concatenate([np.abs(np.diff(next(iter(s.signals.values())).values)) for s in problem.segments])
        finest = max(step / math.sqrt(12.0), 1e-3 * float(np.median(rates)), 1e-9)
        between = problem.data_summary.interval
        bounds = {
            "size": (1e-12, 1e6),
            "memory": (SHORTEST_MEMORY * problem.interval, longest),
            "sensor": (finest, 1e6),
            "smoothing": (LEAST_SMOOTHING * between, MOST_SMOOTHING * between),
            "wave_swing": (1e-2 * finest, 1e6),
            "wave_force": (1e-12, 1e6),
            "wave_frequency": (2.0 * math.pi / LONGEST_WAVE, math.pi / problem.interval),
            "wave_damping": (LEAST_DAMPING, MOST_DAMPING),
        }
        low, high = problem.edges(self.effects, self.free_effects)
        of_noise = np.log([bounds[n] for n in self.names])
        self.low, self.high = np.concatenate([low, of_noise[:, 0]]), np.concatenate([high, of_noise[:, 1]])
        spans = 0.02 * (high - low)
        spans[: len(theta)] = np.inf
        self.widest = np.append(np.where(np.isfinite(spans), spans, np.inf), np.full(self.levels, 0.1))
        self.reach = np.append(np.full(len(self.low) - self.levels, np.inf), np.full(self.levels, LONGEST_MOVE))
        self.steps: Array | None = None
        self._is_new = True
        self.information = np.eye(len(self.low))
        """Information (q, q) on the unknowns at the last point whose derivatives were calculated."""

    def pack(self) -> Array:
        """Return the current values of the unknowns as a vector (q,)."""
        every = [getattr(self.noise, n) for n in self.names]
        return np.append(self.pack_shared(), [math.log(max(v, 1e-12)) for v in every])

    def unpack(self, x: Array) -> tuple[Array, tuple[EffectInstance, ...], ProcessNoise]:
        """Return base parameters (p,), effects and process noise for the unknowns *x* (q,)."""
        levels = dict(zip(self.names, np.exp(x[-self.levels :]).tolist(), strict=True))
        return *self.unpack_shared(x), replace(self.noise, **levels)

    def clipped(self, x: Array) -> Array:
        """Return *x* (q,), clipped to the bounds of the unknowns."""
        inside: Array = np.clip(x, self.low, self.high)
        return inside

    def first_steps(self, x: Array) -> Array:
        """Return the lengths (q,) of the first finite differences at *x*, before its errors are known."""
        steps = 1e-3 * np.maximum(np.abs(x), 1e-3 * max(float(np.abs(x[: -self.levels]).max(initial=1e-6)), 1e-9))
        steps[-self.levels :] = 1e-2
        least: Array = np.minimum(steps, self.widest)
        return least

    def at(self, x: Array) -> Point | None:
        """Return the innovations at *x* (q,), or None if the filter fails."""
        innovations = self.problem.innovations_at(*self.unpack(x))
        if innovations is None:
            return None
        each = np.array([float(log_density(e, S, self.noise.freedom).sum()) for _, e, S in innovations])
        return Point(self, x, innovations, each) if math.isfinite(float(each.sum())) else None

    def begun(self, x: Array) -> Point | None:
        """Return the innovations at *x* (q,), the first of a series of points.

        If the filter fails, its step size is reset and it is run again.
        """
        here = self.at(x)
        if here is None:
            _, effects, noise = self.unpack(x)
            self.problem.afresh(effects, noise)
            here = self.at(x)
        return here

    def local(self, x: Array) -> Point | None:
        """Return the innovations at *x* (q,), or None if the filter fails.

        The first call uses :meth:`begun` and later calls use :meth:`at`.
        """
        first, self._is_new = self._is_new, False
        return self.begun(x) if first else self.at(x)

    def eased(self, x: Array, here: Point) -> Point:
        """Return *here*, evaluated again if an earlier trial made the filter's steps finer than necessary."""
        _, effects, noise = self.unpack(x)
        return (self.at(x) or here) if self.problem.ease(effects, noise) else here

    def slopes(self, here: Point) -> tuple[Array, Array]:
        """Return half the gradient (q,) of the cost, and the expected information (q, q).

        Both come from differences of filter passes.
        """
        x = here.x
        gradient, self.information = self.gathered(*self.derivatives(x, here, self._steps_at(x)), here)
        self.steps = self.steps_for(x, np.sqrt(np.maximum(np.diag(self.information), 1e-30)))
        return -gradient, self.information

    def _steps_at(self, x: Array) -> Array:
        return self.first_steps(x) if self.steps is None else self.steps

    def steps_for(self, x: Array, scale: Array) -> Array:
        """Return the lengths (q,) of finite differences about *x* (q,).

        scale : inverse standard errors.
        """
        steps: Array = np.minimum(np.maximum(STEP / scale, 1e-9 * np.abs(x) + 1e-12), self.widest)
        return steps

    def derivatives(self, x: Array, here: Point, steps: Array) -> tuple[Array, Array]:
        """Return the derivatives (q, samples) of innovations and of the logarithms of their variances."""
        samples = sum(len(r[1]) for r in here.innovations)
        J, D = np.zeros((len(x), samples)), np.zeros((len(x), samples))
        for i in range(len(x)):
            J[i], D[i] = self.derivative(i, x, here, steps[i])
        return J, D

    def derivative(self, i: int, x: Array, here: Point, step: float) -> tuple[Array, Array]:
        """Return the derivatives (samples,) of innovations and log variances by unknown *i*.

        They are 0 if the filter fails.
        """
        e, S = (np.concatenate([r[k] for r in here.innovations]) for k in (1, 2))
        moved = x.copy()
        moved[i] += step if x[i] + step <= self.high[i] else -step
        other = self.at(moved)
        if other is None or moved[i] == x[i]:
            return np.zeros(len(e)), np.zeros(len(e))
        by = moved[i] - x[i]
        then, wider = (np.concatenate([r[k] for r in other.innovations]) for k in (1, 2))
        return (then - e) / by, (np.log(wider) - np.log(S)) / by

    def gathered(self, J: Array, D: Array, here: Point) -> tuple[Array, Array]:
        """Return the gradient (q,) of the log-likelihood at *here*, and the expected information (q, q).

        J, D : derivatives (q, samples) of the innovations and of the logarithms of their variances.
        """
        e, S = (np.concatenate([r[k] for r in here.innovations]) for k in (1, 2))
        nu = self.noise.freedom
        if math.isinf(nu):
            by_e, by_log, info_e, info_log = -e / S, -0.5 + 0.5 * e * e / S, 1.0 / S, np.full(len(S), 0.5)
        else:
            s = S * (nu - 2.0) / nu
            w = (nu + 1.0) / (nu * s + e * e)
            by_e, by_log = -w * e, -0.5 + 0.5 * w * e * e
            info_e, info_log = (nu + 1.0) / ((nu + 3.0) * s), np.full(len(S), nu / (2.0 * (nu + 3.0)))
        return J @ by_e + D @ by_log, (J * info_e) @ J.T + (D * info_log) @ D.T


def log_density(e: Array, S: Array, freedom: float) -> Array:
    """Return the log density of innovations *e* of variance *S*.

    freedom : degrees of freedom of Student's distribution, infinite for the normal one.
    """
    density: Array
    if math.isinf(freedom):
        density = -0.5 * (e * e / S + np.log(2.0 * np.pi * S))
        return density
    s = S * (freedom - 2.0) / freedom
    constant = gammaln(0.5 * (freedom + 1.0)) - gammaln(0.5 * freedom) - 0.5 * math.log(freedom * math.pi)
    density = constant - 0.5 * np.log(s) - 0.5 * (freedom + 1.0) * np.log1p(e * e / (freedom * s))
    return density
