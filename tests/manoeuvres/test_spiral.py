"""Spirals, tick by tick on a craft of one lag: rudder angles in order, held rates, a craft that does not turn."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from gcs_autotune.craft import Observation
from gcs_autotune.manoeuvres import Steering
from gcs_autotune.manoeuvres.spiral import LEAST_LAG, LEAST_RATE_TIME, RATE_TIMES, BechSpiral, DirectSpiral

from .toy_craft import answered, at_rest


class Lagged:
    """A craft of yaw rate *gain* [rad/s] at full helm and time constant *lag* [s]."""

    def __init__(self, gain: float, lag: float) -> None:
        self.gain, self.lag, self.r, self.psi, self.t = gain, lag, 0.0, 0.0, 0.0

    def __call__(self, t: float, command) -> Observation:
        dt, self.t = t - self.t, t
        share = -math.expm1(-dt / self.lag)
        self.r += share * (self.gain * command.N - self.r)
        self.psi += self.r * dt
        return at_rest(t=t, psi=self.psi, r=self.r)


@pytest.mark.parametrize("side", [1, -1])
def test_rudder_angles_step_to_the_other_side_and_back(side: int) -> None:
    spiral = DirectSpiral(2, Steering(0.6, side))
    rows = answered(spiral, Lagged(0.3, 1.0), tick=0.1)
    marks = spiral.take_marks()
    assert [m.detail["N"] for m in marks] == pytest.approx(
        [side * h for h in (0.6, 0.3, 0, -0.3, -0.6, -0.3, 0, 0.3, 0.6)]
    )
    assert {m.kind for m in marks} == {"execute"}
    at = {round(row.t, 3): row for row, _ in rows}
    for mark, after in pairwise(marks):
        assert at[round(after.t, 3)].r == pytest.approx(0.3 * mark.detail["N"], abs=0.01), "held until it is steady"
    assert spiral.outcome is not None
    assert spiral.outcome.reason == "9 steering levels held"
    assert rows[-1][1].N == 0.0
    assert spiral.settings["levels"] == 2


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(("gain", "lag"), [(0.3, 2.0), (-0.5, 1.0)])
def test_turn_rates_are_held_in_order_for_either_rudder_sign(side: int, gain: float, lag: float) -> None:
    spiral = BechSpiral(2, Steering(0.6, side))
    rows = answered(spiral, Lagged(gain, lag), tick=0.1)
    turn, *marks = spiral.take_marks()
    assert turn.detail["N"] == side * 0.6
    steady = side * 0.6 * gain
    assert [m.detail["r"] for m in marks] == pytest.approx(
        [k * steady for k in (1, 0.5, 0, -0.5, -1)], rel=0.03, abs=1e-9
    )
    at = {round(row.t, 3): row for row, _ in rows}
    for mark, after in pairwise(marks):
        assert at[round(after.t, 3)].r == pytest.approx(mark.detail["r"], abs=0.05 * abs(steady))
        spent = after.t - mark.t
        assert spent == pytest.approx(max(RATE_TIMES * lag, LEAST_RATE_TIME), abs=0.15 * RATE_TIMES)
    assert max(abs(c.N) for _, c in rows) <= 1.0
    assert spiral.outcome is not None
    assert spiral.outcome.reason == "5 rates held"


def test_the_time_constant_is_read_from_the_turn_and_has_a_lower_limit() -> None:
    spiral = BechSpiral(1, Steering(0.5))
    spiral._rates = [(0.1 * k, -0.2 * -math.expm1(-0.1 * k / 2.0)) for k in range(200)]
    rate, lag = spiral._reading()
    assert rate == pytest.approx(-0.2, rel=1e-3)
    assert lag == pytest.approx(2.0, abs=0.1)
    spiral._rates = [(0.1 * k, 0.2 * (k > 0)) for k in range(40)]
    assert spiral._reading() == (pytest.approx(0.2), LEAST_LAG)
    spiral._rates = [(0.1 * k, 0.2 * -math.expm1(-0.1 * k / 0.8)) for k in range(100)]
    assert spiral._reading()[1] == pytest.approx(0.8, abs=0.1)


@pytest.mark.parametrize(("gain", "ending"), [(0.02, "completed"), (0.016, "aborted"), (-0.016, "aborted")])
def test_a_craft_that_turns_slower_than_half_a_degree_per_second_is_aborted(gain: float, ending: str) -> None:
    spiral = BechSpiral(1, Steering(0.5))
    rows = answered(spiral, Lagged(gain, 1.0), tick=0.1)
    assert spiral.outcome is not None
    assert spiral.outcome.ending == ending
    assert rows[-1][1].N == 0.0
    if ending == "aborted":
        assert "at 50% steering the craft turns at only 0.5 deg/s" in spiral.outcome.reason
