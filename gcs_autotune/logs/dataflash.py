"""ArduPilot's log on board (dataflash: ``.bin`` binary, ``.log`` text) to tapes."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import BadFile
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.logs.dataflash_binary import HEAD, BinaryLog, Block
from gcs_autotune.logs.dataflash_signals import EVENTS, SIGNALS, Missing, signals_of
from gcs_autotune.logs.dataflash_stamps import strays_of
from gcs_autotune.logs.dataflash_text import TextBlock, TextLog
from gcs_autotune.logs.recording import Census, Recording
from gcs_autotune.logs.tape import Note, Tape

__all__ = ["record_dataflash"]

Array = NDArray[np.float64]
AnyBlock: TypeAlias = Block | TextBlock

EV_ARMED, EV_DISARMED = 10, 11
"""Event numbers of ArduPilot, for logs older than the ARM message."""
REBOOT = 5.0
"""Chosen [s]: a piece of log that begins so much before the end of what came before is of another boot."""


def record_dataflash(path: Path, system: int | None = None) -> Recording:
    """Read the log at *path*, a piece at a time; a log on board is of one vehicle, so *system* is not looked at.

    Raises
    ------
    BadFile
        Unreadable, or not a dataflash log.
    """
    try:
        with path.open("rb") as stream:
            start = stream.read(4096)
        is_binary = HEAD in start
        if not is_binary and not start.lstrip(b"\xef\xbb\xbf \r\n\t").startswith(b"FMT"):
            raise BadFile(f"{path} is no ArduPilot log: it begins with neither a binary message nor a FMT line")
        log: BinaryLog | TextLog = (
            BinaryLog(path.open("rb"))
            if is_binary
            else TextLog(path.open(encoding="utf-8-sig", errors="replace", newline=None))
        )
        scribe = _Scribe(path.stem)
        for blocks in log:
            scribe.write(blocks)
    except OSError as error:
        raise BadFile(f"{path} cannot be read: {error.strerror or error}") from error
    if not scribe.blocks:
        raise BadFile(f"{path} holds no dataflash message: it is no ArduPilot log, or damaged from its start")
    notes: list[Note] = []
    if log.damaged or scribe.strays:
        what = f"{log.damaged} stretches of the log ({log.damaged_bytes} bytes)" if log.damaged else ""
        stamps = f"{scribe.strays} stamps" if scribe.strays else ""
        notes.append(
            (
                "damaged-log",
                f"{' and '.join(w for w in (what, stamps) if w)} were damaged and left out",
                "fetch the log again; such a log carries no checksums, so look at the pictures before believing it",
            )
        )
    meta = {
        "source": path.name,
        "messages": log.messages,
        "damaged": log.damaged,
        "damaged_bytes": log.damaged_bytes,
        "damaged_stamps": scribe.strays,
        "truncated": log.truncated,
    }
    form = "log on board (binary)" if is_binary else "log on board (text)"
    return Recording(form, scribe.tapes(), meta, notes, scribe.census)


class _Scribe:
    """Writes blocks of messages onto tapes, a new one where the boot clock starts again."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.census = Census()
        self.blocks = 0
        self.strays = 0
        self.unstamped: set[str] = set()
        self._tapes = [Tape(name, "vehicle (TimeUS)")]

    def write(self, blocks: Iterable[AnyBlock]) -> None:
        """Take in what one piece of the file holds."""
        here = list(blocks)
        self.blocks += len(here)
        stamps = self._believable(here)
        for block in here:
            if block.kind not in stamps:
                self.census.count(block.kind, self._now(), len(block.order))
        for start, end in _boots(here, stamps):
            part = {
                b.kind: (b, (np.asarray(b.order) >= start) & (np.asarray(b.order) < end))
                for b in here
                if b.kind in stamps
            }
            self._write(part, stamps)

    def _write(self, part: Mapping[str, tuple[AnyBlock, NDArray[np.bool_]]], stamps: Mapping[str, Array]) -> None:
        """Write the chosen messages of one boot."""
        seen = {kind: t[np.isfinite(t)] for kind, (_, mine) in part.items() for t in (stamps[kind][mine],)}
        begins = min((float(t[0]) for t in seen.values() if len(t)), default=np.nan)
        if begins < self._tapes[-1].span[1] - REBOOT:
            old = self._tapes[-1]
            self._tapes.append(Tape(self.name, old.clock, old.vehicle, old.firmware, dict(old.parameters)))
        tape = self._tapes[-1]
        for kind, (block, mine) in part.items():
            if len(seen[kind]):
                self.census.count(kind, float(seen[kind][0]), len(seen[kind]), float(seen[kind][-1]))
            if kind not in EVENTS and kind not in SIGNALS:
                continue
            columns = {name: block.column(name)[mine] for name in block.names if name != "TimeUS"}
            try:
                if kind in EVENTS:
                    _events(tape, kind, stamps[kind][mine], columns)
                else:
                    self._told(tape, kind, stamps[kind][mine], columns)
            except Missing:
                continue

    def tapes(self) -> list[Tape]:
        """Return the tapes; where only the armed time is logged (LOG_DISARMED 0) the beginning counts as armed."""
        for tape in self._tapes:
            tape.arming.sort(key=lambda a: a[0])
            tape.modes.sort(key=lambda m: m[0])
            if tape.arming:
                tape.arming.insert(0, (tape.span[0], not tape.arming[0][1]))
            elif not tape.parameters.get("LOG_DISARMED", 0.0):
                tape.arming.append((tape.span[0], True))
        return self._tapes

    def _now(self) -> float:
        return self._tapes[-1].span[1]

    def _believable(self, blocks: list[AnyBlock]) -> dict[str, Array]:
        """Return stamps [s] by kind, NaN where one does not fit between its neighbours in the file."""
        told = {b.kind: b.column("TimeUS") for b in blocks if "TimeUS" in b.names}
        kinds = {k: t * 1e-6 for k, t in told.items() if t.dtype == np.float64 and t.ndim == 1}
        if not kinds:
            return {}
        order = np.concatenate([b.order for b in blocks if b.kind in kinds])
        t = np.concatenate(list(kinds.values()))
        place = np.argsort(order, kind="stable")
        unstamped = {kind for kind, stamps in kinds.items() if not np.any(stamps)}
        if 0 < len(unstamped) < len(kinds):  # ArduSub 4.7's RATE: as old as the message before it in the file
            self.unstamped |= unstamped
            blank = np.concatenate([np.full(len(s), k in unstamped) for k, s in kinds.items()])[place]
            last = np.maximum.accumulate(np.where(blank, -1, np.arange(len(place))))
            last[last < 0] = int(np.argmax(~blank))
            t[place] = t[place[last]]
        strays = strays_of(t[place])
        self.strays += int(np.sum(strays))
        t[place[strays]] = np.nan
        ends = np.cumsum([len(s) for s in kinds.values()])
        return dict(zip(kinds, np.split(t, ends[:-1]), strict=True))

    def _told(self, tape: Tape, kind: str, stamps: Array, columns: Mapping[str, Any]) -> None:
        values = signals_of(kind, columns)
        if kind in self.unstamped:
            tape.dated_by_arrival.update(source.partition(".")[0] for source in values)
        tape.take_all(*_whole(stamps, values))


def _boots(blocks: list[AnyBlock], stamps: Mapping[str, Array]) -> list[tuple[float, float]]:
    """Return from which message to which (numbers in the file) the clock ran on without starting again."""
    here = [b for b in blocks if b.kind in stamps]
    if not here:
        return []
    order = np.concatenate([b.order for b in here])
    t = np.concatenate([stamps[b.kind] for b in here])
    place = np.argsort(order, kind="stable")
    place = place[np.isfinite(t[place])]
    again = np.flatnonzero(np.diff(t[place]) < -REBOOT) + 1
    cuts = [-np.inf, *order[place[again]].astype(float), np.inf]
    return list(itertools.pairwise(cuts))


def _whole(t: Array, values: Mapping[str, Array]) -> tuple[Array, dict[str, Array]]:
    """Leave out the messages without a stamp or of another instance (NaN)."""
    keep = np.isfinite(t)
    for column in values.values():
        keep &= ~np.isnan(column)
    return t[keep], {name: column[keep] for name, column in values.items()}


def _events(tape: Tape, kind: str, stamps: Array, columns: Mapping[str, Any]) -> None:
    try:
        for i, t in enumerate(stamps):
            if kind == "PARM":
                if np.isfinite(columns["Value"][i]):
                    tape.parameters[str(columns["Name"][i])] = float(columns["Value"][i])
            elif np.isfinite(t):
                _event(tape, kind, float(t), {name: values[i] for name, values in columns.items()})
    except (KeyError, TypeError, ValueError) as error:
        raise Missing(str(error)) from None


def _event(tape: Tape, kind: str, t: float, m: Mapping[str, Any]) -> None:
    if kind == "MSG":
        tape.texts.append((t, str(m["Message"])))
        _name(tape, str(m["Message"]))
    elif kind == "VER":
        _name(tape, str(m["FWS"]))
    elif kind == "MODE":
        number = str(m.get("ModeNum", m.get("Mode"))).partition(".")[0]
        if number.isdecimal():
            tape.modes.append((t, int(number)))
    elif kind == "ARM":
        tape.arming.append((t, bool(m["ArmState"])))
    elif m["Id"] in (EV_ARMED, EV_DISARMED):
        tape.arming.append((t, bool(m["Id"] == EV_ARMED)))


def _name(tape: Tape, text: str) -> None:
    """Take the firmware's name and version from what it says of itself."""
    if tape.firmware is None:
        for name, firmware in FIRMWARE.items():
            if text.lower().startswith((name, name.removeprefix("ardu"))):
                tape.firmware = firmware
                tape.vehicle = text
