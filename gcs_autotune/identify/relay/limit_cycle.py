"""Determine the limit cycles of a relay experiment, and monitor when to stop the experiment (Miskovic2010, 6.5-6.7).

The readings are the extremes and durations of every half period, the actual switching value (6.5), and condition (7.12)
for every period. The stop rule needs five consecutive periods whose maxima and minima scatter within 10 %.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.relay.iso import is_valid
from gcs_autotune.identify.result import LimitCycle
from gcs_autotune.identify.signals.along_axis import distance_in
from gcs_autotune.identify.signals.preparation import prepare
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.sname import Dof
from gcs_autotune.trial import Trial

__all__ = [
    "PERIODS",
    "SCATTER",
    "HalfPeriod",
    "LimitCycleMonitor",
    "MonitorState",
    "Settled",
    "cycle_from",
    "cycles_of",
    "find_cycles",
    "settled_cycles",
]

PERIODS = 5
"""Number of consecutive periods that the stop rule requires (Miskovic2010, 6.7)."""

SCATTER = 0.10
"""Largest standard deviation of maxima and of minima that the stop rule allows, as a fraction of the amplitude.

Source: Miskovic2010, 6.7.
"""

NOISES = 2.0
"""How much too large the bias x_0 of one period may be for (7.12), in standard deviations of the noise. Project choice.

It is read from two extremes and two switching positions, with an error of about one standard deviation. At 1.5 deg of
noise a boat that turns 2 deg beyond its hysteresis would otherwise violate the condition in every third period.
"""


@dataclass(frozen=True, slots=True)
class HalfPeriod:
    """Readings of one half period, from one switching of the relay to the next.

    - ``start``, ``end`` [s]: times at which the relay switches.
    - ``at_switch``: position at ``start``.
    - ``low``, ``high``: smallest and largest position.
    - ``level``: value of the input.
    """

    start: float
    end: float
    at_switch: float
    low: float
    high: float
    level: float

    @property
    def duration(self) -> float:
        """Duration of the half period [s]."""
        return self.end - self.start


def cycle_from(halves: Sequence[HalfPeriod], x_a: float | None = None) -> LimitCycle:
    """Return the mean limit cycle of an even number (two or more) of consecutive half periods.

    Switching values are measured from the midpoint between them, so the reference need not be known. ``valid`` is true
    only if every single period satisfies (7.12).
    """
    one, other = halves[0::2], halves[1::2]
    rising, falling = (one, other) if _mean(one, "at_switch") < _mean(other, "at_switch") else (other, one)
    up, down = _mean(rising, "level"), _mean(falling, "level")
    middle = 0.5 * (_mean(rising, "at_switch") + _mean(falling, "at_switch"))
    x_a_star = 0.5 * (_mean(falling, "at_switch") - _mean(rising, "at_switch"))
    minima = np.array([h.low for h in rising])
    maxima = np.array([h.high for h in falling])
    X_m = 0.5 * float(maxima.mean() - minima.mean())
    T_H, T_L = _mean(rising, "duration"), _mean(falling, "duration")
    spread = (
        max(float(minima.std(ddof=1)), float(maxima.std(ddof=1))) / X_m if len(minima) > 1 and X_m > 0 else math.inf
    )
    valid = all(_is_proper(pair, middle) for pair in zip(one, other, strict=True))
    return LimitCycle(
        C=0.5 * (up - down),
        x_a=x_a_star if x_a is None else x_a,
        x_a_star=x_a_star,
        X_m=X_m,
        x_0=0.5 * float(maxima.mean() + minima.mean()) - middle,
        omega=2.0 * math.pi / (T_H + T_L),
        T_H=T_H,
        T_L=T_L,
        periods=len(one),
        scatter=spread,
        valid=valid,
        offset=0.5 * (up + down),
    )


def _mean(halves: Sequence[HalfPeriod], name: str) -> float:
    return sum(float(getattr(h, name)) for h in halves) / len(halves)


def _is_proper(pair: Sequence[HalfPeriod], middle: float, slack: float = 0.0) -> bool:
    """Return whether one period satisfies Miskovic2010, eq. (7.12), once its bias is smaller by *slack*.

    middle : midway between the switching positions.
    """
    low, high = min(h.low for h in pair), max(h.high for h in pair)
    x_a = 0.5 * abs(pair[0].at_switch - pair[1].at_switch)
    return is_valid(0.5 * (high - low), x_a, max(abs(0.5 * (high + low) - middle) - slack, 0.0))


@dataclass(frozen=True, slots=True)
class MonitorState:
    """State of a :class:`LimitCycleMonitor`.

    - ``switchings``: number of switchings of the relay.
    - ``periods``: number of consecutive periods that satisfy (7.12); a period that violates it sets the count to 0.
    - ``settled``: whether the stop rule is satisfied.
    - ``proper``: whether the last full period satisfied (7.12), True before the first.
    - ``cycle``: mean of the latest periods, None before the first.
    """

    switchings: int
    periods: int
    settled: bool
    proper: bool
    cycle: LimitCycle | None


class LimitCycleMonitor:
    """Monitor that processes a relay experiment sample by sample and applies the stop rule.

    Parameters
    ----------
    C : relay output [input units], half the distance between its two positions.
    x_a : switching value as set [rad or m].
    periods, scatter : limits of the stop rule, with the meaning of :data:`PERIODS` and :data:`SCATTER`.
    noise : standard deviation of the position's noise [rad or m]. A period whose bias is too large by less than
        :data:`NOISES` of it is counted, as long as the mean of the counted periods satisfies (7.12).
    """

    def __init__(
        self, C: float, x_a: float, *, periods: int = PERIODS, scatter: float = SCATTER, noise: float = 0.0
    ) -> None:
        self._C, self._x_a, self._slack = C, x_a, NOISES * noise
        self._needed, self._scatter = periods, scatter
        self._halves: list[HalfPeriod] = []
        self._relay: bool | None = None
        self._start = self._at_switch = self._low = self._high = math.nan
        self._state = MonitorState(0, 0, False, True, None)

    @property
    def state(self) -> MonitorState:
        """State of the monitor after the last update."""
        return self._state

    def update(self, t: float, x: float, relay_high: bool) -> MonitorState:
        """Process one sample, and return the new state.

        t, x, relay_high : time [s], input of the relay with either sign, and whether its output is now high.

        *x* must be continuous (an angle unwrapped or relative to the reference). Call the method after the relay has
        decided. The sample at which it switched is then the first of the new half period. Samples that are not finite
        are ignored.
        """
        if not (math.isfinite(t) and math.isfinite(x)):
            return self._state
        if self._relay is None:
            self._relay = relay_high
        elif relay_high != self._relay:
            self._switch(t, x, relay_high)
        self._low = x if math.isnan(self._low) else min(self._low, x)
        self._high = x if math.isnan(self._high) else max(self._high, x)
        return self._state

    def _switch(self, t: float, x: float, relay_high: bool) -> None:
        """Complete the current half period and begin the next."""
        if not math.isnan(self._start):
            level = self._C if self._relay else -self._C
            self._halves.append(HalfPeriod(self._start, t, self._at_switch, self._low, self._high, level))
            del self._halves[: -2 * self._needed]
        self._relay, self._start, self._at_switch = relay_high, t, x
        self._low = self._high = x
        self._state = self._judged(self._state.switchings + 1)

    def _judged(self, switchings: int) -> MonitorState:
        whole = len(self._halves) // 2
        if whole == 0:
            return MonitorState(switchings, 0, False, self._state.proper, self._state.cycle)
        last, mean = self._halves[-2:], cycle_from(self._halves[-2 * whole :], self._x_a)
        cycle = self._seen_from_relay(mean)
        on_average = whole == 1 or is_valid(mean.X_m, mean.x_a_star, mean.x_0)
        if not (on_average and _is_proper(last, 0.5 * (last[0].at_switch + last[1].at_switch), self._slack)):
            self._halves.clear()
            return MonitorState(switchings, 0, False, False, cycle)
        settled = whole >= self._needed and cycle.scatter <= self._scatter
        return MonitorState(switchings, whole, settled, True, cycle)

    def _seen_from_relay(self, cycle: LimitCycle) -> LimitCycle:
        """Return *cycle* mirrored if *x* falls while the position rises, so that ``C`` keeps its sign."""
        if cycle.C * self._C >= 0.0:
            return cycle
        return replace(cycle, C=-cycle.C, x_0=-cycle.x_0, T_H=cycle.T_L, T_L=cycle.T_H)


Array = NDArray[np.float64]

LEVEL_TOLERANCE = 0.05
"""Relative difference of the relay's output between half periods, up to which they belong to one experiment.

Project choice.
"""


NEUTRAL = 0.25
"""Deviation of an input from the relay's output, relative to its amplitude, above which the input counts as neutral.

Project choice.
"""

RELAY_SPREAD = 0.2
"""Largest scatter of the relay's switching positions, as a fraction of the distance between them. Project choice."""


@dataclass(frozen=True, slots=True, eq=False)
class Settled:
    """A limit cycle with its times.

    - ``cycle``: the limit cycle.
    - ``edges`` (periods + 1,) [s]: start of every period, and end of the last.
    """

    cycle: LimitCycle
    edges: Array


def find_cycles(trial: Trial, dof: Dof | str) -> tuple[LimitCycle, ...]:
    """Return the limit cycles of a run, one per relay setting. The result is empty if the input is not a relay.

    Each limit cycle is averaged over its last periods. The first periods are left out if they belong to the transient.

    Raises
    ------
    MissingChannel, NotInformative, BadFile
        :func:`gcs_autotune.identify.signals.preparation.prepare` raised the error.
    """
    return tuple(settled.cycle for record in prepare(trial, dof) for settled in settled_cycles(trial, record))


def settled_cycles(trial: Trial, record: Segment) -> list[Settled]:
    """Return the limit cycles in *record*, a stretch of *trial*, with the times of their periods."""
    hysteresis = trial.meta.get("x_a")
    x_a = float(hysteresis) if isinstance(hysteresis, (int, float)) else None
    marked = [m.t for m in trial.marks if m.kind == "switch"]
    return cycles_of(record, x_a, marked, declared=trial.by_relay)


def cycles_of(
    record: Segment, x_a: float | None = None, marked: Sequence[float] = (), *, declared: bool = False
) -> list[Settled]:
    """Return the limit cycles in one stretch, with the times of their periods.

    Parameters
    ----------
    x_a : switching value as set [rad or m], None if unknown.
    marked : switching times [s], used if the input itself does not show them.
    declared : whether the run is known to be a relay experiment. If not, only a stretch that behaves like one is used.
    """
    switchings = _switchings(record, marked)
    t, x, nu_0 = _position(record, switchings)
    halves = _half_periods(t, x, record, switchings)
    if len(halves) < 2 and len(marked) > 2:
        halves = _half_periods(t, x, record, np.asarray(marked, dtype=np.float64))
    settled = []
    for group in _groups(halves):
        best = _settled(group, x_a) if declared or _is_relay(group) else None
        if best is not None:
            settled.append(replace(best, cycle=replace(best.cycle, nu_0=nu_0)))
    return settled


def _is_relay(halves: Sequence[HalfPeriod]) -> bool:
    """Return whether a two-level input switches like a relay, repeatedly at the same two positions."""
    if len(halves) < 4:
        return False
    one, other = (np.array([h.at_switch for h in halves[i::2]]) for i in (0, 1))
    apart = abs(float(np.median(one) - np.median(other)))
    return max(float(np.median(np.abs(s - np.median(s)))) for s in (one, other)) < RELAY_SPREAD * apart


def _position(record: Segment, switchings: Array) -> tuple[Array, Array, float]:
    """Return stamps, position, and the mean velocity that was subtracted.

    Without a position, it is the integral of the velocity minus its mean, Miskovic2010, eq. (6.48). The same holds for
    surge and sway if a velocity was measured, because ``x`` and ``y`` may not be ahead and starboard. The mean is taken
    over whole, later periods, because otherwise the integral would drift. If the relay acted on the distance to a wall
    ahead (6.6.2), that distance is used.
    """
    wall = distance_in(record)
    if wall is not None:
        return wall.t, -wall.values, 0.0
    ashore = record.dof.along_ground and record.velocity is not None
    if record.position is not None and not ashore:
        return record.position.t, record.position.values, 0.0
    velocity = record.main if record.velocity is None else record.velocity
    t, nu = velocity.t, velocity.values
    area = np.concatenate([[0.0], np.cumsum(0.5 * (nu[1:] + nu[:-1]) * np.diff(t))])
    inside = switchings[(switchings >= t[0]) & (switchings <= t[-1])]
    periods = (len(inside) - 1) // 2
    first, last = (inside[-1 - 2 * ((periods + 1) // 2)], inside[-1]) if periods >= 1 else (t[0], t[-1])
    from_, to = np.interp([first, last], t, area)
    nu_0 = float((to - from_) / (last - first))
    return t, area - nu_0 * (t - t[0]), nu_0


def _switchings(record: Segment, marked: Sequence[float] = ()) -> Array:
    """Return the times at which the input crosses the middle between its two positions.

    The start from neutral and the final return to it are left out. A relay that stops at a switching returns to neutral
    at once. Only a mark in the record distinguishes this crossing from a mere return.
    """
    low, high = np.quantile(record.tau, [0.1, 0.9]) if len(record.tau) > 4 else (record.tau.min(), record.tau.max())
    middle = 0.0 if low < 0.0 < high else 0.5 * (low + high)
    side = np.where(record.tau > middle, 1, -1)
    switched: Array = record.t_in[1:][np.diff(side) != 0]
    if _begins_at_neutral(record, switched):
        switched = switched[1:]
    if len(switched) > 1 and len(marked) and max(marked) > 0.5 * (switched[-2] + switched[-1]):
        return switched
    return switched[:-1] if _ends_at_neutral(record, switched) else switched


def _begins_at_neutral(record: Segment, switched: Array) -> bool:
    """Return whether the first crossing is the start of the relay from neutral instead of a switching."""
    if len(switched) < 3 or not record.t_in[0] < switched[0]:
        return False
    one, other = (_held_longest(record, float(a), float(b)) for a, b in itertools.pairwise(switched[:3]))
    before = _held_longest(record, float(record.t_in[0]), float(switched[0]))
    return abs(before - other) > NEUTRAL * abs(one - other)


def _ends_at_neutral(record: Segment, switched: Array) -> bool:
    """Return whether the last crossing is a return to neutral instead of a switching.

    It is if the input is then held at a value that is not the relay's level.
    """
    if len(switched) < 3:
        return False
    end = max(float(record.t_in[-1]), float(record.main.t[-1]))
    same, other = (_held_longest(record, float(a), float(b)) for a, b in itertools.pairwise(switched[-3:]))
    after = _held_longest(record, float(switched[-1]), end)
    return abs(after - same) > NEUTRAL * abs(same - other)


def _held_longest(record: Segment, start: float, end: float) -> float:
    """Return the value at which the input is held for the longest time between *start* and *end*."""
    edges, values = _holds(record, start, end)
    return float(values[int(np.argmax(np.diff(edges)))])


def _holds(record: Segment, start: float, end: float) -> tuple[Array, Array]:
    """Return the times (n + 1,) that bound constant values of the input, and these values (n,)."""
    edges = np.concatenate([[start], record.t_in[(record.t_in > start) & (record.t_in < end)], [end]])
    return edges, record.tau[np.searchsorted(record.t_in, edges[:-1], side="right") - 1]


def _half_periods(t: Array, x: Array, record: Segment, switchings: Array) -> list[HalfPeriod]:
    inside = switchings[(switchings >= t[0]) & (switchings <= t[-1])]
    at = np.interp(inside, t, x)
    halves = []
    for i, (start, end) in enumerate(itertools.pairwise(inside)):
        keep = (t >= start) & (t <= end)
        level = _level(record, float(start), float(end))
        if int(keep.sum()) < 3 or level is None:
            halves.append(HalfPeriod(float(start), float(end), math.nan, math.nan, math.nan, math.nan))
            continue
        low, high = -_peak(t[keep], -x[keep]), _peak(t[keep], x[keep])
        halves.append(HalfPeriod(float(start), float(end), float(at[i]), low, high, level))
    return halves


def _level(record: Segment, start: float, end: float) -> float | None:
    """Return the input's level in a half period, or None if it is not held for four fifths of it."""
    edges, values = _holds(record, start, end)
    held = np.diff(edges)
    level = float(values[int(np.argmax(held))])
    near = np.abs(values - level) <= 2.0 * LEVEL_TOLERANCE * max(abs(level), float(np.ptp(record.tau)) / 2.0)
    return level if float(held[near].sum()) >= 0.8 * (end - start) else None


def _peak(t: Array, x: Array) -> float:
    """Return the maximum of *x*, from a parabola through the samples within an eighth of the stretch."""
    top = int(np.argmax(x))
    near = np.abs(t - t[top]) <= max((t[-1] - t[0]) / 8.0, 1.01 * float(np.median(np.diff(t))))
    if not 0 < top < len(x) - 1 or int(near.sum()) < 3:
        return float(x[top])
    c2, c1, c0 = np.polyfit(t[near] - t[top], x[near], 2)
    reach = float(np.max(np.abs(t[near] - t[top])))
    if c2 >= 0.0 or abs(c1 / (2.0 * c2)) > reach:
        return float(x[top])
    return float(c0 - c1 * c1 / (4.0 * c2))


def _groups(halves: Sequence[HalfPeriod]) -> list[list[HalfPeriod]]:
    """Return the stretches in which the relay alternates between the same two levels."""
    groups: list[list[HalfPeriod]] = [[]]
    for half in halves:
        group = groups[-1]
        change = abs(group[-1].level - half.level) if group else 0.0
        alike = len(group) < 2 or abs(group[-2].level - half.level) <= 2.0 * LEVEL_TOLERANCE * change
        if math.isnan(half.level) or not alike:
            group = [] if math.isnan(half.level) else group[-1:]
            groups.append(group)
        if not math.isnan(half.level):
            group.append(half)
    return [g for g in groups if len(g) >= 2]


def _settled(halves: Sequence[HalfPeriod], x_a: float | None) -> Settled | None:
    """Return the mean of the last periods, five or more if possible.

    The number of periods minimises the scatter divided by the square root of this number. More periods help until they
    include the transient.
    """
    count = len(halves) // 2
    cycles = [cycle_from(halves[-2 * periods :], x_a) for periods in range(min(PERIODS, count), count + 1)]
    if not cycles:
        return None
    best = min(cycles, key=lambda c: c.scatter / math.sqrt(c.periods))
    used = halves[-2 * best.periods :]
    edges = np.array([h.start for h in used[::2]] + [used[-1].end])
    return Settled(best if best.X_m > 0.0 else replace(best, valid=False), edges)
