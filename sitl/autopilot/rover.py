"""ArduRover on a boat: pilot sticks, arming rules, controllers, and the modes from MANUAL to GUIDED."""

from __future__ import annotations

import math
from collections.abc import Mapping

from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.failsafes import RoverFailsafe, act_on_failsafe
from sitl.autopilot.mode import Mode
from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.rover_helm import Helm
from sitl.autopilot.rover_loops import RoverSpeedController, RoverSteering
from sitl.autopilot.rover_motors import RoverMotors
from sitl.autopilot.rover_navigation import AutoMode, LoiterMode, RoverGuidedMode, RtlMode

__all__ = ["Rover"]

STEERING_CHANNEL, THROTTLE_CHANNEL = 1, 3
_STEERING_FULL, _THROTTLE_FULL = 4500, 100
_TURNING_MS = 1000
_LEAST_CRUISE, _MOST_CRUISE = 5.0, 100.0
"""CRUISE_THROTTLE [%] within which the throttle stick can hurry navigation."""


class Rover(Autopilot):
    """The Rover firmware. It boots in INITIAL_MODE if that mode is simulated, else in MANUAL."""

    firmware = "ArduRover"
    mav_type = 11
    boot_mode = 0

    def __init__(self, parameters: ParameterStore, dt: float, ready_ms: int) -> None:
        self.motors = RoverMotors(parameters, dt)
        self.steering = RoverSteering(parameters, dt)
        self.speed = RoverSpeedController(parameters, dt)
        super().__init__(parameters, dt, ready_ms)
        self._failsafe = RoverFailsafe(parameters, self)
        self.mode = self.modes.get(int(parameters["INITIAL_MODE"]), self.mode)

    def _make_modes(self) -> Mapping[int, Mode]:
        self.helm = Helm(self, self.motors, self.steering, self.speed, self._pilot_speed_ahead)
        rtl = RtlMode(self, self.helm)
        self._auto = AutoMode(self, self.helm, rtl)
        modes: tuple[Mode, ...] = (
            *(kind(self) for kind in (RoverManualMode, AcroMode, SteeringMode, HoldMode)),
            *(LoiterMode(self, self.helm), self._auto, rtl, RoverGuidedMode(self, self.helm)),
        )
        return {mode.number: mode for mode in modes}

    @property
    def guided(self) -> RoverGuidedMode:
        """The GUIDED mode, for targets from the ground station."""
        mode = self.modes[RoverGuidedMode.number]
        assert isinstance(mode, RoverGuidedMode)
        return mode

    @property
    def mission_crew(self) -> AutoMode:
        """AUTO."""
        return self._auto

    @property
    def failsafe(self) -> bool:
        """Whether a failsafe has acted and its cause persists."""
        return bool(self._failsafe.triggered)

    @property
    def throttle_percent(self) -> int:
        """Magnitude of the throttle demand [%]."""
        return round(abs(self.motors.throttle))

    def check_failsafes(self) -> None:
        """Read the sticks and check for a lost radio or ground station."""
        fresh = self.rc.update(self.ms)
        self._failsafe.update(self.rc.pwm[THROTTLE_CHANNEL], fresh)
        if self.ms % _TURNING_MS == 0:
            self.helm.read_turning()

    def act_on_battery(self, action: int) -> None:
        """Execute BATT_FS_LOW_ACT, as FS_ACTION."""
        act_on_failsafe(self, action)

    def disarm(self) -> bool:
        """Disarm at once; outside AUTO the mission will start from its first command."""
        if self.armed and not self.mode.in_mission:
            self.mission.rewind()
        return super().disarm()

    def arming_fault(self, *, arming: bool) -> str | None:
        """Return the reason why the boat must not arm, or None."""
        if self.parameters["ARMING_CHECK"] == 0.0:
            return None
        if not self.mode.arms:
            return "Mode not armable"
        if self.ms < self.ready_ms:
            return "Accels inconsistent"
        if self._failsafe.radio_lost:
            return "Radio failsafe on"
        if arming and self.stick(THROTTLE_CHANNEL, _THROTTLE_FULL) != 0:
            return f"Throttle (RC{THROTTLE_CHANNEL}) is not neutral"
        return self.battery.arming_fault()

    def write_outputs(self) -> None:
        """Write steering and throttle to the servo outputs."""
        self.motors.output(self.rail, self.estimate.speed, armed=self.armed)

    def stick(self, channel: int, full: int) -> int:
        """Return a stick's position within -full..full, in whole steps as in the firmware."""
        return self.rc.angle(channel, full, self.parameters[f"RC{channel}_DZ"])

    def pilot_sticks(self) -> tuple[float, float]:
        """Return (steering, throttle) as fractions -1..1; neutral if the radio is lost.

        Astern the steering is reversed (PILOT_STEER_TYPE 0).
        """
        if self._failsafe.radio_lost:
            return 0.0, 0.0
        steering = self.stick(STEERING_CHANNEL, _STEERING_FULL) / _STEERING_FULL
        throttle = self.stick(THROTTLE_CHANNEL, _THROTTLE_FULL) / _THROTTLE_FULL
        if throttle < 0.0 and self.parameters["PILOT_STEER_TYPE"] == 0.0:
            steering = -steering
        return steering, throttle

    def pilot_speed(self, throttle: float) -> float:
        """Return the speed [m/s] commanded by a throttle stick of -1..1: full stick is CRUISE_SPEED at 100 %."""
        percent = self.parameters["CRUISE_THROTTLE"]
        return 0.0 if percent <= 0.0 else throttle * self.parameters["CRUISE_SPEED"] * 100.0 / percent

    def _pilot_speed_ahead(self) -> float:
        """Return the speed ahead [m/s] that the throttle stick commands while navigating."""
        if not _LEAST_CRUISE <= self.parameters["CRUISE_THROTTLE"] <= _MOST_CRUISE:
            return 0.0
        return max(self.pilot_speed(self.pilot_sticks()[1]), 0.0)

    def turn_rate_for(self, lateral_acceleration: float) -> float:
        """Return the turn rate [rad/s] that results in *lateral_acceleration* [m/s^2] at the present speed."""
        speed = self.estimate.speed
        return lateral_acceleration / math.copysign(max(abs(speed), 1.0), speed)


_MANUAL_INPUT, _STABILIZE = 64, 16
_SCALE_MANUAL_STEERING = 1


class _RoverMode(Mode):
    def __init__(self, rover: Rover) -> None:
        self.rover = rover


class RoverManualMode(_RoverMode):
    """Passes sticks directly to the servos."""

    number, name, flags = 0, "MANUAL", _MANUAL_INPUT

    def run(self) -> None:
        """Write the stick positions to the steering and throttle demands."""
        rover = self.rover
        steering, throttle = rover.pilot_sticks()
        expo = rover.parameters["MANUAL_STR_EXPO"]
        if expo:
            steering = (1.0 - expo) * steering + expo * steering**3
        scaled = bool(int(rover.parameters["MANUAL_OPTIONS"]) & _SCALE_MANUAL_STEERING)
        rover.motors.set_steering(steering, scaled=scaled)
        rover.motors.set_throttle(100.0 * throttle)


class AcroMode(_RoverMode):
    """The steering stick commands a turn rate up to ACRO_TURN_RATE, the throttle stick a speed.

    Without an estimate of the speed the sticks command the servos directly. Source: ArduPilot's ``Rover/mode_acro``.
    """

    number, name, flags = 1, "ACRO", _MANUAL_INPUT | _STABILIZE

    def run(self) -> None:
        """Run the turn-rate and speed loops with the targets of the two sticks."""
        rover = self.rover
        steering, throttle = rover.pilot_sticks()
        if not rover.aided:
            rover.motors.set_steering(steering, scaled=False)
            rover.motors.set_throttle(100.0 * throttle)
            return
        rover.helm.steer_rate(steering * math.radians(rover.parameters["ACRO_TURN_RATE"]))
        rover.helm.drive_speed(rover.pilot_speed(throttle))


class SteeringMode(_RoverMode):
    """The steering stick commands a lateral acceleration, up to the limit of TURN_RADIUS and ATC_TURN_MAX_G."""

    number, name, flags = 3, "STEERING", _MANUAL_INPUT | _STABILIZE

    def run(self) -> None:
        """Run the turn-rate and speed loops with the targets of the two sticks."""
        rover = self.rover
        steering, throttle = rover.pilot_sticks()
        speed = rover.estimate.speed
        top = speed * speed / max(rover.parameters["TURN_RADIUS"], 0.1)
        top = min(max(top, 0.1), rover.steering.lateral_acceleration_limit())
        rover.helm.steer_rate(rover.turn_rate_for(steering * top))
        rover.helm.drive_speed(rover.pilot_speed(throttle))


class HoldMode(_RoverMode):
    """Keeps all outputs neutral."""

    number, name, flags = 4, "HOLD", _STABILIZE

    def run(self) -> None:
        """Set the steering and throttle demands to zero."""
        self.rover.motors.set_steering(0.0, scaled=False)
        self.rover.motors.set_throttle(0.0)
