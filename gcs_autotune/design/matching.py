"""Select gains inside the documented ranges with which the simulated step follows the reference model.

Without a user-supplied specification, :mod:`gcs_autotune.design.refinement` improves the result. Algebra gives the
start values, and bounded least squares fits the simulated response. The response consists of a step, a smaller step in
the other direction, and a constant disturbance halfway (so that integral action has a benefit). Margins and noise are
further residuals, which are zero inside their limits. Deviations from the start values have a small weight. Gains
without effect on the response therefore stay near their start values.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from gcs_autotune.control import ReferenceModel, settling_time, wanted_step
from gcs_autotune.design.actuator import PERFECT, Actuator
from gcs_autotune.design.laws import Law, Scenario, Settings
from gcs_autotune.design.laws.loops import linearisations, peak_demand
from gcs_autotune.design.margins import Plant, margins_of_each, worst
from gcs_autotune.design.open_loop import OpenLoop, constant, open_loop, slow
from gcs_autotune.design.plant import Region
from gcs_autotune.design.result import Margins
from gcs_autotune.design.spec import Spec
from gcs_autotune.firmware import Gain
from gcs_autotune.models import SingleDof

__all__ = [
    "NOISE_LIMIT",
    "DesignProblem",
    "integral_shortfall",
    "linearisations",
    "match",
    "output_noise",
    "peak_demand",
    "round_gain",
]

Array = NDArray[np.float64]

NOISE_LIMIT = 0.05
"""Largest actuator motion that measurement noise may cause (rms, fraction of full).

Project choice: more noise wears the actuator.
"""
PUSH = 0.06
"""Constant force in the second half of the simulation, relative to the largest output of the required step.

Project choice.
"""
PUSH_WEIGHT = 0.5
INTEGRAL, TRIM_TIME = 0.05, 30.0
"""Limits for the slowest removal of constant forces. Project choice.

- ``INTEGRAL``: smallest rate of removal, relative to the reference model's speed ``1/a1``.
- ``TRIM_TIME`` [s]: a removal faster than 30 s is not required. If ``ATC_STR_ANG_P`` cannot be low enough, integral
  action causes overshoot.
"""
SAMPLES = 80
RELUCTANCE = 0.02
"""Weight of a deviation of a gain from its start value, in units of its documented range.

Project choice. The residuals of the response are rms fractions of the step.
"""
RESERVE = 1.05
"""Factor by which margins must exceed the specification, as a reserve for rounding and for compromises of least
squares. Project choice.
"""
HARDEST = 2
"""Number of samples of the 95 % region whose margins are checked during a descent: those with the worst margins at
its start. Project choice.
"""
DESCENTS = 3
"""Maximum number of descents for a user-supplied specification. Project choice."""
MARGIN_WEIGHT = 0.5
DIFFERENCE = 1e-3
"""Step of finite differences, as a fraction of a gain's range. Project choice."""
WORST_RESIDUAL = 3.0
DIGITS = 4


@dataclass(frozen=True, slots=True, eq=False)
class DesignProblem:
    """Inputs of the design of one loop, except the specification of its speed.

    - ``delay`` [s]: delay in addition to that of the model.
    - ``present_overshoot``: overshoot of the same step with the present gains.
    - ``late``: gains that only refinement changes.
    """

    law: Law
    gains: Sequence[Gain]
    region: Region
    settings: Settings
    spec: Spec
    step: float
    delay: float
    present_overshoot: float = 0.0
    actuator: Actuator = PERFECT
    late: Sequence[Gain] = ()

    @property
    def model(self) -> SingleDof:
        """The identified model."""
        return self.region.model

    @property
    def speed(self) -> float | None:
        """Speed [m/s] at which the gains are matched."""
        return self.law.matching_speed(self.settings, self.spec.speed)

    def with_gains(self, x: Array) -> dict[str, float]:
        """Return the settings with the tuned gains set to *x* (n,), given as fractions of their ranges."""
        tuned = {g.parameter: g.low + float(v) * (g.high - g.low) for g, v in zip(self.gains, x, strict=True)}
        return {**self.settings, **self.law.fixed, **self.spec.measured, **tuned}

    def as_fractions(self, values: Mapping[str, float]) -> Array:
        """Return the gains in *values* as fractions (n,) of their ranges, limited to 0 and 1."""
        x = [(values[g.parameter] - g.low) / (g.high - g.low) for g in self.gains]
        known = np.nan_to_num(np.array(x, dtype=np.float64), nan=0.5, posinf=1.0, neginf=0.0)
        inside: Array = np.clip(known, 0.0, 1.0)
        return inside

    def margins(self, settings: Settings, wanted: ReferenceModel, models: Sequence[SingleDof]) -> list[Margins]:
        """Return the margins for each of *models*: the smaller of those at rest and in the motion of *wanted*."""
        controller = self.law.controller(settings, self.speed) * slow(self.actuator.lag)
        plants, counts = [], []
        for m in models:
            own = self._plants(m, settings, wanted)
            plants += own
            counts.append(len(own))
        each = iter(margins_of_each(controller, plants))
        return [worst([next(each) for _ in range(count)]) for count in counts]

    def loops(self, settings: Settings, wanted: ReferenceModel, model: SingleDof | None = None) -> tuple[OpenLoop, ...]:
        """Return the open loops that :meth:`margins` evaluates, opened at the actuator (*model* None: identified)."""
        controller = self.law.controller(settings, self.speed) * slow(self.actuator.lag)
        plants = self._plants(model or self.model, settings, wanted)
        return tuple(open_loop(constant(p.gain) * controller, *p[1:]) for p in plants)

    def _plants(self, model: SingleDof, settings: Settings, wanted: ReferenceModel) -> list[Plant]:
        """Return the plants of the controller: *model* at rest and in motion, for small and for large outputs."""
        drags = self.law.drags(model, wanted, self.step, self.speed)
        gains = self.law.slopes(self.actuator, model, self.step, settings, self.speed)
        late = model.delay + self.delay
        return [Plant(g, model.alpha, d, late, model.restoring) for d in drags for g in gains]

    def demand(self, model: SingleDof, wanted: ReferenceModel) -> tuple[float, float]:
        """Return the actuator use [fraction] and the largest velocity or acceleration, for following *wanted*
        exactly.
        """
        return self.law.demand(model, wanted, self.step, self.settings, self.spec.speed)

    def hardest(self, settings: Settings, wanted: ReferenceModel, count: int) -> list[SingleDof]:
        """Return the *count* samples of the 95 % region with the smallest margins for *settings*."""
        samples, spec = self.region.samples, self.spec
        found = self.margins(settings, wanted, samples)
        ease = [min(m.phase / spec.phase_margin, m.gain / spec.gain_margin) for m in found]
        return [samples[i] for i in np.argsort(ease, kind="stable")[:count]]


def integral_shortfall(problem: DesignProblem, settings: Settings, wanted: ReferenceModel) -> float:
    """Return the fraction by which the removal of a constant force is too slow, or 0 if it is fast enough.

    The requirement is relaxed if the integral gain's range does not permit it.
    """
    law, speed = problem.law, problem.speed
    high = next(g.high for g in problem.gains if g.parameter == law.integral)
    rate = min(INTEGRAL / wanted.a1, 1.0 / TRIM_TIME, law.integral_rate({**settings, law.integral: high}, speed))
    return max(0.0, 1.0 - law.integral_rate(settings, speed) / max(rate, 1e-12))


def output_noise(problem: DesignProblem, settings: Settings) -> float:
    """Return the rms of the actuator's motion [fraction of full] due to measurement noise of the position, white up
    to its bandwidth.
    """
    spec = problem.spec
    if spec.jitter == 0.0:
        return 0.0
    size = np.abs(problem.law.position_path(settings, problem.speed).at(_noise_axis(spec.noise_bandwidth)))
    return float(spec.jitter * np.sqrt(np.mean(size**2)))


@lru_cache(maxsize=16)
def _noise_axis(bandwidth: float) -> NDArray[np.complex128]:
    """Return complex frequencies (50,) [rad/s] up to *bandwidth* [Hz]."""
    return (1j * np.linspace(0.02, 1.0, 50) * math.tau * bandwidth).astype(np.complex128)


def match(problem: DesignProblem, wanted: ReferenceModel, start: Settings | None = None) -> dict[str, float]:
    """Return the gains (rounded, inside their ranges) whose simulated step is closest to *wanted*.

    Descents may start at the algebraic gains, the present gains and *start* (gains for a neighbouring specification).
    Each descent has a small weight towards its start. For a user-supplied specification descents from several starts
    are made, otherwise only from the best start.
    """
    residuals = _Residuals(problem, wanted)
    algebra = problem.law.starts(problem.model, wanted, problem.settings, problem.speed)
    anchors = [problem.as_fractions(g) for g in [*algebra, *([start] if start else []), problem.settings]]
    anchors.sort(key=lambda a: float(np.sum(residuals(a, a) ** 2)))
    residuals.watch(problem.with_gains(anchors[0]))
    descents = 1 if problem.spec.is_automatic else DESCENTS
    ends = [_descended(residuals, anchor) for anchor in anchors[:descents]]
    values = problem.with_gains(min(ends, key=lambda x: float(np.sum(residuals(x, x) ** 2))))
    return {g.parameter: round_gain(values[g.parameter], g) for g in problem.gains}


def _descended(residuals: _Residuals, anchor: Array) -> Array:
    """Return the end point of a descent that starts at *anchor* (n,)."""
    found = least_squares(
        residuals,
        np.clip(anchor, 1e-6, 1.0 - 1e-6),
        jac=residuals.jacobian,
        bounds=(0.0, 1.0),
        args=(anchor,),
        max_nfev=30,
        ftol=1e-5,
        xtol=1e-5,
    )
    end: Array = found.x
    return end


def round_gain(value: float, gain: Gain) -> float:
    """Return *value* with four significant digits (float32 has seven), limited to the gain's range."""
    if abs(value - gain.low) < 1e-4 * (gain.high - gain.low):
        return gain.low
    return min(max(float(f"{value:.{DIGITS}g}"), gain.low), gain.high)


class _Residuals:
    """Residual vector of the least-squares problem, for one design problem and one specification."""

    def __init__(self, problem: DesignProblem, wanted: ReferenceModel) -> None:
        self._problem = problem
        self._reference = wanted
        self._watched = [problem.model]
        span = 3.0 * settling_time(wanted.kind, wanted.omega_0)
        step = problem.step
        peak = min(problem.demand(problem.model, wanted)[0], 1.0)
        self._scenarios = (Scenario(step, 2.0 * span, PUSH * peak, span), Scenario(-step / 3.0, span))
        self._times = [np.linspace(0.0, s.duration, SAMPLES) for s in self._scenarios]
        self._wanted = [wanted_step(wanted, t).position for t in self._times]
        self._weights = [
            np.where(t > s.push_at, PUSH_WEIGHT, 1.0) / math.sqrt(SAMPLES)
            for t, s in zip(self._times, self._scenarios, strict=True)
        ]
        self._last: tuple[bytes, Array, Array] | None = None

    def watch(self, settings: Settings) -> None:
        """Include the margins of the worst samples for *settings*, in addition to those of the model."""
        self._watched = [self._problem.model, *self._problem.hardest(settings, self._reference, HARDEST)]
        self._last = None

    def __call__(self, x: Array, anchor: Array) -> Array:
        """Return the residual vector at *x*.

        It is cached, because least squares next needs the slopes at the point of its last step.
        """
        key = x.tobytes()
        if self._last is not None and self._last[0] == key and self._last[1] is anchor:
            return self._last[2].copy()
        found = self._residuals(x, anchor)
        self._last = (key, anchor, found)
        return found.copy()

    def _residuals(self, x: Array, anchor: Array) -> Array:
        problem = self._problem
        settings = problem.with_gains(x)
        parts = [RELUCTANCE * (x - anchor), self._shortfalls(settings)]
        for scenario, t, wanted, weight in zip(self._scenarios, self._times, self._wanted, self._weights, strict=True):
            motion = problem.law.simulate(
                problem.model, settings, scenario, problem.speed, problem.delay, problem.actuator
            )
            share = np.interp(t, motion.t, motion.position) / scenario.step
            error = np.nan_to_num(share - wanted, nan=WORST_RESIDUAL)
            parts.append(weight * np.clip(error, -WORST_RESIDUAL, WORST_RESIDUAL))
        return np.concatenate(parts)

    def jacobian(self, x: Array, anchor: Array) -> Array:
        """Return the Jacobian by forward differences; at the upper bound, by backward differences."""
        base = self(x, anchor)
        columns = []
        for i in range(len(x)):
            h = DIFFERENCE if x[i] + DIFFERENCE <= 1.0 else -DIFFERENCE
            moved = x.copy()
            moved[i] += h
            columns.append((self._residuals(moved, anchor) - base) / h)
        return np.stack(columns, axis=1)

    def _shortfalls(self, settings: Settings) -> Array:
        problem, spec = self._problem, self._problem.spec
        lacks = []
        for m in problem.margins(settings, self._reference, self._watched):
            lacks.append(max(0.0, 1.0 - m.gain / (RESERVE * spec.gain_margin)))
            lacks.append(max(0.0, 1.0 - m.phase / (RESERVE * spec.phase_margin)))
        lacks.append(integral_shortfall(problem, settings, self._reference))
        noise = output_noise(problem, settings) / NOISE_LIMIT
        lacks.append(min(max(0.0, RESERVE * noise - 1.0), WORST_RESIDUAL))
        return MARGIN_WEIGHT * np.array(lacks)
