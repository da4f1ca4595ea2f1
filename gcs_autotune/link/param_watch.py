"""Noticing that somebody else wrote a parameter that we rely on."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager

from gcs_autotune.link.param_exchange import ParamExchange
from gcs_autotune.link.param_value import same_float32
from gcs_autotune.link.session import Session
from gcs_autotune.link.wire import Message

__all__ = ["Intrusion", "ParamWatch"]

Intrusion = tuple[str, float, float]
"""(name, the value we left there, the value somebody else wrote)."""


class ParamWatch:
    """``intrusions`` : watched parameters that somebody else changed."""

    def __init__(self, session: Session, exchange: ParamExchange) -> None:
        self._exchange = exchange
        self._watched: dict[str, float] = {}
        self._suspected: dict[str, float] = {}
        self._busy: set[str] = set()
        self.intrusions: list[Intrusion] = []
        session.listen("PARAM_VALUE", self._on_value)

    def add(self, values: Mapping[str, float]) -> None:
        """From now on these are to stay what they are said to be."""
        self._watched.update(values)

    def drop(self, names: Collection[str]) -> None:
        """These are watched no more."""
        for name in names:
            self._watched.pop(name, None)
            self._suspected.pop(name, None)

    @contextmanager
    def writing(self, name: str) -> Iterator[None]:
        """While inside, *name* is being written by us."""
        self._busy.add(name)
        try:
            yield
        finally:
            self._busy.discard(name)

    def wrote(self, name: str, value: float) -> None:
        """We have written *name*: if it is watched, this is what it is to stay."""
        if name in self._watched:
            self._watched[name] = value

    def _on_value(self, message: Message) -> None:
        name = str(message.param_id)
        if name in self._watched and name not in self._busy:
            self._judge(name, float(message.param_value))

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
            self._exchange.request(name)
