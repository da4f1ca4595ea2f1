"""Verify that the vehicle accepts our overrides, that its outputs follow them, and that they are neutral when
required.

MAVLink reports none of the possible faults: a wrong system id, an option bit, a switch, another station's stream, a
safety button. So the path is checked in two sections: from override to RC input, and from RC input to output. The cause
of a failure is read from the vehicle and reported.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from gcs_autotune.clock import Deadline
from gcs_autotune.craft import Actuate
from gcs_autotune.errors import NotAsFound, PreconditionFailed
from gcs_autotune.firmware import Firmware, ServoMap
from gcs_autotune.link.parameters.client import Parameters
from gcs_autotune.link.session import Session
from gcs_autotune.link.vehicle.rc_monitor import RcMonitor
from gcs_autotune.link.vehicle.setpoint_streamer import FOLLOW_TIMEOUT, SetpointStreamer
from gcs_autotune.link.vehicle.telemetry import Telemetry
from gcs_autotune.link.vehicle.vehicle_config import why_deaf
from gcs_autotune.mavlink import Message, message_number

__all__ = ["TWITCH", "await_neutral", "check_outputs_follow", "check_overrides_taken", "read_outputs"]

_TRIES = 10
_WAIT = 0.5
_ENOUGH = 2
"""Which message of outputs is used: the second one, because the first may have been sent before the change. Project
choice."""


def read_outputs(session: Session, servos: ServoMap) -> dict[str, float]:
    """Return force -> measured fraction of full output (-1 to 1); empty if no SERVO_OUTPUT_RAW arrives within 5 s of a
    request.
    """
    heard: list[Message] = []
    stop = session.listen("SERVO_OUTPUT_RAW", lambda m: heard.append(m) if m.port == 0 else None)
    try:
        for _ in range(_TRIES):
            session.request_message(message_number("SERVO_OUTPUT_RAW"))
            if session.wait_for(lambda: True if len(heard) >= _ENOUGH else None, _WAIT):
                break
    finally:
        stop()
    if not heard:
        return {}
    return dict(servos.forces(tuple(getattr(heard[-1], f"servo{n}_raw") for n in range(1, 9))))


_NEUTRAL = 0.03
"""Fraction of full output that still counts as neutral.

It allows for a trim offset of a few microseconds. Project choice.
"""
_TIMEOUT = 5.0
_STALE_OUTPUTS = 0.5
"""Time [s] without outputs after which single messages are requested. Project choice."""
_SERVO_OUTPUT_RAW = message_number("SERVO_OUTPUT_RAW")


def await_neutral(session: Session, telemetry: Telemetry) -> None:
    """Wait for neutral outputs. After a restart of the autopilot, SERVO_OUTPUT_RAW is requested again.

    Raises
    ------
    NotAsFound
        The outputs did not become neutral, or are no longer received.
    """
    begun, deadline = telemetry.output_ticks, Deadline.after(session.liveness, _TIMEOUT)
    while not deadline.expired:
        ticks = telemetry.output_ticks
        if session.wait_for(lambda: _is_neutral(telemetry, begun), min(_STALE_OUTPUTS, deadline.remaining)):
            return
        if telemetry.output_ticks == ticks:
            session.request_message(_SERVO_OUTPUT_RAW)
    outputs = telemetry.outputs
    stuck = {n: f"{f:+.2f} of full output" for n, f in outputs.items() if not abs(f) <= _NEUTRAL}
    if not stuck:
        stuck = {"outputs": "no longer reported"}
    raise NotAsFound(
        f"the actuators are not neutral after {_TIMEOUT:g} s: "
        + ", ".join(f"{name} {what}" for name, what in stuck.items())
        + ". Take over by hand",
        differences=stuck,
    )


def _is_neutral(telemetry: Telemetry, begun: int) -> bool | None:
    fresh = telemetry.output_ticks > begun + 1
    still = all(abs(force) <= _NEUTRAL for force in telemetry.outputs.values())
    return True if fresh and still else None


TWITCH = 0.05
"""Fraction of full output by which the steering is moved, without forward thrust, to verify that the output follows the
command. Project choice.
"""
_LEVELS = (TWITCH, -TWITCH, TWITCH, -TWITCH, 0.0)


def check_overrides_taken(
    session: Session, streamer: SetpointStreamer, rc_monitor: RcMonitor, parameters: Parameters, firmware: Firmware
) -> None:
    """Send nearly neutral but recognisable overrides and verify that RC_CHANNELS shows them.

    Raises
    ------
    PreconditionFailed
        They do not appear; the message states the likely cause and its remedy.
    """
    heard = rc_monitor.count
    taken = streamer.probe_override()
    if not taken and rc_monitor.count > heard:
        raise PreconditionFailed(
            f"the vehicle does not accept this tool's overrides: RC_CHANNELS shows {streamer.differing}; "
            + why_deaf(parameters, firmware, session.port.system)
        )
    if not taken:
        session.notes.append("the vehicle sends no RC_CHANNELS, so only its outputs show whether it accepts overrides")
    streamer.rest()
    session.wait_for(lambda: streamer.is_obeyed or None, 1.0)


def check_outputs_follow(
    streamer: SetpointStreamer, telemetry: Telemetry, observe: Callable[[], object], mode: str, *, skid: bool = False
) -> None:
    """Move the steering by 5 % to each side, without thrust, and verify that SERVO_OUTPUT_RAW follows.

    observe : waits for the next control tick. Commands are sent on ticks, so that the loop is timed as in later use.
    skid : whether two thrusters steer. MOT_THR_MIN, MOT_THST_EXPO and MOT_THST_ASYM enlarge their small outputs.

    Raises
    ------
    PreconditionFailed
        The output does not follow.
    """
    for level in _LEVELS:
        streamer.command(Actuate(N=level))
        deadline = Deadline.after(streamer.clock, FOLLOW_TIMEOUT)
        while not _follows(telemetry.outputs.get("N", math.nan), level, skid=skid):
            if deadline.expired:
                raise _deaf_outputs(level, streamer, telemetry, mode)
            observe()


def _follows(output: float, level: float, *, skid: bool) -> bool:
    if skid and output * level > 0.0:
        return abs(output) > 0.5 * abs(level)
    return abs(output - level) < 0.5 * TWITCH


def _deaf_outputs(level: float, streamer: SetpointStreamer, telemetry: Telemetry, mode: str) -> PreconditionFailed:
    output = telemetry.outputs.get("N", math.nan)
    shown = f"{output:+.0%} in {mode}"
    if streamer.is_obeyed:
        what = f"RC_CHANNELS shows the overrides, but SERVO_OUTPUT_RAW shows {shown}"
    else:
        what = f"neither RC_CHANNELS nor SERVO_OUTPUT_RAW shows it ({shown})"
    return PreconditionFailed(
        f"the steering output does not follow: {level:+.0%} was sent, {what}. Check SERVOn_FUNCTION and the "
        "motor directions, the safety switch (BRD_SAFETY_DEFLT), and that no failsafe is active"
    )
