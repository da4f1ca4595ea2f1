"""The self-oscillation experiment: a relay with hysteresis on heading, depth or integrated speed.

According to Miskovic2010, 6.6, the relay's input is the position of one degree of freedom: heading, depth, or the
integral of surge or sway speed (6.6.2). Its output is the actuator. The output starts small and grows until the
oscillation fulfils condition (7.12). The relay ends when five consecutive periods agree within 10 % (6.7).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Protocol

from gcs_autotune.craft import Actuate, Command, Observation
from gcs_autotune.manoeuvres import relay_messages as messages
from gcs_autotune.manoeuvres.approach import Approach
from gcs_autotune.manoeuvres.hold_controller import HELD_BEFORE, HELD_DURING, HoldController, hold
from gcs_autotune.manoeuvres.manoeuvre import Commands, Manoeuvre, Outcome
from gcs_autotune.manoeuvres.relay_settings import RelaySettings
from gcs_autotune.observer import Progress
from gcs_autotune.sname import DOFS

if TYPE_CHECKING:
    from gcs_autotune.identify.relay import LimitCycleMonitor

__all__ = ["LEAST_REVERSALS", "Relay", "StopCriterion", "WallRelay"]

INTEGRATED: Mapping[str, str] = {"x": "u", "y": "v"}
"""Position signal of a relay -> the speed whose integral is used in its place."""

LEAST_PERIODS = 2
"""Number of proper periods, as in (7.12), after which the period of an oscillation counts as known. Project choice."""

LEAST_REVERSALS = 3
"""Smallest number of switchings from which the response in both directions is known. Project choice."""

MOST_SLOWINGS = 4
"""Largest number of increases of the hysteresis for a slow link; together they are at least a factor of five. Project
choice.
"""

WIDEST_STEP = 3.0
"""Largest factor by which the hysteresis is increased at once, even if the link requires more. Project choice."""

LEAST_MOMENTUM = 5.0
"""Shortest time [s] after a switching before drift against the relay is reported. Project choice."""

ROUNDING = 1e-9
"""Tolerance [m] in a comparison with the hysteresis, for the rounding of two readings to centimetres."""

LEAST_TICKS = 5.0
"""Ticks per half period below which an oscillation that violates (7.12) is attributed to the control rate instead of a
weak relay. Project choice.
"""


class StopCriterion(Protocol):
    """A criterion that ends a relay before its periods agree, once the record is sufficient. It is evaluated at every
    tick.

    Attributes
    ----------
    counted_to : the vehicle's time [s] up to which the record counts when it ended the relay; NaN for its end.
    """

    counted_to: float

    def begin(self) -> None:
        """Reset the criterion, because the oscillation starts, or starts again with another size."""
        ...

    def update(self, relay: Relay, reversals: int) -> str:
        """Return why *relay* may end after *reversals* switchings, or an empty text. It must return at once."""
        ...


class Relay(Manoeuvre):
    """Fly an approach (gain speed, measure noise), then the relay, until its periods agree or *criterion* is met."""

    kind = "relay"

    def __init__(self, settings: RelaySettings, name: str = "relay", criterion: StopCriterion | None = None) -> None:
        super().__init__(name, signal=settings.signal, force=settings.force)
        self._settings = settings
        self._approach = Approach(settings.signal, needs_way=settings.throttle != 0.0)
        self._output = settings.output if settings.output is not None else settings.first_output
        self._hysteresis = settings.hysteresis or settings.least_hysteresis
        self._monitor = self._new_monitor()
        self._criterion, self._enough = criterion, False
        self._counted_to = math.nan
        if settings.noise_std is not None:
            self._approach.skip(settings.noise_std)
        self._high = True
        self._reference = math.nan
        self._began = math.nan
        self._last_switch = math.nan
        self._improper_periods = 0
        self._judged = 0
        self._switched_once = False
        self._widenings = self._slowings = 0
        self._astray = self._reversals = 0
        self._first_half = self._extreme = math.nan
        self._holds = [HoldController(g) for g in HELD_DURING[settings.signal]] if settings.keep_still else []
        before = HELD_BEFORE.get(settings.signal) if settings.keep_still else None
        self._before = None if before is None else HoldController(before)
        self._integral = 0.0
        self._last_t = self._last_tick = self._tick_time = math.nan

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Settings as flown, by name, for the trial's ``meta``. ``from_t``: time [s] at which the relay itself began.
        ``enough``: whether the caller's criterion ended the relay, so that a small number of periods is expected.
        """
        s = self._settings
        return {
            "dof": next(dof.name for dof in DOFS.values() if dof.force == s.force),
            "signal": s.signal,
            "force": s.force,
            "C": self._output,
            "x_a": self._hysteresis,
            "reference": self._reference,
            "throttle": s.throttle,
            "noise_std": self._approach.noise_std,
            "speed": self._approach.speed,
            "from_t": self._began,
            "enough": self._enough,
            **({"to_t": self._counted_to} if math.isfinite(self._counted_to) else {}),
        }

    def commands(self, now: Observation) -> Commands:
        """Yield the commands of the approach, then those of the relay."""
        self._last_t = now.t
        self._approach.start(now)
        while True:
            now = yield self._tick(now)

    def _tick(self, observation: Observation) -> Command:
        x = self._watched(observation)
        if self._settings.signal == "d" and not -x >= self._settings.least_distance:
            self._give_up(messages.no_wall(-x, self._settings.least_distance))
            return self._command(0.0, observation)
        self._time_ticks(observation.t)
        if not self._approach.done:
            self._approach.update(observation.t, x, observation.speed)
            return self._command(0.0 if self._before is None else self._before.demand(observation), observation)
        if math.isnan(self._began):
            self._begin(observation.t, x)
        self._switch(observation.t, x - self._reference)
        self._judge(observation.t, x - self._reference)
        return self._command(self._output if self._high else -self._output, observation)

    def where_room_ends(self, where: str) -> Outcome | None:
        """Return the outcome "stopped" if the record shows the response in both directions; else None, and the relay
        continues up to the limit.
        """
        if self._reversals < LEAST_REVERSALS:
            return None
        return Outcome("stopped", messages.room_ends(self._reversals, where))

    def progress(self, observation: Observation) -> Progress:
        """Return the progress with amplitude, periods and scatter of the oscillation so far."""
        s, state = self._settings, self._monitor.state
        along = s.signal in INTEGRATED
        return replace(
            super().progress(observation),
            manoeuvre="approach" if math.isnan(self._began) else "relay",
            value=observation.value(INTEGRATED.get(s.signal, s.signal)),
            target=s.reference_speed if along else self._reference,
            amplitude=state.cycle.X_m if state.cycle is not None else math.nan,
            periods=state.periods,
            periods_needed=s.periods,
            scatter=state.cycle.scatter if state.cycle is not None else math.nan,
        )

    def _time_ticks(self, t: float) -> None:
        """Update the mean time between control ticks over about the last twenty."""
        if math.isfinite(self._last_tick):
            last = t - self._last_tick
            self._tick_time = last if math.isnan(self._tick_time) else self._tick_time + 0.05 * (last - self._tick_time)
        self._last_tick = t

    def _watched(self, observation: Observation) -> float:
        if self._settings.signal == "d":
            return -observation.d  # ahead is nearer
        if self._settings.signal not in INTEGRATED:
            return observation.value(self._settings.signal)
        dt = observation.t - self._last_t
        self._last_t = observation.t
        speed = observation.value(INTEGRATED[self._settings.signal])
        if math.isfinite(speed):
            self._integral += (speed - self._settings.reference_speed) * dt
        return self._integral

    def _begin(self, t: float, x: float) -> None:
        self._began = self._last_switch = t
        self._reference = x
        if self._settings.hysteresis is None:
            self._hysteresis = max(self._settings.least_hysteresis, 5.0 * self._approach.noise_std)
        self._reset_monitor()
        self._mark(t, "switch", {"x": 0.0, self._settings.force: self._output})

    def _switch(self, t: float, x: float) -> None:
        wanted = self._high
        if x >= self._hysteresis - ROUNDING:
            wanted = False
        elif x <= -self._hysteresis + ROUNDING:
            wanted = True
        if wanted != self._high:
            if not self._switched_once:
                self._first_half = t - self._began
            self._high, self._last_switch, self._switched_once, self._extreme = wanted, t, True, x
            self._reversals += 1
            sign = 1.0 if wanted else -1.0
            self._mark(t, "switch", {"x": x, self._settings.force: sign * self._output})

    def _judge(self, t: float, x: float) -> None:
        s = self._settings
        state = self._monitor.update(t, x, self._high)
        if (
            state.periods >= LEAST_PERIODS
            and state.cycle is not None
            and state.cycle.T_H + state.cycle.T_L < s.least_period
        ):
            self._slow_down(t, state.cycle.T_H + state.cycle.T_L)
            return
        enough = self._met_criterion()
        if enough:
            self._end("completed", enough)
            return
        if state.switchings >= self._judged + 2:
            self._judged = state.switchings
            self._improper_periods = 0 if state.proper else self._improper_periods + 1
        if self._diverged(t, x):
            self._grow(t, (messages.overwhelmed if self._switched_once else messages.wrong_way)(s, self._output))
        elif t - self._last_switch > s.patience:
            self._grow(t, messages.no_oscillation(s, self._output))
        elif self._improper_periods >= 2 and self._outruns_the_ticks():
            too_fast = messages.too_fast(s, self._output, LEAST_TICKS, self._tick_time)
            self._settle(t) if self._may_widen() else self._give_up(too_fast)
        elif self._improper_periods >= 2:
            self._grow(t, messages.improper(s, self._output))
        elif state.switchings >= 2 * s.unsettled_periods and self._may_widen():
            self._settle(t)
        elif state.switchings >= 2 * s.most_periods:
            self._give_up(messages.never_settled(s, state.cycle.scatter if state.cycle is not None else math.nan))

    def _met_criterion(self) -> str:
        """Return the text of the stop criterion that is met; empty if none is.

        There are two: the caller's criterion, if any, and agreement of the periods.
        """
        s, criterion, state = self._settings, self._criterion, self._monitor.state
        enough = criterion.update(self, state.switchings) if criterion is not None and state.proper else ""
        if criterion is not None and enough:
            self._enough, self._counted_to = True, criterion.counted_to
        return enough or (f"{s.periods} periods within {100 * s.tolerance:.0f} %" if state.settled else "")

    def _grow(self, t: float, otherwise: str) -> None:
        """Increase the relay output. If the limit is reached, give up with the reason *otherwise*."""
        s = self._settings
        if s.output is not None or self._output >= s.most_output:
            self._give_up(otherwise)
            return
        self._output = min(self._output * s.growth, s.most_output)
        self._last_switch, self._improper_periods = t, 0
        self._reset_monitor()
        self._mark(t, "grow", {"C": self._output})
        sign = 1.0 if self._high else -1.0
        self._mark(t, "switch", {s.force: sign * self._output})

    def _give_up(self, reason: str) -> None:
        self._end("aborted", reason)

    def _outruns_the_ticks(self) -> bool:
        """Return whether the craft crosses the hysteresis within a few control ticks.

        A larger relay would make this worse.
        """
        cycle = self._monitor.state.cycle
        return cycle is not None and 0.5 * (cycle.T_H + cycle.T_L) < LEAST_TICKS * self._tick_time

    def _may_widen(self) -> bool:
        return self._settings.hysteresis is None and self._widenings < self._settings.most_widenings

    def _settle(self, t: float) -> None:
        """Increase the hysteresis if an oscillation does not settle or half its period lasts only a few ticks."""
        self._widenings += 1
        self._widen(t, self._settings.growth)

    def _slow_down(self, t: float, period: float) -> None:
        """Increase the hysteresis, and so the period, because the link is too slow for this *period* [s]; or give
        up."""
        if self._settings.hysteresis is None and self._slowings < MOST_SLOWINGS:
            self._slowings += 1
            self._widen(t, min(max(self._settings.least_period / period, self._settings.growth), WIDEST_STEP))
        else:
            self._give_up(messages.link_too_slow(self._settings, period))

    def _widen(self, t: float, factor: float) -> None:
        """Make the oscillation larger and slower, so that late switchings on a jittery link matter less."""
        self._hysteresis *= factor
        self._improper_periods = 0
        self._reset_monitor()
        self._mark(t, "widen", {"x_a": self._hysteresis})

    def _reset_monitor(self) -> None:
        self._judged = 0
        self._monitor = self._new_monitor()
        if self._criterion is not None:
            self._criterion.begin()

    def _new_monitor(self) -> LimitCycleMonitor:
        from gcs_autotune.identify.relay import LimitCycleMonitor  # a second to import, which the table need not take

        s = self._settings
        noise = self._approach.noise_std
        return LimitCycleMonitor(self._output, self._hysteresis, periods=s.periods, scatter=s.tolerance, noise=noise)

    def _diverged(self, t: float, x: float) -> bool:
        """Return whether the craft moves against the relay for longer than its momentum explains."""
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
        command = hold(Actuate(X=s.throttle), self._holds, observation)
        return replace(command, **{s.force: getattr(command, s.force) + output})


class WallRelay(Relay):
    """A relay on the distance to a wall ahead of the craft."""

    kind = "wall-relay"
