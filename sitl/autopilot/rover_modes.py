"""Rover's flight modes (MANUAL, ACRO, STEERING, HOLD, GUIDED), and its radio and ground-station failsafes.

Both failsafes share one trigger, as in the firmware, which is why a lost ground station is announced as "Radio
Failsafe": the radio check runs more often and is the first to find the time-out over, whatever started it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from sitl.autopilot.mode import Mode
from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.rc_input import RcInput

if TYPE_CHECKING:
    from sitl.autopilot.rover import Rover

__all__ = ["GuidedTarget", "RoverFailsafe", "RoverGuidedMode", "make_rover_modes"]

_RADIO, _GCS = 1, 2
_GCS_PERIOD_MS = 100
_WARNING, _INFO = 4, 6
_ACTIVE_IN_HOLD = 1
_HOLD_MODE = 4
_ACTION_NONE, _ACTION_TERMINATE = 0, 5


class _Owner(Protocol):
    ms: int
    last_gcs_ms: int
    rc: RcInput

    @property
    def mode_number(self) -> int: ...

    def say(self, severity: int, text: str) -> None: ...

    def set_mode(self, number: int) -> bool: ...

    def disarm(self) -> bool: ...


class RoverFailsafe:
    """``events``: what is wrong now; ``triggered``: what has been acted on. FS_ACTION 5 disarms, others HOLD."""

    def __init__(self, parameters: ParameterStore, owner: _Owner) -> None:
        self._values = parameters.values
        self._owner = owner
        self._last_valid_ms = 0
        self._since_ms = 0
        self.events = 0
        self.triggered = 0

    @property
    def radio_lost(self) -> bool:
        """Whether no usable stick comes in just now."""
        return bool(self.events & _RADIO)

    def update(self, throttle_pwm: int, fresh: bool) -> None:
        """Look once per loop; *fresh*: valid sticks have come in since the last look."""
        owner, values = self._owner, self._values
        if fresh:
            self._last_valid_ms = owner.ms
        if values["FS_THR_ENABLE"]:
            silent = owner.ms - self._last_valid_ms > values["RC_FS_TIMEOUT"] * 1000.0
            self._note(_RADIO, "Radio", silent or throttle_pwm < values["FS_THR_VALUE"])
        if values["FS_GCS_ENABLE"] and owner.last_gcs_ms and owner.ms % _GCS_PERIOD_MS == 0:
            self._note(_GCS, "GCS", owner.ms - owner.last_gcs_ms >= values["FS_GCS_TIMEOUT"] * 1000.0)

    def _note(self, event: int, name: str, present: bool) -> None:
        owner, before = self._owner, self.events
        self.events = before | event if present else before & ~event
        if not before and self.events:
            self._since_ms = owner.ms
        if self.triggered and not self.events:
            owner.say(_INFO, f"{name} Failsafe Cleared")
        self.triggered &= self.events
        overdue = owner.ms - self._since_ms > self._values["FS_TIMEOUT"] * 1000.0
        if self.events and not self.triggered and overdue and self._may_act():
            self._act(name)

    def _may_act(self) -> bool:
        return self._owner.mode_number != _HOLD_MODE or bool(int(self._values["FS_OPTIONS"]) & _ACTIVE_IN_HOLD)

    def _act(self, name: str) -> None:
        owner, action = self._owner, int(self._values["FS_ACTION"])
        self.triggered = self.events
        owner.say(_WARNING, f"{name} Failsafe")
        owner.rc.clear_overrides()
        if action == _ACTION_TERMINATE:
            owner.disarm()
        elif action != _ACTION_NONE:
            owner.set_mode(_HOLD_MODE)


_MANUAL_INPUT, _STABILIZE, _GUIDED = 64, 16, 8
_TARGET_TIMEOUT_MS = 3000
_SCALE_MANUAL_STEERING = 1


class _RoverMode(Mode):
    def __init__(self, rover: Rover) -> None:
        self.rover = rover


class RoverManualMode(_RoverMode):
    """Sticks straight to the servos."""

    number, name, flags = 0, "MANUAL", _MANUAL_INPUT

    def run(self) -> None:
        """Pass the sticks on."""
        rover = self.rover
        steering, throttle = rover.pilot_sticks()
        expo = rover.parameters["MANUAL_STR_EXPO"]
        if expo:
            steering = (1.0 - expo) * steering + expo * steering**3
        scaled = bool(int(rover.parameters["MANUAL_OPTIONS"]) & _SCALE_MANUAL_STEERING)
        rover.motors.set_steering(steering, scaled=scaled)
        rover.motors.set_throttle(100.0 * throttle)


class AcroMode(_RoverMode):
    """Steering stick is a turn rate up to ACRO_TURN_RATE, throttle stick a speed."""

    number, name, flags = 1, "ACRO", _MANUAL_INPUT | _STABILIZE

    def run(self) -> None:
        """Run the rate and speed loops."""
        rover = self.rover
        steering, throttle = rover.pilot_sticks()
        rover.steer_rate(steering * math.radians(rover.parameters["ACRO_TURN_RATE"]))
        rover.drive_speed(rover.pilot_speed(throttle))


class SteeringMode(_RoverMode):
    """Steering stick is a lateral acceleration (up to what TURN_RADIUS and ATC_TURN_MAX_G allow)."""

    number, name, flags = 3, "STEERING", _MANUAL_INPUT | _STABILIZE

    def run(self) -> None:
        """Run the rate and speed loops."""
        rover = self.rover
        steering, throttle = rover.pilot_sticks()
        speed = rover.estimate.speed
        top = speed * speed / max(rover.parameters["TURN_RADIUS"], 0.1)
        top = min(max(top, 0.1), rover.steering.lateral_acceleration_limit())
        rover.steer_rate(rover.turn_rate_for(steering * top))
        rover.drive_speed(rover.pilot_speed(throttle))


class HoldMode(_RoverMode):
    """Everything off and amidships."""

    number, name, flags = 4, "HOLD", _STABILIZE

    def run(self) -> None:
        """Demand nothing."""
        self.rover.motors.set_steering(0.0, scaled=False)
        self.rover.motors.set_throttle(0.0)


@dataclass(frozen=True, slots=True)
class GuidedTarget:
    """A wanted speed [m/s] with a heading [rad] or, that being None, a turn rate [rad/s]; ``ms``: when it came."""

    ms: int
    speed: float
    heading: float | None
    rate: float = 0.0


class RoverGuidedMode(_RoverMode):
    """Follows targets from the ground; 3 s without one and the boat stays where it is (loiters)."""

    number, name, flags = 15, "GUIDED", _STABILIZE | _GUIDED
    needs_position = True

    def __init__(self, rover: Rover) -> None:
        super().__init__(rover)
        self.target: GuidedTarget | None = None
        self._place = (0.0, 0.0)

    def enter(self) -> None:
        """Stay here until the first target comes."""
        self.target = None
        self._loiter_here()

    def run(self) -> None:
        """Follow the target, or loiter."""
        rover, target = self.rover, self.target
        if target is not None and rover.ms - target.ms > _TARGET_TIMEOUT_MS:
            rover.say(_WARNING, "target not received last 3secs, stopping")
            self.target = target = None
            self._loiter_here()
        if target is None:
            self._loiter()
            return
        if target.heading is None:
            rover.steer_rate(target.rate)
        else:
            rover.steer_heading(target.heading)
        rover.drive_speed(target.speed)

    def _loiter_here(self) -> None:
        self._place = (self.rover.estimate.x, self.rover.estimate.y)

    def _loiter(self) -> None:
        rover, estimate = self.rover, self.rover.estimate
        north, east = self._place[0] - estimate.x, self._place[1] - estimate.y
        beyond = math.hypot(north, east) - rover.parameters["LOIT_RADIUS"]
        if beyond <= 0.0:
            rover.motors.set_steering(0.0, scaled=False)
            rover.drive_speed(0.0)
            return
        rover.steer_heading(math.atan2(east, north))
        rover.drive_speed(min(beyond * rover.parameters["LOIT_SPEED_GAIN"], rover.parameters["WP_SPEED"]))


def make_rover_modes(rover: Rover) -> Mapping[int, Mode]:
    """Return Rover's modes by number."""
    modes: tuple[Mode, ...] = (
        RoverManualMode(rover),
        AcroMode(rover),
        SteeringMode(rover),
        HoldMode(rover),
        RoverGuidedMode(rover),
    )
    return {mode.number: mode for mode in modes}
