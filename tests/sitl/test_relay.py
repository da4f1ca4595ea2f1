"""The main experiment: a relay on the heading must give the limit cycle of the boat of Miskovic2010."""

from __future__ import annotations

import itertools
import math

import pytest
from scipy.optimize import brentq

from sitl import load_vehicle
from sitl.plants import Wrench
from tests.sitl.ground import boat

FULL_AHEAD = 2000


def _relay_on_the_hull(amplitude: float, hysteresis: float, seconds: float) -> list[float]:
    """Return the times of the switchings to starboard, for an ideal relay on the true heading."""
    data = load_vehicle("charlie")
    body, actuators, wrench = data.make_plant(), data.make_actuators(), Wrench()
    start, side, dt, switchings = body.state.psi, 1, 0.001, []
    for k in range(round(seconds / dt)):
        pwm = round(1500 + side * 500 * amplitude / math.radians(30))
        actuators.drive((pwm, 0, FULL_AHEAD), body.parameters, wrench)
        body.step(wrench, dt)
        if side * (body.state.psi - start) > hysteresis:
            side = -side
            if side > 0:
                switchings.append(k * dt)
    return switchings


def test_charlies_relay_takes_the_time_the_thesis_reports():
    """Miskovic2010, 8.1.5: C = 25 degrees, x_a = 10 degrees, five oscillations took about 80 s."""
    switchings = _relay_on_the_hull(math.radians(25), math.radians(10), 100.0)
    period = switchings[-1] - switchings[-2]
    assert 65.0 < 5 * period < 85.0


@pytest.mark.parametrize(("amplitude", "hysteresis"), [(25, 10), (10, 5), (20, 15)])
def test_the_relays_period_is_that_of_the_closed_form(amplitude, hysteresis):
    """Half period h of a relay on K/(s(Ts+1)): K C (h - 2 T tanh(h/2T)) = 2 x_a; table 7.12 at n^2 = 64."""
    alpha, beta = 8.695, 2.82
    time = alpha / beta
    half = brentq(lambda h: amplitude / beta * (h - 2 * time * math.tanh(h / (2 * time))) - 2 * hysteresis, 0.1, 100.0)
    switchings = _relay_on_the_hull(math.radians(amplitude), math.radians(hysteresis), 120.0)
    assert switchings[-1] - switchings[-2] == pytest.approx(2 * half, rel=0.01)


def test_the_same_relay_over_mavlink_gives_the_same_limit_cycle():
    ground = boat()
    ground.stream(30, 10)
    ground.sticks = {1: 1500, 3: FULL_AHEAD}
    ground.run(15.0)
    centre, side, switchings = ground.last("ATTITUDE").yaw, 1, []
    while len(switchings) < 7:
        error = math.remainder(ground.last("ATTITUDE").yaw - centre, math.tau)
        if side * error > math.radians(10):
            side = -side
            switchings += [ground.t] if side > 0 else []
        ground.sticks = {1: round(1500 + side * (30 + 470 * 25 / 30)), 3: FULL_AHEAD}
        ground.run(0.1)
    periods = [b - a for a, b in itertools.pairwise(switchings)]
    assert periods == pytest.approx([14.9] * len(periods), abs=0.8)
    assert 65.0 < switchings[-1] - switchings[1] < 85.0
