"""Detect interference by others while we control the vehicle: find the cause, and release the vehicle at once.

A change of mode or armed state that we did not order ends what is flown, and nothing here undoes it. An
acknowledgement goes only to the station that ordered, so that no other station is heard proves nothing. What did not
come from another operator must be shown: a restart by the vehicle's clock; a late copy of our own order by a second
answer to it; a failsafe by its text, by the time without overrides that its parameters demand, and by what it does.

Another ground station that asks for its own stream rates changes ours: that is noticed, asked for again, and said.
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
"""Age up to which an order may cause a change seen now [s]; heartbeats show a mode a second late. Chosen."""
_OWN_CAUSE = "failsafe"
"""Word in the text of each failsafe of ArduPilot: "EKF failsafe", "Radio Failsafe", "Battery 1 low failsafe"."""
_AHEAD = 1.5
"""Relative pace above which a simulation is reported to run faster than the clock."""
_SLACK = 0.3
"""How much longer a pause of ours may appear to the vehicle [s]: delays vary and one message may be lost. Chosen."""
_LEAST_REPORTED = 0.4
"""Pause of ours that is reported although it is not the cause [s of the vehicle's time]. Chosen."""
_MODE_ORDERS = frozenset({"SET_MODE", "MAV_CMD_DO_SET_MODE", "MAV_CMD_NAV_RETURN_TO_LAUNCH", "MAV_CMD_MISSION_START"})
_ARM_ORDERS = frozenset({"MAV_CMD_COMPONENT_ARM_DISARM", "MAV_CMD_DO_FLIGHTTERMINATION"})
_STICK_ORDERS = frozenset({"RC_CHANNELS_OVERRIDE", "MANUAL_CONTROL"})
_MANY = 20
_LATE = 0.8
"""Round trip below which our commands show within the usual waiting time [s]. Chosen."""
_MIDDLE, _DEFLECTED = 1500, 50
"""Deflection below which a stick may be at rest, and above which it counts as moved [us]. Chosen."""
_ANSWER = 2.5
"""Time for two TIMESYNC requests, one a second [s]; their answers, or none, show a late link. Chosen."""


@dataclass(frozen=True, slots=True)
class _Change:
    """A change not ordered by us: in words, orders that cause it, and failsafe actions that end in it."""

    what: str
    kinds: frozenset[str]
    guard: str
    outcome: str
    mode: int


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """What shows who changed the vehicle: other stations, the RC sticks, how regularly we sent, restarts."""

    other_stations: OtherStations
    rc_monitor: RcMonitor
    send_rate: SendRate
    watchdog: Watchdog


class InterferenceMonitor:
    """The expected state of the vehicle while we control it, compared at every tick.

    Parameters
    ----------
    let_go : makes the sticks neutral, if they are in our hands; called before anything is waited for.

    Attributes
    ----------
    failsafes : those that act when nothing is heard of us, as this vehicle's parameters set them.
    lateness : how late the link's answers are now [s].
    on_yield : called with the mode or armed state that another operator has ordered.
    modes : custom mode numbers that may be seen: of what we ordered last, and of before while that is not confirmed.
    armed : whether it is expected to be armed, None while that is just being changed by us.
    is_ours : whether the vehicle is in our hands.
    found : the first change that we did not order, None while there is none.
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
        """Start monitoring: expect the present state until we order a change."""
        if not self.is_ours:
            self.is_ours = True
            self.accept()

    def accept(self) -> None:
        """Accept the present state, whatever caused it."""
        self.modes, self.armed, self.found = frozenset({self._session.custom_mode}), self._session.armed, None

    def give_back(self) -> None:
        """Stop monitoring."""
        self.is_ours, self.modes, self.armed, self.found = False, frozenset(), None, None

    def order_mode(self, number: int) -> None:
        """Expect either mode until our order of mode *number* is confirmed."""
        self.modes = frozenset({*self.modes, number}) if self.is_ours else frozenset()

    def doubt_mode(self, number: int, before: frozenset[int]) -> None:
        """Our order of mode *number* was not answered: keep expecting the mode *before*, too."""
        if self.is_ours:
            self.modes = before
            self._unanswered.add(number)

    def confirm_mode(self, number: int) -> None:
        """Our order of mode *number* was accepted: expect only that mode."""
        self._unanswered.clear()
        self.modes = frozenset({number}) if self.is_ours else frozenset()

    def look(self) -> Intervention | None:
        """Return the first change of mode or armed state not ordered by us, by the last heartbeat.

        At its first detection the sticks are set to neutral. Then two more heartbeats, the vehicle's clock and its
        texts are awaited, about a second: they identify the cause.

        Raises
        ------
        TelemetryFault
            Its heartbeats contradict each other. LinkLost: there are none.
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

    def _take(self, judged: Sequence[tuple[str, Intervention]]) -> None:
        """Record what was *judged*: a failsafe may disarm it just when another station orders a mode."""
        self._guard, told = max(judged, key=lambda j: j[1].stands)
        self.found = replace(
            told,
            mode_stands=any(each.mode_stands for _, each in judged),
            armed_stands=any(each.armed_stands for _, each in judged),
            may_go_on=all(each.may_go_on for _, each in judged),
        )
        if self.found.stands and not self.found.may_go_on:
            mode = {"mode": self._firmware.mode_name(self._session.custom_mode)} if self.found.mode_stands else {}
            self.on_yield({**mode, **({"armed": self._session.armed} if self.found.armed_stands else {})})

    def check_state(self) -> None:
        """Raise the result of :meth:`look`.

        Raises
        ------
        TelemetryFault
            The autopilot has restarted.
        GuardTripped
            Another station, a failsafe or a late copy changed mode or armed state; the message says which.
        """
        found = self.look()
        if found is not None:
            if self._watchdog.has_restarted:
                self._watchdog.check()
            raise GuardTripped(found.what, guard=self._guard)

    def check(self) -> None:
        """Check mode and armed state, and the sticks and parameters under our control."""
        self._check_parameters()
        self.check_state()
        self._check_sticks()

    def _check_parameters(self) -> None:
        if self._parameters.intrusions:
            name, old, new = self._parameters.intrusions[0]
            raise GuardTripped(
                f"another ground station wrote {name} = {new:g} (it was {old:g}): "
                f"{self._who(frozenset({'PARAM_SET'}), name)}. Disconnect it and start again",
                guard="parameters",
                value=new,
                limit=old,
            )

    def _changes(self) -> list[_Change]:
        found = []
        now, armed = self._session.custom_mode, self._session.armed
        if self.armed is not None and armed != self.armed:
            what = f"the vehicle was {'armed' if armed else 'disarmed'}"
            found.append(_Change(what, _ARM_ORDERS, "armed", "" if armed else DISARMS, now))
        if self.modes and now not in self.modes:
            expected = " or ".join(sorted(self._firmware.mode_name(mode) for mode in self.modes))
            name = self._firmware.mode_name(now)
            found.append(_Change(f"the vehicle went from {expected} to {name}", _MODE_ORDERS, "mode", name, now))
        return found

    def _judge(self, change: _Change, seen: float) -> tuple[str, Intervention]:
        """Return the guard and the intervention for a *change* first *seen* at that link time [s]."""
        if self._watchdog.has_restarted:
            return "restart", Intervention(str(self._watchdog.fault), mode_stands=False, armed_stands=False)
        if change.guard == "mode" and self._commands.copy_arrived(change.mode, seen):
            what = f"{change.what}: a late copy of our own command (the vehicle answered it twice)"
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
                    what, mode_stands=False, armed_stands=False, may_go_on=True
                )
            what += ". The vehicle did not report it, so another station may have ordered it"
            return change.guard, Intervention(
                what, mode_stands=change.guard == "mode", armed_stands=False, is_certain=False, may_go_on=gap > 0.0
            )
        unanswered = change.guard == "mode" and change.mode in self._unanswered
        certain = not unanswered and not (change.guard == "mode" and self._commands.has_ordered_mode(change.mode, seen))
        copy = "" if certain else ", unless it was a late copy of our own command"
        if unanswered:
            copy = ", unless it was our own command, which was never answered"
        pause = self._longest_pause()
        short = (
            f" (this computer's pause of {pause:.2g} s is not the cause: no failsafe does this after it)"
            if pause > _LEAST_REPORTED and not self._is_own_cause()
            else ""
        )
        who = self._lost_on_the_way(named, change) or self._who(change.kinds)
        what = f"{change.what}, not by us{self._last_words()}: {who}{copy}{short}"
        by_mode = change.guard == "mode"
        return change.guard, Intervention(
            what,
            mode_stands=by_mode,
            armed_stands=not by_mode and self._session.armed,
            is_certain=certain,
            may_go_on=unanswered,
        )

    def _named(self, change: _Change) -> SetFailsafe | None:
        """Return the failsafe for missing overrides whose text was received and that ends in this *change*."""
        said = [text.casefold() for text in self._recent_texts()]
        return next((f for f in self._fitting(change) if any(f.says in text for text in said)), None)

    def _fitting(self, change: _Change) -> list[SetFailsafe]:
        has_receiver = bool(self._rc_monitor.has_receiver)
        return [f for f in self.failsafes if change.outcome in f.outcomes and not (f.by_overrides and has_receiver)]

    def _lost_on_the_way(self, named: SetFailsafe | None, change: _Change) -> str:
        """Return in words that the failsafe *named* itself although we kept sending; empty if another cause fits."""
        since = self._session.clock.now() - _LOOK_BACK
        if named is None or self._other_stations.has_ordered(change.kinds, since):
            return ""
        lacks = "overrides" if named.by_overrides else "a heartbeat of ours"
        return (
            f"it reports its {named.name}, which does this after {named.needs:g} s without {lacks}. This computer "
            f"paused for {self._longest_pause():.1f} s at most, so its messages were lost on the way. Use a better "
            "link. Another station may have ordered the same"
        )

    def _want_of_overrides(self, change: _Change) -> tuple[SetFailsafe, float, str, str] | None:
        """Return (failsafe, seconds without overrides, reason, remedy) if that time was long enough for it."""
        pause, pace = self._longest_pause(), max(self._send_rate.pace, 1.0)
        silence = self._session.liveness.longest(_LOOK_BACK + self._session.liveness.actual_silence) * pace
        gap = max(pause, silence)
        for failsafe in self._fitting(change):
            if gap + _SLACK < failsafe.needs:
                continue
            if pause + _SLACK < failsafe.needs:
                return failsafe, gap, f"the link was silent for {silence:.1f} s", ""
            ran = f", {pause:.1f} s of the vehicle's time," if pace > _AHEAD else ""
            cure = "Let the simulation run slower" if pace > _AHEAD else "Close other programs"
            cause = f"this computer paused for {pause / pace:.2g} s{ran} without sending overrides"
            return failsafe, gap, cause, f"{cure}, and try again"
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
                f"overrides other than ours are active: RC channel {channel} shows {shown} us, but {sent} us were "
                f"sent{self._last_words()}: {self._who(_STICK_ORDERS)}. Unplug other joysticks. If there are none, our "
                "overrides do not reach the vehicle",
                guard="sticks",
                value=float(shown),
                limit=float(sent),
            )
        moved = self._rc_monitor.moved_by_hand
        if moved is not None:
            raise GuardTripped(
                f"the sticks were moved: RC channel {moved[0]}, which this tool does not drive, went from {moved[1]} "
                f"to {moved[2]} us: {self._whose_stick()}. Do not touch transmitter and joysticks while this tool "
                f"steers",
                guard="sticks",
                value=float(moved[2]),
                limit=float(moved[1]),
            )

    def _check_late(self, channel: int, sent: int, shown: int) -> None:
        """Raise ``GuardTripped`` (guard ``late``) if our own commands arrive late; the sticks are neutral then.

        If the link is prompt again it had stalled, because no other station deflects a stick exactly as we did. A stick
        in the middle proves nothing.
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
            f"our own commands arrive late: RC channel {channel} shows {shown} us, an earlier value, instead of "
            f"{sent} us, and {still} {least:.1f} s or more. Use a faster link, or wait",
            guard="late",
            value=least,
            limit=_LATE,
        )

    def _whose_stick(self) -> str:
        """Return in words who moved a stick that we do not drive."""
        steering = self._other_stations.steering
        if steering is not None and steering.is_receiver:
            return "a pilot, since the vehicle reports that its own RC receiver steers it (MANUAL_INPUT_STATUS)"
        since = self._session.clock.now() - _LOOK_BACK
        if self._other_stations.has_ordered(_STICK_ORDERS, since) or not self._rc_monitor.has_receiver:
            return f"overrides other than ours ({self._other_stations.culprit(_STICK_ORDERS, since)})"
        own = self._session.port.system
        return f"its RC transmitter, or overrides of another station with system id {own}"

    def _who(self, kinds: frozenset[str], name: str = "") -> str:
        since = self._session.clock.now() - _LOOK_BACK
        ordered = self._other_stations.has_ordered(kinds, since)
        moved = self._rc_monitor.moved_by_hand
        if moved is not None and not name and not ordered:
            return (
                f"RC channel {moved[0]} went from {moved[1]} to {moved[2]} us, by a switch of the "
                "transmitter, or overrides other than ours"
            )
        if self._is_own_cause() and not name and not ordered:
            return "it was the vehicle's own failsafe. Fix its cause, and start again"
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
"""Counting window: long enough to distinguish a lost message from a changed rate [s of the vehicle's time]. Chosen."""
_LOW = 0.6
"""Share of the rate at the handshake below which it is requested again. Chosen."""
_REQUESTS = frozenset({"REQUEST_DATA_STREAM", "MAV_CMD_SET_MESSAGE_INTERVAL"})
_RATES_LOOK_BACK = 10.0


class RateKeeper:
    """Monitor of essential message rates; requests them again on a drop. Call :meth:`start` once rates are known."""

    def __init__(self, session: Session, rates: Rates, other_stations: OtherStations) -> None:
        self._session = session
        self._rates = rates
        self._other_stations = other_stations
        self._counts: Counter[str] = Counter()
        self._stamp = self._begun = 0.0
        self._noted: set[str] = set()

    def start(self) -> None:
        """Start keeping the rates measured last."""
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
                f"low rates for a while, requested again: {', '.join(thin.values())}. Messages were lost, or another "
                f"station requested other rates ({who})"
            )

    def _ask_again(self, name: str, rate: float) -> None:
        vehicle = self._session.vehicle
        if vehicle is not None:
            wanted = (float(message_number(name)), 1e6 / rate, 0.0, 0.0, 0.0, 0.0, 0.0)
            command = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
            self._session.send(
                mavlink.MAVLink_command_long_message(vehicle.system, vehicle.component, command, 0, *wanted)
            )
