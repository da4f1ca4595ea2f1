"""Relays on the autopilot's set-point: the commanded heading, depth or speed jumps (Miskovic2010, 6.6.4).

The relay is outside the closed loop, psi_ref = psi_0 +- C. It switches when the heading passes x_a on either side. Two
relays of different size identify the closed loop, (6.49), without driving an actuator directly.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

from gcs_autotune.axes import AXES, AxisKind
from gcs_autotune.craft import Command, Observation, set_point
from gcs_autotune.errors import UsageError
from gcs_autotune.manoeuvres.approach import LONGEST_TIME, Approach, Part
from gcs_autotune.manoeuvres.kind import ManoeuvreKind, of_loop
from gcs_autotune.manoeuvres.manoeuvre import Commands, Manoeuvre, Outcome
from gcs_autotune.sname import SIGNALS

if TYPE_CHECKING:
    from gcs_autotune.identify.relay import LimitCycleMonitor

__all__ = ["KIND", "SetPointRelay"]

PERIODS, MOST_PERIODS = 5, 15
"""Number of consecutive periods that must agree (Miskovic2010, 6.7), and number of periods after which an unsettled
relay ends.
"""
LONGEST, LEAST_SWITCHINGS = 110.0, 6
"""Time [s] and number of switchings after which an unsettled relay ends anyway, because a boat keeps moving. Project
choice."""
SWOLLEN, HELD_PERIODS, LONGEST_HOLD = 3.0, 2.5, 75.0
"""Limit of the ratio of motion to command, and the following hold of the command in periods and its longest time
[s].

A larger motion shows that the loop is poorly damped. The command is then held. An oscillation that persists during the
hold is caused by the loop itself. Project choice.
"""
NOISES = 5.0
"""Motion, in standard deviations of the noise, below which it does not count as an oscillation. Project choice."""
LASTS = 0.6
"""Fraction of an oscillation that may remain after one and a half periods of a constant command.

If more remains, the oscillation counts as persistent. A damping ratio of 0.05 leaves 0.62. Project choice.
"""
PATIENCE = 60.0
"""Time [s] after which a loop counts as not following the command, if the heading has not passed x_a. Project
choice.
"""


class SetPointRelay(Manoeuvre):
    """A manoeuvre that holds the course, then flies each of ``relays`` (C, x_a) [SI, rad] until its oscillation has
    settled.

    ``axis``: the commanded quantity: heading, depth or speed. ``speed`` [m/s]: speed ahead, which is the maximum of a
    relay on speed. If the motion is much larger than the command, the command is then held constant, to show whether
    the motion decays. Marks: ``relay`` at its start, ``switch`` with the command, ``hold`` when the command is held.
    """

    kind, purpose, in_manual = "set-point-relay", "check", False

    def __init__(
        self,
        relays: tuple[tuple[float, float], ...],
        speed: float = 0.0,
        name: str = "",
        axis: AxisKind = AXES["heading"],
    ) -> None:
        super().__init__(name, signal=axis.stepped, force=axis.names.force)
        self._relays, self._speed, self._axis = relays, speed, axis
        self._approach = Approach(self.signal, needs_way=speed > 0.0)
        self._course, self._base = math.nan, math.nan
        self._unsettled = 0
        self._flown, self._switchings = 0, 0
        self._period, self._swollen = math.nan, False
        self.at_most = LONGEST_TIME * (speed > 0.0) + LONGEST * len(relays) + LONGEST_HOLD
        for C, x_a in relays:
            if not 0.0 < x_a < C:
                raise UsageError(
                    f"with a relay of {self._size_text(C)} the {axis.name} may never cross {self._size_text(x_a)}. "
                    "Use a --hysteresis below --set-point"
                )
        most = max(C for C, _ in relays)
        self._middle = speed - most  # faster than its cruise an autopilot need not let itself be commanded
        if axis.controls_velocity and 0.0 < speed <= 2.0 * most:
            raise UsageError(
                f"a relay of {self._size_text(most)} about {self._middle:g} m/s reaches zero speed. "
                "Use a smaller --set-point, or more --speed"
            )

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Relays, speed, and noise of the controlled signal by name, for the trial's ``meta``."""
        return {
            "dof": self._axis.dof,
            "signal": self.signal,
            "set_points": [C for C, _ in self._relays],
            "hystereses": [x_a for _, x_a in self._relays],
            "speed": self._approach.speed,
            "noise_std": self._approach.noise_std,
        }

    def commands(self, now: Observation) -> Commands:
        """Yield the commands to hold the course, then the relays about it."""
        self.phase, self._course = "approach", now.psi
        self._base = self._middle if self._axis.controls_velocity else now.value(self.signal)
        self._approach.start(now)
        while not self._approach.done:
            self._approach.update(now.t, now.value(self.signal), now.speed)
            now = yield self._wanted(0.0)
        for number, (C, x_a) in enumerate(self._relays, start=1):
            now = yield from self._swung(number, C, x_a, now)
            if self.outcome is None and self._swollen:
                now = yield from self._held(now)
            if self.outcome is not None:
                break
        else:
            rest = (
                f", of which {self._unsettled} did not settle: the loop is poorly damped, or waves disturb it"
                if self._unsettled
                else " settled"
            )
            self._end("completed", f"{len(self._relays)} relays about the {self._about}{rest}")
        yield self._wanted(0.0)

    def where_room_ends(self, where: str) -> Outcome | None:
        """Return the outcome "stopped" if a relay has switched often enough to show the damping of the loop;
        else None.
        """
        if self._switchings < LEAST_SWITCHINGS:
            return None
        which = "the last relay" if self._flown == len(self._relays) else f"relay {self._flown}"
        stopped = f"out of space, not settled after {self._switchings} reversals of {which}: {where}"
        return Outcome("stopped", f"{stopped}. The record so far is used")

    @property
    def _about(self) -> str:
        return "course" if SIGNALS[self.signal].wraps else self._axis.name

    def _size_text(self, size: float) -> str:
        return f"{math.degrees(size):g} deg" if self._axis.angular else f"{size:g} {SIGNALS[self.signal].unit}"

    def _wanted(self, change: float) -> Command:
        """Return the command that the relay oscillates about, plus *change*."""
        self.target = self._base + change
        return set_point(self.signal, self.target, course=self._course, speed=self._speed)

    def _held(self, now: Observation) -> Part:
        """Hold that command for some periods. End early if the oscillation continues."""
        start, period, seen = now.t, self._period, []
        self.phase = "holding"
        self._mark(now.t, "hold", {f"{self.signal}_ref": self._base})
        while now.t - start < min(HELD_PERIODS * period, LONGEST_HOLD):
            seen.append((now.t, now.value(self.signal)))
            now = yield self._wanted(0.0)
        first = [x for t, x in seen if t < start + period]
        last = [x for t, x in seen if t > now.t - period]
        amplitude = 0.5 * (max(last) - min(last))
        if amplitude > LASTS * 0.5 * (max(first) - min(first)) and amplitude > NOISES * self._approach.noise_std:
            self._mark(now.t, "oscillation", {"amplitude": amplitude, "period": period})
            self._end(
                "completed",
                f"the loop oscillates without a relay, amplitude {self._size_text(float(f'{amplitude:.3g}'))}",
            )
        self._swollen = False
        return now

    def _swung(self, number: int, C: float, x_a: float, now: Observation) -> Part:
        """Fly one relay until it has settled."""
        monitor, high, switched, began = _monitor(C, x_a), True, now.t, now.t
        commanded = f"{self.signal}_ref"
        self._flown, self._switchings = number, 0
        self.phase = f"relay {number}"
        self._mark(now.t, "relay", {"C": C, "x_a": x_a})
        self._mark(now.t, "switch", {commanded: self._base + C})
        while True:
            x = now.value(self.signal) - self._base
            if x >= x_a if high else x <= -x_a:
                high, switched = not high, now.t
                self._mark(now.t, "switch", {commanded: self._base + (C if high else -C)})
            state = monitor.update(now.t, x, high)
            self._switchings = state.switchings
            command = self._wanted(C if high else -C)
            late = now.t - began > LONGEST and state.switchings >= LEAST_SWITCHINGS
            cycle = state.cycle
            if cycle is not None:
                self._period = cycle.T_H + cycle.T_L
                self._swollen = state.switchings >= LEAST_SWITCHINGS and cycle.X_m > SWOLLEN * C
            if state.settled or late or self._swollen or state.switchings >= 2 * MOST_PERIODS:
                self._unsettled += not state.settled
                return now
            if now.t - switched > PATIENCE:
                self._end(
                    "aborted",
                    f"the loop does not follow: with {self._size_text(C)} commanded to one side, the {self._axis.name} "
                    f"did not cross {self._size_text(x_a)} within {PATIENCE:.0f} s",
                )
                return now
            now = yield command


def _monitor(C: float, x_a: float) -> LimitCycleMonitor:
    from gcs_autotune.identify.relay import LimitCycleMonitor  # a second to import, which the table need not take

    return LimitCycleMonitor(C, x_a, periods=PERIODS)


_ROOM: Mapping[str, str] = {
    "depth": "the depth of the set-point steps to either side",
    "speed": "straight ahead at cruise speed",
}


def _make(axis: AxisKind, options: Mapping[str, float]) -> SetPointRelay:
    pairs = (("set-point", "hysteresis"), ("second-set-point", "second-hysteresis"))
    relays = tuple((options[C], options[x_a]) for C, x_a in pairs)
    return SetPointRelay(relays, options.get("speed", 0.0), axis=axis)


def _row(axis: AxisKind) -> ManoeuvreKind:
    return ManoeuvreKind(
        name="set-point-relay",
        help=f"set-point relay: the commanded {axis.name} steps to either side. The steps have two sizes, and the "
        "autopilot's own loop follows them",
        excites=frozenset({axis.dof}),
        drives=frozenset(),
        make=partial(_make, axis),
        options=("set-point", "hysteresis", "second-set-point", "second-hysteresis"),
        room=_ROOM.get(axis.name, "at the spot; a boat keeps its cruise speed"),
        identifies=False,
        shrinks={"set-point": 1.0, "hysteresis": 1.0, "second-set-point": 1.0, "second-hysteresis": 1.0},
        axis=axis.name,
        for_force=partial(of_loop, _row),
    )


KIND = _row(AXES["heading"])
