"""MAVSDK as the carrier: it owns the connection, we see every frame that it receives and hand it every frame we send.

MAVSDK 4 runs inside our process. Two of its connections with forwarding on make it a router: the one to the vehicle,
and ``raw://``, whose other end is this file. Frames pass through unchanged, signatures and unknown messages included,
so session, log and signing work as on any other link. MAVSDK is a ground station of its own beside us (system 245):
it sends its heartbeat and asks the vehicle who it is; what it sends itself is kept from our ears.

MAVSDK logs to standard output, once for the whole process: while a link of ours is open the log is ours, and what it
complains of is kept. Every frame it receives is handed over on its own thread, which has to wait until our thread lets
go of the interpreter: at Python's usual 5 ms that is 200 frames a second while we compute, and a parameter list from a
fast simulator overruns the socket (measured: 1241 parameters in 3 to 32 s with losses; 0.20 s at 0.1 ms).
"""

from __future__ import annotations

import importlib
import math
import queue
import socket
import sys
import threading
from collections.abc import Callable
from typing import Any

from gcs_autotune.errors import CannotOpenLink, LinkError, UsageError
from gcs_autotune.link.transports.address import HostPort, SerialName, resolve
from gcs_autotune.link.transports.transport import Transport

__all__ = ["HOST", "Complain", "MavsdkHost", "MavsdkLink"]

_SWITCH_INTERVAL = 1e-4
_WARNING = 2
_NOISE = ("Sending message failed", "Connection using ")
"""Messages that MAVSDK logs in ordinary use: a peer that has not called yet, an old form of URL."""
_NEWS = ("TCP connection closed", "TCP client disconnected")
"""Messages that MAVSDK logs as information and that are errors for us."""

Complain = Callable[[str], None]


class MavsdkHost:
    """Counter of open links; the first one sets up the process, the last one restores it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._listeners: list[Complain] = []
        self._usual_interval = 0.0

    def join(self, module: Any, complain: Complain) -> None:
        """Call *complain* with every warning, on MAVSDK's thread; *module* is the imported ``mavsdk``."""
        with self._lock:
            self._listeners.append(complain)
            if len(self._listeners) == 1:
                self._usual_interval = sys.getswitchinterval()
                sys.setswitchinterval(min(self._usual_interval, _SWITCH_INTERVAL))
                module.log_subscribe(self._take)

    def leave(self, module: Any, complain: Complain) -> None:
        """Undo :meth:`join`."""
        with self._lock:
            self._listeners.remove(complain)
            if not self._listeners:
                module.log_unsubscribe()
                sys.setswitchinterval(self._usual_interval)

    def _take(self, level: int, text: str, file: str | None, line: int) -> bool:
        if (level >= _WARNING and not text.startswith(_NOISE)) or text.startswith(_NEWS):
            for complain in tuple(self._listeners):
                complain(text)
        return True


HOST = MavsdkHost()
"""The instance of this process."""

_SYSTEM, _COMPONENT = 245, 190
"""MAVSDK's usual ids for a ground station."""
_HEADS = {0xFD: 5, 0xFE: 3}
"""Start byte -> index of the system id in the frame."""
_CONNECT_PATIENCE = 0.3
"""Seconds in which MAVSDK reports a rejected TCP connection; it then retries forever. Chosen."""
_REFUSED = "Connect error"
_BROKEN = ("write failure", "read failure")
_NO_REOPENING = " (MAVSDK does not reopen a disconnected serial port; --backend pymavlink does)"
_FRESH = 30.0
"""Seconds for which a warning is related to a silence. Chosen."""
_INSTALL = "python3 -m pip install 'mavsdk>=4'"

_CAUSES = {
    "BIND_ERROR": "cannot listen on {where}: {said}. Close another ground station that uses that port, or choose "
    "another port",
    "SOCKET_ERROR": "cannot listen on {where}: {said}. Close another program that uses that port, or choose another "
    "port",
    "CONNECTION_ERROR": "cannot open {where}: {said}. Check that it is plugged in, your permission, and that no other "
    "program uses it",
    "BAUDRATE_UNKNOWN": "cannot open {where}: MAVSDK does not support this speed. Try 57600 or 115200, or --backend "
    "pymavlink",
}


class MavsdkLink(Transport):
    """A connection carried by MAVSDK. MAVSDK reconnects by itself, so a lost peer appears as silence.

    Parameters
    ----------
    scheme : ``udpin``, ``udpout``, ``tcpin``, ``tcpout`` or ``serial``.
    address : where to.

    Raises
    ------
    UsageError
        No usable MAVSDK is installed, or it cannot do what was asked.
    CannotOpenLink
        The port, address or device cannot be had.
    """

    def __init__(self, scheme: str, address: HostPort | SerialName) -> None:
        prefix = f"{'tcp' if scheme == 'tcpout' else scheme}:" if isinstance(address, HostPort) else ""
        super().__init__(f"{prefix}{address}")
        self._mavsdk = _import_mavsdk()
        self._is_serial = isinstance(address, SerialName)
        url = _url(scheme, address)
        self._arrived: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._complaints: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._trouble, self._troubled_at = "", -math.inf
        HOST.join(self._mavsdk, self._complaints.put)
        self._configuration = self._mavsdk.Configuration.create_manual(_SYSTEM, _COMPONENT, False)
        self._carrier = self._mavsdk.Mavsdk(self._configuration)
        try:
            self._connect(url, f"{'UDP' if 'udp' in scheme else 'TCP'} {address}" if prefix else f"{address}")
        except LinkError:
            self.close()
            raise

    @property
    def carrier(self) -> str:
        """``MAVSDK`` and its version."""
        return f"MAVSDK {self._mavsdk.__version__}"

    @property
    def trouble(self) -> str:
        """Recent warnings of MAVSDK."""
        while not self._complaints.empty():
            self._trouble, self._troubled_at = self._complaints.get_nowait(), self._clock.now()
        if self._clock.now() - self._troubled_at > _FRESH:
            return ""
        hint = _NO_REOPENING if self._is_serial and self._trouble.startswith(_BROKEN) else ""
        return f"MAVSDK reported: {self._trouble}{hint}"

    def _connect(self, url: str, where: str) -> None:
        forwarding = self._mavsdk.ForwardingOption.ON
        self._carrier.add_any_connection_with_forwarding("raw://", forwarding)
        self._carrier.subscribe_raw_bytes_to_be_sent(self._hear)
        result = self._carrier.add_any_connection_with_forwarding(url, forwarding)
        if result.name != "SUCCESS":
            cause = _CAUSES.get(result.name, "cannot open {where}: MAVSDK answered {result} ({said})")
            raise CannotOpenLink(cause.format(where=where, result=result.name, said=self.trouble or "nothing more"))
        if url.startswith("tcpout"):
            self._see_refusal(where)

    def _see_refusal(self, where: str) -> None:
        """Raise an early warning as an error: MAVSDK connects in the background and never gives up."""
        try:
            said = self._complaints.get(timeout=_CONNECT_PATIENCE)
        except queue.Empty:
            return
        if said.startswith(_REFUSED):
            raise CannotOpenLink(
                f"cannot connect to {where}: MAVSDK reported: {said}. Check that the vehicle or simulator is running, "
                "and its port"
            )

    def _hear(self, data: bytes) -> None:
        """Receive one frame, on MAVSDK's thread."""
        at = _HEADS.get(data[0]) if data else None
        if at is not None and data[at : at + 2] == bytes((_SYSTEM, _COMPONENT)):
            return
        self._arrived.put(data)

    def _read_available(self, timeout: float) -> bytes:
        try:
            data = self._arrived.get(timeout=timeout) if timeout > 0.0 else self._arrived.get_nowait()
        except queue.Empty:
            return b""
        pieces = [data]
        while not self._arrived.empty():
            pieces.append(self._arrived.get_nowait())
        return b"".join(pieces)

    def _write(self, data: bytes) -> None:
        self._carrier.pass_received_raw_bytes(data)

    def _close(self) -> None:
        self._carrier.destroy()
        self._configuration.destroy()
        HOST.leave(self._mavsdk, self._complaints.put)


def _import_mavsdk() -> Any:
    try:
        module: Any = importlib.import_module("mavsdk")
    except (ImportError, OSError) as error:
        raise UsageError(
            f"--backend mavsdk needs MAVSDK, which cannot be loaded here ({error}). Run {_INSTALL}, or omit --backend"
        ) from error
    if not hasattr(module, "Mavsdk") or not hasattr(module, "ForwardingOption"):
        version = getattr(module, "__version__", "before 4")
        raise UsageError(
            f"--backend mavsdk needs MAVSDK 4 or newer, which runs without a server process; installed is {version}: "
            f"{_INSTALL}, or omit --backend"
        )
    return module


def _url(scheme: str, address: HostPort | SerialName) -> str:
    """Return the URL for MAVSDK, with a numeric IPv4 address."""
    if isinstance(address, SerialName):
        flow = "_flowcontrol" if address.flow_control else ""
        return f"serial{flow}://{address.path}:{address.baud}"
    family, target = resolve(address, socket.SOCK_STREAM if "tcp" in scheme else socket.SOCK_DGRAM)
    if family != socket.AF_INET:
        raise UsageError(f"MAVSDK does not support IPv6, which {address} needs. Use --backend pymavlink")
    return f"{scheme}://{target[0]}:{target[1]}"
