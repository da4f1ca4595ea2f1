"""Our serial transport on a real pseudo-terminal that passes the bytes per second of its baud rate."""

from __future__ import annotations

from typing import Any

import pytest
from scripted_vehicle import ScriptedVehicle

from benchmarks.throttled_pty import ThrottledPty
from gcs_autotune.errors import LinkLost
from gcs_autotune.link import Parameters, Session
from gcs_autotune.link.transports.serial_port import SerialPort


@pytest.mark.parametrize("baud", [57600, 115200])
def test_a_parameter_list_longer_than_the_buffers_arrives_complete_at_line_rate(baud: int) -> None:
    boat = ScriptedVehicle()
    boat.parameters |= {f"EXTRA_{n}": float(n) for n in range(400)}
    with ThrottledPty(boat, baud) as link, Session(link) as session:
        session.discover()
        begun, passed = link.clock.now(), link.down.passed
        assert len(Parameters(session).read_full()) == len(boat.parameters)
        rate = (link.down.passed - passed) / (link.clock.now() - begun)
        assert rate <= 1.05 * baud / 10
        session.pause(1.0)
        assert session.port.bad_data == 0


def test_a_cable_pulled_mid_frame_is_a_lost_link() -> None:
    with ThrottledPty(ScriptedVehicle(), 57600) as link, Session(link) as session:
        session.discover()
        link.unplug()
        with pytest.raises(LinkLost, match="serial port stopped working"):
            link.port.read(0.5)


def test_data_that_would_wait_half_a_second_is_dropped_and_reported() -> None:
    with ThrottledPty(ScriptedVehicle(), 57600) as link:
        port = link.port
        assert isinstance(port, SerialPort)
        port._port = Driver(port._port)
        port.write(b"first")
        port._port.out_waiting = 2881
        port.write(b"late")
        port._port.out_waiting = 2879
        port.write(b"second")
        assert link._from_port(11) == b"firstsecond"
        assert port.trouble.startswith("1 messages were dropped")


class Driver:
    """A serial driver that reports its unsent bytes; a pseudo-terminal never has any."""

    out_waiting = 0

    def __init__(self, port: Any) -> None:
        self._port = port

    def write(self, data: bytes) -> None:
        self._port.write(data)

    def close(self) -> None:
        self._port.close()
