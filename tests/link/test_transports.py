"""Every transport passes the same back-to-back suite; then each one's own ways to fail."""

from __future__ import annotations

import errno
import os
import pty
import socket
import subprocess
import sys
import tty
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
import serial
from scripted_vehicle import ScriptedVehicle

from gcs_autotune.clock import Deadline
from gcs_autotune.errors import CannotOpenLink, LinkLost, UnknownName, UsageError
from gcs_autotune.link import TRANSPORTS, MemoryLink, Transport, open_link, serial_port
from gcs_autotune.link import child as child_module
from gcs_autotune.link.address import HostPort, parse_host_port
from gcs_autotune.link.child import ChildLink
from gcs_autotune.link.tcp import TcpIn
from gcs_autotune.link.udp import UdpIn

LOCAL = "127.0.0.1"
ECHO_CHILD = str(Path(__file__).with_name("echo_child.py"))


class Echo:
    """A peer that sends back what it receives, at its next step."""

    def __init__(self) -> None:
        self._held = b""

    def receive(self, data: bytes) -> None:
        self._held += data

    def advance_to(self, t: float) -> bytes:
        held, self._held = self._held, b""
        return held


@dataclass
class Ends:
    """Our end, and what the other end receives and sends."""

    ours: Transport
    receive: Callable[[], bytes]
    send: Callable[[bytes], object]
    hang_up: Callable[[], object] | None = None


def memory_ends() -> Iterator[Ends]:
    ours = MemoryLink(Echo())
    yield Ends(ours, lambda: ours.read(1.0), ours.write)


def child_ends() -> Iterator[Ends]:
    ours = ChildLink([sys.executable, "-S", ECHO_CHILD], "sitl:echo")
    yield Ends(ours, lambda: ours.read(1.0), ours.write, ours._child.kill)
    ours.close()


def udpin_ends() -> Iterator[Ends]:
    ours = UdpIn(HostPort(LOCAL, 0))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as theirs:
        theirs.settimeout(5.0)
        theirs.connect((LOCAL, ours.port))
        theirs.send(b"hello")
        assert ours.read(5.0) == b"hello"
        yield Ends(ours, lambda: theirs.recv(1000), theirs.send)


def udpout_ends() -> Iterator[Ends]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as theirs:
        theirs.settimeout(5.0)
        theirs.bind((LOCAL, 0))
        ours = open_link(f"udpout:{LOCAL}:{theirs.getsockname()[1]}")
        ours.write(b"hello")
        _, address = theirs.recvfrom(1000)
        theirs.connect(address)
        yield Ends(ours, lambda: theirs.recv(1000), theirs.send)


def tcp_ends() -> Iterator[Ends]:
    with socket.create_server((LOCAL, 0)) as server:
        ours = open_link(f"tcp:{LOCAL}:{server.getsockname()[1]}")
        theirs, _ = server.accept()
        with theirs:
            theirs.settimeout(5.0)
            yield Ends(ours, lambda: theirs.recv(1000), theirs.sendall, theirs.close)


def tcpin_ends() -> Iterator[Ends]:
    ours = TcpIn(HostPort(LOCAL, 0))
    with socket.create_connection((LOCAL, ours.port), timeout=5.0) as theirs:
        theirs.sendall(b"hello")
        assert ours.read(5.0) == b"hello"
        yield Ends(ours, lambda: theirs.recv(1000), theirs.sendall, theirs.close)


def serial_ends() -> Iterator[Ends]:
    master, slave = pty.openpty()
    tty.setraw(master)
    tty.setraw(slave)
    ours = open_link(f"{os.ttyname(slave)},57600")
    os.close(slave)
    is_open = True

    def hang_up() -> None:
        nonlocal is_open
        is_open = False
        os.close(master)

    yield Ends(ours, lambda: os.read(master, 1000), lambda data: os.write(master, data), hang_up)
    if is_open:
        os.close(master)


ENDS = {
    "memory": memory_ends,
    "child": child_ends,
    "udpin": udpin_ends,
    "udpout": udpout_ends,
    "tcp": tcp_ends,
    "tcpin": tcpin_ends,
    "serial": serial_ends,
}
BREAKABLE = ["child", "tcp", "tcpin", "serial"]


@pytest.fixture
def ends(request: pytest.FixtureRequest) -> Iterator[Ends]:
    made = ENDS[request.param]()
    pair = next(made)
    yield pair
    pair.ours.close()
    assert list(made) == []


@pytest.mark.parametrize("ends", ENDS, indirect=True)
class TestBackToBack:
    def test_what_is_written_arrives_at_the_other_end(self, ends: Ends) -> None:
        ends.ours.write(b"\xfd\x00\x0d\x0a\x03ping")
        assert ends.receive() == b"\xfd\x00\x0d\x0a\x03ping"

    def test_what_the_other_end_sends_is_read(self, ends: Ends) -> None:
        ends.send(bytes(range(256)))
        data, deadline = b"", Deadline.after(ends.ours.clock, 5.0)
        while len(data) < 256 and not deadline.expired:
            data += ends.ours.read(deadline.remaining)
        assert data == bytes(range(256))

    def test_a_read_with_nothing_to_read_ends_at_its_deadline(self, ends: Ends) -> None:
        begun = ends.ours.clock.now()
        assert ends.ours.read(0.02) == b""
        assert 0.02 <= ends.ours.clock.now() - begun < 5.0

    def test_reading_and_writing_after_closing_is_a_lost_link(self, ends: Ends) -> None:
        ends.ours.close()
        ends.ours.close()
        with pytest.raises(LinkLost, match="closed"):
            ends.ours.read(0.0)
        with pytest.raises(LinkLost, match="closed"):
            ends.ours.write(b"x")

    def test_it_says_what_it_is(self, ends: Ends) -> None:
        assert ends.ours.description
        assert ends.ours.is_simulated == isinstance(ends.ours, MemoryLink | ChildLink)


@pytest.mark.parametrize("ends", BREAKABLE, indirect=True)
def test_a_peer_that_goes_away_is_a_lost_link_and_not_a_spin(ends: Ends) -> None:
    assert ends.hang_up is not None
    ends.hang_up()
    with pytest.raises(LinkLost, match="lost"):
        for _ in range(50):
            ends.ours.write(b"x" * 100)
            ends.ours.read(0.1)


def test_udpout_to_nobody_is_silence() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as unused:
        unused.bind((LOCAL, 0))
        port = unused.getsockname()[1]
    with open_link(f"udpout:{LOCAL}:{port}") as link:
        for _ in range(3):
            link.write(b"anybody?")
            assert link.read(0.01) == b""


def test_udpin_answers_whoever_spoke_last() -> None:
    with (
        UdpIn(HostPort(LOCAL, 0)) as ours,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as first,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as second,
    ):
        for theirs in (first, second):
            theirs.settimeout(5.0)
            theirs.sendto(b"here", (LOCAL, ours.port))
            assert ours.read(5.0) == b"here"
        ours.write(b"you")
        assert second.recv(100) == b"you"


# --- lock-step --------------------------------------------------------------------------------


def test_a_grant_never_runs_past_the_next_control_tick() -> None:
    grants: list[float] = []

    class Noting(Echo):
        def advance_to(self, t: float) -> bytes:
            grants.append(t)
            return b""

    link = MemoryLink(Noting())
    link.read(0.25)
    link.follow_tick(0.32, 0.1)
    link.read(0.25)
    assert grants == pytest.approx([0.1, 0.2, 0.25, 0.32, 0.42, 0.5], abs=1e-8)


def test_written_bytes_reach_the_peer_at_the_time_they_were_written() -> None:
    heard: list[tuple[float, bytes]] = []

    class Noting(Echo):
        t = 0.0

        def receive(self, data: bytes) -> None:
            heard.append((self.t, data))

        def advance_to(self, t: float) -> bytes:
            self.t = t
            return b""

    link = MemoryLink(Noting())
    link.read(0.3)
    link.write(b"now")
    link.read(0.1)
    assert heard == [(pytest.approx(0.3), b"now")]


def test_a_delayed_memory_link_takes_its_time_both_ways() -> None:
    link = MemoryLink(Echo(), delay=0.1, quantum=0.05)
    link.write(b"x")
    while not link.read(0.05):
        assert link.clock.now() < 1.0
    assert link.clock.now() == pytest.approx(0.2)


def test_a_lossy_memory_link_loses_the_same_frames_for_the_same_seed() -> None:
    def received(seed: int) -> bytes:
        link = MemoryLink(ScriptedVehicle(), loss=0.5, seed=seed)
        return b"".join(link.read(0.1) for _ in range(100))

    whole = MemoryLink(ScriptedVehicle())
    everything = b"".join(whole.read(0.1) for _ in range(100))
    assert received(1) == received(1)
    assert len(received(1)) < len(everything)


def test_the_child_is_granted_time_and_answers_with_the_time_reached() -> None:
    with ChildLink([sys.executable, "-S", ECHO_CHILD], "sitl:echo") as link:
        link.write(b"abc")
        assert link.read(0.05) == b"abc"
        assert link.clock.now() == pytest.approx(0.05)
        link.write(b"grants")
        link.read(0.35)
        link.write(b"tell")
        assert link.read(0.0) == b"first 0.05, longest 0.10"


def test_the_child_is_in_a_session_of_its_own_so_that_ctrl_c_spares_it() -> None:
    with ChildLink([sys.executable, "-S", ECHO_CHILD], "sitl:echo") as link:
        assert os.getsid(link._child.pid) != os.getsid(0)


def test_closing_ends_and_reaps_even_a_child_that_will_not_listen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(child_module, "_GRACE", 0.05)
    link = ChildLink([sys.executable, "-S", ECHO_CHILD, "--stubborn"], "sitl:echo")
    link.close()
    assert link._child.returncode is not None


def test_a_child_that_hangs_is_a_lost_link(monkeypatch: pytest.MonkeyPatch) -> None:
    link = ChildLink([sys.executable, "-S", ECHO_CHILD], "sitl:echo")
    monkeypatch.setattr(child_module, "_PATIENCE", 0.05)
    monkeypatch.setattr(child_module, "_GRACE", 0.05)
    link.write(b"hang")
    with link, pytest.raises(LinkLost, match="has not answered"):
        link.read(0.1)


def test_the_childs_last_words_are_in_the_error() -> None:
    with ChildLink([sys.executable, "-S", ECHO_CHILD], "sitl:echo") as link:
        link.write(b"crash")
        with pytest.raises(LinkLost, match="hull breached"):
            link.read(0.1)


def test_an_unknown_simulated_vehicle_shows_the_simulators_own_message() -> None:
    with pytest.raises(UnknownName, match="Did you mean charlie") as caught:
        ChildLink([sys.executable, "-S", ECHO_CHILD, "--unknown"], "sitl:charly")
    assert caught.value.nearest == ("charlie", "charles")
    assert caught.value.name == "charly"


def test_a_simulator_that_does_not_start_is_said_so() -> None:
    with pytest.raises(CannotOpenLink, match="exit code 7"):
        ChildLink([sys.executable, "-c", "raise SystemExit(7)"], "sitl:x")
    with pytest.raises(CannotOpenLink, match="cannot start"):
        ChildLink(["/no/such/program"], "sitl:x")


def test_sitl_uris_start_the_simulator_with_all_they_say(monkeypatch: pytest.MonkeyPatch) -> None:
    commands: list[list[str]] = []

    def popen(command: list[str], **options: object) -> None:
        commands.append(command)
        raise OSError(errno.ENOENT, "gone")

    monkeypatch.setattr(subprocess, "Popen", popen)
    hidden = "effect=steady-current@over%20ground.V_x=0.1,V_y=0&effect=dead-zone.width=0.1"
    for uri in ("sitl:charlie", "sitl:charlie?seed=3", f"sitl:charlie?{hidden}&param=A=1&model=a%26b.json"):
        with pytest.raises(CannotOpenLink):
            open_link(uri, seed=9)
    assert [c[1:] for c in commands] == [
        ["-m", "sitl", "charlie", "--lockstep", "--seed", "9"],
        ["-m", "sitl", "charlie", "--lockstep", "--seed", "3"],
        [
            *["-m", "sitl", "charlie", "--lockstep", "--seed", "9"],
            *["--effect=steady-current@over ground.V_x=0.1,V_y=0", "--effect=dead-zone.width=0.1"],
            *["--param=A=1", "--model=a&b.json"],
        ],
    ]


@pytest.mark.parametrize(
    "query", ["speed=3", "seed=x", "seed=-1", "effect", "model=", "seed=1&seed=2", "model=a&model=b"]
)
def test_what_a_sitl_uri_cannot_mean_is_refused(query: str) -> None:
    with pytest.raises(UsageError, match=r"seed|model"):
        open_link(f"sitl:charlie?{query}")


def test_a_misspelt_effect_in_a_uri_is_refused_with_the_nearest() -> None:
    with pytest.raises(UnknownName, match="did you mean dead-zone") as caught:
        open_link("sitl:charlie?effect=dead-zon.width=0.1")
    assert (caught.value.name, caught.value.nearest) == ("dead-zon", ("dead-zone",))
    with pytest.raises(UsageError, match="needs width"):
        open_link("sitl:charlie?effect=dead-zone")


# --- connection strings and what can go wrong ----------------------------------------------------------------


@pytest.mark.parametrize("scheme", ["udpin:", "udp:", "udpin://", "tcpin:", "tcpin://"])
def test_a_port_in_use_says_so_and_what_to_do(scheme: str) -> None:
    kind = socket.SOCK_STREAM if "tcp" in scheme else socket.SOCK_DGRAM
    with socket.socket(socket.AF_INET, kind) as taken:
        taken.bind((LOCAL, 0))
        if kind == socket.SOCK_STREAM:
            taken.listen()
        with pytest.raises(CannotOpenLink, match=r"another .* using that port"):
            open_link(f"{scheme}{LOCAL}:{taken.getsockname()[1]}")


@pytest.mark.parametrize("scheme", ["tcp:", "tcp://", "tcpout://"])
def test_a_refused_connection_asks_whether_the_vehicle_runs(scheme: str) -> None:
    with socket.socket() as unused:
        unused.bind((LOCAL, 0))
        port = unused.getsockname()[1]
        with pytest.raises(CannotOpenLink, match="is the vehicle or simulator running"):
            open_link(f"{scheme}{LOCAL}:{port}")


@pytest.mark.parametrize(
    "uri", ["/dev/no-such-port,57600", "serial:/dev/no-such-port:57600", "serial:///dev/no-such-port:57600"]
)
def test_a_missing_serial_port_is_named(uri: str) -> None:
    with pytest.raises(CannotOpenLink, match=r"/dev/no-such-port: there is no such device"):
        open_link(uri)


@pytest.mark.parametrize(
    ("failure", "words"),
    [
        (serial.SerialException(errno.EACCES, "no"), "dialout"),
        (serial.SerialException(errno.EBUSY, "no"), "another program"),
        (serial.SerialException("Could not exclusively lock port"), "another program"),
        (ValueError("not a valid baudrate"), "baudrate"),
    ],
)
def test_serial_failures_come_with_their_cure(monkeypatch: pytest.MonkeyPatch, failure: Exception, words: str) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise failure

    monkeypatch.setattr(serial_port.serial, "Serial", refuse)
    with pytest.raises(CannotOpenLink, match=words):
        open_link("COM3,57600")


def test_serial_speed_comes_from_the_string_or_the_option(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[tuple[str, int]] = []

    def note(path: str, baud: int, **_: object) -> None:
        opened.append((path, baud))
        raise OSError(errno.ENOENT, "gone")

    monkeypatch.setattr(serial_port.serial, "Serial", note)
    for uri in ("/dev/ttyUSB0,57600", "/dev/ttyACM0", "COM3,9600", "serial:/dev/ttyS1:4800", "serial://COM4:1200"):
        with pytest.raises(CannotOpenLink):
            open_link(uri, baud=921600)
    assert opened == [
        ("/dev/ttyUSB0", 57600),
        ("/dev/ttyACM0", 921600),
        ("COM3", 9600),
        ("/dev/ttyS1", 4800),
        ("COM4", 1200),
    ]


def test_a_host_that_does_not_exist_is_named() -> None:
    with pytest.raises(CannotOpenLink, match="cannot find the host"):
        open_link("tcp:no host of this name:5760")


@pytest.mark.parametrize("uri", ["", "charlie", "14550"])
def test_a_string_that_is_no_connection_gets_examples(uri: str) -> None:
    with pytest.raises(UsageError, match=r"udpin:0\.0\.0\.0:14550"):
        open_link(uri)


def test_an_unknown_scheme_gets_the_nearest_ones() -> None:
    with pytest.raises(UnknownName, match="Did you mean") as caught:
        open_link("upd:0.0.0.0:14550")
    assert set(caught.value.nearest) <= set(TRANSPORTS)


@pytest.mark.parametrize("port", ["99999", "abc", "-1"])
def test_a_port_that_is_no_number_is_refused(port: str) -> None:
    with pytest.raises(UsageError, match="port number"):
        open_link(f"udpin:0.0.0.0:{port}")


def test_addresses_have_sensible_defaults() -> None:
    assert parse_host_port(":14551") == HostPort("0.0.0.0", 14551)
    assert parse_host_port("14551") == HostPort("0.0.0.0", 14551)
    assert parse_host_port("boat.local") == HostPort("boat.local", 14550)
    assert parse_host_port("[::1]:14550/") == HostPort("::1", 14550)
