"""The likelihood of a fit with process noise over its unknowns in a row, with its slopes and its information.

Derivatives are differences of passes of the filter.
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
from gcs_autotune.identify.free_numbers import FreeNumbers
from gcs_autotune.identify.kalman.noise_filter import NoiseFilter
from gcs_autotune.identify.kalman.process_noise import ProcessNoise

__all__ = ["LEAST_DAMPING", "LONGEST_WAVE", "MOST_DAMPING", "NoisyObjective", "log_density"]

Array = NDArray[np.float64]

Innovations = tuple[tuple[Array, Array, Array], ...]
"""Stamps, innovations and their variances of every segment, (n,) each."""

STEP = 0.3
"""Chosen: length of a difference in standard errors, all else held. Where unknowns go together that is a small share of
their own error, and with a step of 0.02 rounding ended a fit 1.3 nats early, its errors half of what they are."""

LONGEST_MOVE = 2.0
"""Longest step of a logarithm."""

LEAST_SMOOTHING, MOST_SMOOTHING = 0.2, 8.0
"""Time constants of a smoother, in samples of the record."""

LONGEST_WAVE = 20.0
"""Longest period [s] of waves: what is slower pushes, and is the drifting force's."""

LEAST_DAMPING, MOST_DAMPING = 0.03, 0.5
"""Damping ratios of waves: narrower is a machine's hum, wider no band (Fossen2011 fits 0.1 to 0.26 to usual seas)."""

SHORTEST_MEMORY = 2.0
"""Least time constant of the force, in intervals between samples: quicker, it is noise of the sensor's kind."""


class Point:
    """Innovations at one place ``x`` (q,): minus twice their log-likelihood is the cost.

    ``innovations``: stamps, innovations and variances of every segment; ``total`` their log-likelihood, ``each`` that
    of each segment. The slopes are calculated when they are asked for, by differences of passes of the filter; where a
    trial before it had the filter's steps made finer, it is first looked at again.
    """

    def __init__(self, objective: NoisyObjective, x: Array, innovations: Innovations, each: Array) -> None:
        self.objective, self.x, self.innovations, self.each = objective, x, innovations, each
        self.total = float(each.sum())

    @property
    def cost(self) -> float:
        """Minus twice the log-likelihood."""
        return -2.0 * self.total

    @property
    def gradient(self) -> Array:
        """Half the gradient (q,) of the cost."""
        return self._slopes[0]

    @property
    def curvature(self) -> Array:
        """The expected information (q, q)."""
        return self._slopes[1]

    @cached_property
    def _slopes(self) -> tuple[Array, Array]:
        eased = self.objective.eased(self.x, self)
        self.innovations, self.each, self.total = eased.innovations, eased.each, eased.total
        return self.objective.slopes(self)


class NoisyObjective(FreeNumbers):
    """Minus the log-likelihood of the innovations, as a function of all unknowns in a row.

    These are base parameters, effects' numbers, and logarithms of the noise's (:attr:`ProcessNoise.unknowns`).

    held : numbers of effects that stay as they are.
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
        """Of the last place whose slopes were asked for."""

    def pack(self) -> Array:
        """Return the unknowns (q,) of the numbers given."""
        every = [getattr(self.noise, n) for n in self.names]
        return np.append(self.pack_shared(), [math.log(max(v, 1e-12)) for v in every])

    def unpack(self, x: Array) -> tuple[Array, tuple[EffectInstance, ...], ProcessNoise]:
        """Return base parameters (p,), effects and process noise of the unknowns *x* (q,)."""
        levels = dict(zip(self.names, np.exp(x[-self.levels :]).tolist(), strict=True))
        return *self.unpack_shared(x), replace(self.noise, **levels)

    def clipped(self, x: Array) -> Array:
        """Return *x* (q,) within its bounds."""
        inside: Array = np.clip(x, self.low, self.high)
        return inside

    def first_steps(self, x: Array) -> Array:
        """Return the lengths (q,) of the first differences at *x*, before an error of it is known."""
        steps = 1e-3 * np.maximum(np.abs(x), 1e-3 * max(float(np.abs(x[: -self.levels]).max(initial=1e-6)), 1e-9))
        steps[-self.levels :] = 1e-2
        least: Array = np.minimum(steps, self.widest)
        return least

    def at(self, x: Array) -> Point | None:
        """Return the innovations at *x* (q,); None where the filter fails."""
        found = self.problem.innovations_at(*self.unpack(x))
        if found is None:
            return None
        each = np.array([float(log_density(e, S, self.noise.freedom).sum()) for _, e, S in found])
        return Point(self, x, found, each) if math.isfinite(float(each.sum())) else None

    def begun(self, x: Array) -> Point | None:
        """Return :meth:`at` the first *x* (q,) of a series, with steps anew where those of an earlier one fail."""
        here = self.at(x)
        if here is None:
            _, effects, noise = self.unpack(x)
            self.problem.afresh(effects, noise)
            here = self.at(x)
        return here

    def local(self, x: Array) -> Point | None:
        """Return :meth:`begun` the first time, :meth:`at` after that."""
        first, self._is_new = self._is_new, False
        return self.begun(x) if first else self.at(x)

    def eased(self, x: Array, here: Point) -> Point:
        """Return *x*, the last looked at, again where a trial before it had the filter's steps made finer: *here*."""
        _, effects, noise = self.unpack(x)
        return (self.at(x) or here) if self.problem.ease(effects, noise) else here

    def slopes(self, here: Point) -> tuple[Array, Array]:
        """Return half the gradient (q,) and the expected information (q, q), by differences of passes."""
        x = here.x
        gradient, self.information = self.gathered(*self.derivatives(x, here, self._steps_at(x)), here)
        self.steps = self.steps_for(x, np.sqrt(np.maximum(np.diag(self.information), 1e-30)))
        return -gradient, self.information

    def _steps_at(self, x: Array) -> Array:
        return self.first_steps(x) if self.steps is None else self.steps

    def steps_for(self, x: Array, scale: Array) -> Array:
        """Return the lengths (q,) of differences about *x* (q,), of which *scale* are the inverse standard errors."""
        steps: Array = np.minimum(np.maximum(STEP / scale, 1e-9 * np.abs(x) + 1e-12), self.widest)
        return steps

    def derivatives(self, x: Array, here: Point, steps: Array) -> tuple[Array, Array]:
        """Return the derivatives (q, samples) of innovations and log variances."""
        samples = sum(len(r[1]) for r in here.innovations)
        J, D = np.zeros((len(x), samples)), np.zeros((len(x), samples))
        for i in range(len(x)):
            J[i], D[i] = self.derivative(i, x, here, steps[i])
        return J, D

    def derivative(self, i: int, x: Array, here: Point, step: float) -> tuple[Array, Array]:
        """Return the derivatives (samples,) of innovations and log variances by unknown *i*; 0 for one that cannot."""
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
        """Return gradient and expected information at *here* with these derivatives."""
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
    """Return the log density of innovations of variance *S*, Student's of that *freedom* or normal."""
    density: Array
    if math.isinf(freedom):
        density = -0.5 * (e * e / S + np.log(2.0 * np.pi * S))
        return density
    s = S * (freedom - 2.0) / freedom
    constant = gammaln(0.5 * (freedom + 1.0)) - gammaln(0.5 * freedom) - 0.5 * math.log(freedom * math.pi)
    density = constant - 0.5 * np.log(s) - 0.5 * (freedom + 1.0) * np.log1p(e * e / (freedom * s))
    return density
