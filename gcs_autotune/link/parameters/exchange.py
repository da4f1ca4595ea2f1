"""Parameter requests and their answers: PARAM_REQUEST_READ, PARAM_VALUE, PARAM_ERROR.

Reads single parameters, or the whole list and then missing entries by index. Unrequested values show that another
station has written a parameter that this program depends on.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial

from gcs_autotune.clock import Deadline
from gcs_autotune.errors import NoReply, UsageError
from gcs_autotune.link.session import Session
from gcs_autotune.mavlink import Message, mavlink

__all__ = [
    "IN_FLIGHT",
    "REPLY",
    "Intrusion",
    "ParamExchange",
    "ParamWatch",
    "as_float32",
    "encoded",
    "read_list",
    "same_float32",
]

_NAME = 16


def same_float32(a: float, b: float) -> bool:
    """Return whether two numbers are the same 32-bit float, except for rounding of the last bits."""
    if a == b or (math.isnan(a) and math.isnan(b)):
        return True
    return math.isfinite(a) and math.isfinite(b) and abs(a - b) <= 4.0 * 2.0**-24 * max(abs(a), abs(b))


def encoded(name: str) -> bytes:
    """Return *name* encoded for sending.

    Raises
    ------
    UsageError
        *name* is not a valid parameter name.
    """
    if not (0 < len(name) <= _NAME and name.isascii()):
        raise UsageError(f"'{name}' is not a parameter name. Use 1 to {_NAME} plain characters")
    return name.encode("ascii")


def as_float32(name: str, value: float) -> float:
    """Return *value* as the parameter *name* would store it.

    Raises
    ------
    UsageError
        *value* is not a finite number that a 32-bit float can represent.
    """
    try:
        wanted = float(struct.unpack("<f", struct.pack("<f", value))[0])
    except OverflowError:
        wanted = float("inf")
    if wanted - wanted != 0.0:
        raise UsageError(f"{name} = {value} cannot be written: it is not a finite 32-bit number")
    return wanted


REPLY = 1.0
"""Time to wait for an answer to a parameter request [s]. Project choice."""
IN_FLIGHT = 10
"""Number of parameter requests sent before waiting for answers, about what the buffer of a slow radio can store.
Project choice.
"""
_NO_INDEX = 65535


class ParamExchange:
    """Parameter requests and answers of one session.

    Attributes
    ----------
    known : last value received of every name; ``types`` : their MAV_PARAM_TYPE.
    fresh : answers by name since the last :meth:`forget`; ``refused`` : names that the vehicle reports as missing.
    indices : index in the vehicle's list -> name; ``count`` : length of that list, 0 if not reported.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self.known: dict[str, float] = {}
        self.types: dict[str, int] = {}
        self.fresh: dict[str, float] = {}
        self.refused: set[str] = set()
        self.indices: dict[int, str] = {}
        self.count = 0
        session.listen("PARAM_VALUE", self._on_value)
        session.listen("PARAM_ERROR", self._on_error)

    def _on_value(self, message: Message) -> None:
        name = str(message.param_id)
        self.known[name] = self.fresh[name] = float(message.param_value)
        self.types[name] = int(message.param_type)
        if message.param_index != _NO_INDEX and message.param_index < message.param_count:
            self.indices[int(message.param_index)] = name
            self.count = int(message.param_count)

    def _on_error(self, message: Message) -> None:
        self.refused.add(str(message.param_id))

    def forget(self, names: Iterable[str]) -> None:
        """Discard previous answers for *names*."""
        for name in names:
            self.fresh.pop(name, None)
            self.refused.discard(name)

    def settled(self, name: str) -> bool:
        """Return whether a value or an error was received for *name*."""
        return name in self.fresh or name in self.refused

    def any_settled(self, group: Sequence[str]) -> bool:
        """Return whether, of the alternative names in *group*, one has a value or all have errors."""
        return any(n in self.fresh for n in group) or all(n in self.refused for n in group)

    def first(self, names: Iterable[str]) -> str | None:
        """Return the first of *names* for which a value was received, or None."""
        return next((name for name in names if name in self.fresh), None)

    def ask(self, names: Sequence[str]) -> None:
        """Request *names*, a few at a time. Wait a second after the last answer of each group."""
        for start in range(0, len(names), IN_FLIGHT):
            group = names[start : start + IN_FLIGHT]
            for name in group:
                self.request(name)
            self._session.wait_for(partial(self._all_settled, group), REPLY)

    def ask_any(self, groups: Sequence[Sequence[str]]) -> None:
        """Request the alternative names of all *groups*, a few groups at a time, until each has a value or only
        errors.
        """
        for start in range(0, len(groups), IN_FLIGHT // 2):
            batch = groups[start : start + IN_FLIGHT // 2]
            for name in (name for group in batch for name in group):
                self.request(name)
            self._session.wait_for(partial(self._each_settled, batch), REPLY)

    def _all_settled(self, names: Collection[str]) -> bool | None:
        return True if all(self.settled(name) for name in names) else None

    def _each_settled(self, groups: Sequence[Sequence[str]]) -> bool | None:
        return True if all(self.any_settled(group) for group in groups) else None

    def request(self, name: str) -> None:
        """Request one parameter without waiting for the answer."""
        self._request(encoded(name), -1)

    def request_index(self, index: int) -> None:
        """Request the parameter at one index of the list without waiting for the answer."""
        self._request(b"", index)

    def request_list(self) -> None:
        """Request the whole parameter list without waiting for it."""
        self._session.send(mavlink.MAVLink_param_request_list_message(*self._vehicle()))

    def set(self, name: str, value: float) -> None:
        """Discard previous answers for *name* and send PARAM_SET, without waiting."""
        vehicle = self._vehicle()
        self.forget([name])
        self._session.send(
            mavlink.MAVLink_param_set_message(*vehicle, encoded(name), value, mavlink.MAV_PARAM_TYPE_REAL32)
        )

    def _request(self, name: bytes, index: int) -> None:
        self._session.send(mavlink.MAVLink_param_request_read_message(*self._vehicle(), name, index))

    def _vehicle(self) -> tuple[int, int]:
        vehicle = self._session.vehicle
        if vehicle is None:
            raise NoReply("parameters were requested before a vehicle was discovered. Discover a vehicle first")
        return vehicle.system, vehicle.component


_QUIET = 1.5
"""Seconds without new values after which missing ones are requested. Project choice."""


def read_list(session: Session, exchange: ParamExchange, timeout: float) -> dict[str, float]:
    """Return name -> value of all parameters. It raises the errors of ``Parameters.read_full``."""
    exchange.fresh, exchange.indices, exchange.count = {}, {}, 0
    deadline = Deadline.after(session.liveness, timeout)
    exchange.request_list()
    while not deadline.expired and not _is_whole(exchange):
        heard = len(exchange.indices)
        session.wait_for(partial(_progress, exchange, heard), _QUIET)
        if len(exchange.indices) == heard:
            _fill_gaps(exchange)
    if not _is_whole(exchange):
        raise NoReply(
            f"the parameter list of {session.vehicle} stayed incomplete "
            f"({len(exchange.indices)} of {exchange.count or 'unknown'}) after {timeout:g} s. Try a faster link"
        )
    return {name: exchange.fresh[name] for name in sorted(exchange.fresh)}


def _is_whole(exchange: ParamExchange) -> bool:
    return exchange.count > 0 and len(exchange.indices) >= exchange.count


def _progress(exchange: ParamExchange, seen: int) -> bool | None:
    return True if len(exchange.indices) != seen else None


def _fill_gaps(exchange: ParamExchange) -> None:
    if not exchange.count:
        exchange.request_list()
        return
    gaps = [i for i in range(exchange.count) if i not in exchange.indices]
    for index in gaps[:IN_FLIGHT]:
        exchange.request_index(index)


Intrusion = tuple[str, float, float]
"""A monitored parameter that another station changed: (name, value that we wrote, value written by another station)."""


class ParamWatch:
    """Monitors parameters; ``intrusions`` are those changed by another station."""

    def __init__(self, session: Session, exchange: ParamExchange) -> None:
        self._exchange = exchange
        self._watched: dict[str, float] = {}
        self._suspected: dict[str, float] = {}
        self._busy: set[str] = set()
        self.intrusions: list[Intrusion] = []
        session.listen("PARAM_VALUE", self._on_value)

    def add(self, values: Mapping[str, float]) -> None:
        """Monitor the parameters *values* (name -> value). A parameter that is already monitored with another value
        counts as changed.
        """
        for name, value in values.items():
            before = self._watched.get(name, value)
            if not same_float32(before, value):
                self.intrusions.append((name, before, value))
        self._watched.update(values)

    def drop(self, names: Collection[str]) -> None:
        """Stop monitoring the parameters *names*."""
        for name in names:
            self._watched.pop(name, None)
            self._suspected.pop(name, None)

    @contextmanager
    def writing(self, name: str) -> Iterator[None]:
        """Return a context in which this program writes *name*."""
        self._busy.add(name)
        try:
            yield
        finally:
            self._busy.discard(name)

    def wrote(self, name: str, value: float) -> None:
        """Record that this program wrote *name*. If *name* is monitored, *value* is its new expected value."""
        if name in self._watched:
            self._watched[name] = value

    def _on_value(self, message: Message) -> None:
        name = str(message.param_id)
        if name in self._watched and name not in self._busy:
            self._judge(name, float(message.param_value))

    def _judge(self, name: str, value: float) -> None:
        """Count a change only if another read confirms it, because a late echo of our own write looks the same."""
        expected = self._watched[name]
        if same_float32(value, expected):
            self._suspected.pop(name, None)
        elif name in self._suspected and same_float32(value, self._suspected[name]):
            self.intrusions.append((name, expected, value))
            self._watched[name] = value
            del self._suspected[name]
        else:
            self._suspected[name] = value
            self._exchange.request(name)
