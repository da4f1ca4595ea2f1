"""Does anything wait on the way? The round trip of TIMESYNC tells: it grows while a queue does."""

from __future__ import annotations

from gcs_autotune.clock import Deadline
from gcs_autotune.link.latency import Latency
from gcs_autotune.link.session import Session

__all__ = ["DRAIN", "QUEUE", "await_empty", "is_queueing"]

QUEUE = 0.25
"""Chosen [s]: a round trip that is longer by this than the quickest known waits in a queue; jitter is mostly less."""
DRAIN = 10.0
"""Chosen [s]: what still waits after so long is not worth waiting for."""


def is_queueing(latency: Latency, since: float) -> bool:
    """Whether all that was asked at or after *since* [s of link time] came back later than it does without a queue."""
    trips = [trip for _, trip in latency.trips(since)]
    return bool(trips) and min(trips) - latency.quickest > QUEUE


def await_empty(session: Session, latency: Latency) -> bool:
    """Wait until what was held back has come through, at most ``DRAIN``; return whether it has.

    A vehicle that answers no TIMESYNC is taken to have no queue.
    """
    deadline = Deadline.after(session.clock, DRAIN)
    while latency.answered and not deadline.expired:
        asked = session.clock.now()
        latency.ask()
        session.wait_for(lambda since=asked: latency.trips(since) or None, deadline.remaining)  # type: ignore[misc]
        if latency.trips(asked) and not is_queueing(latency, asked):
            return True
    return not latency.answered
