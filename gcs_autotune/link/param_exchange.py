"""Questions about parameters, and the answers heard to them: PARAM_REQUEST_READ, PARAM_VALUE, PARAM_ERROR."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from functools import partial

from gcs_autotune.errors import NoReply
from gcs_autotune.link.param_value import encoded
from gcs_autotune.link.session import Session
from gcs_autotune.link.wire import Message, mavlink

__all__ = ["IN_FLIGHT", "REPLY", "ParamExchange"]

REPLY = 1.0
"""Chosen: seconds to wait for one answer."""
IN_FLIGHT = 10
"""Chosen: requests outstanding at once; a slow radio's buffer holds about that many."""
_NO_INDEX = 65535


class ParamExchange:
    """One session's questions and answers.

    Attributes
    ----------
    known : last value heard of every name; ``types`` : as what type (MAV_PARAM_TYPE).
    fresh : what was answered since it was last forgotten, by name; ``refused`` : what the vehicle says it has not.
    indices : place in the vehicle's list -> name; ``count`` : how long that list is, 0 when it has not been told.
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
        """From now on only what is heard anew of *names* counts."""
        for name in names:
            self.fresh.pop(name, None)
            self.refused.discard(name)

    def settled(self, name: str) -> bool:
        """Whether *name* has been answered, with a value or a refusal."""
        return name in self.fresh or name in self.refused

    def any_settled(self, group: Sequence[str]) -> bool:
        """Whether one of alternative names has a value, or all of them were refused."""
        return any(n in self.fresh for n in group) or all(n in self.refused for n in group)

    def first(self, names: Iterable[str]) -> str | None:
        """Return the first of *names* that has a value."""
        return next((name for name in names if name in self.fresh), None)

    def ask(self, names: Sequence[str]) -> None:
        """Ask for *names*, a few at a time, and give each group a second after its last answer."""
        for start in range(0, len(names), IN_FLIGHT):
            group = names[start : start + IN_FLIGHT]
            for name in group:
                self.request(name)
            self._session.wait_for(partial(self._all_settled, group), REPLY)

    def ask_any(self, groups: Sequence[Sequence[str]]) -> None:
        """Ask for one name of each of *groups* of alternative ones, likewise."""
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
        """Ask for one parameter; do not wait."""
        self._request(encoded(name), -1)

    def request_index(self, index: int) -> None:
        """Ask for the parameter in one place of the list; do not wait."""
        self._request(b"", index)

    def request_list(self) -> None:
        """Ask for all of them; do not wait."""
        self._session.send(mavlink.MAVLink_param_request_list_message(*self._vehicle()))

    def set(self, name: str, value: float) -> None:
        """Send PARAM_SET, and forget what was answered about *name* before; do not wait."""
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
            raise NoReply("parameters were asked for before a vehicle was found; discover one first")
        return vehicle.system, vehicle.component
