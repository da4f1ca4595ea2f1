"""All the parameters a vehicle has: the whole list, then what was lost of it by index."""

from __future__ import annotations

from functools import partial

from gcs_autotune.clock import Deadline
from gcs_autotune.errors import NoReply
from gcs_autotune.link.param_exchange import IN_FLIGHT, ParamExchange
from gcs_autotune.link.session import Session

__all__ = ["read_list"]

_QUIET = 1.5
"""Chosen: seconds without anything new after which what is missing is asked for."""


def read_list(session: Session, exchange: ParamExchange, timeout: float) -> dict[str, float]:
    """Return every parameter, by name; errors as those of ``Parameters.read_full``."""
    exchange.fresh, exchange.indices, exchange.count = {}, {}, 0
    deadline = Deadline.after(session.clock, timeout)
    exchange.request_list()
    while not deadline.expired and not _is_whole(exchange):
        heard = len(exchange.indices)
        session.wait_for(partial(_progress, exchange, heard), _QUIET)
        if len(exchange.indices) == heard:
            _fill_gaps(exchange)
    if not _is_whole(exchange):
        raise NoReply(
            f"the parameter list of {session.vehicle} stayed incomplete "
            f"({len(exchange.indices)} of {exchange.count or 'unknown'}) after {timeout:g} s; try a faster link"
        )
    return {name: exchange.fresh[name] for name in sorted(exchange.fresh)}


def _is_whole(exchange: ParamExchange) -> bool:
    return exchange.count > 0 and len(exchange.indices) >= exchange.count


def _progress(exchange: ParamExchange, seen: int) -> bool | None:
    return True if len(exchange.indices) != seen else None


def _fill_gaps(exchange: ParamExchange) -> None:
    if not exchange.count:
        exchange.request_list()
        return
    gaps = [i for i in range(exchange.count) if i not in exchange.indices]
    for index in gaps[:IN_FLIGHT]:
        exchange.request_index(index)
