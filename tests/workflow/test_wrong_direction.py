"""Limits that trip because something works the wrong way, and sensors that contradict each other in flight."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from gcs_autotune.craft import Observation
from gcs_autotune.errors import GuardTripped, PreconditionFailed
from gcs_autotune.firmware import FIRMWARE, read_servo_map
from gcs_autotune.logs.sample_store import RecordedParameters
from gcs_autotune.manoeuvres import SignCheck, SignCheckSettings
from gcs_autotune.trial import Channel, Trial
from gcs_autotune.workflow import FlySettings, Unattended, fly
from gcs_autotune.workflow.preflight import most_speed_of, steered_meanwhile
from gcs_autotune.workflow.wrong_way import contradiction_in, straight_throttle, why_tripped
from sitl.effects import parse_effect

from .sitl_harness import WHEN, Ear, SitlHarness

BOAT = FIRMWARE["ardurover"]
SWAPPED = {"SERVO1_FUNCTION": 74.0, "SERVO3_FUNCTION": 73.0}
SKID = {"SERVO1_FUNCTION": 73.0, "SERVO3_FUNCTION": 74.0}
RUDDER = {"SERVO1_FUNCTION": 26.0, "SERVO3_FUNCTION": 70.0}
TRIPPED = GuardTripped("tripped", guard="heading excursion", value=2.1, limit=2.0)


def servos_of(functions: Mapping[str, float], **more: float) -> Any:
    full = {}
    for n in (1, 3):
        full |= {f"SERVO{n}_MIN": 1100.0, f"SERVO{n}_TRIM": 1500.0, f"SERVO{n}_MAX": 1900.0, f"SERVO{n}_REVERSED": 0.0}
    return read_servo_map(RecordedParameters({**full, **functions, **more}), BOAT)


def turning(by_steering: float, by_throttle: float, steering: float, throttle: float = 0.4) -> Trial:
    """Return a record of a craft that a full steering, and a full throttle, turn at so many rad/s; steered at 3 s."""
    t = np.arange(0.0, 10.0, 0.1)
    N = np.where(t < 3.0, 0.0, steering)
    X = np.where(t < 0.5, 0.0, throttle)
    r, psi = np.zeros(len(t)), np.zeros(len(t))
    for i in range(1, len(t)):
        r[i] = r[i - 1] + 0.1 * (by_steering * N[i - 1] + by_throttle * X[i - 1] - r[i - 1])
        psi[i] = psi[i - 1] + 0.1 * r[i]
    return Trial("own", {n: Channel(n, "1", t, v) for n, v in (("N", N), ("X", X), ("psi", psi))})


@pytest.mark.parametrize(("side", "steered"), [(1.0, "port"), (-1.0, "starboard")])
def test_a_craft_that_turns_the_wrong_way_is_reported_with_the_functions_to_swap(side: float, steered: str) -> None:
    why = why_tripped(turning(-1.0, 0.0, side * -0.5), TRIPPED, BOAT, servos_of(SKID))
    assert why is not None
    assert f"while the steering was to {steered}" in str(why)
    assert "swap SERVO1_FUNCTION and SERVO3_FUNCTION" in str(why) and "another limit" not in str(why)


def test_a_directionally_unstable_ship_is_not_mistaken_for_swapped_steering() -> None:
    """It turns against the steering because it is steered against the turn; the steering does slow the turn."""
    t = np.arange(0.0, 10.0, 0.1)
    N, r, psi = np.zeros(len(t)), np.zeros(len(t)), np.zeros(len(t))
    for i in range(1, len(t)):
        N[i] = np.clip(-0.8 * psi[i - 1], -0.3, 0.3)
        r[i] = r[i - 1] + 0.1 * (0.5 * r[i - 1] + 0.2 * N[i - 1] - 0.05)
        psi[i] = psi[i - 1] + 0.1 * r[i]
    columns = {"N": N, "X": np.full(len(t), 0.4), "psi": psi}
    ship = Trial("own", {n: Channel(n, "1", t, v) for n, v in columns.items()})
    reported = why_tripped(ship, TRIPPED, BOAT, servos_of(RUDDER))
    assert reported is None or "while the steering was to" not in str(reported)


def test_a_reversed_rudder_is_reported_with_its_servo() -> None:
    why = why_tripped(turning(-1.0, 0.0, 0.5), TRIPPED, BOAT, servos_of(RUDDER, SERVO1_REVERSED=1.0))
    assert why is not None and "Set SERVO1_REVERSED to 0 (it is 1)" in str(why)


@pytest.mark.parametrize(("turn", "servo"), [(-1.0, "SERVO1"), (1.0, "SERVO3")])
@pytest.mark.parametrize("steering", [0.0, 0.5])
def test_a_thruster_that_runs_the_wrong_way_is_identified(turn: float, servo: str, steering: float) -> None:
    why = why_tripped(turning(0.0, turn, -turn * steering), TRIPPED, BOAT, servos_of(SKID))
    assert why is not None
    assert f"Set {servo}_REVERSED to 1 (it is 0)" in str(why) and "40% throttle" in str(why)


def unstable(start: float, pulse: float) -> Trial:
    """Return a record under throttle of a hull whose turn grows by itself; *start* [rad/s], steered from 5 to 6 s."""
    t = np.arange(0.0, 10.0, 0.1)
    N = np.where((t >= 5.0) & (t < 6.0), pulse, 0.0)
    X = np.where(t < 0.5, 0.0, 0.4)
    r = np.full(len(t), start)
    for i in range(1, len(t)):
        r[i] = r[i - 1] + 0.1 * ((0.3 * r[i - 1] if X[i - 1] else 0.0) - 0.5 * r[i - 1] * abs(r[i - 1]) + N[i - 1])
    psi = np.cumsum(0.1 * r)
    return Trial("own", {n: Channel(n, "1", t, v) for n, v in (("N", N), ("X", X), ("psi", psi))})


@pytest.mark.parametrize(
    ("start", "pulse", "why"),
    [(0.4, 0.0, "was already turning at 22 deg/s"), (-0.4, 0.0, "was already turning at"), (0.0, 0.4, "ran straight")],
)
def test_a_directionally_unstable_hull_is_reported_as_the_likely_cause(start: float, pulse: float, why: str) -> None:
    message = str(why_tripped(unstable(start, pulse), TRIPPED, BOAT, servos_of(SKID)))
    assert f"Most likely the hull does not keep its course by itself: it {why}" in message
    assert "Otherwise one of the two thrusters is reversed or dead" in message


@pytest.mark.parametrize(("straight", "blames"), [(0.4, False), (0.1, True)])
def test_no_thruster_is_reported_if_the_craft_ran_straight_before_at_this_throttle(
    straight: float, blames: bool
) -> None:
    assert straight_throttle(unstable(0.0, 0.4)) == pytest.approx(0.4)
    assert straight_throttle(turning(0.0, 1.0, 0.0)) == straight_throttle(unstable(0.4, 0.0)) == 0.0
    reported = str(why_tripped(unstable(0.4, 0.0), TRIPPED, BOAT, servos_of(SKID), straight))
    assert ("reversed or dead" in reported) == blames
    assert ("Earlier in this run the craft ran straight" in reported) != blames
    assert "does not keep its course by itself" in reported
    assert ("SERVO" in reported) == blames


@pytest.mark.parametrize("steering", [0.0, 0.5])
def test_a_dead_thruster_is_not_mistaken_for_an_unstable_hull(steering: float) -> None:
    reported = str(why_tripped(turning(0.0, 1.0, -steering), TRIPPED, BOAT, servos_of(SKID)))
    assert "reversed or dead" in reported and "keep its course" not in reported


def test_correct_steering_or_another_limit_gives_no_cause() -> None:
    right = turning(1.0, 0.0, 0.5)
    assert why_tripped(right, TRIPPED, BOAT, servos_of(SKID)) is None
    wrong = turning(-1.0, 0.0, 0.5)
    distance = GuardTripped("tripped", guard="distance from start", value=2.0, limit=1.0)
    assert why_tripped(wrong, distance, BOAT, servos_of(SKID)) is None
    still = Trial("short", {n: c.between(0.0, 0.2) for n, c in wrong.channels.items()})
    assert why_tripped(still, TRIPPED, BOAT, servos_of(SKID)) is None


def test_steering_is_checked_during_a_surge_check() -> None:
    boat = servos_of(SKID)
    assert steered_meanwhile("surge", BOAT, boat) and not steered_meanwhile("yaw", BOAT, boat)


def test_a_user_supplied_throttle_is_not_reduced() -> None:
    assert most_speed_of(0.4, 1.5, 4.0) == math.inf
    assert most_speed_of(None, 1.5, 4.0) == pytest.approx(2.4)
    assert most_speed_of(None, 3.0, 4.0) == pytest.approx(3.2), "never near the safety limit"
    assert most_speed_of(None, 0.0, 4.0) == math.inf


def test_a_consistent_record_has_no_contradiction() -> None:
    assert contradiction_in(turning(1.0, 0.0, 0.5)) == ""


def test_a_late_heading_is_attributed_to_stamps_filters_or_motor_currents() -> None:
    t = np.arange(0.0, 60.0, 0.1)
    r = 0.4 * np.sin(0.9 * t)
    psi = np.interp(t - 1.0, t, np.cumsum(0.1 * r))
    why = contradiction_in(Trial("turns", {n: Channel(n, "rad", t, v) for n, v in (("psi", psi), ("r", r))}))
    assert "psi turns 0.93 s later than r integrates to" in why
    assert why.endswith("Check the stamps and filters of psi and r, and whether motor currents deflect the compass")


SIMULATED = {
    "compass 180 deg off": (
        "heading",
        {},
        "compass-deviation.A=3.14159",
        "mounted turned or the thrust is reversed",
    ),
    "compass 90 deg off": ("speed", {}, "compass-deviation.A=1.5708", "COMPASS_ORIENT and AHRS_ORIENTATION"),
    "thrusters swapped": (
        "speed",
        {"SERVO1_FUNCTION": 74.0, "SERVO3_FUNCTION": 73.0},
        "",
        "Left and right are swapped",
    ),
    "one thruster reversed": ("heading", {"SERVO1_REVERSED": 1.0}, "", "Set SERVO1_REVERSED to 0 (it is 1)"),
}


@pytest.mark.slow
@pytest.mark.parametrize(("axis", "parameters", "effect", "why"), SIMULATED.values(), ids=SIMULATED)
def test_no_gains_are_proposed_for_a_craft_that_acts_the_wrong_way(
    tmp_path: Any, axis: str, parameters: dict[str, float], effect: str, why: str
) -> None:
    effects = [parse_effect(effect)] if effect else []
    harness = SitlHarness(tmp_path, "blueboat", parameters=parameters, effects=effects)
    with pytest.raises(PreconditionFailed) as caught:
        harness.tune(axis=axis, dry_run=True)
    assert why in str(caught.value) and "another limit" not in str(caught.value)
    assert not any("another limit" in text for text in harness.said)
    harness.assert_as_found()
    assert not (harness.directory / "proposed.param").exists()


@pytest.mark.slow
def test_a_recheck_reports_the_servo_functions_and_no_larger_limit(tmp_path: Any) -> None:
    harness = SitlHarness(tmp_path, "blueboat", parameters=SWAPPED)
    settings = FlySettings("set-point-relay", harness.common(), {})
    with pytest.raises(PreconditionFailed, match=r"while the steering was to port\. .*_FUNCTION") as caught:
        fly(settings, Unattended(), Ear(harness.said), WHEN)
    assert "another limit" not in str(caught.value)


@pytest.mark.slow
def test_a_flight_ahead_checks_its_steering(tmp_path: Any) -> None:
    harness = SitlHarness(tmp_path, "blueboat", parameters=SWAPPED)
    settings = FlySettings("steps", harness.common(), {}, force="X")
    with pytest.raises(PreconditionFailed, match=r"the wrong way\. Left and right are swapped"):
        fly(settings, Unattended(), Ear(harness.said), WHEN)
    harness.assert_neutral()
    assert not harness.vehicle.autopilot.armed
    kept = [file.stem for file in (harness.directory / "trials").glob("*.csv")]
    assert kept and all("sign-check" in name for name in kept), "no step was flown"


@pytest.mark.slow
def test_a_cruise_pair_wrong_by_a_factor_of_five_is_corrected(tmp_path: Any) -> None:
    file = tmp_path / "five.toml"
    thrust = '{ value = 276.0, unit = "N", source = "five times that of the boat it is like" }'
    file.write_text(f'like = "blueboat"\n[thruster]\nfull_thrust = {thrust}\n', encoding="utf-8")
    harness = SitlHarness(tmp_path, str(file))
    story = harness.tune(axis="speed", dry_run=True)
    assert any("and is used" in text for text in harness.said)
    assert "CRUISE_THROTTLE" in story.proposal.new
    harness.assert_as_found()


def test_a_boat_that_goes_too_fast_gets_less_throttle_until_its_speed_is_known() -> None:
    check = SignCheck(SignCheckSettings("psi", "N", throttle=0.4, least_speed=0.25, most_speed=2.4, wanted_speed=1.5))
    now, speed = Observation(0.0, 0.0, speed=0.0, u=0.0, output={"N": 0.0}), 0.0
    commands = check.commands(now)
    command, fastest = next(commands), 0.0
    for tick in range(1, 200):
        speed += 0.1 * (18.75 * command.X - speed) / 1.4  # 7.5 m/s at 40 %
        fastest = max(fastest, speed)
        command = commands.send(Observation(0.1 * tick, 0.0, speed=speed, u=speed, output={"N": 0.0}))
        if command.N:
            break
    assert check.eased and fastest < 3.5
    assert check.throttle == pytest.approx(1.5 / 18.75, rel=0.1)
