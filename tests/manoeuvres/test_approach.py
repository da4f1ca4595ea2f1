"""The approach of ship manoeuvres: steadiness, noise and course; and a rudder held until the turn is steady."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_autotune.manoeuvres import Commands, Steering
from gcs_autotune.manoeuvres.approach import LEAST_TIME, LONGEST_HOLD, LONGEST_TIME, Approach, Steadiness, UnderWay

from .toy_craft import answered, at_rest


def test_halves_of_a_full_window_are_compared() -> None:
    steady = Steadiness(4.0)
    for k in range(8):
        steady.update(0.5 * k, float(k))
        assert steady.halves is None, "the window is not full"
    steady.update(4.0, 8.0)
    assert steady.halves == (1.5, 6.0)
    assert steady.is_within(4.6)
    assert not steady.is_within(4.5)
    assert steady.mean == 4.0
    steady.update(4.5, 9.0)
    assert steady.halves == (2.5, 7.0), "what is older than the window is forgotten"


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_rising_or_falling_signal_is_unsteady(sign: float) -> None:
    steady = Steadiness(2.0)
    for k in range(5):
        steady.update(0.5 * k, sign * k)
    assert not steady.is_within(2.0)
    assert steady.is_within(2.6)


def test_unknown_values_are_left_out_of_the_mean() -> None:
    steady = Steadiness(1.0)
    assert math.isnan(steady.mean)
    assert steady.halves is None
    for k, x in enumerate((1.0, math.nan, 3.0)):
        steady.update(0.5 * k, x)
    assert steady.halves is None
    assert not steady.is_within(9.0)
    assert steady.mean == 2.0
    steady.update(2.1, math.nan)
    assert math.isnan(steady.mean)


def approach(speed, *, needs_way: bool = True, noise: float = 0.0) -> tuple[Approach, float]:
    """Return the approach and its end time; *speed* is a function of time."""
    own, rng = Approach("psi", needs_way=needs_way), np.random.default_rng(1)
    own.start(at_rest(t=10.0))
    for k in range(1, 801):
        own.update(10.0 + 0.05 * k, 0.2 * 0.05 * k + noise * float(rng.normal()), speed(0.05 * k))
        if own.done:
            return own, 0.05 * k
    return own, math.inf


def test_the_noise_is_that_of_a_heading_that_turns_steadily_and_the_speed_is_the_last_seconds() -> None:
    own, when = approach(lambda t: 1.5, noise=0.01)
    assert own.noise_std == pytest.approx(0.01, rel=0.25)
    assert own.speed == pytest.approx(1.5)
    assert when == pytest.approx(LEAST_TIME, abs=0.11)
    assert approach(lambda t: 1.5)[0].noise_std == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("speed", "when"),
    [
        (lambda t: 0.0, LONGEST_TIME),
        (lambda t: -1.0, LONGEST_TIME),
        (lambda t: math.nan, LONGEST_TIME),
        (lambda t: 2.0 + 0.5 * t, LONGEST_TIME),
        (lambda t: 0.3 + 0.012 * t, LEAST_TIME),
        (lambda t: 0.3 + 0.016 * t, LONGEST_TIME),
        (lambda t: min(0.2 * t, 2.0), 12.1),
    ],
    ids=["none", "astern", "unknown", "gains", "two cm", "more", "then steady"],
)
def test_the_approach_waits_a_limited_time_for_steady_headway(speed, when: float) -> None:
    assert approach(speed)[1] == pytest.approx(when, abs=0.3)
    assert approach(speed, needs_way=False)[1] == pytest.approx(LEAST_TIME, abs=0.06)


class Ahead(UnderWay):
    kind = "a test"

    def __init__(self, steering: Steering, helm: float = 0.0, least: float = 0.0) -> None:
        super().__init__(steering)
        self.helm, self.least, self.approached, self.held = helm, least, math.nan, math.nan

    def commands(self, now) -> Commands:
        now = yield from self._approached(now)
        self.approached = now.t
        self._execute("over", self.helm, now)
        now = yield from self._held(self.helm, now, self.least)
        self.held = now.t - self.approached
        self._end("completed", "")
        yield self._command(0.0, now)


def test_a_craft_that_needs_headway_approaches_twice_as_long_with_light_heading_control() -> None:
    ahead = Ahead(Steering(0.5, throttle=0.4))
    rows = answered(ahead, lambda t, c: at_rest(t=t, psi=0.1 * (t > 0.0), speed=min(0.2 * t, 1.0), u=1.0), tick=0.1)
    assert ahead.approached == pytest.approx(14.7, abs=0.3), "twice the time until three seconds differ by 3 % only"
    before = [c for row, c in rows if 0.0 < row.t < ahead.approached]
    assert {c.X for c in before} == {0.4}
    assert {round(c.N, 6) for c in before} == {-0.02}
    assert ahead._course == pytest.approx(0.1)
    drifting = Ahead(Steering(0.5))
    rows = answered(drifting, lambda t, c: at_rest(t=t, psi=0.1 * (t > 0.0)), tick=0.1)
    assert drifting.approached == pytest.approx(LEAST_TIME, abs=0.11)
    assert {c.N for row, c in rows if row.t < drifting.approached} == {0.0}


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(
    ("rate", "least", "held"),
    [
        (lambda s: 0.3, 0.0, 6.0),
        (lambda s: 0.3, 10.0, 10.0),
        (lambda s: 0.3 * (1.0 - math.exp(-s / 2.0)), 0.0, 17.7),
        (lambda s: 0.01 * s, 0.0, LONGEST_HOLD),
    ],
    ids=["at once", "at least", "after its lag", "never"],
)
def test_the_rudder_is_held_for_twice_the_time_to_a_steady_turn(side: float, rate, least, held) -> None:
    ahead = Ahead(Steering(0.5), helm=0.5 * side, least=least)
    rows = answered(
        ahead, lambda t, c: at_rest(t=t, r=0.0 if c.N == 0.0 else side * rate(t - ahead.approached)), tick=0.1
    )
    assert ahead.held == pytest.approx(held, abs=0.35)
    times = [t for t, _ in ahead._rates]
    assert times[0] == 0.0
    assert times[-1] == pytest.approx(ahead.held, abs=0.11)
    assert [m.detail["N"] for m in ahead.take_marks()] == [0.5 * side]
    assert ahead.phase == "over"
    assert rows[-1][1].N == 0.0


def test_steering_options_are_read_and_recorded() -> None:
    options = {"steering": 0.3, "side": -1.0, "throttle": 0.6, "full-rudder": 0.5, "keep-still": 1.0}
    steering = Steering.of(options)
    assert steering == Steering(0.3, -1, 0.6, 0.5, True)
    settings = Ahead(steering).settings
    assert (settings["steering"], settings["full_rudder"], settings["throttle"]) == (-0.3, 0.5, 0.6)
    plain = Steering.of({"side": 1.0, "throttle": 0.0, "keep-still": 0.0})
    assert plain == Steering(0.0)
    assert "full_rudder" not in Ahead(plain).settings
