"""What is flown: a step and a step back under given gains, a steady circle."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from benchmarks.rivals.fleet import Job
from benchmarks.rivals.sea import Sea
from gcs_autotune.design import StepMetrics, combine, step_metrics

__all__ = ["circle_ratio", "fly_step", "get_ready"]

GUIDED, ALT_HOLD, MANUAL_ROVER = 15, 2, 0
_AWAY, _HOLD = 0.6, 20.0
"""Seconds in the manual mode, long enough to forget (200 ms), and of holding before a fresh step."""
_WORKING_DEPTH = 3.0
_ONLY_Z = 0b110111111011
_UNSEEN = {"heading": math.radians(0.1), "depth": 0.01}
"""Errors [rad or m] that count as none: nobody's compass or pressure sensor sees them, and ITAE over half a minute
would otherwise be made of them."""
_AT_REST = 0.02
"""Of the step."""
_PATIENCE = 8.0
"""Settling times that a vessel is waited for."""
_COLUMN = {"heading": (1, 4), "depth": (2, 5)}
"""Axis -> columns of position and output in the record."""


def _heading(sea: Sea, psi: float) -> Sequence[Any]:
    half = 0.5 * math.remainder(psi, math.tau)
    boat = sea.data.firmware == "rover"
    mask, thrust = (0b111, 1.0) if boat else (0b1000111, 0.5)
    q = [math.cos(half), 0.0, 0.0, math.sin(half)]
    return [mavlink.MAVLink_set_attitude_target_message(0, 1, 1, mask, q, 0.0, 0.0, 0.0, thrust)]


def _depth(z: float) -> Sequence[Any]:
    frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
    return [
        mavlink.MAVLink_set_position_target_global_int_message(0, 1, 1, frame, _ONLY_Z, 0, 0, -z, *[0.0] * 8),
    ]


def get_ready(sea: Sea, job: Job) -> None:
    """Arm, get under way on a heading, or down to depth."""
    sea.run_while(lambda: sea.t < 50.0)
    sea.set(dict(job.calm))
    if sea.data.firmware == "rover":
        sea.go(GUIDED)
        sea.run(1.0)
        psi = sea.psi
        sea.repeated = lambda: _heading(sea, psi)
        sea.run(20.0)
        return
    sea.go(ALT_HOLD)
    if sea.physics.craft.plant.state.z < 1.0:
        sea.repeated = lambda: _depth(_WORKING_DEPTH)
        sea.run_while(lambda: sea.physics.craft.plant.state.z < _WORKING_DEPTH - 0.5, within=120.0)


def fly_step(sea: Sea, job: Job, gains: Mapping[str, float], base: float, *, fresh: bool = False) -> StepMetrics:
    """Wait on the calm gains about *base*, put *gains* in, step and step back; return the mean of all steps.

    Overshoot, steady error and swing are the worst of them. The integral is what the calm gains have worked off: a loop
    that hardly has one keeps it. With *fresh* it is emptied by a change of mode and *gains* hold for a while first, as
    when a vehicle is sent off with them.
    """
    ask = (lambda value: _heading(sea, value)) if job.axis == "heading" else _depth
    sea.set(dict(job.calm))
    sea.repeated = lambda: ask(base)
    position, output = _COLUMN[job.axis]
    sea.run(job.settle)
    _await_rest(sea, position, base, job)
    sea.set(dict(gains))
    if fresh:
        _take_over(sea)
    sea.run(_HOLD if fresh else 1.0)
    found, value = [], base
    for target in (base + job.step, base) * job.pairs:
        begun = sea.t
        before = value
        sea.repeated = lambda target=target: ask(target)
        for message in ask(target):
            sea.send(message)
        sea.run(job.duration)
        flown = sea.record(begun - 0.1)
        t = flown[:, 0] - begun
        x = flown[:, position]
        if job.axis == "heading":
            x = x + math.tau * round((before - x[0]) / math.tau)
        wanted = np.where(t < 0.0, before, target)
        found.append(step_metrics(t, wanted, x, flown[:, output], noise_std=0.5 * _UNSEEN[job.axis]))
        value = target
    sea.log.clear()
    return combine(found)


def _take_over(sea: Sea) -> None:
    """Make the firmware forget its integrals: a boat by a change of mode, an ROV by disarming."""
    wish = sea.repeated
    if sea.data.firmware == "rover":
        sea.command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, float(MANUAL_ROVER))
        sea.run(_AWAY)
        sea.command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, float(GUIDED))
    else:
        sea.rest()
        sea.go(ALT_HOLD)
    sea.repeated = wish
    for message in wish():
        sea.send(message)


def _await_rest(sea: Sea, position: int, base: float, job: Job) -> None:
    """Let time pass until the position has stayed where it is, and near enough to *base* [rad or m], for 5 s."""
    end = sea.t + _PATIENCE * job.settle
    while sea.t < end:
        since = sea.t
        sea.run(5.0)
        x = sea.record(since)[:, position]
        off = x - base if job.axis == "depth" else np.remainder(x - base + math.pi, math.tau) - math.pi
        if np.ptp(x) < _AT_REST * job.step and np.abs(off).max() < job.near * job.step:
            return


def circle_ratio(sea: Sea, throttle: float, rudder: float) -> tuple[float, float, float]:
    """Drive a circle in MANUAL; return (steering demand before speed scaling, turn rate [rad/s], seconds it took).

    QuikTune takes the demand of an automatic mode, which is the servo's share times |V|/MOT_SPD_SCA_BASE.
    """
    began = sea.t
    sea.command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, float(MANUAL_ROVER))

    def sticks() -> Sequence[Any]:
        free = [65535] * 8
        steer = 1530 + round(470 * rudder)
        ahead = 1530 + round(470 * throttle)
        return [mavlink.MAVLink_rc_channels_override_message(1, 1, steer, 65535, ahead, *free[:5])]

    sea.repeated = sticks
    sea.run(20.0)
    since = sea.t
    sea.run(10.0)
    flown = sea.record(since)
    rate = float(np.polyfit(flown[:, 0], flown[:, 1], 1)[0])
    demand = float(np.mean(flown[:, 4]) * max(np.mean(flown[:, 3]), 1.0))
    sea.log.clear()
    return demand, rate, sea.t - began
