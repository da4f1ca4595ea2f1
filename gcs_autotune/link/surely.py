"""Reading a parameter so that one wrong answer cannot mislead: what is put back later must have been there.

A stale duplicate, or a value forged under the vehicle's id, comes beside the right answers, not instead of them.
So a value counts when it was heard twice, and more often than any other, since we began to ask.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from gcs_autotune.errors import TelemetryFault
from gcs_autotune.link.wire import Message

if TYPE_CHECKING:
    from gcs_autotune.link.parameters import Parameters

__all__ = ["read_surely"]

_ROUNDS = 8
"""Chosen: askings before contradicting answers are given up on."""
_ENOUGH = 2


def read_surely(parameters: Parameters, names: Iterable[str]) -> dict[str, float]:
    """Return the values of *names*, each confirmed by a second answer and not outvoted by other answers.

    Raises
    ------
    ParameterMissing, NoReply
        As ``Parameters.read_all``.
    TelemetryFault
        The answers go on contradicting each other.
    """
    wanted = list(dict.fromkeys(names))
    votes: dict[str, Counter[float]] = {name: Counter() for name in wanted}

    def count(message: Message) -> None:
        name, value = str(message.param_id), float(message.param_value)
        if name in votes:
            votes[name][math.nan if math.isnan(value) else value] += 1  # one object, so that it is one key

    stop = parameters.session.listen("PARAM_VALUE", count)
    try:
        for _ in range(_ROUNDS):
            pending = [name for name in wanted if _winner(votes[name]) is None]
            if not pending:
                break
            parameters.read_all(pending, as_is=True)
    finally:
        stop()
    return {name: _decided(name, votes[name]) for name in wanted}


def _decided(name: str, votes: Mapping[float, int]) -> float:
    value = _winner(votes)
    if value is None:
        heard = ", ".join(f"{v:g}" for v in sorted(votes))
        raise TelemetryFault(
            f"{name} is answered with contradicting values ({heard}): somebody else answers under the vehicle's system "
            "id, or the link repeats old messages. Nothing is written; disconnect the other one, or use a signed link"
        )
    return value


def _winner(votes: Mapping[float, int]) -> float | None:
    """Return the value heard at least twice and more often than any other; None while there is none."""
    ranked = sorted(votes.items(), key=lambda item: -item[1])
    if not ranked or ranked[0][1] < _ENOUGH or (len(ranked) > 1 and ranked[1][1] == ranked[0][1]):
        return None
    return ranked[0][0]
