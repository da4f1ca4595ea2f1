"""Light control of the other axes: a PID with limits, and a rudder whose gain falls when it oscillates."""

from __future__ import annotations

import math

import pytest

from gcs_autotune.craft import Actuate
from gcs_autotune.manoeuvres import HELD_DURING
from gcs_autotune.manoeuvres.hold_controller import (
    CALMING,
    LEAST_SHARE,
    MOST_RUDDER,
    RUDDER_GAIN,
    HeadingHold,
    HoldController,
    HoldGains,
    hold,
)

from .toy_craft import at_rest

GAINS = HoldGains("z", "w", "Z", P=0.4, I=0.03, D=0.2, most=0.5)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_initial_value_is_held_by_proportional_derivative_and_integral_action(sign: float) -> None:
    own = HoldController(GAINS)
    assert own.demand(at_rest(t=1.0, z=2.0, w=0.0)) == 0.0
    assert own.demand(at_rest(t=3.0, z=2.0 - 0.5 * sign, w=0.1 * sign)) == pytest.approx(
        sign * (0.4 * 0.5 - 0.2 * 0.1 + 0.03 * 0.5 * 2.0)
    )
    assert own.demand(at_rest(t=4.0, z=2.0, w=0.0)) == pytest.approx(sign * 0.03 * 0.5 * 2.0), "the integral stays"
    assert own.force == "Z"


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_output_and_integral_are_limited(sign: float) -> None:
    own = HoldController(GAINS)
    own.demand(at_rest(t=0.0, z=0.0, w=0.0))
    assert own.demand(at_rest(t=1.0, z=-10.0 * sign, w=0.0)) == sign * 0.5
    assert own.demand(at_rest(t=101.0, z=-1.0 * sign, w=0.0)) == sign * 0.5
    assert own.demand(at_rest(t=102.0, z=0.0, w=0.0)) == pytest.approx(sign * 0.5), "no more than as much is left"
    assert own.demand(at_rest(t=103.0, z=1.0 * sign, w=0.0)) == pytest.approx(sign * (0.5 - 0.03 - 0.4))


def test_without_a_signal_the_output_is_zero_and_a_missing_rate_is_ignored() -> None:
    own = HoldController(GAINS)
    assert own.demand(at_rest(t=0.0, z=math.nan)) == 0.0
    assert own.demand(at_rest(t=5.0, z=3.0, w=math.nan)) == 0.0
    assert own.demand(at_rest(t=6.0, z=2.0, w=math.nan)) == pytest.approx(0.4 + 0.03)


def test_held_forces_replace_the_commanded_forces() -> None:
    own = HoldController(HELD_DURING["psi"][0])
    own.demand(at_rest(z=1.0))
    command = hold(Actuate(N=0.5, Z=0.9), [own], at_rest(z=1.0))
    assert command == Actuate(N=0.5, Z=0.0)
    assert [g.force for g in HELD_DURING["z"]] == ["N"]
    assert [g.force for g in HELD_DURING["x"]] == ["N", "Z"]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_rudder_opposes_the_error_less_at_speed_and_is_limited(sign: float) -> None:
    own = HeadingHold()
    own.start(at_rest(psi=1.0))
    for speed, share in ((0.5, 1.0), (1.0, 1.0), (4.0, 0.25), (math.nan, 1.0)):
        assert own.steer(at_rest(psi=1.0 - 0.3 * sign, speed=speed)) == pytest.approx(sign * RUDDER_GAIN * 0.3 * share)
    assert own.steer(at_rest(psi=1.0 - 9.0 * sign)) == sign * MOST_RUDDER
    assert own.steer(at_rest(psi=math.nan)) == 0.0


def swings(own: HeadingHold, *peaks: float) -> float:
    """Oscillate through each of *peaks* [deg]; return the remaining fraction of the gain."""
    for peak in peaks:
        for part in (0.5, 1.0, 0.5):
            own.steer(at_rest(psi=-math.radians(part * peak), speed=0.0))
    return own.steer(at_rest(psi=-math.radians(10.0), speed=0.0)) / (RUDDER_GAIN * math.radians(10.0))


@pytest.mark.parametrize(
    ("peaks", "share"),
    [
        ((20, -19, 18), CALMING),
        ((20, -12, 7), 1.0),
        ((4, -4, 4, -4), 1.0),
        ((20, -19, 18, -18, 17), CALMING**3),
        ((20, -20) * 8, LEAST_SHARE),
    ],
    ids=["oscillating", "decaying", "small", "continuing", "endless"],
)
def test_the_gain_falls_with_every_oscillation_that_does_not_decay(peaks, share: float) -> None:
    own = HeadingHold()
    own.start(at_rest(psi=0.0))
    assert swings(own, *peaks) == pytest.approx(share)
