"""What a journal says: whom it is about, how it was found, what is still owed. Torn tails are expected."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from gcs_autotune.errors import BadFile

__all__ = ["JournalState", "good_length", "read_journal"]


@dataclass(frozen=True, slots=True)
class JournalState:
    """What a journal says.

    ``vehicle``, ``link``, ``mode``, ``armed``, ``fingerprint`` : how things were found. ``debts`` : name -> old value
    of what was written and neither returned nor kept; ``written`` : name -> the values we wrote there. ``opened`` is
    False when not even the first line reached the disk: then nothing was touched.
    """

    vehicle: Mapping[str, Any] = field(default_factory=dict)
    link: str = ""
    mode: str = ""
    armed: bool | None = None
    fingerprint: Mapping[str, float] = field(default_factory=dict)
    debts: Mapping[str, float] = field(default_factory=dict)
    written: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    closed: bool = False
    opened: bool = False

    @property
    def is_settled(self) -> bool:
        """Whether there is nothing left to put back."""
        return not self.opened or (self.closed and not self.debts)


def read_journal(path: Path) -> JournalState:
    """Return what the journal at *path* says; damage at its end, as a power cut leaves it, is ignored.

    Raises
    ------
    BadFile
        When it cannot be read, or is damaged before its end.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise BadFile(f"the journal {path} cannot be read: {error.strerror}") from error
    lines = data.split(b"\n")
    events = [_event(line) for line in lines]
    last = max((i for i, event in enumerate(events) if event is not None), default=-1)
    for number, (line, event) in enumerate(zip(lines[: last + 1], events, strict=False), start=1):
        if event is None and line.strip():
            raise BadFile(
                f"the journal {path}, line {number}, is damaged; put the old values back with `gcs-autotune params "
                "restore` and the parameters_before.param beside it"
            )
    return _replay(path, [event for event in events if event is not None])


def good_length(data: bytes) -> int:
    """Return how many bytes of a journal are whole lines, the last one perhaps without its end."""
    good = position = 0
    for line in data.split(b"\n"):
        position += len(line)
        if _event(line) is not None:
            good = min(position + 1, len(data))
        position += 1
    return good


def _event(line: bytes) -> dict[str, Any] | None:
    """Return the event of a line; None when it is damaged or empty."""
    try:
        event = json.loads(line.decode("utf-8"))
    except (ValueError, RecursionError):
        return None
    return event if isinstance(event, dict) and isinstance(event.get("event"), str) else None


def _replay(path: Path, events: list[dict[str, Any]]) -> JournalState:
    head: dict[str, Any] = {}
    lent: dict[str, float] = {}
    debts: dict[str, float] = {}
    written: dict[str, tuple[float, ...]] = {}
    closed = opened = False
    try:
        for event in events:
            closed = event["event"] == "closed"
            match event["event"]:
                case "opened":
                    head, opened = head or event, True
                case "lent":
                    lent[str(event["name"])] = float(event["value"])
                case "writing":
                    name = str(event["name"])
                    debts.setdefault(name, lent[name])
                    written[name] = (*written.get(name, ()), float(event["value"]))
                case "returned":
                    debts.pop(event["name"], None)
                    written.pop(event["name"], None)
                case "kept":
                    for name in event["values"]:
                        debts.pop(name, None)
                        written.pop(name, None)
        found = JournalState(
            dict(head.get("vehicle", {})),
            str(head.get("link", "")),
            str(head.get("mode", "")),
            head.get("armed"),
            {str(n): float(v) for n, v in head.get("fingerprint", {}).items()},
        )
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise BadFile(f"the journal {path} holds an event that makes no sense: {error!r}") from error
    return replace(found, debts=debts, written=written, closed=closed, opened=opened)
