"""The S-curve of a leg and the corner between two of them."""

from __future__ import annotations

import itertools
import math

import pytest

from sitl.autopilot.scurve import Limits, SCurve, advance_along

BOAT = Limits(speed=1.2, acceleration=1.0, jerk=1.0, snap=15.0)
FAST = Limits(speed=5.0, acceleration=3.0, jerk=2.0, snap=4.0)
GENTLE = Limits(speed=0.3, acceleration=2.0, jerk=0.5, snap=15.0)
EVERY = [(length, limits) for length in (0.05, 1.0, 4.0, 25.0, 300.0) for limits in (BOAT, FAST, GENTLE)]
STEP = 0.002


def _samples(leg: SCurve) -> list[tuple[float, float, float]]:
    return [leg.at(k * STEP) for k in range(math.ceil(leg.end / STEP) + 1)]


@pytest.mark.parametrize(("length", "limits"), EVERY)
def test_a_leg_respects_every_limit(length, limits):
    rows = _samples(SCurve(0j, complex(length, 0.0), limits))
    assert max(v for _, v, _ in rows) <= limits.speed * (1 + 1e-9)
    assert max(abs(a) for a, _, _ in rows) <= limits.acceleration * (1 + 1e-9)
    jerks = [(b[0] - a[0]) / STEP for a, b in itertools.pairwise(rows)]
    assert max(map(abs, jerks)) <= limits.jerk * (1 + 1e-6)
    assert max(abs(b - a) / STEP for a, b in itertools.pairwise(jerks)) <= limits.snap * 1.01


@pytest.mark.parametrize(("length", "limits"), EVERY)
def test_a_leg_ends_at_rest_exactly_at_its_destination(length, limits):
    leg = SCurve(1 + 2j, 1 + 2j + complex(0.0, length), limits)
    acceleration, speed, distance = leg.at(leg.end)
    assert distance == pytest.approx(length, rel=1e-12)
    assert abs(acceleration) < 1e-9 and abs(speed) < 1e-9
    just_before = leg.at(leg.end - 1e-4)
    assert just_before[2] == pytest.approx(length, abs=1e-4 * limits.speed)


@pytest.mark.parametrize(("length", "limits"), EVERY)
def test_speed_and_distance_are_the_integrals_of_the_acceleration(length, limits):
    speed = distance = 0.0
    steps = list(itertools.pairwise(_samples(SCurve(0j, complex(length, 0.0), limits))))
    assert len(steps) > 10
    for a, b in steps:
        speed += 0.5 * STEP * (a[0] + b[0])
        distance += 0.5 * STEP * (a[1] + b[1])
        assert b[1] == pytest.approx(speed, abs=0.01 * limits.speed)
        assert b[2] == pytest.approx(distance, abs=0.01 * length)


def test_a_leg_of_no_length_is_finished_at_once():
    leg = SCurve(3 + 4j, 3 + 4j, BOAT)
    assert leg.finished and leg.end == 0.0 and leg.top_speed == 0.0


@pytest.mark.parametrize("speed", [0.5, 2.0])
@pytest.mark.parametrize("when", [1.0, 8.0])
def test_a_new_speed_during_a_leg_is_reached_and_the_end_is_unchanged(speed, when):
    leg = SCurve(0j, 60 + 0j, BOAT)
    leg.t = when
    leg.set_speed(speed)
    rows = [leg.at(when + k * STEP) for k in range(math.ceil((leg.end - when) / STEP))]
    assert rows[len(rows) // 2][1] == pytest.approx(speed, abs=1e-6)
    assert max(abs(a) for a, _, _ in rows) <= BOAT.acceleration * (1 + 1e-9)
    assert leg.at(leg.end)[2] == 60.0 and abs(leg.at(leg.end)[1]) < 1e-9
    for a, b in itertools.pairwise(rows):
        assert b[2] - a[2] == pytest.approx(0.5 * STEP * (a[1] + b[1]), abs=1e-6)


def test_a_braking_leg_ignores_a_new_speed():
    leg = SCurve(0j, 20 + 0j, BOAT)
    end, leg.t = leg.end, leg.braking_start + 0.1
    leg.set_speed(3.0)
    assert leg.end == end


def _fly_corner(angle: float, radius: float) -> tuple[list[complex], bool]:
    corner = 20 + 0j
    this = SCurve(0j, corner, BOAT)
    after = SCurve(corner, corner + 20.0 * complex(math.cos(angle), math.sin(angle)), BOAT)
    places, blended = [], False
    for _ in range(5000):
        motion, done = advance_along((SCurve(), this, after), 0j, 0.01, (radius, 6.0), blend=True)
        places.append(motion.place)
        blended = blended or after.t > 0.0
        if done:
            break
    return places, blended


def test_a_corner_is_rounded_within_its_radius():
    places, blended = _fly_corner(math.radians(90.0), 2.0)
    assert blended
    assert 0.0 < abs(places[-1] - 20.0) < 2.0
    steps = [abs(b - a) for a, b in itertools.pairwise(places)]
    assert max(steps) < 0.01 * BOAT.speed * 1.001
    assert min(steps[100:]) > 0.0


def test_a_corner_with_a_small_radius_starts_its_next_leg_later():
    wide, _ = _fly_corner(math.radians(90.0), 2.0)
    narrow, _ = _fly_corner(math.radians(90.0), 0.1)
    assert abs(narrow[-1] - 20.0) < 0.12 < abs(wide[-1] - 20.0)
    assert len(narrow) > len(wide)


def test_a_leg_without_blending_ends_at_its_corner():
    this, after = SCurve(0j, 20 + 0j, BOAT), SCurve(20 + 0j, 20 + 20j, BOAT)
    done = False
    while not done:
        motion, done = advance_along((SCurve(), this, after), 0j, 0.01, (2.0, 6.0), blend=False)
    assert motion.place == pytest.approx(20 + 0j, abs=1e-4)
    assert after.t == 0.0
