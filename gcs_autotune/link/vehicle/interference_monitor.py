"""Detect interference by others during a run, find its cause, and release the vehicle at once.

A change of mode or armed state that this program did not command ends the manoeuvre and is not undone. It counts as a
command of another operator unless something shows another cause. A missing acknowledgement shows nothing, because the
vehicle sends it only to the station that sent the command. Other causes and their signs are:

* of a restart: the vehicle's clock,
* of a late copy of our own order: a second acknowledgement,
* of a failsafe: its text, its action, and the time without overrides that its parameters require.

Another ground station may change our stream rates. The tool detects this, requests its rates again and reports it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from gcs_autotune.craft import Intervention
from gcs_autotune.errors import GuardTripped
from gcs_autotune.firmware import DISARMS, Firmware, SetFailsafe
from gcs_autotune.link.parameters.client import Parameters
from gcs_autotune.link.session import Session
from gcs_autotune.link.vehicle.commands import Commands
from gcs_autotune.link.vehicle.other_stations import OtherStations
from gcs_autotune.link.vehicle.rates import Rates
from gcs_autotune.link.vehicle.rc_monitor import RcMonitor
from gcs_autotune.link.vehicle.setpoint_streamer import SendRate
from gcs_autotune.link.vehicle.watchdog import Watchdog
from gcs_autotune.mavlink import Message, mavlink, message_number
from gcs_autotune.untrusted_text import quoted

__all__ = ["Evidence", "InterferenceMonitor", "RateKeeper"]

_LOOK_BACK = 5.0
"""Age [s] up to which a command may cause a change seen now; heartbeats show a mode a second late. Project choice."""
_OWN_CAUSE = "failsafe"
"""Word that the status text of every ArduPilot failsafe contains: "EKF failsafe", "Radio Failsafe", "Battery 1 low
failsafe"."""
_AHEAD = 1.5
"""Ratio of simulated to real time above which a simulation is reported as faster than real time."""
_SLACK = 0.3
"""Excess [s] by which a pause of ours may appear longer to the vehicle, because delays vary and a message may be lost.
Project choice."""
_LEAST_REPORTED = 0.4
"""Pause of ours [s of the vehicle's time] above which it is reported although it is not the cause. Project choice."""
_MODE_ORDERS = frozenset({"SET_MODE", "MAV_CMD_DO_SET_MODE", "MAV_CMD_NAV_RETURN_TO_LAUNCH", "MAV_CMD_MISSION_START"})
_ARM_ORDERS = frozenset({"MAV_CMD_COMPONENT_ARM_DISARM", "MAV_CMD_DO_FLIGHTTERMINATION"})
_STICK_ORDERS = frozenset({"RC_CHANNELS_OVERRIDE", "MANUAL_CONTROL"})
_MANY = 20
_LATE = 0.8
"""Round trip [s] below which commands take effect within the usual waiting time. Project choice."""
_MIDDLE, _DEFLECTED = 1500, 50
"""PWM of a centred stick [us], and the deflection from it [us] above which the stick counts as moved. Project
choice."""
_ANSWER = 2.5
"""Time [s] for two TIMESYNC requests, one a second. Late or missing answers show a delayed link. Project choice."""


@dataclass(frozen=True, slots=True)
class _Change:
    """A change not commanded by us: its text, the commands that cause it, and the failsafe actions that result in
    it."""

    what: str
    kinds: frozenset[str]
    guard: str
    outcome: str
    mode: int


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """Observations that show what changed the vehicle: other stations, the RC sticks, gaps in our sending, and
    restarts.
    """

    other_stations: OtherStations
    rc_monitor: RcMonitor
    send_rate: SendRate
    watchdog: Watchdog


class InterferenceMonitor:
    """The expected state of the vehicle while we control it, compared at every tick.

    Parameters
    ----------
    let_go : sets the sticks to neutral if we control them; called before any wait.

    Attributes
    ----------
    failsafes : the failsafes for loss of our messages, as set by this vehicle's parameters.
    lateness : present delay of the link's answers [s].
    on_yield : called with the mode or armed state that another operator has commanded.
    modes : custom mode numbers to expect: that of the last command, and the previous mode until the command is
    confirmed.
    armed : whether the vehicle is expected to be armed; None while we are arming or disarming.
    is_ours : whether we control the vehicle.
    found : the first change not commanded by us; None if there is none.
    """

    def __init__(
        self,
        session: Session,
        firmware: Firmware,
        parameters: Parameters,
        commands: Commands,
        evidence: Evidence,
        *,
        let_go: Callable[[], None] = lambda: None,
    ) -> None:
        self._session = session
        self._firmware = firmware
        self._parameters = parameters
        self._commands = commands
        self._other_stations, self._rc_monitor = evidence.other_stations, evidence.rc_monitor
        self._send_rate, self._watchdog = evidence.send_rate, evidence.watchdog
        self.failsafes: Sequence[SetFailsafe] = ()
        self.lateness: Callable[[], float] = lambda: 0.0
        self.on_yield: Callable[[Mapping[str, Any]], None] = lambda what: None
        self._let_go = let_go
        self._guard = ""
        self._unanswered: set[int] = set()
        self.modes: frozenset[int] = frozenset()
        self.armed: bool | None = None
        self.is_ours = False
        self.found: Intervention | None = None

    def take_over(self) -> None:
        """Start monitoring. Expect the present state until we command a change."""
        if not self.is_ours:
            self.is_ours = True
            self.accept()

    def accept(self) -> None:
        """Accept the present mode and armed state as the expected ones, whatever changed them."""
        self.modes, self.armed, self.found = frozenset({self._session.custom_mode}), self._session.armed, None

    def give_back(self) -> None:
        """Stop monitoring mode and armed state."""
        self.is_ours, self.modes, self.armed, self.found = False, frozenset(), None, None

    def order_mode(self, number: int) -> None:
        """Expect the present mode or mode *number* until our command of the latter is confirmed."""
        self.modes = frozenset({*self.modes, number}) if self.is_ours else frozenset()

    def doubt_mode(self, number: int, before: frozenset[int]) -> None:
        """Expect mode *number* and the mode *before*, because our command of *number* was not answered."""
        if self.is_ours:
            self.modes = before
            self._unanswered.add(number)

    def confirm_mode(self, number: int) -> None:
        """Expect only mode *number*, because our command of it was accepted."""
        self._unanswered.clear()
        self.modes = frozenset({number}) if self.is_ours else frozenset()

    def look(self) -> Intervention | None:
        """Return the first change of mode or armed state not commanded by us, according to the last heartbeat.

        On its first detection the sticks are set to neutral. Then, for about a second, two more heartbeats, the
        vehicle's clock and its status texts are awaited to identify the cause.

        Raises
        ------
        TelemetryFault
            The vehicle's heartbeats contradict each other. LinkLost: no heartbeat arrived.
        """
        if self.is_ours and self.found is None and self._changes():
            self._let_go()
            seen = self._session.clock.now()
            self._session.request_message(message_number("SYSTEM_TIME"))
            self._session.await_heartbeat()
            judged = [self._judge(change, seen) for change in self._changes()]
            if judged:
                self._take(judged)
        return self.found

    def yield_to(self, what: str) -> None:
        """Record that an operator has taken the craft by its sticks: its mode and armed state stay."""
        self._let_go()
        self.found = Intervention(what, mode_stands=True, armed_stands=True)
        self.on_yield({"mode": self._firmware.mode_name(self._session.custom_mode), "armed": self._session.armed})

    def _take(self, judged: Sequence[tuple[str, Intervention]]) -> None:
        """Record the *judged* change. A failsafe may disarm the vehicle just when another station commands a mode."""
        self._guard, intervention = max(judged, key=lambda j: j[1].stands)
        self.found = replace(
            intervention,
            mode_stands=any(each.mode_stands for _, each in judged),
            armed_stands=any(each.armed_stands for _, each in judged),
            may_go_on=all(each.may_go_on for _, each in judged),
        )
        if self.found.stands and not self.found.may_go_on:
            mode = {"mode": self._firmware.mode_name(self._session.custom_mode)} if self.found.mode_stands else {}
            self.on_yield({**mode, **({"armed": self._session.armed} if self.found.armed_stands else {})})

    def check_state(self) -> None:
        """Raise an error for the change that :meth:`look` detects, if any.

        Raises
        ------
        TelemetryFault
            The autopilot has restarted.
        GuardTripped
            Another station, a failsafe or a late copy changed mode or armed state; the message states which.
        """
        change = self.look()
        if change is not None:
            if self._watchdog.has_restarted:
                self._watchdog.check()
            raise GuardTripped(change.what, guard=self._guard)

    def check(self) -> None:
        """Raise an error if mode or armed state, or sticks or parameters that we control, were changed by others."""
        self._check_parameters()
        self.check_state()
        self._check_sticks()

    def _check_parameters(self) -> None:
        if self._parameters.intrusions:
            name, old, new = self._parameters.intrusions[0]
            raise GuardTripped(
                f"another ground station wrote {name} = {new:g} (it was {old:g}): "
                f"{self._who(frozenset({'PARAM_SET'}), name)}. Disconnect that station and start again",
                guard="parameters",
                value=new,
                limit=old,
            )

    def _changes(self) -> list[_Change]:
        changes = []
        now, armed = self._session.custom_mode, self._session.armed
        if self.armed is not None and armed != self.armed:
            what = f"the vehicle was {'armed' if armed else 'disarmed'}"
            changes.append(_Change(what, _ARM_ORDERS, "armed", "" if armed else DISARMS, now))
        if self.modes and now not in self.modes:
            expected = " or ".join(sorted(self._firmware.mode_name(mode) for mode in self.modes))
            name = self._firmware.mode_name(now)
            changes.append(_Change(f"the vehicle went from {expected} to {name}", _MODE_ORDERS, "mode", name, now))
        return changes

    def _judge(self, change: _Change, seen: float) -> tuple[str, Intervention]:
        """Return the guard and the intervention for a *change* first *seen* at that link time [s]."""
        if self._watchdog.has_restarted:
            return "restart", Intervention(str(self._watchdog.fault), mode_stands=False, armed_stands=False)
        if change.guard == "mode" and self._commands.copy_arrived(change.mode, seen):
            what = f"{change.what}: a late copy of this tool's own command (the vehicle answered it twice)"
            return "mode", Intervention(what, mode_stands=False, armed_stands=False)
        named = self._named(change)
        want = self._want_of_overrides(change)
        if want is not None:
            failsafe, gap, cause, cure = want
            acts = f"its {failsafe.name} does this after {failsafe.needs:g} s without overrides"
            what = f"{change.what}{self._last_words()}: {cause}, and {acts}"
            if named is not None:
                what += f". {cure}" if cure else ""
                return "pause" if cure else "failsafe", Intervention(
                    what,
                    mode_stands=False,
                    armed_stands=False,
                    may_go_on=True,
                    failsafe=failsafe.name,
                    has_reported=True,
                )
            what += ". The vehicle did not report a failsafe, so another station may have ordered this"
            return change.guard, Intervention(
                what,
                mode_stands=change.guard == "mode",
                armed_stands=False,
                is_certain=False,
                may_go_on=gap > 0.0,
                failsafe=failsafe.name,
            )
        unanswered = change.guard == "mode" and change.mode in self._unanswered
        certain = not unanswered and not (change.guard == "mode" and self._commands.has_ordered_mode(change.mode, seen))
        copy = "" if certain else ", unless it was a late copy of this tool's own command"
        if unanswered:
            copy = ", unless it was this tool's own command, which the vehicle never answered"
        pause = self._longest_pause()
        short = (
            f" (this computer's pause of {pause:.2g} s is not the cause: no failsafe acts after so short a pause)"
            if pause > _LEAST_REPORTED and not self._is_own_cause()
            else ""
        )
        lost = self._lost_on_the_way(named, change)
        who = lost or self._who(change.kinds)
        what = f"{change.what}, not by this tool{self._last_words()}: {who}{copy}{short}"
        by_mode = change.guard == "mode"
        return change.guard, Intervention(
            what,
            mode_stands=by_mode,
            armed_stands=not by_mode and self._session.armed,
            is_certain=certain,
            may_go_on=unanswered,
            failsafe=named.name if lost and named is not None else "",
            has_reported=bool(lost),
        )

    def _named(self, change: _Change) -> SetFailsafe | None:
        """Return the failsafe for missing overrides whose status text was received and that results in this
        *change*."""
        texts = [text.casefold() for text in self._recent_texts()]
        return next((f for f in self._fitting(change) if any(f.says in text for text in texts)), None)

    def _fitting(self, change: _Change) -> list[SetFailsafe]:
        has_receiver = bool(self._rc_monitor.has_receiver)
        return [f for f in self.failsafes if change.outcome in f.outcomes and not (f.by_overrides and has_receiver)]

    def _lost_on_the_way(self, named: SetFailsafe | None, change: _Change) -> str:
        """Return a sentence if the failsafe *named* was reported although we kept sending; empty if another cause
        fits."""
        since = self._session.clock.now() - _LOOK_BACK
        if named is None or self._other_stations.has_ordered(change.kinds, since):
            return ""
        lacks = "overrides" if named.by_overrides else "a heartbeat of this tool"
        return (
            f"it reports its {named.name}, which does this after {named.needs:g} s without {lacks}. This computer "
            f"paused for {self._longest_pause():.1f} s at most, so its messages were lost on the link. Use a better "
            "link. It is also possible that another station ordered this"
        )

    def _want_of_overrides(self, change: _Change) -> tuple[SetFailsafe, float, str, str] | None:
        """Return (failsafe, seconds without overrides, reason, remedy) if that time was long enough to trigger it."""
        pause, pace = self._longest_pause(), max(self._send_rate.pace, 1.0)
        silence = self._session.liveness.longest(_LOOK_BACK + self._session.liveness.actual_silence) * pace
        gap = max(pause, silence)
        for failsafe in self._fitting(change):
            if gap + _SLACK < failsafe.needs:
                continue
            if pause + _SLACK < failsafe.needs:
                return failsafe, gap, f"the link was silent for {silence:.1f} s", ""
            ran = f", {pause:.1f} s of the vehicle's time," if pace > _AHEAD else ""
            cure = "Close other programs"
            if pace > _AHEAD:
                cure = f"The simulation ran at {pace:.1f} times real time. {cure}, or reduce its speed-up if it has one"
            cause = f"this computer paused for {pause / pace:.2g} s{ran} without sending overrides"
            return failsafe, gap, cause, cure
        return None

    def _longest_pause(self) -> float:
        """Longest recent pause between two overrides [s of the vehicle's time]."""
        since = self._session.clock.now() - _LOOK_BACK
        return self._send_rate.pause_since(since) * max(self._send_rate.pace, 1.0)

    def _check_sticks(self) -> None:
        departed = self._rc_monitor.departed
        if departed is not None:
            channel, sent, shown = departed
            self._check_late(channel, sent, shown)
            raise GuardTripped(
                f"overrides of another sender are active: RC channel {channel} shows {shown} us, but {sent} us were "
                f"sent{self._last_words()}: {self._who(_STICK_ORDERS)}. Unplug other joysticks. If there are none, the "
                "overrides of this tool do not reach the vehicle: check the link",
                guard="sticks",
                value=float(shown),
                limit=float(sent),
            )
        moved = self._rc_monitor.moved_by_hand
        if moved is not None:
            raise GuardTripped(
                f"the sticks were moved: RC channel {moved[0]}, which this tool does not drive, went from {moved[1]} "
                f"to {moved[2]} us: {self._whose_stick()}. Do not touch the transmitter or joysticks while this tool "
                f"steers",
                guard="sticks",
                value=float(moved[2]),
                limit=float(moved[1]),
            )

    def _check_late(self, channel: int, sent: int, shown: int) -> None:
        """Raise ``GuardTripped`` (guard ``late``) if our commands arrive late; the sticks are then neutral.

        A late copy of our own deflection shows that the link had stalled, even if it is fast again, because no other
        station deflects a stick exactly as we did. A centred stick proves nothing.
        """
        if not self._rc_monitor.was_sent(channel, shown):
            return
        self._let_go()
        late = self._session.wait_for(lambda: self.lateness() if self.lateness() > _LATE else None, _ANSWER)
        if late is None and abs(shown - _MIDDLE) <= _DEFLECTED:
            return
        least = self._rc_monitor.memory if late is None else late
        still = "the link or the vehicle stalled for" if late is None else "the link's delay is"
        raise GuardTripped(
            f"commands of this tool arrive late: RC channel {channel} shows {shown} us, an earlier value, instead of "
            f"{sent} us, and {still} {least:.1f} s or more. Use a faster link, or wait",
            guard="late",
            value=least,
            limit=_LATE,
        )

    def _whose_stick(self) -> str:
        """Return a sentence on who moved a stick that we do not drive."""
        steering = self._other_stations.steering
        if steering is not None and steering.is_receiver:
            return "a pilot, since the vehicle reports that its own RC receiver steers it (MANUAL_INPUT_STATUS)"
        since = self._session.clock.now() - _LOOK_BACK
        if self._other_stations.has_ordered(_STICK_ORDERS, since) or not self._rc_monitor.has_receiver:
            return f"overrides of another sender ({self._other_stations.culprit(_STICK_ORDERS, since)})"
        own = self._session.port.system
        return f"its RC transmitter, or overrides of another station with system id {own}"

    def _who(self, kinds: frozenset[str], name: str = "") -> str:
        since = self._session.clock.now() - _LOOK_BACK
        ordered = self._other_stations.has_ordered(kinds, since)
        moved = self._rc_monitor.moved_by_hand
        if moved is not None and not name and not ordered:
            return (
                f"RC channel {moved[0]} went from {moved[1]} to {moved[2]} us, by a switch of the "
                "transmitter, or by overrides of another sender"
            )
        if self._is_own_cause() and not name and not ordered:
            return "the vehicle's own failsafe did this. Fix its cause and start again"
        return self._other_stations.culprit(kinds, since, name)

    def _is_own_cause(self) -> bool:
        words = (_OWN_CAUSE, *(failsafe.says for failsafe in self.failsafes))
        return any(word in text.casefold() for text in self._recent_texts() for word in words)

    def _recent_texts(self) -> list[str]:
        return self._session.texts.recent(self._session.clock.now() - _LOOK_BACK, at_most=_MANY)

    def _last_words(self) -> str:
        texts = self._session.texts.recent(self._session.clock.now() - _LOOK_BACK)
        return f" (its message: {quoted(texts)})" if texts else ""


_VITAL = ("ATTITUDE", "SERVO_OUTPUT_RAW", "RC_CHANNELS")
_WINDOW = 2.0
"""Counting window [s of the vehicle's time], long enough to distinguish a lost message from a changed rate. Project
choice."""
_LOW = 0.6
"""Fraction of the rate at the handshake below which it is requested again. Project choice."""
_REQUESTS = frozenset({"REQUEST_DATA_STREAM", "MAV_CMD_SET_MESSAGE_INTERVAL"})
_RATES_LOOK_BACK = 10.0


class RateKeeper:
    """Monitors the rates of essential messages and requests them again after a drop.

    Call :meth:`start` once the rates are known.
    """

    def __init__(self, session: Session, rates: Rates, other_stations: OtherStations) -> None:
        self._session = session
        self._rates = rates
        self._other_stations = other_stations
        self._counts: Counter[str] = Counter()
        self._stamp = self._begun = 0.0
        self._noted: set[str] = set()

    def start(self) -> None:
        """Start monitoring the message rates measured last."""
        for name in _VITAL:
            self._session.listen(name, partial(self._on_message, name))
        self._session.every(1.0, self._look)

    def _on_message(self, name: str, m: Message) -> None:
        self._counts[name] += 1
        if name != "SERVO_OUTPUT_RAW":  # its stamp is in microseconds, and wraps
            self._stamp = m.time_boot_ms * 1e-3

    def _look(self) -> None:
        span = self._stamp - self._begun
        if 0.0 <= span < _WINDOW:
            return
        if span <= 5.0 * _WINDOW and self._begun > 0.0:
            self._judge({name: self._counts[name] / span for name in _VITAL})
        self._counts.clear()
        self._begun = self._stamp

    def _judge(self, rates: Mapping[str, float]) -> None:
        thin = {}
        for name, rate in rates.items():
            granted, usual = self._rates.granted.get(name), self._rates.measured.get(name, 0.0)
            if granted is not None and granted.granted > 0.0 and rate < _LOW * usual:
                self._ask_again(name, granted.granted)
                thin[name] = f"{name} at {rate:.1f} Hz instead of {usual:.1f}"
        if set(thin) - self._noted:
            self._noted |= set(thin)
            who = self._other_stations.culprit(_REQUESTS, self._session.clock.now() - _RATES_LOOK_BACK)
            self._session.notes.append(
                f"message rates were low and were requested again: {', '.join(thin.values())}. Messages were lost, "
                f"or another station requested other rates ({who})"
            )

    def _ask_again(self, name: str, rate: float) -> None:
        vehicle = self._session.vehicle
        if vehicle is not None:
            wanted = (float(message_number(name)), 1e6 / rate, 0.0, 0.0, 0.0, 0.0, 0.0)
            command = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
            self._session.send(
                mavlink.MAVLink_command_long_message(vehicle.system, vehicle.component, command, 0, *wanted)
            )
