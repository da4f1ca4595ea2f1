"""Parameters of the vehicle: read them by name, write and verify them, and detect changes by other stations.

ArduPilot packs every value as a float (C cast), ignores unknown names, echoes the stored value and saves at once. So
every request is repeated until answered, the echo is compared, the value is read back, and a difference counts as a
rejection. Values used in computations are checked (``firmware.values``); values only compared or restored are read
``as_is``.

A value to be restored later is read until confirmed. A stale duplicate, or a forged value with the vehicle's id,
arrives in addition to the right answers. So a value is accepted once it was received twice, and more often than any
other, since the request.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence

from gcs_autotune.errors import BadFile, NoReply, ParameterMissing, ParameterNotAccepted, TelemetryFault
from gcs_autotune.firmware import checked, checked_all
from gcs_autotune.link.file_transfer import read_remote_file
from gcs_autotune.link.parameters.exchange import (
    IN_FLIGHT,
    REPLY,
    Intrusion,
    ParamExchange,
    ParamWatch,
    as_float32,
    encoded,
    read_list,
    same_float32,
)
from gcs_autotune.link.session import Session
from gcs_autotune.mavlink import Message, PackedParameters, unpack_parameters
from gcs_autotune.rounding import counted
from gcs_autotune.untrusted_text import quoted

__all__ = ["Intrusion", "Parameters", "read_confirmed", "same_float32"]

PACKED = "@PARAM/param.pck?withdefaults=1"
"""Path of ArduPilot's packed parameter file on its MAVLink FTP server."""
_ROUNDS = 8
"""Requests after which contradicting answers are reported. Project choice."""
_ENOUGH = 2
MOST_NAMED = 8
"""Largest number of missing parameters in one message, about two lines of a terminal. Project choice."""


def read_confirmed(parameters: Parameters, names: Iterable[str]) -> dict[str, float]:
    """Return the values of *names*, each confirmed by a second answer and not outvoted by other answers.

    Raises
    ------
    ParameterMissing, NoReply
        As ``Parameters.read_all``.
    TelemetryFault
        The answers still contradict each other.
    """
    wanted = list(dict.fromkeys(names))
    votes: dict[str, Counter[float]] = {name: Counter() for name in wanted}

    def count(message: Message) -> None:
        name, value = str(message.param_id), float(message.param_value)
        if name in votes:
            votes[name][math.nan if math.isnan(value) else value] += 1  # one object, so that it is one key

    stop = parameters.session.listen("PARAM_VALUE", count)
    try:
        for k in range(_ROUNDS):
            pending = [name for name in wanted if _winner(votes[name]) is None]
            if not pending:
                break
            if k == 0 and len(pending) <= IN_FLIGHT // 2:  # both answers in one round trip: a write waits for them
                parameters.request_also(pending)
            parameters.read_all(pending, as_is=True)
    finally:
        stop()
    return {name: _decided(name, votes[name]) for name in wanted}


def _decided(name: str, votes: Mapping[float, int]) -> float:
    value = _winner(votes)
    if value is None:
        heard = ", ".join(f"{v:g}" for v in sorted(votes))
        raise TelemetryFault(
            f"contradicting values of {name} ({heard}): another sender uses the vehicle's system id, or the link "
            "repeats old messages. Nothing is written. Disconnect the other sender, or use a signed link"
        )
    return value


def _winner(votes: Mapping[float, int]) -> float | None:
    """Return the value received at least twice and more often than any other, or None."""
    ranked = sorted(votes.items(), key=lambda item: -item[1])
    if not ranked or ranked[0][1] < _ENOUGH or (len(ranked) > 1 and ranked[1][1] == ranked[0][1]):
        return None
    return ranked[0][0]


_TRIES = 3


class Parameters:
    """The parameters of a session's vehicle.

    Attributes
    ----------
    session : the session through which parameters are read and written.
    known : last value received of every name; ``types`` : their MAV_PARAM_TYPE.
    intrusions : monitored parameters that another station changed.
    """

    def __init__(self, session: Session) -> None:
        self.session = session
        self._exchange = ParamExchange(session)
        self._watch = ParamWatch(session, self._exchange)
        self.known: dict[str, float] = self._exchange.known
        self.types: dict[str, int] = self._exchange.types
        self.intrusions: list[Intrusion] = self._watch.intrusions

    # --- reading ------------------------------------------------------------------------------------------

    def read(self, name: str) -> float:
        """Return the value of one parameter.

        Raises
        ------
        ParameterMissing
            The vehicle has no parameter of that name.
        """
        return self.read_all([name])[name]

    def read_all(self, names: Iterable[str], *, as_is: bool = False) -> dict[str, float]:
        """Return the values of several parameters, requested in parallel.

        Raises
        ------
        ParameterMissing
            One or more of them do not exist; the message lists up to :data:`MOST_NAMED` of these.
        NoReply
            The vehicle no longer answers such requests, even for a parameter that it has.
        PreconditionFailed
            One has an invalid value, and *as_is* is not set.
        """
        wanted = list(dict.fromkeys(names))
        values = self.read_existing(wanted, as_is=as_is)
        missing = [name for name in wanted if name not in values]
        if missing:
            if lossy := self.session.lossy():
                raise NoReply(f"{self.session.vehicle} did not answer the request for {', '.join(missing)}: {lossy}")
            self._check_answers(missing)
            others = len(missing) - MOST_NAMED
            more = f" and {counted(others, 'other')}" if others > 0 else ""
            raise ParameterMissing(
                f"{self.session.vehicle} has no parameter {', '.join(missing[:MOST_NAMED])}{more}. Check that this is "
                "the right vehicle. Its firmware may be too old, too new, or built without this feature",
                name=missing[0],
            )
        return values

    def request_also(self, names: Iterable[str]) -> None:
        """Request several parameters in addition to a pending read, without waiting."""
        for name in names:
            self._exchange.request(name)

    def read_existing(self, names: Iterable[str], *, as_is: bool = False) -> dict[str, float]:
        """Return the values of those parameters in *names* that the vehicle has.

        There are three attempts of a second each. There are six if some answers come only after a second attempt,
        because the link then loses messages.

        Raises
        ------
        PreconditionFailed
            One has an invalid value, and *as_is* is not set.
        """
        wanted, heard = list(dict.fromkeys(names)), self._exchange
        for name in wanted:
            encoded(name)
        heard.forget(wanted)
        tries = _TRIES
        for k in range(2 * _TRIES):
            pending = [name for name in wanted if not heard.settled(name)]
            if not pending or k == tries:
                break
            heard.ask(pending)
            if k > 0 and any(name in heard.fresh for name in pending):
                tries = 2 * _TRIES
        values = {name: heard.fresh[name] for name in wanted if name in heard.fresh}
        return values if as_is else checked_all(values)

    def read_confirmed(self, names: Iterable[str]) -> dict[str, float]:
        """Return the values of *names*, each confirmed by a second answer (:mod:`gcs_autotune.link.surely`).

        Raises
        ------
        ParameterMissing, NoReply
            As :meth:`read_all`.
        TelemetryFault
            The answers still contradict each other.
        """
        return read_confirmed(self, names)

    def _check_answers(self, missing: Collection[str]) -> None:
        """Determine whether parameters are missing or the vehicle no longer answers, and raise the matching error."""
        if not self.known and self.session.contested:
            raise NoReply(
                f"{self.session.contested}. The sender in use answers no parameter requests "
                f"({', '.join(missing)}), so it may not be the vehicle. End the other program, or use a signed link"
            )
        known = next((name for name in self.known if name not in missing), None)
        if known is not None and not self.read_existing([known], as_is=True):
            raise NoReply(
                f"{self.session.vehicle} sends messages, but no longer answers parameter requests "
                f"({', '.join(missing)}). Check whether the vehicle restarted, and the speed of the link"
            )

    def read_first(self, names: Iterable[str]) -> tuple[str, float]:
        """Return the name and value of the first of several alternative names that exists.

        Raises
        ------
        ParameterMissing
            None of them exists.
        PreconditionFailed
            It has an invalid value.
        """
        wanted, heard = list(names), self._exchange
        heard.forget(wanted)
        for _ in range(_TRIES):
            for name in wanted:
                heard.request(name)
            self.session.wait_for(lambda: heard.first(wanted), REPLY)
            first = heard.first(wanted)
            if first:
                return first, checked(first, heard.fresh[first])
        raise ParameterMissing(f"{self.session.vehicle} has none of {', '.join(wanted)}", name=wanted[0])

    def read_any(self, groups: Iterable[Sequence[str]]) -> dict[str, float]:
        """Return, for each group of alternative names, the existing one (the first, if several) with its value.

        Once a name of a group is answered, the group is not requested again, so missing names cause no delay. Groups
        without an existing name are absent from the result. ``PreconditionFailed``: a value that no vehicle can have.
        """
        wanted, heard = [list(dict.fromkeys(group)) for group in groups], self._exchange
        heard.forget(name for group in wanted for name in group)
        for _ in range(_TRIES):
            heard.ask_any([group for group in wanted if not heard.any_settled(group)])
        existing = (heard.first(group) for group in wanted)
        return checked_all({name: heard.fresh[name] for name in existing if name is not None})

    def read_full(self, timeout: float = 120.0) -> dict[str, float]:
        """Return name -> value of all parameters, from the parameter list. Missing entries are requested by index.

        Raises
        ------
        NoReply
            The list did not arrive, or stayed incomplete.
        """
        return read_list(self.session, self._exchange, timeout)

    def read_whole(self) -> PackedParameters:
        """Return all parameters and their defaults, read by MAVLink FTP. If that fails, return those of
        :meth:`read_full`.

        Raises
        ------
        NoReply
            Neither method returned a complete list.
        """
        try:
            return unpack_parameters(read_remote_file(self.session, PACKED))
        except (NoReply, BadFile) as error:
            self.session.notes.append(f"reading parameters one by one: {error}")
        values = self.read_full()
        return PackedParameters(values, {n: t for n, t in self.types.items() if n in values}, {})

    # --- writing ------------------------------------------------------------------------------------------

    def write(self, name: str, value: float) -> None:
        """Set one parameter, read it back and verify it.

        Raises
        ------
        ParameterNotAccepted
            The vehicle has another value afterwards.
        ParameterMissing
            The vehicle has no parameter of that name.
        UsageError
            The value is not a finite number a 32-bit float can hold.
        """
        wanted = as_float32(name, value)
        with self._watch.writing(name):
            for _ in range(_TRIES):
                is_echoed = self._set(name, wanted)
                stored = self.read_confirmed([name])[name]
                if same_float32(stored, wanted):
                    break
                if not is_echoed:
                    raise self._not_accepted(name, wanted, stored)
            else:
                raise self._not_accepted(name, wanted, stored)
        self._watch.wrote(name, stored)

    def _not_accepted(self, name: str, wanted: float, found: float) -> ParameterNotAccepted:
        return ParameterNotAccepted(
            f"{name}: wrote {wanted:g}, but the vehicle reports {found:g}{self._why(name)}. "
            "The parameter may be read-only, limited to whole numbers, or set by another ground station",
            name=name,
            wanted=wanted,
            found=found,
        )

    def _set(self, name: str, value: float) -> bool:
        """Send PARAM_SET until the echo equals *value*; return whether it did."""
        heard = self._exchange
        for _ in range(_TRIES):
            heard.set(name, value)
            self.session.wait_for(
                lambda: True if name in heard.refused or self._is_echoed(name, value) else None, REPLY
            )
            if self._is_echoed(name, value):
                return True
            if name in heard.refused:
                return False
        return False

    def _is_echoed(self, name: str, value: float) -> bool:
        fresh = self._exchange.fresh
        return name in fresh and same_float32(fresh[name], value)

    def _why(self, name: str) -> str:
        since = self.session.clock.now() - 2.0 * _TRIES * REPLY
        texts = [t for t in self.session.texts.recent(since, at_most=20) if name in t]
        return f" (its message: {quoted(texts[-1:])})" if texts else ""

    # --- watching -----------------------------------------------------------------------------------------

    def watch(self, values: Mapping[str, float]) -> None:
        """Monitor the parameters *values* (name -> value). A change by another station is recorded in
        :attr:`intrusions`.
        """
        self._watch.add(values)

    def unwatch(self, names: Collection[str]) -> None:
        """Stop monitoring the parameters *names*."""
        self._watch.drop(names)
