"""Both ends of every kind of link, for the conformance suite; a new transport adds its line to ``ENDS``."""

from __future__ import annotations

import os
import pty
import select
import socket
import sys
import tty
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from gcs_autotune.link import MemoryLink, Transport, open_link
from gcs_autotune.link.transports.sitl_process import SitlProcess

LOCAL = "127.0.0.1"
PATIENCE = 10.0
ECHO_CHILD = str(Path(__file__).with_name("echo_child.py"))


@dataclass
class Ends:
    """Our end, and what the other end receives and sends.

    ``receive`` returns some bytes; ``hang_up`` breaks the link as the peer's end would; ``come_back`` mends it.
    """

    ours: Transport
    receive: Callable[[], bytes]
    send: Callable[[bytes], object]
    hang_up: Callable[[], object] | None = None
    come_back: Callable[[], object] | None = None


class Echo:
    """A peer that sends back what it receives, at its next step."""

    def __init__(self) -> None:
        self._held = b""

    def receive(self, data: bytes) -> None:
        self._held += data

    def advance_to(self, t: float) -> bytes:
        held, self._held = self._held, b""
        return held


def memory_ends(folder: Path) -> Iterator[Ends]:
    ours = MemoryLink(Echo())
    yield Ends(ours, lambda: ours.read(1.0), ours.write)


def child_ends(folder: Path) -> Iterator[Ends]:
    ours = SitlProcess([sys.executable, "-S", ECHO_CHILD], "sitl:echo")
    yield Ends(ours, lambda: ours.read(1.0), ours.write, ours._child.kill)
    ours.close()


def free_port(kind: int) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind((LOCAL, 0))
        return int(probe.getsockname()[1])


def _datagrams() -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
    made.settimeout(PATIENCE)
    return made


def _stream(made: socket.socket) -> socket.socket:
    made.settimeout(PATIENCE)
    made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return made


def udpin_ends(folder: Path, backend: str = "pymavlink") -> Iterator[Ends]:
    """The peer calls us; it goes away and calls again from another port."""
    port = free_port(socket.SOCK_DGRAM)
    ours = open_link(f"udpin://{LOCAL}:{port}", backend=backend)

    def call() -> socket.socket:
        made = _datagrams()
        made.connect((LOCAL, port))
        made.send(HELLO)
        while HELLO not in ours.read(PATIENCE):
            continue
        return made

    theirs = call()

    def come_back() -> None:
        nonlocal theirs
        theirs = call()

    yield Ends(ours, lambda: theirs.recv(65535), lambda data: theirs.send(data), lambda: theirs.close(), come_back)
    theirs.close()


def udpout_ends(folder: Path, backend: str = "pymavlink") -> Iterator[Ends]:
    """We call the peer, which learns from our first frame where we are."""
    theirs, caller = _datagrams(), None
    theirs.bind((LOCAL, 0))
    address = theirs.getsockname()
    ours = open_link(f"udpout://{LOCAL}:{address[1]}", backend=backend)

    def receive() -> bytes:
        nonlocal caller
        data, caller = theirs.recvfrom(65535)
        return data

    def come_back() -> None:
        nonlocal theirs
        theirs = _datagrams()
        theirs.bind(address)

    def send(data: bytes) -> None:
        while caller is None:
            ours.write(HELLO)
            receive()
        theirs.sendto(data, caller)

    yield Ends(ours, receive, send, lambda: theirs.close(), come_back)
    theirs.close()


def tcpout_ends(folder: Path, backend: str = "pymavlink") -> Iterator[Ends]:
    with socket.create_server((LOCAL, 0)) as server:
        server.settimeout(PATIENCE)
        ours = open_link(f"tcpout://{LOCAL}:{server.getsockname()[1]}", backend=backend)
        theirs = _stream(server.accept()[0])

        def come_back() -> None:
            nonlocal theirs
            while not select.select([server], [], [], 0.02)[0]:
                ours.read(0.02)
            theirs = _stream(server.accept()[0])
            while not select.select([theirs], [], [], 0.02)[0] or HELLO not in theirs.recv(65535):
                ours.read(0.0)
                ours.write(HELLO)  # accepted is not yet connected, at MAVSDK's end

        send = lambda data: theirs.sendall(data)  # noqa: E731
        yield Ends(ours, lambda: theirs.recv(65535), send, lambda: theirs.close(), come_back)
        theirs.close()


def tcpin_ends(folder: Path, backend: str = "pymavlink") -> Iterator[Ends]:
    port = free_port(socket.SOCK_STREAM)
    ours = open_link(f"tcpin://{LOCAL}:{port}", backend=backend)

    def call() -> socket.socket:
        made = _stream(socket.create_connection((LOCAL, port), timeout=PATIENCE))
        made.sendall(HELLO)
        while HELLO not in ours.read(PATIENCE):
            continue
        return made

    theirs = call()

    def come_back() -> None:
        nonlocal theirs
        theirs = call()

    send = lambda data: theirs.sendall(data)  # noqa: E731
    yield Ends(ours, lambda: theirs.recv(65535), send, lambda: theirs.close(), come_back)
    theirs.close()


def serial_ends(folder: Path, backend: str = "pymavlink") -> Iterator[Ends]:
    """A pseudo-terminal under a name of our own, so that the device can come back under it."""
    name = folder / "ttyBOAT"
    master = -1

    def plug_in() -> int:
        nonlocal master
        master, slave = pty.openpty()
        tty.setraw(master)
        tty.setraw(slave)
        name.unlink(missing_ok=True)
        name.symlink_to(os.ttyname(slave))
        return slave

    def unplug() -> None:
        os.close(master)

    def receive() -> bytes:
        assert select.select([master], [], [], PATIENCE)[0], "nothing came over the wire"
        return os.read(master, 65535)

    def send(data: bytes) -> None:
        while data:
            data = data[os.write(master, data[:2048]) :]

    def come_back() -> None:
        spare = plug_in()
        for _ in range(3):  # opens it again
            ours.read(0.02)
        os.close(spare)

    spare = plug_in()
    ours = open_link(f"serial://{name}:57600", backend=backend)
    os.close(spare)
    yield Ends(ours, receive, send, unplug, come_back if backend == "pymavlink" else None)
    with suppress(OSError):
        unplug()


HELLO = bytes.fromhex("fd090000000101000000000000000b0300040339f2")
"""A HEARTBEAT: what MAVSDK lets through is MAVLink only."""

KINDS = {
    "udpin": udpin_ends,
    "udpout": udpout_ends,
    "tcpout": tcpout_ends,
    "tcpin": tcpin_ends,
    "serial": serial_ends,
}


def over_mavsdk(make: Callable[[Path, str], Iterator[Ends]]) -> Callable[[Path], Iterator[Ends]]:
    return lambda folder: make(folder, "mavsdk")


ENDS: dict[str, Callable[[Path], Iterator[Ends]]] = {
    "memory": memory_ends,
    "child": child_ends,
    **KINDS,
    **{f"mavsdk-{name}": over_mavsdk(make) for name, make in KINDS.items()},
}

BREAK = ["child", "tcpout", "tcpin", "serial"]
"""Those that find out by themselves that the peer has gone."""

RETURN = [name for name in ENDS if name not in ("memory", "child", "mavsdk-serial")]
"""Those that can be mended; MAVSDK opens no serial port twice."""


def opened(name: str, folder: Path) -> Iterator[Ends]:
    """The ends called *name*, closed afterwards."""
    made = ENDS[name](folder)
    pair = next(made)
    try:
        yield pair
    finally:
        pair.ours.close()
        assert list(made) == []
