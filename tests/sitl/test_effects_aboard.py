"""Hidden effects on a vehicle, seen over the link."""

from __future__ import annotations

import math

import pytest

from sitl import EFFECTS, BadEffect, make_effect
from sitl.__main__ import main
from sitl.effects import parse_effect
from tests.sitl.ground import Ground, boat, refusal_of, rov

ATTITUDE, LOCAL_POSITION, SERVO = 30, 32, 36
NUMBERS = {"V_x": 0.3, "V_y": 0.2, "frequency": 1.0, "factor": 1.02, "depth": 8.0}
PLACES = {"wave-disturbance": "surge", "unit-error": "r", "sign-error": "r", "channel-swap": "x+y"}
NEED_SWAY = ("coriolis-coupling", "sway-yaw-coupling", "sway-moment", "munk-moment")


def hidden(*texts):
    return [parse_effect(text) for text in texts]


def turning(ground, seconds=8.0, *, stick=1700, throttle=1500):
    """Full-ish rudder or yaw for a while; return the true rate of turn at the end."""
    is_boat = ground.vehicle.data.is_boat
    ground.sticks = {1: stick, 3: throttle} if is_boat else {3: 1500, 4: stick, 5: throttle, 6: 1500}
    ground.stream(ATTITUDE, 10)
    ground.stream(LOCAL_POSITION, 10)
    ground.stream(SERVO, 10)
    ground.run(seconds)
    return ground.vehicle.state.r


@pytest.mark.parametrize("slug", [s for s in EFFECTS if s not in NEED_SWAY])
def test_every_applicable_effect_runs_on_a_vehicle(slug):
    kind = EFFECTS[slug]
    values = {p.name: NUMBERS.get(p.name, 0.3) for p in kind.parameters}
    ground = rov(effects=[make_effect(slug, PLACES.get(slug, ""), values)])
    turning(ground, 2.0, throttle=1600)
    body = ground.vehicle.state
    assert all(math.isfinite(value) for value in (body.x, body.z, body.psi, body.u, body.r, body.w))


@pytest.mark.parametrize("slug", NEED_SWAY)
def test_effects_that_need_sway_are_rejected_on_a_vehicle_without_it(slug):
    with pytest.raises(BadEffect, match="needs a hull with sway"):
        Ground("automarine", effects=[make_effect(slug)])
    assert EFFECTS[slug].on_vehicles.startswith("no")


def test_a_dead_zone_blocks_small_inputs_only_on_its_axis():
    dead = rov(effects=hidden("dead-zone.width=0.3"))
    turning(dead, stick=1560, throttle=1560)
    assert dead.servos[:4] != [1500] * 4
    idle, plain = rov(), rov()
    turning(idle, stick=1500, throttle=1560)
    turning(plain, stick=1560, throttle=1560)
    assert dead.vehicle.state.r == pytest.approx(idle.vehicle.state.r)
    assert plain.vehicle.state.r > 3.0 * idle.vehicle.state.r
    assert dead.vehicle.state.u == pytest.approx(plain.vehicle.state.u)


def test_an_effect_can_be_applied_to_another_axis():
    dead = rov(effects=hidden("dead-zone@throttle.width=0.3"))
    turning(dead, stick=1560, throttle=1560)
    assert dead.vehicle.state.u == 0.0
    assert dead.vehicle.state.r > 0.01


def test_a_mass_change_is_scaled_once_and_not_every_tick():
    ground = rov(effects=hidden("mass-change.ratio=2,time=1"))
    plain = rov()
    for axis in ("surge", "heave", "yaw"):
        assert ground.vehicle.plant.axis(axis).alpha == 2.0 * plain.vehicle.plant.axis(axis).alpha


def test_added_drag_slows_the_turn_of_a_boat_with_propeller_dependent_drag():
    assert turning(boat(effects=hidden("linear-drag.coefficient=10")), throttle=1800) < 0.5 * turning(
        boat(), throttle=1800
    )


def test_a_current_moves_the_craft_and_shows_in_velocity_over_ground():
    ground = boat(armed=False, effects=hidden("steady-current.V_x=0.4,V_y=-0.2"))
    turning(ground, 10.0)
    reported = ground.last("LOCAL_POSITION_NED")
    assert (reported.vx, reported.vy) == pytest.approx((0.4, -0.2), abs=0.1)
    body = ground.vehicle.state
    assert (body.x, body.y) == pytest.approx((0.4 * ground.t, -0.2 * ground.t), rel=0.02)


def test_the_wind_turns_the_bow():
    ground = rov(armed=False, effects=hidden("wind-moment.strength=0.3,direction=2", "linear-drag.coefficient=0.1"))
    turning(ground, 60.0)
    assert ground.vehicle.state.psi == pytest.approx(2.0, abs=0.1)


def test_waves_follow_the_seed_of_the_vehicle():
    def heading(seed):
        waves = hidden("wave-disturbance.amplitude=0.3,frequency=2,bandwidth=0.1")
        ground = rov(armed=False, effects=waves, seed=seed)
        ground.run(5.0)
        return ground.vehicle.state.psi

    assert heading(1) == heading(1) != heading(2)


def test_a_compass_deviation_does_not_change_the_motion():
    ground = rov(armed=False, effects=hidden("compass-deviation.B=0.3,C=0.2"))
    turning(ground, 1.0)
    psi = ground.vehicle.state.psi
    off = math.remainder(ground.last("ATTITUDE").yaw - psi, math.tau)
    assert off == pytest.approx(0.3 * math.sin(psi) + 0.2 * math.cos(psi), abs=0.05)


def test_a_gps_antenna_ahead_of_the_centre_moves_around_it():
    ground = boat(effects=hidden("sensor-position@x+y.x_P=5"))
    turning(ground, 8.0, throttle=1600)
    body, reported = ground.vehicle.state, ground.last("LOCAL_POSITION_NED")
    assert abs(body.psi) > 0.3
    assert reported.x - body.x == pytest.approx(5.0 * math.cos(body.psi), abs=0.5)
    assert reported.y - body.y == pytest.approx(5.0 * math.sin(body.psi), abs=0.5)


def test_a_delayed_heading_is_an_earlier_one():
    ground = rov(effects=hidden("measurement-delay@psi.delay=1"))
    turning(ground, 3.0)
    then = ground.vehicle.state.psi
    ground.run(1.0)
    behind = math.remainder(ground.last("ATTITUDE").yaw - then, math.tau)
    assert abs(behind) < 0.1 < ground.vehicle.state.psi - then


def test_a_wrong_clock_scales_only_the_stamps():
    wrong, right = rov(effects=hidden("time-scale.factor=1.1")), rov()
    for ground in (wrong, right):
        turning(ground, 5.0)
    assert wrong.last("ATTITUDE").time_boot_ms == round(1.1 * right.last("ATTITUDE").time_boot_ms)
    assert wrong.last("SERVO_OUTPUT_RAW").time_usec == pytest.approx(1.1 * right.last("SERVO_OUTPUT_RAW").time_usec)
    assert wrong.last("ATTITUDE").yaw == right.last("ATTITUDE").yaw


def test_servo_reports_stamped_early_make_the_motion_seem_late():
    wrong, right = rov(effects=hidden("time-offset.offset=0.5")), rov()
    for ground in (wrong, right):
        turning(ground, 5.0)
    assert right.last("SERVO_OUTPUT_RAW").time_usec - wrong.last("SERVO_OUTPUT_RAW").time_usec == 500_000
    assert wrong.last("ATTITUDE").time_boot_ms == right.last("ATTITUDE").time_boot_ms


@pytest.mark.parametrize("craft", [rov, boat])
def test_steering_reported_with_the_wrong_sign_is_mirrored_only_in_the_report(craft):
    wrong, right = craft(effects=hidden("sign-error@steering")), craft()
    for ground in (wrong, right):
        turning(ground, 5.0, throttle=1600)
    assert wrong.vehicle.state.r == right.vehicle.state.r
    reported, meant = wrong.last("SERVO_OUTPUT_RAW"), right.last("SERVO_OUTPUT_RAW")
    read = right.vehicle.actuators.read
    pulses = [[getattr(m, f"servo{n}_raw") for n in range(1, 9)] for m in (reported, meant)]
    assert read(pulses[0])["N"] == pytest.approx(-read(pulses[1])["N"], abs=2e-3)
    assert read(pulses[1])["N"] > 0.1
    assert read(pulses[0])["X"] == pytest.approx(read(pulses[1])["X"], abs=2e-3)


def test_reported_signals_can_have_the_wrong_unit_sign_or_label():
    right = rov()
    degrees = rov(effects=hidden("unit-error@r.factor=57.2958"))
    turned = rov(effects=hidden("sign-error@psi"))
    swapped = rov(effects=hidden("channel-swap@x+y"))
    knots = rov(effects=hidden("unit-error@u.factor=1.94384"))
    for ground in (right, degrees, turned, swapped, knots):
        turning(ground, 6.0, throttle=1700)
    attitude, place = right.last("ATTITUDE"), right.last("LOCAL_POSITION_NED")
    assert degrees.last("ATTITUDE").yawspeed == pytest.approx(57.2958 * attitude.yawspeed, rel=1e-6)
    assert degrees.last("ATTITUDE").yaw == attitude.yaw
    assert turned.last("ATTITUDE").yaw == pytest.approx(-attitude.yaw)
    reported = swapped.last("LOCAL_POSITION_NED")
    assert (reported.x, reported.y) == pytest.approx((place.y, place.x))
    reported, meant = swapped.last("GLOBAL_POSITION_INT"), right.last("GLOBAL_POSITION_INT")
    east = (meant.lon * 1e-7 - 8.7640) * math.cos(math.radians(44.4250))
    assert reported.lat * 1e-7 - 44.4250 == pytest.approx(east, abs=1e-7)
    fast = knots.last("LOCAL_POSITION_NED")
    # the noise of the speed sideways is not multiplied
    assert math.hypot(fast.vx, fast.vy) == pytest.approx(1.94384 * math.hypot(place.vx, place.vy), rel=1e-3)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["charlie", "--effect", "backlsh.width=0.05"], "unknown effect 'backlsh'; did you mean backlash?"),
        (["charlie", "--effect", "backlash.wdth=0.05"], "backlash has no parameter 'wdth'; did you mean width?"),
        (["charlie", "--effect", "backlash.width"], "Use SLUG.PARAMETER=NUMBER"),
        (["charlie", "--effect", "backlash@vertical.width=0.05"], "this craft has no input 'vertical'"),
        (["charlie", "--effect", "net-buoyancy.force=1"], "acts on heave, which this craft does not have"),
        (["automarine", "--effect", "coriolis-coupling.X_vr=1"], "needs a hull with sway"),
        (["automarine", "--effect", "channel-swap@u+psi"], "no message contains both u and psi"),
    ],
)
def test_a_wrong_effect_is_explained_in_one_line(arguments, said, capsys):
    assert said in refusal_of(arguments, capsys)


def test_the_effects_are_listed_with_their_parameters(capsys):
    assert main(["--list-effects"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines if not line.startswith(" ")] == list(EFFECTS)
    assert any(line.split()[:2] == ["time_constant", "[s]"] for line in lines)
