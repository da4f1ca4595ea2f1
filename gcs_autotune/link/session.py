"""One conversation with one vehicle: heartbeat, discovery, routing, liveness, the operator's stop, the log.

Everything happens inside :meth:`Session.pump`, on the caller's thread: read what has come, hand each message
to those who listen for it, send what is due. Whoever waits, waits by pumping, with a deadline on the link's
clock; nothing sleeps and nothing runs beside it. Made of ``port`` (frames, signing, log), ``routing``, ``duties``,
``hearing`` and ``operator_stop``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import Self, TypeVar

from gcs_autotune.clock import Clock, Deadline
from gcs_autotune.errors import LinkLost, TelemetryFault
from gcs_autotune.link.discovery import Sightings
from gcs_autotune.link.duties import Duties, Duty
from gcs_autotune.link.hearing import Hearing
from gcs_autotune.link.identity import VehicleIdentity
from gcs_autotune.link.operator_stop import OperatorStop
from gcs_autotune.link.peer import GONE, Peer
from gcs_autotune.link.port import FramePort
from gcs_autotune.link.routing import Listener, Routing
from gcs_autotune.link.search import find, introduce
from gcs_autotune.link.signing import SigningKey
from gcs_autotune.link.texts import TextLog
from gcs_autotune.link.transport import Transport
from gcs_autotune.link.wire import Frame, Message, Packer, mavlink, message_request, our_heartbeat

__all__ = ["Duty", "Listener", "Session"]

T = TypeVar("T")

_SLICE = 0.1
"""Chosen: longest single wait [s of link time], so that heartbeat and operator are never kept waiting."""
_HEARTBEAT_PERIOD = 1.0
_THREE_HEARTBEATS = 3.5
_ASKINGS = 3
"""Chosen: times that contradicting heartbeats are listened to; one contradiction may be a change on its way."""


class Session:
    """See the module's text.

    Parameters
    ----------
    source_system, source_component : the ids we send as.
    tlog : where to log every frame, both directions; None for no log.
    interrupt : asked at every pump; True means that the operator wants to stop.
    heartbeat_timeout : seconds of silence after which the link counts as lost.
    signing : the key that we and the vehicle sign with; None for none. What is not signed with it is refused.

    Attributes
    ----------
    vehicle : the vehicle found by :meth:`discover`, None before.
    armed, custom_mode : from its last HEARTBEAT.
    foreign : (system, component) -> messages heard from others.
    traffic : message name -> bytes received, of everybody's.
    notes : things worth telling the operator, in order.
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
        self.custom_mode = -1
        self.heartbeats = 0
        self.texts = TextLog()
        self.notes: list[str] = []
        self._port = FramePort(transport, Packer(source_system, source_component), tlog, signing, self.notes)
        self._routing = Routing(self.notes)
        self.foreign: Counter[tuple[int, int]] = self._routing.foreign
        self.traffic: Counter[str] = self._routing.traffic
        self._peer = Peer(self.notes)
        self._held_at = 0.0
        self._sightings = Sightings()
        self._timeout = heartbeat_timeout
        self._hearing = Hearing(self.clock.now())
        self._given_up_at = -1
        self._operator = OperatorStop(interrupt)
        self._duties = Duties(self.clock)
        self.every(_HEARTBEAT_PERIOD, self._send_heartbeat)
        self.listen("HEARTBEAT", self._on_heartbeat)
        self.listen("STATUSTEXT", self._on_text)

    @property
    def bad_data(self) -> int:
        """Stretches of received bytes that were no MAVLink frame."""
        return self._port.bad_data

    @property
    def sent(self) -> int:
        """Bytes sent."""
        return self._port.sent

    @property
    def refused(self) -> int:
        """Frames refused because they were not signed with our key, or too long ago; 0 without a key."""
        return self._port.refused

    @property
    def refusals(self) -> str:
        """How many frames were refused and why, for the operator; empty when none were."""
        return self._port.refusals

    @property
    def source_system(self) -> int:
        """The system id we send as."""
        return self._port.packer.system

    @source_system.setter
    def source_system(self, value: int) -> None:
        self._port.packer.system = value

    @property
    def listened(self) -> float:
        """Seconds of link time spent pumping."""
        return self._hearing.listened

    @property
    def silence(self) -> float:
        """Seconds of link time spent listening since the vehicle was last heard; see :attr:`listened`."""
        return self._hearing.silence

    @property
    def unheard(self) -> float:
        """The same, also while a silence is borne (:meth:`await_return`)."""
        return self._hearing.unheard

    def longest_silence(self, span: float) -> float:
        """Return the longest silence of the vehicle [s] that ended within the last *span* [s] spent listening."""
        return self._hearing.longest(span)

    @property
    def stop_asked(self) -> bool:
        """Whether the operator has wanted to stop."""
        return self._operator.asked

    def send(self, message: Message) -> None:
        """Send one message, and log it."""
        self._port.send(message)

    def request_message(self, number: int) -> None:
        """Ask the vehicle to send the message of that number once; do not wait for it."""
        assert self.vehicle is not None
        self.send(message_request(self.vehicle.system, self.vehicle.component, number))

    def listen(self, name: str, listener: Listener) -> Callable[[], None]:
        """Call *listener* with every message called *name* from the vehicle; return what ends that.

        A listener must not pump; it may send.
        """
        return self._routing.listen(name, listener)

    def overhear(self, listener: Callable[[Frame], None]) -> None:
        """Call *listener* with every frame from anybody but the vehicle. What they say is hearsay, never obeyed."""
        self._routing.overhear(listener)

    def every(self, period: float, action: Callable[[], None]) -> Duty:
        """Call *action* every *period* [s of link time] while pumping, first at the next pump."""
        return self._duties.add(period, action)

    def pump(self, timeout: float = _SLICE) -> None:
        """Do everything that is due, then wait at most *timeout* (never above 0.1 s) for bytes and route them.

        Raises
        ------
        OperatorStopped
            The operator asked to stop and no shield is up.
        LinkLost
            The vehicle has been silent for too long, or the connection broke.
        """
        self._operator.check()
        self._duties.do(self.clock.now())
        next_duty = self._duties.next_due() - self.clock.now()
        data = self.transport.read(max(0.0, min(timeout, _SLICE, next_duty)))
        self._hearing.count(self.clock.now())
        for frame in self._port.frames(data):
            self._route(frame)
        self.check_heard(self._timeout)

    def _route(self, frame: Frame) -> None:
        self.traffic[frame.name] += len(frame.raw)
        if self.vehicle is None:
            if not self._sightings.take(frame):
                self.foreign[frame.system, frame.component] += 1
        elif (frame.system, frame.component) != (self.vehicle.system, self.vehicle.component):
            self._routing.note_foreign(frame, self.source_system)
        elif self._peer.is_held(frame):
            self._peer.hear(frame)
            self._hearing.heard()
            self._held_at = self.listened
            self._routing.tell(frame)
        else:
            self._hear_stranger(frame, self.vehicle)

    def _hear_stranger(self, frame: Frame, vehicle: VehicleIdentity) -> None:
        """Somebody at another address says that he is the vehicle. When that has fallen silent, he may be."""
        if self.listened - self._held_at <= GONE:
            self._peer.note_stranger(frame)
        elif self._peer.may_be(frame, vehicle):
            self._hold(frame.origin, vehicle)
        elif frame.name == "HEARTBEAT":
            self.request_message(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)

    def _hold(self, origin: str, known: VehicleIdentity | None = None) -> None:
        self._peer.hold(origin, known)
        self.transport.hold(origin)

    def check_heard(self, patience: float) -> None:
        """Raise ``LinkLost`` when the vehicle, once found, has been silent for more than *patience* [s]."""
        if self.vehicle is not None and self.silence > patience:
            raise LinkLost(
                f"{self.vehicle} has been silent for {self.silence:.1f} s on {self.transport.description}; "
                f"check power, cable and radio range{self._port.trouble}"
            )

    def wait_for(self, condition: Callable[[], T | None], timeout: float) -> T | None:
        """Pump until *condition* returns something other than None, and return that; None after *timeout* [s]."""
        deadline = Deadline.after(self.clock, timeout)
        while (found := condition()) is None:
            if deadline.expired:
                return None
            self.pump(deadline.remaining)
        return found

    def pause(self, seconds: float) -> None:
        """Go on pumping for *seconds* of link time."""
        self.wait_for(lambda: None, seconds)

    def await_return(self, timeout: float) -> bool:
        """After ``LinkLost``: wait until the vehicle is heard again; return whether it was."""
        self._hearing.bear(timeout)
        before = self.heartbeats
        return self.wait_for(lambda: True if self.heartbeats > before else None, timeout) is not None

    def await_heartbeat(self) -> None:
        """Ask for HEARTBEAT until :attr:`armed` and :attr:`custom_mode` are of now, and nobody contradicts them.

        For two heartbeats and a second all that are heard must say the same: what somebody else sends under the
        vehicle's id comes beside its own, not instead of them.

        Raises
        ------
        LinkLost
            A vehicle that is there would have sent three in that time.
        TelemetryFault
            They go on contradicting each other.
        """
        told: set[tuple[bool, int]] = set()
        for _ in range(_ASKINGS):
            told = self._asked_state()
            if len(told) == 1:
                return
        states = " and ".join(f"{'armed' if armed else 'disarmed'} in mode {mode}" for armed, mode in sorted(told))
        raise TelemetryFault(
            f"the heartbeats of {self.vehicle} contradict each other ({states}): somebody else sends under its system "
            "id. Disconnect him, or use a signed link, and look at the vehicle itself"
        )

    def _asked_state(self) -> set[tuple[bool, int]]:
        """Ask for HEARTBEAT, listen for a while, and return every (armed, custom mode) that was heard."""
        told: list[tuple[bool, int]] = []
        stop = self.listen("HEARTBEAT", lambda m: told.append((_is_armed(m), int(m.custom_mode))))
        try:
            self.request_message(mavlink.MAVLINK_MSG_ID_HEARTBEAT)
            begun = self.listened
            if not self.await_return(_THREE_HEARTBEATS):
                raise LinkLost(f"{self.vehicle} is not heard any more on {self.transport.description}")
            self.wait_for(
                lambda: True if len(told) > 1 and self.listened - begun > _HEARTBEAT_PERIOD else None, _THREE_HEARTBEATS
            )
        finally:
            stop()
        return set(told)

    def outlast(self, patience: float) -> bool:
        """After ``LinkLost`` in a clean-up: wait up to *patience* [s] for the vehicle, once per silence.

        Returns whether it is heard again.
        """
        if self.heartbeats == self._given_up_at:
            return False
        last_heard = self._hearing.last_heard
        with self.shielded(), suppress(LinkLost):
            if self.await_return(patience):
                return True
        self._given_up_at, self._hearing.last_heard = self.heartbeats, last_heard
        return False

    def shielded(self, *, raise_after: bool = False) -> AbstractContextManager[None]:
        """Keep the operator's stop from interrupting what is inside; it is remembered in ``stop_asked``.

        With *raise_after* it is raised on leaving; otherwise the next pump outside the shield raises it.
        """
        return self._operator.shielded(raise_after=raise_after)

    def discover(self, timeout: float = 10.0, system_id: int | None = None) -> VehicleIdentity:
        """Wait for an autopilot's HEARTBEAT; from then on only that system and component is listened to.

        Hears out two seconds more, so that a second autopilot on the link is noticed and not fallen over.

        Raises
        ------
        NoVehicle
            No autopilot was heard within *timeout* [s]; the message says what was heard instead.
        SigningMismatch
            One was heard, but it signs and we have no key or another one, or it does not sign and we have a key.
        UsageError
            There are several and *system_id* does not say which.
        """
        wanted = find(self, self._port, self._sightings, timeout, system_id)
        self.vehicle = wanted.identity()
        self._hold(wanted.origin)
        self._held_at = self.listened
        self._hearing.heard()
        self.armed, self.custom_mode = wanted.armed, wanted.custom_mode
        self.vehicle = introduce(self, self._port, self._sightings, wanted)
        return self.vehicle

    def _on_heartbeat(self, message: Message) -> None:
        self.armed = _is_armed(message)
        self.custom_mode = int(message.custom_mode)
        self.heartbeats += 1

    def _on_text(self, message: Message) -> None:
        self.texts.take(message, self.clock.now())

    def _send_heartbeat(self) -> None:
        self.send(our_heartbeat())
        self._port.flush_log()

    def close(self) -> None:
        """Close the log and the transport."""
        self._port.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _is_armed(heartbeat: Message) -> bool:
    return bool(heartbeat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
