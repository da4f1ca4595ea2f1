"""Measure the delays of this link: round trip, command to actuator, and the whole loop.

The *round trip* of TIMESYNC is that of the radio alone. *Command to servo* is the delay on the way up: from sending an
override until the autopilot's output moves, in the vehicle's own time. The *loop* is the delay in a relay closed over
the link: from the time stamp of the attitude used until the output reacts. The loop needs no synchronised clock,
because both stamps are the vehicle's.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np

from gcs_autotune.link.session import Session
from gcs_autotune.mavlink import Message, mavlink

__all__ = ["Latency", "LinkTimes", "least_period"]

_KEPT = 200
_TRUSTED = 5
"""Number of answers used to compare the clocks.

At one a second no clock drifts by a millisecond in that time. Project choice.
"""
_STEP = 0.04
"""Smallest command change that is timed [fraction of full output].

It is above the corrections of hold loops. Project choice.
"""
_MOVED_SHARE, _MOVED_MOST = 0.3, 0.03
"""Fraction of a commanded change, and its upper limit, after which an output counts as moved.

So the start of a slew-limited change of throttle counts, too. Project choice.
"""
_NEVER = 2.0
"""Time [s] after which a command without effect counts as lost or limited and is not timed. Project choice."""
_REAL_TIME = 0.02
"""Tolerance on the ratio of vehicle time to our time. A simulator at double speed is outside it."""
_LAG_SHARE = 8.0
"""Shortest period that can be evaluated, in multiples of the loop's delay.

A relay on an integrator with delay oscillates with a period of four delays, so at this limit the craft contributes
half. Project choice.
"""
_SAMPLES = 8.0
"""Smallest number of attitudes per oscillation that determines its amplitude. Project choice."""


@dataclass(frozen=True, slots=True)
class LinkTimes:
    """Delays of a link as medians and 90 % quantiles (``_90``) [s of the vehicle's time]; NaN if not measured.

    ``round_trip``: of TIMESYNC [s of link time].
    ``command_to_servo``: from sending an override to the change of an output. It needs both clocks, so it is not
    measured on a simulator that runs at another speed.
    ``loop``: from the stamp of an attitude to the output that reacts to it.
    ``samples``: number of command changes timed.
    ``override_rate`` [Hz]: rate of the overrides while commanding.
    ``override_gap`` [s]: the longest pause between two of them.
    """

    round_trip: float = math.nan
    round_trip_90: float = math.nan
    command_to_servo: float = math.nan
    command_to_servo_90: float = math.nan
    loop: float = math.nan
    loop_90: float = math.nan
    samples: int = 0
    override_rate: float = math.nan
    override_gap: float = math.nan

    def to_dict(self) -> dict[str, float]:
        """Return the known values as plain data for JSON."""
        return {name: value for name, value in asdict(self).items() if math.isfinite(value)}

    def __str__(self) -> str:
        """Return the loop delay with its known parts first, then the round trip, which is not one of these parts."""
        parts = [
            _part("from measured attitude to output", self.loop, self.loop_90),
            _part("of this from command to output", self.command_to_servo, self.command_to_servo_90),
            _part("link there and back", self.round_trip, self.round_trip_90),
        ]
        return ", ".join(p for p in parts if p) or "not measured"


def _part(what: str, middle: float, late: float) -> str:
    return f"{what} {1e3 * middle:.0f} ms (9 of 10 within {1e3 * late:.0f})" if math.isfinite(middle) else ""


@dataclass(frozen=True, slots=True)
class _Pending:
    """A command whose effect has not appeared yet."""

    before: float
    wanted: float
    seen: float
    sent: float
    since: float


class Latency:
    """Measures the delays of a session during normal traffic.

    Attributes
    ----------
    requested, answered : number of TIMESYNC messages sent, and answered.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._open: dict[int, float] = {}
        self._trips: deque[tuple[float, float, float]] = deque(maxlen=_KEPT)
        self._quickest = self._middle = math.nan
        self._pending: dict[str, _Pending] = {}
        self._wanted: dict[str, float] = {}
        self._up: deque[float] = deque(maxlen=_KEPT)
        self._round: deque[float] = deque(maxlen=_KEPT)
        self.requested = self.answered = 0
        session.listen("TIMESYNC", self._on_timesync)

    # --- there and back -----------------------------------------------------------------------------------

    def ask(self) -> None:
        """Send one TIMESYNC request. Its answer is processed on arrival."""
        now = self._session.clock.now()
        stamp = round(now * 1e9) + 1
        if stamp not in self._open:
            self._open[stamp] = now
            self.requested += 1
            self._session.send(mavlink.MAVLink_timesync_message(0, stamp))

    def _on_timesync(self, m: Message) -> None:
        """Process a TIMESYNC. Requests of the vehicle (tc1 0) and answers to other stations are ignored."""
        sent = self._open.pop(int(m.ts1), None) if m.tc1 else None
        if sent is not None:
            self.answered += 1
            trip = self._session.clock.now() - sent
            self._quickest = trip if math.isnan(self._quickest) else min(trip, self._quickest)
            self._trips.append((sent, trip, float(m.tc1) * 1e-9))
            self._middle = math.nan

    @property
    def lateness(self) -> float:
        """Delay [s] of the last TIMESYNC answer, or of a missing answer if that is longer; 0 before any request."""
        waiting = [self._session.clock.now() - sent for sent in self._open.values()]
        answered = max((sent for sent, _, _ in self._trips), default=-math.inf)
        unanswered = [age for age in waiting if self._session.clock.now() - age > answered]
        return max([*unanswered, self._trips[-1][1] if self._trips else 0.0])

    def vehicle_time(self, t: float) -> float:
        """Return the vehicle's time [s since boot] at link time *t* [s]; NaN before any answer.

        The fastest of the last few TIMESYNC answers is used, since it has the smallest error. Older answers are
        ignored, because a simulator on a busy computer falls behind.
        """
        if not self._trips:
            return math.nan
        sent, trip, stamp = min(list(self._trips)[-_TRUSTED:], key=lambda entry: entry[1])
        return stamp + self._pace() * (t - sent - 0.5 * trip)

    def _pace(self) -> float:
        """Return the seconds of vehicle time per second of our time: 1, except for simulators."""
        (t0, trip0, stamp0), (t1, trip1, stamp1) = self._trips[0], self._trips[-1]
        span = t1 + 0.5 * trip1 - t0 - 0.5 * trip0
        if span < 0.5:
            return 1.0
        pace = (stamp1 - stamp0) / span
        return 1.0 if abs(pace - 1.0) < _REAL_TIME + 2.0 * max(trip0, trip1) / span else pace

    # --- command to servo ---------------------------------------------------------------------------------

    def commanded(self, wanted: Mapping[str, float], outputs: Mapping[str, float], seen: float) -> None:
        """Record a command sent now.

        wanted, outputs : commanded and last measured fraction of full output, by force.
        seen : the vehicle's stamp [s] of the attitude that the command answers.
        """
        now = self._session.clock.now()
        for force, value in wanted.items():
            before = self._wanted.get(force)
            if before is not None and abs(value - before) < _STEP:
                continue
            self._wanted[force] = value
            measured = outputs.get(force)
            if before is None or measured is None or abs(value - measured) < _STEP:
                self._pending.pop(force, None)
            else:
                self._pending[force] = _Pending(measured, value, seen, self.vehicle_time(now), seen)

    def forget(self) -> None:
        """Do not time later output changes as reactions to the last command."""
        self._pending.clear()
        self._wanted.clear()

    def moved(self, t: float, outputs: Mapping[str, float]) -> None:
        """Record measured outputs (fractions of full output). *t* [s] is the time of the change on the
        vehicle's clock.
        """
        for force, pending in list(self._pending.items()):
            change = pending.wanted - pending.before
            gone = math.copysign(1.0, change) * (outputs.get(force, pending.before) - pending.before)
            if gone >= min(_MOVED_SHARE * abs(change), _MOVED_MOST):
                self._round.append(t - pending.seen)
                if math.isfinite(pending.sent) and self._pace() == 1.0:
                    # Sent after the attitude that it answers was stamped, whatever the comparison of the clocks shows.
                    self._up.append(t - max(pending.sent, pending.seen))
                del self._pending[force]
            elif t - pending.since > _NEVER:
                del self._pending[force]

    # --- in numbers ---------------------------------------------------------------------------------------

    @property
    def loop(self) -> float:
        """Median delay of the control loop [s]: from an attitude's stamp to the output that reacts to it. NaN if not
        measured.
        """
        return _quantile(self._round, 0.5)

    def trips(self, since: float) -> tuple[tuple[float, float], ...]:
        """Return (link time of the request, round trip), both [s], of every TIMESYNC request answered since link time
        *since* [s].
        """
        return tuple((sent, trip) for sent, trip, _ in self._trips if sent >= since)

    @property
    def quickest(self) -> float:
        """Shortest TIMESYNC round trip so far [s of link time]; NaN before any answer."""
        return self._quickest

    @property
    def round_trip(self) -> float:
        """Median TIMESYNC round trip [s of link time]; NaN if not measured."""
        if math.isnan(self._middle):
            self._middle = _quantile([trip for _, trip, _ in self._trips], 0.5)
        return self._middle

    def times(self, override_rate: float = math.nan, override_gap: float = math.nan) -> LinkTimes:
        """Return the medians and 90 % quantiles of the measured delays [s], with the supplied override rate [Hz] and
        longest gap [s].
        """
        trips = [trip for _, trip, _ in self._trips]
        loop, late = _quantile(self._round, 0.5), _quantile(self._round, 0.9)
        return LinkTimes(
            _quantile(trips, 0.5),
            _quantile(trips, 0.9),
            min(_quantile(self._up, 0.5), loop) if self._up else math.nan,
            min(_quantile(self._up, 0.9), late) if self._up else math.nan,
            loop,
            late,
            len(self._round),
            override_rate,
            override_gap,
        )


def least_period(loop: float, rate: float) -> float:
    """Return the shortest oscillation period [s] that can be flown and still be identified; 0 if nothing is known.

    loop : delay of the loop [s], NaN when not measured. rate : rate of the attitudes used for control [Hz].
    """
    interval = 1.0 / rate if rate > 0.0 else 0.0
    lag = loop + 0.5 * interval if math.isfinite(loop) else 0.0
    return max(_LAG_SHARE * lag, _SAMPLES * interval)


def _quantile(values: deque[float] | list[float], share: float) -> float:
    return float(np.quantile(list(values), share)) if values else math.nan
