"""The process as started by a user: over UDP, TCP and a serial pair, in real time."""

from __future__ import annotations

import math
import os
import pty
import select
import signal
import socket
import subprocess
import sys
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

import sitl
from sitl.clock import Pacer
from sitl.listen import AddressError, CannotListen, TcpLink, UdpLink, open_link, serve_free_running

ROOT = Path(__file__).resolve().parents[2]
PATIENCE = 20.0


def _free_port(kind: int) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def _process(*options: str) -> Iterator[subprocess.Popen[bytes]]:
    command = [sys.executable, "-m", "sitl", *options]
    with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE) as process:
        assert process.stderr
        process.stderr.readline()
        try:
            yield process
        finally:
            process.kill()


class _Wire:
    """The ground's end of a link: ``send``, and ``hear`` until a message satisfies a condition."""

    def __init__(self, descriptor: int, write: Callable[[bytes], object]) -> None:
        self._descriptor, self._write = descriptor, write
        self._mav = mavlink.MAVLink(None, 255, 190)
        self._mav.robust_parsing = True

    def send(self, message: Any) -> None:
        self._write(message.pack(self._mav))

    def hear(self, wanted: Callable[[Any], bool]) -> Any:
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            if not select.select([self._descriptor], [], [], 0.05)[0]:
                continue
            for message in self._mav.parse_buffer(os.read(self._descriptor, 65536)) or ():
                if wanted(message):
                    return message
        raise AssertionError("nothing of the kind was heard")


def _knock(wire: _Wire) -> Any:
    wire.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
    return wire.hear(lambda m: m.get_type() == "HEARTBEAT")


@contextmanager
def _udp(speedup: float = 50) -> Iterator[_Wire]:
    port = _free_port(socket.SOCK_DGRAM)
    options = ("charlie", "--listen", f"udp:127.0.0.1:{port}", "--speedup", str(speedup), "--seed", "7")
    with _process(*options), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.connect(("127.0.0.1", port))
        yield _Wire(end.fileno(), end.send)


@contextmanager
def _tcp() -> Iterator[_Wire]:
    port = _free_port(socket.SOCK_STREAM)
    with (
        _process("charlie", "--listen", f"tcp:127.0.0.1:{port}", "--speedup", "50"),
        socket.create_connection(("127.0.0.1", port), timeout=PATIENCE) as end,
    ):
        yield _Wire(end.fileno(), end.sendall)


@contextmanager
def _serial() -> Iterator[_Wire]:
    ours, theirs = pty.openpty()
    tty.setraw(ours)
    tty.setraw(theirs)
    try:
        with _process("charlie", "--listen", f"serial:{os.ttyname(theirs)},57600", "--speedup", "50"):
            yield _Wire(ours, lambda data: os.write(ours, data))
    finally:
        os.close(ours)
        os.close(theirs)


@pytest.mark.parametrize("link", [_udp, _tcp, _serial])
def test_the_simulator_responds_over_every_link(link):
    with link() as wire:
        assert _knock(wire).type == 11
        wire.send(mavlink.MAVLink_param_request_read_message(1, 1, b"WP_SPEED", -1))
        answer = wire.hear(lambda m: m.get_type() == "PARAM_VALUE")
        assert (answer.param_id, answer.param_value) == ("WP_SPEED", pytest.approx(1.2))


def test_the_simulator_can_connect_to_a_listening_ground_station():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.bind(("127.0.0.1", 0))
        address = f"udpout:127.0.0.1:{end.getsockname()[1]}"
        with _process("videoray", "--listen", address, "--speedup", "50"):
            assert _Wire(end.fileno(), end.send).hear(lambda m: m.get_type() == "HEARTBEAT").type == 12


def test_simulated_time_runs_at_the_speedup():
    with _udp(speedup=20) as wire:
        _knock(wire)
        first = wire.hear(lambda m: m.get_type() == "SYSTEM_TIME").time_boot_ms
        begun = time.monotonic()
        last = wire.hear(lambda m: m.get_type() == "SYSTEM_TIME" and m.time_boot_ms >= first + 8000).time_boot_ms
        assert (last - first) / 1000 / (time.monotonic() - begun) == pytest.approx(20, rel=0.25)


SCRIPT = ((5.0, 1500, 1500), (8.0, 1500, 1900), (14.0, 1600, 1900), (20.0, 1400, 1900), (26.0, 1500, 1900))
"""Boot time [s] from which steering and throttle sticks hold."""
END = 30.0
TOLERANCE = math.radians(4.0)
"""Chosen: at 2 deg/s of turning, a switch may come 1 s of simulated time (0.1 s of wall) late, twice."""


def _sticks_at(t: float) -> Any:
    steering, throttle = next((s, x) for begins, s, x in reversed(((0.0, 1500, 1500), *SCRIPT)) if t >= begins)
    return mavlink.MAVLink_rc_channels_override_message(1, 1, steering, 65535, throttle, *[65535] * 5)


def _command(number: int, *parameters: float) -> Any:
    seven = [*parameters, *[0.0] * (7 - len(parameters))]
    return mavlink.MAVLink_command_long_message(1, 1, number, 0, *seven)


def _headings_in_lockstep() -> dict[int, float]:
    server = sitl.open_vehicle("charlie", seed=7)
    mav, ear = mavlink.MAVLink(None, 255, 190), mavlink.MAVLink(None)
    server.receive(_command(511, 30, 1e5).pack(mav))
    headings = {}
    for k in range(round(END * 10)):
        server.receive(_sticks_at(server.now).pack(mav))
        if k == 60:
            server.receive(_command(176, 1, 0).pack(mav) + _command(400, 1).pack(mav))
        for message in ear.parse_buffer(server.advance_to(round(0.1 * (k + 1), 9))) or ():
            if message.get_type() == "ATTITUDE":
                headings[message.time_boot_ms] = message.yaw
    return headings


def _headings_running_free(wire: _Wire) -> dict[int, float]:
    _knock(wire)
    wire.send(_command(511, 30, 1e5))
    headings: dict[int, float] = {}
    commanded = False
    while True:
        message = wire.hear(lambda m: m.get_type() == "ATTITUDE")
        headings[message.time_boot_ms] = message.yaw
        t = message.time_boot_ms / 1000
        if t >= END:
            return headings
        wire.send(_sticks_at(t))
        if t >= 6.0 and not commanded:
            commanded = True
            wire.send(_command(176, 1, 0))
            wire.send(_command(400, 1))


@pytest.mark.slow
def test_running_free_agrees_with_lockstep_within_the_stated_tolerance():
    stepped = _headings_in_lockstep()
    with _udp(speedup=10) as wire:
        free = _headings_running_free(wire)
    common = [t for t in stepped if t in free and t > 8000]
    assert len(common) > 200
    worst = max(abs(math.remainder(stepped[t] - free[t], math.tau)) for t in common)
    assert worst < TOLERANCE
    assert max(stepped.values()) - min(stepped.values()) > math.radians(5)


@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_ends_the_process_cleanly_and_silently(stop):
    port = _free_port(socket.SOCK_DGRAM)
    with _process("charlie", "--listen", f"udp:127.0.0.1:{port}") as process:
        process.send_signal(stop)
        assert process.wait(10) == 0
        assert process.stderr and process.stderr.read() == b""


def test_after_a_client_leaves_the_next_can_connect():
    link = TcpLink("127.0.0.1", 0)
    port = link._server.getsockname()[1]
    for greeting in (b"one", b"two"):
        with socket.create_connection(("127.0.0.1", port)) as end:
            end.sendall(greeting)
            assert _until(link.read) == greeting
            link.write(b"back")
            assert end.recv(10) == b"back"
    link.write(b"nobody hears this")
    link.close()


def _until(read: Callable[[], bytes]) -> bytes:
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        data = read()
        if data:
            return data
    raise AssertionError("nothing came")


def test_a_client_that_does_not_read_blocks_nothing():
    link = TcpLink("127.0.0.1", 0)
    with socket.create_connection(link._server.getsockname()):
        link.read()
        began = time.monotonic()
        for _ in range(100):
            link.write(bytes(65536))
        assert time.monotonic() - began < PATIENCE
        assert link.read() == b""
    link.close()


def test_datagrams_go_to_the_last_sender():
    link = UdpLink("127.0.0.1", 0)
    link.write(b"to nobody yet")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.sendto(b"hello", link._socket.getsockname())
        assert _until(link.read) == b"hello"
        link.write(bytes(3000))
        assert [len(end.recv(65536)) for _ in range(3)] == [1400, 1400, 200]
    link.close()


@pytest.mark.parametrize("address", ["udp:127.0.0.1:0", "udpin:127.0.0.1:0", "tcp:127.0.0.1:0", "tcpin:127.0.0.1:0"])
def test_an_address_that_listens_has_the_form_of_a_connection(address):
    link = open_link(address)
    assert not link.read()
    link.close()


@pytest.mark.parametrize(
    "address",
    [
        "",
        "udp",
        "udp:",
        "udp:14550",
        "udp:host:",
        "udp:h:99999",
        "tcp:h:x",
        "serial:",
        "serial:/dev/x,fast",
        "usb:1",
    ],
)
def test_an_invalid_address_is_explained(address):
    with pytest.raises(AddressError, match=r"is not|starts with"):
        open_link(address)


def test_a_missing_host_or_device_is_explained():
    with pytest.raises(CannotListen, match="Check the address"):
        open_link("udp:192.0.2.1:14550")
    with pytest.raises(CannotListen, match="Check that it exists"):
        open_link("serial:/dev/no-such-device")


class _Wall:
    def __init__(self) -> None:
        self.t = 100.0
        self.slept: list[float] = []

    def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        self.t += seconds


def test_the_pacer_sleeps_in_proportion_to_the_speedup():
    wall = _Wall()
    pacer = Pacer(10.0, wall=lambda: wall.t, sleep=wall.sleep)
    pacer.wait_until(5.0)
    assert wall.slept == [pytest.approx(0.5)]
    assert pacer.now() == pytest.approx(5.0)


def test_a_pacer_far_behind_skips_time():
    wall = _Wall()
    pacer = Pacer(1.0, wall=lambda: wall.t, sleep=wall.sleep)
    wall.t += 60.0
    pacer.wait_until(1.0)
    assert wall.slept == []
    assert pacer.now() == pytest.approx(1.0)


class _Loopback:
    def __init__(self) -> None:
        self.sent = bytearray()

    def read(self) -> bytes:
        return b""

    def write(self, data: bytes) -> None:
        self.sent += data

    def close(self) -> None:
        pass


def test_the_free_running_loop_sends_the_same_as_lockstep():
    wall, link = _Wall(), _Loopback()
    pacer = Pacer(10.0, wall=lambda: wall.t, sleep=wall.sleep)
    serve_free_running(sitl.open_vehicle("falcon", seed=5), link, pacer, until=3.0)
    assert bytes(link.sent) == sitl.open_vehicle("falcon", seed=5).advance_to(3.0)
