"""MAVLink frames over one transport. Sent frames are packed and signed, received ones verified, and all are logged."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

from gcs_autotune.clock import Clock
from gcs_autotune.errors import BadFile
from gcs_autotune.link.transports.transport import Transport
from gcs_autotune.mavlink import (
    LINK_ID,
    Frame,
    Framer,
    Message,
    Packer,
    Signer,
    SigningKey,
    StampStore,
    TlogWriter,
    refusals,
)

__all__ = ["SIMULATED_EPOCH", "FramePort", "time_base"]

SIMULATED_EPOCH = 1_577_836_800.0
"""Start of time in simulated records: 2020-01-01 00:00 UTC [s].

It is fixed so that equal seeds produce identical records. Project choice.
"""
_STALE_PARTIAL = 0.5
"""Age [s] above which an unfinished frame is discarded as noise. Project choice."""
_MOST_SENDERS = 16
"""Number of senders whose unfinished frames are stored. Project choice."""
_SECRET = ("SETUP_SIGNING",)
"""Messages that contain a signing key. They are never logged, whatever their sender."""


class FramePort:
    """The MAVLink frames of a session over its transport. ``signer`` is None without a key. ``sent`` counts bytes.

    Parameters
    ----------
    tlog : where to log every frame, both directions; None for no log.
    notes : list to which messages for the operator are added.
    """

    def __init__(
        self, transport: Transport, packer: Packer, tlog: Path | None, signing: SigningKey | None, notes: list[str]
    ) -> None:
        self._transport = transport
        self._notes = notes
        self._framers: dict[str, Framer] = {}
        self.packer = packer
        self.signer = self._begin_signing(signing) if signing else None
        self._tlog = TlogWriter(tlog, time_base(transport)) if tlog else None
        self._last_bytes = transport.clock.now()
        self.sent = 0

    def _begin_signing(self, key: SigningKey) -> Signer:
        store = None if self._transport.is_simulated else StampStore()
        signer = Signer(key, time_base(self._transport), store)
        self.packer.sign_with(key.secret, LINK_ID, signer.next_stamp)
        if store and store.trouble:
            self._notes.append(store.trouble)
        return signer

    @property
    def system(self) -> int:
        """Our system id, used for sending."""
        return self.packer.system

    @system.setter
    def system(self, value: int) -> None:
        self.packer.system = value

    @property
    def bad_data(self) -> int:
        """Number of received sequences of bytes that are not MAVLink frames."""
        return sum(framer.bad_data for framer in self._framers.values())

    @property
    def bad_bytes(self) -> int:
        """Number of received bytes that do not belong to a MAVLink frame."""
        return sum(framer.bad_bytes for framer in self._framers.values())

    @property
    def refused(self) -> int:
        """Number of received frames rejected by the signing check: unsigned, wrongly signed or too old. 0
        without a key.
        """
        return self.signer.refused.total() if self.signer else 0

    @property
    def refusals(self) -> str:
        """The rejected frames and the reasons, as text; empty if there are none."""
        return refusals(self.signer)

    @property
    def trouble(self) -> str:
        """Problems of the connection and its messages, as text in brackets; empty if there are none."""
        problems = "; ".join(filter(None, (self._transport.trouble, self.refusals)))
        return f" ({problems})" if problems else ""

    def send(self, message: Message, component: int | None = None) -> None:
        """Send and log one message. *component*, if supplied, replaces our component id."""
        frame = self.packer.pack(message, component)
        if message.get_type() not in _SECRET:
            self._log(frame)
        self.sent += len(frame)
        self._transport.write(frame)

    def frames(self, data: bytes) -> Iterator[Frame]:
        """Yield the valid frames completed by *data*; each is logged as it is yielded."""
        for frame in self._framed(data):
            if self.signer is not None and not self.signer.believes(frame):
                continue
            if frame.name not in _SECRET:
                self._log(frame.raw)
            yield frame

    def _framed(self, data: bytes) -> list[Frame]:
        now = self._transport.clock.now()
        if data:
            self._last_bytes = now
            return self._framer(self._transport.origin).feed(data)
        if now - self._last_bytes > _STALE_PARTIAL:
            return [frame for framer in self._framers.values() if framer.pending for frame in framer.flush()]
        return []

    def _framer(self, origin: str) -> Framer:
        """Return the framer of *origin*. Each sender has its own, so that partial frames are not mixed."""
        if origin not in self._framers and len(self._framers) >= _MOST_SENDERS:
            del self._framers[next(iter(self._framers))]
        return self._framers.setdefault(origin, Framer(origin))

    def flush_log(self) -> None:
        """Write the log to the disk."""
        self._log(b"")

    def _log(self, frame: bytes) -> None:
        """Log *frame*, or flush the log if the frame is empty.

        A full disk ends the log, but never the clean-up of a vehicle.
        """
        if self._tlog is None:
            return
        try:
            self._tlog.write(frame) if frame else self._tlog.flush()
        except BadFile as error:
            self._notes.append(f"{error}. The telemetry log ends here")
            with suppress(BadFile):
                self._tlog.close()
            self._tlog = None

    def close(self) -> None:
        """Close the log and the transport."""
        try:
            if self._tlog:
                self._tlog.close()
        except BadFile as error:
            self._notes.append(str(error))
        finally:
            self._transport.close()


def time_base(transport: Transport) -> Callable[[], float]:
    """Return the time [s since 1970] that corresponds to zero on the clock of *transport*, for the time stamps
    of its log.
    """
    if transport.is_simulated:
        return _simulated(transport.clock)
    return time.time


def _simulated(clock: Clock) -> Callable[[], float]:
    return lambda: SIMULATED_EPOCH + clock.now()
