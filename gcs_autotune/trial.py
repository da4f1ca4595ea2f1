"""A trial: one recorded manoeuvre, as channels with units, events and an ending.

Each channel has its own time stamps, as in telemetry. In a file, a compass at 10 Hz and a servo at 50 Hz have rows
for all stamps, with empty cells where a channel has no sample. An input channel (``X Y Z K M N delta``) holds its value
from its stamp to the next (zero-order hold).
"""

from __future__ import annotations

import csv
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike, NDArray

from gcs_autotune.csv_table import (
    LAST,
    Note,
    TableNumbers,
    cells_of,
    clock_notes,
    is_believable,
    is_pulses,
    numbers_of,
    shares_of_pulses,
    since_1970,
)
from gcs_autotune.documents import conformed, load_json
from gcs_autotune.errors import BadFile, MissingChannel, UsageError
from gcs_autotune.notebook import Display, Displayed, Table, pandas_module
from gcs_autotune.plain_json import plain_data
from gcs_autotune.rounding import format_number
from gcs_autotune.sname import INPUTS, column_unit, parse_header
from gcs_autotune.untrusted_text import visible

__all__ = [
    "TIMES",
    "Channel",
    "Mark",
    "Note",
    "Purpose",
    "Trial",
    "as_share",
    "load_meta",
    "load_trial",
    "save_trial",
    "trial_of_columns",
]

SCHEMA = 1

Purpose = Literal["identification", "proof", "check", "transit", ""]
"""Purpose of a manoeuvre: identification, proof of gains, check of an actuator, positioning; empty if not recorded."""

_FLOWN_FOR: Mapping[str, Purpose] = {
    "step": "proof",
    "sign-check": "check",
    "turn-about": "transit",
    "dive": "transit",
}
"""Purpose of manoeuvres in old records without one. All others were flown for identification."""


HALF_A_STAMP = 0.5e-6
"""Resolution of written timestamps [s]. A time stamp read back may be earlier than the original by this time."""


@dataclass(frozen=True, slots=True, eq=False)
class Channel(Displayed):
    """One signal in SI units.

    t, values : (n,) float64; non-decreasing stamps [s] as recorded, and values in ``unit``.
    """

    name: str
    unit: str
    t: NDArray[np.float64] = field(repr=False)
    values: NDArray[np.float64] = field(repr=False)

    def __len__(self) -> int:
        return len(self.t)

    def between(self, start: float, end: float) -> Channel:
        """Return the samples with ``start <= t <= end``."""
        keep = (self.t >= start) & (self.t <= end)
        return replace(self, t=self.t[keep], values=self.values[keep])

    def held_at(self, t: float) -> float:
        """Return the value at *t* [s] by zero-order hold. Before the first time stamp it is the first value."""
        i = int(np.searchsorted(self.t, t, side="right")) - 1
        return float(self.values[max(i, 0)])


@dataclass(frozen=True, slots=True)
class Mark(Displayed):
    """An event in a trial, e.g. ``Mark(12.3, "switch", {"x": 0.18, "N": 0.3})``."""

    t: float
    kind: str
    detail: Mapping[str, float | str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Trial(Displayed):
    """One recorded manoeuvre.

    ``ending`` is ``completed``, ``stopped``, ``aborted`` or ``imported``; ``meta`` contains the conditions (manoeuvre
    settings, vehicle, firmware, seed).
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
            The trial has no channel of that name; the message lists its channels.
        """
        try:
            return self.channels[name]
        except KeyError:
            have = ", ".join(self.channels) or "nothing"
            raise MissingChannel(f"run '{self.name}' contains no channel '{name}'. It contains {have}") from None

    def __contains__(self, name: object) -> bool:
        return name in self.channels

    def _display(self) -> Display:
        rows = [
            (
                name,
                channel.unit,
                str(len(channel)),
                *(format_number(float(f(channel.values))) if len(channel) else "" for f in (np.nanmin, np.nanmax)),
            )
            for name, channel in self.channels.items()
        ]
        title = f"Run '{self.name}', {format_number(self.duration)} s, {self.ending}"
        table = Table(("channel", "unit", "samples", "least", "greatest"), tuple(rows))
        return Display(title, (table,) if rows else (), (self.reason,) if self.reason else ())

    @property
    def start(self) -> float:
        """Earliest time stamp of all channels [s]."""
        return min((float(c.t[0]) for c in self.channels.values() if len(c)), default=math.nan)

    @property
    def end(self) -> float:
        """Latest time stamp of all channels [s]."""
        return max((float(c.t[-1]) for c in self.channels.values() if len(c)), default=math.nan)

    @property
    def duration(self) -> float:
        """Time from the first to the last time stamp [s]."""
        return self.end - self.start

    @property
    def purpose(self) -> Purpose:
        """Purpose of the run: ``meta["purpose"]``."""
        told = self.meta.get("purpose")
        if told is None and "manoeuvre" in self.meta:
            told = _FLOWN_FOR.get(str(self.meta["manoeuvre"]), "identification")
        return cast("Purpose", told or "")

    @property
    def by_relay(self) -> bool:
        """Whether a relay drove the input, according to its marked switches or the recorded manoeuvre."""
        return self.meta.get("manoeuvre") == "relay" or any(m.kind == "switch" for m in self.marks)

    @property
    def proper(self) -> Trial:
        """The manoeuvre itself: from ``meta["from_t"]`` to ``meta["to_t"]`` [s], if present.

        The lead-in comes before it. After it the craft waited for an answer of the operator.
        """
        start, end = self.meta.get("from_t"), self.meta.get("to_t")
        begins = start - HALF_A_STAMP if isinstance(start, float) and start > self.start else self.start
        ends = end + HALF_A_STAMP if isinstance(end, float) and end < self.end else self.end
        return self if (begins, ends) == (self.start, self.end) else self.between(begins, ends)

    def with_full_scale(self, full: Mapping[str, float]) -> Trial:
        """Return the trial with forces recorded as normalised output converted to N and N m.

        full : force letter -> force or moment at full output [N or N m].

        Raises
        ------
        MissingChannel
            The trial has no such channel. UsageError: a channel is not a normalised output.

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
                raise UsageError(f"{name} of run '{self.name}' is already in {share.unit}, not a normalised output")
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
    """Write ``path`` (CSV, ``name[unit]`` headings), and ``path`` with suffix ``.json`` (marks, meta) in the same
    folder.

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
    """Remove unknown numbers, because JSON has no NaN."""
    return {k: plain_data(v) for k, v in values.items() if not (isinstance(v, float) and not math.isfinite(v))}


def _column(channel: Channel, stamps: NDArray[np.float64]) -> list[str]:
    cells = [""] * len(stamps)
    for i, value in zip(np.searchsorted(stamps, channel.t), channel.values, strict=True):
        cells[int(i)] = f"{value:.9g}"
    return cells


def load_trial(path: Path, columns: Mapping[str, str] | None = None) -> Trial:
    """Return the run in a CSV file with ``name[unit]`` headings, written by :func:`save_trial` or any other program.

    columns : heading (or its name) in the file -> the heading to use instead, for files with other names.

    The time column is ``t`` (or the first column whose unit is a time). Empty cells and ``nan`` are missing
    samples. Units are converted to SI, inputs in pulses to normalised output. Columns of unknown name are kept if they
    contain numbers. ``meta["notes"]`` lists what was skipped or assumed.

    Raises
    ------
    BadFile
        The file is not readable, has no time column, an unknown unit or a damaged row (a truncated *last* row is
            dropped and
        noted in ``meta["dropped_rows"]``), has no rows, two columns of one name, or another type (semicolons, decimal
            commas, dates, UTF-16).
    UsageError
        A name in *columns* does not exist in the file.
    """
    cells = cells_of(path)
    heads = _heads(path, cells.head, columns or {})
    table = numbers_of(cells)
    heads = [heads[i] for i in table.columns]
    notes = _table_notes(path.stem, [name for name, _ in heads], table)
    channels, more = _channels(path, heads, table.values)
    meta: dict[str, Any] = {"source": path.name, "empty_cells": int(np.isnan(table.values).sum())}
    if table.dropped:
        meta["dropped_rows"] = table.dropped
    trial = _with_side_file(Trial(visible(path.stem), channels, meta=meta), path.with_suffix(".json"))
    there = {tuple(note) for note in trial.meta.get("notes", ()) if isinstance(note, (list, tuple))}
    return _noted(trial, [note for note in (*notes, *more) if note not in there])


def load_meta(path: Path) -> Mapping[str, Any]:
    """Return the ``meta`` of the run in a CSV file that :func:`save_trial` wrote. The samples are not read.

    Raises
    ------
    BadFile
        The metadata file is damaged.
    """
    return _with_side_file(Trial(visible(path.stem), {}), path.with_suffix(".json")).meta


def _noted(trial: Trial, notes: Sequence[Note]) -> Trial:
    """Return *trial* with further *notes* in its ``meta``."""
    return replace(trial, meta={**trial.meta, "notes": [*trial.meta.get("notes", ()), *notes]}) if notes else trial


def _table_notes(run: str, names: Sequence[str], table: TableNumbers) -> list[Note]:
    """Return notes about the cells of a table that are not numbers."""
    notes: list[Note] = []
    bad = [
        f"{count} of {name} {'is' if count == 1 else 'are'} {what}"
        for what, counts in (("nan", table.nans), ("inf", table.infinite))
        for name, count in zip(names, counts, strict=True)
        if count
    ]
    if bad:
        cure = "check the sensor and the logger. The samples were skipped"
        notes.append(("no-numbers", f"of {len(table.values)} samples in run '{visible(run)}' {', '.join(bad)}", cure))
    if table.texts:
        notes.append(
            (
                "text-columns",
                f"columns of run '{visible(run)}' that contain words were skipped: {', '.join(table.texts[:5])}",
                "no action needed if they are not signals",
            )
        )
    return notes


def trial_of_columns(table: Mapping[str, ArrayLike], name: str, columns: Mapping[str, str] | None = None) -> Trial:
    """Return a run from arrays (n,) by ``name[unit]`` headings, one of them the time. NaN is a missing sample.

    columns : as :func:`load_trial`.

    Raises
    ------
    BadFile
        There is no time column, a unit is unknown, the arrays differ in length, are not numbers, or are empty.
            UsageError: as for `load_trial`.
    """
    source = Path(name)
    heads = _heads(source, list(table), columns or {})
    try:
        values = np.column_stack([np.asarray(column, dtype=np.float64) for column in table.values()])
    except (TypeError, ValueError) as error:
        raise BadFile(f"{name}: columns must be numbers of equal length: {error}") from error
    if len(values) == 0:
        raise BadFile(f"{name} contains no samples")
    channels, notes = _channels(source, heads, values)
    return _noted(
        Trial(visible(name), channels, meta={"source": name, "empty_cells": int(np.isnan(values).sum())}), notes
    )


@np.errstate(invalid="ignore", over="ignore")  # damaged numbers may be signalling NaN, or overflow
def _channels(
    path: Path, heads: Sequence[tuple[str, str]], table: NDArray[np.float64]
) -> tuple[dict[str, Channel], list[Note]]:
    """Return the columns of *table* (n, k), except the time, as channels in SI units, and notes on what was assumed or
    left out."""
    try:
        units = [column_unit(name, unit) for name, unit in heads]
    except BadFile as error:
        raise BadFile(f"{path}: {error}") from None
    time_column = _time_column(path, heads, units)
    t = table[:, time_column] * units[time_column][1]
    if not heads[time_column][1]:
        t, notes = since_1970(path.name, t)
    else:
        notes = []
    t = np.where(np.abs(t) <= LAST, t, np.nan)
    known_t = np.isfinite(t)
    notes += clock_notes(path.name, t)
    channels: dict[str, Channel] = {}
    for i, (name, _) in enumerate(heads):
        if i != time_column:
            unit, factor = units[i]
            values = table[:, i] * factor
            keep, doubts = is_believable(name, values, path.name)
            keep &= known_t
            channels[name], more = as_share(Channel(name, unit, t[keep], values[keep]), path.stem)
            notes += [*doubts, *more]
    return channels, notes


def as_share(channel: Channel, run: str) -> tuple[Channel, list[Note]]:
    """Return an input in pulses [us] as normalised output about neutral, with a note. Other channels are unchanged.

    Raises
    ------
    BadFile
        The channel's unit is that of pulses, but its values cannot be pulses.
    """
    if channel.name not in INPUTS or not is_pulses(channel.unit, channel.values):
        return channel, []
    values, note = shares_of_pulses(channel.name, channel.values, run)
    return replace(channel, unit="1", values=values), [note]


def _heads(path: Path, row: list[str], columns: Mapping[str, str]) -> list[tuple[str, str]]:
    try:
        plain = [parse_header(visible(h)) for h in row]
        wanted = {parse_header(old): parse_header(new) for old, new in columns.items()}
    except BadFile as error:
        raise BadFile(f"{path}: {error}") from None
    known = {*plain, *((name, "") for name, _ in plain)}
    missing = [name for name, unit in wanted if (name, unit) not in known]
    if missing:
        raise UsageError(
            f"{path} has no column {', '.join(missing)}. Its columns are {', '.join(name for name, _ in plain)}"
        )
    heads = [wanted.get(head, wanted.get((head[0], ""), head)) for head in plain]
    heads = [(new, unit or old_unit) for (new, unit), (_, old_unit) in zip(heads, plain, strict=True)]
    names = [name for name, _ in heads]
    twice = sorted({n for n in names if names.count(n) > 1})
    if twice:
        raise BadFile(f"{path} has more than one column called {', '.join(twice)}. Rename one")
    return heads


TIMES = ("t", "time", "%time", "timestamp", "stamp")
"""Names of a time column, in lower case. ``%time`` comes from ``rostopic echo -p``."""


def _time_column(path: Path, heads: Sequence[tuple[str, str]], units: Sequence[tuple[str, float]]) -> int:
    for i, (name, _) in enumerate(heads):
        if name.lower() in TIMES and units[i][0] in ("s", "1"):
            return i
    for i, (unit, _) in enumerate(units):
        if unit == "s":
            return i
    found = ", ".join(name for name, _ in heads)
    raise BadFile(
        f"{path} has no time column t[s]. Its columns are {found}. Map the columns with --columns OLD=t[s],..."
    )


_BEGINNING = re.compile(rb'\s*\{\s*"schema":\s*\d+,\s*"name":')
"""First characters of a metadata file, to distinguish a truncated one from a file that is not JSON."""


def _with_side_file(trial: Trial, path: Path) -> Trial:
    """Return *trial* with the contents of its metadata file. Other JSON files are ignored."""
    if not path.is_file():
        return trial
    try:
        data = load_json(path, "the meta file of a run")
    except BadFile:
        if not _BEGINNING.match(path.read_bytes()[:200]):
            return trial
        raise  # torn: its marks would be missed
    if not (isinstance(data, dict) and ("marks" in data or {"ending", "meta"} <= set(data))):
        return trial
    side = conformed(data, _SideFile, f"{path}, the meta file of the run, cannot be read")
    marks = tuple(Mark(m.t, m.kind, m.detail) for m in side.marks)
    meta = {**trial.meta, **side.meta}
    name, reason = visible(side.name), visible(side.reason)
    return replace(trial, name=name, ending=side.ending, reason=reason, meta=meta, marks=marks)


class _MarkData(Struct, frozen=True, forbid_unknown_fields=True):
    """An event of a run as in the metadata file. Its ``detail`` consists of numbers, text, or lists of numbers."""

    t: float
    kind: str
    detail: dict[str, Any]


class _SideFile(Struct, frozen=True, forbid_unknown_fields=True):
    """Contents of the metadata file of :func:`save_trial`."""

    name: str
    ending: Literal["completed", "stopped", "aborted", "imported"]
    reason: str
    meta: dict[str, Any]
    marks: list[_MarkData]
    schema: Literal[1]
