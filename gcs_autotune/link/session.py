"""One conversation with one vehicle: heartbeat, discovery, routing, liveness, the operator's stop, the log.

Everything happens inside :meth:`Session.pump`, on the caller's thread: read what has come, hand each message
to those who listen for it, send what is due. Whoever waits, waits by pumping, with a deadline on the link's
clock; nothing sleeps and nothing runs beside it.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self, TypeVar

from gcs_autotune.clock import Clock, Deadline
from gcs_autotune.errors import BadFile, LinkLost, OperatorStopped
from gcs_autotune.link.discovery import Candidate, choose, is_autopilot, nobody_found
from gcs_autotune.link.identity import VehicleIdentity, firmware_version, unique_id
from gcs_autotune.link.signing import LINK_ID, Signer, SigningKey, is_signed
from gcs_autotune.link.signing_errors import cannot_be_commanded, not_believed, refusals
from gcs_autotune.link.stamp_store import StampStore
from gcs_autotune.link.texts import TextLog
from gcs_autotune.link.tlog import TlogWriter, time_base
from gcs_autotune.link.transport import Transport
from gcs_autotune.link.wire import Frame, Framer, Message, Packer, mavlink

__all__ = ["Duty", "Listener", "Session"]

T = TypeVar("T")
Listener = Callable[[Message], None]

_SLICE = 0.1
"""Chosen: longest single wait [s of link time], so that heartbeat and operator are never kept waiting."""
_HEARTBEAT_PERIOD = 1.0
_LONGEST_PUMP = 0.5
"""Chosen: of a longer time from pump to pump [s] this much counts as listened: then it was we who were away (a machine
that is busy or was suspended), and what has come meanwhile is still to be read."""
_STALE_PARTIAL = 0.5
"""Chosen: seconds after which an unfinished frame is held to be a false start in noise."""
_VERSION_TRIES = 3
_SECRET = ("SETUP_SIGNING",)
"""Messages that hold a signing key: never logged, whoever sent them."""
_ROUNDING = 1e-6
"""Seconds: what sums of decimal fractions may be off."""


def _never() -> bool:
    return False


@dataclass(slots=True, eq=False)
class Duty:
    """Something done every ``period`` [s of link time] while pumping."""

    clock: Clock
    period: float
    action: Callable[[], None]
    due: float

    def postpone(self) -> None:
        """It has just been done: next time a whole period from now."""
        self.due = self.clock.now() + self.period


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
    listened : seconds of link time spent pumping.
    foreign : (system, component) -> messages heard from others.
    traffic : message name -> bytes received, of everybody's.
    sent : bytes sent.
    notes : things worth telling the operator, in order.
    """

    def __init__(
        self,
        transport: Transport,
        *,
        source_system: int = 255,
        source_component: int = 190,
        tlog: Path | None = None,
        interrupt: Callable[[], bool] = _never,
        heartbeat_timeout: float = 5.0,
        signing: SigningKey | None = None,
    ) -> None:
        self.transport = transport
        self.clock: Clock = transport.clock
        self.vehicle: VehicleIdentity | None = None
        self.armed = False
        self.custom_mode = -1
        self.heartbeats = 0
        self.foreign: Counter[tuple[int, int]] = Counter()
        self.traffic: Counter[str] = Counter()
        self.sent = 0
        self.texts = TextLog()
        self.notes: list[str] = []
        self._framer = Framer()
        self._packer = Packer(source_system, source_component)
        self._signer = self._begin_signing(signing) if signing else None
        self._signs: set[tuple[int, int]] = set()
        self._tlog = TlogWriter(tlog, time_base(transport)) if tlog else None
        self._interrupt = interrupt
        self._timeout = heartbeat_timeout
        self._listeners: dict[str, list[Listener]] = defaultdict(list)
        self._twins: set[tuple[int, int]] = set()
        self._overhearing: list[Callable[[Frame], None]] = []
        self._duties: list[Duty] = []
        self._candidates: dict[tuple[int, int], Candidate] = {}
        self.listened = 0.0
        self._last_heard = 0.0
        self._last_pump = self.clock.now()
        self._last_bytes = self.clock.now()
        self._shields = 0
        self._given_up_at = -1
        self.stop_asked = False
        self.every(_HEARTBEAT_PERIOD, self._send_heartbeat)
        self.listen("HEARTBEAT", self._on_heartbeat)
        self.listen("STATUSTEXT", self._on_text)

    @property
    def bad_data(self) -> int:
        """Stretches of received bytes that were no MAVLink frame."""
        return self._framer.bad_data

    @property
    def refused(self) -> int:
        """Frames refused because they were not signed with our key, or too long ago; 0 without a key."""
        return self._signer.refused.total() if self._signer else 0

    @property
    def refusals(self) -> str:
        """How many frames were refused and why, for the operator; empty when none were."""
        return refusals(self._signer)

    @property
    def source_system(self) -> int:
        """The system id we send as."""
        return self._packer.system

    @source_system.setter
    def source_system(self, value: int) -> None:
        self._packer.system = value

    @property
    def silence(self) -> float:
        """Seconds of link time spent listening since the vehicle was last heard; see :attr:`listened`."""
        return self.listened - self._last_heard

    # --- talking ------------------------------------------------------------------------------------------

    def send(self, message: Message) -> None:
        """Send one message, and log it."""
        frame = self._packer.pack(message)
        if message.get_type() not in _SECRET:
            self._log(frame)
        self.sent += len(frame)
        self.transport.write(frame)

    def listen(self, name: str, listener: Listener) -> Callable[[], None]:
        """Call *listener* with every message called *name* from the vehicle; return what ends that.

        A listener must not pump; it may send.
        """
        self._listeners[name].append(listener)
        return lambda: self._listeners[name].remove(listener)

    def overhear(self, listener: Callable[[Frame], None]) -> None:
        """Call *listener* with every frame from anybody but the vehicle. What they say is hearsay, never obeyed."""
        self._overhearing.append(listener)

    def every(self, period: float, action: Callable[[], None]) -> Duty:
        """Call *action* every *period* [s of link time] while pumping, first at the next pump."""
        duty = Duty(self.clock, period, action, self.clock.now())
        self._duties.append(duty)
        return duty

    def pump(self, timeout: float = _SLICE) -> None:
        """Do everything that is due, then wait at most *timeout* (never above 0.1 s) for bytes and route them.

        Raises
        ------
        OperatorStopped
            The operator asked to stop and no shield is up.
        LinkLost
            The vehicle has been silent for too long, or the connection broke.
        """
        self._ask_operator()
        self._do_duties()
        next_duty = min(duty.due for duty in self._duties) - self.clock.now()
        data = self.transport.read(max(0.0, min(timeout, _SLICE, next_duty)))
        self._count_listening()
        for frame in self._frames(data):
            self._route(frame)
        self.check_heard(self._timeout)

    def _count_listening(self) -> None:
        now = self.clock.now()
        self.listened += min(now - self._last_pump, _LONGEST_PUMP)
        self._last_pump = now

    def check_heard(self, patience: float) -> None:
        """Raise ``LinkLost`` when the vehicle, once found, has been silent for more than *patience* [s]."""
        if self.vehicle is not None and self.silence > patience:
            raise LinkLost(
                f"{self.vehicle} has been silent for {self.silence:.1f} s on {self.transport.description}; "
                f"check power, cable and radio range{self._trouble()}"
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
        self._last_heard, before = self.listened + timeout, self.heartbeats
        return self.wait_for(lambda: True if self.heartbeats > before else None, timeout) is not None

    def outlast(self, patience: float) -> bool:
        """After ``LinkLost`` in a clean-up: wait up to *patience* [s] for the vehicle, once per silence.

        Returns whether it is heard again.
        """
        if self.heartbeats == self._given_up_at:
            return False
        last_heard = self._last_heard
        with self.shielded():
            try:
                is_back = self.await_return(patience)
            except LinkLost:
                is_back = False
        if not is_back:
            self._given_up_at, self._last_heard = self.heartbeats, last_heard
        return is_back

    # --- the operator -------------------------------------------------------------------------------------

    @contextmanager
    def shielded(self, *, raise_after: bool = False) -> Iterator[None]:
        """Keep the operator's stop from interrupting what is inside; it is remembered in ``stop_asked``.

        With *raise_after* it is raised on leaving; otherwise the next pump outside the shield raises it.
        """
        self._shields += 1
        try:
            yield
        finally:
            self._shields -= 1
        if raise_after:
            self._ask_operator()

    def _ask_operator(self) -> None:
        if self._interrupt():
            self.stop_asked = True
        if self.stop_asked and not self._shields:
            raise OperatorStopped("stopped by the operator")

    # --- finding the vehicle ------------------------------------------------------------------------------

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
        wanted = self.wait_for(lambda: self._found(system_id), timeout)
        if wanted is None:
            if self._signer and self._signer.refused:
                raise not_believed(self._signer, self.transport.description)
            where, heard = f"{self.transport.description}{self._trouble()}", self._candidates
            raise nobody_found(where, timeout, system_id, heard, self.foreign, self._framer.bad_bytes)
        if system_id is None:
            self.pause(2 * _HEARTBEAT_PERIOD)
            wanted = choose(list(self._candidates.values()))
        self.vehicle = wanted.identity()
        self._last_heard = self.listened
        self.armed, self.custom_mode = wanted.armed, wanted.custom_mode
        version, uid = self._ask_version()
        if self._signer is None and (wanted.system, wanted.component) in self._signs:
            if not version:
                raise cannot_be_commanded(wanted, self.transport.description)
            self.notes.append("the vehicle signs its messages; on this link it obeys unsigned ones too")
        self.vehicle = wanted.identity(version=version, uid=uid)
        return self.vehicle

    def _trouble(self) -> str:
        said = "; ".join(filter(None, (self.transport.trouble, self.refusals)))
        return f" ({said})" if said else ""

    def _begin_signing(self, key: SigningKey) -> Signer:
        store = None if self.transport.is_simulated else StampStore()
        signer = Signer(key, time_base(self.transport), store)
        self._packer.sign_with(key.secret, LINK_ID, signer.next_stamp)
        if store and store.trouble:
            self.notes.append(store.trouble)
        return signer

    def _found(self, system_id: int | None) -> Candidate | None:
        return next((c for c in self._candidates.values() if system_id in (None, c.system)), None)

    def _ask_version(self) -> tuple[str, str]:
        """Return (firmware version, unique id), each empty when it is not told."""
        answers: list[Message] = []
        stop = self.listen("AUTOPILOT_VERSION", answers.append)
        try:
            for _ in range(_VERSION_TRIES):
                self.request_message(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
                if self.wait_for(lambda: True if answers else None, 1.0):
                    return firmware_version(answers[0]), unique_id(answers[0])
        finally:
            stop()
        self.notes.append("the vehicle did not tell its firmware version")
        return "", ""

    def request_message(self, number: int) -> None:
        """Ask the vehicle to send the message of that number once; do not wait for it."""
        assert self.vehicle is not None
        self.send(
            mavlink.MAVLink_command_long_message(
                self.vehicle.system,
                self.vehicle.component,
                mavlink.MAV_CMD_REQUEST_MESSAGE,
                0,
                *(float(number), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
            )
        )

    # --- inside -------------------------------------------------------------------------------------------

    def _frames(self, data: bytes) -> list[Frame]:
        now = self.clock.now()
        if data:
            self._last_bytes = now
            return self._framer.feed(data)
        if self._framer.pending and now - self._last_bytes > _STALE_PARTIAL:
            return self._framer.flush()
        return []

    def _route(self, frame: Frame) -> None:
        if self._signer is not None and not self._signer.believes(frame):
            return
        if frame.name not in _SECRET:
            self._log(frame.raw)
        self.traffic[frame.name] += len(frame.raw)
        if self.vehicle is None:
            self._consider(frame)
            return
        if (frame.system, frame.component) != (self.vehicle.system, self.vehicle.component):
            self._note_foreign(frame)
            return
        self._last_heard = self.listened
        for listener in tuple(self._listeners.get(frame.name, ())):
            listener(frame.message)

    def _log(self, frame: bytes) -> None:
        """Log *frame*, or flush when it is empty. A full disk ends the log, never the clean-up of a vehicle."""
        if self._tlog is None:
            return
        try:
            self._tlog.write(frame) if frame else self._tlog.flush()
        except BadFile as error:
            self.notes.append(f"{error}; from here on nothing is logged")
            with suppress(BadFile):
                self._tlog.close()
            self._tlog = None

    def _note_foreign(self, frame: Frame) -> None:
        self.foreign[frame.system, frame.component] += 1
        for hear in self._overhearing:
            hear(frame)
        is_twin = frame.name == "HEARTBEAT" and frame.system == self.source_system
        if is_twin and (frame.system, frame.component) not in self._twins:
            self._twins.add((frame.system, frame.component))
            self.notes.append(
                f"another station on this link also is system {frame.system}: the vehicle cannot tell us apart "
                "and obeys both; close it"
            )

    def _consider(self, frame: Frame) -> None:
        if frame.name == "HEARTBEAT" and is_autopilot(frame.message):
            if is_signed(frame):
                self._signs.add((frame.system, frame.component))
            self._candidates[frame.system, frame.component] = Candidate.of(frame)
        else:
            self.foreign[frame.system, frame.component] += 1

    def _on_heartbeat(self, message: Message) -> None:
        self.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        self.custom_mode = int(message.custom_mode)
        self.heartbeats += 1

    def _on_text(self, message: Message) -> None:
        self.texts.take(message, self.clock.now())

    def _do_duties(self) -> None:
        now = self.clock.now() + _ROUNDING
        for duty in self._duties:
            if duty.due <= now:
                duty.postpone()
                duty.action()

    def _send_heartbeat(self) -> None:
        self.send(
            mavlink.MAVLink_heartbeat_message(
                mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
            )
        )
        self._log(b"")

    def close(self) -> None:
        """Close the log and the transport."""
        try:
            if self._tlog:
                self._tlog.close()
        except BadFile as error:
            self.notes.append(str(error))
        finally:
            self.transport.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
