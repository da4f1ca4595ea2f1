"""A recorded session with ArduPilot as a vehicle on a memory link: it answers as it was answered then.

Not a simulator: a request that is not in the recording gets no answer (an interval not in the recording gets the answer
to the nearest one), and commands do not move it. Telemetry runs by the vehicle's own stamps from a moment of the
recording that the test chooses.
"""

from __future__ import annotations

import gzip
import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_autotune.mavlink import TlogReader

__all__ = ["RECORDED", "Recording", "Replayed"]

RECORDED = Path(__file__).parent / "recorded"
GROUND = 255
ANSWERS = ("COMMAND_ACK", "PARAM_VALUE", "PARAM_ERROR", "AUTOPILOT_VERSION", "MESSAGE_INTERVAL", "TIMESYNC")
"""Sent only on request."""
TICK = 0.02


@dataclass(frozen=True)
class Heard:
    """One recorded message of the vehicle: its time [s since boot], as far as that was known, and name."""

    t: float
    name: str
    raw: bytes
    message: Any


def _name(text: str) -> str:
    return text.split("\0", 1)[0]


def _key(m: Any) -> tuple[Any, ...] | None:
    """Return the key that identifies a request; None for a message that is not a request."""
    match m.get_type():
        case "PARAM_REQUEST_READ":
            return ("parameter", _name(m.param_id) if m.param_index < 0 else int(m.param_index))
        case "PARAM_SET":
            return ("set", _name(m.param_id), struct.pack("<f", m.param_value))
        case "PARAM_REQUEST_LIST":
            return ("list",)
        case "COMMAND_LONG":
            return ("command", m.command, m.param1, m.param2)
    return None


class Recording:
    """What a tlog of both directions holds.

    Attributes
    ----------
    telemetry : the messages that the vehicle sent without a request, in order, dated by the last stamp heard.
    relays : when the experiments in it began and ended [s since boot], and their outputs.
    """

    def __init__(self, kind: str) -> None:
        facts = json.loads((RECORDED / f"{kind}.json").read_text())
        self.version: str = facts["version"]
        self.relays: list[dict[str, float]] = facts["relays"]
        self.telemetry: list[Heard] = []
        self._answers: dict[tuple[Any, ...], list[bytes]] = {}
        self._values: dict[str, bytes] = {}
        self._read(TlogReader(gzip.decompress((RECORDED / f"{kind}.tlog.gz").read_bytes())))

    def _read(self, reader: TlogReader) -> None:
        t, pending = 0.0, dict[Any, tuple[Any, ...]]()
        for record in reader:
            frame, m = record.frame, record.frame.message
            if frame.system == GROUND:
                if (key := _key(m)) is not None:
                    pending[key[1] if key[0] in ("parameter", "set", "command") else key[0]] = key
                continue
            if frame.name in ("ATTITUDE", "SYSTEM_TIME"):
                t = m.time_boot_ms * 1e-3
            if frame.name in ANSWERS:
                self._note(frame.name, m, frame.raw, pending)
            else:
                self.telemetry.append(Heard(t, frame.name, frame.raw, m))

    def _note(self, name: str, m: Any, raw: bytes, pending: dict[Any, tuple[Any, ...]]) -> None:
        match name:
            case "PARAM_VALUE":
                self._values.setdefault(_name(m.param_id), raw)
                requests = pending.get(_name(m.param_id), ("parameter", _name(m.param_id)))
                self._answers.setdefault(requests, [raw])
            case "PARAM_ERROR":
                self._answers.setdefault(("parameter", _name(m.param_id)), [raw])
            case "COMMAND_ACK":
                requests = pending.get(m.command, ())
                self._answers.setdefault(requests, []).append(raw)
            case "AUTOPILOT_VERSION":
                self._answers.setdefault(("version",), [raw])
            case "MESSAGE_INTERVAL":
                requests = pending.get(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, ())
                self._answers.setdefault((*requests, "interval"), [raw])

    def answers(self, question: Any) -> list[bytes]:
        """Return the recorded frames that answer *question*, none when it was never requested."""
        key = _key(question)
        if key is None:
            return []
        if key == ("list",):
            return list(self._values.values())
        if key[0] == "parameter":
            return self._answers.get(key) or ([self._values[key[1]]] if key[1] in self._values else [])
        if key[0] == "command" and key[1] == mavlink.MAV_CMD_REQUEST_MESSAGE:
            return self._answers.get(("version",), []) if key[2] == mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION else []
        if key[0] == "command" and key[1] == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            key = self._nearest(key)
        return [*self._answers.get((*key, "interval"), []), *self._answers.get(key, [])[:1]]

    def _nearest(self, key: tuple[Any, ...]) -> tuple[Any, ...]:
        """Return the recorded request nearest in interval, of this message or else of one that is always there."""
        requests = [k for k in self._answers if k[:2] == key[:2]]
        of_this = [k for k in requests if k[2] == key[2]] or [
            k for k in requests if k[2] == mavlink.MAVLINK_MSG_ID_VFR_HUD
        ]
        return min(of_this, key=lambda k: abs(k[3] - key[3]))

    def between(self, begin: float, end: float) -> Iterator[Heard]:
        """Yield the telemetry stamped within [begin, end] seconds since boot."""
        return (heard for heard in self.telemetry if begin <= heard.t <= end)

    def names(self) -> frozenset[str]:
        """Return the parameters that the vehicle has."""
        return frozenset(self._values)


class Replayed:
    """A ``Peer`` for ``MemoryLink``: *recording* from *begin* [s since boot] on.

    Attributes: ``received`` every message received; ``unanswered`` the requests that the recording does not answer.
    """

    def __init__(self, recording: Recording, begin: float) -> None:
        self._recording = recording
        self._begin = begin
        self._telemetry = list(recording.between(begin, float("inf")))
        self._next = 0
        self._out = bytearray()
        self._ear = mavlink.MAVLink(None)
        self._written: dict[str, list[bytes]] = {}
        self.received: list[Any] = []
        self.unanswered: list[Any] = []

    def receive(self, data: bytes) -> None:
        for message in self._ear.parse_buffer(data) or ():
            self.received.append(message)
            answers = self._held(message) or self._recording.answers(message)
            if not answers and _key(message) is not None:
                self.unanswered.append(message)
            self._out += b"".join(answers)

    def _held(self, message: Any) -> list[bytes]:
        """Return what a parameter that was written (as in the recording) holds since."""
        key = _key(message)
        if key is not None and key[0] == "set":
            self._written[key[1]] = self._recording.answers(message) or self._written.get(key[1], [])
        return self._written.get(key[1], []) if key is not None and key[0] == "parameter" else []

    def advance_to(self, t: float) -> bytes:
        out, self._out = bytes(self._out), bytearray()
        while self._next < len(self._telemetry) and self._telemetry[self._next].t - self._begin <= t:
            out += self._telemetry[self._next].raw
            self._next += 1
        return out
