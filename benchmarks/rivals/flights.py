"""Flights: a step and a step back with given gains, and a steady circle."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from benchmarks.rivals.firmware_loop import FirmwareLoop
from benchmarks.rivals.fleet import Job
from gcs_autotune.design import StepMetrics, combine, step_metrics

__all__ = ["circle_ratio", "fly_step", "get_ready"]

GUIDED, ALT_HOLD, MANUAL_ROVER = 15, 2, 0
_AWAY, _HOLD = 0.6, 20.0
"""Time [s] in the manual mode, which resets the integral after 0.2 s, and of holding before a step from there."""
_WORKING_DEPTH = 3.0
_ONLY_Z = 0b110111111011
_UNSEEN = {"heading": math.radians(0.1), "depth": 0.01}
"""Errors [rad or m] that count as zero: they are below the resolution of a compass or pressure sensor.

They would otherwise dominate an ITAE over half a minute.
"""
_AT_REST = 0.02
"""Largest motion at rest, as a fraction of the step."""
_PATIENCE = 8.0
"""Longest wait for rest, in settling times."""
_COLUMN = {"heading": (1, 4), "depth": (2, 5)}
"""Axis -> columns of position and output in the record."""


def _heading(firmware: FirmwareLoop, psi: float) -> Sequence[Any]:
    half = 0.5 * math.remainder(psi, math.tau)
    boat = firmware.data.firmware == "rover"
    mask, thrust = (0b111, 1.0) if boat else (0b1000111, 0.5)
    q = [math.cos(half), 0.0, 0.0, math.sin(half)]
    return [mavlink.MAVLink_set_attitude_target_message(0, 1, 1, mask, q, 0.0, 0.0, 0.0, thrust)]


def _depth(z: float) -> Sequence[Any]:
    frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
    return [
        mavlink.MAVLink_set_position_target_global_int_message(0, 1, 1, frame, _ONLY_Z, 0, 0, -z, *[0.0] * 8),
    ]


def get_ready(firmware: FirmwareLoop, job: Job) -> None:
    """Arm, and gather speed on a heading or dive to the working depth."""
    firmware.run_while(lambda: firmware.t < 50.0)
    firmware.set(dict(job.calm))
    if firmware.data.firmware == "rover":
        firmware.go(GUIDED)
        firmware.run(1.0)
        psi = firmware.psi
        firmware.repeated = lambda: _heading(firmware, psi)
        firmware.run(20.0)
        return
    firmware.go(ALT_HOLD)
    if firmware.physics.craft.plant.state.z < 1.0:
        firmware.repeated = lambda: _depth(_WORKING_DEPTH)
        firmware.run_while(lambda: firmware.physics.craft.plant.state.z < _WORKING_DEPTH - 0.5, within=120.0)


def fly_step(
    firmware: FirmwareLoop, job: Job, gains: Mapping[str, float], base: float, *, fresh: bool = False
) -> StepMetrics:
    """Wait at *base* with soft gains, write *gains*, step and step back; return the mean of all steps.

    Overshoot, steady error and oscillation are the largest of all steps. The integral at the start is that of the soft
    gains. *fresh*: it is reset by a change of mode, and *gains* hold the vehicle before the step.
    """
    setpoint = (lambda value: _heading(firmware, value)) if job.axis == "heading" else _depth
    firmware.set(dict(job.calm))
    firmware.repeated = lambda: setpoint(base)
    position, output = _COLUMN[job.axis]
    firmware.run(job.settle)
    _await_rest(firmware, position, base, job)
    firmware.set(dict(gains))
    if fresh:
        _reset_integral(firmware)
    firmware.run(_HOLD if fresh else 1.0)
    found, value = [], base
    for target in (base + job.step, base) * job.pairs:
        begun = firmware.t
        before = value
        firmware.repeated = lambda target=target: setpoint(target)
        for message in setpoint(target):
            firmware.send(message)
        firmware.run(job.duration)
        flown = firmware.record(begun - 0.1)
        t = flown[:, 0] - begun
        x = flown[:, position]
        if job.axis == "heading":
            x = x + math.tau * round((before - x[0]) / math.tau)
        reference = np.where(t < 0.0, before, target)
        found.append(step_metrics(t, reference, x, flown[:, output], noise_std=0.5 * _UNSEEN[job.axis]))
        value = target
    firmware.log.clear()
    return combine(found)


def _reset_integral(firmware: FirmwareLoop) -> None:
    """Reset the firmware's integrals: of a boat by a change of mode, of an ROV by disarming."""
    repeated = firmware.repeated
    if firmware.data.firmware == "rover":
        firmware.command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, float(MANUAL_ROVER))
        firmware.run(_AWAY)
        firmware.command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, float(GUIDED))
    else:
        firmware.rest()
        firmware.go(ALT_HOLD)
    firmware.repeated = repeated
    for message in repeated():
        firmware.send(message)


def _await_rest(firmware: FirmwareLoop, position: int, base: float, job: Job) -> None:
    """Wait until the position has been steady and close to *base* [rad or m] for 5 s."""
    end = firmware.t + _PATIENCE * job.settle
    while firmware.t < end:
        since = firmware.t
        firmware.run(5.0)
        x = firmware.record(since)[:, position]
        off = x - base if job.axis == "depth" else np.remainder(x - base + math.pi, math.tau) - math.pi
        if np.ptp(x) < _AT_REST * job.step and np.abs(off).max() < job.near * job.step:
            return


def circle_ratio(firmware: FirmwareLoop, throttle: float, rudder: float) -> tuple[float, float, float]:
    """Drive a circle in MANUAL; return (steering demand before speed scaling, turn rate [rad/s], duration [s]).

    QuikTune uses the demand of an automatic mode: the normalised servo output times |V|/MOT_SPD_SCA_BASE.
    """
    began = firmware.t
    firmware.command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, float(MANUAL_ROVER))

    def sticks() -> Sequence[Any]:
        free = [65535] * 8
        steer = 1530 + round(470 * rudder)
        ahead = 1530 + round(470 * throttle)
        return [mavlink.MAVLink_rc_channels_override_message(1, 1, steer, 65535, ahead, *free[:5])]

    firmware.repeated = sticks
    firmware.run(20.0)
    since = firmware.t
    firmware.run(10.0)
    flown = firmware.record(since)
    rate = float(np.polyfit(flown[:, 0], flown[:, 1], 1)[0])
    demand = float(np.mean(flown[:, 4]) * max(np.mean(flown[:, 3]), 1.0))
    firmware.log.clear()
    return demand, rate, firmware.t - began
