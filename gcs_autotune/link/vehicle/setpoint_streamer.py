"""Send overrides and set-points, repeated 25 times a second until released."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace

from gcs_autotune.clock import Clock
from gcs_autotune.craft import Actuate, Command, DepthTarget, HeadingTarget, PositionTarget, TurnRateTarget
from gcs_autotune.firmware import Firmware
from gcs_autotune.link.session import Session
from gcs_autotune.link.vehicle.latency import Latency
from gcs_autotune.link.vehicle.rc_monitor import RcMonitor
from gcs_autotune.link.vehicle.telemetry import Telemetry
from gcs_autotune.link.vehicle.vehicle_config import VehicleConfig
from gcs_autotune.mavlink import Message, mavlink

__all__ = [
    "ATTITUDE_TARGETS",
    "FOLLOW_TIMEOUT",
    "SendRate",
    "SetpointStreamer",
    "depth_target",
    "position_target",
    "turn_rate_target",
]

_IGNORE_BODY_RATES = 0b111
_IGNORE_THRUST = 1 << 6
_YAW_RATE_ONLY = 0b10000011
"""ATTITUDE_TARGET_TYPEMASK that ignores attitude and body roll and pitch rates, and uses yaw rate and thrust."""
_ONLY_Z = 0b110111111011
"""POSITION_TARGET_TYPEMASK that ignores everything except z. Its force bit selects acceleration, which is ignored."""
_POSITION_AND_YAW = 0b100111000000
"""POSITION_TARGET_TYPEMASK that ignores accelerations and the yaw rate. The velocity is zero: without it ArduSub turns
towards the target (WP_YAW_BEHAVIOR)."""
_HALF = 0.5
"""Thrust value that ArduSub interprets as neither up nor down, if it reads this field."""


def _quaternion(psi: float, phi: float = 0.0, theta: float = 0.0) -> list[float]:
    """Return (w, x, y, z) of the attitude with heading *psi*, roll *phi* and pitch *theta* [rad]."""
    (a, i), (b, j), (c, k) = (
        (math.cos(0.5 * angle), math.sin(0.5 * angle)) for angle in (phi, theta, math.remainder(psi, math.tau))
    )
    return [a * b * c + i * j * k, i * b * c - a * j * k, a * j * c + i * b * k, a * b * k - i * j * c]


def _attitude(ids: tuple[int, int], target: HeadingTarget, mask: int, thrust: float) -> Message:
    quaternion = _quaternion(target.psi, target.phi, target.theta)
    return mavlink.MAVLink_set_attitude_target_message(0, *ids, mask, quaternion, 0.0, 0.0, 0.0, thrust)


def _share(speed: float, full_speed: float) -> float:
    return max(-1.0, min(1.0, speed / full_speed)) if full_speed > 0.0 else 0.0


def turn_rate_target(ids: tuple[int, int], target: TurnRateTarget, full_speed: float) -> Message:
    """Return the message that commands a turn rate [rad/s] and a speed [m/s] to a Rover in GUIDED."""
    thrust = _share(target.speed, full_speed)
    nothing = _quaternion(0.0)
    return mavlink.MAVLink_set_attitude_target_message(0, *ids, _YAW_RATE_ONLY, nothing, 0.0, 0.0, target.r, thrust)


def _boat(ids: tuple[int, int], target: HeadingTarget, full_speed: float) -> Message:
    """Return the target for a Rover in GUIDED: heading as quaternion and thrust as a fraction of WP_SPEED, both
    needed."""
    return _attitude(ids, target, _IGNORE_BODY_RATES, _share(target.speed, full_speed))


def _rov(ids: tuple[int, int], target: HeadingTarget, full_speed: float) -> Message:
    """Return the target for a Sub in ALT_HOLD: an attitude that is valid for five seconds, while the depth loop
    continues."""
    return _attitude(ids, target, _IGNORE_BODY_RATES | _IGNORE_THRUST, _HALF)


ATTITUDE_TARGETS: Mapping[str, Callable[[tuple[int, int], HeadingTarget, float], Message]] = {
    "boat": _boat,
    "rov": _rov,
}
"""Type of vehicle (``Firmware.kind``) -> function that returns the message that commands a heading."""


def depth_target(ids: tuple[int, int], target: DepthTarget) -> Message:
    """Return SET_POSITION_TARGET_GLOBAL_INT for a depth [m] below the estimator's origin, as ArduSub interprets it.

    In ALT_HOLD, ArduSub reads only the altitude, relative to its origin, whatever frame the message contains.
    """
    nothing = [0.0] * 8
    return mavlink.MAVLink_set_position_target_global_int_message(
        0, *ids, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, _ONLY_Z, 0, 0, -target.z, *nothing
    )


def position_target(ids: tuple[int, int], target: PositionTarget) -> Message:
    """Return SET_POSITION_TARGET_LOCAL_NED for a position below and beside the estimator's origin."""
    where, nothing = (target.x, target.y, target.z), [0.0] * 6
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0,
        *ids,
        mavlink.MAV_FRAME_LOCAL_NED,
        _POSITION_AND_YAW,
        *where,
        *nothing,
        math.remainder(target.psi, math.tau),
        0.0,
    )


_LEAST_KEPT = 0.02
"""Pause [s] below which pauses are ignored."""
_KEPT = 200
_TELLING = 1.0
"""Time of sending [s] after which the pace of the vehicle's time is known."""


class SendRate:
    """Measures how regularly commands are sent, on the link's clock.

    Attributes
    ----------
    longest : longest pause between two commands [s]; NaN before the second command.
    pace : seconds of vehicle time per second of link time; 1 until known; above 1 in a simulation faster than real
        time.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._last = math.nan
        self._count = 0
        self._time = 0.0
        self._pauses: deque[tuple[float, float]] = deque(maxlen=_KEPT)
        self._begun = (math.nan, math.nan)
        self.longest = math.nan
        self.pace = 1.0

    @property
    def rate(self) -> float:
        """Mean rate of the commands [Hz]; NaN before the second command."""
        return self._count / self._time if self._time > 0.0 else math.nan

    def pause_since(self, t: float) -> float:
        """Return the longest pause between commands [s] that ended after link time *t* [s]; 0 if there was none."""
        return max((pause for end, pause in self._pauses if end >= t), default=0.0)

    def count(self, vehicle_time: float = math.nan) -> None:
        """Count a command sent now. *vehicle_time* [s] is the vehicle's last stamp."""
        now = self._clock.now()
        self._keep_pace(now, vehicle_time)
        if not math.isnan(self._last):
            pause = now - self._last
            self._count += 1
            self._time += pause
            self.longest = max(pause, self.longest) if not math.isnan(self.longest) else pause
            if pause > _LEAST_KEPT:
                self._pauses.append((now, pause))
        self._last = now

    def _keep_pace(self, now: float, vehicle_time: float) -> None:
        begun, then = self._begun
        if not vehicle_time >= then:  # the first, or its clock ran back
            self._begun = (now, vehicle_time)
        elif now - begun > _TELLING:
            self.pace = (vehicle_time - then) / (now - begun)

    def suspend(self) -> None:
        """Stop measuring pauses until the next command."""
        self._last = math.nan


_NARROW_REFRESH = 0.1
"""Repeat period [s of link time] of the active command on a narrow link. Project choice."""
_STALE = 0.15
"""Repeat period in vehicle time [s].

It is above one control period, so that a command sent per tick is not doubled. Project choice.
"""
_SYNC_PERIOD = 1.0
"""Seconds between two TIMESYNC requests."""
_CROWD = 3
"""Number of overrides sent per control period in the rehearsal.

An override and a target together are smaller than three overrides (30 and at most 53 bytes, unsigned).
"""
_REPEATS = 5
"""Number of release messages sent at once. Losing five in a row is rare even if every second one is lost."""
FOLLOW_TIMEOUT = 3.0
"""Longest time to wait for the effect of a command [s].

It is longer than on any healthy link and short enough for an operator. Project choice.
"""


class SetpointStreamer:
    """Sends overrides and targets, repeats them, and returns the sticks to the RC receiver.

    Attributes
    ----------
    clock : the link's clock.
    active : the command in force; None if we do not control the sticks.
    send_rate : the measured rate and pauses of the overrides.
    """

    def __init__(
        self,
        session: Session,
        firmware: Firmware,
        config: VehicleConfig,
        telemetry: Telemetry,
        latency: Latency,
        rc_monitor: RcMonitor,
    ) -> None:
        assert session.vehicle is not None
        self._session = session
        self._firmware = firmware
        self._overrides = config.overrides
        self._full_speed = config.full_speed
        self._telemetry = telemetry
        self._latency = latency
        self._rc_monitor = rc_monitor
        self._rate_stick = config.rate_stick
        self._ids = (session.vehicle.system, session.vehicle.component)
        self._probing = False
        self._copies = 1
        self._sparing = False
        self._sent = self._sent_t = -math.inf
        self.clock = session.clock
        self.active: Command | None = None
        self.send_rate = SendRate(session.clock)
        self._task = session.every(session.transport.repeat_period, self._refresh)
        session.every(_SYNC_PERIOD, latency.ask)
        session.listen("ATTITUDE", lambda _: self._refresh_in_vehicle_time())
        session.listen("SERVO_OUTPUT_RAW", lambda _: latency.moved(telemetry.output_since, telemetry.outputs))

    def spare_the_link(self) -> None:
        """Send ten overrides a second instead of twenty-five, on a link without capacity for more."""
        self._task.period, self._sparing = _NARROW_REFRESH, True

    def crowd(self) -> None:
        """Start a capacity test: send overrides at the byte rate that overrides and targets will need together."""
        self._copies = _CROWD

    def thin_out(self) -> None:
        """End the capacity test: send each override once again."""
        self._copies = 1

    def command(self, command: Command) -> None:
        """Send *command* and repeat it until the next one. On a slow link a command just sent is not sent again."""
        if self._sparing and command == self.active and self.clock.now() - self._sent < 0.5 * _NARROW_REFRESH:
            return
        self.active = command
        wanted = command if isinstance(command, Actuate) else Actuate()
        forces = {force: getattr(wanted, force) for force in self._overrides.channels}
        self._latency.commanded(forces, self._telemetry.outputs, self._telemetry.t)
        self._transmit(command)

    def rest(self) -> None:
        """Send neutral several times, because the first message may be lost."""
        self._latency.forget()
        self.active = Actuate()
        for _ in range(_REPEATS):
            self._transmit(self.active)

    def probe_override(self) -> bool:
        """Send nearly neutral overrides until RC_CHANNELS shows them. Return whether it shows them in time."""
        self._probing, self.active = True, Actuate()
        try:
            self._transmit(self.active)
            return self._session.wait_for(lambda: self.shows_probe or None, FOLLOW_TIMEOUT) is not None
        finally:
            self._probing = False

    @property
    def shows_probe(self) -> bool:
        """Whether RC_CHANNELS shows the values of :meth:`probe_override`."""
        return self._rc_monitor.show(self._overrides.probe)

    @property
    def is_obeyed(self) -> bool:
        """Whether RC_CHANNELS shows the overrides of the active command."""
        return self._rc_monitor.show(self._values(self.active)) if self.active is not None else False

    @property
    def differing(self) -> str:
        """Text with the channels that do not show the values of :meth:`probe_override`."""
        shown = self._rc_monitor.shown
        return ", ".join(
            f"channel {n} {shown.get(n, 0)} us for {pwm}" for n, pwm in self._overrides.probe.items() if pwm != shown[n]
        )

    def let_go(self) -> None:
        """Return the sticks to the RC receiver, if there is one."""
        self.active = None
        self._rc_monitor.forget()
        self._latency.forget()
        self.send_rate.suspend()
        for _ in range(_REPEATS):
            self._release()

    def let_go_visibly(self) -> bool:
        """Release the overrides. Return whether RC_CHANNELS shows that the RC receiver has the sticks.

        Without a receiver RC_CHANNELS shows nothing: the vehicle keeps the last value, which is neutral.
        """
        marked = bool(self._rc_monitor.has_receiver) and self.probe_override()
        self.let_go()
        return not marked or self._session.wait_for(self._is_released, FOLLOW_TIMEOUT) is not None

    def _is_released(self) -> bool | None:
        """Return whether the probe values have disappeared. If not, the release messages may have been lost."""
        if not self.shows_probe:
            return True
        self._release()
        return None

    def _release(self) -> None:
        self._session.send(self._overrides.release(*self._ids))

    def _refresh(self) -> None:
        if self.active is not None:
            self._transmit(self.active)

    def _refresh_in_vehicle_time(self) -> None:
        """Repeat in vehicle time, because in a simulator faster than real time overrides expire by its own clock."""
        if self._telemetry.t - self._sent_t > _STALE:
            self._refresh()

    def _values(self, command: Command) -> Mapping[int, int]:
        if self._probing:
            return self._overrides.probe
        if isinstance(command, TurnRateTarget) and self._rate_stick is not None:
            gain = self._telemetry.value("pilot_gain")
            return self._overrides.values(Actuate(N=self._rate_stick.deflection(command.r, gain)))
        return self._overrides.values(command if isinstance(command, Actuate) else Actuate())

    def _transmit(self, command: Command) -> None:
        """Send the command. Targets are sent with neutral overrides, which prevent failsafes."""
        self._task.postpone()
        self.send_rate.count(self._telemetry.t)
        self._sent, self._sent_t = self.clock.now(), self._telemetry.t
        values, trip = self._values(command), self._latency.round_trip
        self._rc_monitor.sent(values, 2.0 * trip if math.isfinite(trip) else 0.0)
        for _ in range(self._copies):
            self._session.send(self._overrides.message(values, *self._ids))
        if isinstance(command, HeadingTarget):
            encode = ATTITUDE_TARGETS[self._firmware.kind]
            self._session.send(encode(self._ids, command, self._full_speed))
        elif isinstance(command, TurnRateTarget) and self._rate_stick is None:
            self._session.send(turn_rate_target(self._ids, command, self._full_speed))
        elif isinstance(command, DepthTarget):
            below_origin = DepthTarget(command.z + self._telemetry.depth_offset)
            self._session.send(depth_target(self._ids, below_origin))
        elif isinstance(command, PositionTarget):
            where = replace(command, z=command.z + self._telemetry.depth_offset)
            self._session.send(position_target(self._ids, where))
