"""Find the serial ports of this computer and the senders on them. Nothing is sent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from gcs_autotune.clock import Deadline
from gcs_autotune.errors import CannotOpenLink, LinkError, LinkLost
from gcs_autotune.link.discovery import VehicleCandidate, is_autopilot
from gcs_autotune.link.transports import not_mavlink_advice, open_link
from gcs_autotune.link.transports.transport import Transport
from gcs_autotune.mavlink import Framer

__all__ = ["BAUDS", "Overheard", "PortSeen", "overhear", "serial_ports"]

BAUDS = (57600, 115200)
"""Baud rates tried on a serial port: ArduPilot's defaults of SERIALn_BAUD for radios, USB and companion computers."""
_LONGEST_READ = 0.1


@dataclass(frozen=True, slots=True)
class PortSeen:
    """A serial port: device, description, USB vendor and product (None: not USB)."""

    device: str
    description: str
    manufacturer: str = ""
    usb: tuple[int, int] | None = None

    def __str__(self) -> str:
        maker = f", {self.manufacturer}" if self.manufacturer and self.manufacturer not in self.description else ""
        usb = f" (USB {self.usb[0]:04x}:{self.usb[1]:04x})" if self.usb else ""
        return f"{self.device}: {self.description}{maker}{usb}"


@dataclass(frozen=True, slots=True)
class Overheard:
    """Messages received on a link while listening.

    Attributes
    ----------
    uri : the link, as ``--connect`` takes it.
    autopilots : senders that identify themselves as an autopilot. others : system ids of all other senders.
    messages, bad_bytes : number of MAVLink messages, and of bytes that belong to no message.
    trouble : reason why the link could not be opened; empty if it was opened.
    """

    uri: str
    autopilots: tuple[VehicleCandidate, ...] = ()
    others: tuple[int, ...] = ()
    messages: int = 0
    bad_bytes: int = 0
    trouble: str = ""

    @property
    def description(self) -> str:
        """Sentence for the user that states what was received on the link."""
        if self.trouble:
            return self.trouble
        if self.autopilots:
            return " and ".join(f"{who}, {'armed' if who.armed else 'disarmed'}" for who in self.autopilots)
        if self.others:
            return f"MAVLink, but no autopilot: system ids {', '.join(map(str, self.others))}"
        if self.messages:
            return "MAVLink, but no heartbeat"
        return f"data that is not MAVLink. {not_mavlink_advice(self.uri)}" if self.bad_bytes else "silent"


def serial_ports() -> tuple[PortSeen, ...]:
    """Return the serial ports of this computer that have hardware, sorted by device."""
    from serial.tools import list_ports  # slow to import where there are many drivers

    ports: Sequence[Any] = sorted(list_ports.comports(), key=lambda port: str(port.device))
    return tuple(
        PortSeen(
            str(port.device),
            str(port.description or "serial port"),
            str(port.manufacturer or ""),
            None if port.vid is None or port.pid is None else (int(port.vid), int(port.pid)),
        )
        for port in ports
        if port.vid is not None or str(port.hwid or "n/a") != "n/a"
    )


def overhear(uri: str, seconds: float) -> Overheard:
    """Listen on *uri* for at most *seconds* [s] and return the senders heard. Nothing is sent.

    Listening ends early, half a second after the first autopilot's heartbeat.
    """
    try:
        with open_link(uri) as transport:
            return _heard(uri, transport, seconds)
    except (CannotOpenLink, LinkLost) as error:
        return Overheard(uri, trouble=str(error))
    except LinkError as error:
        return Overheard(uri, trouble=f"cannot be opened: {error}")


def _heard(uri: str, transport: Transport, seconds: float) -> Overheard:
    framer, end = Framer(""), Deadline.after(transport.clock, seconds)
    autopilots: dict[tuple[int, int], VehicleCandidate] = {}
    others: set[int] = set()
    messages = 0
    while not end.expired:
        for frame in framer.feed(transport.read(min(_LONGEST_READ, end.remaining))):
            messages += 1
            if frame.name != "HEARTBEAT":
                continue
            if not is_autopilot(frame.message):
                others.add(frame.system)
                continue
            end = end if autopilots else Deadline.after(transport.clock, min(end.remaining, 0.5))
            autopilots[frame.system, frame.component] = VehicleCandidate.of(frame)
    return Overheard(uri, tuple(autopilots.values()), tuple(sorted(others)), messages, framer.bad_bytes)
