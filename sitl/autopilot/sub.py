"""ArduSub: pilot sticks, joystick gain, arming rules, controllers, and the modes from MANUAL to GUIDED."""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping

from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.failsafes import SubFailsafe
from sitl.autopilot.mode import Mode, WayReport
from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.shaping import clamp
from sitl.autopilot.sub_loops import SubAngleController, SubDepthController
from sitl.autopilot.sub_motors import SubMotors
from sitl.autopilot.sub_position import SubPositionController, SubWaypoint

__all__ = ["Sub"]

_PITCH, _ROLL, _THROTTLE, _YAW, _FORWARD, _LATERAL = 1, 2, 3, 4, 5, 6
_STICK_FULL = 4500
_TARGET_LIFE_MS = 5000
_STOPPING_MS = 250
_CM = 100.0
_GUIDED_MODE = 4
_DEPTH_CUTOFF = 2.0
"""Cutoff frequency [Hz] of the low-pass on the depth loop's throttle. It is fixed in the firmware."""


class Sub(Autopilot):
    """The Sub firmware. It boots in MANUAL. ``gain`` is the joystick gain, read from JS_GAIN_DEFAULT only at boot."""

    firmware = "ArduSub"
    mav_type = 12
    boot_mode = 19

    def __init__(self, parameters: ParameterStore, dt: float, ready_ms: int) -> None:
        self.motors = SubMotors(parameters, dt)
        self.yaw = SubAngleController(parameters, dt)
        self.roll, self.pitch = (SubAngleController(parameters, dt, axis) for axis in ("RLL", "PIT"))
        self.depth = SubDepthController(parameters, dt)
        self.position = SubPositionController(parameters, dt)
        self.waypoint = SubWaypoint(parameters, self.position, dt)
        self.gain = clamp(parameters["JS_GAIN_DEFAULT"], 0.1, 1.0)
        super().__init__(parameters, dt, ready_ms)
        self._failsafe = SubFailsafe(parameters, self)
        self._hold_heading = 0.0
        self._turned_ms = -_STOPPING_MS
        self._target_ms = -_TARGET_LIFE_MS
        self._tilt_target: tuple[float, float] | None = None
        self._goal: complex | None = None

    def _make_modes(self) -> Mapping[int, Mode]:
        kinds = (SubManualMode, StabilizeMode, AltHoldMode, PosHoldMode, SubGuidedMode)
        return {kind.number: kind(self) for kind in kinds}

    @property
    def failsafe(self) -> bool:
        """Whether the pilot or the ground station is lost."""
        return self.armed and (self._failsafe.pilot_lost or self._failsafe.gcs_lost)

    @property
    def throttle_percent(self) -> int:
        """Throttle demand [%]; 50 is neutral."""
        return round(100.0 * self.motors.throttle)

    def check_failsafes(self) -> None:
        """Read the sticks and check for a lost pilot or ground station."""
        self.rc.update(self.ms)
        self._failsafe.update()

    def act_on_battery(self, action: int) -> None:
        """Execute BATT_FS_LOW_ACT: 0 does nothing, others disarm (surfacing is not simulated)."""
        if action:
            self.disarm()

    def arming_fault(self, *, arming: bool) -> str | None:
        """Return the reason why the craft must not arm, or None."""
        if self.parameters["ARMING_CHECK"] == 0.0:
            return None
        return "Gyros not calibrated" if self.ms < self.ready_ms else self.battery.arming_fault()

    def write_outputs(self) -> None:
        """Write the motors' pulses to the servo outputs."""
        if not self.armed:
            self.reset_loops()
        self.motors.output(self.rail, armed=self.armed)

    def note_pilot(self) -> None:
        """Record that the ground station has just sent stick commands."""
        self._failsafe.last_pilot_ms = self.ms

    def reset_loops(self) -> None:
        """Reset the loops to hold the present heading and depth."""
        estimate = self.estimate
        self._hold_heading = estimate.yaw
        self.yaw.reset(estimate.yaw)
        self.roll.reset(estimate.roll)
        self.pitch.reset(estimate.pitch)
        self.depth.reset(-_CM * estimate.z, _CM * estimate.climb, self.motors.throttle)

    def set_attitude_target(self, roll: float, pitch: float, heading: float) -> None:
        """Hold these angles [rad]. A target from the ground station has priority over the sticks for 5 s."""
        self._target_ms = self.ms
        self._hold_heading, self._tilt_target = heading, (roll, pitch)

    def set_depth_target(self, altitude: float) -> None:
        """Hold *altitude* [m, up from the surface: negative under water]."""
        self.depth.target = _CM * altitude

    def go(self, place: complex, altitude: float) -> None:
        """Fly to *place* (north + i east) and *altitude* (up) [m] in GUIDED."""
        if self.mode.number == _GUIDED_MODE:
            self._goal = None
            self.waypoint.go(self.depth.target, _CM * place, _CM * altitude)

    def stay_at(self, place: complex, altitude: float, heading: float) -> None:
        """Move to *place* (north + i east) and *altitude* (up) [m] in GUIDED, and hold *heading* [rad] there."""
        if self.mode.number == _GUIDED_MODE:
            if self._goal is None:
                self.position.begin_shaping(_CM * self.estimate.place, _CM * self.estimate.velocity)
                self.waypoint.stop()
            self._goal = _CM * place
            self.set_depth_target(altitude)
            self.set_attitude_target(0.0, 0.0, heading)

    def approach_goal(self) -> bool:
        """Move the target of the position towards the place to stay at; return whether there is one."""
        if self._goal is not None:
            self.position.approach(self._goal)
        return self._goal is not None

    def hold_place(self, *, anew: bool = False) -> tuple[float, float]:
        """Return the forward and lateral demand that hold the place, or where the craft comes to rest (*anew*)."""
        place, velocity = _CM * self.estimate.place, _CM * self.estimate.velocity
        if anew:
            self.position.hold(place, velocity)
        return self.position.run(place, velocity, self.estimate.yaw, self.motors.throttle_in)

    def start_position(self) -> None:
        """Hold from now on where the craft comes to rest."""
        self._goal = None
        self.position.start(_CM * self.estimate.place, _CM * self.estimate.velocity)
        self.waypoint.stop()

    def advance_waypoint(self) -> None:
        """Move the target on along its way, depth included."""
        estimate, waypoint = self.estimate, self.waypoint
        error = self.position.target - _CM * estimate.place
        waypoint.advance(_CM * estimate.velocity, _CM * estimate.climb, error, self.depth.target + _CM * estimate.z)
        self.depth.follow(waypoint.altitude, waypoint.climb)

    def pass_horizontal_sticks(self) -> None:
        """Set the forward and lateral demands to the stick positions, without a dead zone."""
        self.motors.forward = self.rc.fraction(_FORWARD)
        self.motors.lateral = self.rc.fraction(_LATERAL)

    def pass_yaw_stick(self) -> None:
        """Set the yaw demand to the stick position, without a dead zone."""
        self.motors.yaw = self.rc.fraction(_YAW)

    def pass_tilt_sticks(self) -> None:
        """Set the roll and pitch demands to the stick positions, without a dead zone."""
        self.motors.roll, self.motors.pitch = self.rc.fraction(_ROLL), self.rc.fraction(_PITCH)

    def hold_tilt(self) -> None:
        """Hold the roll and pitch of the sticks, level with both centred."""
        if not self.tilts:
            return
        estimate, motors = self.estimate, self.motors
        roll: float = self.rc.angle(_ROLL, _STICK_FULL, 0.0)
        pitch: float = self.rc.angle(_PITCH, _STICK_FULL, 0.0)
        if roll or pitch:
            most = math.radians(self.parameters["ANGLE_MAX"] / 100.0)
            roll, pitch = most * roll / _STICK_FULL, most * pitch / _STICK_FULL
        if self._tilt_target is not None and self.ms - self._target_ms < _TARGET_LIFE_MS:
            roll, pitch = self._tilt_target
        self.roll.hold(roll)
        self.pitch.hold(pitch)
        motors.roll = self.roll.run(estimate.roll, estimate.roll_rate, abs(motors.roll) >= 1.0)
        motors.pitch = self.pitch.run(estimate.pitch, estimate.pitch_rate, abs(motors.pitch) >= 1.0)

    def pass_throttle_stick(self) -> None:
        """Set the throttle demand to the stick position, bypassing the depth loop."""
        self.motors.set_throttle(0.5 * (1.0 + self._throttle_stick()), 0.0)

    def _throttle_stick(self) -> float:
        """Return the throttle stick as -1..1.

        Before 4.7, which added RCMAP_*, it was relative to its trim, which is at its low end.
        """
        stick = self.rc.fraction(_THROTTLE)
        return stick if self.parameters["RCMAP_THROTTLE"] else 2.0 * stick - 1.0

    def steer(self) -> None:
        """Turn as commanded by the yaw stick. With the stick centred, stop the turn for 250 ms, then hold the
        heading. Hold roll and pitch.
        """
        self.hold_tilt()
        estimate, ms = self.estimate, self.ms
        stick = self.rc.angle(_YAW, _STICK_FULL, self.parameters["RC4_DZ"] * self.gain)
        if ms - self._target_ms < _TARGET_LIFE_MS:
            self.yaw.hold(self._hold_heading)
        elif stick != 0:
            self.yaw.turn(math.radians(stick * self.parameters["ACRO_YAW_P"] / 100.0))
            self._hold_heading, self._turned_ms = estimate.yaw, ms
        elif ms - self._turned_ms < _STOPPING_MS:
            self.yaw.turn(0.0)
            self._hold_heading = estimate.yaw
        else:
            self.yaw.hold(self._hold_heading)
        self.motors.yaw = self.yaw.run(estimate.yaw, estimate.yaw_rate, self.motors.limit_yaw)

    def hold_depth(self) -> None:
        """Climb by the throttle stick, else hold the depth."""
        rate = self._climb_stick()
        if rate == 0.0 and -_CM * self.estimate.z > self.parameters["SURFACE_DEPTH"]:
            self.depth.target = min(self.depth.target, self.parameters["SURFACE_DEPTH"])
        self.depth.climb(rate)
        self.run_depth()

    def run_depth(self) -> None:
        """Let the depth loop hold its target."""
        estimate, depth = self.estimate, self.depth
        altitude = -_CM * estimate.z
        throttle = depth.run(
            altitude, _CM * estimate.climb, _CM * estimate.climb_acceleration, self.motors.limit_throttle
        )
        if altitude > self.parameters["SURFACE_DEPTH"]:
            throttle = min(throttle, 0.5 + 0.5 * self.parameters["SURFACE_MAX_THR"])
        self.motors.set_throttle(throttle, _DEPTH_CUTOFF)

    def _climb_stick(self) -> float:
        """Return the commanded climb rate [cm/s, up], zero within THR_DZ (scaled by the gain)."""
        stick = self._throttle_stick()
        dead = self.parameters["THR_DZ"] * self.gain / 500.0
        if abs(stick) <= dead:
            return 0.0
        up, down = self.parameters["PILOT_SPEED_UP"], self.parameters["PILOT_SPEED_DN"]
        fastest = up if stick > 0.0 else down or up
        return math.copysign((abs(stick) - dead) / (1.0 - dead) * fastest, stick)


_MANUAL_INPUT, _STABILIZE, _GUIDED = 64, 16, 8
_PUSH = 0.1
"""Fraction of full stick beyond which the pilot moves the place that is held."""


class _SubMode(Mode):
    def __init__(self, sub: Sub) -> None:
        self.sub = sub

    def enter(self) -> None:
        """Hold the present heading and depth."""
        self.sub.reset_loops()


class SubManualMode(_SubMode):
    """Passes sticks directly to the motors."""

    number, name, flags = 19, "MANUAL", _MANUAL_INPUT

    def run(self) -> None:
        """Set all demands to the stick positions."""
        self.sub.pass_yaw_stick()
        self.sub.pass_tilt_sticks()
        self.sub.pass_throttle_stick()
        self.sub.pass_horizontal_sticks()


class StabilizeMode(_SubMode):
    """Holds the heading. The throttle stick acts directly on the vertical thrusters."""

    number, name, flags = 0, "STABILIZE", _MANUAL_INPUT | _STABILIZE

    def run(self) -> None:
        """Run the yaw loop, and set the other demands to the stick positions."""
        self.sub.steer()
        self.sub.pass_throttle_stick()
        self.sub.pass_horizontal_sticks()


class AltHoldMode(_SubMode):
    """Holds heading and depth."""

    number, name, flags = 2, "ALT_HOLD", _MANUAL_INPUT | _STABILIZE

    def run(self) -> None:
        """Run the yaw and depth loops, and pass the horizontal sticks to the motors."""
        self.sub.steer()
        self.sub.hold_depth()
        self.sub.pass_horizontal_sticks()


class _PositionMode(_SubMode):
    flags = _STABILIZE | _GUIDED
    needs_position = True

    def enter(self) -> None:
        """Hold heading, depth and the place where the craft comes to rest."""
        super().enter()
        self.sub.start_position()

    def report(self) -> WayReport:
        """Return the way to the place that is held or flown to."""
        sub = self.sub
        place = (sub.waypoint.destination if sub.waypoint.active else sub.position.target) / _CM
        way = place - sub.estimate.place
        return WayReport(place, abs(way), cmath.phase(way), 0.0, 0.0)


class PosHoldMode(_PositionMode):
    """Heading, depth and place are held; the sticks push, and while they do the place follows."""

    number, name, flags = 16, "POSHOLD", _MANUAL_INPUT | _STABILIZE | _GUIDED

    def run(self) -> None:
        """Run the yaw, depth and position loops."""
        sub = self.sub
        ahead, aside = sub.rc.fraction(_FORWARD), sub.rc.fraction(_LATERAL)
        forward, lateral = sub.hold_place(anew=max(abs(ahead), abs(aside)) > _PUSH)
        sub.steer()
        sub.hold_depth()
        sub.motors.forward, sub.motors.lateral = forward + ahead, lateral + aside


class SubGuidedMode(_PositionMode):
    """Heading, depth and place follow targets from the ground; yaw and throttle sticks still count."""

    number, name = 4, "GUIDED"

    def run(self) -> None:
        """Run the yaw, depth and position loops."""
        sub = self.sub
        sub.steer()
        if sub.approach_goal():
            sub.run_depth()
        elif sub.waypoint.active:
            sub.advance_waypoint()
            sub.run_depth()
        else:
            sub.hold_depth()
        sub.motors.forward, sub.motors.lateral = sub.hold_place()
