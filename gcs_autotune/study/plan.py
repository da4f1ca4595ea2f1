"""Read a study file, and give its cases one by one.

A study varies named numbers and texts. A name is a path through the tables of the file, as ``vehicle.yaw.alpha``. The
first word states what the value changes; :data:`SUBJECTS` lists these words. Numbers are rounded to
:data:`DIGITS` significant digits, so that every computer gets the same case.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, overload

import msgspec
import numpy as np
from numpy.typing import NDArray

from gcs_autotune.documents import conformed, load_toml
from gcs_autotune.errors import BadFile
from gcs_autotune.kept_results import fingerprint
from gcs_autotune.registry import nearest_of
from gcs_autotune.slow_imports import scipy_stats
from gcs_autotune.study.jobs import FUNCTION, JOBS, WORDS, subjects_of

__all__ = ["MOST_CASES", "Axis", "Case", "Goal", "Plan", "ReportSpec", "load_plan"]

Value = float | str | bool
"""A value of a case: a number, a text, or true or false."""
DIGITS = 12
"""Significant digits of a number that is not listed in the file. Project choice."""
MOST_CASES = 10_000_000
"""Largest number of cases; their keys then need a gigabyte of memory. Project choice."""
MOST_SOBOL = 2**20
"""Largest number of points of a Sobol design, which is held in memory. Project choice."""
DESIGNS = ("grid", "random", "sobol")
_NEXT_REPEAT = MOST_CASES + 19
"""Distance of the seeds of two repeats of a drawn case, so that no two cases have the same seed. Project choice."""
_CHUNK = 1024
"""Points of a random design that are drawn together. Their number does not change the points. Project choice."""


class Goal(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """Condition on a result: its name, and the least and most values that meet the condition."""

    of: str
    least: float = -math.inf
    most: float = math.inf


class ReportSpec(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """What the report shows.

    ``success``: a result that is true or false, or a :class:`Goal`.
    ``map``: the two varied names of the success map.
    ``measure``: the number that ranks the cases. ``higher_is_better``: how.
    ``truth``, ``answer``: the varied name and the result that the confusion matrix compares.
    ``bound``: result that is an error -> result that is the Cramér-Rao bound of its standard deviation.
    """

    success: str | Goal = ""
    map: tuple[str, ...] = ()
    measure: str = ""
    higher_is_better: bool = False
    truth: str = ""
    answer: str = ""
    bound: dict[str, str] = {}


class _Range(msgspec.Struct, forbid_unknown_fields=True, frozen=True, rename={"start": "from", "end": "to"}):
    start: float
    end: float
    steps: Annotated[int, msgspec.Meta(ge=2, le=100_000)] | None = None
    scale: Literal["linear", "log"] = "linear"


class _File(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    title: str
    do: str
    fixed: dict[str, Any] = {}
    vary: dict[str, Any] = {}
    design: Literal["grid", "random", "sobol"] = "grid"
    cases: Annotated[int, msgspec.Meta(ge=1)] | None = None
    seed: Annotated[int, msgspec.Meta(ge=0, le=2**32 - 1)] = 1
    repeats: Annotated[int, msgspec.Meta(ge=1)] = 1
    keep: tuple[str, ...] = ()
    report: ReportSpec = ReportSpec()


@dataclass(frozen=True, slots=True)
class Axis:
    """A varied name: its ``values``, or a range from ``start`` to ``end`` when there are none."""

    values: tuple[Value, ...] = ()
    start: float = 0.0
    end: float = 0.0
    logarithmic: bool = False

    def at(self, u: float) -> Value:
        """Return the value at the fraction *u* (0 to 1) of the axis."""
        if self.values:
            return self.values[min(int(u * len(self.values)), len(self.values) - 1)]
        if self.logarithmic:
            return _rounded(math.exp(math.log(self.start) + u * (math.log(self.end) - math.log(self.start))))
        return _rounded(self.start + u * (self.end - self.start))


@dataclass(frozen=True, slots=True)
class Case:
    """One case: its position in the study, and every fixed and varied value by name."""

    index: int
    given: Mapping[str, Value]

    def point(self, do: str) -> str:
        """Return the hash of the values and of what is done with them, whatever the version of the code."""
        plain = {n: v if isinstance(v, bool | str) else float(v) for n, v in sorted(self.given.items())}
        return fingerprint("case 1", do, plain)


@dataclass(frozen=True)
class Plan(Sequence[Case]):
    """A study: a sequence of cases that are computed when they are needed.

    file : the study file. home : the folder that paths and functions in it refer to. do : what is done with a case.
    points : number of cases without repeats. keep : patterns of the results to store.
    """

    file: Path
    home: Path
    title: str
    do: str
    design: str
    points: int
    seed: int
    repeats: int
    fixed: Mapping[str, Value]
    vary: Mapping[str, Axis]
    keep: tuple[str, ...] = ()
    report: ReportSpec = field(default_factory=ReportSpec)

    def __len__(self) -> int:
        return self.points * self.repeats

    @overload
    def __getitem__(self, index: int) -> Case: ...
    @overload
    def __getitem__(self, index: slice) -> list[Case]: ...
    def __getitem__(self, index: int | slice) -> Case | list[Case]:
        """Return case number *index*. The repeats, with further seeds, follow after all points.

        In a drawn design each case has a seed of its own. So two cases differ, even if the same values are drawn.
        """
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        if not 0 <= index < len(self):
            raise IndexError(index)
        repeat, at = divmod(index, self.points)
        varied = self._grid(at) if self.design == "grid" else self._drawn(at)
        own = repeat if self.design == "grid" else at + _NEXT_REPEAT * repeat
        seed = {} if "seed" in self.fixed or "seed" in self.vary else {"seed": (self.seed + own) % 2**32}
        return Case(index, {**self.fixed, **seed, **varied})

    def __iter__(self) -> Iterator[Case]:
        return (self[i] for i in range(len(self)))

    @property
    def settings(self) -> dict[str, Any]:
        """Everything that a stored result of this study depends on, by name. More cases or repeats do not change it."""
        fixed = {f"fixed.{name}": value for name, value in self.fixed.items()}
        vary = {f"vary.{name}": [list(a.values), a.start, a.end, a.logarithmic] for name, a in self.vary.items()}
        return {"do": self.do, "design": self.design, "seed": self.seed, "keep": list(self.keep), **fixed, **vary}

    def _grid(self, at: int) -> dict[str, Value]:
        found: dict[str, Value] = {}
        for name, axis in reversed(list(self.vary.items())):
            at, k = divmod(at, len(axis.values))
            found[name] = axis.values[k]
        return {name: found[name] for name in self.vary}

    def _drawn(self, at: int) -> dict[str, Value]:
        if self.design == "sobol":
            row = self._sobol[at]
        else:
            row = _random(self.seed, at // _CHUNK, len(self.vary))[at % _CHUNK]
        return {name: axis.at(float(u)) for (name, axis), u in zip(self.vary.items(), row, strict=True)}

    @cached_property
    def _sobol(self) -> NDArray[np.float64]:
        """Points of the scrambled Sobol sequence (n, axes); n is the next power of two, as its balance needs."""
        engine = scipy_stats().qmc.Sobol(len(self.vary), scramble=True, seed=self.seed)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            points: NDArray[np.float64] = engine.random_base2(max(0, math.ceil(math.log2(self.points))))
        return points


@lru_cache(maxsize=4)
def _random(seed: int, chunk: int, axes: int) -> NDArray[np.float64]:
    return np.random.default_rng([seed, chunk]).random((_CHUNK, axes))


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def load_plan(file: Path, home: Path | None = None) -> Plan:
    """Return the study in *file* (TOML). *home* : the folder that it refers to, if it is a copy.

    Raises
    ------
    BadFile
        The file cannot be read, or an entry is unknown, empty or out of range. The message names file and entry.
    """
    data = conformed(load_toml(file, "a study"), _File, file)
    _verify_job(file, data.do)
    fixed = {name: _single(file, f"fixed.{name}", value) for name, value in _flat(file, "fixed", data.fixed, data.do)}
    vary = {
        name: _axis(file, f"vary.{name}", value, data.design) for name, value in _flat(file, "vary", data.vary, data.do)
    }
    if twice := sorted(set(fixed) & set(vary)):
        raise BadFile(f"{file}: {twice[0]} is both fixed and varied. Remove one of the two")
    for name in data.report.map:
        if name not in vary:
            raise BadFile(f"{file}: report.map: '{name}' is not varied.{nearest_of(name, list(vary))[1]}")
    if data.report.map and len(data.report.map) != 2:
        raise BadFile(f"{file}: report.map needs the names of two varied numbers")
    if data.report.truth and data.report.truth not in (*vary, *fixed):
        raise BadFile(f"{file}: report.truth: '{data.report.truth}' is not varied.")
    points = _points(file, data, vary)
    if points * data.repeats > MOST_CASES:
        raise BadFile(
            f"{file}: vary: {points * data.repeats} cases are too many (most {MOST_CASES}). Use fewer values, or "
            'design = "sobol" with cases = N'
        )
    home = home or file.absolute().parent
    what = (file, home, data.title, data.do, data.design, points, data.seed, data.repeats)
    return Plan(*what, fixed, vary, data.keep, data.report)


def _points(file: Path, data: _File, vary: Mapping[str, Axis]) -> int:
    if data.design == "grid":
        if data.cases is not None:
            raise BadFile(f"{file}: cases: a grid has as many cases as its values give. Remove it")
        return math.prod(len(axis.values) for axis in vary.values())
    if data.cases is None:
        raise BadFile(f'{file}: cases is missing. design = "{data.design}" needs it, e.g. cases = 200')
    if not vary:
        raise BadFile(f'{file}: vary is empty. design = "{data.design}" needs at least one entry there')
    if data.design == "sobol" and data.cases > MOST_SOBOL:
        raise BadFile(f'{file}: cases: a Sobol design has at most {MOST_SOBOL} points. Use design = "random"')
    return data.cases


def _verify_job(file: Path, do: str) -> None:
    if do not in JOBS and not FUNCTION.fullmatch(do):
        hint = nearest_of(do, list(JOBS))[1]
        raise BadFile(f"{file}: do: '{do}' is not {', '.join(JOBS)} or a function MODULE:FUNCTION.{hint}")


def _flat(file: Path, table: str, tables: Mapping[str, Any], do: str) -> list[tuple[str, Any]]:
    """Return (name, value) of all entries; names are joined by dots. A table with ``from`` is a range."""
    known = subjects_of(do)
    found = []
    for first, value in tables.items():
        if first not in known:
            hint = nearest_of(first, list(known))[1]
            raise BadFile(f"{file}: {table}.{first}: unknown entry.{hint} Known: {', '.join(known)}.")
        found += list(_walk(file, f"{table}.{first}", first, value))
    return found


def _walk(file: Path, place: str, name: str, value: Any) -> Iterator[tuple[str, Any]]:
    if not isinstance(value, dict) or "from" in value or "to" in value:
        if name.count(".") not in WORDS[name.partition(".")[0]]:
            raise BadFile(f"{file}: {place}: no value belongs here. Write e.g. vehicle.yaw.alpha, fly.throttle")
        yield name, value
    elif not value:
        raise BadFile(f"{file}: {place}: the table is empty. Remove it")
    else:
        for own, inner in value.items():
            yield from _walk(file, f"{place}.{own}", f"{name}.{own}", inner)


def _single(file: Path, place: str, value: Any) -> Value:
    if place.endswith(".seed") and place.count(".") == 1 and (isinstance(value, bool) or not isinstance(value, int)):
        raise BadFile(f"{file}: {place}: expected a whole number, not {value!r}")
    if isinstance(value, bool | str | int | float):
        return value
    raise BadFile(f"{file}: {place}: expected a number, a text, true or false. Lists and ranges belong under vary")


def _axis(file: Path, place: str, value: Any, design: str) -> Axis:
    if isinstance(value, list):
        if not value:
            raise BadFile(f"{file}: {place}: the list is empty. Give at least one value")
        values = tuple(_single(file, place, each) for each in value)
        if len(set(map(repr, values))) < len(values):
            raise BadFile(f"{file}: {place}: a value appears twice. Use repeats = N for the same case with other seeds")
        return Axis(values)
    if not isinstance(value, dict):
        raise BadFile(
            f"{file}: {place}: expected a list or a range {{ from = A, to = B }}. One value belongs under fixed"
        )
    span = conformed(value, _Range, f"{file}: {place}")
    if not span.start < span.end:
        raise BadFile(f"{file}: {place}: the range from {span.start:g} to {span.end:g} is empty. from must be below to")
    if span.scale == "log" and span.start <= 0.0:
        raise BadFile(f"{file}: {place}: a logarithmic range must begin above 0")
    axis = Axis((), span.start, span.end, span.scale == "log")
    if span.steps is not None:
        return Axis(tuple(axis.at(k / (span.steps - 1)) for k in range(span.steps)))
    if design == "grid":
        raise BadFile(f"{file}: {place}: a grid needs the number of values. Add steps = N to the range")
    return axis
