"""ArduRover on a boat: pilot sticks, arming rules, controllers, and the modes from MANUAL to GUIDED."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from sitl.autopilot.autopilot import WARNING, Autopilot
from sitl.autopilot.failsafes import RoverFailsafe
from sitl.autopilot.mode import Mode
from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.rover_loops import RoverSpeedController, RoverSteering
from sitl.autopilot.rover_motors import RoverMotors
from sitl.autopilot.shaping import wrap_pi

__all__ = ["GuidedTarget", "Rover", "RoverGuidedMode"]

STEERING_CHANNEL, THROTTLE_CHANNEL = 1, 3
_STEERING_FULL, _THROTTLE_FULL = 4500, 100


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
        kinds = (RoverManualMode, AcroMode, SteeringMode, HoldMode, RoverGuidedMode)
        return {kind.number: kind(self) for kind in kinds}

    @property
    def guided(self) -> RoverGuidedMode:
        """The GUIDED mode, for targets from the ground station."""
        mode = self.modes[RoverGuidedMode.number]
        assert isinstance(mode, RoverGuidedMode)
        return mode

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

    def act_on_battery(self, action: int) -> None:
        """Execute BATT_FS_LOW_ACT: 0 does nothing, 5 disarms, others change to HOLD."""
        if action == 5:
            self.disarm()
        elif action != 0:
            self.set_mode(4)

    def arming_fault(self, *, arming: bool) -> str | None:
        """Return the reason why the boat must not arm, or None."""
        if self.parameters["ARMING_CHECK"] == 0.0:
            return None
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

    def steer_rate(self, rate: float) -> None:
        """Use the rate loop to steer at *rate* [rad/s]."""
        estimate = self.estimate
        out = self.steering.run(self.ms, rate, estimate.yaw_rate, estimate.speed, self.motors.limit_steer)
        self.motors.set_steering(out, scaled=True)

    def steer_heading(self, heading: float) -> None:
        """Use the heading loop to steer to *heading* [rad]."""
        self.steer_rate(self.steering.rate_for_heading(wrap_pi(heading - self.estimate.yaw)))

    def drive_speed(self, speed: float) -> None:
        """Use the speed loop to drive at *speed* [m/s]."""
        out = self.speed.run(self.ms, speed, self.estimate.speed, self.motors.limit_throttle)
        self.motors.set_throttle(100.0 * out)

    def pilot_speed(self, throttle: float) -> float:
        """Return the speed [m/s] commanded by a throttle stick of -1..1: full stick is CRUISE_SPEED at 100 %."""
        percent = self.parameters["CRUISE_THROTTLE"]
        return 0.0 if percent <= 0.0 else throttle * self.parameters["CRUISE_SPEED"] * 100.0 / percent

    def turn_rate_for(self, lateral_acceleration: float) -> float:
        """Return the turn rate [rad/s] that results in *lateral_acceleration* [m/s^2] at the present speed."""
        speed = self.estimate.speed
        return lateral_acceleration / math.copysign(max(abs(speed), 1.0), speed)


_MANUAL_INPUT, _STABILIZE, _GUIDED = 64, 16, 8
_TARGET_TIMEOUT_MS = 3000
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
    """The steering stick commands a turn rate up to ACRO_TURN_RATE, the throttle stick a speed."""

    number, name, flags = 1, "ACRO", _MANUAL_INPUT | _STABILIZE

    def run(self) -> None:
        """Run the turn-rate and speed loops with the targets of the two sticks."""
        rover = self.rover
        steering, throttle = rover.pilot_sticks()
        rover.steer_rate(steering * math.radians(rover.parameters["ACRO_TURN_RATE"]))
        rover.drive_speed(rover.pilot_speed(throttle))


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
        rover.steer_rate(rover.turn_rate_for(steering * top))
        rover.drive_speed(rover.pilot_speed(throttle))


class HoldMode(_RoverMode):
    """Keeps all outputs neutral."""

    number, name, flags = 4, "HOLD", _STABILIZE

    def run(self) -> None:
        """Set the steering and throttle demands to zero."""
        self.rover.motors.set_steering(0.0, scaled=False)
        self.rover.motors.set_throttle(0.0)


@dataclass(frozen=True, slots=True)
class GuidedTarget:
    """A target speed [m/s] with a heading [rad] or, if that is None, a turn rate [rad/s]. ``ms``: arrival time since
    boot [ms].
    """

    ms: int
    speed: float
    heading: float | None
    rate: float = 0.0


class RoverGuidedMode(_RoverMode):
    """Follows targets from the ground station. After 3 s without a target the boat loiters."""

    number, name, flags = 15, "GUIDED", _STABILIZE | _GUIDED
    needs_position = True

    def __init__(self, rover: Rover) -> None:
        super().__init__(rover)
        self.target: GuidedTarget | None = None
        self._place = (0.0, 0.0)

    def enter(self) -> None:
        """Loiter here until the first target arrives."""
        self.target = None
        self._loiter_here()

    def run(self) -> None:
        """Run the loops with the last target, or loiter if it is too old."""
        rover, target = self.rover, self.target
        if target is not None and rover.ms - target.ms > _TARGET_TIMEOUT_MS:
            rover.say(WARNING, "target not received last 3secs, stopping")
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
