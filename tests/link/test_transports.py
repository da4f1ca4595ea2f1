"""Each transport's own ways to fail; what they have in common is in the suites test_every_link_*."""

from __future__ import annotations

import errno
import os
import re
import socket
import subprocess
import sys
import time
import types
from pathlib import Path

import pytest
import serial
from link_ends import ECHO_CHILD, LOCAL, Echo, free_port
from scripted_vehicle import ScriptedVehicle

from gcs_autotune.clock import ManualClock
from gcs_autotune.errors import CannotOpenLink, LinkLost, UnknownName, UsageError
from gcs_autotune.link import BACKENDS, TRANSPORTS, MemoryLink, open_link
from gcs_autotune.link.transports import mavsdk as mavsdk_link
from gcs_autotune.link.transports import serial_port, tcp, udp
from gcs_autotune.link.transports import sitl_process as child_module
from gcs_autotune.link.transports import transport as returning
from gcs_autotune.link.transports.address import HostPort, parse_host_port
from gcs_autotune.link.transports.sitl_process import SitlProcess
from gcs_autotune.link.transports.tcp import TcpIn, TcpOut
from gcs_autotune.link.transports.udp import UdpIn
from sitl import VEHICLES


def test_udpout_to_a_closed_port_is_silence() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as unused:
        unused.bind((LOCAL, 0))
        port = unused.getsockname()[1]
    with open_link(f"udpout:{LOCAL}:{port}") as link:
        for _ in range(3):
            link.write(b"anybody?")
            assert link.read(0.01) == b""


def test_udpin_answers_every_recent_sender(monkeypatch: pytest.MonkeyPatch) -> None:
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
        assert (first.recv(100), second.recv(100)) == (b"you", b"you")
        monkeypatch.setattr(udp, "_REMEMBERED", 0.0)
        ours.write(b"last")
        assert second.recv(100) == b"last"
        first.settimeout(0.01)
        with pytest.raises(TimeoutError):
            first.recv(100)


# --- lock-step --------------------------------------------------------------------------------


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


def test_a_delayed_memory_link_delays_both_ways() -> None:
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


def test_the_child_is_granted_time_and_returns_the_time_reached() -> None:
    with SitlProcess([sys.executable, "-S", ECHO_CHILD], "sitl:echo") as link:
        link.write(b"abc")
        assert link.read(0.05) == b"abc"
        assert link.clock.now() == pytest.approx(0.05)
        link.write(b"grants")
        link.read(0.35)
        link.write(b"tell")
        assert link.read(0.0) == b"first 0.05, longest 0.10"


def test_the_child_has_its_own_session_and_is_spared_by_ctrl_c() -> None:
    with SitlProcess([sys.executable, "-S", ECHO_CHILD], "sitl:echo") as link:
        assert os.getsid(link._child.pid) != os.getsid(0)


def test_closing_ends_and_reaps_even_a_stubborn_child(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(child_module, "_GRACE", 0.05)
    link = SitlProcess([sys.executable, "-S", ECHO_CHILD, "--stubborn"], "sitl:echo")
    link.close()
    assert link._child.returncode is not None


def test_a_child_that_hangs_is_a_lost_link(monkeypatch: pytest.MonkeyPatch) -> None:
    link = SitlProcess([sys.executable, "-S", ECHO_CHILD], "sitl:echo")
    monkeypatch.setattr(child_module, "_PATIENCE", 0.05)
    monkeypatch.setattr(child_module, "_GRACE", 0.05)
    link.write(b"hang")
    with link, pytest.raises(LinkLost, match="has not responded"):
        link.read(0.1)


@pytest.mark.parametrize(
    "looks",
    [
        [(True, 0.0)] * 5 + [(False, 0.0)] * 2,  # waits for the processor, then sleeps
        [(False, 0.01 * k) for k in range(5)] + [(False, 0.04)],  # works now and then, then sleeps
        [(True, 0.01 * k) for k in range(7)],  # works without end
    ],
)
def test_a_child_hangs_only_when_it_sleeps_or_works_too_long(
    monkeypatch: pytest.MonkeyPatch, looks: list[tuple[bool, float]]
) -> None:
    link = SitlProcess([sys.executable, "-S", ECHO_CHILD], "sitl:echo")
    left = list(looks)
    monkeypatch.setattr(child_module, "_activity_of", lambda pid: left.pop(0))
    monkeypatch.setattr(child_module, "_PATIENCE", 0.05)
    monkeypatch.setattr(child_module, "_GRACE", 0.05)
    link.write(b"hang")
    with link, pytest.raises(LinkLost, match="has not responded"):
        link.read(0.1)
    assert len(left) <= 1


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
def test_the_activity_of_a_process_is_its_processor_time() -> None:
    waits, spent = child_module._activity_of(os.getpid())
    assert waits
    assert spent == pytest.approx(time.process_time(), abs=1.0)
    assert child_module._activity_of(2**30) == (False, 0.0)


def test_the_childs_last_output_is_in_the_error() -> None:
    with SitlProcess([sys.executable, "-S", ECHO_CHILD], "sitl:echo") as link:
        link.write(b"crash")
        with pytest.raises(LinkLost, match="hull breached"):
            link.read(0.1)


def test_an_unknown_simulated_vehicle_shows_the_simulators_own_message() -> None:
    with pytest.raises(UnknownName, match="Did you mean charlie") as caught:
        SitlProcess([sys.executable, "-S", ECHO_CHILD, "--unknown"], "sitl:charly")
    assert caught.value.nearest == ("charlie", "charles")
    assert caught.value.name == "charly"


def test_an_unknown_simulated_vehicle_is_refused_before_the_simulator_starts(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(subprocess, "Popen", lambda *_, **__: pytest.fail("the simulator was started"))
    with pytest.raises(UnknownName, match=r"unknown simulated vehicle 'charly'\. Did you mean charlie") as caught:
        open_link("sitl:charly")
    for name in VEHICLES:
        assert re.search(rf"Known: .*\b{name}\b", str(caught.value))


def test_a_simulator_that_does_not_start_is_reported() -> None:
    with pytest.raises(CannotOpenLink, match="exit code 7"):
        SitlProcess([sys.executable, "-c", "raise SystemExit(7)"], "sitl:x")
    with pytest.raises(CannotOpenLink, match="cannot start"):
        SitlProcess(["/no/such/program"], "sitl:x")


def test_sitl_uris_start_the_simulator_with_their_options(monkeypatch: pytest.MonkeyPatch) -> None:
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
def test_an_invalid_sitl_uri_is_refused(query: str) -> None:
    with pytest.raises(UsageError, match=r"seed|model"):
        open_link(f"sitl:charlie?{query}")


def test_a_misspelt_effect_in_a_uri_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(UnknownName, match="did you mean dead-zone") as caught:
        open_link("sitl:charlie?effect=dead-zon.width=0.1")
    assert (caught.value.name, caught.value.nearest) == ("dead-zon", ("dead-zone",))
    with pytest.raises(UsageError, match="needs width"):
        open_link("sitl:charlie?effect=dead-zone")


# --- connection strings and what can go wrong ----------------------------------------------------------------


@pytest.mark.parametrize("scheme", ["udpin:", "udp:", "udpin://", "tcpin:", "tcpin://"])
def test_a_port_in_use_is_reported_with_its_cure(scheme: str) -> None:
    kind = socket.SOCK_STREAM if "tcp" in scheme else socket.SOCK_DGRAM
    with socket.socket(socket.AF_INET, kind) as taken:
        taken.bind((LOCAL, 0))
        if kind == socket.SOCK_STREAM:
            taken.listen()
        with pytest.raises(CannotOpenLink, match=r"another .* uses that"):
            open_link(f"{scheme}{LOCAL}:{taken.getsockname()[1]}")


@pytest.mark.parametrize("scheme", ["tcp:", "tcp://", "tcpout://"])
def test_a_refused_connection_is_reported_with_its_cure(scheme: str) -> None:
    with socket.socket() as unused:
        unused.bind((LOCAL, 0))
        port = unused.getsockname()[1]
        with pytest.raises(CannotOpenLink, match="Check that the vehicle or simulator is running"):
            open_link(f"{scheme}{LOCAL}:{port}")


@pytest.mark.parametrize(
    "uri", ["/dev/no-such-port,57600", "serial:/dev/no-such-port:57600", "serial:///dev/no-such-port:57600"]
)
def test_a_missing_serial_port_is_reported(uri: str) -> None:
    with pytest.raises(CannotOpenLink, match=r"/dev/no-such-port: the device does not exist"):
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
def test_serial_failures_are_reported_with_their_cure(
    monkeypatch: pytest.MonkeyPatch, failure: Exception, words: str
) -> None:
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


def test_an_unknown_host_is_reported() -> None:
    with pytest.raises(CannotOpenLink, match="cannot find the host"):
        open_link("tcp:no host of this name:5760")


@pytest.mark.parametrize("uri", ["", "charlie", "14550"])
def test_an_invalid_connection_string_is_answered_with_examples(uri: str) -> None:
    with pytest.raises(UsageError, match=r"udpin:0\.0\.0\.0:14550"):
        open_link(uri)


def test_an_unknown_scheme_is_reported_with_the_nearest_ones() -> None:
    with pytest.raises(UnknownName, match="Did you mean") as caught:
        open_link("upd:0.0.0.0:14550")
    assert set(caught.value.nearest) <= set(TRANSPORTS)


@pytest.mark.parametrize("port", ["99999", "abc", "-1"])
def test_an_invalid_port_number_is_refused(port: str) -> None:
    with pytest.raises(UsageError, match="port number"):
        open_link(f"udpin:0.0.0.0:{port}")


def test_addresses_have_sensible_defaults() -> None:
    assert parse_host_port(":14551") == HostPort("0.0.0.0", 14551)
    assert parse_host_port("14551") == HostPort("0.0.0.0", 14551)
    assert parse_host_port("boat.local") == HostPort("boat.local", 14550)
    assert parse_host_port("[::1]:14550/") == HostPort("::1", 14550)


# --- MAVSDK's connection URLs, in both backends ----------------------------------------------------------------


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    ("url", "understood"),
    [
        ("udpin://127.0.0.1:{udp}", "udpin:127.0.0.1:{udp}"),
        ("udpin://:{udp}", "udpin:0.0.0.0:{udp}"),
        ("udp://:{udp}", "udpin:0.0.0.0:{udp}"),
        ("udp://0.0.0.0:{udp}", "udpin:0.0.0.0:{udp}"),
        ("udp:127.0.0.1:{udp}", "udpin:127.0.0.1:{udp}"),
        ("udp://127.0.0.1:{udp}", "udpout:127.0.0.1:{udp}"),
        ("udpout://localhost:{udp}", "udpout:localhost:{udp}"),
        ("tcpin://127.0.0.1:{tcp}", "tcpin:127.0.0.1:{tcp}"),
    ],
)
def test_mavsdk_urls_mean_the_same_in_both_backends(backend: str, url: str, understood: str) -> None:
    ports = {"udp": free_port(socket.SOCK_DGRAM), "tcp": free_port(socket.SOCK_STREAM)}
    with open_link(url.format(**ports), backend=backend) as link:
        assert link.description == understood.format(**ports)
    with open_link(link.description, backend=backend) as again:  # what a journal keeps can be opened again
        assert again.description == link.description


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("url", ["tcp://127.0.0.1:{tcp}", "tcpout://127.0.0.1:{tcp}", "tcp:127.0.0.1:{tcp}"])
def test_a_tcp_server_address_is_accepted_in_three_forms(
    backend: str, url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mavsdk_link, "_CONNECT_PATIENCE", 0.02)
    with (
        socket.create_server((LOCAL, 0)) as server,
        open_link(url.format(tcp=server.getsockname()[1]), backend=backend) as link,
    ):
        assert link.description == f"tcp:127.0.0.1:{server.getsockname()[1]}"


@pytest.mark.parametrize(
    ("url", "words"),
    [
        (
            "tcpout://127.0.0.1:{free}",
            "cannot connect to TCP 127.0.0.1:{free}: .*refused. Check that the vehicle or simulator",
        ),
        ("udpin://127.0.0.1:{taken}", "cannot listen on UDP 127.0.0.1:{taken}: .*in use. Close another ground station"),
        ("udpin://192.0.2.1:14550", "cannot listen on UDP 192.0.2.1:14550: .*Cannot assign"),
        ("udpout://no host of this name:1", "cannot find the host"),
        ("serial:///dev/no-such-port:57600", "cannot open /dev/no-such-port,57600: .*No such file"),
        ("sitl:charlie?seed=3", "lock-step.*gcs-autotune sitl charlie --listen"),
        ("udpout://[::1]:14550", "IPv6.*--backend pymavlink"),
        ("upd://:14540", "Did you mean"),
    ],
)
def test_mavsdk_limitations_are_reported_with_a_cure(url: str, words: str, capfd: pytest.CaptureFixture[str]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind((LOCAL, 0))
        ports = {"free": free_port(socket.SOCK_STREAM), "taken": taken.getsockname()[1]}
        with pytest.raises((CannotOpenLink, UsageError), match=words.format(**ports)):
            open_link(url.format(**ports), backend="mavsdk")
    assert capfd.readouterr() == ("", "")


def test_a_missing_or_old_mavsdk_is_reported_with_the_install_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mavsdk", None)
    with pytest.raises(UsageError, match=r"cannot be loaded here .*pip install 'mavsdk>=4'"):
        open_link("udpin://:0", backend="mavsdk")
    monkeypatch.setitem(sys.modules, "mavsdk", types.ModuleType("mavsdk"))
    with pytest.raises(UsageError, match=r"MAVSDK 4 or newer.*pip install"):
        open_link("udpin://:0", backend="mavsdk")


def test_an_unknown_backend_is_reported_with_the_nearest() -> None:
    with pytest.raises(UnknownName, match="mavsdk"):
        open_link("udpin://:0", backend="mavsd")


def test_a_refused_reconnection_is_retried_without_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(returning, "_RETRY", 0.001)
    with socket.create_server((LOCAL, 0)) as server:
        ours = TcpOut(HostPort(LOCAL, server.getsockname()[1]))
        server.accept()[0].close()
    with ours:
        with pytest.raises(LinkLost, match="closed the connection"):
            ours.read(1.0)
        for _ in range(5):
            assert ours.read(0.002) == b""


def test_a_silent_tcp_client_is_replaced_by_the_next_but_a_talking_one_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    with TcpIn(HostPort(LOCAL, 0)) as ours, socket.create_connection((LOCAL, ours.port)) as first:
        first.sendall(b"one")
        while ours.read(1.0) != b"one":
            continue
        with socket.create_connection((LOCAL, ours.port)) as second:
            second.sendall(b"two")
            first.sendall(b"again")
            assert ours.read(1.0) == b"again"
            monkeypatch.setattr(tcp, "_DEAF", -1.0)
            assert ours.read(1.0) == b"two"


@pytest.mark.parametrize(("now", "looks"), [(4.999, False), (5.0, True), (6.0, True)])
def test_reconnection_is_tried_when_its_time_has_come(monkeypatch: pytest.MonkeyPatch, now: float, looks: bool) -> None:
    idled: list[float] = []
    monkeypatch.setattr(returning, "idle", idled.append)
    link = types.SimpleNamespace(_next_look=5.0, _clock=ManualClock(now), _is_down=True, _call_again=lambda: True)
    returning.ReconnectingTransport._look(link, 0.2)  # type: ignore[arg-type]
    assert link._is_down is not looks
    assert idled == ([] if looks else [pytest.approx(0.001)])
    assert link._next_look == (5.0 if not looks else pytest.approx(now + returning._RETRY))
