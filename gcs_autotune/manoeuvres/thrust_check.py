"""Check before throttle manoeuvres that a thrust pulse ahead moves the craft ahead.

A reversed propeller would drive a boat backwards into its mooring; a dead thruster of two would turn it on the spot.
The pulse is ahead only, since many boats cannot go astern. It starts from rest with neutral steering, so that only the
propeller acts.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gcs_autotune.craft import Actuate, Command, Observation
from gcs_autotune.manoeuvres import sign_messages as messages
from gcs_autotune.manoeuvres.hold_controller import HELD_DURING, HoldController, hold
from gcs_autotune.manoeuvres.manoeuvre import Commands, Manoeuvre
from gcs_autotune.manoeuvres.pulse_response import FOLLOWS, Pulse
from gcs_autotune.manoeuvres.sign_check import NOISES, STANDING
from gcs_autotune.manoeuvres.sign_messages import Outlet

__all__ = ["ThrustCheck", "ThrustCheckSettings"]

WINDOW = 3.0
"""Time [s] at rest over which speed and its noise are measured."""
STILL = 0.04
"""Largest change of speed [m/s] between the halves of the window, at rest or in steady drift. Project choice."""
LONGEST_REST = 30.0
"""Longest wait for rest [s]; after this time the check begins anyway. Project choice."""
UNKNOWN = 12.0
"""Time [s] without a speed reading after which the vehicle counts as reporting no speed. Project choice."""
SHORTEST = 1.5
"""Shortest duration of a pulse [s]. The throttle is slew-limited, by default 1 s from none to full. Project choice."""
AT_ONCE, FAR_TOO_MUCH = 0.6, 3.0
"""Duration [s] after which a pulse may end early, and the multiple of the intended speed at which it does. Project
choice."""
LAST = 0.5
"""Time [s] at the end of the pulse over which the gained speed is averaged. Project choice."""


@dataclass(frozen=True, slots=True)
class ThrustCheckSettings:
    """Settings: outputs normalised, times s, speeds m/s, angles rad.

    Attributes
    ----------
    outputs : sizes of the pulse, tried until one has a response.
    reach : gained speed that ends a pulse; otherwise it ends after ``longest``.
    least : smallest speed gained that counts as a response.
    turned : turn under thrust alone, in excess of the drift, that indicates a fault on one side.
    cure, crooked : advice if the craft goes astern, or turns.
    outlets : the servo outputs that drive the thrust, for messages.
    """

    outputs: tuple[float, ...] = (0.25, 0.5)
    reach: float = 0.3
    least: float = 0.06
    longest: float = 8.0
    turned: float = math.radians(60.0)
    keep_still: bool = False
    cure: str = "check SERVOn_REVERSED or MOT_n_DIRECTION"
    crooked: str = "check the propellers, their directions and the trim"
    outlets: tuple[Outlet, ...] = ()


class ThrustCheck(Manoeuvre):
    """Wait at rest (measure speed, noise and idle output), then give thrust pulses ahead until the craft has responded
    to one.
    """

    kind, purpose = "sign-check", "check"

    def __init__(self, settings: ThrustCheckSettings) -> None:
        super().__init__(signal="u", force="X")
        self.answer: Pulse | None = None
        self._settings = settings
        self._holds = [HoldController(gains) for gains in HELD_DURING["psi"]] if settings.keep_still else []
        self._size = 0
        self._command = 0.0
        self._began = math.nan
        self._rest: deque[tuple[float, float, float, float]] = deque()
        self._pulse: list[tuple[float, float, float]] = []
        self._speed = self._noise = self._idle = math.nan
        self._psi = self._drift = 0.0

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Settings as flown and results by name, for the trial's ``meta``."""
        s, seen = self._settings, self.answer
        return {
            "dof": "surge",
            "signal": "u",
            "force": "X",
            "output": s.outputs[self._size],
            "speed": self._speed,
            "noise_std": self._noise,
            **({} if seen is None else {"gained": seen.moved}),
        }

    def commands(self, now: Observation) -> Commands:
        """Yield neutral commands at rest, then the pulses."""
        self._began = now.t
        while True:
            command = self._tick(now)
            self.phase = "at rest" if self._command == 0.0 else "pulse ahead"
            now = yield command

    def _tick(self, observation: Observation) -> Command:
        if self._pulse:
            self._watch(observation)
        elif math.isfinite(observation.u):
            self._wait(observation)
        elif observation.t - self._began > UNKNOWN:
            self._refuse("the vehicle reports no speed. Check that it has a position fix")
        return hold(Actuate(X=self._command), self._holds, observation)

    # --- the course of it ---------------------------------------------------------------------------------

    def _wait(self, observation: Observation) -> None:
        t, rest = observation.t, self._rest
        rest.append((t, observation.u, observation.output.get("X", math.nan), observation.psi))
        while rest[0][0] < t - WINDOW:
            rest.popleft()
        if t - rest[0][0] < 0.9 * WINDOW or not (self._is_still() or t - self._began > LONGEST_REST):
            return
        speeds = [u for _, u, _, _ in rest]
        self._speed, self._idle = math.fsum(speeds) / len(speeds), math.fsum(x for _, _, x, _ in rest) / len(rest)
        steps = [b - a for a, b in itertools.pairwise(speeds) if b != a] or [0.0]
        self._noise = math.sqrt(math.fsum(d * d for d in steps) / (2.0 * len(steps)))
        self._psi, self._drift = observation.psi, (observation.psi - rest[0][3]) / (t - rest[0][0])
        if abs(self._idle) >= STANDING:
            self._refuse(messages.at_its_stop(self._idle, "X", self._settings.outlets))
            return
        self._command = self._settings.outputs[self._size]
        self._pulse = [rest[-1][:3]]
        self._mark(t, "pulse", {"X": self._command})

    def _is_still(self) -> bool:
        speeds = [u for _, u, _, _ in self._rest]
        half = len(speeds) // 2
        change = math.fsum(speeds[half:]) / (len(speeds) - half) - math.fsum(speeds[:half]) / max(half, 1)
        return abs(change) < STILL

    def _watch(self, observation: Observation) -> None:
        s, t = self._settings, observation.t
        self._pulse.append((t, observation.u, observation.output.get("X", math.nan)))
        seconds = t - self._pulse[0][0]
        turn = observation.psi - self._psi - self._drift * seconds
        gained = self._gained()
        if abs(turn) >= s.turned:
            self._refuse(messages.turns_on_thrust(turn, seconds, self._command, s.crooked))
        elif (seconds >= AT_ONCE and gained >= max(FAR_TOO_MUCH * s.reach, self._least)) or (
            seconds >= SHORTEST and (abs(gained) >= max(s.reach, self._least) or seconds >= s.longest)
        ):
            self._judge(gained, seconds)

    @property
    def _least(self) -> float:
        return max(self._settings.least, NOISES * self._noise)

    def _gained(self) -> float:
        """Speed gained [m/s] at the end of the pulse."""
        end = self._pulse[-1][0]
        last = [u for t, u, _ in self._pulse if t >= end - LAST and math.isfinite(u)]
        return math.fsum(last) / len(last) - self._speed if last else 0.0

    def _judge(self, gained: float, seconds: float) -> None:
        """End with a verdict, or come to rest and try the next pulse size."""
        s, outputs = self._settings, [x - self._idle for _, _, x in self._pulse]
        late = outputs[len(outputs) // 2 :]
        seen = Pulse(self._command, gained, self._noise, gained, math.fsum(late) / len(late), seconds)
        self.answer, self._command = seen, 0.0
        if not seen.obeyed >= FOLLOWS:
            self._refuse(messages.not_followed(seen, "X", s.outlets))
        elif gained >= self._least:
            self._end("completed", f"{messages.gained(seen)}: X acts in the right direction")
        elif gained <= -self._least:
            self._refuse(f"{messages.gained(seen)}, the wrong way. {s.cure}")
        elif self._size + 1 < len(s.outputs):
            self._size += 1
            self._began, self._pulse = self._pulse[-1][0], []
            self._rest.clear()
        else:
            self._refuse(messages.does_not_drive(seen, s.outlets))

    def _refuse(self, why: str) -> None:
        self._command = 0.0
        self._end("aborted", why)
