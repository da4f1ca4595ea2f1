"""Stopping tests: the least initial speed, when the craft counts as stopped, and when the test is aborted."""

from __future__ import annotations

import math

import pytest

from gcs_autotune.craft import Observation
from gcs_autotune.manoeuvres import Steering
from gcs_autotune.manoeuvres.stopping import LEAST_SPEED, PATIENCE, STOPPED, Stopping

from .toy_craft import answered, at_rest


class Way:
    """A craft with *top* speed at its throttle; without throttle it decelerates by *fall* [m/s^2]."""

    def __init__(self, top: float, fall: float) -> None:
        self.top, self.fall, self.u, self.t = top, fall, top, 0.0

    def __call__(self, t: float, command) -> Observation:
        if command.X <= 0.0 and t > 0.5:
            self.u -= self.fall * (t - self.t)
        self.t = t
        return at_rest(t=t, u=self.u, speed=abs(self.u))


@pytest.mark.parametrize("astern", [0.0, 0.7])
def test_thrust_is_cut_or_reversed_until_a_tenth_of_the_speed_is_left(astern: float) -> None:
    manoeuvre = Stopping(astern, Steering(0.0, throttle=0.5))
    rows = answered(manoeuvre, Way(2.0, 0.1))
    (mark,) = manoeuvre.take_marks()
    assert mark.detail["X"] == -astern
    stopping = [c.X for row, c in rows if mark.t <= row.t < rows[-1][0].t]
    assert set(stopping) == {-astern}
    assert rows[-1][0].u == pytest.approx(STOPPED * 2.0, abs=0.06 if astern else 0.2)
    assert rows[-1][0].u <= STOPPED * 2.0
    assert rows[-1][1].X == 0.0
    assert manoeuvre.target == pytest.approx(0.2)
    assert manoeuvre.outcome is not None
    assert manoeuvre.outcome.ending == "completed"
    assert manoeuvre.outcome.reason == ("stopped by thrust astern" if astern else "coasted until stopped")
    assert manoeuvre.settings["astern"] == astern
    assert all(c.X == 0.5 for row, c in rows if row.t < mark.t)


@pytest.mark.parametrize(("top", "aborts"), [(0.99 * LEAST_SPEED, True), (1.01 * LEAST_SPEED, False), (math.nan, True)])
def test_a_craft_with_too_little_or_unknown_speed_is_rejected(top: float, aborts: bool) -> None:
    manoeuvre = Stopping(0.0, Steering(0.0, throttle=0.5))
    rows = answered(manoeuvre, Way(top, 0.01))
    assert manoeuvre.outcome is not None
    assert (manoeuvre.outcome.ending == "aborted") is aborts
    assert ("too little for a stopping" in manoeuvre.outcome.reason) is aborts
    assert rows[-1][1].X == 0.0


def test_a_craft_that_does_not_stop_ends_at_the_timeout_with_its_remaining_speed() -> None:
    manoeuvre = Stopping(0.0, Steering(0.0, throttle=0.5))
    rows = answered(manoeuvre, Way(2.0, 0.001))
    start = manoeuvre.take_marks()[0].t
    assert rows[-1][0].t - start == PATIENCE + 0.5
    assert manoeuvre.outcome is not None
    assert manoeuvre.outcome.ending == "stopped"
    assert "not stopped 180 s after 2.00 m/s: the craft still makes 1.82 m/s" in manoeuvre.outcome.reason
