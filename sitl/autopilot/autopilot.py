"""Functions shared by both firmwares: boot, modes, arming, texts, state estimate, battery, and the steps of one
loop.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Protocol

from sitl.autopilot.mission import Crew, Mission
from sitl.autopilot.mode import Mode
from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.rc_input import RcInput
from sitl.autopilot.servo_rail import ServoRail
from sitl.autopilot.shaping import TwoPoleLowPass
from sitl.sensors import SensorReading

__all__ = [
    "CRITICAL",
    "ERROR",
    "INFO",
    "NOTICE",
    "SLOW_RATE",
    "WARNING",
    "Autopilot",
    "BatteryMonitor",
    "ScriptHost",
    "StateEstimate",
]


class StateEstimate:
    """Attitude and position as estimated by the autopilot: sensors through its filters.

    SI, radians, NED; angles are not filtered. Turn rates are delayed by the gyro filter (INS_GYRO_FILTER), 4 Hz on
    Rover, which is about 55 ms. ``climb`` and ``climb_acceleration`` point up.
    """

    def __init__(self, parameters: ParameterStore) -> None:
        self._values = parameters.values
        self._gyro_x, self._gyro_y, self._gyro_z = TwoPoleLowPass(), TwoPoleLowPass(), TwoPoleLowPass()
        self._accelerometer = TwoPoleLowPass()
        self.roll = self.pitch = self.yaw = 0.0
        self.roll_rate = self.pitch_rate = self.yaw_rate = 0.0
        self.speed = 0.0
        self.x = self.y = self.z = 0.0
        self._sway = self.vz = 0.0
        self.climb = self.climb_acceleration = 0.0
        self.distance = self.distance_starboard = math.nan

    def update(self, reading: SensorReading, dt: float) -> None:
        """Update the estimate with one sample of the sensors, *dt* [s] after the last."""
        values = self._values
        self.roll, self.pitch, self.yaw = reading.phi, reading.theta, reading.psi
        cutoff = values["INS_GYRO_FILTER"]
        self.roll_rate = self._gyro_x.apply(reading.p, cutoff, dt)
        self.pitch_rate = self._gyro_y.apply(reading.q, cutoff, dt)
        self.yaw_rate = self._gyro_z.apply(reading.r, cutoff, dt)
        self.speed = reading.u
        self.x, self.y, self.z = reading.x, reading.y, reading.z
        self._sway, self.vz = reading.v, reading.w
        self.distance, self.distance_starboard = reading.d, reading.d_starboard
        self.climb = -reading.w
        self.climb_acceleration = self._accelerometer.apply(-reading.az, values["INS_ACCEL_FILTER"], dt)

    @property
    def place(self) -> complex:
        """The position on the plane, north + i east [m] of the origin."""
        return complex(self.x, self.y)

    @property
    def velocity(self) -> complex:
        """The velocity on the plane, north + i east [m/s]."""
        return complex(self.vx, self.vy)

    @property
    def vx(self) -> float:
        """Velocity to the north [m/s]."""
        return self.speed * math.cos(self.yaw) - self._sway * math.sin(self.yaw)

    @property
    def vy(self) -> float:
        """Velocity to the east [m/s]."""
        return self.speed * math.sin(self.yaw) + self._sway * math.cos(self.yaw)


_WARNING = 4


class ScriptHost(Protocol):
    """What runs Lua scripts on this autopilot. The simulator has none of its own; tests bring one."""

    def tick(self) -> None:
        """Run the scripts that are due."""

    def restart(self) -> None:
        """Reload all scripts on the card."""


class _Owner(Protocol):
    ms: int

    def say(self, severity: int, text: str) -> None: ...

    def act_on_battery(self, action: int) -> None: ...


class BatteryMonitor:
    """Triggers the battery failsafe once, when the voltage has been below BATT_LOW_VOLT for BATT_LOW_TIMER seconds.

    Without a monitor (BATT_MONITOR 0 at boot, ``is_fitted``) nothing is measured or checked.
    """

    def __init__(self, parameters: ParameterStore) -> None:
        self._values = parameters.values
        self._low_since_ms: int | None = None
        self.is_fitted = parameters["BATT_MONITOR"] > 0
        self.voltage = 0.0
        self.is_low = False

    def arming_fault(self) -> str | None:
        """Return the reason why the battery prevents arming, or None."""
        if self.is_fitted and self.voltage < self._values["BATT_ARM_VOLT"]:
            return "Battery 1 below minimum arming voltage"
        return "Battery 1 low voltage failsafe" if self.is_low else None

    def update(self, owner: _Owner, voltage: float, consumed_mah: float) -> None:
        """Check the present voltage [V], and trigger the failsafe if due. The message shows the charge used [mAh]."""
        if not self.is_fitted:
            return
        values = self._values
        self.voltage = voltage
        if self.is_low or not 0.0 < voltage < values["BATT_LOW_VOLT"]:
            self._low_since_ms = None
            return
        if self._low_since_ms is None:
            self._low_since_ms = owner.ms
        if owner.ms - self._low_since_ms >= values["BATT_LOW_TIMER"] * 1000.0:
            self.is_low = True
            owner.say(_WARNING, f"Battery 1 is low {voltage:.2f}V used {consumed_mah:.0f} mAh")
            owner.act_on_battery(int(values["BATT_FS_LOW_ACT"]))


SLOW_RATE = 50
"""Rate [Hz] at which sticks and failsafes are processed at any loop rate (ArduPilot's scheduler tables)."""

CRITICAL, ERROR, WARNING, NOTICE, INFO = 2, 3, 4, 5, 6
"""MAV_SEVERITY."""
_SLOW_PERIOD_MS = 1000 // SLOW_RATE
_PREARM_PERIOD_MS = 1000
_HOME_LEAST = 0.5
"""Home follows a disarmed craft in steps of at least that [m]."""
_PREARM_REPORT_MS = 30000
_FIRST_REPORT_MS = 2000


class Autopilot(ABC):
    """One firmware on its board. ``tick`` runs one loop; all other methods may be called between loops.

    ``ms`` is the time since boot, ``texts`` the STATUSTEXTs not yet sent as (severity, text), ``reached_items`` the
    mission items not yet reported as reached, ``last_gcs_ms`` when the ground station was last heard, ``failsafe``
    whether one is in force. ``home`` follows the craft until it arms (north + i east [m]). ``tilts``: whether the craft
    has roll and pitch to control. ``aided``: whether position or velocity is measured. ``has_gps``: whether GPS1_TYPE
    was set at boot. ``scripts`` runs Lua scripts, if SCR_ENABLE was set at boot.
    """

    firmware: str
    mav_type: int
    boot_mode: int
    tilts = False
    aided = True

    def __init__(self, parameters: ParameterStore, dt: float, ready_ms: int) -> None:
        self.parameters = parameters
        self.dt = dt
        self.ready_ms = ready_ms
        self.ms = 0
        self.estimate = StateEstimate(parameters)
        self.rc = RcInput(parameters)
        self.rail = ServoRail(parameters)
        self.battery = BatteryMonitor(parameters)
        self.has_gps = parameters["GPS1_TYPE"] > 0
        self.armed = False
        self.last_gcs_ms = 0
        self.texts: list[tuple[int, str]] = []
        self.reached_items: list[int] = []
        self.mission = Mission()
        self.scripts: ScriptHost | None = None
        self.home: complex | None = None
        self.prearm_ok = False
        self._next_report_ms = _FIRST_REPORT_MS
        self.modes: Mapping[int, Mode] = self._make_modes()
        self.mode: Mode = self.modes[self.boot_mode]

    @abstractmethod
    def _make_modes(self) -> Mapping[int, Mode]:
        """Return the flight modes by number."""

    @property
    @abstractmethod
    def failsafe(self) -> bool:
        """Whether a failsafe is active."""

    @property
    @abstractmethod
    def throttle_percent(self) -> int:
        """Throttle shown in VFR_HUD [%]."""

    @abstractmethod
    def check_failsafes(self) -> None:
        """Check for a lost pilot or ground station, and execute the failsafe action."""

    @abstractmethod
    def act_on_battery(self, action: int) -> None:
        """Execute the *action* of the battery failsafe, numbered as in the firmware."""

    @abstractmethod
    def arming_fault(self, *, arming: bool) -> str | None:
        """Return the reason why the craft must not arm, or None. *arming*: include checks that are made only at
        arming.
        """

    @abstractmethod
    def write_outputs(self) -> None:
        """Write the demands to the servo outputs, or neutral if disarmed."""

    @property
    def pwm(self) -> list[int]:
        """Pulses of all servo outputs [us]; 0 without a signal."""
        return self.rail.pwm

    @property
    def position_ok(self) -> bool:
        """Whether the position estimate is good enough for modes that need it."""
        return self.aided and self.ms >= self.ready_ms

    def say(self, severity: int, text: str) -> None:
        """Queue a STATUSTEXT, truncated to 50 characters."""
        self.texts.append((severity, text))

    def note_gcs(self) -> None:
        """Record that the ground station with the configured id has just sent a message."""
        self.last_gcs_ms = self.ms

    def tick(self, ms: int, reading: SensorReading, voltage: float, consumed_mah: float) -> None:
        """Run one loop at *ms* [ms] since boot: estimate, failsafes, flight mode, outputs."""
        self.ms = ms
        self.estimate.update(reading, self.dt)
        if ms % _SLOW_PERIOD_MS == 0:
            self.check_failsafes()
            self.battery.update(self, voltage, consumed_mah)
            if ms % _PREARM_PERIOD_MS == 0:
                self._check_prearm()
                self._follow_home()
        if self.scripts is not None:
            self.scripts.tick()
        if self.armed:
            self.mode.run()
        self.write_outputs()

    def set_mode(self, number: int) -> bool:
        """Change the flight mode. Return whether it was accepted. If not, a STATUSTEXT states the reason."""
        mode = self.modes.get(number)
        if mode is None:
            self.say(WARNING, f"No such mode {number}")
            return False
        if mode is self.mode:
            return True
        if mode.needs_position and self.armed and not self.position_ok:
            self.say(WARNING, f"Mode change to {mode.name} failed: requires position")
            return False
        refusal = mode.refusal()
        if refusal is not None:
            self.say(WARNING, refusal)
            return False
        self.mode.leave()
        self.mode = mode
        mode.enter()
        return True

    def set_mission_item(self, index: int) -> bool:
        """Go on with item *index* of the mission; return whether there is one. Only AUTO starts it at once."""
        crew = self.mission_crew
        return crew is not None and self.mission.set_current(index, crew)

    @property
    def mission_crew(self) -> Crew | None:
        """Who flies the mission; None where the firmware's AUTO is not simulated."""
        return None

    def arm(self, *, force: bool) -> bool:
        """Arm. Return whether it was accepted. If not, a STATUSTEXT states the reason. *force* skips the checks."""
        if self.armed:
            return True
        fault = None if force else self.arming_fault(arming=True)
        if fault is not None:
            self.say(CRITICAL, f"Arm: {fault}")
            return False
        self.armed = True
        self.mode.enter()
        self.say(INFO, "Throttle armed")
        return True

    def disarm(self) -> bool:
        """Disarm at once. Always returns True."""
        if self.armed:
            self.armed = False
            self.say(INFO, "Throttle disarmed")
        return True

    def _follow_home(self) -> None:
        place = self.estimate.place
        if not self.armed and self.position_ok and (self.home is None or abs(place - self.home) >= _HOME_LEAST):
            self.home = place

    def _check_prearm(self) -> None:
        fault = self.arming_fault(arming=False)
        self.prearm_ok = fault is None
        if fault is not None and not self.armed and self.ms >= self._next_report_ms:
            self._next_report_ms = self.ms + _PREARM_REPORT_MS
            self.say(CRITICAL, f"PreArm: {fault}")
