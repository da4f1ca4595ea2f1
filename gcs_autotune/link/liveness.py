"""Determine which sender is the vehicle, and how long it has been silent.

Silence counts only while we listen. The first sender found is used; another sender with the vehicle's ids is reported
and ignored, because any sender can use these ids. Senders differ in their origin (address and port on UDP) and in their
sequence numbers. After a restart or a radio reconnect the vehicle may use another port. If the sender in use has fallen
silent, another sender with the same ids gets a request for its board id, and is used if the board ids match.
"""

from __future__ import annotations

from collections import deque

from gcs_autotune.mavlink import Frame, VehicleIdentity, firmware_version, unique_id

__all__ = ["GONE", "HeldSender", "Liveness"]

_LONGEST_PUMP = 0.5
"""Longest time between two pumps that counts as listening [s]. Project choice.

After a longer time this computer was busy or suspended, and received messages are still unread.
"""
_LEAST_KEPT = 0.5
_KEPT = 50


class Liveness:
    """Measures the time spent listening and the time since the last message. It is also a clock that stops while this
    computer is busy.

    Attributes
    ----------
    listened : seconds of link time spent pumping.
    last_received : what ``listened`` was when the vehicle was last heard.
    """

    def __init__(self, now: float) -> None:
        self._last_pump = now
        self.listened = 0.0
        self.last_received = 0.0
        self._word = 0.0
        self._silences: deque[tuple[float, float]] = deque(maxlen=_KEPT)

    def now(self) -> float:
        """Return the time spent listening so far [s], for deadlines that must not expire while an answer is unread."""
        return self.listened

    @property
    def silence(self) -> float:
        """Seconds of listening since the last message; negative during an expected silence that is tolerated."""
        return self.listened - self.last_received

    def count(self, now: float) -> float:
        """Count the time since the last call as listening, and return that time [s]. *now* is the link time [s]."""
        since, self._last_pump = now - self._last_pump, now
        self.listened += min(since, _LONGEST_PUMP)
        return since

    @property
    def actual_silence(self) -> float:
        """Seconds of listening since the last message, including a tolerated silence."""
        return self.listened - self._word

    def longest(self, span: float) -> float:
        """Return the longest silence [s] that ended within the last *span* [s] of listening; 0 if there was none."""
        return max((silence for end, silence in self._silences if end >= self.listened - span), default=0.0)

    def heard(self) -> None:
        """Record that a message from the vehicle arrived."""
        if self.actual_silence > _LEAST_KEPT:
            self._silences.append((self.listened, self.actual_silence))
        self.last_received = self._word = self.listened

    def bear(self, silence: float) -> None:
        """Tolerate a silence of the vehicle. :attr:`silence` counts from zero again only after *silence* [s]."""
        self.last_received = self.listened + silence


LOSSY = 0.1
"""Fraction of lost messages above which the loss is reported as a cause; a good radio loses 1 to 3 %. Project
choice."""
_ENOUGH = 12
"""Number of messages sent before their loss is computed. Project choice."""
_JUMP = 128
"""Step of the sequence number above which it counts as backwards, because of messages out of order or a restart."""


class Loss:
    """Fraction of the vehicle's messages that the link lost, computed from gaps in the sequence numbers.

    The autopilot numbers only messages that it sends, not those that did not fit into its port's buffer. So a gap means
    a loss on the link.
    """

    def __init__(self) -> None:
        self._last = -1
        self.received = self.lost = 0

    def hear(self, sequence: int) -> None:
        """Update the counts with the *sequence* number (0 to 255) of the next message."""
        gap = (sequence - self._last - 1) % 256 if self._last >= 0 else 0
        self._last = sequence
        self.received += 1
        if gap < _JUMP:
            self.lost += gap

    @property
    def share(self) -> float:
        """Lost messages as a fraction of the messages sent; 0 if too few were sent to compute it."""
        return self.lost / (self.received + self.lost) if self.is_known else 0.0

    @property
    def is_known(self) -> bool:
        """Whether enough messages were sent to compute the loss."""
        return self.received + self.lost >= _ENOUGH

    @property
    def words(self) -> str:
        """Sentence with the loss and its remedy for an error message; empty if the loss is small."""
        if self.share < LOSSY:
            return ""
        return (
            f"the link loses {100.0 * self.share:.0f} % of the vehicle's messages (gaps in their sequence numbers). "
            "Check antennas, range and interference, and whether a radio or router on the way is overloaded"
        )


GONE = 3.0
"""Silence of the sender in use after which another may replace it [s]. Project choice: three heartbeats."""
_VOICES = 16
"""Number of sequences followed at once. Every lost message starts a new one."""
_TURNS = 5
"""Number of alternations between two sequences that prove two senders. Project choice."""
_MOST_STRANGERS = 20


class _Voice:
    """A series of consecutive sequence numbers; ``turns`` counts how often it resumed after another one."""

    def __init__(self) -> None:
        self.turns = 0


class HeldSender:
    """The one sender, among those with the vehicle's ids, that is accepted as the vehicle.

    Attributes
    ----------
    origin : source address of its bytes; empty if the link does not report it.
    loss : fraction of its messages that does not arrive.
    notes : messages for the operator.
    """

    def __init__(self, notes: list[str]) -> None:
        self.origin = ""
        self._notes = notes
        self._suspects: dict[str, str] = {}
        self._other_senders: dict[str, None] = {}
        self.loss = Loss()
        self._voices: dict[int, _Voice] = {}
        self._last: _Voice | None = None
        self._two_noted = False

    def is_held(self, frame: Frame) -> bool:
        """Return whether *frame*, sent with the vehicle's ids, comes from the accepted sender."""
        return frame.origin == self.origin

    def hear(self, frame: Frame) -> None:
        """Process the sequence number of *frame* from the accepted sender.

        Report interleaved sequences and other senders once each.
        """
        if self._suspects:
            self._report_others()
        sequence = frame.raw[4] if frame.raw[0] == 0xFD else frame.raw[2]
        self.loss.hear(sequence)
        voice = self._voices.pop(sequence, None) or _Voice()
        if voice is not self._last:
            voice.turns += 1
        self._last = self._voices[(sequence + 1) % 256] = voice
        if len(self._voices) > _VOICES:
            del self._voices[next(iter(self._voices))]
        if voice.turns > _TURNS and not self._two_noted:
            self._two_noted = True
            self._notes.append(
                "two senders use the vehicle's system id on this connection (their sequence numbers "
                "interleave): another program with the vehicle's id, or a router that joins two links to it. "
                "Stop one of them. If the other sender is unknown, use a signed link"
            )

    def note_other_sender(self, frame: Frame) -> None:
        """Record another sender with the vehicle's ids.

        It is reported once, if a message of the accepted sender arrives after it.
        """
        if frame.origin not in self._other_senders and len(self._other_senders) < _MOST_STRANGERS:
            self._suspects[frame.origin] = f"system {frame.system}, component {frame.component}"

    def _report_others(self) -> None:
        for origin, ids in self._suspects.items():
            self._other_senders[origin] = None
            self._notes.append(
                f"another sender at {origin} uses the vehicle's ids ({ids}); the vehicle is at {self.origin}. The "
                "other sender is ignored. Give one of the two another system id, or use a signed link"
            )
        self._suspects.clear()

    @property
    def others(self) -> tuple[str, ...]:
        """Addresses of the other senders that used the vehicle's ids."""
        return tuple(dict.fromkeys((*self._suspects, *self._other_senders)))

    def may_be(self, frame: Frame, known: VehicleIdentity) -> bool:
        """Return whether *frame* is an AUTOPILOT_VERSION which shows that its sender is the *known* vehicle at a new
        address."""
        if frame.name != "AUTOPILOT_VERSION":
            return False
        if known.uid:
            return unique_id(frame.message) == known.uid
        return not unique_id(frame.message) and firmware_version(frame.message) == known.version

    def hold(self, origin: str, known: VehicleIdentity | None = None) -> None:
        """Accept the sender at *origin* as the vehicle from now on, because the *known* vehicle has changed its
        address.
        """
        if known is not None:
            how = "its board's id is the same" if known.uid else "its board reports no id, but its firmware is the same"
            self._notes.append(f"the vehicle now sends from {origin}, not {self.origin} (restarted?): {how}")
        self.origin = origin
        self._suspects.pop(origin, None)
