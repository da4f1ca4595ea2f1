"""A transport that applies faults to another one."""

from __future__ import annotations

import heapq
import math
import random
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from benchmarks.faults.fault import LASTING, Fault
from gcs_autotune.link import Transport
from gcs_autotune.mavlink import frame_length

__all__ = ["FaultyLink", "Killed"]

_SHARE = 1.0 / 3.0
_FOREIGN = 9
_HEARTBEAT, _PARAM_VALUE = mavlink.MAVLINK_MSG_ID_HEARTBEAT, mavlink.MAVLINK_MSG_ID_PARAM_VALUE


class Killed(BaseException):
    """The tool was killed; every later call of the link raises this too."""


class FaultyLink(Transport):
    """Pass bytes to and from *inner*, frame by frame, with *faults*; the same seed has the same effects.

    ``actions`` : kind of an event (``reboot``, ``disk-full``, ``operator``, ``killed``) -> function to call then.
    ``patience`` : link time [s] after which it raises TimeoutError.
    """

    def __init__(
        self,
        inner: Transport,
        faults: Sequence[Fault],
        *,
        seed: int = 0,
        actions: Mapping[str, Callable[[Fault], None]] | None = None,
        patience: float = math.inf,
    ) -> None:
        super().__init__(inner.description, inner.clock)
        self.is_simulated = inner.is_simulated
        self.sent: dict[str, int] = {}
        self._inner = inner
        self._random = random.Random(seed)
        self._actions = dict(actions or {})
        self._begins = {i: f.after if not f.sent else math.inf for i, f in enumerate(faults)}
        self._faults = dict(enumerate(faults))
        self._acted: set[int] = set()
        self._queues: dict[str, list[tuple[float, int, bytes]]] = {"up": [], "down": []}
        self._order = 0
        self._rest = bytearray()
        self._frozen: dict[int, bytes] = {}
        self._names = {kind.id: kind.msgname for kind in mavlink.mavlink_map.values()}
        self._origin = self.clock.now()
        self._patience = patience
        self._dead: BaseException | None = None

    # --- Transport ----------------------------------------------------------------------------------------

    def follow_tick(self, at: float, period: float) -> None:
        """Call the same of the inner transport."""
        self._inner.follow_tick(at, period)

    def _read_available(self, timeout: float) -> bytes:
        self._act()
        self._flush_up()
        data = self._inner.read(max(0.0, min(timeout, self._next_moment() - self._now())))
        self._act()
        for frame in self._split(data):
            for each in self._forged(frame):
                self._pass("down", each)
        return b"".join(self._due("down"))

    def _write(self, data: bytes) -> None:
        self._act()
        name = self._names.get(_number(data), "?")
        self.sent[name] = self.sent.get(name, 0) + 1
        for i, fault in self._faults.items():
            if fault.sent == name and fault.count == self.sent[name]:
                self._begins[i] = self._now() + fault.after
        self._pass("up", data)
        self._act()
        self._flush_up()

    def _close(self) -> None:
        self._inner.close()

    # --- events -----------------------------------------------------------------------------------------------

    def _now(self) -> float:
        return self.clock.now() - self._origin

    def _act(self) -> None:
        """Start the events that are due; raise if the link is lost."""
        if self._dead is not None:
            raise self._dead
        now = self._now()
        for i, fault in self._faults.items():
            if fault.kind in LASTING or i in self._acted or now < self._begins[i]:
                continue
            self._acted.add(i)
            self._actions.get(fault.kind, _nothing)(fault)
            if fault.kind == "unplugged":
                self._dead = self.lost("the serial port stopped working (device disconnected)", "check the cable")
            elif fault.kind == "killed":
                self._dead = Killed(f"killed at {now:.2f} s")
        if now > self._patience and self._dead is None:
            self._dead = TimeoutError(f"not finished after {now:.0f} s of link time")
        if self._dead is not None:
            raise self._dead

    def _active(self, kind: str, way: str) -> Fault | None:
        now = self._now()
        for i, fault in self._faults.items():
            if fault.kind == kind and fault.concerns(way) and 0.0 <= now - self._begins[i] < fault.duration:
                return fault
        return None

    def _silent(self) -> bool:
        """Return whether the autopilot is booting, and thus silent."""
        now = self._now()
        return any(f.kind == "reboot" and 0.0 <= now - self._begins[i] < f.size for i, f in self._faults.items())

    def _next_moment(self) -> float:
        moments = [queue[0][0] for queue in self._queues.values() if queue]
        moments += [t for i, t in self._begins.items() if t > self._now() and i not in self._acted]
        return min(moments, default=math.inf)

    # --- frames -------------------------------------------------------------------------------------------

    def _split(self, data: bytes) -> list[bytes]:
        """Return the complete frames; keep an incomplete one."""
        self._rest += data
        frames, position = [], 0
        while position < len(self._rest):
            length = frame_length(self._rest, position)
            if length is None:
                length = 1
            elif position + length > len(self._rest):
                break
            frames.append(bytes(self._rest[position : position + length]))
            position += length
        del self._rest[:position]
        return frames

    def _pass(self, way: str, frame: bytes) -> None:
        """Queue one frame: in time, late, twice, damaged, or not at all."""
        draw, now = self._random, self._now()
        if self._silent() or self._active("silence", way):
            return
        stuck = self._active("stuck", way)
        if stuck and _number(frame) != _HEARTBEAT:
            frame = self._frozen.get(_number(frame), frame) if stuck.size and way == "down" else b""
        elif way == "down":
            self._frozen[_number(frame)] = frame
        if way == "down" and self._active("wrong-system", way):
            frame = _as_system(frame, _FOREIGN)
        lost, corrupt = self._active("loss", way), self._active("corrupt", way)
        if not frame or (lost and draw.random() < lost.size):
            return
        if corrupt and draw.random() < corrupt.size:
            frame = self._damaged(frame)
        delay, mixed, twice = (self._active(kind, way) for kind in ("delay", "reorder", "duplicate"))
        due = now + (delay.size if delay else 0.0)
        if mixed and draw.random() < _SHARE:
            due += draw.uniform(0.0, mixed.size)
        self._queue(way, due, frame)
        if twice and draw.random() < _SHARE:
            self._queue(way, due + draw.uniform(0.0, twice.size), frame)

    def _queue(self, way: str, due: float, frame: bytes) -> None:
        self._order += 1
        heapq.heappush(self._queues[way], (due, self._order, frame))

    def _due(self, way: str) -> list[bytes]:
        queue, found = self._queues[way], []
        while queue and queue[0][0] <= self._now() + 1e-9:
            found.append(heapq.heappop(queue)[2])
        return found

    def _flush_up(self) -> None:
        for frame in self._due("up"):
            self._inner.write(frame)

    def _damaged(self, frame: bytes) -> bytes:
        draw, data = self._random, bytearray(frame)
        kind = draw.randrange(4)
        if kind == 0:
            for _ in range(draw.randint(1, 4)):
                data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
        elif kind == 1:
            del data[draw.randrange(1, len(data)) :]
        elif kind == 2:
            at = draw.randrange(len(data))
            data[at:at] = draw.randbytes(draw.randint(1, 8))
        else:
            data = bytearray(draw.randbytes(len(data)))
        return bytes(data)

    def _forged(self, frame: bytes) -> list[bytes]:
        """Return forged frames before a PARAM_VALUE."""
        if _number(frame) != _PARAM_VALUE:
            return [frame]
        frames = [frame]
        for kind, system in (("forged-foreign", _FOREIGN), ("forged-own", None)):
            fault = self._active(kind, "down")
            if fault and self._random.random() < fault.size:
                frames.insert(0, _forged_value(frame, self._random, system))
        return frames


def _nothing(fault: Fault) -> None:
    return None


def _number(frame: bytes) -> int:
    """Return the message number of a frame; -1 if it is not a frame."""
    if frame[:1] == b"\xfd" and len(frame) >= 10:
        return int.from_bytes(frame[7:10], "little")
    return frame[5] if frame[:1] == b"\xfe" and len(frame) >= 6 else -1


def _decoded(frame: bytes) -> Any:
    try:
        return mavlink.MAVLink(None).decode(bytearray(frame))
    except (mavlink.MAVError, ValueError):
        return None


def _as_system(frame: bytes, system: int) -> bytes:
    message = _decoded(frame)
    if message is None:
        return frame
    return bytes(message.pack(mavlink.MAVLink(None, srcSystem=system, srcComponent=message.get_srcComponent())))


def _forged_value(frame: bytes, draw: random.Random, system: int | None) -> bytes:
    message = _decoded(frame)
    if message is None:
        return b""
    value = draw.choice((message.param_value * draw.uniform(0.2, 3.0) + draw.uniform(0.05, 1.0), draw.gauss(0.0, 10.0)))
    forged = mavlink.MAVLink_param_value_message(
        message.param_id.encode(), value, message.param_type, message.param_count, message.param_index
    )
    sender = message.get_srcSystem() if system is None else system
    return bytes(forged.pack(mavlink.MAVLink(None, srcSystem=sender, srcComponent=message.get_srcComponent())))
