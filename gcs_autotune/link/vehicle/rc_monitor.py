"""Compare the vehicle's RC input with our overrides, to detect whether it obeys and whether another station steers.

RC_CHANNELS shows the overrides in force on overridden channels, and the receiver's sticks on the others. So a driven
channel with a value that we did not send is another station's stick. Another channel that moves is a stick or switch of
the transmitter, or an override of another station with our id. RC_CHANNELS does not distinguish these.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

from gcs_autotune.link.session import Session
from gcs_autotune.mavlink import Message

__all__ = ["RcMonitor"]

_WATCHED = 8
"""Channels monitored: those of a transmitter's sticks and main switches."""
_SAME = 2
"""Tolerance [us] for rounding of a pulse."""
_MOVED = 100
"""Change [us] that counts as a deliberate movement of a stick or switch; receivers jitter by a tenth of that.
Project choice."""
_NO_PULSE = 800
"""Pulse length [us] below which a channel carries no signal."""
_JUDGED, _TOO_MANY = 12, 3
"""Number of recent RC_CHANNELS messages compared, and how many of them must disagree for a fault. Project choice.

One or two may disagree because they crossed our commands on the link. Another joystick is seen only in the gaps between
our overrides. If it is in step with them, it appears in one message of three.
"""
_MEMORY = 1.0
"""Time [s of listening] for which a sent value may still be on its way, in addition to the known delay of the link.

It counts listening time so that a stall of this computer is not attributed to the vehicle. Project choice.
"""
_HISTORY = 8.0
"""Age [s] above which a value of ours that appears is no longer recognised as our command. Project choice."""
_PATIENCE = 3.0
"""Time [s] without effect after which the vehicle counts as ignoring our commands. Project choice."""


class RcMonitor:
    """Compares RC_CHANNELS with what was sent.

    Attributes
    ----------
    shown : channel (1-based) -> PWM [us] in the last RC_CHANNELS.
    has_receiver : whether an RC receiver delivers channels; None before the first message.
    count : number of RC_CHANNELS messages received.
    memory : time [s] for which a sent value may still be on its way.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._sent: deque[tuple[float, Mapping[int, int]]] = deque()
        self._history: deque[tuple[float, Mapping[int, int]]] = deque()
        self._driven: Mapping[int, int] = {}
        self._since = 0.0
        self._verdicts: deque[tuple[int, int] | None] = deque(maxlen=_JUDGED)
        self._at_rest: dict[int, int] = {}
        self._strayed: dict[int, int] = {}
        self._moved: tuple[int, int, int] | None = None
        self.obeyed = False
        self.shown: dict[int, int] = {}
        self.has_receiver: bool | None = None
        self.count = 0
        self.memory = _MEMORY
        session.listen("RC_CHANNELS", self._on_rc_channels)

    def sent(self, values: Mapping[int, int], slack: float = 0.0) -> None:
        """Record an override sent now: channel -> PWM [us]. *slack*: round trip of the link [s], added to the time for
        which a sent value may still arrive.
        """
        now = self._session.liveness.listened
        self.memory = _MEMORY + slack
        if not self._sent:
            self._since = now
        self._driven = values
        if not self._sent or dict(self._sent[-1][1]) != dict(values):
            self._sent.append((now, dict(values)))
            self._history.append((now, dict(values)))
        while len(self._history) > 1 and self._history[1][0] < now - _HISTORY:
            self._history.popleft()
        while len(self._sent) > 1 and self._sent[1][0] < now - self.memory:
            self._sent.popleft()

    def forget(self) -> None:
        """Discard the overrides sent, because commanding has ended."""
        self._sent.clear()
        self._history.clear()
        self._verdicts.clear()
        self._at_rest.clear()
        self._strayed.clear()
        self._moved, self.obeyed = None, False

    def show(self, values: Mapping[int, int]) -> bool:
        """Return whether the last RC_CHANNELS shows *values* (channel -> PWM [us])."""
        return bool(self.shown) and all(abs(self.shown[n] - pwm) <= _SAME for n, pwm in values.items())

    @property
    def moved_by_hand(self) -> tuple[int, int, int] | None:
        """(channel, PWM [us] before, PWM now) of a channel that we do not drive and that has moved; None if none
        has.

        Without a receiver a channel keeps its value, so an override must have moved it.
        """
        return self._moved

    @property
    def departed(self) -> tuple[int, int, int] | None:
        """(channel, PWM [us] sent, PWM shown) if RC_CHANNELS keeps showing other values than ours; else None."""
        if not self._sent:
            return None
        wrong = [v for v in self._verdicts if v is not None]
        late = self._session.liveness.listened - self._since > _PATIENCE + self.memory
        if len(wrong) < _TOO_MANY or not (self.obeyed or late):
            return None
        channel, shown = wrong[-1]
        return channel, self._driven[channel], shown

    def was_sent(self, channel: int, pwm: int) -> bool:
        """Return whether we sent *pwm* [us] on *channel* some time ago, so that it may have arrived late."""
        return any(abs(values.get(channel, 0) - pwm) <= _SAME for _, values in self._history)

    def _on_rc_channels(self, m: Message) -> None:
        self.shown = {n: int(getattr(m, f"chan{n}_raw")) for n in range(1, 17)}
        self.has_receiver = m.chancount > 0
        self.count += 1
        if self._sent:
            self._judge()
            self._check_rc_sticks()

    def _judge(self) -> None:
        verdict = next(
            (
                (channel, self.shown[channel])
                for channel in self._driven
                if not any(abs(self.shown[channel] - values[channel]) <= _SAME for _, values in self._sent)
            ),
            None,
        )
        self.obeyed = self.obeyed or verdict is None
        self._verdicts.append(verdict)

    def _check_rc_sticks(self) -> None:
        for channel in range(1, _WATCHED + 1):
            pwm = self.shown[channel]
            if channel in self._driven or pwm < _NO_PULSE:
                continue
            rest = self._at_rest.setdefault(channel, pwm)
            if abs(pwm - rest) <= _MOVED:
                self._strayed.pop(channel, None)
            elif channel in self._strayed:
                self._moved = channel, rest, pwm
            else:
                self._strayed[channel] = pwm
