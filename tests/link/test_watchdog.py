"""The watchdog and the clock of boot by number: each limit on both sides, and a simulation that runs ahead."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_autotune.clock import ManualClock
from gcs_autotune.errors import TelemetryFault
from gcs_autotune.link.vehicle.watchdog import BootClock, Unwrapper, Watchdog, gyro_lag


def seen(*stamps: tuple[float, float]) -> tuple[list[bool], str]:
    """Show a watchdog stamps (our time, its time); return which of them are used, and the fault."""
    clock = ManualClock()
    watchdog = Watchdog(clock)
    used = []
    for ours, its in stamps:
        clock.advance_to(ours)
        used.append(watchdog.check_stamp(its))
    return used, str(watchdog.fault or "")


@pytest.mark.parametrize(
    ("silence", "gone_on", "has_jumped"), [(0.0, 5.0, False), (0.0, 5.1, True), (10.0, 19.9, False), (10.0, 20.1, True)]
)
def test_a_clock_may_advance_by_five_seconds_plus_one_and_a_half_silences(
    silence: float, gone_on: float, has_jumped: bool
) -> None:
    used, words = seen((1.0, 100.0), (1.0 + silence, 100.0 + gone_on))
    assert used == [True, True]
    assert ("jumped from 100.0 s" in words) is has_jumped


@pytest.mark.parametrize(("gone_on", "has_jumped"), [(34.9, False), (35.1, True)])
def test_a_faster_simulation_may_advance_at_its_own_pace(gone_on: float, has_jumped: bool) -> None:
    """Four of its seconds in one of ours, seen over five of ours: five more of ours may be thirty of its and five."""
    for since in (0.0, 100.0):
        ahead = [(since + 0.25 * k, 70.0 + 1.0 * k) for k in range(21)]
        _, words = seen(*ahead, (since + 10.0, 90.0 + gone_on))
        assert ("jumped" in words) is has_jumped


def test_a_pace_is_estimated_from_more_than_two_seconds() -> None:
    assert "jumped" in seen((0.0, 100.0), (2.0, 108.0), (3.0, 114.6))[1]
    assert "jumped" not in seen((0.0, 100.0), (2.25, 108.0), (3.25, 114.6))[1]


def test_a_slower_simulation_is_judged_at_our_pace() -> None:
    behind = [(1.0 * k, 0.25 * k) for k in range(6)]
    assert "jumped" not in seen(*behind, (9.0, 1.25 + 10.9))[1]
    assert "jumped" in seen(*behind, (9.0, 1.25 + 11.1))[1]


@pytest.mark.parametrize(
    ("its", "used", "words"),
    [
        (99.1, False, ""),
        (99.0, False, ""),
        (98.9, True, "its clock jumped back: timestamps went from 100.0 s to 98.9 s"),
        (60.5, True, "its clock jumped back"),
        (60.0, True, "its clock jumped back"),
        (59.5, True, "its clock jumped back"),
        (2.1, True, "the autopilot has restarted: its time since boot went from 100.0 s to 2.1 s"),
        (2.2, True, "its clock jumped back"),
    ],
)
def test_an_older_stamp_is_late_a_jump_back_or_a_restart(its: float, used: bool, words: str) -> None:
    found, fault = seen((0.0, 100.0), (0.1, its))
    assert found == [True, used]
    assert (words in fault) is True and bool(fault) is bool(words)


def test_after_a_restart_the_new_clock_counts_and_the_first_fault_stays() -> None:
    used, words = seen((0.0, 100.0), (0.1, 2.0), (0.2, 2.1), (0.3, 50.0))
    assert used == [True] * 4
    assert "restarted" in words and "jumped" not in words


def test_a_clock_that_stops_for_two_seconds_is_a_fault() -> None:
    for since in (0.0, 100.0):
        assert seen((since, 5.0), (since + 1.0, 5.0), (since + 2.0, 5.0)) == ([True, False, False], "")
    used, words = seen((0.0, 5.0), (1.0, 5.1), (2.9, 5.1), (3.1, 5.1))
    assert used == [True, True, False, False]
    assert "stopped at 5.10 s" in words


def test_a_nan_attitude_is_a_fault_raised_on_check() -> None:
    watchdog = Watchdog(ManualClock())
    watchdog.check()
    for bad in (math.nan, math.inf):
        other = Watchdog(ManualClock())
        other.check_attitude(1.0, (0.0, bad))
        with pytest.raises(TelemetryFault, match="not a number"):
            other.check()


@pytest.mark.parametrize(("force", "limit"), [("N", 3.0), ("X", 10.0)])
def test_an_attitude_is_frozen_only_while_an_actuator_works(force: str, limit: float) -> None:
    for size, is_fault in ((0.05, False), (0.051, True), (-0.051, True)):
        watchdog = Watchdog(ManualClock())
        watchdog.check_attitude(0.0, (0.1, 0.2))
        watchdog.note_outputs(0.0, {force: size})
        watchdog.note_outputs(1.0, {force: size})  # it goes on: counted from its beginning
        watchdog.check_attitude(limit, (0.1, 0.2))
        assert watchdog.fault is None
        watchdog.check_attitude(limit + 0.1, (0.1, 0.2))
        assert (f"frozen for {limit + 0.1:.1f} s" in str(watchdog.fault)) is is_fault
    watchdog = Watchdog(ManualClock())
    watchdog.check_attitude(0.0, (0.1, 0.2))
    watchdog.note_outputs(0.0, {force: 0.5})
    watchdog.note_outputs(1.0, {force: 0.0})
    watchdog.note_outputs(limit, {force: 0.5})
    watchdog.check_attitude(limit + 0.1, (0.1, 0.2))
    assert watchdog.fault is None, "the count restarted"
    watchdog.check_attitude(2.0 * limit - 0.1, (0.1, 0.21))
    watchdog.check_attitude(3.0 * limit - 0.2, (0.1, 0.21))
    assert watchdog.fault is None, "the attitude changed meanwhile"
    watchdog.check_attitude(3.0 * limit, (0.1, 0.21))
    assert watchdog.fault is not None


def test_one_working_actuator_among_others_at_rest_is_enough() -> None:
    for forces in ({"X": 0.5, "Z": 0.0}, {"Z": 0.0, "X": 0.5}):
        watchdog = Watchdog(ManualClock())
        watchdog.check_attitude(0.0, (0.1, 0.2))
        watchdog.note_outputs(0.0, forces)
        watchdog.check_attitude(10.1, (0.1, 0.2))
        assert watchdog.fault is not None


def test_boot_counters_are_unwrapped_to_the_turn_nearest_the_last_stamp() -> None:
    clock = BootClock()
    assert not clock.is_set and math.isnan(clock.from_us(5_000_000))
    turn_ms, turn_us = 2.0**32 * 1e-3, 2.0**32 * 1e-6
    assert clock.from_ms(2**32 - 1000) == pytest.approx(turn_ms - 1.0, abs=1e-3)
    assert clock.is_set and clock.now == pytest.approx(turn_ms - 1.0, abs=1e-3)
    assert clock.from_ms(500) == pytest.approx(turn_ms + 0.5, abs=1e-3)
    assert clock.from_ms(2**32 - 500) == pytest.approx(turn_ms - 0.5, abs=1e-3)
    assert clock.now == pytest.approx(turn_ms + 0.5, abs=1e-3), "an older one is not the present"
    us = int(((turn_ms + 0.7) % turn_us) * 1e6)
    assert clock.from_us(us) == pytest.approx(turn_ms + 0.7, abs=1e-3)
    assert clock.from_us(us + 2**32) == pytest.approx(turn_ms + 0.7, abs=1e-3)


@given(st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=50), st.floats(-100.0, 100.0))
def test_an_unwrapped_angle_is_continuous(steps: list[float], start: float) -> None:
    true, unwrapper = start, Unwrapper()
    assert steps
    first = unwrapper.unwrap(math.remainder(start, math.tau))
    for step in steps:
        true += step
        assert unwrapper.unwrap(math.remainder(true, math.tau)) - first == pytest.approx(true - start, abs=1e-9)


def test_the_lag_of_a_gyro_filter_follows_from_its_cutoff() -> None:
    assert gyro_lag(20.0) == pytest.approx(math.sqrt(2.0) / (2.0 * math.pi * 20.0))
    assert gyro_lag(0.5) == pytest.approx(math.sqrt(2.0) / math.pi)
    assert gyro_lag(0.0) == gyro_lag(-1.0) == 0.0
