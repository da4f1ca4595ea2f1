"""The turning circle and the pull-out, tick by tick: what is commanded, what is reported, when it is aborted."""

from __future__ import annotations

import math

import pytest

from gcs_autotune.craft import Observation
from gcs_autotune.manoeuvres import MANOEUVRES, Steering
from gcs_autotune.manoeuvres.turning import LEAST_GAIN, LEAST_PULL_OUT, PATIENCE, CircleAndPullOut, PullOuts

from .toy_craft import answered, at_rest


class Turner:
    """A craft that turns at *rate* [rad/s] for its whole helm, at once."""

    def __init__(self, rate: float, start: float = 0.3) -> None:
        self.rate, self.psi, self.t = rate, start, 0.0

    def __call__(self, t: float, command) -> Observation:
        r = self.rate * command.N
        self.psi += r * (t - self.t)
        self.t = t
        return at_rest(t=t, psi=self.psi, r=r)


@pytest.mark.parametrize("side", [1, -1])
def test_the_rudder_is_held_until_the_turn_is_complete_and_then_centred(side: int) -> None:
    circle = CircleAndPullOut(math.radians(90.0), Steering(0.5, side))
    rows = answered(circle, Turner(0.2))
    turn, pull_out = circle.take_marks()
    assert (turn.detail["N"], pull_out.detail["N"]) == (side * 0.5, 0.0)
    at = {row.t: row for row, _ in rows}
    assert side * (at[pull_out.t].psi - 0.3) == pytest.approx(math.radians(90.0), abs=0.1 * 0.5 + 1e-9)
    assert side * (at[pull_out.t].psi - 0.3) >= math.radians(90.0)
    assert all(c.N == side * 0.5 for row, c in rows if turn.t <= row.t < pull_out.t)
    assert all(c.N == 0.0 for row, c in rows if row.t >= pull_out.t or row.t < turn.t)
    assert rows[-1][0].t - pull_out.t >= LEAST_PULL_OUT
    assert math.isnan(circle.target)  # after a full turn it would be the heading at the start
    assert circle.outcome is not None
    assert circle.outcome.reason == "turned by 90 deg and pulled out"
    assert circle.settings["turn"] == pytest.approx(math.radians(90.0))


@pytest.mark.parametrize(("rate", "ending"), [(0.02, "completed"), (0.016, "aborted"), (-0.2, "aborted")])
def test_a_turn_of_less_than_thirty_degrees_in_a_minute_is_aborted(rate: float, ending: str) -> None:
    circle = CircleAndPullOut(math.radians(100.0), Steering(0.5))
    answered(circle, Turner(rate))
    assert circle.outcome is not None
    assert circle.outcome.ending == ending
    if ending == "aborted":
        assert f"of 100 deg, and by less than 30 deg in the last {PATIENCE:.0f} s" in circle.outcome.reason


def test_a_pull_out_follows_a_turn_to_either_side() -> None:
    manoeuvre = PullOuts(Steering(0.4, -1))
    rows = answered(manoeuvre, Turner(0.2))
    marks = manoeuvre.take_marks()
    assert [m.detail["N"] for m in marks] == [-0.4, 0.0, 0.4, 0.0]
    for mark, until in zip(marks, [m.t for m in marks[1:]], strict=False):
        assert {c.N for row, c in rows if mark.t <= row.t < until} == {mark.detail["N"]}
    assert rows[-1][0].t - marks[-1].t >= LEAST_PULL_OUT
    assert rows[-1][1].N == 0.0
    assert manoeuvre.phase == "pull-out 2"
    assert manoeuvre.outcome is not None
    assert manoeuvre.outcome.ending == "completed"


def test_the_rows_of_the_table_create_the_requested_turns() -> None:
    options = {"turn": 2.0, "steering": 0.3, "side": 1.0, "throttle": 0.5, "keep-still": 0.0}
    for name, kind in (("turning-circle", CircleAndPullOut), ("pull-out", PullOuts)):
        row = MANOEUVRES[name].of("N")
        assert row.turns
        assert row.make is not None
        made = row.make(options)
        assert isinstance(made, kind)
        assert made.settings["steering"] == 0.3


@pytest.mark.parametrize(("reached", "given_up"), [(LEAST_GAIN, 110.5), (0.999 * LEAST_GAIN, 60.5)])
def test_the_timeout_restarts_after_each_thirty_degrees(reached: float, given_up: float) -> None:
    circle = CircleAndPullOut(math.radians(100.0), Steering(0.5))
    began: list[float] = []

    def seen(t: float, command) -> Observation:
        if command.N and not began:
            began.append(t - 0.5)  # the helm was ordered at the tick before
        return at_rest(t=t, psi=reached if began and t - began[0] >= 50.0 else 0.0)

    rows = answered(circle, seen)
    assert rows[-1][0].t - began[0] == given_up
    assert circle.outcome is not None
    assert circle.outcome.ending == "aborted"
