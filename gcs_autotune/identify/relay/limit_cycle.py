"""Limit cycles: the mean cycle of a relay experiment, and a monitor that tells when to stop one.

Miskovic2010, 6.6-6.7: extremes and durations of every half period, the real switching value (6.5), condition (7.12)
for every period, and the stop rule: five consecutive periods whose maxima and minima scatter within 10 %.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gcs_autotune.identify.relay.describing_function import is_valid
from gcs_autotune.identify.result import LimitCycle

__all__ = ["PERIODS", "SCATTER", "HalfPeriod", "LimitCycleMonitor", "MonitorState", "cycle_from"]

PERIODS = 5
"""Consecutive periods the stop rule asks for, Miskovic2010, 6.7."""

SCATTER = 0.10
"""Largest standard deviation of maxima and of minima, as a fraction of the amplitude, Miskovic2010, 6.7."""


@dataclass(frozen=True, slots=True)
class HalfPeriod:
    """From one switching to the next: times [s], the position when it began, its extremes, the input's level."""

    start: float
    end: float
    at_switch: float
    low: float
    high: float
    level: float

    @property
    def duration(self) -> float:
        """Seconds."""
        return self.end - self.start


def cycle_from(halves: Sequence[HalfPeriod], x_a: float | None = None) -> LimitCycle:
    """Return the mean limit cycle of an even number (two or more) of consecutive half periods.

    Switching values are measured from their own middle, so the reference need not be known; ``valid`` holds
    only when every single period satisfies (7.12).
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


def _is_proper(pair: Sequence[HalfPeriod], middle: float) -> bool:
    """Miskovic2010, eq. (7.12) for one period."""
    low, high = min(h.low for h in pair), max(h.high for h in pair)
    x_a = 0.5 * abs(pair[0].at_switch - pair[1].at_switch)
    return is_valid(0.5 * (high - low), x_a, 0.5 * (high + low) - middle)


@dataclass(frozen=True, slots=True)
class MonitorState:
    """What is known so far.

    ``switchings`` counted in all; ``periods`` consecutive proper periods at present (0 after one that broke
    (7.12), which clears the registers); ``settled`` the stop rule; ``proper`` whether the last full period
    satisfied (7.12) (True before the first); ``cycle`` the mean over the latest periods, None before the first.
    """

    switchings: int
    periods: int
    settled: bool
    proper: bool
    cycle: LimitCycle | None


class LimitCycleMonitor:
    """Follows a relay sample by sample.

    Parameters
    ----------
    C : relay output [input units], half the distance between its two positions.
    x_a : set switching value [rad or m].
    periods, scatter : the stop rule.
    """

    def __init__(self, C: float, x_a: float, *, periods: int = PERIODS, scatter: float = SCATTER) -> None:
        self._C, self._x_a = C, x_a
        self._needed, self._scatter = periods, scatter
        self._halves: list[HalfPeriod] = []
        self._relay: bool | None = None
        self._start = self._at_switch = self._low = self._high = math.nan
        self._state = MonitorState(0, 0, False, True, None)

    @property
    def state(self) -> MonitorState:
        """The state after the last update."""
        return self._state

    def update(self, t: float, x: float, relay_high: bool) -> MonitorState:
        """Take one sample: time [s], the relay's input *x* of either sign, and the relay's position now.

        *x* must be continuous (an angle unwrapped or relative to the reference). Call it after the relay has
        decided, so that the sample at which it switched is the first of the new half period. Samples that
        are not finite are ignored.
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
        """Close the running half period and begin the next."""
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
        proper = cycle_from(self._halves[-2:], self._x_a).valid
        cycle = self._seen_from_relay(cycle_from(self._halves[-2 * whole :], self._x_a))
        if not proper:
            self._halves.clear()
            return MonitorState(switchings, 0, False, False, cycle)
        settled = whole >= self._needed and cycle.scatter <= self._scatter and cycle.valid
        return MonitorState(switchings, whole, settled, True, cycle)

    def _seen_from_relay(self, cycle: LimitCycle) -> LimitCycle:
        """Mirror a cycle whose *x* falls when the position rises, so that ``C`` keeps the sign it was given."""
        if cycle.C * self._C >= 0.0:
            return cycle
        return replace(cycle, C=-cycle.C, x_0=-cycle.x_0, T_H=cycle.T_L, T_L=cycle.T_H)
