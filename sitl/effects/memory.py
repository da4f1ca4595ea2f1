"""Actuator effects whose output depends on earlier commands. Each one acts on one input."""

from __future__ import annotations

import math
from collections import deque

from sitl.effects.actuator import OnInput
from sitl.effects.effect import EffectParameter, Setting

__all__ = ["ActuatorLag", "Backlash", "InputDelay", "RateLimit"]


class InputDelay(OnInput):
    """Delayed command. The first command acts from the beginning."""

    slug = "input-delay"
    meaning = "commands act with a delay"
    parameters = (EffectParameter("delay", "s", least=0.0),)

    def begin(self, setting: Setting) -> None:
        """Find the input, and clear the delayed commands."""
        super().begin(setting)
        self._due: deque[tuple[float, float]] = deque()
        """Delayed commands as (time [s] at which the command begins to act, command), oldest first."""
        self._last = math.nan

    def act(self, t: float, dt: float, u: float) -> float:
        """Return the mean of the delayed command between *t* and *t + dt* [s]."""
        due = self._due
        if u != self._last:
            due.append((t + self["delay"] if due else -math.inf, u))
            self._last = u
        end = t + dt
        while len(due) > 1 and due[1][0] <= t:
            due.popleft()
        if len(due) == 1 or due[1][0] >= end:
            return due[0][1]
        total, since, value = 0.0, t, due[0][1]
        for when, following in list(due)[1:]:
            if when >= end:
                break
            total += value * (when - since)
            since, value = when, following
        return (total + value * (end - since)) / dt


class ActuatorLag(OnInput):
    """First-order lag between the command and the output."""

    slug = "actuator-lag"
    meaning = "the actuator follows its command with a time constant"
    parameters = (EffectParameter("time_constant", "s", least=1e-6),)

    def begin(self, setting: Setting) -> None:
        """Find the input, and reset the output."""
        super().begin(setting)
        self._now = math.nan

    def act(self, t: float, dt: float, u: float) -> float:
        """Return the mean over the step of the exact response to the command *u*."""
        if self._now != self._now:
            self._now = u
        ratio = dt / self["time_constant"]
        rest = self._now - u
        self._now = u + rest * math.exp(-ratio)
        return u - rest * math.expm1(-ratio) / ratio


class RateLimit(OnInput):
    """Limited rate of change of the output."""

    slug = "rate-limit"
    meaning = "the actuator moves at a limited rate"
    parameters = (EffectParameter("rate", "input unit/s", least=1e-9),)

    def begin(self, setting: Setting) -> None:
        """Find the input, and reset the output."""
        super().begin(setting)
        self._now = math.nan

    def act(self, t: float, dt: float, u: float) -> float:
        """Move the output towards *u* within the rate limit. Return its mean over the step."""
        if self._now != self._now:
            self._now = u
        gap = u - self._now
        if gap == 0.0:
            return u
        needed = abs(gap) / self["rate"]
        if needed <= dt:
            self._now = u
            return u - 0.5 * gap * needed / dt
        before = self._now
        self._now += gap * dt / needed
        return 0.5 * (before + self._now)


class Backlash(OnInput):
    """Backlash: the output stays at rest until the command has crossed the gap."""

    slug = "backlash"
    meaning = "backlash in the linkage: after each reversal the command first crosses the gap"
    parameters = (EffectParameter("width", "input unit", "full width of the gap", least=0.0),)

    def begin(self, setting: Setting) -> None:
        """Find the input, and reset the output."""
        super().begin(setting)
        self._now = math.nan

    def act(self, t: float, dt: float, u: float) -> float:
        """Return the output: moved if the command *u* has crossed the gap, otherwise unchanged."""
        half = 0.5 * self["width"]
        if self._now != self._now:
            self._now = u
        self._now = min(max(self._now, u - half), u + half)
        return self._now
