"""A trial: one recorded manoeuvre, as channels with units, events and an ending.

Channels carry their own time stamps, because telemetry does: a compass at 10 Hz and a servo at 50 Hz sit in
one file as rows of the union of stamps, with empty cells where a channel has no sample. An input channel
(``X Y Z K M N delta``) holds its value from its stamp to the next (zero-order hold).
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike, NDArray

from gcs_autotune.documents import conformed, load_json
from gcs_autotune.errors import BadFile, MissingChannel, UsageError
from gcs_autotune.foreign_text import visible
from gcs_autotune.notebook import pandas_module
from gcs_autotune.plain_json import plain_data
from gcs_autotune.sname import column_unit, parse_header

__all__ = ["Channel", "Mark", "Purpose", "Trial", "load_trial", "save_trial", "trial_of_columns"]

SCHEMA = 1

Purpose = Literal["identification", "proof", "check", "transit", ""]
"""What a manoeuvre was flown for: to tell the craft from, to prove gains, to see that an actuator acts and the right
way, to get somewhere; empty when the record does not say."""

_FLOWN_FOR: Mapping[str, Purpose] = {
    "step": "proof",
    "sign-check": "check",
    "turn-about": "transit",
    "dive": "transit",
}
"""Manoeuvres of records that do not say their purpose yet; all others were flown to identify."""


HALF_A_STAMP = 0.5e-6
"""Stamps are written to a microsecond [s]: one read back may lie so much before the one that was meant."""


@dataclass(frozen=True, slots=True, eq=False)
class Channel:
    """One signal in SI units.

    t, values : (n,) float64, stamps [s] non-decreasing as recorded, values in ``unit``.
    """

    name: str
    unit: str
    t: NDArray[np.float64]
    values: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.t)

    def between(self, start: float, end: float) -> Channel:
        """Return the samples with ``start <= t <= end``."""
        keep = (self.t >= start) & (self.t <= end)
        return replace(self, t=self.t[keep], values=self.values[keep])

    def held_at(self, t: float) -> float:
        """Return the value in force at *t* under zero-order hold (the first value before the first stamp)."""
        i = int(np.searchsorted(self.t, t, side="right")) - 1
        return float(self.values[max(i, 0)])


@dataclass(frozen=True, slots=True)
class Mark:
    """An event in a trial, e.g. ``Mark(12.3, "switch", {"x": 0.18, "N": 0.3})``."""

    t: float
    kind: str
    detail: Mapping[str, float | str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """One recorded manoeuvre.

    ``ending`` is ``completed``, ``stopped``, ``aborted`` or ``imported``; ``meta`` holds what was in force
    (manoeuvre settings, vehicle, firmware, seed).
    """

    name: str
    channels: Mapping[str, Channel]
    marks: tuple[Mark, ...] = ()
    ending: str = "imported"
    reason: str = ""
    meta: Mapping[str, Any] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Channel:
        """Return a channel.

        Raises
        ------
        MissingChannel
            When the trial has none of that name; the message lists what it has.
        """
        try:
            return self.channels[name]
        except KeyError:
            have = ", ".join(self.channels) or "nothing"
            raise MissingChannel(f"run '{self.name}' has no channel '{name}'; it has {have}") from None

    def __contains__(self, name: object) -> bool:
        return name in self.channels

    @property
    def start(self) -> float:
        """First stamp of any channel [s]."""
        return min((float(c.t[0]) for c in self.channels.values() if len(c)), default=math.nan)

    @property
    def end(self) -> float:
        """Last stamp of any channel [s]."""
        return max((float(c.t[-1]) for c in self.channels.values() if len(c)), default=math.nan)

    @property
    def duration(self) -> float:
        """Seconds from first to last stamp."""
        return self.end - self.start

    @property
    def purpose(self) -> Purpose:
        """What the run was flown for: ``meta["purpose"]``."""
        told = self.meta.get("purpose")
        if told is None and "manoeuvre" in self.meta:
            told = _FLOWN_FOR.get(str(self.meta["manoeuvre"]), "identification")
        return cast("Purpose", told or "")

    @property
    def by_relay(self) -> bool:
        """Whether a relay drove the input: its switches are marked, or the record's manoeuvre says so."""
        return self.meta.get("manoeuvre") == "relay" or any(m.kind == "switch" for m in self.marks)

    @property
    def proper(self) -> Trial:
        """The manoeuvre proper, without its lead-in: from ``meta["from_t"]`` on (all of it when there is none)."""
        start = self.meta.get("from_t")
        return self.between(start - HALF_A_STAMP, self.end) if isinstance(start, float) and start > self.start else self

    def with_full_scale(self, full: Mapping[str, float]) -> Trial:
        """Return the trial with forces recorded as shares of full output in N and N m.

        full : force letter -> force or moment at full output [N or N m].

        Raises
        ------
        MissingChannel
            It has no such channel. UsageError: one is no share of full.

        Examples
        --------
        >>> from gcs_autotune.api import example_run
        >>> run = example_run().with_full_scale({"N": 23.0})
        >>> run["N"].unit, round(float(max(run["N"].values)), 3)
        ('N m', 2.3)
        """
        forces = {}
        for name, size in full.items():
            share = self[name]
            if share.unit != "1":
                raise UsageError(f"{name} of run '{self.name}' is in {share.unit} already, no share of full output")
            unit = "N" if name in "XYZ" else "N m"
            forces[name] = replace(share, unit=unit, values=size * share.values)
        return replace(self, channels={**self.channels, **forces})

    def to_pandas(self) -> Any:
        """Return a pandas DataFrame: one row per stamp [s], a column ``name[unit]`` per channel, NaN between samples.

        Raises
        ------
        UsageError
            pandas is not installed.

        Examples
        --------
        >>> from gcs_autotune.api import example_run
        >>> table = example_run().to_pandas()
        >>> list(table.columns), len(table)
        (['N[1]', 'psi[rad]', 'r[rad/s]'], 600)
        """
        pandas = pandas_module()
        columns = [pandas.Series(c.values, index=c.t, name=f"{c.name}[{c.unit}]") for c in self.channels.values()]
        single = [column[~column.index.duplicated(keep="last")] for column in columns]
        table = pandas.concat(single, axis=1).sort_index() if single else pandas.DataFrame()
        table.index.name = "t[s]"
        return table

    def between(self, start: float, end: float) -> Trial:
        """Return the part of the trial with ``start <= t <= end`` [s].

        Examples
        --------
        >>> from gcs_autotune.api import example_run
        >>> part = example_run().between(10.0, 20.0)
        >>> part.start, part.end
        (10.0, 20.0)
        """
        return replace(
            self,
            channels={n: c.between(start, end) for n, c in self.channels.items()},
            marks=tuple(m for m in self.marks if start <= m.t <= end),
        )


def save_trial(trial: Trial, path: Path) -> None:
    """Write ``path`` (CSV, ``name[unit]`` heads) and beside it ``path`` with suffix ``.json`` (marks, meta).

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> t = np.array([0.0, 0.5])
    >>> with TemporaryDirectory() as folder:
    ...     save_trial(Trial("run", {"r": Channel("r", "rad/s", t, 2.0 * t)}), Path(folder) / "run.csv")
    ...     (Path(folder) / "run.csv").read_text().split()
    ['t[s],r[rad/s]', '0.000000,0', '0.500000,1']
    """
    channels = [replace(c, t=np.round(c.t, 6)) for c in trial.channels.values()]
    stamps = np.unique(np.concatenate([c.t for c in channels])) if channels else np.empty(0)
    columns = [_column(c, stamps) for c in channels]
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(["t[s]", *(f"{c.name}[{c.unit}]" for c in channels)])
        for i, t in enumerate(stamps):
            writer.writerow([f"{t:.6f}", *(column[i] for column in columns)])
    side = {
        "schema": SCHEMA,
        "name": trial.name,
        "ending": trial.ending,
        "reason": trial.reason,
        "meta": _finite(trial.meta),
        "marks": [{"t": m.t, "kind": m.kind, "detail": _finite(m.detail)} for m in trial.marks],
    }
    path.with_suffix(".json").write_text(json.dumps(side, indent=1) + "\n", encoding="utf-8")


def _finite(values: Mapping[str, Any]) -> dict[str, Any]:
    """Leave out what is unknown: JSON has no NaN."""
    return {k: plain_data(v) for k, v in values.items() if not (isinstance(v, float) and not math.isfinite(v))}


def _column(channel: Channel, stamps: NDArray[np.float64]) -> list[str]:
    cells = [""] * len(stamps)
    for i, value in zip(np.searchsorted(stamps, channel.t), channel.values, strict=True):
        cells[int(i)] = f"{value:.9g}"
    return cells


def load_trial(path: Path, columns: Mapping[str, str] | None = None) -> Trial:
    """Read a CSV run written by :func:`save_trial` or by anybody using ``name[unit]`` heads.

    columns : head (or its name) in the file -> the head it should have, for files with names of their own.

    The time column is ``t`` (or the first column whose unit is a time). Empty cells and ``nan`` are missing
    samples. Units are converted to SI. Columns of unknown name are kept; non-numeric ones are an error.

    Raises
    ------
    BadFile
        Not readable, no time column, unknown unit, a damaged row (a truncated *last* row is dropped and
        noted in ``meta["dropped_rows"]``), no rows, two columns of one name.
    UsageError
        A name in *columns* that the file does not have.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            rows = [row for row in csv.reader(stream) if row and not row[0].lstrip().startswith("#")]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise BadFile(f"{path} cannot be read as a CSV run: {error}") from error
    if len(rows) < 2:
        raise BadFile(f"{path} holds no samples; a run needs a head line like t[s],psi[rad],N[N m] and rows")
    heads = _heads(path, rows[0], columns or {})
    units = [column_unit(name, unit) for name, unit in heads]
    time_column = _time_column(path, heads, units)
    table, dropped = _table(path, rows, len(heads))
    channels = _channels([name for name, _ in heads], units, table, time_column)
    meta: dict[str, Any] = {"source": path.name, "empty_cells": int(np.isnan(table).sum())}
    if dropped:
        meta["dropped_rows"] = dropped
    return _with_side_file(Trial(visible(path.stem), channels, meta=meta), path.with_suffix(".json"))


def trial_of_columns(table: Mapping[str, ArrayLike], name: str, columns: Mapping[str, str] | None = None) -> Trial:
    """Return a run of arrays (n,) by ``name[unit]`` heads, one of them the time; NaN is a missing sample.

    columns : as :func:`load_trial`.

    Raises
    ------
    BadFile
        No time column, unknown unit, arrays of different length, not numbers, or none. UsageError: as `load_trial`.
    """
    source = Path(name)
    heads = _heads(source, list(table), columns or {})
    units = [column_unit(called, unit) for called, unit in heads]
    time_column = _time_column(source, heads, units)
    try:
        values = np.column_stack([np.asarray(column, dtype=np.float64) for column in table.values()])
    except (TypeError, ValueError) as error:
        raise BadFile(f"{name}: columns must be numbers, all of one length: {error}") from error
    if len(values) == 0:
        raise BadFile(f"{name} holds no samples")
    channels = _channels([called for called, _ in heads], units, values, time_column)
    return Trial(visible(name), channels, meta={"source": name, "empty_cells": int(np.isnan(values).sum())})


def _channels(
    names: Sequence[str], units: Sequence[tuple[str, float]], table: NDArray[np.float64], time_column: int
) -> dict[str, Channel]:
    """Return the columns of *table* (n, k) but the time as channels in SI units."""
    t = table[:, time_column] * units[time_column][1]
    known_t = np.isfinite(t)
    channels: dict[str, Channel] = {}
    for i, name in enumerate(names):
        if i != time_column:
            unit, factor = units[i]
            keep = known_t & np.isfinite(table[:, i])
            channels[name] = Channel(name, unit, t[keep], table[keep, i] * factor)
    return channels


def _heads(path: Path, row: list[str], columns: Mapping[str, str]) -> list[tuple[str, str]]:
    plain = [parse_header(visible(h)) for h in row]
    wanted = {parse_header(old): parse_header(new) for old, new in columns.items()}
    known = {*plain, *((name, "") for name, _ in plain)}
    missing = [name for name, unit in wanted if (name, unit) not in known]
    if missing:
        raise UsageError(f"{path} has no column {', '.join(missing)}; it has {', '.join(name for name, _ in plain)}")
    heads = [wanted.get(head, wanted.get((head[0], ""), head)) for head in plain]
    names = [name for name, _ in heads]
    twice = sorted({n for n in names if names.count(n) > 1})
    if twice:
        raise BadFile(f"{path} has more than one column called {', '.join(twice)}; rename one")
    return heads


def _time_column(path: Path, heads: list[tuple[str, str]], units: list[tuple[str, float]]) -> int:
    for i, (name, _) in enumerate(heads):
        if name in ("t", "time"):
            return i
    for i, (unit, _) in enumerate(units):
        if unit == "s":
            return i
    found = ", ".join(name for name, _ in heads)
    raise BadFile(f"{path} has no time column t[s]; it has {found}. Say what the columns mean: --columns OLD=t[s],...")


def _table(path: Path, rows: list[list[str]], width: int) -> tuple[NDArray[np.float64], int]:
    values: list[list[float]] = []
    dropped = 0
    for number, row in enumerate(rows[1:], start=2):
        try:
            if len(row) != width:
                raise ValueError(f"{len(row)} cells instead of {width}")
            values.append([_cell(c) for c in row])
        except ValueError as error:
            if number == len(rows):
                dropped = 1
                break
            raise BadFile(f"{path}, row {number}: {error}") from error
    if not values:
        raise BadFile(f"{path} holds no complete row of samples")
    return np.array(values, dtype=np.float64), dropped


def _cell(text: str) -> float:
    text = text.strip()
    return math.nan if text == "" else float(text)


def _with_side_file(trial: Trial, path: Path) -> Trial:
    """Return *trial* with what the file beside it says; one that is no side file of ours is left alone."""
    if not path.exists():
        return trial
    data = load_json(path, "the side file of a run")
    if not (isinstance(data, dict) and ("marks" in data or {"ending", "meta"} <= set(data))):
        return trial
    side = conformed(data, _SideFile, f"{path} beside the run cannot be read")
    marks = tuple(Mark(m.t, m.kind, m.detail) for m in side.marks)
    meta = {**trial.meta, **side.meta}
    name, reason = visible(side.name), visible(side.reason)
    return replace(trial, name=name, ending=side.ending, reason=reason, meta=meta, marks=marks)


class _MarkData(Struct, frozen=True):
    """An event of a run, as the side file has it; its ``detail`` is numbers, text, or lists of numbers."""

    t: float
    kind: str
    detail: dict[str, Any]


class _SideFile(Struct, frozen=True):
    """What :func:`save_trial` writes beside the samples."""

    name: str
    ending: Literal["completed", "stopped", "aborted", "imported"]
    reason: str
    meta: dict[str, Any]
    marks: list[_MarkData]
    schema: Literal[1]
