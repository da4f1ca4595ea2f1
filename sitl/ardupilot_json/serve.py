"""The lock-step loop over UDP: ArduPilot sends requests, each is answered, and ArduPilot's clock applies."""

from __future__ import annotations

import errno
import socket
import time
from collections.abc import Callable

from sitl.ardupilot_json.physics import Physics
from sitl.ardupilot_json.wire import BadPacket, Servos, read_servos, write_state
from sitl.listen import CannotListen

__all__ = ["DEFAULT_PORT", "JsonServer"]

DEFAULT_PORT = 9002
"""UDP port of the physics for ArduPilot's instance 0. Instance I uses 9002 + 10 I."""
_LARGEST = 2048
_SLOWEST_RATE = 11
"""Lowest rate [Hz], because ArduPilot ignores frames of 0.1 s and more.

It starts at 1200 Hz and decreases to its --rate by 1 Hz per frame.
"""


class JsonServer:
    """Answers one ArduPilot at a time, from a bound UDP port.

    A request with the same frame count as the last one is a repetition and gets the same answer. A count of 0 means
    that ArduPilot has restarted, and the hull restarts at home. Other senders are not answered.

    Parameters
    ----------
    physics : the hull.
    port : UDP port; 0 lets the system choose (see ``port``).
    host : address to listen on.
    patience : longest time to wait for a request [s], then ``TimeoutError``; None: no limit.
    say : receives a line for the operator when a session begins.

    Raises
    ------
    CannotListen
        The port is taken.
    """

    def __init__(
        self,
        physics: Physics,
        *,
        port: int = DEFAULT_PORT,
        host: str = "127.0.0.1",
        patience: float | None = None,
        say: Callable[[str], None] = lambda line: None,
    ) -> None:
        self.physics = physics
        self.frames = 0
        """Number of frames answered, without repetitions."""
        self.simulated = 0.0
        """Simulated time of all frames [s]."""
        self.began: float | None = None
        """Clock time of the first request [s] (time.monotonic), None before it."""
        self._say = say
        self._peer: tuple[str, int] | None = None
        self._last: Servos | None = None
        self._answer = b""
        self._complained = False
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            reason = "the port is in use. Stop the other program or choose another port"
            if error.errno != errno.EADDRINUSE:
                reason = f"{error.strerror}. Check the address"
            raise CannotListen(f"cannot listen on {host}:{port}: {reason}") from error
        self._socket.settimeout(patience)
        self.port: int = self._socket.getsockname()[1]

    def close(self) -> None:
        """Close the port."""
        self._socket.close()

    def serve(self) -> None:
        """Answer requests until an exception, such as that of Ctrl-C, ends the loop."""
        while True:
            self.serve_one()

    def serve_one(self) -> None:
        """Wait for one datagram and answer it if it is a request. Raises ``TimeoutError`` if no datagram arrives in
        time.
        """
        try:
            datagram, sender = self._socket.recvfrom(_LARGEST)
        except ConnectionError:  # an earlier answer had no receiver
            return
        try:
            servos = read_servos(datagram)
        except BadPacket as error:
            if not self._complained:
                self._say(f"ignored a datagram from {sender[0]}:{sender[1]}: {error}")
            self._complained = True
            return
        answer = self._answer_to(servos, sender)
        if answer:
            self._socket.sendto(answer, sender)

    def _answer_to(self, servos: Servos, sender: tuple[str, int]) -> bytes:
        if sender != self._peer:
            if self._peer is not None and servos.count != 0:
                return b""
            self._begin(servos, sender)
        elif self._last is not None and servos.count == self._last.count:
            return self._answer
        elif self._last is not None and servos.count < self._last.count:
            self._begin(servos, sender)
        self._last = servos
        dt = 1.0 / max(servos.rate, _SLOWEST_RATE)
        self.frames += 1
        self.simulated += dt
        self._answer = write_state(self.physics.step(dt, servos.pwm))
        return self._answer

    def _begin(self, servos: Servos, sender: tuple[str, int]) -> None:
        """Accept *sender* as the autopilot. A hull that has moved is returned home."""
        if self.physics.seconds > 0.0:
            self.physics.restart()
        if servos.count > 0:  # ours was started in mid-run: its clock goes on, or it would take our time for a jump
            self.physics.seconds = servos.count / max(servos.rate, _SLOWEST_RATE)
        self._peer = sender
        self.began = self.began or time.monotonic()
        self._say(f"ArduPilot at {sender[0]}:{sender[1]}")
