"""The self-oscillation experiment: relay with hysteresis on heading, depth or (integrated) speed.

Miskovic2010, 6.6: the relay's input is the position of one degree of freedom (heading, depth, or the integral of
surge speed, 6.6.2), its output the actuator. It starts small and grows until the oscillation is proper
(condition (7.12)); it ends when five consecutive periods agree within 10 % (6.7).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from gcs_autotune.craft import Actuate, Command, Observation
from gcs_autotune.identify import LimitCycleMonitor
from gcs_autotune.manoeuvres import relay_words as words
from gcs_autotune.manoeuvres.keeper import HOLDERS, KEEPERS, Keeper
from gcs_autotune.manoeuvres.lead_in import LeadIn
from gcs_autotune.manoeuvres.manoeuvre import Outcome
from gcs_autotune.manoeuvres.relay_settings import RelaySettings
from gcs_autotune.sname import DOFS
from gcs_autotune.trial import Mark
from gcs_autotune.watch import Progress

__all__ = ["Relay", "RelaySettings"]

ENOUGH_TO_TELL = 2
"""Chosen: proper periods after which it is clear how quick an oscillation is."""

MOST_SLOWINGS = 4
"""Chosen: widenings for the link's sake; five times the hysteresis at least."""

WIDEST_STEP = 3.0
"""Chosen: a relay is not widened by more than this at once, whatever the link would like."""

LEAST_MOMENTUM = 5.0
"""Chosen [s]: no craft is said to drift against the relay sooner than this after a switching."""

LEAST_TICKS = 5.0
"""Chosen: ticks per half period below which an improper oscillation is blamed on them and not on a weak relay."""


class Relay:
    """Lead-in (way on, noise measured), then the relay until the limit cycle has settled."""

    in_manual = True

    def __init__(self, settings: RelaySettings, name: str = "relay") -> None:
        self.name = name
        self.outcome: Outcome | None = None
        self._settings = settings
        self._lead_in = LeadIn(settings.signal, needs_way=settings.throttle != 0.0)
        self._marks: list[Mark] = []
        self._output = settings.output if settings.output is not None else settings.first_output
        self._hysteresis = settings.hysteresis or settings.least_hysteresis
        self._monitor = self._new_monitor()
        self._high = True
        self._reference = math.nan
        self._began = math.nan
        self._last_switch = math.nan
        self._improper_periods = 0
        self._judged = 0
        self._switched_once = False
        self._widenings = self._slowings = 0
        self._astray = 0
        self._first_half = self._extreme = math.nan
        self._keepers = [Keeper(gains) for gains in KEEPERS[settings.signal]] if settings.keep_still else []
        holder = HOLDERS.get(settings.signal) if settings.keep_still else None
        self._holder = None if holder is None else Keeper(holder)
        self._integral = 0.0
        self._last_t = self._last_tick = self._tick = math.nan

    @property
    def settings(self) -> Mapping[str, Any]:
        """Settings as flown, for the trial's meta; ``from_t`` is where the relay proper began."""
        s = self._settings
        return {
            "manoeuvre": "relay",
            "purpose": "identification",
            "dof": next(dof.name for dof in DOFS.values() if dof.force == s.force),
            "signal": s.signal,
            "force": s.force,
            "C": self._output,
            "x_a": self._hysteresis,
            "reference": self._reference,
            "throttle": s.throttle,
            "noise_std": self._lead_in.noise_std,
            "speed": self._lead_in.speed,
            "from_t": self._began,
        }

    def start(self, observation: Observation) -> None:
        """Begin the lead-in."""
        self._last_t = observation.t
        self._lead_in.start(observation)

    def update(self, observation: Observation) -> Command:
        """Drive the relay."""
        x = self._watched(observation)
        self._time_ticks(observation.t)
        if not self._lead_in.done:
            self._lead_in.update(observation.t, x, observation.speed)
            return self._command(0.0 if self._holder is None else self._holder.demand(observation), observation)
        if math.isnan(self._began):
            self._begin(observation.t, x)
        self._switch(observation.t, x - self._reference)
        self._judge(observation.t, x - self._reference)
        return self._command(self._output if self._high else -self._output, observation)

    def take_marks(self) -> Sequence[Mark]:
        """Return switchings and growths since the last call."""
        marks, self._marks = self._marks, []
        return marks

    def progress(self, observation: Observation) -> Progress:
        """Return amplitude, periods and scatter so far."""
        s, state = self._settings, self._monitor.state
        return Progress(
            stage="",
            manoeuvre="lead-in" if math.isnan(self._began) else "relay",
            t=observation.t,
            signal=s.signal,
            value=observation.value(s.signal) if s.signal != "x" else observation.u,
            target=self._reference if s.signal != "x" else s.reference_speed,
            output=observation.output.get(s.force, math.nan),
            amplitude=state.cycle.X_m if state.cycle is not None else math.nan,
            periods=state.periods,
            periods_needed=s.periods,
            scatter=state.cycle.scatter if state.cycle is not None else math.nan,
            age=observation.age,
        )

    def _time_ticks(self, t: float) -> None:
        """Keep the mean time between control ticks, of about the last twenty."""
        if math.isfinite(self._last_tick):
            last = t - self._last_tick
            self._tick = last if math.isnan(self._tick) else self._tick + 0.05 * (last - self._tick)
        self._last_tick = t

    def _watched(self, observation: Observation) -> float:
        if self._settings.signal != "x":
            return observation.value(self._settings.signal)
        dt = observation.t - self._last_t
        self._last_t = observation.t
        if math.isfinite(observation.u):
            self._integral += (observation.u - self._settings.reference_speed) * dt
        return self._integral

    def _begin(self, t: float, x: float) -> None:
        self._began = self._last_switch = t
        self._reference = x
        if self._settings.hysteresis is None:
            self._hysteresis = max(self._settings.least_hysteresis, 5.0 * self._lead_in.noise_std)
        self._reset_monitor()
        self._marks.append(Mark(t, "switch", {"x": 0.0, self._settings.force: self._output}))

    def _switch(self, t: float, x: float) -> None:
        wanted = self._high
        if x >= self._hysteresis:
            wanted = False
        elif x <= -self._hysteresis:
            wanted = True
        if wanted != self._high:
            if not self._switched_once:
                self._first_half = t - self._began
            self._high, self._last_switch, self._switched_once, self._extreme = wanted, t, True, x
            sign = 1.0 if wanted else -1.0
            self._marks.append(Mark(t, "switch", {"x": x, self._settings.force: sign * self._output}))

    def _judge(self, t: float, x: float) -> None:
        s = self._settings
        state = self._monitor.update(t, x, self._high)
        if (
            state.periods >= ENOUGH_TO_TELL
            and state.cycle is not None
            and state.cycle.T_H + state.cycle.T_L < s.least_period
        ):
            self._slow_down(t, state.cycle.T_H + state.cycle.T_L)
            return
        if state.settled:
            self.outcome = Outcome("completed", f"{s.periods} periods within {100 * s.tolerance:.0f} %")
            return
        if state.switchings >= self._judged + 2:
            self._judged = state.switchings
            self._improper_periods = 0 if state.proper else self._improper_periods + 1
        if self._went_astray(t, x):
            self._grow(t, (words.overwhelmed if self._switched_once else words.wrong_way)(s, self._output))
        elif t - self._last_switch > s.patience:
            self._grow(t, words.no_oscillation(s, self._output))
        elif self._improper_periods >= 2 and self._outruns_the_ticks():
            too_fast = words.too_fast(self._output, LEAST_TICKS, self._tick)
            self._settle(t) if self._may_widen() else self._give_up(too_fast)
        elif self._improper_periods >= 2:
            self._grow(t, words.improper(self._output))
        elif state.switchings >= 2 * s.unsettled_periods and self._may_widen():
            self._settle(t)
        elif state.switchings >= 2 * s.most_periods:
            self._give_up(words.never_settled(s, state.cycle.scatter if state.cycle is not None else math.nan))

    def _grow(self, t: float, otherwise: str) -> None:
        """Make the relay larger; when it may not grow, give up with the reason *otherwise*."""
        s = self._settings
        if s.output is not None or self._output >= s.most_output:
            self._give_up(otherwise)
            return
        self._output = min(self._output * s.growth, s.most_output)
        self._last_switch, self._improper_periods = t, 0
        self._reset_monitor()
        self._marks.append(Mark(t, "grow", {"C": self._output}))
        sign = 1.0 if self._high else -1.0
        self._marks.append(Mark(t, "switch", {s.force: sign * self._output}))

    def _give_up(self, reason: str) -> None:
        self.outcome = Outcome("aborted", reason)

    def _outruns_the_ticks(self) -> bool:
        """Whether the craft swings through the hysteresis within a few control ticks: a larger relay makes it worse."""
        cycle = self._monitor.state.cycle
        return cycle is not None and 0.5 * (cycle.T_H + cycle.T_L) < LEAST_TICKS * self._tick

    def _may_widen(self) -> bool:
        return self._settings.hysteresis is None and self._widenings < self._settings.most_widenings

    def _settle(self, t: float) -> None:
        """Widen an oscillation that does not settle, or that is over within a few ticks."""
        self._widenings += 1
        self._widen(t, self._settings.growth)

    def _slow_down(self, t: float, period: float) -> None:
        """The link cannot carry an oscillation of this *period* [s]: make it wider and so slower, or give up."""
        if self._settings.hysteresis is None and self._slowings < MOST_SLOWINGS:
            self._slowings += 1
            self._widen(t, min(max(self._settings.least_period / period, self._settings.growth), WIDEST_STEP))
        else:
            self._give_up(words.link_too_slow(self._settings, period))

    def _widen(self, t: float, factor: float) -> None:
        """Make the oscillation larger and slower: late switchings on a jittery link then matter less."""
        self._hysteresis *= factor
        self._improper_periods = 0
        self._reset_monitor()
        self._marks.append(Mark(t, "widen", {"x_a": self._hysteresis}))

    def _reset_monitor(self) -> None:
        self._judged = 0
        self._monitor = self._new_monitor()

    def _new_monitor(self) -> LimitCycleMonitor:
        s = self._settings
        return LimitCycleMonitor(self._output, self._hysteresis, periods=s.periods, scatter=s.tolerance)

    def _went_astray(self, t: float, x: float) -> bool:
        """Whether the craft moves away from where the relay pushes it, for longer than momentum explains."""
        if not self._switched_once:
            astray = x < -(2.0 + self._astray) * self._hysteresis
            self._astray += astray
            return astray
        away = x > self._extreme if not self._high else x < self._extreme
        if away:
            self._extreme = x
        return away and t - self._last_switch > max(3.0 * self._first_half, LEAST_MOMENTUM)

    def _command(self, output: float, observation: Observation) -> Command:
        s = self._settings
        command = Actuate(X=s.throttle)
        for keeper in self._keepers:
            command = replace(command, **{keeper.force: keeper.demand(observation)})
        return replace(command, **{s.force: getattr(command, s.force) + output})
