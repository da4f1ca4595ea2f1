"""Compare a position with the integral of its rate: their ratio, their time shift, and whether they agree at all.

The slopes of both are compared over windows as short as the noise permits (:mod:`.windows`). The noisier side is
regressed on the quieter one, so that noise does not reduce the ratio. A constant offset of the rate (the bias of a
gyro) is part of the regression. The prior of the offset is its usual size. A ratio can then still be calculated for a
craft in a steady turn, but not for a craft at rest.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.crosscheck.windows import Series, Windows, gaps_of, windows_on
from gcs_autotune.notebook import Displayed

__all__ = ["Comparison", "Expected", "compare"]

Array = NDArray[np.float64]

Kind = Literal["agrees", "factor", "sign", "shift", "still-position", "still-rate", "unrelated", "unclear"]

CLEAR = 8.0
"""Ratio of slopes to their noise above which a side of the comparison counts as precise. Project choice."""
LEAST_CLEAR = 5.0
"""Ratio of slopes to their noise, on both sides, below which there is too little motion for a comparison.

Project choice.
"""
FEWEST = 8
"""Minimum number of windows of a comparison. Project choice."""
SHORTEST = 0.5
"""Shortest window [s]. Project choice: time shifts between sensors of one craft are usually shorter."""
SURE = 4.0
"""Number of standard errors by which a ratio or a shift must differ to count. Project choice."""
ALIKE, APART = 0.75, 0.5
"""Coherence above which two motions are equal up to a ratio (ALIKE), and below which they differ (APART).

Project choice.
"""
STILL = 0.3
"""Motion, relative to that of the other side, below which a side of the comparison counts as constant.

Project choice.
"""
LONGEST_SHIFT = 5.0
"""Longest time shift [s] that is tried. Project choice."""
TURNED_ROUND, LATER = 0.5, 0.04
"""Penalties for a time shift, because half a period of an oscillation and a change of sign look alike. Project choice.

- ``TURNED_ROUND``: shift [s] to which a change of sign is equivalent.
- ``LATER``: reduction of the coherence per second of shift.
"""
SPREAD = 0.15
"""Relative standard error of the ratio up to which a longer window may contradict a shorter one. Project choice."""
BETTER = 0.6
"""Unexplained variance with a time shift, relative to that without the shift, below which the shift counts.

Project choice.
"""


PART, STANDING = 8.0, 0.2
"""Limits for a stretch of a run in which one side does not change. Project choice.

- ``PART`` [s]: least duration of the stretch.
- ``STANDING``: largest motion of that side, relative to the other side.
"""
JUMP = 3
"""Number of windows that contain the jump of a column after a constant stretch. Project choice."""
LARGE, MANY = 4.0, 20
"""Limits for a contradiction between two different motions. Project choice.

- ``LARGE``: least motion, as a multiple of the usual least motion.
- ``MANY``: least number of windows.
"""


@dataclass(frozen=True, slots=True)
class Expected:
    """Differences that are normal for good sensors of a pair.

    offset : standard deviation of a constant offset of the rate [unit of the rate].
    floor : least motion for a comparison, as the rms of the rate.
    way : least total distance of the position, in its unit. In one short turn a filter looks like a contradiction.
    shift : time [s] by which one sensor may be later than the other.
    tolerance : deviation of the ratio from 1 that filters and scales may cause. Default 0.12 (0.88 to 1.12), a project
        choice.
    """

    offset: float
    floor: float
    way: float
    shift: float = 0.4
    tolerance: float = 0.12


@dataclass(frozen=True, slots=True)
class Comparison(Displayed):
    """Result of the comparison of a position with its rate.

    factor, std : ratio of the position's change to the integral of the rate, and its standard error.
    shift, shift_std : time [s] by which the position is later than the rate, and its standard error.
    coherence : coherence of the two at that shift, -1 to 1.
    moved, predicted : rms slope of the position, and of the rate's integral.
    clear : rms slope of the quieter side, in standard deviations of its noise.
    during : stretch [s] in which one side does not change while the rest of the run agrees. None for the whole run.
    """

    kind: Kind
    factor: float
    std: float
    shift: float
    shift_std: float
    coherence: float
    moved: float
    predicted: float
    clear: float
    during: tuple[float, float] | None = None


def compare(position: Series, rate: Series, total: Array, expected: Expected) -> Comparison | None:
    """Return the comparison of *position* with *total*, the integral of *rate*, or None if there is too little motion.

    *total* (n,) is known at the stamps of *rate*. A filter removes fast motion from one side. A contradiction over
    short windows must therefore also occur over longer ones, if the motion is clear there.
    """
    most = min(LONGEST_SHIFT, 0.1 * _common(position, rate))
    first: Comparison | None = None
    strange: list[Comparison] = []
    for k, windows in enumerate(_windows(position, rate, total, most)):
        comparison = _compared(windows, position, rate, total, expected, most)
        if comparison is None:
            continue
        if k == 0:
            part = _still_part(windows, position, rate, total, expected, comparison)
            if part is not None:
                return part
        if comparison.kind == "unclear":
            if _is_strange(windows, position, rate, expected, comparison):
                strange.append(comparison)
            continue
        if first is None:
            first = comparison
            if first.kind in ("agrees", "shift"):
                return first
        elif first.kind == "unrelated" and comparison.kind in ("factor", "sign"):
            first = comparison
        elif (
            comparison.kind == "agrees"
            and comparison.coherence > ALIKE
            and comparison.std < SPREAD * abs(comparison.factor)
        ):
            return comparison
    if first is None and len(strange) >= 2:
        return replace(strange[0], kind="unrelated", factor=math.nan, std=math.nan)
    return first


def _is_strange(windows: Windows, position: Series, rate: Series, expected: Expected, comparison: Comparison) -> bool:
    """Return whether both sides move, each well above its noise, and have little in common."""
    noise = _noises(windows, position, rate)
    moves = comparison.moved > CLEAR * noise[0] and comparison.predicted > CLEAR * noise[1]
    large = min(comparison.moved, comparison.predicted) > LARGE * expected.floor
    return moves and large and len(windows) >= MANY and abs(comparison.coherence) < APART and comparison.std > SPREAD


def _still_part(
    windows: Windows, position: Series, rate: Series, total: Array, expected: Expected, whole: Comparison
) -> Comparison | None:
    """Return a comparison if one side does not change in a part of the run, while the rest of the run agrees."""
    sides = windows.slopes(position.x), _predicted(windows, position, rate, total, 0.0)
    noises = _noises(windows, position, rate)
    hop = windows.span / windows.overlap
    count = max(math.ceil(PART / hop), FEWEST)
    if len(windows) < 3 * count:
        return None
    last = len(windows) - count
    blocks = [slice(k, k + count) for k in (*range(0, last, max(count // 4, 1)), last)]
    middle = windows.middle
    for kind, a, b, noise in (
        ("still-rate", *sides, noises[0]),
        ("still-position", sides[1], sides[0], noises[1]),
    ):
        still = np.zeros(len(windows), dtype=bool)
        for block in blocks:
            if middle[block][-1] - middle[block][0] < 2.0 * count * hop and _stands(
                a[block], b[block], noise, hop, expected
            ):
                still[block] = True
        reach = 2 * (JUMP + count // 4) + 1
        near = np.convolve(still, np.ones(reach), mode="same") > 0.5  # a dead column comes back with a jump
        rest = ~near
        if not still.any() or rest.sum() < count:
            continue
        slope, std, _ = _regression(a[rest], b[rest], windows.overlap, expected.offset, noise)
        if abs(slope - 1.0) > 2.0 * expected.tolerance + SURE * min(std, 0.03) or _cosine(a[rest], b[rest]) < ALIKE:
            continue
        edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
        k = int(np.argmax(edges[1::2] - edges[::2]))
        start, end = int(edges[2 * k]), int(edges[2 * k + 1]) - 1
        during = (
            float(middle[start] if start else position.t[0]),
            float(middle[end] if end < len(windows) - 1 else position.t[-1]),
        )
        found: Kind = "still-rate" if kind == "still-rate" else "still-position"
        return replace(whole, kind=found, factor=math.nan, std=math.nan, during=during)
    return None


def _stands(a: Array, b: Array, noise: float, hop: float, expected: Expected) -> bool:
    """Return whether *b* is constant, or about zero, over windows in which *a* moves far.

    noise : that of *a*.
    """
    keep = np.sort(np.argsort(np.abs(a))[:-JUMP])
    a, b = a[keep], b[keep]
    (centred, quiet), size = (v - float(np.mean(v)) for v in (a, b)), _rms(a)
    if float(np.sum(np.abs(a))) * hop < expected.way or size < max(CLEAR * noise, LARGE * expected.floor):
        return False
    varies = _rms(centred) > max(CLEAR * noise, LARGE * expected.floor)
    return (_rms(b) < STANDING * size) or (varies and _rms(quiet) < STANDING * _rms(centred))


def _compared(
    windows: Windows, position: Series, rate: Series, total: Array, expected: Expected, most: float
) -> Comparison | None:
    x = windows.slopes(position.x)
    least, (of_position, of_rate) = 0.02 * expected.floor, _noises(windows, position, rate)
    noise = max(of_position, least), max(of_rate, least)
    predicted = _predicted(windows, position, rate, total, 0.0)
    if max(_rms(x), _rms(predicted)) < expected.floor:
        return None
    hop = windows.span / windows.overlap
    if max(float(np.sum(np.abs(s))) for s in (x, predicted)) * hop < expected.way:
        return None
    sizes = [
        _rms(s - min(max(float(np.mean(s)), -2.0 * expected.offset), 2.0 * expected.offset)) for s in (x, predicted)
    ]
    position_leads = sizes[0] / noise[0] >= sizes[1] / noise[1]
    if max(sizes[0] / noise[0], sizes[1] / noise[1]) < LEAST_CLEAR:
        return None
    best = _best_shift(windows, position, rate, total, x, most)
    beats = 0.5 * (position.beat + rate.beat)
    return _judge(windows, x, best, noise, expected, position_leads=position_leads, beats=beats)


def _common(position: Series, rate: Series) -> float:
    return float(min(position.t[-1], rate.t[-1]) - max(position.t[0], rate.t[0]))


def _windows(position: Series, rate: Series, total: Array, margin: float) -> Iterator[Windows]:
    """Yield windows of increasing length, starting with the shortest over which one side is clear of its noise.

    If there is none, the windows with the clearest motion are yielded.
    """
    start = max(position.t[0], rate.t[0] + margin)
    end = min(position.t[-1], rate.t[-1] - margin)
    span = max(SHORTEST, 4.0 * position.beat, 3.0 * rate.beat)
    clearest: tuple[float, Windows] | None = None
    yielded = False
    while span <= (end - start) / 4.0:
        gaps = gaps_of(rate.t, max(0.4 * span, 3.0 * rate.beat))
        windows = windows_on(position.t, span, start, end, gaps)
        if windows is not None and len(windows) >= FEWEST:
            noise = _noises(windows, position, rate)
            x, predicted = windows.slopes(position.x), _predicted(windows, position, rate, total, 0.0)
            clear = max(_rms(x) / noise[0], _rms(predicted) / noise[1])
            if clear >= CLEAR:
                yielded = True
                yield windows
            elif clearest is None or clear > clearest[0]:
                clearest = clear, windows
        span *= 2.0 if yielded else 1.5
    if not yielded and clearest is not None and clearest[0] >= LEAST_CLEAR:
        yield clearest[1]


def _noises(windows: Windows, position: Series, rate: Series) -> tuple[float, float]:
    """Return the standard deviations of a slope of the position, and of a slope predicted by the rate."""
    own = position.noise * float(np.median(windows.gain))
    samples = max(windows.span / rate.beat, 1.0)
    return max(own, 1e-12), max(rate.noise * math.sqrt(1.2 / samples), 1e-12)


def _predicted(windows: Windows, position: Series, rate: Series, total: Array, shift: float) -> Array:
    return windows.slopes(np.interp(position.t - shift, rate.t, total))


def _rms(x: Array) -> float:
    return math.sqrt(float(np.mean(x * x)))


def _cosine(a: Array, b: Array) -> float:
    size = math.sqrt(float(a @ a) * float(b @ b))
    return float(a @ b) / size if size > 0.0 else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class _Shift:
    """A time shift: ``time`` [s], its standard error, and the slopes (n,) ``predicted`` with this shift.

    ``unshifted``, ``changing``: coherence of the varying component without a shift, and with this shift.
    """

    time: float
    std: float
    unshifted: float
    changing: float
    predicted: Array


def _best_shift(windows: Windows, position: Series, rate: Series, total: Array, x: Array, most: float) -> _Shift:
    """Return the shift at which both sides agree best."""
    step = max(0.05, 0.25 * min(position.beat, rate.beat))
    shifts = step * np.arange(-math.floor(most / step), math.floor(most / step) + 1)
    rows = [_predicted(windows, position, rate, total, float(s)) for s in shifts]
    centred = x - float(np.mean(x))
    cosines = np.array([_cosine(centred, row - float(np.mean(row))) for row in rows])
    handicap = LATER * (np.abs(shifts) + TURNED_ROUND * (cosines < 0.0))
    k = int(np.argmax(np.abs(cosines) - handicap))
    zero = int(np.argmin(np.abs(shifts)))
    best = rows[k]
    shift = float(shifts[k])
    if 0 < k < len(rows) - 1:  # the top of the parabola through three cosines
        below, at, above = (abs(float(cosines[i])) for i in (k - 1, k, k + 1))
        bend = below - 2.0 * at + above
        if bend < 0.0:
            shift += 0.5 * step * min(max((below - above) / bend, -1.0), 1.0)
    change = rows[min(k + 1, len(rows) - 1)] - rows[max(k - 1, 0)]
    factor = float(centred @ (best - best.mean())) / max(float(np.sum((best - best.mean()) ** 2)), 1e-300)
    left = centred - factor * (best - best.mean())
    slope = abs(factor) * math.sqrt(float(np.sum((change / (2.0 * step)) ** 2)))
    std = _rms(left) * math.sqrt(windows.overlap) / slope if slope > 0.0 else math.inf
    return _Shift(shift, std, float(cosines[zero]), float(cosines[k]), best)


def _judge(
    windows: Windows,
    x: Array,
    best: _Shift,
    noise: tuple[float, float],
    expected: Expected,
    *,
    position_leads: bool,
    beats: float,
) -> Comparison:
    """Return the comparison of the slopes *x* (n,) of the position with those predicted at the *best* shift.

    beats : mean interval [s] of both.
    """
    predicted, shift, shift_std = best.predicted, best.time, best.std
    leading, following = (x, predicted) if position_leads else (predicted, x)
    slope, std, coherence = _regression(
        leading, following, windows.overlap, expected.offset, noise[1 if position_leads else 0]
    )
    noisy = noise[0 if position_leads else 1] / max(_rms(leading), 1e-300)
    slope, std = (value / max(1.0 - noisy**2, 0.5) for value in (slope, std))
    measured_rms, predicted_rms = _rms(x), _rms(predicted)
    factor, factor_std = (1.0 / slope, std / slope**2) if position_leads and slope else (slope, std)
    kind: Kind = "unclear"
    high = abs(slope)
    own_noise = noise[1 if position_leads else 0]
    quiet = _rms(following) < max(STILL * _rms(leading), 2.0 * own_noise)
    steady = _rms(leading - float(np.mean(leading))) < 0.1 * _rms(leading)
    frozen = float(np.ptp(following)) <= 1e-9 * _rms(following) and (not steady or high < 0.1)
    excluded = high + SURE * std < 1.0 - expected.tolerance
    nothing = excluded and high < APART and (frozen or _rms(following) < 3.0 * own_noise)
    little = excluded and high < 0.5 * APART and high < max(3.0 * std, 0.1)
    if nothing or (little and (abs(coherence) < ALIKE or _is_flat(leading, following))):
        still: Kind = "still-rate" if position_leads else "still-position"
        kind, factor, factor_std = (still if quiet else "unrelated"), math.nan, math.nan
    elif abs(coherence) >= ALIKE:
        frequency = _frequency(windows, leading)
        allowed = expected.tolerance
        if abs(shift) <= expected.shift:
            allowed += 1.0 - 1.0 / math.hypot(1.0, frequency * shift)
        away = abs(math.log(max(high, 1e-12)))
        if slope < 0.0 and -slope > SURE * std:
            kind = "sign"
        elif away > math.log1p(allowed) and abs(slope - 1.0) > SURE * std:
            kind = "factor"
        elif (
            abs(shift) > expected.shift + beats + SURE * shift_std
            and best.changing >= ALIKE
            and 1.0 - best.changing**2 < BETTER * (1.0 - best.unshifted**2)
        ):
            kind = "shift"
        elif std < SPREAD:
            kind = "agrees"
    elif std < SPREAD and abs(slope - 1.0) < 2.0 * expected.tolerance:
        kind = "agrees"
    clear = _rms(leading) / noise[0 if position_leads else 1]
    return Comparison(kind, factor, factor_std, shift, shift_std, coherence, measured_rms, predicted_rms, clear)


def _is_flat(leading: Array, following: Array) -> bool:
    """Return whether the following side is constant, or noise about a constant, while the leading one changes."""
    a, b = leading - float(np.mean(leading)), following - float(np.mean(following))
    return abs(_cosine(a, b)) < APART and _rms(a) > 0.1 * _rms(leading)


def _regression(a: Array, b: Array, overlap: float, offset: float, noise: float) -> tuple[float, float, float]:
    """Return the slope of *b* (n,) on *a*, its standard error, and the coherence of both.

    noise : that of *b*.
    offset : standard deviation of a constant that is fitted with the slope.

    Up to one window in ten may be excluded as an outlier.
    """
    keep = np.ones(len(a), dtype=bool)
    slope = std = constant = 0.0
    left = b
    for _ in range(2):
        n = int(keep.sum())
        spread = (
            max(float(np.mean(left[keep] ** 2)), noise**2) if slope or constant else _variance_left(a[keep], b[keep])
        )
        spread = max(spread, noise**2)
        prior = spread / max(offset**2, 1e-300)
        matrix = np.array([[a[keep] @ a[keep], a[keep].sum()], [a[keep].sum(), n + prior]])
        matrix[0, 0] += 1e-12 * float(matrix[0, 0]) + 1e-300
        slope, constant = (float(v) for v in np.linalg.solve(matrix, np.array([a[keep] @ b[keep], b[keep].sum()])))
        left = b - slope * a - constant
        spread = max(float(np.mean(left[keep] ** 2)), noise**2)
        prior = spread / max(offset**2, 1e-300)
        matrix[1, 1] = n + prior
        inverse = np.linalg.inv(matrix)
        std = math.sqrt(max(float(inverse[0, 0]), 0.0) * spread * overlap * _lasting(left[keep], overlap))
        scale = 1.4826 * float(np.median(np.abs(left[keep])))
        good = np.abs(left) <= max(4.0 * scale, 1e-300)
        if good.all() or good.mean() < 0.9:
            break
        keep = good
    return slope, std, _cosine(a[keep], b[keep] - constant)


def _variance_left(a: Array, b: Array) -> float:
    slope = float(a @ b) / max(float(a @ a), 1e-300)
    return max(float(np.mean((b - slope * a) ** 2)), 1e-300)


def _lasting(left: Array, overlap: float) -> float:
    """Return the factor by which residuals that last longer than a window raise the variance of a mean."""
    lag = max(round(overlap), 1)
    if len(left) < 4 * lag:
        return 1.0
    rho = float(left[lag:] @ left[:-lag]) / max(float(left @ left), 1e-300)
    rho = min(max(rho, 0.0), 0.9)
    return (1.0 + rho) / (1.0 - rho)


def _frequency(windows: Windows, slopes: Array) -> float:
    """Return the approximate frequency [rad/s] of the motion, from the rms of its change between windows."""
    hops = np.diff(windows.middle)
    near = hops < 1.5 * float(np.median(hops))
    if not near.any():
        return 0.0
    change = _rms(np.diff(slopes)[near] / hops[near])
    return change / max(_rms(slopes), 1e-300)
