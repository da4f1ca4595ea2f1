"""The rules for following a mission, and the comparison of two flights of one."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from gcs_autotune.design import (
    HullTurn,
    OnLeg,
    TrackMetrics,
    current_on,
    follows_better,
    line_changes,
    pivots_wide,
    too_short,
    track_metrics,
)

SLOW = HullTurn(1.2, math.radians(10.0), 3.5)
PRESENT = {"WP_ACCEL": 0.0, "WP_RADIUS": 2.0, "PSC_POS_P": 0.2, "PSC_VEL_P": 1.0, "WP_PIVOT_ANGLE": 60.0}
ROUTE = (0j, 30 + 0j, 30 + 30j)


def chosen(hull: HullTurn) -> dict[str, float]:
    return {c.parameter: c.new for c in line_changes(hull, PRESENT)}


def test_a_corner_takes_as_long_as_the_hull_needs_to_turn() -> None:
    braking = chosen(SLOW)["WP_ACCEL"]
    assert SLOW.speed / braking == pytest.approx(90.0 / 8.0 + 3.0 * 3.5, rel=0.05)


def test_the_waypoint_radius_contains_the_target_in_a_u_turn() -> None:
    new = chosen(SLOW)
    assert new["WP_RADIUS"] >= SLOW.speed**2 / (4.0 * new["WP_ACCEL"])


def test_a_quicker_hull_has_shorter_corners_and_a_higher_position_gain() -> None:
    slow, quick = chosen(SLOW), chosen(replace(SLOW, rate=math.radians(40.0), lag=0.5))
    assert quick["WP_ACCEL"] > 3.0 * slow["WP_ACCEL"]
    assert slow["PSC_POS_P"] < PRESENT["PSC_POS_P"]
    assert "PSC_POS_P" not in quick  # it has the greatest gain already


def test_a_boat_that_turns_on_the_spot_keeps_doing_so_unless_it_drifts_away() -> None:
    spot = replace(SLOW, pivots=True)
    assert not {"WP_ACCEL", "WP_RADIUS", "WP_PIVOT_ANGLE"} & set(chosen(spot))
    assert chosen(replace(spot, pivots_wide=True))["WP_PIVOT_ANGLE"] == 0.0


def test_parameters_already_set_are_not_changed() -> None:
    new = chosen(SLOW)
    assert line_changes(SLOW, new) == []


def flight(places: list[complex], turned: tuple[float, ...]) -> TrackMetrics:
    return track_metrics(np.arange(len(places), dtype=float), np.array(places), ROUTE, turned)


def test_distances_are_measured_from_the_nearer_of_two_legs() -> None:
    first = [complex(x, 0.5) for x in range(30)]
    beyond = [31 + 0j, 32 + 1j]
    second = [complex(30.0, y) for y in range(2, 30)]
    found = flight([*first, *beyond, *second], (0.0, 30.0, 59.5))
    assert found.corners == (pytest.approx(2.0),)
    assert found.rms == pytest.approx(math.sqrt((30 * 0.25 + 1.0 + 4.0) / 60.0))
    assert found.settled == pytest.approx(0.25, abs=0.01)
    assert (found.seconds, found.leg) == (59.5, 30.0)


BEFORE = TrackMetrics(2.0, 0.5, 0.4, (3.0, 4.0), 100.0, 30.0)


@pytest.mark.parametrize(
    ("change", "better", "reason"),
    [
        ({"rms": 1.0}, True, "2.00 -> 1.00 m"),
        ({"rms": 1.95}, False, "at least 5 % less"),
        ({"rms": 1.0, "corners": (1.0, 5.0)}, False, "the widest is more than the 4.40 m"),
        ({"rms": 1.0, "corners": (4.0, 4.0)}, False, "their mean is more than the 3.68 m"),
        ({"rms": 1.0, "corners": (3.5, 2.0)}, True, "corners off by 3.00, 4.00 -> 3.50, 2.00 m"),
        ({"rms": 1.0, "settled": 1.6}, False, "third quarter of legs 0.40 -> 1.60 m rms, more than"),
        ({"rms": 1.0, "seconds": 160.0}, False, "more than the 150 s"),
        ({"rms": math.nan}, False, "at least 5 % less"),
    ],
)
def test_a_flight_is_better_only_if_nothing_is_clearly_worse(
    change: dict[str, object], better: bool, reason: str
) -> None:
    verdict = follows_better(BEFORE, replace(BEFORE, **change))  # type: ignore[arg-type]
    assert verdict.better is better
    assert reason in " ".join(verdict.reasons)


def limits_of(hull: HullTurn, **present: float) -> dict[str, float]:
    return {c.parameter: c.new for c in line_changes(hull, {**PRESENT, **present})}


def test_a_limit_below_the_turning_ability_is_raised_and_a_higher_one_stays() -> None:
    quick = HullTurn(1.5, math.radians(60.0), 0.5)
    low = limits_of(quick, ATC_STR_RAT_MAX=30.0, ATC_STR_ACC_MAX=40.0, ATC_TURN_MAX_G=0.1)
    assert (low["ATC_STR_RAT_MAX"], low["ATC_STR_ACC_MAX"]) == (60.0, 120.0)
    assert low["ATC_TURN_MAX_G"] == pytest.approx(1.5 * math.radians(60.0) / 9.81, rel=0.02)
    high = limits_of(quick, ATC_STR_RAT_MAX=120.0, ATC_STR_ACC_MAX=0.0, ATC_TURN_MAX_G=0.6)
    assert not {"ATC_STR_RAT_MAX", "ATC_STR_ACC_MAX", "ATC_TURN_MAX_G"} & set(high)


def driven(*speeds: float, output: float = 0.5) -> HullTurn:
    legs = [OnLeg(k * math.pi / 2.0, speed * 1j**k, output) for k, speed in enumerate(speeds)]
    return replace(SLOW, legs=tuple(legs))


def test_a_mission_speed_that_the_boat_did_not_reach_with_full_thrust_is_lowered() -> None:
    slow = driven(1.2, 0.9, 1.2, output=0.98)
    assert limits_of(slow, WP_SPEED=1.2)["WP_SPEED"] == pytest.approx(0.81)
    assert limits_of(slow, WP_SPEED=1.2)["WP_ACCEL"] < limits_of(SLOW)["WP_ACCEL"]
    assert "WP_SPEED" not in limits_of(driven(1.2, 0.9, 1.2), WP_SPEED=1.2)  # thrust was left: the gains are to blame
    assert "WP_SPEED" not in limits_of(driven(1.2, 1.15, output=0.98), WP_SPEED=1.2)


def test_a_cruise_pair_is_changed_only_if_its_throttle_is_wrong() -> None:
    pair = {"WP_SPEED": 1.2, "CRUISE_SPEED": 1.0, "CRUISE_THROTTLE": 30.0}
    new = limits_of(driven(1.2, 1.2, output=0.6), **pair)
    assert (new["CRUISE_SPEED"], new["CRUISE_THROTTLE"]) == (1.2, 60.0)
    assert "CRUISE_THROTTLE" not in limits_of(driven(1.2, 1.2, output=0.4), **pair)


def test_the_current_is_estimated_from_the_drift_on_the_legs() -> None:
    current = 0.2 - 0.1j
    legs = [OnLeg(psi, 1.2 * complex(math.cos(psi), math.sin(psi)) + current, 0.5) for psi in (0.3, 1.9, 4.5)]
    assert abs(current_on(legs) - current) < 1e-9


def test_corners_that_do_not_fit_on_a_leg_are_rejected_with_a_sufficient_length() -> None:
    why = too_short(SLOW, 20.0)
    enough = math.ceil(SLOW.speed * SLOW.corner)
    assert f"the legs are 20 m. Use --leg-length {enough} or more" in why
    assert too_short(SLOW, enough) == ""
    assert too_short(replace(SLOW, pivots=True), 20.0) == ""  # it turns on the spot


def test_a_gentle_line_turns_more_slowly_and_corrects_less() -> None:
    hull = HullTurn(1.2, math.radians(20.0), 1.5)
    normal, gentle = (
        {c.parameter: c.new for c in line_changes(h, PRESENT)} for h in (hull, replace(hull, bandwidth=0.5))
    )
    assert gentle["WP_ACCEL"] < normal["WP_ACCEL"]
    assert gentle["WP_RADIUS"] > normal["WP_RADIUS"]
    assert gentle["PSC_POS_P"] < normal.get("PSC_POS_P", PRESENT["PSC_POS_P"])


def test_a_pivoting_boat_that_drifts_at_one_corner_pivots_wide() -> None:
    assert pivots_wide(replace(BEFORE, corners=(4.04, 1.68, 1.74)), 3.5)  # a BlueBoat that sways, in 0.3 m/s
    assert not pivots_wide(replace(BEFORE, corners=(0.4, 0.6, 1.0)), 3.5)
