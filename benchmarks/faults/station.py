"""Another ground station on its own link, and a check that the tool does not undo its orders."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from benchmarks.faults.fault import Fault

if TYPE_CHECKING:
    from benchmarks.faults.vehicle import VehicleAsFound

__all__ = ["STICK_PERIOD", "Order", "OtherStation", "misattributed", "order_in", "undone_orders"]

_SYSTEM, _TWIN = 200, 255
STICK_PERIOD = 0.05
_TIE = 0.3
"""Time [s] after another station's order within which an order of the tool is a tie.

It was already on its way, or was based on the vehicle's state just before. No station can prevent this.
"""


@dataclass(frozen=True, slots=True)
class Order:
    """An order to the vehicle: its time [s], ``mode``, ``armed`` or ``write``, and the value.

    ``seen``: mode of the vehicle when an order of the tool arrived; None if unknown.
    """

    t: float
    what: str
    value: float = math.nan
    name: str = ""
    seen: int | None = None


def order_in(message: Any, t: float, mode: int | None = None) -> Order | None:
    """Return the order of mode or armed state or the write in *message* at time *t* [s]; else None."""
    name = message.get_type()
    if name == "PARAM_SET":
        return Order(t, "write", float(message.param_value), str(message.param_id), mode)
    if name == "COMMAND_LONG" and message.command == mavlink.MAV_CMD_DO_SET_MODE:
        return Order(t, "mode", message.param2, seen=mode)
    if name == "COMMAND_LONG" and message.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
        return Order(t, "armed", message.param1, seen=mode)
    return None


class OtherStation:
    """A station with its own port of the vehicle. The tool does not receive the replies at this port."""

    def __init__(self, vehicle: VehicleAsFound, gain: str) -> None:
        self._vehicle = vehicle
        self._gain = gain
        self._packer = mavlink.MAVLink(None, srcSystem=_SYSTEM, srcComponent=190)
        self._twin = mavlink.MAVLink(None, srcSystem=_TWIN, srcComponent=100)
        self.orders: list[Order] = []
        self.sticks_until = -math.inf
        self._next_stick = 0.0

    def act(self, fault: Fault) -> None:
        """Carry out a fault of this station."""
        now, mode = self._vehicle.server.now, int(fault.size)
        autopilot = self._vehicle.server.vehicle.autopilot
        if fault.kind == "station-mode" and autopilot.mode.number == mode:
            return  # changes nothing, so it cannot be noticed
        if fault.kind == "station-disarm" and not autopilot.armed:
            return
        if fault.kind == "station-mode":
            self._order(Order(now, "mode", mode), mavlink.MAV_CMD_DO_SET_MODE, 1.0, float(mode))
        elif fault.kind == "station-disarm":
            self._order(Order(now, "armed", 0.0), mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0)
        elif fault.kind == "station-write":
            value = round(1.37 * self._vehicle.server.vehicle.parameters.values[self._gain] + 0.0421, 4)
            self.orders.append(Order(now, "write", value, self._gain))
            message = mavlink.MAVLink_param_set_message(1, 1, self._gain.encode(), value, 9)
            self._vehicle.server.receive_elsewhere(message.pack(self._packer))
        else:
            self.orders.append(Order(now, "sticks", fault.duration))
            self.sticks_until = now + fault.duration

    def steer(self) -> None:
        """Send stick overrides, if this station steers at present."""
        now = self._vehicle.server.now
        if now < self.sticks_until and now >= self._next_stick:
            self._next_stick = now + STICK_PERIOD
            sticks = mavlink.MAVLink_rc_channels_override_message(
                1, 1, 1640, 1500, 1420, 1630, 1500, 1580, 65535, 65535
            )
            self._vehicle.server.receive_elsewhere(sticks.pack(self._twin))

    def _order(self, order: Order, command: int, *values: float) -> None:
        self.orders.append(order)
        padded = [*values, *[0.0] * (7 - len(values))]
        message = mavlink.MAVLink_command_long_message(1, 1, command, 0, *padded)
        self._vehicle.server.receive_elsewhere(message.pack(self._packer))


def undone_orders(orders: Sequence[Order], ours: Sequence[Order], stops_in: Sequence[int]) -> tuple[list[str], int]:
    """Return descriptions of the station's *orders* that the tool's orders undid, and the number of ties.

    Disarming a vehicle that the station has stopped (a mode of *stops_in*) undoes nothing. Neither does an order after
    a failsafe of the vehicle has replaced the mode.
    """
    found, ties = [], 0
    for order in orders:
        for own in ours:
            if own.t < order.t or not _undoes(own, order, stops_in):
                continue
            if own.t - order.t <= _TIE:
                ties += 1
            else:
                found.append(
                    f"{order.what} {order.value:g} of another station undone {own.t - order.t:.1f} s later: {own}"
                )
    return found, ties


def _undoes(own: Order, order: Order, stops_in: Sequence[int]) -> bool:
    if order.what == "mode" and own.seen is not None and own.seen != order.value:
        return False  # something else had replaced the mode before
    if order.what == "mode":
        disarms = own.what == "armed" and own.value == 0.0 and int(order.value) not in stops_in
        return disarms or (own.what == "mode" and own.value != order.value)
    if order.what == "armed":
        return own.what == "armed" and own.value == 1.0
    return order.what == "write" and own.what == "write" and own.name == order.name


CAUSE_TEXTS: Mapping[str, tuple[str, ...]] = {
    "station-mode": ("not by this tool", "another station may have ordered", "was armed, not by this tool"),
    "station-disarm": ("not by this tool", "another station may have ordered"),
    "station-sticks": ("overrides of another sender", "the sticks were moved"),
    "station-write": ("another ground station wrote", "another station changed it", "another station wrote"),
    "reboot": ("has restarted", "Lost contact with"),
    "stall": ("this computer paused",),
    "silence": (
        "Lost contact with",
        "the link was silent",
        "another station may have ordered",
        "the vehicle's own failsafe",
        "its messages were lost",
    ),
}
"""Kind of fault -> texts of the program that report it."""


def misattributed(text: str, kinds: Sequence[str]) -> str:
    """Return what is wrong with the causes in *text* of a run that ended early; *kinds*: the possible causes."""
    fitting = [words for kind in kinds for words in CAUSE_TEXTS.get(kind, ())]
    wrong = [words for group in CAUSE_TEXTS.values() for words in group if words in text and words not in fitting]
    if wrong:
        return f"reports {wrong[0]!r}, but the cause is one of {', '.join(kinds)}"
    return "" if any(words in text for words in fitting) else f"reports none of {', '.join(kinds)}"
