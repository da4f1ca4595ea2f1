"""ArduRover on a boat: pilot sticks, arming rules, failsafes, and the controllers the modes use."""

from __future__ import annotations

import math
from collections.abc import Mapping

from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.mode import Mode
from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.rover_loops import RoverSpeedController, RoverSteering
from sitl.autopilot.rover_modes import RoverFailsafe, RoverGuidedMode, make_rover_modes
from sitl.autopilot.rover_motors import RoverMotors
from sitl.autopilot.shaping import wrap_pi

__all__ = ["Rover"]

STEERING_CHANNEL, THROTTLE_CHANNEL = 1, 3
_STEERING_FULL, _THROTTLE_FULL = 4500, 100


class Rover(Autopilot):
    """The Rover firmware. Boots in INITIAL_MODE when that is a mode of ours, else in MANUAL."""

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
        return make_rover_modes(self)

    @property
    def guided(self) -> RoverGuidedMode:
        """The GUIDED mode, for targets from the ground."""
        mode = self.modes[RoverGuidedMode.number]
        assert isinstance(mode, RoverGuidedMode)
        return mode

    @property
    def mode_number(self) -> int:
        """The number of the mode in force."""
        return self.mode.number

    @property
    def failsafe(self) -> bool:
        """Whether a failsafe has been acted on and its cause lasts."""
        return bool(self._failsafe.triggered)

    @property
    def throttle_percent(self) -> int:
        """The size of the throttle demand [%]."""
        return round(abs(self.motors.throttle))

    def check_failsafes(self) -> None:
        """Read the sticks and look for lost ones."""
        fresh = self.rc.update(self.ms)
        self._failsafe.update(self.rc.pwm[THROTTLE_CHANNEL], fresh)

    def act_on_battery(self, action: int) -> None:
        """Carry out BATT_FS_LOW_ACT: 0 nothing, 5 disarm, anything else HOLD."""
        if action == 5:
            self.disarm()
        elif action != 0:
            self.set_mode(4)

    def arming_fault(self, *, arming: bool) -> str | None:
        """Return why the boat must not arm, or None."""
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
        """Put steering and throttle on the servo rail."""
        self.motors.output(self.rail, self.estimate.speed, armed=self.armed)

    def stick(self, channel: int, full: int) -> int:
        """Return a stick's position within -full..full, in the firmware's whole steps."""
        return self.rc.angle(channel, full, self.parameters[f"RC{channel}_DZ"])

    def pilot_sticks(self) -> tuple[float, float]:
        """Return (steering, throttle) as fractions -1..1; neutral when the radio is lost.

        Going astern the steering is turned round (PILOT_STEER_TYPE 0).
        """
        if self._failsafe.radio_lost:
            return 0.0, 0.0
        steering = self.stick(STEERING_CHANNEL, _STEERING_FULL) / _STEERING_FULL
        throttle = self.stick(THROTTLE_CHANNEL, _THROTTLE_FULL) / _THROTTLE_FULL
        if throttle < 0.0 and self.parameters["PILOT_STEER_TYPE"] == 0.0:
            steering = -steering
        return steering, throttle

    def steer_rate(self, rate: float) -> None:
        """Let the rate loop steer at *rate* [rad/s]."""
        estimate = self.estimate
        out = self.steering.run(self.ms, rate, estimate.yaw_rate, estimate.speed, self.motors.limit_steer)
        self.motors.set_steering(out, scaled=True)

    def steer_heading(self, heading: float) -> None:
        """Let the heading loop steer to *heading* [rad]."""
        self.steer_rate(self.steering.rate_for_heading(wrap_pi(heading - self.estimate.yaw)))

    def drive_speed(self, speed: float) -> None:
        """Let the speed loop drive at *speed* [m/s]."""
        out = self.speed.run(self.ms, speed, self.estimate.speed, self.motors.limit_throttle)
        self.motors.set_throttle(100.0 * out)

    def pilot_speed(self, throttle: float) -> float:
        """Return the speed [m/s] a throttle stick of -1..1 asks for: full stick is CRUISE_SPEED at 100 %."""
        percent = self.parameters["CRUISE_THROTTLE"]
        return 0.0 if percent <= 0.0 else throttle * self.parameters["CRUISE_SPEED"] * 100.0 / percent

    def turn_rate_for(self, lateral_acceleration: float) -> float:
        """Return the turn rate [rad/s] that gives *lateral_acceleration* [m/s^2] at the present speed."""
        speed = self.estimate.speed
        return lateral_acceleration / math.copysign(max(abs(speed), 1.0), speed)
