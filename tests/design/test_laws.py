"""The simulated loops do what ArduPilot is documented to do."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from gcs_autotune.design import LAWS, Scenario
from gcs_autotune.design.laws import THROTTLE, loops
from gcs_autotune.design.laws.rover_steering import scale
from gcs_autotune.firmware import FIRMWARE

from .crafts import (
    CHARLIE,
    DEFAULTS,
    ROVER_DEFAULTS,
    SUB_DEPTH_DEFAULTS,
    SUB_HEADING_DEFAULTS,
    VIDEORAY_HEAVE,
    boat,
    heave,
    yaw,
)

ROVER, SUB, DEPTH = LAWS["rover-heading"], LAWS["sub-heading"], LAWS["sub-depth"]
POSITIONS = [name for name, law in LAWS.items() if not law.controls_velocity]
STEADY = {**ROVER_DEFAULTS, "ATC_STR_RAT_P": 1.5, "ATC_STR_RAT_I": 0.02, "ATC_STR_ANG_P": 1.0}


@pytest.mark.parametrize(("firmware", "axis"), [(f, a) for f, kind in FIRMWARE.items() for a in kind.axes])
def test_every_axis_of_every_firmware_has_a_law_with_its_parameters(firmware: str, axis: str) -> None:
    given = FIRMWARE[firmware].axes[axis]
    law = LAWS[given.law]
    assert {*law.tuned, *law.fixed, *law.measured} == {g.parameter for g in given.gains}
    assert law.integral in law.tuned
    assert set(law.defaults) <= set(given.context)


@pytest.mark.parametrize("lead", [0.0, 2.0])
def test_every_sample_of_a_motion_is_written_including_the_first(lead: float, monkeypatch: pytest.MonkeyPatch) -> None:
    unwritten = SimpleNamespace(**{**vars(np), "empty": lambda n: np.full(n, math.nan)})
    monkeypatch.setattr(loops, "np", unwritten)
    motion = ROVER.simulate(boat(1.0, 1.0, 0.0, 0.0), ROVER_DEFAULTS, Scenario(0.3, 5.0, lead=lead), 2.0, 0.0)
    assert np.isfinite(motion.position).all()
    assert np.isfinite(motion.output).all()


@pytest.mark.parametrize("name", POSITIONS)
def test_a_step_is_followed_equally_in_both_directions(name: str) -> None:
    law = LAWS[name]
    craft = {
        "rover-heading": boat(1.0, 1.0, 0.0, 0.0),
        "sub-heading": yaw(0.2, 0.75),
        "sub-depth": heave(0.4, 0.7),
        **dict.fromkeys(("sub-roll", "sub-pitch"), yaw(0.2, 0.75)),
    }
    ways = [law.simulate(craft[name], DEFAULTS[name], Scenario(size, 20.0), 2.0, 0.0).position for size in (0.3, -0.3)]
    assert ways[0] == pytest.approx(-ways[1], abs=1e-12)
    assert ways[0][-1] == pytest.approx(0.3, abs=0.03)


def test_without_a_largest_acceleration_in_yaw_the_angle_controller_of_a_sub_is_linear() -> None:
    gains = {**SUB_HEADING_DEFAULTS, "ATC_RAT_YAW_P": 0.05, "ATC_SLEW_YAW": 1e6, "ATC_RATE_Y_MAX": 0.0}
    free, bound = (
        [
            SUB.simulate(yaw(0.2, 0.75), {**gains, "ATC_ACCEL_Y_MAX": most}, Scenario(size, 5.0), None, 0.0).position
            for size in (0.2, 0.4)
        ]
        for most in (0.0, 9000.0)
    )
    assert free[1] == pytest.approx(2.0 * free[0], abs=1e-9)
    assert np.max(np.abs(bound[1] - 2.0 * bound[0])) > 0.01


@pytest.mark.parametrize("name", POSITIONS)
def test_a_constant_force_displaces_a_starting_loop_until_its_integral_has_grown(name: str) -> None:
    law, gains = LAWS[name], {**DEFAULTS[name], "PSC_ACCZ_I": 1.0}
    craft = heave(0.4, 0.7, 0.0, 0.05) if name == "sub-depth" else yaw(1.0, 2.0, 0.0, 0.02)
    late = law.simulate(craft, gains, Scenario(0.3, 60.0, lead=5.0), 2.0, 0.0)
    before = late.position[late.t < 5.0]
    assert before[0] == 0.0
    assert 0.001 < np.max(before) < 0.1
    settled = law.simulate(craft, gains, Scenario(0.3, 60.0), 2.0, 0.0)
    assert late.position[-1] == pytest.approx(settled.position[-1], abs=0.01)
    assert settled.position[0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("name", LAWS)
def test_the_output_stays_within_full_and_the_same_call_gives_the_same_bits(name: str) -> None:
    law = LAWS[name]
    craft = heave(0.4, 0.7, 0.0, 0.05) if name == "sub-depth" else yaw(1.0, 0.75, 0.1, 0.05)
    first, second = (law.simulate(craft, DEFAULTS[name], Scenario(3.0, 15.0), 2.0, 0.1) for _ in range(2))
    assert np.max(np.abs(first.output)) <= 1.0
    assert np.array_equal(first.position, second.position)
    assert np.array_equal(first.output, second.output)


def test_charlie_with_default_gains_is_unstable_as_by_routh() -> None:
    """T s^3 + (1 + KP) s^2 + K(I + A(FF+P)) s + K A I is unstable at K = 0.2, T = 3.1; this must be coped with."""
    k, time = 0.22 / 1.1, 3.1
    assert (1.0 + 0.2 * k) * k * (0.2 + 0.8) < time * k * 2.0 * 0.2
    motion = ROVER.simulate(CHARLIE, ROVER_DEFAULTS, Scenario(0.5, 120.0), 1.1, 0.03)
    assert np.all(np.isfinite(motion.position))
    assert np.ptp(motion.position[-1500:]) > 0.5


def test_the_rovers_integral_removes_a_trim_above_the_base_speed_only() -> None:
    craft = boat(1.0, 1.0, delta=0.0, delay=0.0)
    scenario = Scenario(0.2, 150.0, push=0.2, push_at=30.0)
    gains = {**STEADY, "ATC_STR_RAT_I": 0.2}
    fast = ROVER.simulate(craft, gains, scenario, 1.05, 0.0).position[-1]
    slow = ROVER.simulate(craft, gains, scenario, 0.95, 0.0).position[-1]
    assert fast == pytest.approx(0.2, abs=2e-3)
    assert slow == pytest.approx(0.2 + 0.2 / (0.2 + 1.5), rel=0.02)


def test_the_rovers_gains_are_valid_at_every_speed_above_base() -> None:
    steps = []
    for speed in (1.5, 3.0, 6.0):
        craft = boat(1.0, 0.3 * speed, 0.0, 0.0)
        steps.append(ROVER.simulate(craft, STEADY, Scenario(0.1, 20.0), speed, 0.0).position)
    assert steps[0] == pytest.approx(steps[1], abs=1e-9)
    assert steps[1] == pytest.approx(steps[2], abs=1e-9)


def test_the_rovers_rate_limit_bounds_the_turn() -> None:
    craft = boat(0.5, 2.0, 0.0, 0.0)
    gains = {**ROVER_DEFAULTS, "ATC_STR_RAT_FF": 0.5, "ATC_STR_RAT_I": 0.0, "ATC_STR_RAT_MAX": 10.0}
    motion = ROVER.simulate(craft, gains, Scenario(1.5, 20.0), 1.0, 0.0)
    assert np.max(np.gradient(motion.position, motion.t)) < math.radians(11.0)


def test_lateral_acceleration_limits_the_turn_of_a_fast_boat() -> None:
    assert ROVER.velocity_limit({"ATC_TURN_MAX_G": 0.1}, 10.0) == pytest.approx(0.0981, rel=1e-3)


def test_vectored_thrust_is_scaled_by_throttle_with_a_note() -> None:
    settings = {**STEADY, "MOT_VEC_ANGLEMAX": 30.0, "CRUISE_SPEED": 2.0, "CRUISE_THROTTLE": 50.0}
    assert any("atan(steering / throttle)" in note for note in ROVER.notes(CHARLIE, settings, 3.0))
    assert scale(settings, 1.0) == pytest.approx(1.0 / (0.25 * math.radians(30.0)))
    once, again = (
        ROVER.simulate(boat(1.0, 0.4 * v, 0.0, 0.0), settings, Scenario(0.01, 10.0), v, 0.0).position for v in (1, 3)
    )
    assert once == pytest.approx(again)


@pytest.mark.parametrize("speed", [0.5, 1.0, 3.0])
def test_vectored_thrust_is_scaled_by_the_throttle_of_the_experiment(
    speed: float,
) -> None:
    promised = {**STEADY, "MOT_VEC_ANGLEMAX": 30.0, "CRUISE_SPEED": 2.0, "CRUISE_THROTTLE": 50.0}
    assert scale({**promised, THROTTLE: 0.8}, speed) == pytest.approx(1.0 / (0.8 * math.radians(30.0)))
    note = ROVER.notes(CHARLIE, {**promised, THROTTLE: 0.8}, speed)[0]
    assert "the throttle of the experiment, 80% of full throttle." in note


@pytest.mark.parametrize("speed", [1.2, 4.0])
@pytest.mark.parametrize("base", [0.5, 1.0])
def test_the_rovers_notes_state_the_feed_forward_for_every_speed(speed: float, base: float) -> None:
    per_speed = 0.8
    settings = {**STEADY, "MOT_SPD_SCA_BASE": base}
    note = ROVER.notes(boat(1.0, per_speed * speed, 0.0, 0.0), settings, speed)[0]
    assert f"identified in MANUAL at {speed:.2f} m/s" in note
    assert f"= 1/(K base) = {1.0 / (per_speed * base):.3g} " in note


def test_a_delay_moves_the_whole_response() -> None:
    now, later = (SUB.simulate(yaw(0.2, 0.75), SUB_HEADING_DEFAULTS, Scenario(0.2, 5.0), None, d) for d in (0, 0.2))
    first = [np.flatnonzero(m.position > 1e-9)[0] for m in (now, later)]
    assert (first[1] - first[0]) * 0.0025 == pytest.approx(0.2, abs=0.003)


def test_the_sub_turns_no_faster_than_it_is_allowed_to_slew() -> None:
    gains = {**SUB_HEADING_DEFAULTS, "ATC_RAT_YAW_P": 0.5, "ATC_SLEW_YAW": 2000.0}
    motion = SUB.simulate(yaw(0.05, 0.1), gains, Scenario(1.5, 10.0), None, 0.0)
    assert np.max(np.gradient(motion.position, motion.t)) < math.radians(26.0)
    assert motion.position[-1] == pytest.approx(1.5, abs=0.02)


def test_a_buoyant_sub_has_a_steady_error_only_without_integral() -> None:
    craft = heave(0.4, 0.7, 0.0, delta=-0.1)
    without = DEPTH.simulate(craft, {**SUB_DEPTH_DEFAULTS, "PSC_ACCZ_I": 0.0}, Scenario(1.0, 40.0), None, 0.0)
    expected = -0.1 / (0.2 * 0.5 * 8.0 * 3.0)
    assert without.position[0] == pytest.approx(expected, rel=1e-6)
    assert without.position[-1] == pytest.approx(1.0 + expected, abs=1e-3)
    held = DEPTH.simulate(craft, SUB_DEPTH_DEFAULTS, Scenario(1.0, 60.0), None, 0.0)
    assert held.position[0] == 0.0
    assert held.position[-1] == pytest.approx(1.0, abs=5e-3)


def test_a_hover_throttle_off_centre_acts_as_a_constant_force() -> None:
    plain = DEPTH.simulate(heave(0.4, 0.7, 0.0, 0.04), SUB_DEPTH_DEFAULTS, Scenario(1.0, 10.0), None, 0.0)
    offset = {**SUB_DEPTH_DEFAULTS, "MOT_THST_HOVER": 0.52}
    same = DEPTH.simulate(heave(0.4, 0.7, 0.0, 0.08), offset, Scenario(1.0, 10.0), None, 0.0)
    assert same.output[0] == pytest.approx(-0.08, abs=2e-3)
    assert same.position == pytest.approx(plain.position, abs=0.01)


def test_the_sub_dives_no_faster_than_its_pilot_speed() -> None:
    motion = DEPTH.simulate(
        heave(0.2, 0.1), {**SUB_DEPTH_DEFAULTS, "PILOT_SPEED_UP": 30.0}, Scenario(3.0, 15.0), None, 0.0
    )
    assert np.max(np.gradient(motion.position, motion.t)) < 0.42


def test_the_heave_step_of_the_videoray_is_independent_of_the_loop_rate() -> None:
    """400 Hz and 200 Hz differ by their discretisation only."""
    fast, slow = (
        DEPTH.simulate(VIDEORAY_HEAVE, {**SUB_DEPTH_DEFAULTS, "SCHED_LOOP_RATE": rate}, Scenario(1.0, 10.0), None, 0.0)
        for rate in (400.0, 200.0)
    )
    assert np.interp(slow.t, fast.t, fast.position) == pytest.approx(slow.position, abs=0.02)


def test_the_thrust_limit_near_the_surface_is_reported_if_the_firmware_has_one() -> None:
    """ALT_HOLD limits the thrust near the surface since 4.7."""
    result = DEPTH.notes(VIDEORAY_HEAVE, {**SUB_DEPTH_DEFAULTS, "SURFACE_MAX_THR": 0.1}, None)
    assert any("SURFACE_MAX_THR" in note for note in result)
    assert not any("SURFACE_MAX_THR" in note for note in DEPTH.notes(VIDEORAY_HEAVE, SUB_DEPTH_DEFAULTS, None))
