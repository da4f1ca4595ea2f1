"""Test whether a table of identified parameters, one row per experiment, describes one craft.

A craft has one inertia and one drag law, whatever was commanded. If rows contradict each other, the pattern indicates
the kind of cause. Equal deviations of inertia and drag indicate a thrust other than stated, because both are force over
motion. Inertia alone indicates another load or a slow actuator. Drag alone indicates another drag law.

All tests use logarithms, so that differences are relative. Rows at one input are a group. A difference that the scatter
may hide is reported as "cannot tell".
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.csv_table import cells_of, numbers_of
from gcs_autotune.errors import BadFile, NotInformative
from gcs_autotune.notebook import Displayed
from gcs_autotune.slow_imports import scipy_stats

__all__ = [
    "ParameterTable",
    "TableFinding",
    "diagnose_table",
    "is_parameter_table",
    "read_parameter_table",
    "reading_of_level",
    "reading_of_order",
    "reading_of_sign",
    "reading_of_trend",
]

ALIKE = 0.5
"""Ratio of the smaller to the larger deviation above which two deviations of equal sign count as equal."""


def reading_of_level(shares: Mapping[str, float], answers: Mapping[str, str], *, smallest: bool) -> str:
    """Return the interpretation of deviations of inertia and drag at one input level.

    shares : relative deviation of each quantity.
    """
    off = [n for n, a in answers.items() if a == "yes"]
    if not off:
        hidden = [n for n, a in answers.items() if a == "cannot tell"]
        return f"the scatter of {' and '.join(hidden)} hides a difference of this size" if hidden else ""
    both = [shares["inertia"], shares["drag"]]
    if min(both) * max(both) > 0.0 and min(map(abs, both)) >= ALIKE * max(map(abs, both)):
        if both[0] > 0.0:
            lost = 1.0 - 1.0 / (1.0 + sum(both) / 2.0)
            cause = "dead zone or static friction" if smallest else "saturation, sagging voltage, a stalled propeller"
            return f"inertia and drag deviate equally: {100 * lost:.0f} % of the stated thrust is missing ({cause})"
        return "inertia and drag deviate equally: the thrust is larger than stated (wrong calibration of this level)"
    if off == ["inertia"]:
        return (
            "only inertia deviates: another load or trapped water in these runs, or a rate limit of the actuator. A "
            "thrust error would change the drag equally"
        )
    if off == ["drag"]:
        more = shares["drag"] > 0.0
        if smallest and more:
            return "only drag deviates: there is linear drag or friction that the quadratic law does not include"
        return "only drag deviates: the drag law is different from the assumed one, or the water moved in these runs"
    return "inertia and drag deviate in different ways, so no single known cause explains both"


def reading_of_sign(shares: Mapping[str, float], answers: Mapping[str, str]) -> str:
    """Return the interpretation of a dependence on the input's sign."""
    off = [n for n, a in answers.items() if a == "yes"]
    if not off:
        return "no significant asymmetry in these pairs"
    both = [shares["inertia"], shares["drag"]]
    if len(off) == 2 and both[0] * both[1] > 0.0:
        return "inertia and drag deviate equally: the actuator pushes less one way (asymmetric thrust)"
    if off == ["drag"]:
        return "only drag deviates: there is a steady moment (trim, tether, current), or the hull is not symmetric"
    return (
        "only inertia deviates, which asymmetric thrust does not cause: check the evaluation of the transient, "
        "or a steady moment"
    )


def reading_of_order(order: float, half: float) -> str:
    """Return the interpretation of the exponent of rate in the drag force."""
    prefix = f"drag force is proportional to the rate to the power {order:.2f} +- {half:.2f}: "
    if abs(order - 2.0) <= half and abs(order - 1.0) <= half:
        return prefix + "linear or quadratic drag, which these rows do not distinguish"
    if abs(order - 2.0) <= half:
        return prefix + "quadratic drag"
    if abs(order - 1.0) <= half:
        return prefix + "linear drag"
    if 1.0 < order < 2.0:
        return (
            prefix + "a mixture of linear and quadratic drag, so the coefficient of either alone varies with the input"
        )
    return prefix + "neither linear nor quadratic drag"


def reading_of_trend(slopes: Mapping[str, float], answers: Mapping[str, str]) -> str:
    """Return the interpretation of a dependence of inertia or drag on the size of the input."""
    off = [n for n, a in answers.items() if a == "yes"]
    if not off:
        return "no significant trend over these levels"
    if len(off) == 2 and slopes["inertia"] * slopes["drag"] > 0.0:
        if slopes["drag"] < 0.0:
            return (
                "inertia and drag fall as the input grows: part of small commands has no effect (dead zone, "
                "static friction)"
            )
        return (
            "inertia and drag rise as the input grows: the thrust grows less than the command (saturation, "
            "non-linear thrust)"
        )
    if "drag" in off and slopes["drag"] < 0.0:
        finding = (
            "quadratic drag falls as the input grows: there is linear drag or friction that its law does not include"
        )
        return (
            finding
            if off == ["drag"]
            else finding + ". Inertia rises: there is a delay or lag that the fit does not include"
        )
    if "drag" in off:
        return (
            "drag rises as the input grows: its law is steeper than assumed, or the thrust grows less than the command"
        )
    if slopes["inertia"] > 0.0:
        return "inertia rises as the input grows: the actuator needs longer for larger reversals (rate limit)"
    return "inertia falls as the input grows: part of small commands has no effect, or a wrong drag law affects the fit"


Array = NDArray[np.float64]

Answer = Literal["yes", "no", "cannot tell"]

LEAST = 4
"""Minimum number of rows of a table."""

SURE = 0.01
"""False-alarm probability of one question, over all its levels (or rows)."""

POOLED = 0.25
"""p-value above which levels count as not differing more than their rows do (Bancroft1964, sometimes-pooling)."""

MATTERS = 0.1
"""Relative difference that does not matter; a quantity that cannot differ by more is reported as "no"."""


@dataclass(frozen=True, slots=True, eq=False)
class ParameterTable(Displayed):
    """Identified parameters, one row per experiment.

    level : (n,) input, with its sign if it has one. inertia, drag : (n,) in any unit; ``drag`` is that of the assumed
    law (usually quadratic). rate : (n,) a typical rate of turn or speed. linear_drag : (n,) the equivalent linear drag
    at that rate; both serve to find the order of the drag law.
    """

    name: str
    level: Array
    inertia: Array
    drag: Array
    linear_drag: Array | None = None
    rate: Array | None = None

    @property
    def quantities(self) -> Mapping[str, Array]:
        """The quantities that should be constant."""
        return {"inertia": self.inertia, "drag": self.drag}


@dataclass(frozen=True, slots=True)
class TableFinding(Displayed):
    """The answer to one question about a table.

    ``share``: relative difference of the quantity there from elsewhere (0.2: 20 %); for ``drag-order`` the exponent of
    rate in the drag force. ``ci95``: its interval. ``p``: probability of such a difference by scatter alone (over all
    levels tried).
    """

    question: str
    quantity: str
    where: str
    answer: Answer
    share: float
    ci95: tuple[float, float]
    p: float
    reading: str = ""


_COLUMNS = ("level", "inertia", "drag")
_MORE = ("linear_drag", "rate")
_HEAD = 4096
"""Bytes that contain the heads of a table. Project choice."""


def _names(heads: list[str]) -> list[str]:
    return [head.partition("[")[0].strip() for head in heads]


def is_parameter_table(path: Path) -> bool:
    """Return whether *path* is a CSV file whose columns are parameters (``level``, ``inertia``, ``drag``), not time."""
    if path.suffix.lower() != ".csv" or not path.is_file():
        return False
    with path.open("rb") as stream:  # a long run is not read twice
        if b"inertia" not in stream.read(_HEAD):
            return False
    try:
        return set(_COLUMNS) <= set(_names(list(cells_of(path).head)))
    except BadFile:
        return False


def read_parameter_table(path: Path) -> ParameterTable:
    """Return the table in a CSV file with ``level``, ``inertia``, ``drag``, and ``linear_drag`` and ``rate`` if known.

    Units do not matter, because only ratios are tested.

    Raises
    ------
    BadFile
        The file is not such a table, or a cell is not a number.
    """
    cells = cells_of(path, ",".join(_COLUMNS))
    heads, table = _names(list(cells.head)), numbers_of(cells)
    if table.dropped or not np.all(np.isfinite(table.values)):
        raise BadFile(f"{path}: a row is incomplete, or a cell is not a number. Correct or remove it")
    columns = {heads[i]: table.values[:, k] for k, i in enumerate(table.columns)}
    lacking = [name for name in _COLUMNS if name not in columns]
    if lacking:
        raise BadFile(f"{path} lacks the column {lacking[0]}. It needs {', '.join(_COLUMNS)}")
    linear_drag, rate = (columns.get(name) for name in _MORE)
    for name, values in ((_MORE[0], linear_drag), (_MORE[1], rate)):
        if values is not None and not np.all(values > 0.0):
            raise BadFile(f"{path}: {name} must be positive in every row. Correct or remove that column")
    level, inertia, drag = (columns[name] for name in _COLUMNS)
    return ParameterTable(path.stem, level, inertia, drag, linear_drag, rate)


def diagnose_table(table: ParameterTable) -> tuple[TableFinding, ...]:
    """Test whether the rows of a table describe one craft.

    The questions are each level, the smallest input, the sign, single rows, and the drag law.

    Raises
    ------
    NotInformative
        Fewer than four rows, or values that are not positive.
    """
    if len(table.level) < LEAST:
        raise NotInformative(
            f"table '{table.name}' has {len(table.level)} rows, but a check for contradictions needs at least {LEAST}"
        )
    bad = [n for n, v in table.quantities.items() if not np.all(v > 0.0)]
    if bad:
        raise NotInformative(f"{' and '.join(bad)} of table '{table.name}' must be positive in every row")
    return (*_levels(table), *_sign(table), *_rows(table), *_order(table))


def _levels(table: ParameterTable) -> Iterator[TableFinding]:
    """Yield the deviation of every input level from the others, the smallest level first.

    Levels that deviate are excluded from the mean of the others.
    """
    size = np.abs(table.level)
    levels = np.unique(size).tolist()
    if len(levels) < 3:
        return
    departing = {n: _departing(np.log(v), size) for n, v in table.quantities.items()}
    for level in levels:
        smallest = level == levels[0]
        tried = 1 if smallest else len(levels) - 1
        deviations = {}
        for name, values in table.quantities.items():
            use = np.array([s == level or s not in departing[name] for s in size])
            off, half, p = _apart(np.log(values)[use], size[use], level)
            p = min(1.0, p * tried)
            deviations[name] = (off, half, p, _answer(off, half, p))
        reading = reading_of_level(
            {n: math.expm1(f[0]) for n, f in deviations.items()},
            {n: f[3] for n, f in deviations.items()},
            smallest=smallest,
        )
        for name, (off, half, p, answer) in deviations.items():
            question = "smallest-input" if smallest else "level"
            yield _finding(question, name, f"|input| = {level:.4g}", answer, off, half, p, reading)
    kept = {n: np.array([s not in departing[n] for s in size]) for n in departing}
    yield from _trend(table, kept)


def _departing(y: Array, size: Array) -> set[float]:
    """Return the levels that deviate from all others, the most significant first.

    Each is judged without the levels before it.
    """
    departing: set[float] = set()
    tried = len(np.unique(size))
    while len(np.unique(size)) > 3:
        levels = np.unique(size).tolist()
        chances = {level: _apart(y, size, level)[2] * tried for level in levels}
        clearest = min(chances, key=lambda level: chances[level])
        if chances[clearest] >= SURE:
            break
        departing.add(clearest)
        y, size = y[size != clearest], size[size != clearest]
    return departing


def _trend(table: ParameterTable, kept: Mapping[str, NDArray[np.bool_]]) -> Iterator[TableFinding]:
    """Yield the trend of the level means: their relative change if the input doubles."""
    size = np.abs(table.level)
    trends = {}
    for name, values in table.quantities.items():
        levels = np.unique(size[kept[name]])
        if len(levels) < LEAST:
            return
        means = np.array([np.log(values)[size == s].mean() for s in levels])
        fit = scipy_stats().linregress(np.log2(levels), means)
        half = float(scipy_stats().t.isf(0.025, len(levels) - 2)) * float(fit.stderr)
        trends[name] = (float(fit.slope), half, float(fit.pvalue), _answer(float(fit.slope), half, float(fit.pvalue)))
    reading = reading_of_trend({n: f[0] for n, f in trends.items()}, {n: f[3] for n, f in trends.items()})
    for name, (off, half, p, answer) in trends.items():
        yield _finding("trend", name, "per doubling of the input", answer, off, half, p, reading)


def _apart(y: Array, size: Array, level: float) -> tuple[float, float, float]:
    """Return the deviation of one level's mean from the others' mean, half its 95 % interval, and its p-value.

    The variance has two parts: that of rows about their level's mean, and that of the other levels about their mean.
    """
    others = [y[size == s] for s in np.unique(size) if s != level]
    own = y[size == level]
    groups = [own, *others]
    freedom = sum(len(g) - 1 for g in groups)
    means = np.array([g.mean() for g in others])
    between = float(np.var(means, ddof=1)) if len(means) > 1 else 0.0
    if freedom > 0:
        within = sum(float(np.sum((g - g.mean()) ** 2)) for g in groups) / freedom
        expected = within * float(np.mean([1.0 / len(g) for g in others]))
        ratio = between / expected if expected > 0.0 else math.inf
        differ = len(others) > 1 and float(scipy_stats().f.sf(ratio, len(others) - 1, freedom)) < POOLED
        between = between - expected if differ else 0.0
        weights = np.array([1.0 / (between + within / len(g)) if between + within > 0.0 else 1.0 for g in others])
        variance = between + within / len(own) + 1.0 / float(weights.sum())
        freedom = freedom if between == 0.0 else min(freedom, len(others) - 1)
    else:
        weights, freedom = np.ones(len(others)), len(others) - 1
        variance = between * (1.0 + 1.0 / len(others))
    off = float(own.mean() - weights @ means / weights.sum())
    return off, *_t(off, variance, freedom)


def _t(off: float, variance: float, freedom: int) -> tuple[float, float]:
    """Return half the 95 % interval of a mean, and the p-value of a mean of zero."""
    if freedom < 1 or variance <= 0.0:
        return math.inf, 1.0
    s = math.sqrt(variance)
    return float(scipy_stats().t.isf(0.025, freedom)) * s, float(2.0 * scipy_stats().t.sf(abs(off) / s, freedom))


def _answer(off: float, half: float, p: float) -> Answer:
    if p < SURE:
        return "yes"
    return "no" if abs(off) + half < MATTERS else "cannot tell"


def _finding(
    question: str, quantity: str, where: str, answer: Answer, off: float, half: float, p: float, reading: str
) -> TableFinding:
    ends = (math.expm1(off - half), math.expm1(min(off + half, 700.0)))
    return TableFinding(question, quantity, where, answer, math.expm1(off), ends, p, reading)


def _sign(table: ParameterTable) -> Iterator[TableFinding]:
    """Yield the difference between positive and negative inputs of the same size."""
    size = np.abs(table.level)
    both = [s for s in np.unique(size) if np.any(table.level == s) and np.any(table.level == -s) and s > 0.0]
    if len(both) < 3:
        return
    differences = {}
    for name, values in table.quantities.items():
        y = np.log(values)
        off = np.array([y[table.level == s].mean() - y[table.level == -s].mean() for s in both])
        mean = float(off.mean())
        half, p = _t(mean, float(np.var(off, ddof=1)) / len(off), len(off) - 1)
        differences[name] = (mean, half, p, _answer(mean, half, p))
    reading = reading_of_sign(
        {n: math.expm1(f[0]) for n, f in differences.items()}, {n: f[3] for n, f in differences.items()}
    )
    for name, (mean, half, p, answer) in differences.items():
        yield _finding(
            "sign", name, f"{len(both)} pairs of positive and negative inputs", answer, mean, half, p, reading
        )


def _rows(table: ParameterTable) -> Iterator[TableFinding]:
    """Yield rows that contradict all others of their level (deleted studentised residuals)."""
    size = np.abs(table.level)
    for name, values in table.quantities.items():
        y = np.log(values)
        residual = y - np.array([np.mean(y[size == s]) for s in size])
        counts = np.array([np.sum(size == s) for s in size])
        share = 1.0 - 1.0 / counts
        freedom = int(len(y) - len(np.unique(size)))
        for i in np.flatnonzero(counts > 2):
            rest = (float(residual @ residual) - residual[i] ** 2 / share[i]) / max(freedom - 1, 1)
            half, p = _t(float(residual[i] / share[i]), max(rest, 1e-300) / float(share[i]), freedom - 1)
            p = min(1.0, p * len(y))
            if p < SURE:
                where = f"row {i + 1} (input {table.level[i]:.4g})"
                off = float(residual[i] / share[i])
                reading = "this row contradicts the other rows at its input. Repeat that experiment"
                yield _finding("row", name, where, "yes", off, half, p, reading)


def _order(table: ParameterTable) -> Iterator[TableFinding]:
    """Yield the exponent of rate in the drag force: 1 plus that of the equivalent linear drag."""
    if table.rate is None or table.linear_drag is None or np.ptp(np.log(table.rate)) < math.log(1.3):
        return
    fit = scipy_stats().linregress(np.log(table.rate), np.log(table.linear_drag))
    groups = len(np.unique(np.abs(table.level)))
    half = float(scipy_stats().t.isf(0.025, max(groups - 2, 1))) * float(fit.stderr)
    order = 1.0 + float(fit.slope)
    either = [law for law in (1.0, 2.0) if abs(order - law) <= half]
    answer: Answer = "cannot tell" if len(either) == 2 else ("no" if either == [2.0] else "yes")
    yield TableFinding(
        "drag-order",
        "linear drag",
        f"{len(table.level)} rows",
        answer,
        order,
        (order - half, order + half),
        float(fit.pvalue),
        reading_of_order(order, half),
    )
