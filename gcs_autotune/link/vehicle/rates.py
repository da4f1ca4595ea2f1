"""Request message rates and measure the actual ones.

ArduPilot rejects a rate that its loop cannot send and keeps the old one. Radios carry a few kilobytes a second and lose
the rest. So a requested rate is halved until it is granted. The result is measured on the vehicle's own clock and
fitted to the measured capacity of the link (:mod:`gcs_autotune.link.vehicle.bandwidth`). All rates are restored at the
end.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

from gcs_autotune.errors import AutotuneError, CommandDenied, LinkLost, NoReply, TelemetryFault
from gcs_autotune.link.session import Session
from gcs_autotune.link.vehicle.bandwidth import CHATTER, FASTER, USUAL_SIZE, Demand, least, plan, shortfall
from gcs_autotune.link.vehicle.commands import Commands
from gcs_autotune.link.vehicle.congestion import await_empty, is_queueing
from gcs_autotune.link.vehicle.latency import Latency
from gcs_autotune.mavlink import Message, mavlink, message_number

__all__ = ["Granted", "Rates"]

_SLOWEST = 1.0
"""Rate [Hz] at which the halving of a request stops."""
_SHORT = 0.8
"""Fraction of the granted rate below which a message counts as lost or delayed. Project choice."""
_ROUNDS = 3
"""Most rounds of fitting. Project choice."""
_OFF = -1
_ROUNDING = 1e-3
_REQUESTS = 2
"""Number of requests by name after which a message counts as not available. Project choice."""


@dataclass(frozen=True, slots=True)
class Granted:
    """Result of one rate request: rates [Hz] requested and granted (0: rejected), and the previous interval [us] (0:
    default).
    """

    requested: float
    granted: float
    previous: int


_COUNTED_AGAIN = 5
"""Number of consecutive silences after which the link is used as it is. Project choice."""


class Rates:
    """Message rates of the session's vehicle.

    Parameters
    ----------
    first : message -> rate [Hz] with priority: on a full link it is granted before others get more than their minimum.

    Attributes
    ----------
    granted : message name -> result of the request.
    measured : message name -> Hz, from the last :meth:`measure`.
    capacity : capacity measured when the link was full, in bytes per second [of the vehicle's time]; NaN if it never
        was.
    """

    def __init__(self, session: Session, commands: Commands, first: Mapping[str, float] | None = None) -> None:
        self._session = session
        self._first = first or {}
        self._commands = commands
        self.granted: dict[str, Granted] = {}
        self.measured: dict[str, float] = {}
        self.capacity = math.nan
        self._sizes: dict[str, float] = {}
        self._carried = 0.0
        self._chatter: dict[str, float] = {}

    def request(self, wanted: Mapping[str, float]) -> dict[str, float]:
        """Request messages at *rates* [Hz]. Return message -> rate granted [Hz], 0 for a rejection.

        Raises
        ------
        TelemetryFault
            Answers no longer arrive, because the rates granted so far have filled the link.
        """
        begun, before_all = self._session.clock.now(), self._session.routing.traffic.total()
        for name, rate in wanted.items():
            before = self.granted.get(name)
            previous = before.previous if before else self._previous_interval(name)
            self.granted[name] = Granted(rate, 0.0, previous)
            try:
                self.granted[name] = Granted(rate, self._grant(name, rate), previous)
            except NoReply as error:
                carried = self._session.routing.traffic.total() - before_all
                seconds = max(self._session.clock.now() - begun, 1e-3)
                least_of_all = [Demand(n, hz, USUAL_SIZE, self._first.get(n, 0.0)) for n, hz in wanted.items()]
                offered = carried / seconds / max(1.0 - self._session.loss.share, 1e-3)
                if carried / seconds >= least(least_of_all) or offered < least(least_of_all):
                    self._name_loss(error)  # the line was not full
                raise TelemetryFault(
                    f"the link is too slow: {shortfall(carried / seconds, least_of_all, 'about ')}. Therefore {error}. "
                    f"{FASTER}"
                ) from error
            if self.granted[name].granted < rate:
                self._session.notes.append(
                    f"{name}: requested {rate:g} Hz, but the vehicle grants {self.granted[name].granted:g} Hz"
                )
        return {name: self.granted[name].granted for name in wanted}

    def fit(
        self, needed: Mapping[str, float], loop_period: float = 0.0, latency: Latency | None = None
    ) -> dict[str, float]:
        """Measure the rates, and request less in order of need until the link carries all requests.

        Parameters
        ----------
        needed : message -> lowest rate [Hz] that every run requires.
        loop_period : loop period of the autopilot [s]; it may round a message interval up to whole loops.
        latency : detects messages queued on the link.

        Returns message -> rate [Hz] measured at the end.

        Raises
        ------
        TelemetryFault
            The link does not carry the required rates, or stays full at reduced rates. The message contains the
                numbers.
        """
        floors = {**needed, **self._first}
        for _ in range(_ROUNDS):
            begun = self._session.clock.now()
            measured = self.measure({})
            if not (self._is_full(measured, loop_period) or self._is_holding_back(measured, floors, latency, begun)):
                break
            self.capacity = self._carried
            try:
                self._ask_for_less(floors)
            except NoReply as error:
                self._session.notes.append(f"the link is overloaded: {error}")
                measured = self._once_more(floors, latency)
                break
            if latency is not None:
                await_empty(self._session, latency)
        else:
            measured = self._once_more(floors, latency)
        self._demand(needed)
        return measured

    def quicken(self, wanted: Mapping[str, float], loop_period: float, latency: Latency) -> None:
        """Request higher rates [Hz]. Undo this if the link cannot carry all of them.

        loop_period, latency : as in :meth:`fit`.
        """
        if math.isfinite(self.capacity):
            return
        usual = {n: g for n, g in self.granted.items() if 0.0 < g.granted < wanted.get(n, 0.0)}
        begun = self._session.clock.now()
        for name, before in usual.items():
            with suppress(CommandDenied):
                self._set_interval(name, round(1e6 / wanted[name]))
                self.granted[name] = replace(before, requested=wanted[name], granted=wanted[name])
        if all(self.granted[name] is before for name, before in usual.items()):
            return
        if self._is_full(self.measure({}), loop_period) or is_queueing(latency, begun):
            for name, before in usual.items():
                self._set_interval(name, round(1e6 / before.granted))
                self.granted[name] = before
            await_empty(self._session, latency)
            self.measure({})

    def _once_more(self, floors: Mapping[str, float], latency: Latency | None) -> dict[str, float]:
        """Measure the final rates."""
        begun = self._session.clock.now()
        measured = self.measure({})
        if self._is_holding_back(measured, floors, latency, begun):
            if latency is None or not is_queueing(latency, begun):
                self._name_loss()
            raise TelemetryFault(
                f"the link is too slow: it carries {self.capacity:.0f} bytes/s and is still full with all "
                f"rates reduced to what an experiment needs. {FASTER}"
            )
        return measured

    def _is_holding_back(
        self, measured: Mapping[str, float], floors: Mapping[str, float], latency: Latency | None, begun: float
    ) -> bool:
        """Return whether messages are queued or crowded out.

        A message counts as crowded out if it arrives when it is requested singly or when others are reduced.
        """
        if latency is not None and is_queueing(latency, begun):
            return True
        missing = [n for n, g in self.granted.items() if g.granted > 0.0 and measured.get(n) == 0.0]
        return bool(missing) and (self._comes_on_request(missing) or self._comes_given_room(missing, floors))

    def _comes_on_request(self, missing: Collection[str]) -> bool:
        came: list[str] = []
        stops = [self._session.listen(n, lambda m: came.append(m.get_type())) for n in missing]
        try:
            for _ in range(_REQUESTS):
                for name in missing:
                    self._session.request_message(message_number(name))
                self._session.wait_for(lambda: came or None, 0.5)
        finally:
            for stop in stops:
                stop()
        return bool(came)

    def _comes_given_room(self, missing: Collection[str], floors: Mapping[str, float]) -> bool:
        """Reduce the largest messages to their minimum, and return whether a crowded-out message then arrives."""
        demands = {d.name: d for d in self._demands(floors) if d.name not in missing}
        spare = {name: (d.rate - d.floor) * d.size for name, d in demands.items()} | self._chatter
        crowding = max(spare, key=lambda name: spare[name], default="")
        if not spare.get(crowding, 0.0) > 0.0:
            return False
        try:
            if crowding in demands:
                slow, usual = round(1e6 / demands[crowding].floor), round(1e6 / demands[crowding].rate)
            else:
                slow, usual = _OFF, self._previous_interval(crowding)
                self.granted[crowding] = Granted(0.0, 0.0, usual)  # restored at the end whatever happens now
            self._set_interval(crowding, slow)
            came = self._comes_on_request(missing)
            self._set_interval(crowding, usual)
        except CommandDenied:
            return False
        except NoReply:
            return True  # not even an answer has room
        if crowding not in demands:
            del self.granted[crowding]
        return came

    def _is_full(self, measured: Mapping[str, float], loop_period: float) -> bool:
        """Return whether a message arrives at less than the granted rate."""
        return any(
            0.0 < measured[n] < _SHORT * _at_loops(g.granted, loop_period)
            for n, g in self.granted.items()
            if n in measured
        )

    def _ask_for_less(self, floors: Mapping[str, float]) -> None:
        demands = self._demands(floors)
        sizes = {d.name: d.size for d in demands}
        if self.capacity < least(demands):
            raise TelemetryFault(f"the link is too slow: {shortfall(self.capacity, demands)}. {FASTER}")
        rates, hushed = plan(demands, self._chatter, self.capacity)
        changes = []
        for name, rate in sorted(rates.items(), key=lambda item: -sizes[item[0]] * self.granted[item[0]].granted):
            before = self.granted[name]
            if rate < before.granted:
                changes.append(f"{name} {before.granted:g} -> {rate:.3g} Hz")
                self._set_interval(name, round(1e6 / rate))
                self.granted[name] = replace(before, granted=rate)
        for name in hushed:
            changes.append(f"{name} off")
            self.granted[name] = Granted(0.0, 0.0, self._previous_interval(name))
            self._set_interval(name, _OFF)
        if changes:
            self._session.notes.append(
                f"the link carries {self.capacity:.0f} bytes/s and is full: {', '.join(changes)}"
            )

    def _demands(self, floors: Mapping[str, float]) -> list[Demand]:
        return [
            Demand(n, g.granted, self._sizes.get(n, USUAL_SIZE), floors.get(n, 0.0))
            for n, g in self.granted.items()
            if g.granted > 0.0
        ]

    def _grant(self, name: str, rate: float) -> float:
        while rate >= _SLOWEST:
            try:
                self._set_interval(name, round(1e6 / rate))
                return rate
            except CommandDenied:
                rate /= 2.0
        return 0.0

    def _set_interval(self, name: str, interval: int) -> None:
        self._commands.command_long(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, float(message_number(name)), float(interval))

    def _previous_interval(self, name: str) -> int:
        """Return the present interval [us]; 0 (default) if the vehicle does not report it."""
        number = message_number(name)
        answers: list[Message] = []
        stop = self._session.listen("MESSAGE_INTERVAL", lambda m: answers.append(m) if m.message_id == number else None)
        try:
            self._commands.command_long(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, float(number), tries=2)
            self._session.wait_for(lambda: True if answers else None, 1.0)
        except (CommandDenied, NoReply):
            return 0
        finally:
            stop()
        return int(answers[0].interval_us) if answers else 0

    def measure(
        self, required: Mapping[str, float], duration: float = 2.0, *, tolerance: float = 0.6
    ) -> dict[str, float]:
        """Count messages for *duration* [s of the vehicle's time]. Return message -> rate [Hz] of all requested and
        required messages.

        Parameters
        ----------
        required : message -> required rate [Hz]; at least the fraction *tolerance* of it must arrive.

        Raises
        ------
        TelemetryFault
            A required message arrives too slowly; the message contains the numbers. Or no ATTITUDE arrives, which is
            needed to measure
                time.
        """
        rates = self._count(duration, required)
        self._demand(required, tolerance)
        return rates

    def _count(self, duration: float, required: Mapping[str, float]) -> dict[str, float]:
        """Count again if a tolerated silence occurred during the count."""
        for _ in range(_COUNTED_AGAIN):
            begun = self._session.liveness.listened
            rates = self._count_once(duration, required)
            lasted = self._session.liveness.listened - begun
            if not 0.0 < self._session.liveness.longest(lasted) <= self._session.patience:
                break
        return rates

    def _count_once(self, duration: float, required: Mapping[str, float]) -> dict[str, float]:
        counts: Counter[str] = Counter()
        stamps: list[float] = []
        traffic = self._session.routing.traffic.copy()
        watched = {*required, *self.granted}
        stops = [self._session.listen(name, partial(_count, counts, name)) for name in watched]
        stops.append(self._session.listen("ATTITUDE", lambda m: _append_later(stamps, m.time_boot_ms * 1e-3)))
        try:
            self._session.wait_for(lambda: _lasted(stamps, duration), 4.0 * duration)
        finally:
            for stop in stops:
                stop()
        n = len(stamps)
        span = (stamps[-1] - stamps[0]) * n / (n - 1) if n > 1 else 0.0  # n messages stand for n periods
        if span <= 0.0:
            raise TelemetryFault(
                "HEARTBEAT arrives, but no ATTITUDE. Check whether another ground station changes the stream rates"
            )
        self.measured = {name: counts[name] / span for name in watched}
        heard = self._session.routing.traffic - traffic
        self._carried = heard.total() / span
        self._sizes = {name: heard[name] / counts[name] for name in watched if counts[name]}
        self._chatter = {n: size / span for n, size in heard.items() if n not in watched and n in CHATTER}
        return self.measured

    def _demand(self, required: Mapping[str, float], tolerance: float = 0.6) -> None:
        rates = self.measured
        slow = [
            f"{n} {rates.get(n, 0.0):.1f} Hz of {hz:g}"
            for n, hz in required.items()
            if rates.get(n, 0.0) < tolerance * hz
        ]
        if slow:
            self._name_loss()
            room = f"; it carries {self.capacity:.0f} bytes/s" if math.isfinite(self.capacity) else ""
            raise TelemetryFault(f"telemetry is too slow: {', '.join(slow)}{room}. {FASTER}")

    def _name_loss(self, error: AutotuneError | None = None) -> None:
        """Raise ``TelemetryFault`` with the loss as its cause, if the link loses messages and is not just too slow."""
        if lossy := self._session.lossy():
            raise TelemetryFault(f"{lossy}. Nothing was armed") from error

    def restore(self) -> None:
        """Restore all message intervals changed on the vehicle. The operator cannot interrupt this. A failure is noted
        but not raised.
        """
        with self._session.operator.shielded():
            lost = [name for name, request in reversed(list(self.granted.items())) if not self._restore(name, request)]
        if lost:
            self._session.notes.append(f"no contact, so these message rates were not restored: {', '.join(lost)}")
        self.granted.clear()

    def _restore(self, name: str, request: Granted) -> bool:
        """Return whether the vehicle answered."""
        try:
            self._set_interval(name, request.previous)
        except LinkLost:
            return False
        except AutotuneError as error:
            refused = request.granted == 0.0 < request.requested and isinstance(error, CommandDenied)
            if not refused:  # a rate that was refused has never changed
                self._session.notes.append(f"the rate of {name} was not restored: {error}")
        return True


def _count(counts: Counter[str], name: str, _: Message) -> None:
    counts[name] += 1


def _at_loops(rate: float, loop_period: float) -> float:
    """Return the rate [Hz] that results if the message interval is rounded up to whole loops."""
    if rate <= 0.0 or loop_period <= 0.0:
        return rate
    return 1.0 / (math.ceil(1.0 / rate / loop_period - _ROUNDING) * loop_period)


def _append_later(stamps: list[float], t: float) -> None:
    """Keep a stamp unless it is older than the last one, because datagrams may arrive out of order or twice."""
    if not stamps or t > stamps[-1]:
        stamps.append(t)


def _lasted(stamps: list[float], duration: float) -> bool | None:
    return True if len(stamps) > 1 and stamps[-1] - stamps[0] >= duration else None
