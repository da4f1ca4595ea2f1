"""Convert MAVLink telemetry to SI signals with the vehicle's own stamps.

Every sample is stored in the current trial without resampling. At the next control tick the latest values form one
observation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from gcs_autotune.craft import Observation
from gcs_autotune.errors import TelemetryFault
from gcs_autotune.firmware import LEVELLING, ServoMap
from gcs_autotune.frames import flat, to_body
from gcs_autotune.link.session import Session
from gcs_autotune.link.vehicle.wall_beams import WallBeams, yaw_of
from gcs_autotune.link.vehicle.watchdog import BootClock, Unwrapper, Watchdog
from gcs_autotune.mavlink import Frame, Message, mavlink, message_number
from gcs_autotune.sname import SIGNALS
from gcs_autotune.trial import Channel, Mark, Trial

__all__ = ["UNITS", "Recorder", "Telemetry", "await_tick", "observation"]

UNITS: Mapping[str, str] = {
    **{name: signal.unit for name, signal in SIGNALS.items()},
    **dict.fromkeys("XYZKMN", "1"),
    "battery": "V",
    "battery_remaining": "1",
    "pressure": "Pa",
}
"""Recorded channel -> its unit. Forces are fractions of full actuator output."""


class Recorder:
    """Stores samples while a trial runs, and discards them otherwise."""

    def __init__(self) -> None:
        self._name: str | None = None
        self._samples: dict[str, tuple[list[float], list[float]]] = {}
        self._marks: list[Mark] = []
        self.late = 0

    def start(self, name: str) -> None:
        """Begin a new trial and discard an unfinished one."""
        self._name = name
        self._samples, self._marks, self.late = {}, [], 0

    def take(self, t: float, values: Mapping[str, float]) -> None:
        """Add samples stamped *t* [s]. A sample older than the last of its channel counts as late and is discarded."""
        if self._name is None:
            return
        for name, value in values.items():
            times, column = self._samples.setdefault(name, ([], []))
            if times and t < times[-1]:
                self.late += 1
                continue
            times.append(t)
            column.append(value)

    def mark(self, mark: Mark) -> None:
        """Add an event."""
        if self._name is not None:
            self._marks.append(mark)

    def so_far(self, ending: str, reason: str, meta: Mapping[str, Any]) -> Trial:
        """Return the trial recorded so far; an empty trial if none is running."""
        channels = {
            name: Channel(name, UNITS.get(name, "1"), np.array(times), np.array(column))
            for name, (times, column) in self._samples.items()
            if name not in LEVELLING or any(column)
        }
        details = {**meta, "late_samples": self.late} if self.late else dict(meta)
        return Trial(self._name or "", channels, tuple(self._marks), ending, reason, details)

    def stop(self, ending: str, reason: str, meta: Mapping[str, Any]) -> Trial:
        """End the trial and return it; an empty trial if none was running."""
        trial = self.so_far(ending, reason, meta)
        self._name = None
        return trial


_SAME_MOMENT = 0.005
"""Largest difference of stamps [s] of two messages from one estimate. Project choice."""
_BETWEEN = 1.0
"""Longest interval [s] over which a depth is interpolated. Project choice."""
_PREFER_LOCAL = 2.0
"""Time [s] without LOCAL_POSITION_NED after which GLOBAL_POSITION_INT supplies the position. Project choice."""
_HAS_PLACE = int(mavlink.EKF_POS_HORIZ_REL | mavlink.EKF_POS_HORIZ_ABS)
"""Bits of EKF_STATUS_REPORT.flags of an estimator with a position."""
_UNKNOWN_VOLTAGE = 65535
_LONGEST_GAP = 0.5
"""Silence of the outputs [s] above which a change gets the time stamp of its own message. Project choice."""


class Telemetry:
    """Listens to a session and keeps the latest value of every signal.

    Position ``x``, ``y`` and velocity come from LOCAL_POSITION_NED, or else from GLOBAL_POSITION_INT. They never come
    from both, because their origins differ. ``z`` is minus the relative altitude of GLOBAL_POSITION_INT, or else that
    of LOCAL_POSITION_NED.

    The autopilot's gyro filter delays turn rates by ``rate_lag`` [s]. They are recorded at the time they apply to, so
    that they match the angles, which are not delayed. ``loop_period`` [s] is the period of the autopilot's main loop.

    Attributes
    ----------
    latest : signal -> last value (names of ``sname.SIGNALS``, ``battery``, ``battery_remaining``, ``pressure``).
    t : stamp [s] of the last ATTITUDE. ticks : number of ATTITUDE messages received.
    outputs, output_t : measured force fractions and their stamp. output_ticks : number of output messages received.
    output_since : estimated time of their last change [s].
    fix : last latitude and longitude [deg], None before any.
    servos : relation between servo outputs and forces.
    """

    def __init__(
        self, session: Session, servos: ServoMap, recorder: Recorder, *, loop_period: float = 0.0, rate_lag: float = 0.0
    ) -> None:
        self.servos = servos
        self._loop_period = loop_period
        self._rate_lag = rate_lag
        self._recorder = recorder
        self._clock = BootClock()
        self._unwrapper = Unwrapper()
        self._origin: tuple[float, float] | None = None
        self._position_source = ""
        self._global_since = math.nan
        self._depth_source = ""
        self.watchdog = Watchdog(session.clock)
        self.latest: dict[str, float] = {}
        self.outputs: dict[str, float] = {}
        self.output_t = math.nan
        self.output_since = math.nan
        self.fix: tuple[float, float] | None = None
        self.depth_offset = 0.0
        """Depth below the estimator's origin minus depth below home [m]. They differ by centimetres or more."""
        self._local_z = self._global_z = (math.nan, math.nan)
        self._had_place = self._lost_place = False
        self.output_ticks = 0
        self.distance_t = self.angle_t = math.nan
        self._beams = WallBeams()
        self._rangefinder: int | None = None
        self._companion: int | None = None
        self._session = session
        self.t = math.nan
        self.ticks = 0
        for name, reader in self._readers().items():
            session.listen(name, reader)
        session.routing.overhear(self._overheard)

    def _readers(self) -> Mapping[str, Callable[[Message], None]]:
        return {
            "ATTITUDE": self._attitude,
            "SERVO_OUTPUT_RAW": self._servo_output,
            "LOCAL_POSITION_NED": self._local_position,
            "GLOBAL_POSITION_INT": self._global_position,
            "VFR_HUD": self._vfr_hud,
            "SCALED_PRESSURE2": self._pressure,
            "SYS_STATUS": self._sys_status,
            "NAMED_VALUE_FLOAT": self._named_value,
            "DISTANCE_SENSOR": self._distance,
            "EKF_STATUS_REPORT": self._estimator,
            "MISSION_CURRENT": partial(self._mission_item, 0),
            "MISSION_ITEM_REACHED": partial(self._mission_item, 1),
            "SYSTEM_TIME": lambda m: self.watchdog.check_boot_time(m.time_boot_ms * 1e-3),
        }

    @property
    def boot_time(self) -> float:
        """The vehicle's time since boot [s] by the latest stamp; NaN before any."""
        return self._clock.now

    @property
    def has_local_position(self) -> bool:
        """Whether ``x`` and ``y`` count from the estimator's origin (LOCAL_POSITION_NED)."""
        return self._position_source == "local"

    def value(self, name: str) -> float:
        """Return the latest value of the signal *name* [SI], or NaN if none was received."""
        return self.latest.get(name, math.nan)

    def _take(self, t: float, values: Mapping[str, float]) -> None:
        self.latest.update(values)
        self._recorder.take(t, values)

    def _attitude(self, m: Message) -> None:
        t = self._clock.from_ms(m.time_boot_ms)
        if not self.watchdog.check_stamp(t):
            return
        attitude = (m.roll, m.pitch, m.yaw, m.rollspeed, m.pitchspeed, m.yawspeed)
        self.watchdog.check_attitude(t, attitude)
        if not math.isfinite(m.yaw):
            return
        self.t = t
        self.ticks += 1
        psi = self._unwrapper.unwrap(m.yaw)
        self._take(t, {"phi": m.roll, "theta": m.pitch, "psi": psi})
        self._take(t - self._rate_lag, {"p": m.rollspeed, "q": m.pitchspeed, "r": m.yawspeed})

    def _servo_output(self, m: Message) -> None:
        t = self._clock.from_us(m.time_usec)
        if m.port != 0 or math.isnan(t):
            return
        pwms = (
            m.servo1_raw,
            m.servo2_raw,
            m.servo3_raw,
            m.servo4_raw,
            m.servo5_raw,
            m.servo6_raw,
            m.servo7_raw,
            m.servo8_raw,
        )
        forces = self.servos.forces(pwms)
        self.watchdog.note_outputs(t, forces)
        self._record_outputs(t, forces)
        self.outputs, self.output_t = forces, t
        self.output_ticks += 1

    def _record_outputs(self, t: float, forces: Mapping[str, float]) -> None:
        """Set the time of an output change midway between the earliest and the latest moment at which it may have
        happened.

        The earliest is one autopilot loop after the last message without the change. The latest is the first message
        with it. Outputs change only at loops, and a message contains those of its own loop. Using the later stamp would
        add half an interval of delay on average. That is noticeable when identifying a craft with a two-second
        oscillation.
        """
        gap = t - self.output_t
        midway = t - 0.5 * max(gap - self._loop_period, 0.0) if gap < _LONGEST_GAP else t
        changed = {n: f for n, f in forces.items() if f != self.outputs.get(n)}
        if changed:
            self.output_since = midway
        self._recorder.take(midway, changed)
        self._recorder.take(t, {n: f for n, f in forces.items() if n not in changed})

    def _local_position(self, m: Message) -> None:
        t = self._clock.from_ms(m.time_boot_ms)
        earlier, self._local_z = self._local_z, (t, m.z)
        self._compare_depths(earlier, self._local_z)
        if self._position_source in ("", "local"):
            self._position_source = "local"
            self._take_motion(t, m.x, m.y, m.vx, m.vy)
        if self._depth_source in ("", "local"):
            self._depth_source = "local"
            self._take(t, {"z": m.z, "w": m.vz})

    def _global_position(self, m: Message) -> None:
        t = self._clock.from_ms(m.time_boot_ms)
        self._depth_source = "global"
        self._global_z = (t, -m.relative_alt * 1e-3)
        self._compare_depths(self._local_z, self._local_z)
        self._take(t, {"z": -m.relative_alt * 1e-3, "w": m.vz * 1e-2})
        has_fix = m.lat != 0 or m.lon != 0
        if has_fix:
            self.fix = m.lat * 1e-7, m.lon * 1e-7
        if self.fix is not None and has_fix and self._use_global(t):
            x, y = self._flat(*self.fix)
            self._take_motion(t, x, y, m.vx * 1e-2, m.vy * 1e-2)

    def _take_motion(self, t: float, x: float, y: float, north: float, east: float) -> None:
        """Record position [m] and velocity over ground [m/s]; NaN while the autopilot has lost its position."""
        if self._lost_place:
            x = y = north = east = math.nan
        self._take(t, {"x": x, "y": y, **self._velocity(t, north, east)})

    def _estimator(self, m: Message) -> None:
        """Note whether the autopilot has lost a position that it had: it reports the last one on and on."""
        has_place = bool(m.flags & _HAS_PLACE)
        self._had_place |= has_place
        self._lost_place = self._had_place and not has_place

    def _compare_depths(self, earlier: tuple[float, float], later: tuple[float, float]) -> None:
        """Compare the depth below home with the depth below the estimator's origin, interpolated to the same time.

        ArduPilot sends the global message before the local one of the same moment; a router may send them at different
        times.
        """
        t, below_home = self._global_z
        if earlier[0] - _SAME_MOMENT <= t <= later[0] + _SAME_MOMENT and later[0] - earlier[0] <= _BETWEEN:
            below_origin = float(np.interp(t, (earlier[0], later[0]), (earlier[1], later[1])))
            self.depth_offset = below_origin - below_home

    def _use_global(self, t: float) -> bool:
        if self._position_source == "" and math.isnan(self._global_since):
            self._global_since = t
        if self._position_source == "" and t - self._global_since >= _PREFER_LOCAL:
            self._position_source = "global"
        return self._position_source == "global"

    def _flat(self, lat_deg: float, lon_deg: float) -> tuple[float, float]:
        """Return metres north and east of the first position fix."""
        if self._origin is None:
            self._origin = (lat_deg, lon_deg)
        return flat(lat_deg, lon_deg, self._origin)

    def _velocity(self, t: float, north: float, east: float) -> dict[str, float]:
        """Return velocity over ground [m/s] in the body frame, with the heading extrapolated to *t*."""
        if not (math.isfinite(north) and math.isfinite(east)):
            return {"U": math.nan, "u": math.nan, "v": math.nan}
        psi = self.value("psi")
        rate = self.value("r")
        if math.isfinite(rate) and abs(t - self.t) < 1.0:
            psi += rate * (t - self.t)
        velocity = {"U": math.hypot(north, east)}
        if math.isfinite(psi):
            velocity["u"], velocity["v"] = to_body(north, east, psi)
        return velocity

    def _vfr_hud(self, m: Message) -> None:
        if not self._position_source and self._clock.is_set:
            self._take(self._clock.now, {"U": m.groundspeed})

    def _pressure(self, m: Message) -> None:
        self._take(self._clock.from_ms(m.time_boot_ms), {"pressure": m.press_abs * 100.0})

    def _named_value(self, m: Message) -> None:
        if m.name.rstrip("\0") == "PilotGain":
            self.latest["pilot_gain"] = m.value

    def _mission_item(self, ahead: int, m: Message) -> None:
        """Store the item under way: *ahead* of the one that the message names."""
        self.latest["waypoint"] = float(m.seq + ahead)

    def _distance(self, m: Message) -> None:
        """Record the distance ahead; NaN beyond the sensor's range.

        The rangefinder with the lowest id is ``d``; another one ahead is ``d_starboard``. Two that look to either side
        of the bow give ``wall_angle``, and ``d`` if none looks straight ahead.
        """
        if self._companion is None and yaw_of(m) is not None:
            self._measured(self._clock.from_ms(m.time_boot_ms), m)

    def _overheard(self, frame: Frame) -> None:
        """Record the distance that a companion computer of the vehicle sends, from then on instead of the autopilot's.

        Its clock is not the autopilot's, so the time of the latest telemetry is used. ArduPilot cannot distinguish two
        MAVLink rangefinders ahead, so what it reports of them is not used.
        """
        vehicle = self._session.vehicle
        is_ours = frame.name == "DISTANCE_SENSOR" and vehicle is not None and frame.system == vehicle.system
        if not is_ours or yaw_of(frame.message) is None or not self._clock.is_set:
            return
        if self._companion is None:
            self._companion, self._rangefinder, self._beams = frame.component, None, WallBeams()
        if frame.component == self._companion:
            self._measured(self._clock.now, frame.message)

    def _measured(self, t: float, m: Message) -> None:
        known = m.min_distance <= m.current_distance <= m.max_distance
        distance = m.current_distance * 1e-2 if known else math.nan
        yaw = yaw_of(m)
        if yaw:
            self._seen_aside(t, yaw, distance)
            return
        self._rangefinder = m.id if self._rangefinder is None else min(m.id, self._rangefinder)
        self._take(t, {"d" if m.id == self._rangefinder else "d_starboard": distance})
        self.distance_t = t

    def _seen_aside(self, t: float, yaw: float, distance: float) -> None:
        wall = self._beams.add(t, yaw, distance)
        if wall is None:
            return
        if self._rangefinder is None:
            self._take(t, {"d": wall[0]})
            self.distance_t = t
        self._take(t, {"wall_angle": wall[1]})
        self.angle_t = t

    def _sys_status(self, m: Message) -> None:
        values = {}
        if m.voltage_battery not in (0, _UNKNOWN_VOLTAGE):
            values["battery"] = m.voltage_battery * 1e-3
        if m.battery_remaining >= 0:
            values["battery_remaining"] = m.battery_remaining * 1e-2
        if values and self._clock.is_set:
            self._take(self._clock.now, values)
        self.latest["prearm_ok"] = _prearm_ok(m)


def _prearm_ok(m: Message) -> float:
    """Return 1 if the pre-arm checks pass, 0 if they fail, NaN if unknown."""
    bit = 0x10000000  # MAV_SYS_STATUS_PREARM_CHECK
    if not m.onboard_control_sensors_enabled & bit:
        return math.nan
    return 1.0 if m.onboard_control_sensors_health & bit else 0.0


_OLD = 3.0
"""Age [s] above which a distance is invalid. Project choice."""
_TICK_TIMEOUT = 3.0
_MISSED = 1.0
"""Time [s] after the last attitude at which the vehicle's time since boot is requested. Project choice."""
_SYSTEM_TIME = message_number("SYSTEM_TIME")
_SILENT_AFTER = 2.0
"""Time [s] without any message after which missing attitudes are attributed to the link: two heartbeats. Project
choice."""


def await_tick(session: Session, telemetry: Telemetry) -> None:
    """Pump until the next ATTITUDE.

    Raises
    ------
    LinkLost, OperatorStopped
        Raised by the session.
    TelemetryFault
        NaN, frozen or jumping telemetry; or no attitude although other messages arrive.
    """
    ticks, begun = telemetry.ticks, session.liveness.listened
    requested = False
    while telemetry.ticks == ticks:
        telemetry.watchdog.check()
        if session.liveness.listened - begun > _MISSED and not requested:  # a restart ends the requested streams
            requested = True
            session.request_message(_SYSTEM_TIME)
        if session.tolerates_silence:
            begun = session.liveness.listened
        if session.liveness.listened - begun > _TICK_TIMEOUT:
            session.check_contact(_SILENT_AFTER)
            raise TelemetryFault(
                f"no usable ATTITUDE for {_TICK_TIMEOUT:g} s, although the vehicle sends messages. Check whether "
                "another ground station changes the stream rates"
            )
        session.pump()
    telemetry.watchdog.check()


def observation(session: Session, telemetry: Telemetry, mode: str) -> Observation:
    """Return the latest values of all signals as the observation of a craft in *mode*."""
    value = telemetry.value
    return Observation(
        t=telemetry.t,
        psi=value("psi"),
        r=value("r"),
        phi=value("phi"),
        theta=value("theta"),
        p=value("p"),
        q=value("q"),
        x=value("x"),
        y=value("y"),
        z=value("z"),
        u=value("u"),
        v=value("v"),
        w=value("w"),
        speed=value("U"),
        d=value("d") if telemetry.t - telemetry.distance_t < _OLD else math.nan,
        d_starboard=value("d_starboard") if telemetry.t - telemetry.distance_t < _OLD else math.nan,
        wall_angle=value("wall_angle") if telemetry.t - telemetry.angle_t < _OLD else math.nan,
        waypoint=value("waypoint"),
        output=telemetry.outputs,
        output_t=telemetry.output_t,
        armed=session.armed,
        mode=mode,
        battery_voltage=value("battery"),
        battery_remaining=value("battery_remaining"),
        age=session.liveness.silence,
    )
