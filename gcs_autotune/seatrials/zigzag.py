"""Zig-zags of any angle: recognition in a run, overshoot angles, times, initial turning, K and T.

The manoeuvre is Algorithm 4.1 of Miskovic2010 (Kempf). The rudder is put over, and reversed when the heading has
changed by a set angle. It is reversed again when the heading has changed equally to the other side, and so on. Rudder
and heading angle need not be equal (``Z_<rudder>_<heading>``), nor the same on both sides. Angles and times are defined
as in IMO MSC.137(76), 4.2 and ITTC 7.5-04-02-01, 2.2.2.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify import Doubt
from gcs_autotune.identify.open_loop import (
    Execute,
    LocalFit,
    Reading,
    ShipLog,
    find_executes,
    local_fit,
    nomoto_of,
    rows_of,
    solve_zigzag,
    steered,
)
from gcs_autotune.identify.signals import prepare
from gcs_autotune.rounding import counted
from gcs_autotune.seatrials.criteria import (
    FIRST_OVERSHOOT_20,
    INITIAL_TURNING,
    Figure,
    Particulars,
    Shape,
    Sheet,
    first_overshoot_limit,
    helm_text,
    in_lengths,
    judged,
    known,
    per_helm,
    per_helm_words,
    second_overshoot_limit,
)
from gcs_autotune.trial import Trial

__all__ = ["ZigZagFigures", "read_zigzag", "zigzag_sheet"]

Array = NDArray[np.float64]

SLOW = 0.5
"""Duration of a helm reversal, relative to a half period, above which a run is not a zig-zag. Project choice."""

WIDEST, MOST = math.radians(100.0), 0.75
"""Limits for recognising a zig-zag. Project choice.

- ``WIDEST``: largest mean change of heading [rad].
- ``MOST``: least fraction of reversals at which the heading is on the correct side.
"""

BEND = 3
"""Degree of the polynomials in time that approximate the track of the first turn. Project choice."""
APPROACH = 3.0
"""Longest time [s] before the first execute from which the approach speed is calculated. Project choice: the craft may
gain speed until then.
"""
UNEVEN = 0.15
"""Relative spread of the headings at the executes above which a doubt is reported. Project choice."""


@dataclass(frozen=True, slots=True, eq=False)
class ZigZagFigures:
    """Figures of one zig-zag. All angles are positive, whatever the sign of the rudder. NaN means unknown.

    - ``rudder``: mean helm to the positive and to the negative side [unit of the input].
    - ``heading``: mean change of heading at the executes [rad].
    - ``sense``: +1 if a positive input turns to starboard, else -1.
    - ``overshoots`` [rad]: additional change of heading after the second, third, ... execute.
    - ``times_to_check`` [s]: from these executes to the extreme heading.
    - ``initial_turning_time`` [s]: from the first to the second execute.
    - ``reach`` [s]: from the first execute until the heading is back at the initial one.
    - ``period`` [s]: between executes of the same sign.
    - ``distance`` [m]: along the track from the first to the second execute.
    - ``approach`` [m/s]: speed just before the first execute.
    - ``L`` [m]: length of the craft.
    - ``approach_psi`` [rad]: initial heading.
    - ``peaks``: time [s] and heading [rad] of the extremes that ``overshoots`` lead to.
    """

    run: str
    input: str
    executes: tuple[Execute, ...]
    from_approach: bool
    rudder: tuple[float, float]
    heading: Reading
    sense: float
    overshoots: tuple[Reading, ...]
    times_to_check: tuple[Reading, ...]
    initial_turning_time: Reading
    reach: Reading
    period: Reading
    distance: Reading
    approach: float
    approach_psi: float
    peaks: tuple[tuple[float, float], ...]
    doubts: tuple[Doubt, ...]

    @property
    def helm(self) -> float:
        """Mean magnitude of the helm [unit of the input], relative to the middle between both sides."""
        return 0.5 * (self.rudder[0] + self.rudder[1])


def heading_at(log: ShipLog, t: float, start: float, end: float, degree: int = 2) -> LocalFit | None:
    """Return a local polynomial of the heading about *t* from the samples in [start, end], or None if there are too
    few.
    """
    s, psi = log.heading(start, end)
    return local_fit(s, psi, t, degree, log.floor) if len(s) >= degree + 3 else None


def read_zigzag(log: ShipLog) -> ZigZagFigures:
    """Return the figures of the zig-zag in the run *log*.

    Raises
    ------
    NotInformative
        The run contains no zig-zag: fewer than two reversals, or headings that do not alternate between sides.
    """
    executes = find_executes(log)
    executes = tuple(e for e in executes if e.t < log.end)
    if len(executes) < 3:
        raise NotInformative(
            f"run '{log.name}' contains no zig-zag: {counted(max(len(executes) - 1, 0), 'reversal')} of "
            f"{log.steering.name}; "
            "at least two are needed"
        )
    _check_reversals(log, executes)
    from_approach = executes[0].before == 0.0 and executes[0].t > log.t[0]
    psi_0 = _initial_heading(log, executes, from_approach)
    reversals = executes[1:] if executes[0].before == 0.0 else executes
    at = [_execute_heading(log, e) for e in reversals]
    sense = float(np.sign(sum((a.value - psi_0) * e.before for a, e in zip(at, reversals, strict=True)))) or 1.0
    changes = np.array(
        [sense * math.copysign(1.0, e.before) * (a.value - psi_0) for a, e in zip(at, reversals, strict=True)]
    )
    peaks = [_extreme(log, executes, e, sense) for e in reversals]
    proper = np.array([p is not None for p in peaks])
    if int(proper.sum()) < 1 or not 0.0 < float(np.mean(changes)) < WIDEST or np.mean(changes > 0.0) < MOST:
        raise NotInformative(f"run '{log.name}' contains no zig-zag: the heading does not follow the reversals")
    overshoots, checks = [], []
    for a, e, p in zip(at, reversals, peaks, strict=True):
        if p is not None:
            over = sense * math.copysign(1.0, e.before) * (p[1].value - a.value)
            overshoots.append(Reading(over, math.hypot(p[1].std, a.std), "rad"))
            checks.append(Reading(p[0].value - e.t, p[0].std, "s"))
    first = executes[0]
    span = float(np.ptp([e.level for e in executes]))
    plus = [e.level for e in executes if e.level > 0.0]
    minus = [-e.level for e in executes if e.level < 0.0]
    spread = float(changes.std(ddof=1)) / math.sqrt(len(changes)) if len(changes) > 1 else at[0].std
    return ZigZagFigures(
        run=log.name,
        input=log.steering.name,
        executes=executes,
        from_approach=from_approach,
        rudder=(float(np.mean(plus)) if plus else 0.5 * span, float(np.mean(minus)) if minus else 0.5 * span),
        heading=Reading(float(changes.mean()), spread, "rad"),
        sense=sense,
        overshoots=tuple(overshoots),
        times_to_check=tuple(checks),
        initial_turning_time=_time(reversals[0].t - first.t) if from_approach else _time(math.nan),
        reach=_reach(log, executes, psi_0) if from_approach else _time(math.nan),
        period=_period(executes),
        distance=_distance(log, first.t, reversals[0].t) if from_approach else Reading(math.nan, math.nan, "m"),
        approach=log.speed(max(log.t[0], first.t - APPROACH), first.t) if from_approach else math.nan,
        approach_psi=psi_0,
        peaks=tuple((p[0].value, p[1].value) for p in peaks if p is not None),
        doubts=(*log.doubts, *_doubts(log, changes, executes, from_approach)),
    )


def _check_reversals(log: ShipLog, executes: tuple[Execute, ...]) -> None:
    """Reject a run whose helm is reversed slowly, as in a spiral."""
    shares = [(a.done - a.t) / max(b.t - a.t, 1e-9) for a, b in itertools.pairwise(executes)]
    if float(np.median(shares)) > SLOW:
        raise NotInformative(f"run '{log.name}' contains no zig-zag: the helm moves continuously or in small steps")


def _time(value: float, std: float = math.nan) -> Reading:
    return Reading(value, std, "s")


def _initial_heading(log: ShipLog, executes: tuple[Execute, ...], from_approach: bool) -> float:
    """Return the heading of the approach; without an approach, the middle of the headings at the reversals."""
    if from_approach:
        t, psi = log.heading(executes[0].t - 5.0 * (executes[1].t - executes[0].t), executes[0].t)
        if len(t) >= 1:
            return float(psi.mean())
        return float(log.psi[0])
    if executes[0].before == 0.0:
        return float(log.psi[0])
    sides = [[_execute_heading(log, e).value for e in executes if (e.before > 0.0) == up] for up in (True, False)]
    return float(np.mean([np.mean(s) for s in sides if s]))


def _execute_heading(log: ShipLog, e: Execute) -> Reading:
    """Return the heading at the time of the order, from the samples just before and just after it."""
    dt = float(np.median(np.diff(log.t)))
    width = max(8.0 * dt, 0.0)
    fit = heading_at(log, e.t, e.t - width, e.t + 2.0 * dt)
    if fit is None:
        return Reading(float(np.interp(e.t, log.t, log.psi)), log.floor, "rad")
    return fit.value("rad")


def _extreme(log: ShipLog, executes: tuple[Execute, ...], e: Execute, sense: float) -> tuple[Reading, Reading] | None:
    """Return time and heading of the extreme after a reversal; None if the record ends before it."""
    k = executes.index(e)
    until = executes[k + 1].t if k + 1 < len(executes) else log.end
    t, psi = log.heading(e.t, until)
    if len(t) < 5:
        return None
    side = sense * math.copysign(1.0, e.before)
    top = int(np.argmax(side * psi))
    if top >= len(t) - 2:
        return None
    # the width over which the heading stays near its extreme: a tenth of the oscillation
    near = side * (psi[top] - psi) < 0.1 * float(np.ptp(psi)) + 2.0 * log.step
    left = top - int(np.argmax(~near[top::-1])) + 1 if (~near[: top + 1]).any() else 0
    right = top + int(np.argmax(~near[top:])) if (~near[top:]).any() else len(t)
    left, right = max(min(left, top - 3), 0), min(max(right, top + 4), len(t))
    fit = local_fit(t[left:right], psi[left:right], float(t[top]), 3 if right - left > 8 else 2, log.floor)
    c = fit.coefficients
    if len(c) < 3 or c[2] * side >= 0.0:
        return None
    move = float(np.clip(-c[1] / (2.0 * c[2]), t[left] - t[top], t[right - 1] - t[top]))
    powers = move ** np.arange(len(c))
    value = float(powers @ c)
    std = math.sqrt(max(float(powers @ fit.covariance @ powers), 0.0))
    when = Reading(float(t[top]) + move, math.sqrt(max(fit.covariance[1, 1], 0.0)) / abs(2.0 * float(c[2])), "s")
    return when, Reading(value, std, "rad")


def _reach(log: ShipLog, executes: tuple[Execute, ...], psi_0: float) -> Reading:
    """Return the time from the first execute until the heading returns to the initial one after the second execute."""
    t, psi = log.heading(executes[1].t, executes[2].t)
    if len(t) < 4:
        return _time(math.nan)
    crossed = np.flatnonzero((psi[:-1] - psi_0) * (psi[1:] - psi_0) <= 0.0)
    if len(crossed) == 0:
        return _time(math.nan)
    i = int(crossed[0])
    fit = local_fit(t[max(i - 4, 0) : i + 6], psi[max(i - 4, 0) : i + 6], float(t[i]), 1, log.floor)
    slope = float(fit.coefficients[1])
    when = float(t[i]) + (psi_0 - float(fit.coefficients[0])) / slope
    return _time(when - executes[0].t, math.sqrt(float(fit.covariance[0, 0])) / abs(slope))


def _period(executes: tuple[Execute, ...]) -> Reading:
    """Return the mean time between reversals of the same sign; the first execute, from amidships, does not count."""
    times = [e.t for e in (executes[1:] if executes[0].before == 0.0 else executes)]
    periods = np.array([b - a for a, b in zip(times[:-2], times[2:], strict=True)])
    if len(periods) == 0:
        return _time(2.0 * (times[1] - times[0]) if len(times) > 1 else math.nan)
    return _time(
        float(periods.mean()), float(periods.std(ddof=1)) / math.sqrt(len(periods)) if len(periods) > 1 else math.nan
    )


def _distance(log: ShipLog, start: float, end: float) -> Reading:
    """Return the distance [m] between two times, from the track; without a track from the speed, without an error.

    A smooth curve is first fitted to the positions, because their noise accumulates from one to the next and would
    lengthen the track.
    """
    x, y = log.channel("x"), log.channel("y")
    if x is None or y is None or min(len(x.between(start, end).t), len(y.between(start, end).t)) < BEND + 3:
        return Reading(log.speed(start, end) * (end - start), math.nan, "m")
    middle = 0.5 * (start + end)
    fits = [local_fit(c.t, c.values, middle, BEND) for c in (x.between(start, end), y.between(start, end))]
    grid = np.linspace(start - middle, end - middle, 101)
    slopes = np.stack([k * grid ** (k - 1) if k else np.zeros_like(grid) for k in range(BEND + 1)])
    along = np.stack([fit.coefficients @ slopes for fit in fits])
    speed = np.hypot(*along)
    gradients = [np.trapezoid(part / np.maximum(speed, 1e-12) * slopes, grid, axis=1) for part in along]
    variance = sum(float(g @ fit.covariance @ g) for g, fit in zip(gradients, fits, strict=True))
    return Reading(float(np.trapezoid(speed, grid)), math.sqrt(variance), "m")


def _doubts(log: ShipLog, changes: Array, executes: tuple[Execute, ...], from_approach: bool) -> list[Doubt]:
    doubts = []
    if not from_approach:
        doubts.append(
            Doubt(
                "no-approach",
                f"run '{log.name}' does not start on a straight course with the helm amidships",
                "record a few ship lengths of approach for the first figures",
            )
        )
    if len(changes) > 1 and float(changes.std(ddof=1)) > UNEVEN * float(changes.mean()):
        doubts.append(
            Doubt(
                "uneven-executes",
                f"the helm was reversed at heading changes from {math.degrees(changes.min()):.1f} to "
                f"{math.degrees(changes.max()):.1f} deg",
                "reverse the helm at the same heading change each time, because overshoot angles depend on it",
            )
        )
    dt = float(np.median(np.diff(log.t)))
    shortest = min(b.t - a.t for a, b in itertools.pairwise(executes))
    if shortest < 20.0 * dt:
        doubts.append(
            Doubt(
                "slow-sampling",
                f"the heading is sampled every {dt:.2g} s, at the fewest {shortest / dt:.0f} times from one helm order "
                "to the next",
                "record the heading at a higher rate",
            )
        )
    return doubts


NAN = math.nan


def zigzag_sheet(run: Trial, log: ShipLog, ship: Particulars) -> Sheet:
    """Return the sheet of figures of the zig-zag in *run*, with Nomoto's indices from the same run."""
    z = read_zigzag(log)
    helm = z.helm
    nominal = _nominal(z)
    seconds = ship.seconds(z.approach)
    first_limit = first_overshoot_limit(seconds) if nominal == "10/10" else NAN
    first_limit = FIRST_OVERSHOOT_20 if nominal == "20/20" else first_limit
    second_limit = second_overshoot_limit(seconds) if nominal == "10/10" else NAN
    unit = "rad" if log.steering.unit == "rad" else log.steering.unit
    overs = [
        judged("first-overshoot", "first overshoot angle", z.overshoots[0], first_limit, "5.3.3"),
        *(
            [judged("second-overshoot", "second overshoot angle", z.overshoots[1], second_limit, "5.3.3")]
            if len(z.overshoots) > 1
            else []
        ),
        *(
            judged(f"overshoot-{i}", f"{_ordinal(i)} overshoot angle", o)
            for i, o in enumerate(z.overshoots[2:], start=3)
        ),
    ]
    turning = nominal == "10/10"
    figures = known(
        judged("helm", _helm_words(run, z, unit), Reading(helm, NAN, unit)),
        judged("heading", "heading change at helm reversal", z.heading),
        *overs,
        judged("initial-turning-time", "initial turning time", z.initial_turning_time),
        judged("time-to-check", "time to check yaw", z.times_to_check[0]),
        judged("reach", "reach (return to the initial heading)", z.reach),
        judged("period", "period", z.period),
        judged("initial-turning", "distance to the second helm order (execute)", z.distance),
        judged(
            "initial-turning-lengths",
            "distance to the second helm order (execute)",
            in_lengths(z.distance, ship),
            INITIAL_TURNING if turning else None,
            "5.3.2",
        ),
        judged("approach", "approach speed", Reading(z.approach, NAN, "m/s")),
        *_nomoto_figures(run, ship, z, unit),
    )
    side = "" if not z.from_approach else f", first to {'starboard' if z.sense * z.executes[0].level > 0 else 'port'}"
    return Sheet(log.name, "zig-zag", f"{_angles(run, z, unit)} zig-zag{side}", figures, "", z.doubts, _shape(log, z))


def _ordinal(number: int) -> str:
    """Return *number*, from 3, as in "third" and "21st"."""
    if number < 11:
        return ("third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")[number - 3]
    ending = "th" if 11 <= number % 100 <= 13 else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{ending}"


def _shape(log: ShipLog, z: ZigZagFigures) -> Shape:
    """Return heading change and helm over time from the first execute, with the overshoot angles at the extremes."""
    start = z.executes[0].t
    helm = log.steering
    lines = (
        ("heading change", log.t - start, log.psi - z.approach_psi),
        ("helm", helm.t - start, z.sense * helm.values),
    )
    points = tuple(
        (f"{math.degrees(over.value):.1f}°", t - start, psi - z.approach_psi)
        for over, (t, psi) in zip(z.overshoots, z.peaks, strict=True)
    )
    return Shape("time", lines, points, helm.unit)


def _nominal(z: ZigZagFigures) -> str:
    """Return "10/10" or "20/20" if helm (to a tenth) and heading (to a sixth) match; otherwise an empty string."""
    for angle in (10.0, 20.0):
        near = math.radians(angle)
        close = abs(z.helm - near) < HELM_NEAR * near and abs(z.heading.value - near) < HEADING_NEAR * near
        if close and z.input == "delta":
            return f"{angle:.0f}/{angle:.0f}"
    return ""


def _angles(run: Trial, z: ZigZagFigures, unit: str) -> str:
    """Return rudder and heading as ordered; as measured if the record does not contain the order.

    A helmsman reverses the rudder late, so that the heading at the executes exceeds the ordered one.
    """
    ordered = run.meta.get("heading")
    if isinstance(ordered, float) and isinstance(run.meta.get("steering"), float):
        return f"{helm_text(_ordered_helm(run, z, unit), unit)}/{math.degrees(ordered):.0f}{_sign(unit)}"
    helm = _ordered(z.helm, HELM_NEAR) if unit == "rad" else z.helm
    return f"{helm_text(helm, unit)}/{math.degrees(_ordered(z.heading.value, HEADING_NEAR)):.0f}{_sign(unit)}"


def _ordered_helm(run: Trial, z: ZigZagFigures, unit: str) -> float:
    """Return the helm that was ordered; the measured one if the record does not contain the order."""
    share = run.meta.get("steering")
    if not isinstance(share, float) or unit not in ("rad", "1"):
        return z.helm
    return abs(share) * float(run.meta.get("full_rudder", 1.0))


def _helm_words(run: Trial, z: ZigZagFigures, unit: str) -> str:
    """Return the name of the measured helm; a mixer that saturates sends less than was ordered."""
    ordered = _ordered_helm(run, z, unit)
    if abs(z.helm - ordered) <= HELM_MISSED * z.helm:
        return "helm"
    return f"helm at the output (ordered: {helm_text(ordered, unit)})"


def _sign(unit: str) -> str:
    """Return the unit of the heading in a title. A zig-zag by rudder angle has none: 20/20 is its name at the IMO."""
    return "" if unit == "rad" else "\N{DEGREE SIGN}"


HELM_MISSED = 0.02
"""Relative difference of the measured from the ordered helm above which both are named. Project choice."""
HELM_NEAR, HEADING_NEAR = 0.1, 1.0 / 6.0
"""Relative differences from a multiple of 5 degrees within which a rudder angle and a heading count as that multiple.

Project choice.
"""


def _ordered(angle: float, near: float) -> float:
    """Return the multiple of 5 degrees that *angle* [rad] is within the fraction *near* of; otherwise *angle*."""
    five = math.radians(5.0)
    whole = round(angle / five) * five
    return whole if abs(angle - whole) < near * whole else angle


def _nomoto_figures(run: Trial, ship: Particulars, z: ZigZagFigures, unit: str) -> tuple[Figure, ...]:
    """Return Nomoto's indices per *unit* of the helm, as the other figures do."""
    every = [rows for record in prepare(steered(run), "yaw") if (rows := rows_of(record)) is not None]
    if not every:
        return ()
    try:
        theta, covariance, _, _ = solve_zigzag(every, "linear")
    except NotInformative:
        return ()
    speed = z.approach if z.approach > 0.0 else ship.speed
    made = nomoto_of(theta, covariance, ship.length, speed)
    return (
        judged("K", f"Nomoto K, {per_helm_words(unit)}", made.K.scaled(z.sense, per_helm("rad/s", unit))),
        judged("T", "Nomoto T", made.T),
        judged(
            "K-prime", f"Nomoto K' = K L/U, {per_helm_words(unit)}", made.K_prime.scaled(z.sense, per_helm("rad", unit))
        ),
        judged("T-prime", "Nomoto T' = T U/L", made.T_prime),
    )
