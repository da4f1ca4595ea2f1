"""Nothing was answered: has the vehicle no such thing, or had the answer no room on the link?

An autopilot sends what it streams by default before anybody asks for less. A line of 4800 baud is full with it: the
answers wait behind seconds of telemetry or are dropped, and a vehicle looks as if it lacked what it has. The round trip
of TIMESYNC tells the two apart, and what came meanwhile is all that the link carries.
"""

from __future__ import annotations

from collections.abc import Mapping

from gcs_autotune.clock import Deadline
from gcs_autotune.errors import AutotuneError, TelemetryFault
from gcs_autotune.link.bandwidth import FASTER, USUAL_SIZE, Demand, least, shortfall
from gcs_autotune.link.latency import Latency
from gcs_autotune.link.session import Session

__all__ = ["see_that_answers_come"]

_LATE = 1.0
"""Chosen [s]: no radio or mobile network of use takes so long there and back without a queue."""
_ASKING = 0.5
_SECONDS = 4.0
"""Chosen: what is heard in so long is what the link carries, to a few per cent."""
_PATIENCE = 20.0
"""Chosen [s]: what an autopilot's buffer of 2 kB takes at 1200 baud."""


def see_that_answers_come(
    session: Session, wanted: Mapping[str, float], first: Mapping[str, float], error: AutotuneError
) -> None:
    """Return when the link has room for answers, or when that cannot be told.

    Parameters
    ----------
    wanted : message -> rate [Hz] that an experiment asks for. first : message -> least rate [Hz], above the usual.
    error : what not being answered was taken for.

    Raises
    ------
    TelemetryFault
        What is asked comes back a second later or more, because the link is full; with what it carries and what an
        experiment needs.
    """
    latency, begun, before = Latency(session), session.clock.now(), session.traffic.total()
    deadline = Deadline.after(session.clock, _SECONDS)
    while not deadline.expired:
        latency.ask()
        session.pause(min(_ASKING, deadline.remaining))
        if latency.quickest <= _LATE:
            return
    carried = (session.traffic.total() - before) / (session.clock.now() - begun)
    session.wait_for(lambda: latency.answered or None, _PATIENCE)
    if not latency.quickest > _LATE:
        return
    demands = [Demand(name, rate, USUAL_SIZE, first.get(name, 0.0)) for name, rate in wanted.items()]
    if carried < least(demands):
        said = f"the link is too slow: {shortfall(carried, demands, 'about ')}"
    else:
        said = f"the link is full: it carries {carried:.0f} bytes/s"
    raise TelemetryFault(
        f"{said}. An answer takes {latency.quickest:.1f} s behind what the vehicle streams anyway. {FASTER}; nothing "
        "was armed"
    ) from error
