"""Detect queues on the link by the round trip of TIMESYNC, which grows with a queue.

*Down*: an unanswered request means that the vehicle lacks the item, or that the link was too full for the answer. An
autopilot streams its default messages until a station requests fewer. That fills a line of 4800 baud. Answers then wait
behind seconds of telemetry or are dropped, and existing items seem to be missing.

*Up*: before arming, the capacity for all commands is checked. An overloaded radio, serial port or router delays data by
seconds before it loses any. So commands first arrive late, then not at all. The check sends the largest load: neutral
overrides at the byte rate of targets and overrides together, while telemetry arrives at its final rates.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gcs_autotune.clock import Deadline
from gcs_autotune.errors import AutotuneError, TelemetryFault
from gcs_autotune.link.session import Session
from gcs_autotune.link.vehicle.bandwidth import FASTER, USUAL_SIZE, Demand, least, shortfall
from gcs_autotune.link.vehicle.latency import Latency
from gcs_autotune.link.vehicle.setpoint_streamer import SetpointStreamer

__all__ = ["DRAIN", "QUEUE", "UplinkLoad", "await_empty", "check_answers_come", "check_uplink", "is_queueing"]

QUEUE = 0.25
"""Excess over the shortest round trip [s] that indicates a queue; jitter is usually smaller. Project choice."""
DRAIN = 10.0
"""Longest time to wait [s] for a queue to empty. Project choice."""


def is_queueing(latency: Latency, since: float) -> bool:
    """Return whether the answers to all TIMESYNC requests since *since* [s of link time] show a queue on the link."""
    trips = [trip for _, trip in latency.trips(since)]
    return bool(trips) and min(trips) - latency.quickest > QUEUE


def await_empty(session: Session, latency: Latency) -> bool:
    """Wait until the queue is empty, at most ``DRAIN``; return whether it is.

    A vehicle that does not answer TIMESYNC counts as having no queue.
    """
    deadline = Deadline.after(session.clock, DRAIN)
    while latency.answered and not deadline.expired:
        sent = session.clock.now()
        latency.ask()
        session.wait_for(lambda since=sent: latency.trips(since) or None, deadline.remaining)  # type: ignore[misc]
        if latency.trips(sent) and not is_queueing(latency, sent):
            return True
    return not latency.answered


_LATE = 1.0
"""Longest round trip [s] of a usable radio or mobile network without a queue. Project choice."""
_ASKING = 0.5
_SECONDS = 4.0
"""Time [s] in which the received bytes show the link's capacity to a few per cent. Project choice."""
_PATIENCE = 20.0
"""Time [s] in which an autopilot's buffer of 2 kB empties at 1200 baud. Project choice."""


def check_answers_come(
    session: Session, wanted: Mapping[str, float], first: Mapping[str, float], error: AutotuneError
) -> None:
    """Check that the link has capacity for answers. Raise only if it is certain that it has not.

    Parameters
    ----------
    wanted : message -> rate [Hz] that an experiment requests. first : message -> least rate [Hz], above the usual.
    error : the error that the missing answer was first taken for.

    Raises
    ------
    TelemetryFault
        Answers arrive a second late or more, because the link is full. The message states its capacity and what an
            experiment needs.
    """
    latency, begun, before = Latency(session), session.clock.now(), session.routing.traffic.total()
    deadline = Deadline.after(session.clock, _SECONDS)
    while not deadline.expired:
        latency.ask()
        session.pause(min(_ASKING, deadline.remaining))
        if latency.quickest <= _LATE:
            return
    carried = (session.routing.traffic.total() - before) / (session.clock.now() - begun)
    session.wait_for(lambda: latency.answered or None, _PATIENCE)
    lossy = "" if math.isfinite(latency.quickest) else session.lossy()
    if lossy or not latency.quickest > _LATE:
        return  # what is lost for good waits in no queue
    demands = [Demand(name, rate, USUAL_SIZE, first.get(name, 0.0)) for name, rate in wanted.items()]
    if carried < least(demands):
        problem = f"the link is too slow: {shortfall(carried, demands, 'about ')}"
    else:
        problem = f"the link is full: it carries {carried:.0f} bytes/s"
    raise TelemetryFault(
        f"{problem}. Queued behind the vehicle's message streams, an answer takes {latency.quickest:.1f} s. {FASTER}. "
        "Nothing was armed"
    ) from error


_UPLINK_SECONDS = 2.0
"""Duration of the rehearsal [s].

If a tenth of the capacity is missing, the queue grows by more than ``QUEUE`` [s]. Project choice.
"""
_UPLINK_ASKING = 0.2
_UPLINK_FIRST = 0.3
"""Time [s] of the first two round trips, before the queue has grown. Project choice."""
_LATE_HALF = 0.5


@dataclass(frozen=True, slots=True)
class UplinkLoad:
    """Result of the capacity test of the link towards the vehicle.

    ``sent``: bytes per second that were sent.
    ``grown`` [s]: increase of the round trip towards the end, compared with no queue.
    ``carried`` [bytes/s]: what the link carried, computed from the growth rate.
    """

    sent: float
    grown: float
    carried: float

    @property
    def is_enough(self) -> bool:
        """Whether the link carried the whole load: no queue remained at the end of the test."""
        return not self.grown > QUEUE


def check_uplink(session: Session, streamer: SetpointStreamer, latency: Latency) -> None:
    """Test the capacity towards the vehicle with neutral overrides. If it is too small, send fewer overrides from now
    on.

    Raises
    ------
    TelemetryFault
        Not even the reduced rate fits. The message states the bytes per second sent, carried and needed, and what to
        do.
    """
    first = _load_uplink(session, streamer, latency)
    if first.is_enough:
        return
    streamer.spare_the_link()
    await_empty(session, latency)
    second = _load_uplink(session, streamer, latency)
    if not second.is_enough:
        raise TelemetryFault(
            f"the uplink is too slow: it carries {second.carried:.0f} bytes/s, but an experiment needs "
            f"{second.sent:.0f}. Its delay grows to {second.grown:.1f} s after "
            f"{_UPLINK_SECONDS:g} s. Use a faster link (a higher baud rate, a better radio), or close other programs "
            "on this one. Nothing was armed"
        )
    session.notes.append(
        f"the uplink carries {first.carried:.0f} of {first.sent:.0f} bytes/s: overrides are sent 10 times a "
        "second instead of 25"
    )


def _load_uplink(session: Session, streamer: SetpointStreamer, latency: Latency) -> UplinkLoad:
    begun, sent_before = session.clock.now(), session.port.sent
    streamer.crowd()
    try:
        deadline = Deadline.after(session.clock, _UPLINK_SECONDS)
        while not deadline.expired:
            latency.ask()
            session.pause(min(_UPLINK_ASKING, deadline.remaining))
    finally:
        streamer.thin_out()
    ended = session.clock.now()
    sent = (session.port.sent - sent_before) / max(ended - begun, 1e-3)
    late = begun + (1.0 - _LATE_HALF) * (ended - begun)
    if not math.isfinite(latency.quickest):
        return UplinkLoad(sent, 0.0, sent)  # it answers no TIMESYNC: the load is not measurable
    session.wait_for(lambda: latency.trips(late) or None, DRAIN)
    load = _judged(latency, latency.quickest, begun, late, ended, sent)
    if load.is_enough or await_empty(session, latency):
        return load
    # Late without any load, too: a mobile network takes another way than when the quickest answer came. What counts is
    # whether it became later still. A queue with an end, which no longer grows once it is full, was emptied above.
    first = [trip for sent_at, trip in latency.trips(begun) if sent_at < begun + _UPLINK_FIRST]
    return _judged(latency, min(first, default=latency.quickest), begun, late, ended, sent)


def _judged(latency: Latency, quick: float, begun: float, late: float, ended: float, sent: float) -> UplinkLoad:
    trips = [(sent_at, trip) for sent_at, trip in latency.trips(begun) if sent_at <= ended]
    last = [trip for sent_at, trip in trips if sent_at >= late]
    grown = min(last) - quick if last else DRAIN
    sent_at, took = np.array(trips).reshape(-1, 2).T
    slope = float(np.polyfit(sent_at, took, 1)[0]) if len(trips) > 2 else grown / (ended - begun)
    return UplinkLoad(sent, grown, sent / (1.0 + max(slope, 0.0)))
