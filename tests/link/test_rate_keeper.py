"""Interference causes and falling message rates, on a minimal session."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_autotune.clock import ManualClock
from gcs_autotune.errors import GuardTripped
from gcs_autotune.firmware import FIRMWARE, SetFailsafe
from gcs_autotune.link.vehicle.interference_monitor import Evidence, InterferenceMonitor, RateKeeper

VITAL = ("ATTITUDE", "SERVO_OUTPUT_RAW", "RC_CHANNELS")


class Kept:
    """A rate keeper and what it does; the vehicle's time and ours are the same from *begun* [s] on."""

    def __init__(self, begun: float = 100.0, granted: dict[str, float] | None = None) -> None:
        self.clock = ManualClock(begun)
        self.notes: list[str] = []
        self.sent: list[Any] = []
        self.told: dict[str, Any] = {}
        self.blamed: list[tuple[frozenset[str], float]] = []
        self.look: Callable[[], None] = lambda: None
        session: Any = SimpleNamespace(
            clock=self.clock, notes=self.notes, send=self.sent.append, listen=self.told.__setitem__, every=self.every,
            vehicle=SimpleNamespace(system=7, component=2),
        )  # fmt: skip
        self.session = session
        usual = {"ATTITUDE": 10.0, "SERVO_OUTPUT_RAW": 5.0, "RC_CHANNELS": 5.0} if granted is None else granted
        rates: Any = SimpleNamespace(
            granted={n: SimpleNamespace(granted=2.0 * f) for n, f in usual.items()},
            measured={n: f for n, f in usual.items() if f},
        )
        others: Any = SimpleNamespace(culprit=lambda kinds, since: self.blamed.append((kinds, since)) or "nobody")
        self.keeper = RateKeeper(session, rates, others)
        self.keeper.start()

    def every(self, period: float, look: Callable[[], None]) -> None:
        assert period == 1.0
        self.look = look

    def pass_by(self, seconds: float, **rates: float) -> list[str]:
        """Let seconds pass with so many messages a second; return the messages requested again."""
        before = len(self.sent)
        begun = self.clock.now()
        for step in range(round(20.0 * seconds)):
            now = begun + 0.05 * (step + 1)
            self.clock.advance_to(now)
            for name, rate in rates.items():
                if int(rate * (now - begun) + 1e-6) > int(rate * (now - begun - 0.05) + 1e-6):
                    stamp = 5 if name == "SERVO_OUTPUT_RAW" else round(1e3 * now)
                    self.told[name](SimpleNamespace(time_boot_ms=stamp))
            if step % 20 == 19:
                self.look()
        names = {m.param1: m for m in self.sent[before:]}
        assert all((m.target_system, m.target_component) == (7, 2) for m in names.values())
        assert all(m.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL for m in names.values())
        return [{30.0: "ATTITUDE", 36.0: "SERVO_OUTPUT_RAW", 65.0: "RC_CHANNELS"}[number] for number in names]


ALL = {"ATTITUDE": 10.0, "SERVO_OUTPUT_RAW": 5.0, "RC_CHANNELS": 5.0}


@pytest.mark.parametrize("name", VITAL)
@pytest.mark.parametrize(("share", "thin"), [(0.5, True), (0.7, False), (1.0, False)])
def test_a_message_below_three_fifths_of_its_rate_is_requested_again(name: str, share: float, thin: bool) -> None:
    kept = Kept()
    assert kept.pass_by(4.0, **ALL) == []
    requested = kept.pass_by(10.0, **{**ALL, name: share * ALL[name]})
    assert set(requested) == ({name} if thin else set())
    if thin:
        assert kept.sent[0].param2 == pytest.approx(1e6 / (2.0 * ALL[name])), "at the rate granted, in us"
        (note,) = kept.notes
        assert f"message rates were low and were requested again: {name} at " in note
        assert f"instead of {ALL[name]:.1f}" in note and "(nobody)" in note
        kinds, since = kept.blamed[0]
        assert "REQUEST_DATA_STREAM" in kinds
        assert 0.0 <= since - 94.0 <= 8.0, "orders of the last ten seconds"


def test_a_low_rate_is_noted_once_per_message_and_requested_each_time() -> None:
    kept = Kept()
    kept.pass_by(4.0, **ALL)
    kept.pass_by(8.0, **{**ALL, "RC_CHANNELS": 0.5})
    assert (len(kept.notes), len(kept.sent)) == (1, 4)
    kept.pass_by(4.0, **{**ALL, "RC_CHANNELS": 0.5, "SERVO_OUTPUT_RAW": 1.0})
    assert len(kept.notes) == 2
    assert "SERVO_OUTPUT_RAW at" in kept.notes[1] and "RC_CHANNELS at" in kept.notes[1]


def test_a_rate_never_granted_or_measured_is_not_missed() -> None:
    kept = Kept(granted={"ATTITUDE": 10.0, "RC_CHANNELS": 0.0})
    assert kept.pass_by(12.0, ATTITUDE=10.0) == []
    assert kept.notes == []


def test_rates_are_not_judged_after_a_silence_or_before_the_first_stamp() -> None:
    kept = Kept()
    kept.pass_by(2.0, ATTITUDE=10.0)
    assert kept.sent == [], "counted from the first look on"
    silent = Kept()
    silent.pass_by(4.0, **ALL)
    silent.clock.advance(9.0)  # neither a message nor a look for so long
    assert silent.pass_by(1.0, **ALL) == [], "more than ten seconds at once are not judged"
    nobody = Kept()
    nobody.pass_by(4.0, **ALL)
    nobody.session.vehicle = None
    assert nobody.pass_by(4.0, ATTITUDE=1.0) == []


class Ours:
    """A monitor on minimal stand-ins; the radio failsafe waits for two seconds."""

    def __init__(
        self, *, pause: float = 0.0, pace: float = 1.0, ordered: bool = False, says: tuple[str, ...] = ()
    ) -> None:
        self.asked: list[tuple[Any, ...]] = []
        texts = SimpleNamespace(recent=lambda since, at_most=3: self.asked.append(("texts", since)) or list(says))
        self.session: Any = SimpleNamespace(
            clock=ManualClock(50.0),
            custom_mode=15,
            armed=True,
            texts=texts,
            liveness=SimpleNamespace(longest=lambda span: 0.0, actual_silence=0.0),
            request_message=lambda number: None,
            await_heartbeat=lambda: None,
            port=SimpleNamespace(system=255),
        )
        self.others: Any = SimpleNamespace(
            has_ordered=lambda kinds, since: self.asked.append(("ordered", since)) or ordered,
            culprit=lambda kinds, since, name="": self.asked.append(("culprit", since, name)) or "somebody",
            steering=None,
        )
        self.sticks: Any = SimpleNamespace(
            moved_by_hand=None, departed=None, has_receiver=False, was_sent=lambda channel, pwm: False
        )
        rate: Any = SimpleNamespace(pause_since=lambda since: self.asked.append(("pause", since)) or pause, pace=pace)
        self.parameters: Any = SimpleNamespace(intrusions=[])
        commands: Any = SimpleNamespace(has_ordered_mode=lambda mode, now: False, copy_arrived=lambda mode, now: False)
        watchdog: Any = SimpleNamespace(has_restarted=False)
        radio = SetFailsafe("radio failsafe", 2.0, ("HOLD",), "radio failsafe", by_overrides=True)
        self.monitor = InterferenceMonitor(
            self.session,
            FIRMWARE["ardurover"],
            self.parameters,
            commands,
            Evidence(self.others, self.sticks, rate, watchdog),
        )
        self.monitor.failsafes = (radio,)
        self.monitor.take_over()

    def trips(self) -> GuardTripped:
        with pytest.raises(GuardTripped) as caught:
            self.monitor.check()
        return caught.value


@pytest.mark.parametrize(
    ("pause", "pace", "guard"),
    [
        (1.71, 1.0, "pause"),
        (1.69, 1.0, "mode"),
        (0.171, 10.0, "pause"),
        (0.16, 10.0, "mode"),
        (1.71, 0.5, "pause"),
    ],
)
def test_our_pause_as_long_as_the_failsafe_timeout_is_the_cause(pause: float, pace: float, guard: str) -> None:
    ours = Ours(pause=pause, pace=pace, says=("Radio Failsafe",))
    ours.monitor.check()
    ours.session.custom_mode = 4
    tripped = ours.trips()
    assert tripped.guard == guard
    assert ("pause", 45.0) in ours.asked
    found = ours.monitor.found
    assert found is not None and found.may_go_on is (guard == "pause") and found.stands is (guard == "mode")
    assert found.failsafe == "radio failsafe" and found.has_reported
    if guard == "pause":
        assert f"this computer paused for {pause:.2g} s" in str(tripped)
        assert (f"The simulation ran at {pace:.1f} times real time" in str(tripped)) is (pace > 1.5)
        assert ("s of the vehicle's time," in str(tripped)) is (pace > 1.5)
        assert "Close other programs" in str(tripped)
    else:
        assert "it reports its radio failsafe" in str(tripped) and "lost on the link" in str(tripped)


@pytest.mark.parametrize("receiver", [True, False])
@pytest.mark.parametrize("says", [(), ("Radio Failsafe",)])
def test_a_pause_explains_a_failsafe_only_without_a_receiver(receiver: bool, says: tuple[str, ...]) -> None:
    ours = Ours(pause=3.0, says=says)
    ours.sticks.has_receiver = receiver
    ours.session.custom_mode = 4
    assert (ours.trips().guard == "pause") is (not receiver and bool(says))
    found = ours.monitor.found
    assert found is not None and found.may_go_on is not receiver and found.is_certain is (receiver or bool(says))


@pytest.mark.parametrize(("pace", "ahead"), [(1.5, False), (1.51, True)])
def test_a_simulation_runs_ahead_beyond_one_and_a_half_times_real_time(pace: float, ahead: bool) -> None:
    ours = Ours(pause=2.0, pace=pace, says=("Radio Failsafe",))
    ours.session.custom_mode = 4
    told = str(ours.trips())
    assert "Close other programs" in told and ("or reduce its speed-up if it has one" in told) is ahead


def test_a_disarm_is_not_attributed_to_a_failsafe_that_changes_the_mode() -> None:
    ours = Ours(pause=3.0, ordered=True, says=("Failsafe",))
    ours.session.armed = False
    tripped = ours.trips()
    assert tripped.guard == "armed"
    assert 'the vehicle was disarmed, not by this tool (its message: "Failsafe"): somebody' in str(tripped)
    assert ("texts", 45.0) in ours.asked and ("ordered", 45.0) in ours.asked


def test_while_our_mode_command_is_under_way_both_modes_are_expected() -> None:
    ours = Ours()
    ours.monitor.order_mode(4)
    for mode in (15, 4, 15):
        ours.session.custom_mode = mode
        ours.monitor.check()
    ours.session.custom_mode = 4
    ours.monitor.confirm_mode(4)
    ours.session.custom_mode = 15
    assert ours.trips().guard == "mode"


def test_an_accepted_state_is_expected_from_then_on() -> None:
    ours = Ours()
    ours.session.custom_mode = 4
    ours.trips()
    ours.monitor.accept()
    ours.monitor.check()
    ours.session.armed = False
    assert ours.trips().guard == "armed"


def test_a_vehicle_that_was_given_back_is_not_monitored() -> None:
    ours = Ours()
    ours.monitor.give_back()
    ours.session.custom_mode, ours.session.armed = 4, False
    assert ours.monitor.check() is None


def test_a_switch_moved_on_the_transmitter_explains_a_mode_but_not_a_parameter() -> None:
    ours = Ours()
    ours.session.custom_mode = 4
    ours.sticks.moved_by_hand = (5, 1000, 1900)
    assert "RC channel 5 went from 1000 to 1900 us, by a switch of the transmitter" in str(ours.trips())
    ours.parameters.intrusions = [("P", 0.2, 0.9), ("I", 0.1, 0.4)]
    tripped = ours.trips()
    assert (tripped.guard, tripped.value, tripped.limit) == ("parameters", 0.9, 0.2)
    assert "wrote P = 0.9 (it was 0.2): somebody" in str(tripped)
    assert ("culprit", 45.0, "P") in ours.asked


def test_moved_sticks_and_foreign_overrides_are_distinguished() -> None:
    ours = Ours()
    ours.sticks.departed = (1, 1600, 1500)
    tripped = ours.trips()
    assert (tripped.guard, tripped.value, tripped.limit) == ("sticks", 1500.0, 1600.0)
    assert "RC channel 1 shows 1500 us, but 1600 us were sent: somebody" in str(tripped)
    ours.sticks.departed, ours.sticks.moved_by_hand = None, (3, 1500, 1200)
    tripped = ours.trips()
    assert (tripped.guard, tripped.value, tripped.limit) == ("sticks", 1200.0, 1500.0)
    assert (
        "RC channel 3, which this tool does not drive, went from 1500 to 1200 us: overrides of another sender"
        in str(tripped)
    )
    ours.sticks.has_receiver = True
    assert "its RC transmitter, or overrides of another station with system id 255" in str(ours.trips())
    ours.others.steering = SimpleNamespace(is_receiver=True)
    assert "a pilot, since the vehicle reports that its own RC receiver steers it" in str(ours.trips())
