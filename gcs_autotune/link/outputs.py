"""One look at the measured outputs, without asking for a stream of them."""

from __future__ import annotations

from gcs_autotune.firmware import ServoMap
from gcs_autotune.link.rates import message_number
from gcs_autotune.link.session import Session
from gcs_autotune.link.wire import Message

__all__ = ["read_outputs"]

_TRIES = 10
_WAIT = 0.5
_ENOUGH = 2
"""Chosen: the second message is used; the first may have been under way before what we look for."""


def read_outputs(session: Session, servos: ServoMap) -> dict[str, float]:
    """Return the measured force fractions; empty when SERVO_OUTPUT_RAW is not heard within 5 s of asking."""
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
