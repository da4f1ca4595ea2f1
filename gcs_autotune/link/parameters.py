"""The vehicle's parameters: read by name, written and read back, watched for others' hands.

ArduPilot packs every value as a float (C cast), says nothing about unknown names, echoes what it stored and
saves at once. So: ask by name, repeat, compare the echo, read back, and treat a difference as a refusal.
"""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import partial

from gcs_autotune.clock import Deadline
from gcs_autotune.errors import NoReply, ParameterMissing, ParameterNotAccepted, UsageError
from gcs_autotune.link.session import Session
from gcs_autotune.link.surely import read_surely
from gcs_autotune.link.wire import Message, mavlink

__all__ = ["Intrusion", "Parameters", "same_float32"]

_REPLY = 1.0
"""Chosen: seconds to wait for one answer."""
_TRIES = 3
_IN_FLIGHT = 10
"""Chosen: requests outstanding at once; a slow radio's buffer holds about that many."""
_LIST_QUIET = 1.5
_NAME = 16
_NO_INDEX = 65535

Intrusion = tuple[str, float, float]
"""(name, the value we left there, the value somebody else wrote)."""


def same_float32(a: float, b: float) -> bool:
    """Whether two numbers are the same 32-bit float, give or take its last bits."""
    if a == b:
        return True
    return abs(a - b) <= 4.0 * 2.0**-24 * max(abs(a), abs(b))


class Parameters:
    """The parameters of a session's vehicle.

    Attributes
    ----------
    session : the session they are read and written through.
    known : last value heard of every name.
    intrusions : watched parameters that somebody else changed.
    """

    def __init__(self, session: Session) -> None:
        self.session = session
        self.known: dict[str, float] = {}
        self.intrusions: list[Intrusion] = []
        self._watched: dict[str, float] = {}
        self._suspected: dict[str, float] = {}
        self._fresh: dict[str, float] = {}
        self._refused: set[str] = set()
        self._busy: set[str] = set()
        self._indices: dict[int, str] = {}
        self._count = 0
        session.listen("PARAM_VALUE", self._on_value)
        session.listen("PARAM_ERROR", self._on_error)

    # --- reading ------------------------------------------------------------------------------------------

    def read(self, name: str) -> float:
        """Return the value of one parameter.

        Raises
        ------
        ParameterMissing
            The vehicle answers nothing under that name.
        """
        return self.read_all([name])[name]

    def read_all(self, names: Iterable[str]) -> dict[str, float]:
        """Return the values of several parameters, asked for without waiting for each.

        Raises
        ------
        ParameterMissing
            When one or more of them do not exist; the message names all of those.
        NoReply
            The vehicle no longer answers such questions at all, not even for a name that it has.
        """
        wanted = list(dict.fromkeys(names))
        found = self.read_existing(wanted)
        missing = [name for name in wanted if name not in found]
        if missing:
            self._check_answers(missing)
            raise ParameterMissing(
                f"{self.session.vehicle} has no parameter {', '.join(missing)}; "
                "its firmware is older, newer or built without that feature",
                name=missing[0],
            )
        return found

    def read_existing(self, names: Iterable[str]) -> dict[str, float]:
        """Return the values of those of *names* that the vehicle has.

        Three tries of a second each; six when some answers come only after a second try, since the link loses messages.
        """
        wanted = list(dict.fromkeys(names))
        for name in wanted:
            _encoded(name)
        self._forget(wanted)
        tries = _TRIES
        for k in range(2 * _TRIES):
            pending = [name for name in wanted if name not in self._fresh and name not in self._refused]
            if not pending or k == tries:
                break
            self._ask(pending)
            if k > 0 and any(name in self._fresh for name in pending):
                tries = 2 * _TRIES
        return {name: self._fresh[name] for name in wanted if name in self._fresh}

    def read_surely(self, names: Iterable[str]) -> dict[str, float]:
        """Return the values of *names*, each confirmed by a second answer (:mod:`gcs_autotune.link.surely`).

        Raises
        ------
        ParameterMissing, NoReply
            As :meth:`read_all`.
        TelemetryFault
            The answers go on contradicting each other.
        """
        return read_surely(self, names)

    def _check_answers(self, missing: Collection[str]) -> None:
        """Tell a vehicle that has no such parameter from one that has stopped answering."""
        known = next((name for name in self.known if name not in missing), None)
        if known is not None and not self.read_existing([known]):
            raise NoReply(
                f"{self.session.vehicle} is heard, but no longer answers when asked for parameters "
                f"({', '.join(missing)}); is it restarting, or the link too slow?"
            )

    def read_first(self, names: Iterable[str]) -> tuple[str, float]:
        """Return the first of several alternative names that exists, with its value.

        Raises
        ------
        ParameterMissing
            When none does.
        """
        wanted = list(names)
        self._forget(wanted)
        for _ in range(_TRIES):
            for name in wanted:
                self._request(name)
            self.session.wait_for(lambda: next((n for n in wanted if n in self._fresh), None), _REPLY)
            found = next((name for name in wanted if name in self._fresh), None)
            if found:
                return found, self._fresh[found]
        raise ParameterMissing(f"{self.session.vehicle} has none of {', '.join(wanted)}", name=wanted[0])

    def read_any(self, groups: Iterable[Sequence[str]]) -> dict[str, float]:
        """Return, of each group of alternative names, the one that exists (the first, if several) with its value.

        A group is not asked for again once one of its names has answered, so names this vehicle does not have cost no
        waiting. Groups of which nothing exists are missing in the answer.
        """
        wanted = [list(dict.fromkeys(group)) for group in groups]
        self._forget(name for group in wanted for name in group)
        for _ in range(_TRIES):
            pending = [g for g in wanted if not self._settled(g)]
            while pending:
                batch, pending = pending[: _IN_FLIGHT // 2], pending[_IN_FLIGHT // 2 :]
                for name in (name for group in batch for name in group):
                    self._request(name)
                self.session.wait_for(partial(self._all_settled, batch), _REPLY)
        found = (next((n for n in group if n in self._fresh), None) for group in wanted)
        return {name: self._fresh[name] for name in found if name is not None}

    def _settled(self, group: Sequence[str]) -> bool:
        return any(n in self._fresh for n in group) or all(n in self._refused for n in group)

    def _all_settled(self, groups: Sequence[Sequence[str]]) -> bool | None:
        return True if all(self._settled(group) for group in groups) else None

    def read_full(self, timeout: float = 120.0) -> dict[str, float]:
        """Return every parameter: the whole list, then what was lost of it by index.

        Raises
        ------
        NoReply
            The list did not come, or stayed incomplete.
        """
        self._fresh, self._indices, self._count = {}, {}, 0
        deadline = Deadline.after(self.session.clock, timeout)
        self._send_list_request()
        while not deadline.expired and not (self._count and len(self._indices) >= self._count):
            heard = len(self._indices)
            self.session.wait_for(partial(self._progress, heard), _LIST_QUIET)
            if len(self._indices) == heard:
                self._fill_gaps()
        if not self._count or len(self._indices) < self._count:
            raise NoReply(
                f"the parameter list of {self.session.vehicle} stayed incomplete "
                f"({len(self._indices)} of {self._count or 'unknown'}) after {timeout:g} s; try a faster link"
            )
        return {name: self._fresh[name] for name in sorted(self._fresh)}

    def _progress(self, seen: int) -> bool | None:
        return True if len(self._indices) != seen else None

    def _fill_gaps(self) -> None:
        if not self._count:
            self._send_list_request()
            return
        gaps = [i for i in range(self._count) if i not in self._indices]
        for index in gaps[:_IN_FLIGHT]:
            self.session.send(self._read_request(b"", index))

    # --- writing ------------------------------------------------------------------------------------------

    def write(self, name: str, value: float) -> None:
        """Set one parameter, read it back and make sure that it is set.

        Raises
        ------
        ParameterNotAccepted
            The vehicle holds something else afterwards.
        ParameterMissing
            The vehicle answers nothing under that name.
        UsageError
            The value is not a finite number a 32-bit float can hold.
        """
        wanted = _as_float32(name, value)
        self._busy.add(name)
        try:
            for _ in range(_TRIES):
                is_echoed = self._set(name, wanted)
                found = self.read_surely([name])[name]
                if same_float32(found, wanted):
                    break
                if not is_echoed:
                    raise self._not_accepted(name, wanted, found)
            else:
                raise self._not_accepted(name, wanted, found)
        finally:
            self._busy.discard(name)
        if name in self._watched:
            self._watched[name] = found

    def _not_accepted(self, name: str, wanted: float, found: float) -> ParameterNotAccepted:
        return ParameterNotAccepted(
            f"{name}: wrote {wanted:g}, but the vehicle holds {found:g}{self._why(name)}; "
            "it may be read-only, whole-numbered, or held by another ground station",
            name=name,
            wanted=wanted,
            found=found,
        )

    def _set(self, name: str, value: float) -> bool:
        """Send PARAM_SET until its echo carries *value*; return whether it did."""
        vehicle = self._vehicle()
        for _ in range(_TRIES):
            self._forget([name])
            self.session.send(
                mavlink.MAVLink_param_set_message(*vehicle, _encoded(name), value, mavlink.MAV_PARAM_TYPE_REAL32)
            )
            self.session.wait_for(lambda: self._echo(name, value), _REPLY)
            if name in self._fresh and same_float32(self._fresh[name], value):
                return True
            if name in self._refused:
                return False
        return False

    def _echo(self, name: str, value: float) -> bool | None:
        if name in self._refused:
            return False
        return True if name in self._fresh and same_float32(self._fresh[name], value) else None

    def _why(self, name: str) -> str:
        since = self.session.clock.now() - 2.0 * _TRIES * _REPLY
        texts = [t for t in self.session.texts.recent(since, at_most=20) if name in t]
        return f" (it says: {texts[-1]})" if texts else ""

    # --- watching -----------------------------------------------------------------------------------------

    def watch(self, values: Mapping[str, float]) -> None:
        """From now on, note in :attr:`intrusions` when one of these changes without us."""
        self._watched.update(values)

    def unwatch(self, names: Collection[str]) -> None:
        """Stop watching these."""
        for name in names:
            self._watched.pop(name, None)
            self._suspected.pop(name, None)

    def _judge(self, name: str, value: float) -> None:
        """A late echo of our own looks like an intrusion; only one that is confirmed by asking counts."""
        expected = self._watched[name]
        if same_float32(value, expected):
            self._suspected.pop(name, None)
        elif name in self._suspected and same_float32(value, self._suspected[name]):
            self.intrusions.append((name, expected, value))
            self._watched[name] = value
            del self._suspected[name]
        else:
            self._suspected[name] = value
            self._request(name)

    # --- messages -----------------------------------------------------------------------------------------

    def _on_value(self, message: Message) -> None:
        name, value = str(message.param_id), float(message.param_value)
        self.known[name] = self._fresh[name] = value
        if message.param_index != _NO_INDEX and message.param_index < message.param_count:
            self._indices[int(message.param_index)] = name
            self._count = int(message.param_count)
        if name in self._watched and name not in self._busy:
            self._judge(name, value)

    def _on_error(self, message: Message) -> None:
        self._refused.add(str(message.param_id))

    def _forget(self, names: Iterable[str]) -> None:
        for name in names:
            self._fresh.pop(name, None)
            self._refused.discard(name)

    def _ask(self, names: list[str]) -> None:
        """Ask for *names*, a few at a time, and give each group a second after its last answer."""
        for start in range(0, len(names), _IN_FLIGHT):
            group = names[start : start + _IN_FLIGHT]
            for name in group:
                self._request(name)
            self.session.wait_for(partial(self._all_answered, group), _REPLY)

    def _all_answered(self, names: list[str]) -> bool | None:
        return True if all(n in self._fresh or n in self._refused for n in names) else None

    def _request(self, name: str) -> None:
        self.session.send(self._read_request(_encoded(name), -1))

    def _read_request(self, name: bytes, index: int) -> Message:
        return mavlink.MAVLink_param_request_read_message(*self._vehicle(), name, index)

    def _send_list_request(self) -> None:
        self.session.send(mavlink.MAVLink_param_request_list_message(*self._vehicle()))

    def _vehicle(self) -> tuple[int, int]:
        vehicle = self.session.vehicle
        if vehicle is None:
            raise NoReply("parameters were asked for before a vehicle was found; discover one first")
        return vehicle.system, vehicle.component


def _encoded(name: str) -> bytes:
    if not (0 < len(name) <= _NAME and name.isascii()):
        raise UsageError(f"'{name}' is no parameter name: 1 to {_NAME} plain letters")
    return name.encode("ascii")


def _as_float32(name: str, value: float) -> float:
    try:
        wanted = float(struct.unpack("<f", struct.pack("<f", value))[0])
    except OverflowError:
        wanted = float("inf")
    if wanted - wanted != 0.0:
        raise UsageError(f"{name} = {value} cannot be written: it is not a finite 32-bit number")
    return wanted
