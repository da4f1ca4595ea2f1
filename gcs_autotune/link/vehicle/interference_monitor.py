"""Others at work on the vehicle while we command it: whose doing it is, and that we let go at once.

Another ground station that asks for its own stream rates changes ours: that is noticed, asked for again, and said.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from functools import partial

from gcs_autotune.errors import GuardTripped
from gcs_autotune.firmware import Firmware
from gcs_autotune.foreign_text import quoted
from gcs_autotune.link.parameters.client import Parameters
from gcs_autotune.link.session import Session
from gcs_autotune.link.vehicle.other_stations import OtherStations
from gcs_autotune.link.vehicle.rates import Rates
from gcs_autotune.link.vehicle.rc_monitor import RcMonitor
from gcs_autotune.link.vehicle.setpoint_streamer import SendRate
from gcs_autotune.mavlink import Message, mavlink, message_number

__all__ = ["InterferenceMonitor", "RateKeeper"]

_LOOK_BACK = 5.0
"""Chosen [s]: an order this old may be the cause of what is seen now; heartbeats show a mode a second late."""
_OWN_DOING = "failsafe"
"""ArduPilot names every one of its own accord so: "EKF failsafe", "Radio Failsafe", "Battery 1 low failsafe"."""
_AHEAD = 1.5
"""A simulation whose time goes faster than the clock by this is said to run ahead."""
_FELT = 0.4
"""Chosen [s of the vehicle's time]: ArduRover without a receiver takes its pilot for lost after half a second."""
_MODE_ORDERS = frozenset({"SET_MODE", "MAV_CMD_DO_SET_MODE", "MAV_CMD_NAV_RETURN_TO_LAUNCH", "MAV_CMD_MISSION_START"})
_ARM_ORDERS = frozenset({"MAV_CMD_COMPONENT_ARM_DISARM", "MAV_CMD_DO_FLIGHTTERMINATION"})
_STICK_ORDERS = frozenset({"RC_CHANNELS_OVERRIDE", "MANUAL_CONTROL"})


class InterferenceMonitor:
    """What is expected of the vehicle while it is ours, and a check of it at every tick.

    Attributes
    ----------
    mode : custom mode number that is expected, None while it is just being changed by us.
    armed : whether it is expected to be armed, None while that is just being changed by us.
    """

    def __init__(
        self,
        session: Session,
        firmware: Firmware,
        parameters: Parameters,
        other_stations: OtherStations,
        rc_monitor: RcMonitor,
        send_rate: SendRate,
    ) -> None:
        self._session = session
        self._firmware = firmware
        self._parameters = parameters
        self._other_stations = other_stations
        self._rc_monitor = rc_monitor
        self._send_rate = send_rate
        self.mode: int | None = None
        self.armed: bool | None = None

    def take_over(self) -> None:
        """From now on it is ours, as it is."""
        self.mode, self.armed = self._session.custom_mode, self._session.armed

    def change(self) -> None:
        """Mode and arming are about to be changed by us."""
        self.mode = self.armed = None

    def check(self) -> None:
        """Raise ``GuardTripped`` when somebody else has taken a hand, saying who as far as that can be known."""
        self._check_parameters()
        self._check_mode()
        self._check_armed()
        self._check_sticks()

    def _check_parameters(self) -> None:
        if self._parameters.intrusions:
            name, old, new = self._parameters.intrusions[0]
            raise GuardTripped(
                f"another ground station wrote {name} = {new:g} (it was {old:g}): "
                f"{self._who(frozenset({'PARAM_SET'}), name)}. Disconnect it and start again",
                guard="parameters",
                value=new,
                limit=old,
            )

    def _check_mode(self) -> None:
        if self.mode is not None and self._session.custom_mode != self.mode:
            expected, now = self._firmware.mode_name(self.mode), self._firmware.mode_name(self._session.custom_mode)
            self._see_our_pause(f"the vehicle went from {expected} to {now}", _MODE_ORDERS)
            raise GuardTripped(
                f"the vehicle went from {expected} to {now}, not by us{self._last_words()}: {self._who(_MODE_ORDERS)}",
                guard="mode",
            )

    def _check_armed(self) -> None:
        if self.armed and not self._session.armed:
            self._see_our_pause("the vehicle was disarmed", _ARM_ORDERS)
            raise GuardTripped(
                f"the vehicle was disarmed, not by us{self._last_words()}: {self._who(_ARM_ORDERS)}", guard="armed"
            )

    def _check_sticks(self) -> None:
        moved = self._rc_monitor.moved_by_hand
        if moved is not None:
            raise GuardTripped(
                f"a pilot's hand: RC channel {moved[0]} of the vehicle's own receiver went from {moved[1]} to "
                f"{moved[2]} us. Leave the transmitter alone, or switched off, while this tool steers",
                guard="sticks",
                value=float(moved[2]),
                limit=float(moved[1]),
            )
        departed = self._rc_monitor.departed
        if departed is not None:
            channel, sent, shown = departed
            raise GuardTripped(
                f"somebody else is steering: RC channel {channel} shows {shown} us where {sent} us were sent"
                f"{self._last_words()}: {self._who(_STICK_ORDERS)}. Unplug other joysticks; if there is none, our "
                "overrides do not get through",
                guard="sticks",
                value=float(shown),
                limit=float(sent),
            )

    def _see_our_pause(self, what: str, kinds: frozenset[str]) -> None:
        """Raise ``GuardTripped`` (guard ``pause``) when it was this computer that kept the vehicle waiting."""
        since = self._session.clock.now() - _LOOK_BACK
        pause, pace = self._send_rate.pause_since(since), max(self._send_rate.pace, 1.0)
        if pause * pace < _FELT or self._other_stations.has_ordered(kinds, since):
            return
        ran = f", {pause * pace:.1f} s of the vehicle's time," if pace > _AHEAD else ""
        cure = "let the simulation run slower" if pace > _AHEAD else "close other programs"
        raise GuardTripped(
            f"{what}{self._last_words()}: this computer paused for {pause:.2g} s{ran} and sent no overrides meanwhile. "
            f"It was not the radio, nor another station: {cure}, and try again",
            guard="pause",
            value=pause * pace,
            limit=_FELT,
        )

    def _who(self, kinds: frozenset[str], name: str = "") -> str:
        moved = self._rc_monitor.moved_by_hand
        if moved is not None and not name:
            return f"RC channel {moved[0]} went from {moved[1]} to {moved[2]} us just now, a switch on the transmitter"
        since = self._session.clock.now() - _LOOK_BACK
        own_doing = any(_OWN_DOING in text.casefold() for text in self._session.texts.recent(since))
        if own_doing and not name and not self._other_stations.has_ordered(kinds, since):
            return "it was a failsafe of its own. Look after what it names, and start again"
        return self._other_stations.culprit(kinds, since, name)

    def _last_words(self) -> str:
        texts = self._session.texts.recent(self._session.clock.now() - _LOOK_BACK)
        return f" (it says: {quoted(texts)})" if texts else ""


_VITAL = ("ATTITUDE", "SERVO_OUTPUT_RAW", "RC_CHANNELS")
_WINDOW = 2.0
"""Chosen [s of the vehicle's time]: long enough to tell a lost message from a changed rate."""
_LOW = 0.6
"""Chosen: share of the rate measured at the handshake below which it is asked for again."""
_REQUESTS = frozenset({"REQUEST_DATA_STREAM", "MAV_CMD_SET_MESSAGE_INTERVAL"})
_RATES_LOOK_BACK = 10.0


class RateKeeper:
    """Counts what we cannot do without, and asks again when it thins out. Call :meth:`start` once rates are known."""

    def __init__(self, session: Session, rates: Rates, other_stations: OtherStations) -> None:
        self._session = session
        self._rates = rates
        self._other_stations = other_stations
        self._counts: Counter[str] = Counter()
        self._stamp = self._begun = 0.0
        self._noted: set[str] = set()

    def start(self) -> None:
        """From now on the rates last measured are kept."""
        for name in _VITAL:
            self._session.listen(name, partial(self._on_message, name))
        self._session.every(1.0, self._look)

    def _on_message(self, name: str, m: Message) -> None:
        self._counts[name] += 1
        if name != "SERVO_OUTPUT_RAW":  # its stamp is in microseconds, and wraps
            self._stamp = m.time_boot_ms * 1e-3

    def _look(self) -> None:
        span = self._stamp - self._begun
        if 0.0 <= span < _WINDOW:
            return
        if span <= 5.0 * _WINDOW and self._begun > 0.0:
            self._judge({name: self._counts[name] / span for name in _VITAL})
        self._counts.clear()
        self._begun = self._stamp

    def _judge(self, rates: Mapping[str, float]) -> None:
        thin = {}
        for name, rate in rates.items():
            granted, usual = self._rates.granted.get(name), self._rates.measured.get(name, 0.0)
            if granted is not None and granted.granted > 0.0 and rate < _LOW * usual:
                self._ask_again(name, granted.granted)
                thin[name] = f"{name} at {rate:.1f} Hz instead of {usual:.1f}"
        if set(thin) - self._noted:
            self._noted |= set(thin)
            who = self._other_stations.culprit(_REQUESTS, self._session.clock.now() - _RATES_LOOK_BACK)
            self._session.notes.append(
                f"for a while {', '.join(thin.values())} came, asked for again: lost on the way, or another station "
                f"has asked for other rates ({who})"
            )

    def _ask_again(self, name: str, rate: float) -> None:
        vehicle = self._session.vehicle
        if vehicle is not None:
            wanted = (float(message_number(name)), 1e6 / rate, 0.0, 0.0, 0.0, 0.0, 0.0)
            command = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
            self._session.send(
                mavlink.MAVLink_command_long_message(vehicle.system, vehicle.component, command, 0, *wanted)
            )
