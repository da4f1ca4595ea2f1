"""Asking for message rates, and measuring what really comes.

ArduPilot denies what its loop cannot send and keeps the old rate; radios lose messages. So a request is
halved until it is granted, the result is measured on the vehicle's own clock, and put back at the end.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

from gcs_autotune.errors import AutotuneError, CommandDenied, NoReply, TelemetryFault
from gcs_autotune.link.commands import Commands
from gcs_autotune.link.session import Session
from gcs_autotune.link.wire import Message, mavlink

__all__ = ["Granted", "Rates", "message_number"]

_SLOWEST = 1.0
"""Hz below which halving gives up."""


def message_number(name: str) -> int:
    """Return the id of the MAVLink message called *name*."""
    return int(getattr(mavlink, f"MAVLINK_MSG_ID_{name}"))


@dataclass(frozen=True, slots=True)
class Granted:
    """One request: rates [Hz] asked and granted (0: refused), and the interval [us] before (0: default)."""

    asked: float
    granted: float
    previous: int


class Rates:
    """The message rates of a session's vehicle.

    Attributes
    ----------
    granted : message name -> what came of the request.
    measured : message name -> Hz, from the last :meth:`measure`.
    """

    def __init__(self, session: Session, commands: Commands) -> None:
        self._session = session
        self._commands = commands
        self.granted: dict[str, Granted] = {}
        self.measured: dict[str, float] = {}

    def request(self, wanted: Mapping[str, float]) -> dict[str, float]:
        """Ask for messages at rates [Hz]; return what was granted, 0 for what the vehicle refuses altogether."""
        for name, rate in wanted.items():
            before = self.granted.get(name)
            previous = before.previous if before else self._previous_interval(name)
            self.granted[name] = Granted(rate, 0.0, previous)
            self.granted[name] = Granted(rate, self._grant(name, rate), previous)
            if self.granted[name].granted < rate:
                self._session.notes.append(
                    f"{name}: asked for {rate:g} Hz, the vehicle grants {self.granted[name].granted:g} Hz"
                )
        return {name: self.granted[name].granted for name in wanted}

    def _grant(self, name: str, rate: float) -> float:
        while rate >= _SLOWEST:
            try:
                self._set_interval(name, round(1e6 / rate))
                return rate
            except CommandDenied:
                rate /= 2.0
        return 0.0

    def _set_interval(self, name: str, interval: int) -> None:
        self._commands.command_long(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, float(message_number(name)), float(interval))

    def _previous_interval(self, name: str) -> int:
        """Return the interval [us] in force; 0, which means the default, when the vehicle does not tell."""
        number = message_number(name)
        answers: list[Message] = []
        stop = self._session.listen("MESSAGE_INTERVAL", lambda m: answers.append(m) if m.message_id == number else None)
        try:
            self._commands.command_long(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, float(number), tries=2)
            self._session.wait_for(lambda: True if answers else None, 1.0)
        except (CommandDenied, NoReply):
            return 0
        finally:
            stop()
        return int(answers[0].interval_us) if answers else 0

    def measure(
        self, required: Mapping[str, float], duration: float = 2.0, *, tolerance: float = 0.6
    ) -> dict[str, float]:
        """Count for *duration* [s of the vehicle's time]; return Hz of all messages asked for and required.

        Parameters
        ----------
        required : message -> rate [Hz] that is needed; at least *tolerance* of it must be there.

        Raises
        ------
        TelemetryFault
            One comes too slowly, with the numbers, or no ATTITUDE comes to measure time by.
        """
        counts: Counter[str] = Counter()
        stamps: list[float] = []
        watched = {*required, *self.granted}
        stops = [self._session.listen(name, partial(_count, counts, name)) for name in watched]
        stops.append(self._session.listen("ATTITUDE", lambda m: stamps.append(m.time_boot_ms * 1e-3)))
        try:
            self._session.wait_for(lambda: _lasted(stamps, duration), 4.0 * duration)
        finally:
            for stop in stops:
                stop()
        n = len(stamps)
        span = (stamps[-1] - stamps[0]) * n / (n - 1) if n > 1 else 0.0  # n messages stand for n periods
        if span <= 0.0:
            raise TelemetryFault(
                "no ATTITUDE arrives although heartbeats do: is another ground station changing the stream rates?"
            )
        rates = self.measured = {name: counts[name] / span for name in watched}
        slow = [f"{n} {rates[n]:.1f} Hz of {hz:g}" for n, hz in required.items() if rates[n] < tolerance * hz]
        if slow:
            raise TelemetryFault(
                f"telemetry is too slow: {', '.join(slow)}; use a faster link, or ask for fewer messages"
            )
        return rates

    def restore(self) -> None:
        """Put every interval back as it was. The operator has to wait; what fails is noted, not raised."""
        with self._session.shielded():
            for name in reversed(list(self.granted)):
                try:
                    self._set_interval(name, self.granted[name].previous)
                except AutotuneError as error:
                    self._session.notes.append(f"the rate of {name} was not put back: {error}")
        self.granted.clear()


def _count(counts: Counter[str], name: str, _: Message) -> None:
    counts[name] += 1


def _lasted(stamps: list[float], duration: float) -> bool | None:
    return True if len(stamps) > 1 and stamps[-1] - stamps[0] >= duration else None
