"""Is there room on the link for all that will be said? Asked before anything is armed.

A radio, a serial port or a router that is given more than it passes holds the rest back, seconds of it, before anything
is lost: commands come late, then not at all. The round trip of TIMESYNC tells: it grows while the queue does. So the
busiest minute is rehearsed: neutral overrides, as many bytes a second as targets and overrides together will take,
while telemetry comes down at the rates that will be flown with.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gcs_autotune.clock import Deadline
from gcs_autotune.errors import TelemetryFault
from gcs_autotune.link.driver import Driver
from gcs_autotune.link.latency import Latency
from gcs_autotune.link.queueing import DRAIN, QUEUE, await_empty
from gcs_autotune.link.session import Session

__all__ = ["Rehearsal", "see_headroom"]

_SECONDS = 2.0
"""Chosen: with a tenth less room than bytes the queue grows by more than ``QUEUE`` in so long."""
_ASKING = 0.2
_LATE_HALF = 0.5


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """``sent`` bytes per second went up; ``grown`` [s] is how much longer the round trip was towards the end, and
    ``carried`` [bytes/s] what the link passed meanwhile, by how quickly that grew.
    """

    sent: float
    grown: float
    carried: float

    @property
    def is_enough(self) -> bool:
        """Whether no queue was left standing."""
        return not self.grown > QUEUE


def see_headroom(session: Session, driver: Driver, latency: Latency) -> None:
    """Rehearse with neutral overrides; where they do not fit send fewer from now on.

    Raises
    ------
    TelemetryFault
        Not even those fit; with what was sent, what was carried, what is needed and what to do.
    """
    first = _rehearse(session, driver, latency)
    if first.is_enough:
        return
    driver.spare_the_link()
    await_empty(session, latency)
    second = _rehearse(session, driver, latency)
    if not second.is_enough:
        raise TelemetryFault(
            f"the link is too slow upwards: of {second.sent:.0f} bytes/s that an experiment needs it carries "
            f"{second.carried:.0f}, the rest waits longer and longer ({second.grown:.1f} s after {_SECONDS:g} s). "
            "Use a faster link (a higher baud rate, a better radio), or close what else uses this one; nothing was "
            "armed"
        )
    session.notes.append(
        f"the link carries {first.carried:.0f} of {first.sent:.0f} bytes/s upwards: overrides are sent 10 times a "
        "second instead of 25"
    )


def _rehearse(session: Session, driver: Driver, latency: Latency) -> Rehearsal:
    begun, sent_before = session.clock.now(), session.sent
    driver.crowd()
    try:
        deadline = Deadline.after(session.clock, _SECONDS)
        while not deadline.expired:
            latency.ask()
            session.pause(min(_ASKING, deadline.remaining))
    finally:
        driver.thin_out()
    ended = session.clock.now()
    sent = (session.sent - sent_before) / max(ended - begun, 1e-3)
    late = begun + (1.0 - _LATE_HALF) * (ended - begun)
    if not math.isfinite(latency.quickest):
        return Rehearsal(sent, 0.0, sent)  # it answers no TIMESYNC: nothing can be told
    session.wait_for(lambda: latency.trips(late) or None, DRAIN)
    return _judged(latency, begun, late, ended, sent)


def _judged(latency: Latency, begun: float, late: float, ended: float, sent: float) -> Rehearsal:
    trips, last = latency.trips(begun), [trip for _, trip in latency.trips(late)]
    grown = min(last) - latency.quickest if last else DRAIN
    asked, took = np.array(trips).reshape(-1, 2).T
    slope = float(np.polyfit(asked, took, 1)[0]) if len(trips) > 2 else grown / (ended - begun)
    return Rehearsal(sent, grown, sent / (1.0 + max(slope, 0.0)))
