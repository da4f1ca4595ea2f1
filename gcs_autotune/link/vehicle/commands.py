"""Send commands to the autopilot, repeated until answered and confirmed by its heartbeat."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from functools import partial

from gcs_autotune.clock import Deadline
from gcs_autotune.errors import ArmingRefused, CommandDenied, LinkLost, ModeRefused, NoReply
from gcs_autotune.firmware import Firmware
from gcs_autotune.link.session import Session
from gcs_autotune.mavlink import Message, enum_name, mavlink
from gcs_autotune.registry import lookup
from gcs_autotune.untrusted_text import quoted

__all__ = ["Commands"]

_REPLY = 1.5
_TRIES = 3
_IN_PROGRESS_PATIENCE = 10.0
_HEARTBEAT_PATIENCE = 3.5
"""Time to wait for a mode change [s]: three heartbeats, because it shows in the next one or not at all. Project
choice."""
_KNOWN = 2.0
"""Time [s] for four requests of a HEARTBEAT before an unanswered command is repeated. Project choice."""
_TEXT_DELAY = 0.5
"""Longest time [s] by which the STATUSTEXT that explains a rejection may follow the COMMAND_ACK. Project choice."""
_EXPLAINS = ("Arm:", "PreArm:")
_KEPT = 20
_COPIES = 5.0
"""Longest delay [s] of a duplicated command on any known link. Project choice."""


class Commands:
    """Commands to the vehicle.

    Parameters
    ----------
    session : a session whose vehicle is known.
    firmware : the firmware, which defines the mode names.

    Attributes
    ----------
    accepted_mode : number of the mode commanded last, if the vehicle accepted the command; else -1.
    """

    def __init__(self, session: Session, firmware: Firmware) -> None:
        self._session = session
        self._firmware = firmware
        self._ordered: deque[tuple[float, int]] = deque(maxlen=_KEPT)
        self._in_progress = -1
        self.accepted_mode = -1
        self._copies: deque[float] = deque(maxlen=_KEPT)
        session.listen("COMMAND_ACK", self._on_acknowledgement)

    def _on_acknowledgement(self, ack: Message) -> None:
        """Record an acknowledgement that no request is waiting for.

        It means that a copy of a mode command arrived late.
        """
        to_us = int(getattr(ack, "target_system", 0)) == self._session.port.system
        if to_us and ack.command == mavlink.MAV_CMD_DO_SET_MODE != self._in_progress:
            self._copies.append(self._session.clock.now())

    def has_ordered_mode(self, number: int, now: float) -> bool:
        """Return whether mode *number* was commanded so recently that a copy may still arrive (*now*: link time
        [s])."""
        return any(mode == number for t, mode in self._ordered if t >= now - _COPIES)

    def copy_arrived(self, number: int, now: float) -> bool:
        """Return whether the vehicle recently acknowledged one command of mode *number* twice (*now*: link time
        [s])."""
        return self.has_ordered_mode(number, now) and any(t >= now - _COPIES for t in self._copies)

    @property
    def mode(self) -> str:
        """Name of the vehicle's present flight mode."""
        return self._firmware.mode_name(self._session.custom_mode)

    def command_long(
        self,
        command: int,
        *values: float,
        timeout: float = _REPLY,
        tries: int = _TRIES,
        is_done: Callable[[], bool] = lambda: False,
    ) -> None:
        """Send COMMAND_LONG, repeated until it is answered. After ``IN_PROGRESS``, wait for the final answer.

        is_done : called before each repetition; True prevents it.

        Raises
        ------
        CommandDenied
            The answer is not "accepted"; ``result`` is the MAV_RESULT.
        NoReply
            No answer arrived.
        """
        self._command(command, lambda n: self._message(command, n, values), timeout, tries, is_done)

    def command_int(self, command: int, *values: float) -> None:
        """Send COMMAND_INT with the first four parameters; repetition and errors as for :meth:`command_long`."""
        vehicle = self._session.vehicle
        if vehicle is None:
            raise NoReply("a command was sent before a vehicle was discovered. Discover a vehicle first")
        params = [float(v) for v in values] + [0.0] * (4 - len(values))
        ids = vehicle.system, vehicle.component
        message = mavlink.MAVLink_command_int_message(*ids, 0, command, 0, 0, *params, 0, 0, 0.0)
        self._command(command, lambda n: message, _REPLY, _TRIES, lambda: False)

    def _command(
        self,
        command: int,
        message: Callable[[int], Message],
        timeout: float,
        tries: int,
        is_done: Callable[[], bool],
    ) -> None:
        answers: list[Message] = []
        stop = self._session.listen("COMMAND_ACK", lambda m: answers.append(m) if self._ours(m, command) else None)
        self._in_progress = command
        try:
            for confirmation in range(tries):
                if confirmation and is_done():
                    break
                self._session.send(message(confirmation))
                if self._session.wait_for(lambda: True if answers else None, timeout):
                    break
            result = self._final_result(answers, command, timeout * tries)
        finally:
            self._in_progress = -1
            stop()
        if result != mavlink.MAV_RESULT_ACCEPTED:
            raise CommandDenied(
                f"the vehicle answered {enum_name('MAV_CMD', command)} with {enum_name('MAV_RESULT', result)}"
                f"{self._message_since(self._session.clock.now() - _REPLY)}",
                command=command,
                result=result,
            )

    def _final_result(self, answers: list[Message], command: int, waited: float) -> int:
        while answers:
            result = int(answers[-1].result)
            if result != mavlink.MAV_RESULT_IN_PROGRESS:
                return result
            if not self._session.wait_for(partial(_longer, answers, len(answers)), _IN_PROGRESS_PATIENCE):
                raise NoReply(f"{enum_name('MAV_CMD', command)} started but did not finish. Try again")
        raise NoReply(
            f"no answer to {enum_name('MAV_CMD', command)} within {waited:g} s; "
            "check the losses of the link, and that the autopilot accepts this tool's system id"
        )

    def _ours(self, ack: Message, command: int) -> bool:
        addressed = int(getattr(ack, "target_system", 0))
        return bool(ack.command == command and addressed in (0, self._session.port.system))

    def _message(self, command: int, confirmation: int, values: Sequence[float]) -> Message:
        vehicle = self._session.vehicle
        if vehicle is None:
            raise NoReply("a command was sent before a vehicle was discovered. Discover a vehicle first")
        params = [float(v) for v in values] + [0.0] * (7 - len(values))
        return mavlink.MAVLink_command_long_message(vehicle.system, vehicle.component, command, confirmation, *params)

    # --- modes --------------------------------------------------------------------------------------------

    def set_mode(self, mode: str) -> None:
        """Change the flight mode and wait until a HEARTBEAT shows the new mode.

        Raises
        ------
        UnknownName
            The firmware has no mode of that name.
        ModeRefused
            The vehicle rejected the mode or did not change to it. The message contains its last status texts.
        """
        number = lookup(self._firmware.modes, mode, f"{self._firmware.name} mode")
        begun, before = self._session.clock.now(), self._session.custom_mode
        beats, self.accepted_mode = self._session.heartbeats, -1
        self._ordered.append((begun, number))
        values = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, float(number)
        try:
            # Not sent again once the mode has changed: it has arrived, or another station has ordered another one. Nor
            # where that cannot be known.
            self.command_long(
                mavlink.MAV_CMD_DO_SET_MODE,
                *values,
                is_done=lambda: not self._session.ask_state(_KNOWN) or self._session.custom_mode != before,
            )
        except NoReply:
            if self._session.custom_mode != number:
                raise
        except CommandDenied as error:
            self._session.pause(_TEXT_DELAY)
            raise ModeRefused(
                f"mode {mode} was rejected{self._message_since(begun)}. The vehicle stays in {self.mode}"
            ) from error
        else:
            self.accepted_mode = number
        taken = self._session.wait_for(
            lambda: True if self._session.custom_mode == number else None, _HEARTBEAT_PATIENCE
        )
        if not taken and self._session.heartbeats == beats:
            raise LinkLost(
                f"mode {mode} was accepted, but no HEARTBEAT arrived for {_HEARTBEAT_PATIENCE:g} s after that. Check "
                "the link"
            )
        if not taken:
            raise ModeRefused(
                f"mode {mode} was accepted, but the vehicle is in {self.mode}{self._message_since(begun)}"
            )

    # --- arming -------------------------------------------------------------------------------------------

    def arm(self) -> None:
        """Arm the vehicle and wait until a HEARTBEAT shows it as armed.

        Raises
        ------
        ArmingRefused
            The vehicle rejected the command; the message contains its reasons.
        """
        begun, count = self._session.clock.now(), self._session.texts.count
        try:
            self.command_long(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0, is_done=lambda: self._session.armed)
        except NoReply:
            if not self._session.armed:
                raise
        except CommandDenied as error:
            self._session.pause(_TEXT_DELAY)
            raise self._arming_refused(count, begun) from error
        if not self._session.wait_for(lambda: self._session.armed or None, _HEARTBEAT_PATIENCE):
            raise self._arming_refused(count, begun)

    def arm_patiently(self, patience: float, pause: float, check: Callable[[], None] = lambda: None) -> None:
        """Arm the vehicle. On rejection retry every *pause* [s] for *patience* [s], until the pre-arm checks pass.

        check : called before every attempt; an exception ends the attempts.

        Raises
        ------
        ArmingRefused
            The vehicle rejected the last attempt; the message contains its reasons.
        """
        deadline = Deadline.after(self._session.liveness, patience)
        while True:
            check()
            try:
                self.arm()
                return
            except ArmingRefused:
                if deadline.expired:
                    raise
                self._session.pause(pause)

    def disarm(self) -> None:
        """Disarm the vehicle and wait until a HEARTBEAT shows it as disarmed.

        Raises
        ------
        CommandDenied
            The vehicle rejected the command (it may be moving).
        """
        try:
            self.command_long(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, is_done=lambda: not self._session.armed)
        except NoReply:
            if self._session.armed:
                raise
        if not self._session.wait_for(lambda: None if self._session.armed else True, _HEARTBEAT_PATIENCE):
            raise CommandDenied(
                "the vehicle accepted the command to disarm but is still armed. Disarm it by hand",
                command=mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
                result=mavlink.MAV_RESULT_ACCEPTED,
            )

    def _arming_refused(self, count: int, begun: float) -> ArmingRefused:
        texts = [text.text for text in self._session.texts.since(count)]
        earlier = [text.text for text in self._session.texts]
        reasons = [t for t in texts if t.startswith(_EXPLAINS)] or texts
        reasons = reasons or [t for t in earlier if t.startswith(_EXPLAINS)][-3:]
        reasons = list(dict.fromkeys(reasons))
        why = quoted(reasons) or "no reason reported"
        return ArmingRefused(f"the vehicle does not arm: {why}. Fix this and try again", reasons=reasons)

    def _message_since(self, since: float) -> str:
        texts = self._session.texts.recent(since)
        return f" (its message: {quoted(texts)})" if texts else ""


def _longer(answers: Sequence[Message], count: int) -> bool | None:
    return True if len(answers) > count else None
