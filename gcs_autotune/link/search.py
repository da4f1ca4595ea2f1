"""Finding the vehicle on a session's link, and hearing from it what it is."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gcs_autotune.link.discovery import Candidate, Sightings, choose, nobody_found
from gcs_autotune.link.identity import VehicleIdentity, firmware_version, unique_id
from gcs_autotune.link.port import FramePort
from gcs_autotune.link.signing_errors import cannot_be_commanded, not_believed
from gcs_autotune.link.wire import Message, mavlink

if TYPE_CHECKING:
    from gcs_autotune.link.session import Session

__all__ = ["find", "introduce"]

_HEARD_OUT = 2.0
"""Seconds that the link is listened to for a second autopilot: two heartbeats."""
_VERSION_TRIES = 3


def find(session: Session, port: FramePort, sightings: Sightings, timeout: float, system_id: int | None) -> Candidate:
    """Return the only autopilot heard on *port*, or that with *system_id*; errors as those of ``Session.discover``."""
    wanted = session.wait_for(lambda: sightings.found(system_id), timeout)
    if wanted is None:
        where = session.transport.description
        if port.signer and port.signer.refused:
            raise not_believed(port.signer, where)
        where += port.trouble
        raise nobody_found(where, timeout, system_id, sightings.candidates, session.foreign, port.bad_bytes)
    if system_id is not None:
        return wanted
    session.pause(_HEARD_OUT)
    return choose(list(sightings.candidates.values()))


def introduce(session: Session, port: FramePort, sightings: Sightings, wanted: Candidate) -> VehicleIdentity:
    """Return who *wanted* says it is, once the session listens to it.

    Raises
    ------
    SigningMismatch
        It signs, we have no key, and it does not answer.
    """
    version, uid = _ask_version(session)
    if port.signer is None and sightings.signs(wanted):
        if not version:
            raise cannot_be_commanded(wanted, session.transport.description)
        session.notes.append("the vehicle signs its messages; on this link it obeys unsigned ones too")
    return wanted.identity(version=version, uid=uid)


def _ask_version(session: Session) -> tuple[str, str]:
    """Return (firmware version, unique id), each empty when it is not told."""
    answers: list[Message] = []
    stop = session.listen("AUTOPILOT_VERSION", answers.append)
    try:
        for _ in range(_VERSION_TRIES):
            session.request_message(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
            if session.wait_for(lambda: True if answers else None, 1.0):
                return firmware_version(answers[0]), unique_id(answers[0])
    finally:
        stop()
    session.notes.append("the vehicle did not tell its firmware version")
    return "", ""
