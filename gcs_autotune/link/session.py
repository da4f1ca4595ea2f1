"""One connection to one vehicle: heartbeat, discovery, routing, liveness, operator stop and log.

Everything happens inside :meth:`Session.pump`, on the caller's thread. It reads what has arrived, passes each message
to its listeners and sends what is due. To wait, it is called repeatedly until a deadline on the link's clock. Nothing
sleeps and there are no other threads.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Self, TypeVar

from gcs_autotune.clock import Clock, Deadline
from gcs_autotune.errors import LinkLost, OperatorStopped, TelemetryFault
from gcs_autotune.link.discovery import (
    Sightings,
    VehicleCandidate,
    cannot_be_commanded,
    choose,
    no_vehicle_error,
    not_believed,
)
from gcs_autotune.link.frame_port import FramePort
from gcs_autotune.link.liveness import GONE, HeldSender, Liveness, Loss
from gcs_autotune.link.routing import Listener, Routing
from gcs_autotune.link.transports.transport import Transport
from gcs_autotune.mavlink import (
    Frame,
    Message,
    Packer,
    SigningKey,
    TextLog,
    VehicleIdentity,
    firmware_version,
    mavlink,
    message_request,
    our_heartbeat,
    unique_id,
)

__all__ = ["Listener", "OperatorStop", "PeriodicTask", "PeriodicTasks", "Session"]

T = TypeVar("T")

_SLICE = 0.1
"""Longest single wait [s of link time].

It is short so that the heartbeat and the operator are served in time. Project choice.
"""
_LEAST = 1e-9
"""Shortest time [s] to pump. A shorter one does not advance the clock of a simulated link, whose numbers are larger."""
_HEED = 0.02
"""Longest single wait in real time [s], because STOP must be sent within 50 ms. Project choice."""
_AWAY = 0.2
"""Time between two pumps [s of link time] above which this program was busy elsewhere. Project choice."""
_MOST_READS = 64
"""Most reads in a row to catch up; a continuous sender must not block our own tasks. Project choice."""
_HEARTBEAT_PERIOD = 1.0
_FIRST_BEACON = int(mavlink.MAV_COMP_ID_USER1)
_BEACONS = int(mavlink.MAV_COMP_ID_USER75) - _FIRST_BEACON + 1
_THREE_HEARTBEATS = 3.5
_ASKINGS = 3
"""Rounds of contradicting heartbeats before an error; a single one may be due to a change under way. Project choice."""
_SILENT = 1.2
"""Time [s] in which a vehicle sends at least one heartbeat. Project choice."""
_REPEAT = 0.5
"""Seconds after which a missing heartbeat is requested again."""
_ROUNDING = 1e-6
"""Tolerance [s] for rounding errors in sums of decimal fractions."""
_LISTEN_FOR_SECOND = 2.0
"""Time [s] spent listening for a second autopilot: two heartbeat periods."""
_VERSION_TRIES = 3


_SEEN = 3
"""Number of messages without a gap that rule out a loss of half of all messages. Project choice."""
_TIME_TO_KNOW = 20.0
"""Time [s] in which a vehicle without streams sends twenty heartbeats. Project choice."""


@dataclass(slots=True, eq=False)
class PeriodicTask:
    """A task executed every ``period`` [s of link time] while pumping."""

    clock: Clock
    period: float
    action: Callable[[], None]
    due: float

    def postpone(self) -> None:
        """Restart the period, because the task has just been executed."""
        self.due = self.clock.now() + self.period


class PeriodicTasks:
    """The periodic tasks of a session, in order of registration."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._tasks: list[PeriodicTask] = []

    def add(self, period: float, action: Callable[[], None]) -> PeriodicTask:
        """Register *action* to be executed every *period* [s], first at once. Return its task."""
        task = PeriodicTask(self._clock, period, action, self._clock.now())
        self._tasks.append(task)
        return task

    def next_due(self) -> float:
        """Return the link time [s] at which the next task is due. At least one task must exist."""
        return min(task.due for task in self._tasks)

    def do(self, now: float) -> None:
        """Execute all tasks that are due at link time *now* [s]."""
        for task in self._tasks:
            if task.due <= now + _ROUNDING:
                task.postpone()
                task.action()


class OperatorStop:
    """The operator's stop request. ``requested``: whether it was made. *interrupt* is called to detect it."""

    def __init__(self, interrupt: Callable[[], bool]) -> None:
        self._interrupt = interrupt
        self._shields = 0
        self.requested = False

    def check(self) -> None:
        """Raise ``OperatorStopped`` if a stop is requested and not shielded."""
        if self._interrupt():
            self.requested = True
        if self.requested and not self._shields:
            raise OperatorStopped("stopped by the operator")

    @contextmanager
    def shielded(self, *, raise_after: bool = False) -> Iterator[None]:
        """Postpone the operator's stop inside this context. With *raise_after* it is raised on exit."""
        self._shields += 1
        try:
            yield
        finally:
            self._shields -= 1
        if raise_after:
            self.check()


class Session:
    """A connection to one vehicle.

    Parameters
    ----------
    source_system, source_component : the ids used for sending.
    tlog : where to log every frame, both directions; None for no log.
    interrupt : called at every pump; True means that the operator requests a stop.
    heartbeat_timeout : seconds of silence after which the link counts as lost.
    signing : the signing key shared with the vehicle; None: no signing. Frames not signed with it are rejected.

    Attributes
    ----------
    vehicle : the vehicle found by :meth:`discover`, None before.
    armed, custom_mode : from its last HEARTBEAT.
    at_work : whether the HEARTBEAT from :attr:`beacon` reports that a run is going on.
    beacon : component id of that HEARTBEAT, chosen at random for every session. Routers, including ArduPilot, do not
        forward a HEARTBEAT to a link on which its sender's ids were heard. All computers with this program have the
        same ids otherwise.
    port : sends and receives frames, counts them, and contains our system id.
    routing : the listeners, and the other senders heard.
    liveness : how long the vehicle has been silent.
    patience : longest silence [s] tolerated while waiting; 0 for none. It is used before arming only, because an armed
        vehicle is made neutral first.
    operator : the operator's stop request, and the context that postpones it.
    texts : text messages of the vehicle.
    notes : messages for the operator, in order.
    """

    def __init__(
        self,
        transport: Transport,
        *,
        source_system: int = 255,
        source_component: int = 190,
        tlog: Path | None = None,
        interrupt: Callable[[], bool] = lambda: False,
        heartbeat_timeout: float = 5.0,
        signing: SigningKey | None = None,
    ) -> None:
        self.transport = transport
        self.clock: Clock = transport.clock
        self.vehicle: VehicleIdentity | None = None
        self.armed = False
        self.at_work = False
        self.beacon = _FIRST_BEACON + (0 if transport.is_simulated else secrets.randbelow(_BEACONS))
        self.custom_mode = -1
        self.heartbeats = 0
        self.texts = TextLog()
        self.notes: list[str] = []
        self.port = FramePort(transport, Packer(source_system, source_component), tlog, signing, self.notes)
        self.routing = Routing(self.notes)
        self._held_sender = HeldSender(self.notes)
        self._held_at = 0.0
        self._sightings = Sightings()
        self._timeout = heartbeat_timeout
        self.patience = 0.0
        self.liveness = Liveness(self.clock.now())
        self._given_up_at = -1
        self.operator = OperatorStop(interrupt)
        self._periodic_tasks = PeriodicTasks(self.clock)
        self.every(_HEARTBEAT_PERIOD, self._send_heartbeat)
        self.listen("HEARTBEAT", self._on_heartbeat)
        self.listen("STATUSTEXT", self._on_text)

    def send(self, message: Message) -> None:
        """Send one message to the vehicle and log it."""
        self.port.send(message)

    def request_message(self, number: int) -> None:
        """Request one message by number without waiting for it."""
        assert self.vehicle is not None
        self.send(message_request(self.vehicle.system, self.vehicle.component, number))

    def listen(self, name: str, listener: Listener) -> Callable[[], None]:
        """Call *listener* with every message *name* of the vehicle. Return a function that stops this.

        A listener must not pump; it may send.
        """
        return self.routing.listen(name, listener)

    def every(self, period: float, action: Callable[[], None]) -> PeriodicTask:
        """Call *action* every *period* [s of link time] while pumping, first at the next pump."""
        return self._periodic_tasks.add(period, action)

    def pump(self, timeout: float = _SLICE) -> None:
        """Execute the tasks that are due, then wait for bytes and route the messages in them. It waits at most
        *timeout* [s], and at most 0.1 s, or 20 ms in real time.

        Raises
        ------
        OperatorStopped
            The operator requested a stop, and it is not deferred.
        LinkLost
            The vehicle has been silent for too long, or the connection broke.
        """
        self.operator.check()
        self._periodic_tasks.do(self.clock.now())
        next_task = self._periodic_tasks.next_due() - self.clock.now()
        longest = _SLICE if self.transport.is_simulated else _HEED
        data = self.transport.read(max(0.0, min(timeout, longest, next_task)))
        was_away = self.liveness.count(self.clock.now()) > _AWAY
        for frame in self.port.frames(data):
            self._route(frame)
        if was_away and data:
            self._catch_up()
        self.check_contact(self._timeout)

    def _catch_up(self) -> None:
        """Read what arrived while this computer was busy: the oldest message arrives first but the newest one
        counts."""
        for _ in range(_MOST_READS):
            data = self.transport.read(0.0)
            if not data:
                return
            for frame in self.port.frames(data):
                self._route(frame)

    def _route(self, frame: Frame) -> None:
        self.routing.traffic[frame.name] += len(frame.raw)
        if self.vehicle is None:
            if not self._sightings.take(frame):
                self.routing.foreign[frame.system, frame.component] += 1
        elif (frame.system, frame.component) != (self.vehicle.system, self.vehicle.component):
            self.routing.note_other_station(frame, self.port.system)
        elif self._held_sender.is_held(frame):
            self._held_sender.hear(frame)
            self.liveness.heard()
            self._held_at = self.liveness.listened
            self.routing.tell(frame)
        else:
            self._receive_from_other(frame, self.vehicle)

    def _receive_from_other(self, frame: Frame, vehicle: VehicleIdentity) -> None:
        """Handle a frame with the vehicle's ids from another address.

        After a silence the vehicle may have moved there.
        """
        if self.liveness.listened - self._held_at <= GONE:
            self._held_sender.note_other_sender(frame)
        elif self._held_sender.may_be(frame, vehicle):
            self._hold(frame.origin, vehicle)
        elif frame.name == "HEARTBEAT":
            self.request_message(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)

    @property
    def contested(self) -> str:
        """Text with the senders if several addresses use the vehicle's ids; else empty."""
        others = self._held_sender.others
        if not others:
            return ""
        return (
            f"messages with the ids of {self.vehicle} come from {len(others) + 1} addresses: "
            f"{' and '.join((self._held_sender.origin, *others))}. Only messages "
            f"from {self._held_sender.origin} are used"
        )

    @property
    def loss(self) -> Loss:
        """Counts of the vehicle's messages that arrived and that the link lost."""
        return self._held_sender.loss

    def lossy(self) -> str:
        """Return a sentence if the link loses many messages, else an empty text.

        It waits until enough messages have arrived. Call it before reporting another cause.
        """
        if self.loss.received >= _SEEN and not self.loss.lost:
            return ""
        self.wait_for(lambda: self.loss.is_known or None, _TIME_TO_KNOW)
        return self.loss.words

    def _hold(self, origin: str, known: VehicleIdentity | None = None) -> None:
        self._held_sender.hold(origin, known)
        self.transport.hold(origin)

    def check_contact(self, patience: float) -> None:
        """Raise ``LinkLost`` if the vehicle, once found, has been silent for more than *patience* [s]."""
        if self.vehicle is not None and self.liveness.silence > max(patience, self.patience):
            raise LinkLost(
                f"Lost contact with {self.vehicle} on {self.transport.description} ({self.liveness.silence:.1f} s). "
                f"Check power, cable and radio range{self.port.trouble}"
            )

    def wait_for(self, condition: Callable[[], T | None], timeout: float) -> T | None:
        """Pump until *condition* returns something other than None, and return that; None after *timeout* [s].

        Only time spent listening counts: an answer that arrived while this computer was busy is read before the
        deadline is checked. A tolerated silence (:attr:`patience`) does not count.
        """
        deadline = Deadline.after(self.liveness, timeout)
        while (result := condition()) is None:
            if deadline.expired and not self.tolerates_silence:
                return None
            self.pump(_HEED if deadline.expired else max(deadline.remaining, _LEAST))
        return result

    @property
    def tolerates_silence(self) -> bool:
        """Whether the vehicle is silent now and :attr:`patience` permits this."""
        return self.vehicle is not None and _SILENT < self.liveness.silence <= self.patience

    def pause(self, seconds: float) -> None:
        """Keep pumping for *seconds* of link time."""
        self.wait_for(lambda: None, seconds)

    def await_return(self, timeout: float) -> bool:
        """Wait after ``LinkLost`` until the vehicle sends again, at most *timeout* [s]. Return whether it did."""
        self.liveness.bear(timeout)
        before = self.heartbeats
        return self.wait_for(lambda: True if self.heartbeats > before else None, timeout) is not None

    def ask_state(self, timeout: float) -> bool:
        """Request a HEARTBEAT so that :attr:`armed` and :attr:`custom_mode` are current; return whether one arrived
        within *timeout* [s].

        The request is repeated every half second, because it or its answer may be lost.
        """
        before, deadline = self.heartbeats, Deadline.after(self.clock, timeout)
        while self.heartbeats == before and not deadline.expired:
            self.request_message(mavlink.MAVLINK_MSG_ID_HEARTBEAT)
            self.wait_for(lambda: True if self.heartbeats > before else None, min(_REPEAT, deadline.remaining))
        return self.heartbeats > before

    def await_heartbeat(self) -> None:
        """Request HEARTBEAT until :attr:`armed` and :attr:`custom_mode` are current and uncontradicted.

        All heartbeats of two periods and a second must agree, because a forged one arrives in addition to the vehicle's
        own.

        Raises
        ------
        LinkLost
            No heartbeat arrived, although a connected vehicle would have sent three.
        TelemetryFault
            The heartbeats still contradict each other.
        """
        reported: set[tuple[bool, int]] = set()
        for _ in range(_ASKINGS):
            reported = self._reported_states()
            if len(reported) == 1:
                return
        states = " and ".join(f"{'armed' if armed else 'disarmed'} in mode {mode}" for armed, mode in sorted(reported))
        raise TelemetryFault(
            f"the heartbeats of {self.vehicle} contradict each other ({states}): another sender uses its system id. "
            "Disconnect it, or use a signed link, and check the vehicle itself"
        )

    def _reported_states(self) -> set[tuple[bool, int]]:
        """Request HEARTBEAT, listen for a while, and return every pair (armed, custom mode) received."""
        reported: list[tuple[bool, int]] = []
        stop = self.listen("HEARTBEAT", lambda m: reported.append((_is_armed(m), int(m.custom_mode))))
        try:
            self.request_message(mavlink.MAVLINK_MSG_ID_HEARTBEAT)
            begun = self.liveness.listened
            if not self.await_return(_THREE_HEARTBEATS):
                raise LinkLost(
                    f"lost contact with {self.vehicle} on {self.transport.description}. Check power, cable and radio "
                    "range"
                )
            self.wait_for(
                lambda: True if len(reported) > 1 and self.liveness.listened - begun > _HEARTBEAT_PERIOD else None,
                _THREE_HEARTBEATS,
            )
        finally:
            stop()
        return set(reported)

    def outlast(self, patience: float) -> bool:
        """Wait for the vehicle to return after ``LinkLost`` in a clean-up, up to *patience* [s] and once per
        silence.

        Returns whether it has returned.
        """
        if self.heartbeats == self._given_up_at:
            return False
        last_received = self.liveness.last_received
        with self.operator.shielded(), suppress(LinkLost):
            if self.await_return(patience):
                return True
        self._given_up_at, self.liveness.last_received = self.heartbeats, last_received
        return False

    def discover(self, timeout: float = 10.0, system_id: int | None = None) -> VehicleIdentity:
        """Wait for an autopilot's HEARTBEAT; then accept only that system and component. Return the vehicle's identity.

        It listens for two more seconds to detect a second autopilot on the link.

        Raises
        ------
        NoVehicle
            No autopilot was heard within *timeout* [s]; the message lists the senders heard instead.
        SigningMismatch
            An autopilot was heard, but its signing does not match ours: only one side signs, or the keys differ.
        UsageError
            There are several autopilots, and *system_id* does not select one.
        """
        wanted = self._find(timeout, system_id)
        self.vehicle = wanted.identity()
        self._hold(wanted.origin)
        self._held_at = self.liveness.listened
        self.liveness.heard()
        self.armed, self.custom_mode = wanted.armed, wanted.custom_mode
        self.vehicle = self._introduce(wanted)
        return self.vehicle

    def _find(self, timeout: float, system_id: int | None) -> VehicleCandidate:
        """Return the only autopilot heard, or the one with *system_id*; errors as for :meth:`discover`."""
        port, sightings = self.port, self._sightings
        wanted = self.wait_for(lambda: sightings.found(system_id), timeout)
        if wanted is None:
            where = self.transport.description
            if port.signer and port.signer.refused:
                raise not_believed(port.signer, where)
            where += port.trouble
            raise no_vehicle_error(
                where, timeout, system_id, sightings.candidates, self.routing.foreign, port.bad_bytes
            )
        if system_id is not None:
            return wanted
        self.pause(_LISTEN_FOR_SECOND)
        return choose(list(sightings.candidates.values()))

    def _introduce(self, wanted: VehicleCandidate) -> VehicleIdentity:
        """Return the identity of *wanted*. Raises ``SigningMismatch`` if it signs and does not answer without a key."""
        version, uid = self._ask_version()
        if self.port.signer is None and self._sightings.signs(wanted):
            if not version:
                raise cannot_be_commanded(wanted, self.transport.description)
            self.notes.append("the vehicle signs its messages, but accepts unsigned messages on this link")
        return wanted.identity(version=version, uid=uid)

    def _ask_version(self) -> tuple[str, str]:
        """Return (firmware version, unique id), each empty if not reported."""
        answers: list[Message] = []
        stop = self.listen("AUTOPILOT_VERSION", answers.append)
        try:
            for _ in range(_VERSION_TRIES):
                self.request_message(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
                if self.wait_for(lambda: True if answers else None, 1.0):
                    return firmware_version(answers[0]), unique_id(answers[0])
        finally:
            stop()
        self.notes.append("the vehicle did not report its firmware version")
        return "", ""

    def _on_heartbeat(self, message: Message) -> None:
        self.armed = _is_armed(message)
        self.custom_mode = int(message.custom_mode)
        self.heartbeats += 1

    def _on_text(self, message: Message) -> None:
        self.texts.take(message, self.clock.now())

    def _send_heartbeat(self) -> None:
        self.send(our_heartbeat())
        if self.at_work:
            self.port.send(our_heartbeat(at_work=True), self.beacon)
        self.port.flush_log()

    def close(self) -> None:
        """Close the log and the transport."""
        self.port.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _is_armed(heartbeat: Message) -> bool:
    return bool(heartbeat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
