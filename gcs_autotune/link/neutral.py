"""Seeing by the measured outputs that every actuator is at neutral."""

from __future__ import annotations

from gcs_autotune.clock import Deadline
from gcs_autotune.errors import NotAsFound
from gcs_autotune.link.rates import message_number
from gcs_autotune.link.session import Session
from gcs_autotune.link.telemetry import Telemetry

__all__ = ["await_neutral"]

_NEUTRAL = 0.03
"""Chosen: fraction of full output that still counts as neutral; a trim offset of a few microseconds."""
_TIMEOUT = 5.0
_STALE_OUTPUTS = 0.5
"""Chosen: seconds without any outputs after which they are asked for one by one."""
_SERVO_OUTPUT_RAW = message_number("SERVO_OUTPUT_RAW")


def await_neutral(session: Session, telemetry: Telemetry) -> None:
    """Wait for neutral outputs; an autopilot that has restarted must be asked for them again.

    Raises
    ------
    NotAsFound
        They did not become neutral, or are not heard any more.
    """
    begun, deadline = telemetry.output_ticks, Deadline.after(session.clock, _TIMEOUT)
    while not deadline.expired:
        seen = telemetry.output_ticks
        if session.wait_for(lambda: _is_neutral(telemetry, begun), min(_STALE_OUTPUTS, deadline.remaining)):
            return
        if telemetry.output_ticks == seen:
            session.request_message(_SERVO_OUTPUT_RAW)
    outputs = telemetry.outputs
    stuck = {n: f"{f:+.2f} of full output" for n, f in outputs.items() if not abs(f) <= _NEUTRAL}
    if not stuck:
        stuck = {"outputs": "not heard any more"}
    raise NotAsFound(
        f"the actuators are not neutral after {_TIMEOUT:g} s: "
        + ", ".join(f"{name} {what}" for name, what in stuck.items())
        + "; take over by hand",
        differences=stuck,
    )


def _is_neutral(telemetry: Telemetry, begun: int) -> bool | None:
    fresh = telemetry.output_ticks > begun + 1
    still = all(abs(force) <= _NEUTRAL for force in telemetry.outputs.values())
    return True if fresh and still else None
