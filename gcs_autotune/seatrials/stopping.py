"""Stopping: distance and time that a craft continues after its thrust was removed or reversed.

Track reach, head reach and lateral deviation are defined as in IMO MSC.137(76), 4.2.5 and ITTC 7.5-04-02-01. The
criterion of 5.3.4 (track reach in ship lengths) applies to full astern. With quadratic drag a coasting craft never
quite stops. The figures therefore end at a tenth of the approach speed.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import MissingChannel, NotInformative
from gcs_autotune.identify import Doubt
from gcs_autotune.identify.open_loop import LocalFit, Reading, find_holds, local_fit
from gcs_autotune.identify.signals import clean
from gcs_autotune.seatrials.criteria import TRACK_REACH, Particulars, Shape, Sheet, in_lengths, judged, known
from gcs_autotune.trial import Channel, Trial

__all__ = ["stopping_sheet"]

Array = NDArray[np.float64]

ENDED, HALF = 0.1, 0.5
"""Fractions of the approach speed at which the craft counts as stopped, and for the half-speed figures.

Project choice.
"""
NO_THRUST = 0.05
"""Largest thrust that counts as zero, relative to the thrust of the approach. Project choice."""
FULL_ASTERN = 0.1
"""Quantile of the thrust during a stop that is reported as thrust astern. Project choice: thrust builds up slowly."""
BEFORE = 3.0
"""Longest interval before the stop [s] from which the approach speed is calculated. Project choice."""
WIDTH = 2.0
"""Length [s] of the window of positions or speeds for one figure. Project choice."""
SLOW = 0.1
"""Length of the window for a speed, as a fraction of the time since the stop began, if that is longer than
:data:`WIDTH`. In a shorter window the noise hides how slowly a coasting craft loses speed. Project choice.
"""
NAN = math.nan


def stopping_sheet(run: Trial, ship: Particulars) -> Sheet:
    """Return the sheet of figures of the stop in *run*.

    Raises
    ------
    MissingChannel
        The run has no thrust X, no speed u, or no positions.
    NotInformative
        The thrust is never removed at a steady speed ahead.
    """
    notes: list[Doubt] = []
    X, u, x, y = (clean(_channel(run, name), run.name, notes) for name in "Xuxy")
    start = _order(run, X, float(u.t[-1]))
    approach = u.between(max(start - BEFORE, float(u.t[0])), start)
    if len(approach) < 5:
        raise NotInformative(
            f"run '{run.name}' contains no approach before its stop. Start recording at steady speed ahead"
        )
    speed = local_fit(approach.t, approach.values, start, 1).value("m/s")
    if not speed.value > 3.0 * speed.std:
        raise NotInformative(f"run '{run.name}' has no speed before its thrust is removed")
    half, ended = (_passing(u, start, share * speed.value) for share in (HALF, ENDED))
    if not math.isfinite(ended.value):
        left = float(u.values[-10:].mean())
        cause = f"the record ends while the craft still moves at {left:.2f} m/s (initially {speed.value:.2f} m/s)"
        notes.append(Doubt("not-stopped", cause, "record until the speed has fallen to a tenth of its initial value"))
    astern = _astern(X, start, ended.value if math.isfinite(ended.value) else float(u.t[-1]))
    course = _course(x, y, start)
    reach = {name: _reach(u, x, y, start, when, course) for name, when in (("half", half), ("ended", ended))}
    unit = "of full astern" if X.unit == "1" else f"{X.unit} astern"
    track, ahead, aside = reach["ended"]
    figures = known(
        judged("approach", "approach speed", speed),
        judged("time-half", "time to half the speed", Reading(half.value - start, half.std, "s")),
        judged("reach-half", "track reach at half the speed", reach["half"][0]),
        judged("time-stop", "time to stop (a tenth of the speed)", Reading(ended.value - start, ended.std, "s")),
        judged("track-reach", "track reach", track),
        judged(
            "track-reach-lengths",
            "track reach",
            in_lengths(track, ship),
            TRACK_REACH if astern else None,
            "5.3.4 (full astern)",
        ),
        judged("head-reach", "head reach", ahead),
        judged("lateral-deviation", "lateral deviation to starboard", aside),
        judged("heading-change", "heading change to starboard", _turned(run, start, ended.value)),
    )
    how = f"{100.0 * astern:.0f} % {unit}" if astern and X.unit == "1" else f"{astern:.3g} {unit}"
    shape, doubts = _shape(x, y, start, ended.value, course, ahead, aside), tuple({d.slug: d for d in notes}.values())
    title = f"stopping with {how}" if astern else "stopping without thrust (coasting)"
    return Sheet(run.name, "stopping", title, figures, "", doubts, shape)


def _shape(
    x: Channel, y: Channel, start: float, end: float, course: float, reach: Reading, deviation: Reading
) -> Shape:
    """Return the stopping track from the removal of thrust, with the point at which the craft had stopped."""
    first, last = start - BEFORE, end if math.isfinite(end) else float(x.t[-1])
    t = x.t[(x.t >= first) & (x.t <= last)]
    north, east = (np.interp(t, c.t, c.values) - _position(c, start).coefficients[0] for c in (x, y))
    ahead = north * math.cos(course) + east * math.sin(course)
    abeam = east * math.cos(course) - north * math.sin(course)
    stopped = math.isfinite(reach.value)
    points = ((f"stopped, head reach {reach.value:.3g} m", deviation.value, reach.value),) if stopped else ()
    return Shape("track", (("track", abeam, ahead),), points)


def _channel(run: Trial, name: str) -> Channel:
    if name not in run or len(run[name]) < 2:
        raise MissingChannel(f"run '{run.name}' has no {name}. A stop needs X, u, x and y")
    return run[name]


def _order(run: Trial, X: Channel, end: float) -> float:
    """Return the time at which thrust was last removed from steady speed ahead [s].

    A fast craft stops before thrust astern reaches its level. The mark in the record is then used.
    """
    marked = [m.t for m in run.marks if m.kind == "execute" and isinstance(m.detail.get("X"), float)]
    if marked and X.held_at(math.nextafter(marked[-1], -math.inf)) > 0.0:
        return marked[-1]
    holds = find_holds(X.t, X.values, end)
    for before, after in reversed(list(itertools.pairwise(holds))):
        if before.level > 0.0 and after.level <= NO_THRUST * before.level:
            return 0.5 * (after.before + after.start)
    raise NotInformative(f"run '{run.name}' contains no stop: the thrust X is never removed from steady speed ahead")


def _astern(X: Channel, start: float, end: float) -> float:
    """Return the steady thrust astern during the stop; 0 if the craft coasted."""
    held = X.between(start + 0.3 * (end - start), end).values
    astern = -float(np.quantile(held, FULL_ASTERN)) if len(held) else -X.held_at(0.5 * (start + end))
    return astern if astern > NO_THRUST * float(np.max(np.abs(X.values))) else 0.0


def _passing(u: Channel, start: float, level: float) -> Reading:
    """Return the time at which the speed fell to *level*, from a straight line near it; NaN if it never did.

    The mean over a window (shorter at the ends of the record) finds the place, because single readings are below
    *level* too early. A line that reaches *level* only after the end of the record does not count.
    """
    after = u.between(start, float(u.t[-1]))
    window = 0.5 * np.maximum(WIDTH, SLOW * (after.t - start))
    half = np.minimum(window, np.minimum(after.t - after.t[0], after.t[-1] - after.t))
    first, last = np.searchsorted(after.t, after.t - half, "left"), np.searchsorted(after.t, after.t + half, "right")
    summed = np.concatenate([[0.0], np.cumsum(after.values)])
    below = np.flatnonzero((summed[last] - summed[first]) / np.maximum(last - first, 1) <= level)
    if not len(below) or below[0] == 0:
        return Reading(NAN, NAN, "s")
    t = float(after.t[below[0]])
    keep = np.abs(after.t - t) <= window[below[0]]
    if int(keep.sum()) < 4:
        return Reading(t, NAN, "s")
    line = local_fit(after.t[keep], after.values[keep], t, 1)
    slope = float(line.coefficients[1])
    if slope >= 0.0:
        return Reading(t, NAN, "s")
    when = t + (level - float(line.coefficients[0])) / slope
    if when > float(after.t[-1]):
        return Reading(NAN, NAN, "s")
    return Reading(when, math.sqrt(float(line.covariance[0, 0])) / -slope, "s")


def _position(c: Channel, t: float) -> LocalFit:
    """Return the position at *t* from earlier samples only, because the track bends when thrust is removed."""
    last = max(int(np.searchsorted(c.t, t, side="right")), 6)
    first = min(int(np.searchsorted(c.t, t - WIDTH)), last - 6)
    return local_fit(c.t[first:last], c.values[first:last], t, 2)


def _course(x: Channel, y: Channel, start: float) -> float:
    """Return the direction of the track [rad] on the approach."""
    slopes = []
    for c in (x, y):
        before = c.between(start - BEFORE, start)
        if len(before) < 4:
            raise NotInformative("too few positions before the stop to determine the course. Record a longer approach")
        slopes.append(float(local_fit(before.t, before.values, start, 1).coefficients[1]))
    return math.atan2(slopes[1], slopes[0])


def _reach(u: Channel, x: Channel, y: Channel, start: float, when: Reading, course: float) -> tuple[Reading, ...]:
    """Return track reach (the integral of speed), head reach and lateral deviation [m]; NaN if the record ends before.

    The length of the track itself would increase with the noise of its positions.
    """
    if not math.isfinite(when.value):
        return (Reading(NAN, NAN, "m"),) * 3
    inner = u.between(start, when.value)
    t = np.concatenate([[start], inner.t, [when.value]])
    v = np.interp(t, u.t, u.values)
    noise = float(np.std(np.diff(inner.values, n=2))) / math.sqrt(6.0) if len(inner) > 4 else NAN
    slowest = float(np.interp(when.value, u.t, u.values))
    late = 0.0 if math.isnan(when.std) else slowest * when.std
    track = Reading(float(np.trapezoid(v, t)), math.hypot(noise * math.sqrt(max(len(t), 1)) * _step(t), late), "m")
    a, b = [_position(c, start) for c in (x, y)], [_position(c, when.value) for c in (x, y)]
    north, east = (float(q.coefficients[0] - p.coefficients[0]) for p, q in zip(a, b, strict=True))
    std = math.sqrt(0.5 * sum(float(f.covariance[0, 0]) for f in (*a, *b)))
    ahead = north * math.cos(course) + east * math.sin(course)
    aside = east * math.cos(course) - north * math.sin(course)
    return track, Reading(ahead, math.hypot(std, late), "m"), Reading(aside, std, "m")


def _step(t: Array) -> float:
    return float(np.median(np.diff(t)))


def _turned(run: Trial, start: float, end: float) -> Reading:
    if "psi" not in run or not math.isfinite(end):
        return Reading(NAN, NAN, "rad")
    psi = run["psi"]
    angles = np.unwrap(psi.values)
    return Reading(float(np.interp(end, psi.t, angles) - np.interp(start, psi.t, angles)), NAN, "rad")
