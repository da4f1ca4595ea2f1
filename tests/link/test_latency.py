"""Delays, answer by answer: clocks compared, changes timed, and what is not timed."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, cast

import pytest

from gcs_autotune.clock import ManualClock
from gcs_autotune.link import Session
from gcs_autotune.link.vehicle.latency import Latency, least_period


class Listening:
    """The part of a session that ``Latency`` needs."""

    def __init__(self) -> None:
        self.clock = ManualClock(50.0)
        self.sent: list[Any] = []
        self.answer: Any = None

    def listen(self, name: str, deliver: Any) -> None:
        assert name == "TIMESYNC"
        self.answer = deliver

    def send(self, message: Any) -> None:
        self.sent.append(message)


@pytest.fixture
def link() -> Listening:
    return Listening()


@pytest.fixture
def latency(link: Listening) -> Latency:
    return Latency(cast(Session, link))


def sync(link: Listening, latency: Latency, trip: float, boot: float, after: float = 1.0) -> None:
    """Request and answer after *trip* [s], the vehicle's clock at *boot* half-way."""
    latency.ask()
    link.clock.advance(trip)
    link.answer(SimpleNamespace(tc1=round(boot * 1e9), ts1=link.sent[-1].ts1))
    link.clock.advance(after - trip)


def test_vehicle_time_comes_from_the_midpoint_of_the_fastest_recent_answer(link: Listening, latency: Latency) -> None:
    assert math.isnan(latency.vehicle_time(50.0))
    for k, trip in enumerate((0.02, 0.4, 0.1, 0.4, 0.4, 0.4)):
        sync(link, latency, trip, 7.0 + k + 0.5 * trip + (0.0 if trip == 0.1 else 0.03))
    # the first answer, quickest of all, is not among the last five
    assert latency.vehicle_time(52.0) == pytest.approx(9.0, abs=1e-6)
    assert (latency.requested, latency.answered) == (6, 6)
    assert latency.quickest == pytest.approx(0.02)
    assert latency.round_trip == pytest.approx(0.4)
    assert latency.trips(54.0) == ((54.0, pytest.approx(0.4)), (55.0, pytest.approx(0.4)))


@pytest.mark.parametrize(("pace", "expected"), [(1.0, 1.0), (1.015, 1.0), (0.985, 1.0), (2.0, 2.0), (0.5, 0.5)])
def test_a_clock_of_another_speed_is_followed_and_small_drift_is_ignored(
    link: Listening, latency: Latency, pace: float, expected: float
) -> None:
    for k in range(11):
        sync(link, latency, 0.0, 7.0 + pace * k)
    # counted from the first of the last five answers, which are all as quick
    assert latency.vehicle_time(66.0) == pytest.approx(7.0 + pace * 6.0 + expected * 10.0, abs=1e-6)


@pytest.mark.parametrize("trips", [(0.25, 0.125), (0.125, 0.25)])
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("off", "followed"), [(0.06, False), (0.08, True)])
def test_uneven_trip_times_are_not_taken_for_another_clock_speed(
    link: Listening, latency: Latency, trips: tuple[float, float], side: float, off: float, followed: bool
) -> None:
    """Over ten seconds the longer of both trips, twice, adds 5 % to the 2 % that clocks may drift."""
    middles = (50.0 + 0.5 * trips[0], 60.0 + 0.5 * trips[1])
    expected = 7.0 + (1.0 + side * off) * (middles[1] - middles[0])
    sync(link, latency, trips[0], 7.0, after=10.0)
    sync(link, latency, trips[1], expected)
    counted = (expected, middles[1]) if trips[1] < trips[0] else (7.0, middles[0])
    pace = 1.0 + side * off * followed
    assert latency.vehicle_time(70.0) == pytest.approx(counted[0] + pace * (70.0 - counted[1]), abs=1e-6)


def test_a_request_carries_our_clock_in_nanoseconds_and_is_never_zero(link: Listening, latency: Latency) -> None:
    latency.ask()
    link.clock.advance(0.25)
    latency.ask()
    assert [m.ts1 for m in link.sent] == [50_000_000_001, 50_250_000_001]
    assert {m.tc1 for m in link.sent} == {0}
    link.clock = ManualClock(0.0)
    latency.ask()
    assert link.sent[-1].ts1 == 1


def test_medians_are_of_all_answers_so_far(link: Listening, latency: Latency) -> None:
    for k, trip in enumerate((0.1, 0.6, 0.2)):
        sync(link, latency, trip, 12.0 + k)
        assert latency.round_trip == pytest.approx((0.1, 0.35, 0.2)[k])
    assert (latency.times().round_trip, latency.times().round_trip_90) == (pytest.approx(0.2), pytest.approx(0.52))
    sent = latency.vehicle_time(link.clock.now())
    for k, late in enumerate((0.1, 0.6, 0.2)):
        command(latency, 0.3 * (-1.0) ** k, -0.3 * (-1.0) ** k, sent - 0.1)
        latency.moved(sent + late, {"N": 0.3 * (-1.0) ** k})
    command(latency, -0.3, 0.3, sent - 0.1)
    latency.moved(sent + 0.2, {"N": -0.3})
    times = latency.times()
    assert (times.samples, latency.loop, times.loop, times.loop_90) == (
        3, pytest.approx(0.3), pytest.approx(0.3), pytest.approx(0.62),
    )  # fmt: skip
    assert (times.command_to_servo, times.command_to_servo_90) == (pytest.approx(0.2), pytest.approx(0.52))


@pytest.mark.parametrize(("apart", "pace"), [(0.4, 1.0), (0.5, 2.0), (0.7, 2.0)])
def test_half_a_second_of_answers_determines_the_clock_speed(
    link: Listening, latency: Latency, apart: float, pace: float
) -> None:
    for k in range(2):
        sync(link, latency, 0.0, 7.0 + 2.0 * apart * k, after=apart)
    assert latency.vehicle_time(60.0) == pytest.approx(7.0 + pace * 10.0, abs=1e-6)


def test_requests_and_answers_for_others_are_ignored(link: Listening, latency: Latency) -> None:
    latency.ask()
    link.answer(SimpleNamespace(tc1=0, ts1=link.sent[-1].ts1))
    link.answer(SimpleNamespace(tc1=1, ts1=12345))
    assert latency.answered == 0
    latency.ask()
    assert (latency.requested, len(link.sent)) == (1, 1), "the same moment is asked about once"


def command(latency: Latency, value: float, measured: float, seen: float) -> None:
    latency.commanded({"N": value}, {"N": measured}, seen)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("size", "moved"), [(0.5, 0.03), (0.06, 0.018)])
def test_a_change_is_timed_when_the_output_has_moved_a_given_fraction(
    link: Listening, latency: Latency, sign: float, size: float, moved: float
) -> None:
    for k in range(2):
        sync(link, latency, 0.0, 10.0 + k)  # its clock is 40 s behind ours: now 12 s
    command(latency, 0.0, 0.0, 11.9)
    command(latency, sign * size, 0.0, 11.95)
    latency.moved(12.05, {"N": sign * 0.99 * moved})
    latency.moved(12.06, {"N": -sign * size})
    assert latency.times().samples == 0
    latency.moved(12.2, {"N": sign * 1.01 * moved})
    times = latency.times(25.0, 0.1)
    assert (times.samples, times.loop, times.command_to_servo) == (1, pytest.approx(0.25), pytest.approx(0.2))
    assert (times.override_rate, times.override_gap) == (25.0, 0.1)
    latency.moved(12.3, {"N": sign * size})
    assert latency.times().samples == 1


def test_a_change_is_timed_relative_to_the_previous_output(latency: Latency) -> None:
    command(latency, 0.3, 0.0, 1.0)
    command(latency, -0.3, 0.3, 2.0)
    latency.moved(2.1, {"N": 0.28})
    assert latency.times().samples == 0
    latency.moved(2.2, {"N": 0.26})
    assert latency.loop == pytest.approx(0.2)
    assert math.isnan(latency.times().command_to_servo), "without the vehicle's clock there is none"


@pytest.mark.parametrize(
    ("value", "measured"),
    [(0.039, 0.0), (-0.039, 0.0), (0.3, 0.27), (0.3, 0.33)],
    ids=["small", "down", "there", "far"],
)
def test_small_changes_and_outputs_already_there_are_not_timed(latency: Latency, value: float, measured: float) -> None:
    command(latency, 0.0, 0.0, 1.0)
    command(latency, value, measured, 2.0)
    latency.moved(2.1, {"N": 2.0 * value})
    assert latency.times().samples == 0


def test_the_first_ineffective_and_forgotten_commands_are_not_timed(latency: Latency) -> None:
    command(latency, 0.5, 0.0, 1.0)
    latency.moved(1.1, {"N": 0.5})
    command(latency, -0.5, 0.5, 2.0)
    latency.moved(4.01, {})
    latency.moved(4.02, {"N": -0.5})
    command(latency, 0.5, -0.5, 5.0)
    latency.forget()
    latency.moved(5.1, {"N": 0.5})
    assert latency.times().samples == 0
    assert latency.times().to_dict() == {"samples": 0}
    assert str(latency.times()) == "not measured"


def test_a_command_withdrawn_before_the_output_moves_is_not_timed(latency: Latency) -> None:
    command(latency, 0.0, 0.0, 1.0)
    command(latency, 0.5, 0.0, 2.0)
    command(latency, 0.0, 0.01, 2.1)
    latency.moved(2.2, {"N": 0.5})
    assert latency.times().samples == 0


def test_after_forgetting_the_next_command_is_treated_as_the_first(latency: Latency) -> None:
    command(latency, 0.0, 0.0, 1.0)
    latency.forget()
    command(latency, 0.5, 0.0, 2.0)
    latency.moved(2.1, {"N": 0.5})
    assert latency.times().samples == 0


def test_a_constant_force_does_not_hide_a_changing_one(latency: Latency) -> None:
    for k, value in enumerate((0.0, 0.04)):
        latency.commanded({"X": 0.3, "N": value}, {"X": 0.3, "N": 0.0}, 1.0 + k)
    latency.moved(2.3, {"X": 0.3, "N": 0.04})
    assert latency.times().samples == 1


def test_an_effect_within_two_seconds_is_timed(latency: Latency) -> None:
    command(latency, 0.5, 0.5, 1.0)
    command(latency, -0.5, 0.5, 2.0)
    latency.moved(3.9, {})
    latency.moved(4.0, {})
    latency.moved(3.95, {"N": -0.5})
    assert latency.loop == pytest.approx(1.95)
    assert str(latency.times()) == "from measured attitude to output 1950 ms (9 of 10 within 1950)"


@pytest.mark.parametrize(
    ("loop", "rate", "period"),
    [(0.1, 10.0, 1.2), (math.nan, 10.0, 0.8), (0.01, 10.0, 0.8), (0.1, 0.0, 0.8), (math.nan, 0.0, 0.0)],
)
def test_an_oscillation_takes_at_least_eight_delays_and_eight_samples(loop: float, rate: float, period: float) -> None:
    assert least_period(loop, rate) == pytest.approx(period)


def test_the_uplink_delay_never_exceeds_the_loop_delay(link: Listening, latency: Latency) -> None:
    for k in range(19):  # before the clocks are compared: the whole loop only
        command(latency, 0.3 * (-1.0) ** k, -0.3 * (-1.0) ** k, 1.0 + k)
        latency.moved(1.1 + k, {"N": 0.3 * (-1.0) ** k})
    sync(link, latency, 0.0, 30.0)
    command(latency, -0.3, 0.3, 31.0)
    latency.moved(31.5, {"N": -0.3})
    times = latency.times()
    assert times.samples == 19
    assert (times.command_to_servo, times.command_to_servo_90) == (pytest.approx(0.1), pytest.approx(0.1))


def test_two_outputs_that_move_in_one_message_are_both_timed(latency: Latency) -> None:
    for k, (commanded_value, measured) in enumerate(((0.0, 0.0), (0.5, 0.0))):
        latency.commanded({"N": commanded_value, "X": -commanded_value}, {"N": measured, "X": -measured}, 1.0 + k)
    latency.moved(2.3, {"N": 0.4, "X": -0.4})
    assert latency.times().samples == 2
