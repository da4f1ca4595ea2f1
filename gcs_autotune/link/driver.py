"""Sticks and targets out: what is commanded stays commanded, 25 times a second, until somebody lets go."""

from __future__ import annotations

import math
from collections.abc import Mapping

from gcs_autotune.craft import Actuate, Command, DepthTarget, HeadingTarget, TurnRateTarget
from gcs_autotune.firmware import Firmware
from gcs_autotune.link.beat import Beat
from gcs_autotune.link.latency import Latency
from gcs_autotune.link.overrides import OverrideMap
from gcs_autotune.link.rate_stick import RateStick
from gcs_autotune.link.session import Session
from gcs_autotune.link.sticks import Sticks
from gcs_autotune.link.targets import ATTITUDE_TARGETS, depth_target, turn_rate_target
from gcs_autotune.link.telemetry import Telemetry

__all__ = ["FOLLOW_TIMEOUT", "Driver"]

_NARROW_REFRESH = 0.1
"""Chosen: seconds of link time after which the active command is repeated where there is no room for more."""
_STALE = 0.15
"""Chosen: the same in vehicle time; above one control period, so that a command per tick is not doubled."""
_SYNC_PERIOD = 1.0
"""Seconds between two TIMESYNCs."""
_CROWD = 3
"""An override and a target together take less than three overrides (30 and at most 53 bytes, unsigned)."""
_REPEATS = 5
"""Releases sent at once: losing five in a row is rare even where every second one is lost."""
FOLLOW_TIMEOUT = 3.0
"""Chosen [s]: longer than any healthy link takes, shorter than an operator's patience."""


class Driver:
    """Sends overrides and targets, keeps them in force, and hands the sticks back.

    Attributes
    ----------
    clock : the link's.
    active : the command in force, None when the sticks are not ours.
    beat : how regularly overrides really go out.
    """

    def __init__(
        self,
        session: Session,
        firmware: Firmware,
        overrides: OverrideMap,
        full_speed: float,
        telemetry: Telemetry,
        latency: Latency,
        sticks: Sticks,
        *,
        rate_stick: RateStick | None = None,
    ) -> None:
        assert session.vehicle is not None
        self._session = session
        self._firmware = firmware
        self._overrides = overrides
        self._full_speed = full_speed
        self._telemetry = telemetry
        self._latency = latency
        self._sticks = sticks
        self._rate_stick = rate_stick
        self._ids = (session.vehicle.system, session.vehicle.component)
        self._nudging = False
        self._copies = 1
        self._sparing = False
        self._sent = self._sent_t = -math.inf
        self.clock = session.clock
        self.active: Command | None = None
        self.beat = Beat(session.clock)
        self._duty = session.every(session.transport.repeat_period, self._refresh)
        session.every(_SYNC_PERIOD, latency.ask)
        session.listen("ATTITUDE", lambda _: self._refresh_in_vehicle_time())
        session.listen("SERVO_OUTPUT_RAW", lambda _: latency.moved(telemetry.output_since, telemetry.outputs))

    def spare_the_link(self) -> None:
        """Send ten overrides a second instead of twenty-five: there is no room for more."""
        self._duty.period, self._sparing = _NARROW_REFRESH, True

    def crowd(self) -> None:
        """From now on send every override as often as to fill what overrides and targets together will take."""
        self._copies = _CROWD

    def thin_out(self) -> None:
        """End that."""
        self._copies = 1

    def command(self, command: Command) -> None:
        """Put *command* on the wire and keep it in force; on a link to be spared not again when just sent."""
        if self._sparing and command == self.active and self.clock.now() - self._sent < 0.5 * _NARROW_REFRESH:
            return
        self.active = command
        wanted = command if isinstance(command, Actuate) else Actuate()
        forces = {force: getattr(wanted, force) for force in self._overrides.channels}
        self._latency.commanded(forces, self._telemetry.outputs, self._telemetry.t)
        self._transmit(command)

    def rest(self) -> None:
        """Neutral, repeatedly: the first may be lost."""
        self._latency.forget()
        self.active = Actuate()
        for _ in range(_REPEATS):
            self._transmit(self.active)

    def nudge(self) -> bool:
        """Stream overrides that are as good as neutral until RC_CHANNELS shows them; return whether it did."""
        self._nudging, self.active = True, Actuate()
        try:
            self._transmit(self.active)
            return self._session.wait_for(lambda: self.is_nudged or None, FOLLOW_TIMEOUT) is not None
        finally:
            self._nudging = False

    @property
    def is_nudged(self) -> bool:
        """Whether RC_CHANNELS shows what :meth:`nudge` sends."""
        return self._sticks.show(self._overrides.nudged)

    @property
    def is_obeyed(self) -> bool:
        """Whether RC_CHANNELS shows the overrides of the active command."""
        return self._sticks.show(self._values(self.active)) if self.active is not None else False

    @property
    def differing(self) -> str:
        """Channels that do not show what :meth:`nudge` sends, in words."""
        shown = self._sticks.shown
        return ", ".join(
            f"channel {n} {shown.get(n, 0)} us for {pwm}"
            for n, pwm in self._overrides.nudged.items()
            if pwm != shown[n]
        )

    def let_go(self) -> None:
        """Hand the sticks back to the RC receiver, if there is one."""
        self.active = None
        self._sticks.forget()
        self._latency.forget()
        self.beat.rest()
        for _ in range(_REPEATS):
            self._release()

    def let_go_visibly(self) -> bool:
        """Let go, and see by RC_CHANNELS that the sticks are the receiver's again; return whether they are.

        Without a receiver there is nothing to see: the vehicle keeps the last value, which is neutral.
        """
        marked = bool(self._sticks.has_receiver) and self.nudge()
        self.let_go()
        return not marked or self._session.wait_for(self._is_released, FOLLOW_TIMEOUT) is not None

    def _is_released(self) -> bool | None:
        """Whether the nudged values are gone; if not, the releases may have been lost."""
        if not self.is_nudged:
            return True
        self._release()
        return None

    def _release(self) -> None:
        self._session.send(self._overrides.release(*self._ids))

    def _refresh(self) -> None:
        if self.active is not None:
            self._transmit(self.active)

    def _refresh_in_vehicle_time(self) -> None:
        """A simulator that runs ahead of the wall clock lets overrides expire by its own time."""
        if self._telemetry.t - self._sent_t > _STALE:
            self._refresh()

    def _values(self, command: Command) -> Mapping[int, int]:
        if self._nudging:
            return self._overrides.nudged
        if isinstance(command, TurnRateTarget) and self._rate_stick is not None:
            gain = self._telemetry.value("pilot_gain")
            return self._overrides.values(Actuate(N=self._rate_stick.deflection(command.r, gain)))
        return self._overrides.values(command if isinstance(command, Actuate) else Actuate())

    def _transmit(self, command: Command) -> None:
        """Send the command; targets go with neutral overrides, which tell the failsafes that we are there."""
        self._duty.postpone()
        self.beat.strike(self._telemetry.t)
        self._sent, self._sent_t = self.clock.now(), self._telemetry.t
        values, trip = self._values(command), self._latency.round_trip
        self._sticks.sent(values, 2.0 * trip if math.isfinite(trip) else 0.0)
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
