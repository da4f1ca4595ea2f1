"""MAVSDK as the carrier: it owns the connection and exchanges complete MAVLink frames with this program.

MAVSDK 4 runs inside our process. Two of its connections with forwarding switched on make it a router. One leads to the
vehicle. The other is ``raw://``, whose other end is this module. Frames pass through unchanged, including signatures
and unknown messages. So session, log and signing work as on any other link. MAVSDK is also a ground station of its own
(system 245). It sends its own heartbeat and asks the vehicle for its identity. The messages that it sends itself are
not passed to this program.

MAVSDK logs to standard output, once for the whole process. While a link of ours is open, this module receives the log
and stores its warnings. MAVSDK passes on each received frame on its own thread. That thread has to wait until our
thread releases the interpreter lock. At Python's usual switch interval of 5 ms this limits it to 200 frames a second
while we compute, and a parameter list from a fast simulator overruns the socket. Measured: 1241 parameters took 3 to 32
s with losses, and 0.20 s at 0.1 ms.
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
"""Messages that MAVSDK logs in ordinary use, such as a peer that has not connected yet or an old form of URL."""
_NEWS = ("TCP connection closed", "TCP client disconnected")
"""Messages that MAVSDK logs as information but that are errors for this program."""

Complain = Callable[[str], None]


class MavsdkHost:
    """Counts the open MAVSDK links of this process. The first one sets up the process, and closing the last one
    restores it.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._listeners: list[Complain] = []
        self._usual_interval = 0.0

    def join(self, module: Any, complain: Complain) -> None:
        """Call *complain* with every warning, on MAVSDK's thread. *module* is the imported ``mavsdk``."""
        with self._lock:
            self._listeners.append(complain)
            if len(self._listeners) == 1:
                self._usual_interval = sys.getswitchinterval()
                sys.setswitchinterval(min(self._usual_interval, _SWITCH_INTERVAL))
                module.log_subscribe(self._take)

    def leave(self, module: Any, complain: Complain) -> None:
        """Stop calling *complain*, and restore the process after the last link."""
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
"""The only :class:`MavsdkHost` in this process."""

_SYSTEM, _COMPONENT = 245, 190
"""MAVSDK's usual MAVLink system and component id for a ground station."""
_HEADS = {0xFD: 5, 0xFE: 3}
"""Start byte -> index of the system id in the frame."""
_CONNECT_PATIENCE = 0.3
"""Time [s] within which MAVSDK reports a rejected TCP connection; later it retries forever. Project choice."""
_REFUSED = "Connect error"
_BROKEN = ("write failure", "read failure")
_NO_REOPENING = " (MAVSDK does not reopen a disconnected serial port; --backend pymavlink does)"
_FRESH = 30.0
"""Age [s] up to which a warning is considered the cause of a silence. Project choice."""
_INSTALL = "python3 -m pip install 'mavsdk>=4'"

_CAUSES = {
    "BIND_ERROR": "cannot listen on {where}: {detail}. Close another ground station that uses that port, or choose "
    "another port",
    "SOCKET_ERROR": "cannot listen on {where}: {detail}. Close another program that uses that port, or choose another "
    "port",
    "CONNECTION_ERROR": "cannot open {where}: {detail}. Check that it is plugged in, that you have permission, and "
    "that no other program uses it",
    "BAUDRATE_UNKNOWN": "cannot open {where}: MAVSDK does not support this speed. Try 57600 or 115200, or --backend "
    "pymavlink",
}


class MavsdkLink(Transport):
    """A connection carried by MAVSDK. MAVSDK reconnects by itself, so a lost peer appears as silence.

    Parameters
    ----------
    scheme : ``udpin``, ``udpout``, ``tcpin``, ``tcpout`` or ``serial``.
    address : the address to connect to or listen on.

    Raises
    ------
    UsageError
        No usable MAVSDK is installed, or it does not support the request.
    CannotOpenLink
        The port, address or device cannot be opened.
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
        """The text ``MAVSDK`` and its version."""
        return f"MAVSDK {self._mavsdk.__version__}"

    @property
    def trouble(self) -> str:
        """Recent warnings of MAVSDK as text; empty if there are none."""
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
            cause = _CAUSES.get(result.name, "cannot open {where}: MAVSDK answered {result} ({detail})")
            raise CannotOpenLink(cause.format(where=where, result=result.name, detail=self.trouble or "nothing more"))
        if url.startswith("tcpout"):
            self._see_refusal(where)

    def _see_refusal(self, where: str) -> None:
        """Raise an early warning as an error, because MAVSDK connects in the background and retries forever."""
        try:
            warning = self._complaints.get(timeout=_CONNECT_PATIENCE)
        except queue.Empty:
            return
        if warning.startswith(_REFUSED):
            raise CannotOpenLink(
                f"cannot connect to {where}: MAVSDK reported: {warning}. Check that the vehicle or simulator is "
                "running, and its port"
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
            f"--backend mavsdk needs MAVSDK 4 or newer, which runs without a server process. Installed is {version}. "
            f"Run {_INSTALL}, or omit --backend"
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
