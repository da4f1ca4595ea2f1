"""Check before a relay that a small pulse in each direction moves the craft in the right direction.

A relay or loop on a reversed rudder would turn the craft in circles. On a dead rudder it would wait for ever. The pulse
grows until there is a response.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from gcs_autotune.craft import Actuate, Command, Observation
from gcs_autotune.manoeuvres import sign_messages as messages
from gcs_autotune.manoeuvres.approach import Approach
from gcs_autotune.manoeuvres.hold_controller import HELD_DURING, HoldController, hold
from gcs_autotune.manoeuvres.manoeuvre import Commands, Manoeuvre
from gcs_autotune.manoeuvres.pulse_response import CLEAR, PulseResponse, Tick, pulse_response
from gcs_autotune.manoeuvres.relay import INTEGRATED
from gcs_autotune.manoeuvres.sign_messages import Outlet
from gcs_autotune.sname import DOFS

__all__ = ["SignCheck", "SignCheckSettings"]

SHORTEST = 0.6
"""Shortest duration of a pulse [s], a few ticks longer than the delays of a radio and an actuator. Project choice."""
DRIFT_WINDOW = 3.0
"""Time [s] before a pulse over which the drift is measured. Project choice."""
NOISES = 5.0
"""Smallest significant motion, in standard deviations of the noise. Project choice."""
BACK_LONGER = 2.5
"""Longest duration of the return pulse relative to the first pulse; a craft without drag needs 1 + sqrt(2)."""
LAST_LONGER = 2.0
"""Duration of the largest pulse, in multiples of ``longest``. Project choice.

With 0.6 of full rudder, a boat with a yaw time constant of 8 s turns by 2.5 deg in 4 s, which is too little for a poor
compass. In 8 s it turns by 9 deg.
"""
TWICE = 2
"""Number of pulse pairs that must move the craft in the wrong direction before its actuator counts as reversed. Project
choice.
"""
STANDING = 0.9
"""Output without any command [fraction of full] above which the actuator counts as at its stop. Project choice."""
ASTERN = 0.7
"""Fraction of the motion that is astern, above which neither leeway nor current explains it: the propeller turns the
wrong way. Project choice.
"""
CIRCLING = math.radians(5.0)
"""Turn rate [rad/s] without steering, at varying speed, above which a boat counts as circling. Project choice."""
EASED, LEAST_SHARE = 1.0, 1.0 / 64.0
"""Time between two halvings of the throttle [s], and the smallest remaining fraction of the throttle. Project
choice.
"""
WAY_NOISES = 4.0
"""Speed, in standard deviations of its noise, below which it counts as too low for steering. Project choice."""


@dataclass(frozen=True, slots=True)
class SignCheckSettings:
    """Settings of a sign check. Outputs are normalised; ``reach``, ``least`` rad or m; times s; ``least_speed`` m/s.

    Attributes
    ----------
    signal, force : the signal observed (``psi``, ``z``; ``y``: integrated sway speed) and the driven force.
    outputs : sizes of the pulse, tried until one has a response.
    reach : motion that ends a pulse; larger with a noisy sensor, so that it counts as a response. Otherwise a pulse
        ends after ``longest``, the largest pulse after twice that time.
    least : smallest motion that counts as a response.
    throttle : constant thrust ahead; the craft must make ``least_speed`` with it, or a rudder has no effect.
    most_speed, wanted_speed : speed [m/s] above which the throttle is halved, and speed for which the throttle is then
        estimated.
    cure, astern : advice if the craft turns the wrong way, or goes astern.
    outlets : the servo outputs that drive the force, for messages.
    """

    signal: str
    force: str
    outputs: tuple[float, ...] = (0.15, 0.3, 0.6)
    reach: float = math.radians(6.0)
    least: float = math.radians(1.5)
    longest: float = 4.0
    throttle: float = 0.0
    least_speed: float = 0.0
    most_speed: float = math.inf
    wanted_speed: float = math.nan
    keep_still: bool = False
    cure: str = "check SERVOn_REVERSED or MOT_n_DIRECTION"
    astern: str = "check SERVOn_REVERSED of the throttle, and the propeller"
    outlets: tuple[Outlet, ...] = ()


class SignCheck(Manoeuvre):
    """Fly an approach (measure speed, noise and drift), then pulses until there is a response in both directions."""

    kind, purpose = "sign-check", "check"

    def __init__(self, settings: SignCheckSettings) -> None:
        super().__init__(signal=settings.signal, force=settings.force)
        self.answer: PulseResponse | None = None
        self._settings = settings
        self._approach = Approach(settings.signal, needs_way=settings.throttle != 0.0)
        self._holds = [HoldController(g) for g in HELD_DURING[settings.signal]] if settings.keep_still else []
        self._size = 0
        self._share, self._eased_at = 1.0, -math.inf
        self._reversals = 0
        self._command = 0.0
        self._began_at, self._oscillates = math.nan, False
        self._along, self._last_t = 0.0, math.nan
        self._rest: list[Tick] = []
        self._forward: list[Tick] = []
        self._back: list[Tick] = []
        self._speeds: list[float] = []
        self._ahead: list[float] = []

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Settings as flown and results by name, for the trial's ``meta``."""
        s, seen = self._settings, self.answer
        found = {} if seen is None else {"moved": [seen.forward.moved, seen.back.moved], "signs": list(seen.signs)}
        return {
            "dof": next(dof.name for dof in DOFS.values() if dof.force == s.force),
            "signal": s.signal,
            "force": s.force,
            "output": s.outputs[self._size],
            "throttle": self._share * s.throttle,
            "speed": self._approach.speed,
            "noise_std": self._approach.noise_std,
            **found,
        }

    def commands(self, now: Observation) -> Commands:
        """Yield the commands of the approach, then the pulses."""
        self._approach.start(now)
        self._last_t = now.t
        self._began_at = self._watched(now)
        while True:
            command = self._tick(now)
            self.phase = "approach" if self._command == 0.0 else "pulse"
            now = yield command

    def _tick(self, observation: Observation) -> Command:
        s, t, x = self._settings, observation.t, self._watched(observation)
        tick = t, x, observation.output.get(s.force, math.nan)
        if not self._forward:
            self._ease(observation)
            self._wait(observation, tick)
        elif not self._back:
            self._forward.append(tick)
            moved, seconds = x - self._forward[0][1], t - self._forward[0][0]
            is_last = self._size + 1 == len(s.outputs)
            longest = s.longest * (LAST_LONGER if is_last else 1.0)
            reach = max(s.reach, CLEAR * self._least)
            if seconds >= SHORTEST and (seconds >= longest or abs(moved) >= reach):
                self._back = [tick]
                self._push(t, -self._command)
        else:
            self._back.append(tick)
            start, turn = self._forward[0], self._back[0]
            gone, seconds = turn[1] - start[1], t - turn[0]
            answered = abs(gone) >= self._least
            longest = (turn[0] - start[0]) * (BACK_LONGER if answered else 1.0)
            is_back = answered and (x - start[1]) * gone <= 0.0
            if seconds >= SHORTEST and (seconds >= longest or is_back):
                self._judge()
        return self._drive(observation)

    def _watched(self, observation: Observation) -> float:
        """Return the monitored position; sideways it is the integral of the speed."""
        signal, dt = self._settings.signal, observation.t - self._last_t
        self._last_t = observation.t
        if signal not in INTEGRATED:
            return observation.value(signal)
        speed = observation.value(INTEGRATED[signal])
        self._along += speed * dt if math.isfinite(speed) else 0.0
        return self._along

    @property
    def eased(self) -> bool:
        """Whether the boat exceeded the permitted speed and its throttle was reduced."""
        return self._share < 1.0

    @property
    def throttle(self) -> float:
        """Normalised throttle: that for the required speed if the boat was too fast, else the throttle flown."""
        s, flown = self._settings, self._share * self._settings.throttle
        if not self.eased or not self._approach.speed > 0.0 or not math.isfinite(s.wanted_speed):
            return flown
        return min(max(flown * s.wanted_speed / self._approach.speed, 0.01), s.throttle)

    def _ease(self, observation: Observation) -> None:
        """Halve the throttle of a boat that is too fast, and wait for a steady speed."""
        s, t = self._settings, observation.t
        if not observation.speed > s.most_speed or t - self._eased_at < EASED or self._share <= LEAST_SHARE:
            return
        self._share, self._eased_at = 0.5 * self._share, t
        self._approach = Approach(s.signal, needs_way=s.throttle != 0.0)
        self._approach.start(observation)

    # --- the course of it ---------------------------------------------------------------------------------

    def _wait(self, observation: Observation, tick: Tick) -> None:
        """Wait until speed, noise and drift settle. Then begin, unless the craft has too little speed to steer."""
        t, x, _ = tick
        if not self._approach.done:
            self._approach.update(t, x, observation.speed)
        self._speeds.append(observation.speed)
        self._ahead.append(observation.u)
        self._rest = [*(old for old in self._rest if old[0] >= t - DRIFT_WINDOW), tick]
        settled = self._approach.done and t - self._rest[0][0] >= 0.9 * DRIFT_WINDOW
        if settled and not self._nothing_to_steer_by():
            self._forward = [tick]
            self._push(t, self._way(x) * self._settings.outputs[self._size])

    def _way(self, x: float) -> float:
        """Return the side of the first pulse: to port if waves have turned the bow far to starboard.

        No controller holds the bow there, and pulses add to the deviation. Steady drift to one side does not count.
        """
        s, seen = self._settings, [x for _, x, _ in self._rest]
        if self.answer is None:  # afterwards pulses also turn it
            excess = max(max(seen) - max(seen[0], seen[-1]), min(seen[0], seen[-1]) - min(seen))
            self._oscillates = s.signal == "psi" and excess > s.reach
        return -1.0 if self._oscillates and x - self._began_at > s.reach else 1.0

    def _nothing_to_steer_by(self) -> bool:
        s, idle = self._settings, self._rest[-1][2]
        if abs(idle) >= STANDING:
            self._refuse(messages.at_its_stop(idle, s.force, s.outlets))
        elif s.least_speed > 0.0:
            speed, recent = self._approach.speed, self._speeds[-30:]
            noise = math.sqrt(sum((v - speed) ** 2 for v in recent) / len(recent))
            least = max(s.least_speed, WAY_NOISES * noise)
            ahead = sum(self._ahead[-30:]) / len(self._ahead[-30:])
            first, last = self._rest[0], self._rest[-1]
            rate = (last[1] - first[1]) / (last[0] - first[0])
            if s.least_speed <= speed < least and s.signal == "psi" and abs(rate) > CIRCLING:
                self._refuse(messages.turns_by_itself(rate, speed, noise, s.throttle))
            elif not speed >= least:
                self._refuse(messages.too_slow(speed, noise, least, s.throttle))
            elif s.throttle > 0.0 and ahead < -ASTERN * speed and not self._reversals:
                self._refuse(messages.goes_astern(ahead, s.throttle, s.astern))
        return self.outcome is not None

    @property
    def _least(self) -> float:
        """Smallest motion that counts as a response [rad or m]."""
        return max(self._settings.least, NOISES * self._approach.noise_std)

    def _push(self, t: float, command: float) -> None:
        self._command = command
        self._mark(t, "pulse", {self._settings.force: command})

    def _judge(self) -> None:
        """End with a verdict, or come to rest and try the next pulse size."""
        s = self._settings
        command = -self._command  # of the first pulse: the second is flown last
        self.answer = seen = pulse_response(command, self._rest, self._forward, self._back, self._least)
        self._command = 0.0
        if seen.unheeded is not None:
            self._refuse(messages.not_followed(seen.unheeded, s.force, s.outlets))
        elif seen.is_right:
            self._end("completed", messages.acts_rightly(seen.forward, s.signal, s.force))
        else:
            self._not_right(seen)

    def _not_right(self, seen: PulseResponse) -> None:
        """Reject the actuator, or come to rest and pulse once more.

        The surface, a quay or a net can push the craft back during a pulse, which looks like a response in the wrong
        direction. It must occur twice, without a right response at the end.
        """
        s, is_last = self._settings, self._size + 1 == len(self._settings.outputs)
        self._reversals += seen.is_reversed
        is_clear = seen.signs == (-1, -1) or (is_last and 1 not in seen.signs)
        if self._reversals >= TWICE and is_clear:
            self._refuse(messages.turned_round(seen, s.signal, s.force, s.cure))
            return
        if is_last and not (seen.is_reversed and self._reversals < TWICE):
            self._refuse(messages.unclear(seen, s.signal, s.force, s.outlets, under_way=s.throttle > 0.0))
            return
        if not (seen.is_reversed and self._reversals < TWICE):
            self._size += 1
        self._rest, self._forward, self._back = [], [], []

    def _refuse(self, why: str) -> None:
        self._end("aborted", why)

    def _drive(self, observation: Observation) -> Command:
        s = self._settings
        command = hold(Actuate(X=self._share * s.throttle), self._holds, observation)
        return replace(command, **{s.force: getattr(command, s.force) + self._command})
