"""The other stations on this link and the commands received from them.

This program does not act on their messages. But if the vehicle does something that we did not command, the operator
must know who caused it. The first source are the commands themselves, if a router forwards them to all. The second is
the vehicle's COMMAND_ACK, which contains the station that it answers. Otherwise the list of stations present is used. A
vehicle may also report which station controls it (CONTROL_STATUS) and whose sticks it uses (MANUAL_INPUT_STATUS). These
reports are shown.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection
from dataclasses import dataclass

from gcs_autotune.link.session import Session
from gcs_autotune.mavlink import (
    AT_WORK,
    CONTROL_STATUS_NAMES,
    MANUAL_INPUT_NAMES,
    REQUEST_OPERATOR_CONTROL,
    ControlStatus,
    Frame,
    ManualInput,
    Message,
    control_status,
    enum_name,
    manual_input,
    mavlink,
    type_name,
)

__all__ = ["Order", "OtherStations"]

_KEPT = 100
_RECENT = 10.0
"""Silence [s] above which a station is no longer considered a possible cause: ten heartbeats. Project choice."""

_STICKS = frozenset({"MANUAL_CONTROL", "RC_CHANNELS_OVERRIDE"})

_TARGETS = {"MANUAL_CONTROL": "target"}
"""Message -> field with its target, for messages that do not use ``target_system``."""

ORDERS = frozenset(
    {
        "COMMAND_INT",
        "COMMAND_LONG",
        "MANUAL_CONTROL",
        "PARAM_SET",
        "RC_CHANNELS_OVERRIDE",
        "REQUEST_DATA_STREAM",
        "SET_ATTITUDE_TARGET",
        "SET_MODE",
        "SET_POSITION_TARGET_GLOBAL_INT",
        "SET_POSITION_TARGET_LOCAL_NED",
    }
)
"""Names of the messages with which a station commands a vehicle."""


@dataclass(frozen=True, slots=True)
class Order:
    """A command of another station: link time [s], sender, message or MAV_CMD, and the parameter name if any."""

    t: float
    system: int
    component: int
    what: str
    name: str = ""


class OtherStations:
    """The other stations on a session's link.

    Attributes
    ----------
    stations : (system, component) -> its reported type, e.g. ``GCS``; ``""`` before its first heartbeat.
    orders : the last commands received, oldest first.
    in_control : the station that the vehicle reports to obey; None if not reported.
    steering : whose sticks the vehicle reports to use; None if not reported.
    radio : text of a telemetry radio's last report (RADIO_STATUS); empty if there is none.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._heard: dict[tuple[int, int], float] = {}
        self.stations: dict[tuple[int, int], str] = {}
        self._at_work: tuple[int, int] | None = None
        self.orders: deque[Order] = deque(maxlen=_KEPT)
        self.in_control: ControlStatus | None = None
        self.steering: ManualInput | None = None
        self.radio = ""
        for name in CONTROL_STATUS_NAMES:
            session.listen(name, self._on_control_status)
        for name in MANUAL_INPUT_NAMES:
            session.listen(name, self._on_manual_input)
        session.listen("COMMAND_LONG", self._on_control_request)
        session.routing.overhear(self._on_other_station)
        session.listen("COMMAND_ACK", self._on_acknowledgement)

    def culprit(self, kinds: Collection[str], since: float, name: str = "") -> str:
        """Return a sentence that identifies the station that sent a command of any of *kinds* (for parameter *name*)
        since link time *since* [s].
        """
        steered = self._steered_by() if _STICKS & set(kinds) else ""
        return self._suspect(kinds, since, name) + self._in_control_of_it() + steered

    def _in_control_of_it(self) -> str:
        """Return a sentence on which station the vehicle reports to obey, if that is not us."""
        status = self.in_control
        if status is None or status.station == self._session.port.system:
            return ""
        who = self._called_system(status.station) if status.station else "no station"
        return f"; the vehicle reports that {who} is in control of it (CONTROL_STATUS)"

    def _steered_by(self) -> str:
        """Return a sentence on whose sticks the vehicle reports to use, if they are not ours."""
        manual = self.steering
        if manual is None or not (manual.is_receiver or self._is_other_station(manual)):
            return ""
        who = "its own RC receiver" if manual.is_receiver else self._called(*manual.station)
        return f"; the vehicle reports that {who} steers it (MANUAL_INPUT_STATUS)"

    def _is_other_station(self, manual: ManualInput) -> bool:
        packer = self._session.port.packer
        return manual.station[0] != 0 and manual.station != (packer.system, packer.component)

    def _on_manual_input(self, message: Message) -> None:
        manual = manual_input(message)
        if manual is None or manual == self.steering:
            return
        self.steering = manual
        if self._is_other_station(manual):
            self._session.notes.append(
                f"the vehicle reports that {self._called(*manual.station)} steers it (MANUAL_INPUT_STATUS). Release "
                "the joystick there"
            )

    def _called_system(self, system: int) -> str:
        return self._called(system, self._component(system, 0)) if self._is_known(system) else f"system {system}"

    def _is_known(self, system: int) -> bool:
        return any(of == system for of, _ in self.stations)

    def _on_control_status(self, message: Message) -> None:
        status = control_status(message)
        if status is None or status == self.in_control:
            return
        before, self.in_control = self.in_control, status
        ours = self._session.port.system
        if status.station not in (0, ours):
            how = (
                "that station releases control on request" if status.takeover_allowed else "that station keeps control"
            )
            self._session.notes.append(
                f"the vehicle reports that {self._called_system(status.station)} is in control of it (CONTROL_STATUS), "
                f"and may reject commands of this tool; {how}. Release control there, or let that station fly"
            )
        elif before is not None:
            who = "this tool is" if status.station else "no station is"
            self._session.notes.append(f"the vehicle reports that {who} in control of it now (CONTROL_STATUS)")

    def _on_control_request(self, message: Message) -> None:
        """Record another station's request for control, which the vehicle forwards to the station in control."""
        if int(message.command) == REQUEST_OPERATOR_CONTROL and message.target_system == self._session.port.system:
            self._session.notes.append(
                f"{self._called_system(int(message.param4))} requests control of the vehicle. Control was not released"
            )

    def _suspect(self, kinds: Collection[str], since: float, name: str) -> str:
        fitting = self._ordered(kinds, since, name)
        if fitting:
            order = fitting[-1]
            return f"{self._called(order.system, order.component)} sent {order.what}"
        present = [
            self._called(*ids) for ids, t in sorted(self._heard.items()) if self._session.clock.now() - t < _RECENT
        ]
        if present:
            return f"also on this link: {', '.join(present)}"
        return "no other station is on this link, so the order came over another link or from on board"

    @property
    def at_work(self) -> str:
        """Text of the station that recently ran gcs-autotune; empty if none is known."""
        ids = self._at_work
        if ids is None or self._session.clock.now() - self._heard[ids] >= _RECENT:
            return ""
        return self._called(*ids)

    def has_ordered(self, kinds: Collection[str], since: float) -> bool:
        """Return whether a command of any of *kinds* was received from others since link time *since* [s]."""
        return bool(self._ordered(kinds, since))

    def _ordered(self, kinds: Collection[str], since: float, name: str = "") -> list[Order]:
        return [o for o in self.orders if o.t >= since and o.what in kinds and name in ("", o.name)]

    def _called(self, system: int, component: int) -> str:
        kind = self.stations.get((system, component), "")
        return f"{kind or 'station'} (system {system}, component {component})"

    def _on_other_station(self, frame: Frame) -> None:
        if frame.name in ("RADIO_STATUS", "RADIO"):
            self._on_radio(frame.message)
            return
        ids = frame.system, frame.component
        self._heard[ids] = self._session.clock.now()
        if frame.name == "HEARTBEAT":
            self.stations[ids] = type_name(int(frame.message.type))
            if ids == (self._session.port.system, self._session.beacon):
                return  # our own, which a router sent back
            if int(frame.message.custom_mode) == AT_WORK:
                self._at_work = ids
        else:
            self.stations.setdefault(ids, "")
        if frame.name in ORDERS and self._is_for_our_vehicle(frame):
            self._take(*ids, _spelled(frame.name, frame.message), str(getattr(frame.message, "param_id", "")))

    def _on_radio(self, m: Message) -> None:
        """Record RADIO_STATUS, which a radio sends with its own id.

        Signal and noise are in the radio's units; 255 means unknown.
        """
        self.radio = (
            f"signal {m.rssi} and noise {m.noise} here, {m.remrssi} and {m.remnoise} on board; {m.txbuf} % of its "
            f"buffer free; {m.rxerrors} packets damaged"
        )

    def _is_for_our_vehicle(self, frame: Frame) -> bool:
        vehicle = self._session.vehicle
        target = getattr(frame.message, _TARGETS.get(frame.name, "target_system"), 0)
        return vehicle is not None and target in (0, vehicle.system)

    def _on_acknowledgement(self, ack: Message) -> None:
        """Record whose command the vehicle acknowledges. It sends the acknowledgement to all stations."""
        system = int(getattr(ack, "target_system", 0))
        if system not in (0, self._session.port.system) and ack.result == mavlink.MAV_RESULT_ACCEPTED:
            component = self._component(system, int(getattr(ack, "target_component", 0)))
            self._heard[system, component] = self._session.clock.now()
            self.stations.setdefault((system, component), "")
            self._take(system, component, _command_name(int(ack.command)))

    def _component(self, system: int, reported: int) -> int:
        """Return the reported component, or the known one of that system if the vehicle reports none."""
        known = [component for of, component in self.stations if of == system]
        return known[0] if reported == 0 and len(known) == 1 else reported

    def _take(self, system: int, component: int, what: str, name: str = "") -> None:
        self.orders.append(Order(self._session.clock.now(), system, component, what, name))


def _spelled(name: str, message: Message) -> str:
    return _command_name(int(message.command)) if name in ("COMMAND_LONG", "COMMAND_INT") else name


def _command_name(number: int) -> str:
    """Return the name of a MAV_CMD. ArduPilot acknowledges the old SET_MODE by its message number."""
    if number == mavlink.MAVLINK_MSG_ID_SET_MODE:
        return "SET_MODE"
    return enum_name("MAV_CMD", number)
