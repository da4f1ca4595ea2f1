"""Content of any ArduPilot log between two boots, whatever its format: samples, parameters, modes, arming.

Readers fill a :class:`SampleStore` with *named sources* (``attitude.psi``, ``local.x``, ``ekf.z``, ``servo.1``).
:mod:`.channels` later selects the source for each channel. Angles are in radians, the rest in SI, positions on
the globe in degrees. Samples are stored in flat arrays of doubles, and a column that never changes as one number. So an
hour's log needs megabytes and not gigabytes. A :class:`Recording` contains the stores of a whole log, with its counts
and doubts.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import ParameterMissing
from gcs_autotune.firmware import Firmware, checked_all
from gcs_autotune.trial import Note

__all__ = ["UNKNOWN", "Census", "Heard", "LogReader", "Note", "RecordedParameters", "Recording", "SampleStore"]

Array = NDArray[np.float64]
LIMITS: Mapping[str, float] = {
    **dict.fromkeys(("phi", "theta", "psi"), 10.0),
    **dict.fromkeys("pqr", 200.0),
    **dict.fromkeys(("U", "vn", "ve", "w"), 200.0),
    **dict.fromkeys("xyz", 1e7),
    "lat": 90.0,
    "lon": 180.0,
}
"""Largest plausible magnitude of a source's values, by the part of its name after the dot (rad, rad/s, m/s, m, deg).
Project choice."""
LARGEST = 1e5
"""Largest plausible magnitude for every other source (pulses in us, stick fractions). Project choice."""


UNKNOWN = "unknown vehicle"
"""Name of the vehicle if the log does not contain one."""


class RecordedParameters:
    """The parameters recorded in a log, with the interface ``ParameterSource``."""

    def __init__(self, values: Mapping[str, float]) -> None:
        self.values = dict(values)

    def read(self, name: str) -> float:
        """Return the recorded value of the parameter *name*."""
        return self.read_all([name])[name]

    def read_all(self, names: Iterable[str]) -> dict[str, float]:
        """Return name -> value of all *names*.

        Raises
        ------
        ParameterMissing
            The log does not contain one of the parameters.
        PreconditionFailed
            The log contains an implausible value.
        """
        wanted = list(names)
        missing = [n for n in wanted if n not in self.values]
        if missing:
            raise ParameterMissing(f"the log does not contain the parameter {', '.join(missing)}", name=missing[0])
        return checked_all({n: self.values[n] for n in wanted})

    def read_existing(self, names: Iterable[str]) -> dict[str, float]:
        """Return name -> value of those *names* that the log contains."""
        return checked_all({n: self.values[n] for n in names if n in self.values})


class _Column:
    """Values of one source, stored as one number and a count until they change for the first time."""

    __slots__ = ("count", "first", "values")

    def __init__(self, first: float) -> None:
        self.first = first
        self.count = 0
        self.values: array[float] | None = None

    def append(self, value: float) -> None:
        if self.values is not None:
            self.values.append(value)
        elif value == self.first:
            self.count += 1
        else:
            self._unfold().append(value)

    def extend(self, values: Array) -> None:
        if self.values is None and bool(np.all(values == self.first)):
            self.count += len(values)
        else:
            (self.values if self.values is not None else self._unfold()).frombytes(values.tobytes())

    def _unfold(self) -> array[float]:
        self.values = array("d", [self.first]) * self.count
        return self.values

    def read(self) -> Array:
        if self.values is None:
            return np.full(self.count, self.first)
        return np.array(self.values, dtype=np.float64)


class _Group:
    """Sources that share time stamps, because one message contains them. It always has at least one sample."""

    __slots__ = ("_read", "columns", "stamps")

    def __init__(self, values: Iterable[float]) -> None:
        self.stamps = array("d")
        self.columns = [_Column(v) for v in values]
        self._read = np.empty(0)

    def times(self) -> Array:
        """Return the time stamps as one array for all columns, so that they need memory only once."""
        if len(self._read) != len(self.stamps):
            self._read = np.array(self.stamps, dtype=np.float64)
        return self._read


@dataclass(eq=False)
class SampleStore:
    """One vehicle from one boot to the next; times [s] since that boot.

    Attributes
    ----------
    name : name of the file. vehicle : text for the vehicle. firmware : its profile, None when unknown.
    parameters : last recorded value of each. texts, modes, arming : messages and changes, with their times.
    clock : source of the timestamps. late : samples skipped because they arrived after later ones.
    absurd : samples skipped because they are not a number, or implausible (see :data:`LIMITS`).
    dated_by_arrival : sources without timestamps, timed by arrival.
    by_speed : whether the inputs are the measured speeds of the shafts, not the commands.
    """

    name: str
    clock: str
    vehicle: str = UNKNOWN
    firmware: Firmware | None = None
    parameters: dict[str, float] = field(default_factory=dict)
    modes: list[tuple[float, int]] = field(default_factory=list)
    arming: list[tuple[float, bool]] = field(default_factory=list)
    texts: list[tuple[float, str]] = field(default_factory=list)
    notes: list[Note] = field(default_factory=list)
    dated_by_arrival: set[str] = field(default_factory=set)
    by_speed: bool = False
    late: int = 0
    absurd: int = 0
    _groups: dict[tuple[str, ...], _Group] = field(default_factory=dict)
    _limits: dict[tuple[str, ...], list[float]] = field(default_factory=dict)

    def take(self, t: float, values: Mapping[str, float]) -> None:
        """Add samples stamped *t* [s]. A sample older than the last one of its source is counted and discarded."""
        if not values:
            return
        names = tuple(values)
        group = self._groups.get(names)
        if group is None:
            limits = self._limits[names] = _limits(names)
        else:
            limits = self._limits[names]
            if t < group.stamps[-1]:
                self.late += 1
                return
        if not all(-most <= v <= most for v, most in zip(values.values(), limits, strict=True)):
            self.absurd += 1
            return
        if group is None:
            group = self._groups[names] = _Group(values.values())
        group.stamps.append(t)
        for column, value in zip(group.columns, values.values(), strict=True):
            column.append(value)

    def take_all(self, t: Array, values: Mapping[str, Array]) -> None:
        """Add many samples of several sources at once. t : (n,) stamps [s]; values : source -> (n,)."""
        names = tuple(values)
        columns = [np.asarray(v, dtype=np.float64) for v in values.values()]
        believable = np.isfinite(t)
        for column, most in zip(columns, _limits(names), strict=True):
            believable &= np.abs(column) <= most  # also false for NaN
        self.absurd += int(np.sum(~believable))
        t = t[believable]
        columns = [c[believable] for c in columns]
        if not len(t):
            return
        group = self._groups.get(names)
        newest = np.maximum.accumulate(t)
        if group is not None:
            newest = np.maximum(newest, group.stamps[-1])
        in_order = t >= newest
        self.late += int(np.sum(~in_order))
        if not np.any(in_order):
            return
        if group is None:
            group = self._groups[names] = _Group([float(c[0]) for c in columns])
        group.stamps.frombytes(t[in_order].tobytes())
        for target, column in zip(group.columns, columns, strict=True):
            target.extend(column[in_order])

    def __contains__(self, source: object) -> bool:
        return any(source in names for names in self._groups)

    def series(self, source: str) -> tuple[Array, Array]:
        """Return time stamps [s] and values, (n,) each, of a source; both are empty if the log does not contain it."""
        found = [
            (group.times(), group.columns[names.index(source)].read())
            for names, group in self._groups.items()
            if source in names
        ]
        if len(found) == 1:
            return found[0]
        if not found:
            return np.empty(0), np.empty(0)
        t = np.concatenate([f[0] for f in found])
        order = np.argsort(t, kind="stable")
        return t[order], np.concatenate([f[1] for f in found])[order]

    def numbered(self, source: str) -> list[int]:
        """Return the numbers *n* of all sources named ``source.n``, in order."""
        prefix = source + "."
        every = {n for names in self._groups for n in names}
        return sorted(int(n.removeprefix(prefix)) for n in every if n.startswith(prefix))

    @property
    def span(self) -> tuple[float, float]:
        """First and last time stamp of the store [s]; (0, 0) if it has no samples."""
        ends = [(g.stamps[0], g.stamps[-1]) for g in self._groups.values()]
        return (min(a for a, _ in ends), max(b for _, b in ends)) if ends else (0.0, 0.0)

    def silences(self, longest: float) -> list[tuple[float, float]]:
        """Return the intervals (begin, end) [s], longer than *longest* [s], in which no source has a sample."""
        groups = [g.times() for g in self._groups.values()]
        if not groups:
            return []
        t = np.concatenate(groups)
        t.sort()
        at = np.flatnonzero(np.diff(t) > longest)
        return [(float(t[i]), float(t[i + 1])) for i in at]


def _limits(names: Iterable[str]) -> list[float]:
    return [LIMITS.get(name.rpartition(".")[2], LARGEST) for name in names]


@dataclass(frozen=True, slots=True)
class Heard:
    """One MAVLink message of a ground station's log: ``time`` [s since 1970], sender, fields by name."""

    time: float
    system: int
    component: int
    name: str
    message: Any


@dataclass(slots=True)
class Census:
    """Kinds of messages: number, and the first and last time of each [s, by any clock]."""

    seen: dict[str, list[float]] = field(default_factory=dict)

    def count(self, kind: str, t: float, how_many: int = 1, until: float | None = None) -> None:
        """Count *how_many* messages of a *kind* at time *t* [s], or from *t* to *until* [s]. An unknown time is not
        finite.
        """
        row = self.seen.setdefault(kind, [0, math.inf, -math.inf])
        row[0] += how_many
        if math.isfinite(t):
            row[1] = min(row[1], t)
            row[2] = max(row[2], t if until is None else until)

    def rate(self, kind: str) -> float:
        """Return the mean rate [Hz] of a *kind* of message; 0 if there are fewer than two messages."""
        count, first, last = self.seen.get(kind, [0, 0.0, 0.0])
        return (count - 1) / (last - first) if last > first else 0.0


@dataclass(frozen=True, slots=True)
class Recording:
    """A log as read.

    Attributes
    ----------
    form : text for the type of file.
    stores : one per boot of the vehicle, in order of time.
    meta : added to the metadata of every run: ``source messages damaged damaged_bytes truncated system``...
    notes : added to the doubts of every run.
    """

    form: str
    stores: list[SampleStore]
    meta: dict[str, Any]
    notes: list[Note]
    census: Census


LogReader: TypeAlias = Callable[[Path, int | None], Recording]
"""Function that returns the content of a log. Arguments: path, and system id of the vehicle. It raises ``BadFile`` or
``UsageError``.
"""
