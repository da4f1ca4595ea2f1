"""The compiled simulation that every law uses: position, velocity and acceleration loops in cascade, with a craft.

A law sets the stages that its autopilot has (:class:`Cascade`); stages at their defaults are omitted. The code follows
the behaviour documented for ArduPilot (AC_PID, control.cpp's sqrt_controller, LowPassFilter2p), not its source text.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.design.actuator import PERFECT, Actuator, ActuatorStep
from gcs_autotune.design.laws.law import Scenario
from gcs_autotune.jit import entry, inlined, pasted
from gcs_autotune.models import SingleDof

__all__ = [
    "AT_REST",
    "Cascade",
    "LoopPlant",
    "StartingVelocity",
    "fly",
    "gyro_coefficients",
    "plant_of",
    "shaped_throttle",
]

# ``min`` and ``max`` are not used here: each is compiled again for every kind of number it is given.

MAX_STANDING_ERROR = 0.5
"""Largest initial error [rad or m] of a loop without integral action.

Project choice. Such a loop starts at the error that the craft's constant force causes.
"""
FINEST = 0.1
"""Longest substep of the craft's motion, relative to its shortest time constant. Project choice."""
MAX_SUBSTEPS = 50
SATURATED = 0.999
"""Output [fraction of full] from which a low-pass filtered output counts as saturated, because it never quite
reaches 1. Project choice.
"""
HELD = 0.5
"""Mean delay, in loops, of an output that is held for one loop."""


class LoopPlant(NamedTuple):
    """Data on craft and scenario for the compiled simulation, all floats.

    - ``alpha``, ``beta``, ``beta_quadratic``, ``delta``: model of the craft.
    - ``substeps``: integration steps per loop of ``dt`` [s].
    - ``late``: delay [loops].
    - ``step``: size of the step.
    - ``step_at``, ``back_at``: loops at which the step starts and is reversed.
    - ``push``: constant force [fraction of full] from the loop ``push_at``.
    - ``settled``: constant force that the integral already compensates.
    - ``restoring``: moment per angle from the start, where the craft is level.
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
    restoring: float = 0.0


class GyroFilter(NamedTuple):
    """Coefficients of a second-order low-pass: ``y = b0 x + b1 x1 + b2 x2 - a1 y1 - a2 y2``."""

    b0: float
    b1: float
    b2: float
    a1: float
    a2: float


class StartingVelocity(NamedTuple):
    """Initial state of a velocity loop: the ``velocity`` to keep for ``before`` loops, the ``output`` at their
    beginning, and by how much the craft is ``ahead`` of that velocity.
    """

    velocity: float
    output: float
    before: float
    ahead: float = 0.0


AT_REST = StartingVelocity(0.0, 0.0, 0.0)


class Cascade(NamedTuple):
    """The stages of a loop, outermost first.

    All fields are floats in SI units. A switch is on if it is above 0. A stage whose fields have their defaults is
    omitted.

    **Position.** With ``on_position``, the position error times ``position_p`` is the velocity demand. An ``angle`` is
    wrapped. For large errors the demand follows a square root with ``sqrt_acceleration``. It is at most
    ``sqrt(2 |e| stop_acceleration)``. With ``leads``, the position target moves ahead of the craft, by at most
    ``lead_max``, and its velocity is fed forward. With ``shaped``, its motion is limited by ``shape_acceleration``, and
    for steps in position also by ``slew`` and the time constant ``shape_time``.

    **Velocity.** The velocity demand changes at ``acceleration`` (when it falls, at ``deceleration`` if that is not 0),
    up to ``velocity_max``. With ``nested``, a PI (``velocity_p``, ``velocity_i``, ``velocity_imax``) converts the
    velocity error to the acceleration demand. Its error is low-pass filtered at ``velocity_cutoff`` [Hz]. The PID then
    controls the craft's acceleration.

    **PID.** ``ff`` acts on the target, ``p``, ``i`` (limited to ``imax``) and ``d`` on the error. Low-pass filters [Hz,
    0: none] act on target, error and the error's slope. ``cruise`` acts on the unfiltered velocity demand. The sum is
    multiplied by ``scale`` and reduced by ``hover``. The integral is frozen unless ``grows`` is set.

    **Output.** The output is at most ``most`` and changes by at most ``slew_output`` per loop. With two thrusters, the
    output is reduced if output and ``throttle`` together exceed full output. The output does not act against the
    velocity demand unless ``brakes`` is set. The output is low-pass filtered at ``output_cutoff`` [Hz]. ``least`` and
    ``expo`` convert the output to a pulse (:func:`shaped_throttle`).
    """

    on_position: float = 0.0
    angle: float = 0.0
    position_p: float = 0.0
    sqrt_acceleration: float = 0.0
    stop_acceleration: float = 0.0
    leads: float = 0.0
    lead_max: float = math.inf
    shaped: float = 0.0
    shape_acceleration: float = 0.0
    slew: float = 0.0
    shape_time: float = 1.0
    acceleration: float = 0.0
    deceleration: float = 0.0
    velocity_max: float = math.inf
    nested: float = 0.0
    velocity_p: float = 0.0
    velocity_i: float = 0.0
    velocity_imax: float = 0.0
    velocity_cutoff: float = 0.0
    ff: float = 0.0
    p: float = 0.0
    i: float = 0.0
    d: float = 0.0
    imax: float = 0.0
    target_cutoff: float = 0.0
    error_cutoff: float = 0.0
    slope_cutoff: float = 0.0
    cruise: float = 0.0
    scale: float = 1.0
    hover: float = 0.0
    grows: float = 1.0
    most: float = 1.0
    slew_output: float = 0.0
    throttle: float = 0.0
    brakes: float = 1.0
    output_cutoff: float = 0.0
    least: float = 0.0
    expo: float = 0.0


def _clip(value: float, low: float, high: float) -> float:
    return low if value < low else (high if value > high else value)


def _wrap(angle: float) -> float:
    if -math.pi <= angle < math.pi:  # as nearly always: a division less
        return angle
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


def _sqrt_control(error: float, p: float, limit: float) -> float:
    """Return a velocity that is proportional to *error* near zero and follows a square root beyond.

    Stopping then never needs more deceleration than *limit*.
    """
    if limit <= 0.0 or p <= 0.0:
        return error * p
    linear = limit / (p * p)
    if error > linear:
        return math.sqrt(2.0 * limit * (error - 0.5 * linear))
    if error < -linear:
        return -math.sqrt(2.0 * limit * (-error - 0.5 * linear))
    return error * p


def _smoothing(cutoff: float, dt: float) -> float:
    """Return the weight of the new sample in a first-order low-pass of *cutoff* [Hz]; 1 (no filter) if that is zero."""
    if cutoff <= 0.0:
        return 1.0
    return dt / (dt + 1.0 / (2.0 * math.pi * cutoff))


def _advance(position: float, velocity: float, force: float, plant: LoopPlant) -> tuple[float, float]:
    """Move the craft for one loop period under a constant *force* (fraction)."""
    substeps, per_inertia, force = int(plant.substeps), 1.0 / plant.alpha, force + plant.delta
    h = plant.dt / substeps
    for _ in range(substeps):  # the explicit midpoint rule
        free = force - plant.restoring * position
        slope = per_inertia * (free - (plant.beta + plant.beta_quadratic * abs(velocity)) * velocity)
        middle = velocity + 0.5 * h * slope
        free -= plant.restoring * 0.5 * h * velocity
        position += h * middle
        velocity += h * per_inertia * (free - (plant.beta + plant.beta_quadratic * abs(middle)) * middle)
    return position, velocity


def _mixed(steering: float, throttle: float) -> float:
    """Return the part of *steering* that remains if two thrusters also drive with *throttle* (MOT_STR_THR_MIX 0.5).

    *throttle* is 0 if another actuator drives the craft.
    """
    wanted = abs(steering) + throttle
    return steering / wanted if throttle > 0.0 and wanted > 1.0 else steering


def shaped_throttle(throttle: float, least: float, expo: float) -> float:
    """Return the pulse [-1, 1] that the firmware sends for *throttle* [-1, 1].

    least : smallest pulse as a fraction (MOT_THR_MIN).
    expo : curvature, as MOT_THST_EXPO.
    """
    if throttle == 0.0:
        return 0.0
    size = least + abs(throttle) * (1.0 - least)
    if expo != 0.0 and -1.0 <= expo <= 1.0:
        rest = 1.0 - expo
        root = rest * rest + 4.0 * expo * size
        size = ((math.sqrt(root) if root > 0.0 else 0.0) - rest) / (2.0 * expo)
    return size if throttle > 0.0 else -size


shape = inlined(shaped_throttle)
clip = inlined(_clip)
mixed = pasted(_mixed)
wrap = inlined(_wrap)
sqrt_control = inlined(_sqrt_control)
smoothing = inlined(_smoothing)
advance = pasted(_advance)


def _bent(u: float, actuator: ActuatorStep) -> float:
    """Return the force of a steady output *u*, with backlash taken up."""
    size = abs(u) - actuator.lost if abs(u) > actuator.dead_zone else 0.0
    size *= 1.0 - actuator.square + actuator.square * size / actuator.reference
    return float(actuator.ahead * size if u >= 0.0 else -actuator.astern * size)


bent = inlined(_bent)


def _actuate(output: float, actuator: ActuatorStep, memory: NDArray[np.float64]) -> float:
    """Return the force of *output* after the actuator's dynamics.

    memory : (4,) whether it is initialised, and the states of rate limit, lag and backlash; changed in place. The first
    call starts in the steady state of *output*.
    """
    if actuator.acts == 0.0:
        return output
    limited = clip(output, -actuator.limit, actuator.limit)
    if memory[0] == 0.0:
        memory[0], memory[1], memory[2] = 1.0, limited, limited
    memory[1] = clip(limited, memory[1] - actuator.rate, memory[1] + actuator.rate)
    memory[2] += actuator.lag * (memory[1] - memory[2])
    memory[3] = clip(memory[3], memory[2] - actuator.backlash, memory[2] + actuator.backlash)
    u, noise = memory[3], actuator.dither
    force = bent(u, actuator)
    if noise > 0.0:  # the mean over normal noise: Gauss-Hermite quadrature of five points
        near = bent(u - 1.355626 * noise, actuator) + bent(u + 1.355626 * noise, actuator)
        far = bent(u - 2.856970 * noise, actuator) + bent(u + 2.856970 * noise, actuator)
        force = 0.5333333 * force + 0.2220759 * near + 0.0112574 * far
    return float(force)


actuate = pasted(_actuate)


def _delayed(sent: NDArray[np.float64], k: int, late: float, before: float) -> float:
    """Return the mean acting output in loop *k*, for outputs held for one loop and delayed by *late* loops.

    *before* acts until the first of *sent* arrives.
    """
    whole = int(late)
    new = sent[k - whole] if k >= whole else before
    old = sent[k - whole - 1] if k > whole else before
    return float(new + (late - whole) * (old - new))


delayed = pasted(_delayed)


def _fly(
    loop: Cascade,
    gyro: GyroFilter,
    plant: LoopPlant,
    actuator: ActuatorStep,
    start: StartingVelocity,
    position: NDArray[np.float64],
    output: NDArray[np.float64],
    sent: NDArray[np.float64],
    memory: NDArray[np.float64],
) -> None:
    """Fill *position* (n,) and *output* (n,); for a velocity loop, *position* is the integral of the velocity change.

    *sent* (``start.before`` + n,) receives the outputs. *memory* (4,) must start with zeros (:func:`_actuate`).
    """
    dt, before, v0 = plant.dt, int(start.before), start.velocity
    on_position, angle, leads, shaped = loop.on_position > 0.0, loop.angle > 0.0, loop.leads > 0.0, loop.shaped > 0.0
    nested, frozen, smoothed = loop.nested > 0.0, loop.grows <= 0.0, loop.output_cutoff > 0.0
    derivative, bent = loop.d != 0.0, loop.least != 0.0 or loop.expo != 0.0
    f_v, f_u = smoothing(loop.velocity_cutoff, dt), smoothing(loop.output_cutoff, dt)
    f_t, f_e, f_d = (
        smoothing(loop.target_cutoff, dt),
        smoothing(loop.error_cutoff, dt),
        smoothing(loop.slope_cutoff, dt),
    )
    x = lead = slope = error = velocity_error = velocity_integral = acceleration = integral = 0.0
    v = x1 = x2 = y1 = y2 = v0 + start.ahead
    demand = target = v0
    lead_rate = v0 if shaped else 0.0
    if on_position:
        # It has stood here for long: the integral holds the craft's constant force as far as it may, and the craft
        # stands off by what makes the proportional terms hold the rest.
        rest = (plant.settled - loop.hover) / loop.scale
        if loop.i > 0.0 and not frozen:
            integral = clip(-rest, -loop.imax, loop.imax)
        target = -(rest + integral) / clip(loop.ff + loop.p, 1e-9, math.inf)
        if nested:
            velocity_error = target / clip(loop.velocity_p, 1e-9, math.inf)
        else:
            demand = target = velocity_error = clip(target, -loop.velocity_max, loop.velocity_max)
        error = target
        x = clip(-velocity_error / clip(loop.position_p, 1e-9, math.inf), -MAX_STANDING_ERROR, MAX_STANDING_ERROR)
        sending = clip(loop.scale * (integral + (loop.ff + loop.p) * target) - loop.hover, -loop.most, loop.most)
    else:
        sending = start.output
        if before > 0 and loop.i > 0.0 and not frozen:
            proportional = (loop.cruise + loop.ff) * v0 - loop.p * start.ahead
            integral = clip(sending / loop.scale - proportional, -loop.imax, loop.imax)
            error = -start.ahead
    trim = shape(sending, loop.least, loop.expo)
    limited = frozen
    for j in range(len(sent)):
        k = j - before
        if k >= 0:
            position[k] = x if on_position else v - v0
        aim = v0 + plant.step if plant.step_at <= k < plant.back_at else v0
        if nested:
            measured = acceleration
        else:
            measured = gyro.b0 * v + gyro.b1 * x1 + gyro.b2 * x2 - gyro.a1 * y1 - gyro.a2 * y2
            x2, x1, y2, y1 = x1, v, y1, measured
        # From where to go to how fast.
        request = aim
        if leads:
            if on_position:
                ahead = wrap(aim - lead)
                if shaped:
                    request = clip(
                        sqrt_control(ahead, 1.0 / loop.shape_time, loop.shape_acceleration), -loop.slew, loop.slew
                    )
                else:
                    request = clip(ahead / dt, -loop.slew, loop.slew)
            if shaped:
                most = loop.shape_acceleration * dt
                lead_rate = clip(request, lead_rate - most, lead_rate + most)
                lead += lead_rate * dt
            else:
                lead += request * dt
        if on_position or leads:
            e = (lead if leads else aim) - x
            if angle:
                e = wrap(e)
            if abs(e) > loop.lead_max:
                e = clip(e, -loop.lead_max, loop.lead_max)
                lead = x + e
            request = sqrt_control(e, loop.position_p, loop.sqrt_acceleration) + lead_rate
            if loop.stop_acceleration > 0.0:
                most = math.sqrt(2.0 * abs(e) * loop.stop_acceleration)
                request = clip(request, -most, most)
        if loop.acceleration > 0.0:
            falls = abs(request) < abs(demand) and loop.deceleration > 0.0
            most = (loop.deceleration if falls else loop.acceleration) * dt
            request = clip(request, demand - most, demand + most)
        demand = clip(request, -loop.velocity_max, loop.velocity_max)
        # From how fast to what the PID is to reach.
        request = demand
        if nested:
            velocity_error += f_v * (demand - v - velocity_error)
            if not limited or velocity_integral * velocity_error < 0.0:
                velocity_integral += loop.velocity_i * velocity_error * dt
                velocity_integral = clip(velocity_integral, -loop.velocity_imax, loop.velocity_imax)
            request = loop.velocity_p * velocity_error + velocity_integral
        target += f_t * (request - target)
        last = error
        error += f_e * (target - measured - error)
        if derivative:  # seldom, and the longest way from a sample to the output
            slope += f_d * ((error - last) / dt - slope)
        if not limited or integral * error < 0.0:  # what is limited may only be worked off
            integral = clip(integral + loop.i * error * dt, -loop.imax, loop.imax)
        u = loop.cruise * demand + loop.ff * target + loop.p * error + integral + loop.d * slope
        u = loop.scale * u - loop.hover
        # From that to what is sent.
        if loop.brakes <= 0.0 and demand * u <= 0.0:
            u, held = 0.0, True
        else:
            held = False
        free = clip(u, -loop.most, loop.most)
        if loop.throttle > 0.0:
            free = mixed(free, loop.throttle)
        if smoothed:
            sending += f_u * (free - sending)
            limited = abs(sending) >= SATURATED
        else:
            sending = (
                clip(free, sending - loop.slew_output, sending + loop.slew_output) if loop.slew_output > 0.0 else free
            )
            limited = frozen or held or sending != u
        sent[j] = shape(sending, loop.least, loop.expo) if bent else sending
        if k >= 0:
            output[k] = sent[j]
        force = actuate(delayed(sent, j, plant.late, trim), actuator, memory)
        was = v
        x, v = advance(x, v, force + (plant.push if k >= plant.push_at else 0.0), plant)
        acceleration = (v - was) / dt


fly: Callable[..., None] = entry(_fly)


def plant_of(model: SingleDof, scenario: Scenario, dt: float, delay: float, actuator: Actuator = PERFECT) -> LoopPlant:
    """Return the data on craft and scenario for the compiled simulation.

    *delay* [s] includes the half loop for which an output is held. The compiled simulation causes that delay itself, so
    it is subtracted here.
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
        restoring=model.restoring,
    )


def gyro_coefficients(cutoff: float, rate: float) -> GyroFilter:
    """Return the coefficients of a second-order Butterworth low-pass of *cutoff* [Hz], sampled at *rate* [Hz].

    The filter is discretised by the bilinear transform with pre-warping. It has no effect if *cutoff* is zero or too
    close to half of *rate*.
    """
    if cutoff <= 0.0 or cutoff >= 0.45 * rate:
        return GyroFilter(1.0, 0.0, 0.0, 0.0, 0.0)
    w = math.tan(math.pi * cutoff / rate)
    scale = 1.0 / (1.0 + math.sqrt(2.0) * w + w * w)
    b0 = w * w * scale
    return GyroFilter(b0, 2.0 * b0, b0, 2.0 * (w * w - 1.0) * scale, (1.0 - math.sqrt(2.0) * w + w * w) * scale)
