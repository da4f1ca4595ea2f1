"""Numba pieces the simulated loops share: the craft, and the autopilot's filters and limiters.

Written from the behaviour documented for ArduPilot (AC_PID, control.cpp's sqrt_controller,
LowPassFilter2p), not from its source text. Numba's on-disk cache does not notice a change in *this* file from
the files that use it: delete ``__pycache__`` after editing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gcs_autotune.design.actuator import PERFECT, Actuator, ActuatorStep
from gcs_autotune.design.laws.law import Scenario
from gcs_autotune.models import SingleDof

__all__ = [
    "MAX_STANDING_ERROR",
    "Cutoffs",
    "GyroFilter",
    "HeldVelocity",
    "LoopPlant",
    "actuate",
    "advance",
    "clip",
    "compiled",
    "delayed",
    "gyro_coefficients",
    "mixed",
    "plant_of",
    "smoothing",
    "sqrt_control",
    "wrap",
]

compiled: Callable[[Callable[..., Any]], Callable[..., Any]] = njit(cache=True)
"""Compile a function of floats and arrays."""

MAX_STANDING_ERROR = 0.5
"""A loop without integral action starts from the error it would stand at, at most this [rad or m]."""
FINEST = 0.1
"""A substep of the craft's motion may take at most this share of its shortest time constant."""
MAX_SUBSTEPS = 50
HELD = 0.5
"""Loops by which an output that is held for one acts late on the mean."""


class LoopPlant(NamedTuple):
    """What the kernels need of craft and scenario, all floats.

    ``alpha``, ``beta``, ``beta_quadratic``, ``delta`` of the craft, moved in ``substeps`` each loop of ``dt`` [s];
    ``late`` the delay in loops; the ``step`` at loop ``step_at``, taken back at ``back_at``; a ``push`` (fraction) from
    ``push_at`` on; ``settled`` constant force already worked off.
    """

    alpha: float
    beta: float
    beta_quadratic: float
    delta: float
    dt: float
    substeps: float
    late: float
    step: float
    push: float
    push_at: float
    step_at: float
    settled: float
    back_at: float


class GyroFilter(NamedTuple):
    """Coefficients of a second-order low-pass: ``y = b0 x + b1 x1 + b2 x2 - a1 y1 - a2 y2``."""

    b0: float
    b1: float
    b2: float
    a1: float
    a2: float


class Cutoffs(NamedTuple):
    """Cut-offs [Hz] of the low-passes on target, error and the error's slope; 0: none."""

    target: float
    error: float
    slope: float


class HeldVelocity(NamedTuple):
    """How a loop on a velocity begins: the ``velocity`` kept, the ``output`` that keeps it, for ``before`` loops."""

    velocity: float
    output: float
    before: float


def _clip(value: float, low: float, high: float) -> float:
    return low if value < low else (min(high, value))


def _wrap(angle: float) -> float:
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


def _sqrt_control(error: float, p: float, limit: float) -> float:
    """Proportional near zero, square root beyond, so that the demand never asks for more than *limit* to stop."""
    if limit <= 0.0 or p <= 0.0:
        return error * p
    linear = limit / (p * p)
    if error > linear:
        return math.sqrt(2.0 * limit * (error - 0.5 * linear))
    if error < -linear:
        return -math.sqrt(2.0 * limit * (-error - 0.5 * linear))
    return error * p


def _smoothing(cutoff: float, dt: float) -> float:
    """Share of the new sample in a first-order low-pass of *cutoff* [Hz]; 1 (no filter) when it is zero."""
    if cutoff <= 0.0:
        return 1.0
    return dt / (dt + 1.0 / (2.0 * math.pi * cutoff))


def _advance(position: float, velocity: float, force: float, plant: LoopPlant) -> tuple[float, float]:
    """Move the craft one loop period under constant *force* (fraction)."""
    alpha, beta, quadratic, delta = plant.alpha, plant.beta, plant.beta_quadratic, plant.delta
    steps = int(plant.substeps)
    h = plant.dt / steps
    for _ in range(steps):
        a1 = (force + delta - (beta + quadratic * abs(velocity)) * velocity) / alpha
        middle = velocity + 0.5 * h * a1
        a2 = (force + delta - (beta + quadratic * abs(middle)) * middle) / alpha
        position += h * (velocity + 0.5 * h * a1)
        velocity += h * a2
    return position, velocity


def _mixed(steering: float, throttle: float) -> float:
    """Return what of *steering* two thrusters give that drive with *throttle* too, shared fairly (MOT_STR_THR_MIX 0.5).

    *throttle* is 0 where something else drives.
    """
    wanted = abs(steering) + throttle
    return steering / wanted if throttle > 0.0 and wanted > 1.0 else steering


clip = compiled(_clip)
mixed = compiled(_mixed)
wrap = compiled(_wrap)
sqrt_control = compiled(_sqrt_control)
smoothing = compiled(_smoothing)
advance = compiled(_advance)


def _actuate(output: float, actuator: ActuatorStep, memory: NDArray[np.float64]) -> float:
    """Return the force that *output* gives.

    memory : (4,) whether it has begun, and where limiter, lag and play are; changed. It begins settled at *output*.
    """
    if actuator.acts == 0.0:
        return output
    wish = clip(output, -actuator.limit, actuator.limit)
    if memory[0] == 0.0:
        memory[0], memory[1], memory[2] = 1.0, wish, wish
        memory[3] = wish - clip(wish, -actuator.play, actuator.play)
    memory[1] = clip(wish, memory[1] - actuator.rate, memory[1] + actuator.rate)
    memory[2] += actuator.lag * (memory[1] - memory[2])
    memory[3] = min(max(memory[3], memory[2] - actuator.play), memory[2] + actuator.play)
    u = memory[3]
    size = abs(u) - actuator.lost if abs(u) > actuator.dead_zone else 0.0
    size *= 1.0 - actuator.square + actuator.square * size / actuator.reference
    return float(actuator.ahead * size if u >= 0.0 else -actuator.astern * size)


actuate = compiled(_actuate)


def _delayed(sent: NDArray[np.float64], k: int, late: float, before: float) -> float:
    """Return what acts, on the mean, during loop *k* of outputs that are *late* (in loops, besides being held for one).

    *before* acts until the first of *sent* arrives.
    """
    whole = int(late)
    new = sent[k - whole] if k >= whole else before
    old = sent[k - whole - 1] if k > whole else before
    return float(new + (late - whole) * (old - new))


delayed = compiled(_delayed)


def plant_of(model: SingleDof, scenario: Scenario, dt: float, delay: float, actuator: Actuator = PERFECT) -> LoopPlant:
    """Return what the kernels need of craft and scenario.

    Holding an output for a loop delays it by half a loop, which is part of *delay* and happens by itself here: it is
    taken out.
    """
    fastest = abs(model.beta) + 2.0 * model.beta_quadratic * abs(model.steady_velocity(1.0 - model.delta))
    rate = fastest / model.alpha if math.isfinite(fastest) else 0.0
    substeps = min(max(math.ceil(dt * rate / FINEST), 1), MAX_SUBSTEPS)
    push_at = scenario.push_at / dt if math.isfinite(scenario.push_at) else 1e12
    return LoopPlant(
        alpha=model.alpha,
        beta=model.beta,
        beta_quadratic=model.beta_quadratic,
        delta=model.delta,
        dt=dt,
        substeps=substeps,
        late=max((model.delay + delay) / dt - HELD, 0.0),
        step=scenario.step,
        push=scenario.push,
        push_at=push_at,
        step_at=round(scenario.lead / dt),
        settled=-actuator.output_for(-model.delta) if scenario.lead == 0.0 else 0.0,
        back_at=round(scenario.back_at / dt) if math.isfinite(scenario.back_at) else 1e12,
    )


def gyro_coefficients(cutoff: float, rate: float) -> GyroFilter:
    """Return a Butterworth low-pass of *cutoff* [Hz] sampled at *rate* [Hz].

    Bilinear with pre-warping; transparent when the cut-off is zero or too near half the rate.
    """
    if cutoff <= 0.0 or cutoff >= 0.45 * rate:
        return GyroFilter(1.0, 0.0, 0.0, 0.0, 0.0)
    w = math.tan(math.pi * cutoff / rate)
    scale = 1.0 / (1.0 + math.sqrt(2.0) * w + w * w)
    b0 = w * w * scale
    return GyroFilter(b0, 2.0 * b0, b0, 2.0 * (w * w - 1.0) * scale, (1.0 - math.sqrt(2.0) * w + w * w) * scale)
