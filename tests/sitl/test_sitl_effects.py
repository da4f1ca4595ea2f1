"""Each hidden effect alone, in the open-loop simulator, against its law derived by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sitl.effects import EFFECTS, BadEffect, Setting, make_effect, parse_effect
from sitl.open_loop import Hull, open_loop
from sitl.plants import State, Water, Wrench

SLUGS = [
    "time-scale",
    "time-offset",
    "unit-error",
    "sign-error",
    "channel-swap",
    "input-delay",
    "saturation",
    "rate-limit",
    "actuator-lag",
    "backlash",
    "dead-zone",
    "quadratic-actuator",
    "rudder-stall",
    "asymmetric-thrust",
    "command-coupling",
    "gain-drift",
    "speed-dependent-steering",
    "propeller-wash",
    "advance-speed-loss",
    "linear-drag",
    "quadratic-drag",
    "coriolis-coupling",
    "sway-yaw-coupling",
    "sway-moment",
    "speed-damping",
    "munk-moment",
    "velocity-product",
    "mass-change",
    "net-buoyancy",
    "ground-effect",
    "input-bias",
    "steady-current",
    "changing-current",
    "wind-moment",
    "wind-load",
    "wave-disturbance",
    "tether-pull",
    "tether-line",
    "shallow-water",
    "bank-suction",
    "sensor-position",
    "compass-deviation",
    "gyro-bias",
    "measurement-delay",
    "quantisation",
    "outliers",
]

QUICK = Hull(("yaw",), {"yaw": 0.02}, {"yaw": 1.0})
"""So quick that its rate is the moment."""
SLOW = Hull(("yaw",), {"yaw": 3.0}, {"yaw": 1.0})
PLANE = Hull(
    ("surge", "sway", "yaw"), {"surge": 10.0, "sway": 15.0, "yaw": 2.0}, {"surge": 5.0, "sway": 10.0, "yaw": 2.0}
)
DIVER = Hull(("heave",), {"heave": 12.0}, {"heave": 6.0}, bottom=10.0)
RAMP = np.linspace(-1.0, 1.0, 201)


def turn(hull, slug, values, command, *, place="", measured=("psi", "r"), interval=0.1, **more):
    command = np.asarray(command, dtype=float)
    effect = make_effect(slug, place, values)
    return open_loop(
        hull, {"N": command}, duration=interval * len(command), interval=interval, measured=measured, effects=[effect],
        **more,
    )  # fmt: skip


def moment(slug, values, command, **more):
    """What the actuator does [N m] by the end of each sample, seen through a hull that follows at once."""
    return turn(QUICK, slug, values, command, **more)["r"][1:]


def integrate(slope, start, t):
    return solve_ivp(slope, (t[0], t[-1]), start, t_eval=t, rtol=1e-9, atol=1e-9, max_step=0.05).y


def test_every_effect_of_the_catalogue_exists():
    assert list(EFFECTS) == SLUGS


@pytest.mark.parametrize(
    ("slug", "values", "law"),
    [
        ("saturation", {"limit": 0.6}, lambda u: np.clip(u, -0.6, 0.6)),
        ("dead-zone", {"width": 0.2}, lambda u: np.sign(u) * np.maximum(np.abs(u) - 0.2, 0.0)),
        ("quadratic-actuator", {"share": 0.7}, lambda u: 0.3 * u + 0.7 * u * np.abs(u)),
        ("quadratic-actuator", {"share": 1.0, "u_ref": 2.0}, lambda u: u * np.abs(u) / 2.0),
        (
            "rudder-stall",
            {"angle": 0.4, "drop": 1.5},
            lambda u: np.where(np.abs(u) <= 0.4, u, np.sign(u) * np.maximum(0.4 - 1.5 * (np.abs(u) - 0.4), 0.0)),
        ),
        ("asymmetric-thrust", {"ratio": 0.5}, lambda u: np.where(u < 0.0, 0.5 * u, u)),
    ],
)
def test_a_static_actuator_nonlinearity_changes_its_command(slug, values, law):
    assert moment(slug, values, RAMP) == pytest.approx(law(RAMP[:-1]), abs=1e-2)


def test_a_drifting_gain_falls_with_time_to_a_lower_limit():
    done = moment("gain-drift", {"rate": 0.1}, np.ones(201))
    t = 0.1 * np.arange(1, 201)
    assert done == pytest.approx(np.maximum(1.0 - 0.1 * t, 0.05), abs=1e-2)


def test_a_delayed_command_acts_later_by_any_fraction_of_a_sample():
    command = np.where(np.arange(60) < 20, 0.3, -0.3)
    late = turn(SLOW, "input-delay", {"delay": 0.537}, command)
    t = late["t"]
    exact = np.where(
        t < 2.537,
        0.3 * (1.0 - np.exp(-t / 3.0)),
        -0.3 + (0.6 - 0.3 * np.exp(-2.537 / 3.0)) * np.exp(-(t - 2.537) / 3.0),
    )
    assert late["r"] == pytest.approx(exact, abs=1e-5)


def test_a_lagging_actuator_starts_at_its_first_command_and_follows_exponentially():
    done = moment("actuator-lag", {"time_constant": 0.5}, np.where(np.arange(80) < 20, 0.4, -0.4))
    t = 0.1 * np.arange(1, 80)
    assert done == pytest.approx(np.where(t <= 2.0, 0.4, -0.4 + 0.8 * np.exp(-(t - 2.02) / 0.5)), abs=1e-2)


def test_a_rate_limited_actuator_starts_at_its_first_command_and_moves_in_a_straight_line():
    done = moment("rate-limit", {"rate": 0.5}, np.where(np.arange(80) < 20, 0.4, -0.4))
    t = 0.1 * np.arange(1, 80)
    assert done == pytest.approx(np.clip(0.4 - 0.5 * (t - 2.02), -0.4, 0.4), abs=1e-2)


def test_backlash_holds_until_the_gap_is_crossed():
    command = np.concatenate([np.linspace(0.0, 1.0, 51), np.linspace(1.0, 0.0, 51)])
    done = moment("backlash", {"width": 0.3}, command)
    expected, y = [], command[0]
    for u in command:
        y = min(max(y, u - 0.15), u + 0.15)
        expected.append(y)
    assert done == pytest.approx(expected[:-1], abs=1e-2)
    assert done[51:60] == pytest.approx(0.85, abs=1e-2)


def test_steering_is_proportional_to_the_square_of_the_speed():
    hull = Hull(("surge", "yaw"), {"surge": 1e6, "yaw": 0.1}, {"yaw": 1.0})
    for speed in (0.5, 1.0, 2.0):
        run = turn(
            hull, "speed-dependent-steering", {"share": 0.8, "U_ref": 1.0}, np.ones(50), initial={"u": speed}
        )  # fmt: skip
        assert run["r"][-1] == pytest.approx(0.2 + 0.8 * speed**2, rel=1e-3)


def test_a_thruster_loses_force_with_advance():
    run = turn(SLOW, "advance-speed-loss", {"loss": 0.5}, np.full(400, -0.4))
    assert run["r"][-1] == pytest.approx(-0.4 / (1.0 + 0.5 * 0.4), rel=1e-4)


def test_drag_is_added_to_one_degree_of_freedom():
    linear = turn(SLOW, "linear-drag", {"coefficient": 0.5}, np.ones(300))
    assert linear["r"] == pytest.approx((1.0 - np.exp(-linear["t"] / 2.0)) / 1.5, abs=1e-4)
    quadratic = turn(SLOW, "quadratic-drag", {"coefficient": 6.0}, np.ones(300))
    assert quadratic["r"] == pytest.approx(
        integrate(lambda t, r: (1.0 - r - 6.0 * np.abs(r) * r) / 3.0, [0.0], quadratic["t"])[0], abs=1e-4
    )


def plane(slug, values, *, place="", initial=None, commands=None):
    commands = commands or {"X": [(0.0, 4.0)], "Y": [(0.0, 1.0)], "N": [(0.0, 0.6)]}
    return open_loop(
        PLANE, commands, duration=20.0, interval=0.1, measured=("x", "y", "psi", "u", "v", "r"), initial=initial,
        effects=[make_effect(slug, place, values)],
    )  # fmt: skip


def test_coriolis_couples_the_three_horizontal_degrees_of_freedom():
    run = plane("coriolis-coupling", {"X_vr": 15.0, "Y_ur": -10.0, "N_uv": -5.0})

    def slope(t, s):
        u, v, r = s
        return [
            (4.0 + 15.0 * v * r - 5.0 * u) / 10.0,
            (1.0 - 10.0 * u * r - 10.0 * v) / 15.0,
            (0.6 - 5.0 * u * v - 2.0 * r) / 2.0,
        ]

    exact = integrate(slope, [0.0, 0.0, 0.0], run["t"])
    assert len(run["t"]) > 10
    for name, truth in zip("uvr", exact, strict=True):
        assert run[name] == pytest.approx(truth, abs=2e-4)


def test_sway_and_yaw_share_damping_and_mass_with_the_sign_of_sname():
    run = plane("sway-yaw-coupling", {"Y_r": 0.7, "N_v": -1.1, "Y_rdot": 2.0})
    M = np.array([[15.0, -2.0], [-2.0, 2.0]])

    def slope(t, s):
        v, r = s
        return np.linalg.solve(M, [1.0 - 10.0 * v + 0.7 * r, 0.6 - 2.0 * r - 1.1 * v])

    exact = integrate(slope, [0.0, 0.0], run["t"])
    assert run["v"] == pytest.approx(exact[0], abs=2e-4)
    assert run["r"] == pytest.approx(exact[1], abs=2e-4)


def test_a_payload_changes_the_inertia_but_not_the_speed():
    run = turn(SLOW, "mass-change", {"ratio": 2.0, "time": 2.0}, np.ones(100))
    t = run["t"]
    before = 1.0 - np.exp(-np.minimum(t, 2.0) / 3.0)
    exact = 1.0 - (1.0 - before) * np.exp(-np.maximum(t - 2.0, 0.0) / 6.0)
    assert run["r"] == pytest.approx(exact, abs=1e-4)


def dive(slug, values, *, place="", **more):
    return open_loop(
        DIVER, {"Z": [(0.0, 1.2)]}, duration=60.0, interval=0.1, measured=("z", "w"),
        effects=[make_effect(slug, place, values)], **more,
    )  # fmt: skip


def test_a_heavy_craft_sinks():
    assert dive("net-buoyancy", {"force": 0.6})["w"][-1] == pytest.approx(0.3, rel=1e-6)


def test_drag_grows_towards_the_bottom():
    run = dive("ground-effect", {"strength": 2.0, "length": 1.5}, initial={"z": 3.0})

    def slope(t, s):
        z, w = s
        return [w, (1.2 - 6.0 * (1.0 + 2.0 * math.exp(-(10.0 - z) / 1.5)) * w) / 12.0]

    exact = integrate(slope, [3.0, 0.0], run["t"])
    above = exact[0] < 10.0
    assert 450 < np.sum(above) < 600
    assert run["z"][above] == pytest.approx(exact[0][above], abs=1e-3)


def test_a_bias_is_added_in_units_of_the_input():
    assert turn(SLOW, "input-bias", {"bias": 0.2}, np.zeros(400))["r"][-1] == pytest.approx(0.2, rel=1e-4)
    hull = Hull(("yaw",), {"yaw": 1.0}, {"yaw": 1.0}, gain=3.0)
    bias = make_effect("input-bias", "yaw", {"bias": 0.2})
    run = open_loop(hull, {"delta": [(0.0, 0.0)]}, duration=20.0, interval=0.1, measured=("r",), effects=[bias])
    assert run["r"][-1] == pytest.approx(0.6, rel=1e-4)


@pytest.mark.parametrize(("place", "shown"), [("", True), ("over ground", True), ("through water", False)])
def test_a_current_moves_the_hull_and_appears_only_in_speed_over_ground(place, shown):
    run = plane("steady-current", {"V_x": 0.3, "V_y": -0.2}, place=place)
    still = plane("linear-drag", {"coefficient": 0.0})
    assert run["x"] - still["x"] == pytest.approx(0.3 * run["t"], abs=1e-6)
    assert run["y"] - still["y"] == pytest.approx(-0.2 * run["t"], abs=1e-6)
    c, s = np.cos(run["psi"]), np.sin(run["psi"])
    assert run["u"] - still["u"] == pytest.approx(shown * (0.3 * c - 0.2 * s), abs=1e-6)
    assert run["v"] - still["v"] == pytest.approx(shown * (-0.2 * c - 0.3 * s), abs=1e-6)


def test_the_wind_turns_the_bow_to_its_direction():
    run = turn(SLOW, "wind-moment", {"strength": 0.5, "direction": 2.0}, np.zeros(1200))
    assert run["psi"][-1] == pytest.approx(2.0, abs=1e-3)
    first = turn(QUICK, "wind-moment", {"strength": 0.01, "direction": 2.0}, np.zeros(11))
    assert first["r"][-1] == pytest.approx(0.01 * math.sin(2.0 - first["psi"][-1]), rel=1e-2)


def waves(interval, count, **values):
    """The bare force of waves at even times."""
    effect = make_effect("wave-disturbance", "yaw", {"amplitude": 0.3, "frequency": 2.0, **values})
    plain = {"dofs": ("yaw",), "inputs": {"N": "yaw"}, "amplitude": {"N": 1.0}, "gain": {}, "signals": ("r",)}
    effect.begin(Setting(state=State(), water=Water(), parameters={}, **plain))
    force = []
    for k in range(count):
        wrench = Wrench()
        effect.alter_force(interval * k, wrench)
        force.append(wrench.N)
    return np.array(force)


@pytest.mark.parametrize("interval", [0.02, 0.2])
def test_waves_have_the_specified_rms_and_spectrum(interval):
    count = 40000
    force = waves(interval, count, bandwidth=0.1)
    assert np.std(force) == pytest.approx(0.3, rel=0.1)
    power = np.abs(np.fft.rfft(force)) ** 2
    omega = 2.0 * np.pi * np.fft.rfftfreq(count, interval)
    density = (0.2 * 2.0 * omega) ** 2 / ((4.0 - omega**2) ** 2 + (0.2 * 2.0 * omega) ** 2)
    for low, high in ((0.0, 1.5), (1.5, 2.0), (2.0, 2.5), (2.5, 6.0)):
        band = (omega > low) & (omega <= high)
        expected = density[band].sum() / density.sum()
        assert power[band].sum() / power.sum() == pytest.approx(expected, rel=0.3), (low, high)


def test_waves_without_bandwidth_are_one_sinusoid():
    t = 0.1 * np.arange(300)
    basis = np.column_stack([np.sin(2.0 * t), np.cos(2.0 * t)])
    fit, left, *_ = np.linalg.lstsq(basis, waves(0.1, 300), rcond=None)
    assert np.hypot(*fit) == pytest.approx(0.3 * math.sqrt(2.0))
    assert left[0] < 1e-20


def test_waves_follow_the_seed():
    wave = {"amplitude": 0.3, "frequency": 2.0, "bandwidth": 0.1}
    a, b, c = (moment("wave-disturbance", wave, np.zeros(50), seed=seed) for seed in (1, 1, 2))
    assert np.array_equal(a, b)
    assert not np.array_equal(a, c)


def test_a_tether_pulls_the_heading_or_the_depth_back_to_its_anchor():
    assert turn(SLOW, "tether-pull", {"stiffness": 0.2, "anchor": 1.0}, np.zeros(900))["psi"][-1] == pytest.approx(
        1.0, 1e-3
    )
    assert dive("tether-pull", {"stiffness": 1.0, "anchor": 4.0}, place="heave")["z"][-1] == pytest.approx(
        5.2, rel=1e-3
    )


def test_a_horizontal_tether_pulls_towards_its_anchor_position():
    run = plane("tether-pull", {"stiffness": 1.0, "x": 2.0, "y": -1.0}, place="surge+sway", initial={"psi": 0.8})

    def slope(t, s):
        x, y, psi, u, v, r = s
        c, sn = math.cos(psi), math.sin(psi)
        fx, fy = 2.0 - x, -1.0 - y
        return [
            c * u - sn * v,
            sn * u + c * v,
            r,
            (4.0 + c * fx + sn * fy - 5.0 * u) / 10.0,
            (1.0 - sn * fx + c * fy - 10.0 * v) / 15.0,
            (0.6 - 2.0 * r) / 2.0,
        ]

    exact = integrate(slope, [0.0, 0.0, 0.8, 0.0, 0.0, 0.0], run["t"])
    assert run["x"] == pytest.approx(exact[0], abs=1e-3)
    assert run["y"] == pytest.approx(exact[1], abs=1e-3)


COMMAND = np.where(np.arange(300) % 100 < 50, 0.4, -0.3)


@pytest.fixture(scope="module")
def truth():
    return turn(SLOW, "linear-drag", {"coefficient": 0.0}, COMMAND)


def test_a_compass_deviates_with_the_heading(truth):
    run = turn(SLOW, "compass-deviation", {"B": 0.1, "C": -0.05}, COMMAND)
    psi = truth["psi"]
    assert run["psi"] == pytest.approx(psi + 0.1 * np.sin(psi) - 0.05 * np.cos(psi), abs=1e-12)
    assert np.array_equal(run["r"], truth["r"])


def test_an_off_centre_sensor_measures_the_motion_of_its_own_position_without_extra_noise():
    files = []
    for effects in ([], [make_effect("sensor-position", "", {"x_P": 0.6, "y_P": -0.2})]):
        usual = {"duration": 20.0, "interval": 0.1, "measured": ("u", "v", "x", "y"), "noise": {"u": 0.01}}
        files.append(open_loop(PLANE, {"N": [(0.0, 1.0)], "X": [(2.0, 3.0)]}, effects=effects, **usual))
    true = open_loop(PLANE, {"N": [(0.0, 1.0)]}, duration=20.0, interval=0.1, measured=("psi", "r"))
    plain, shown = files
    c, s = np.cos(true["psi"]), np.sin(true["psi"])
    assert shown["u"] - plain["u"] == pytest.approx(0.2 * true["r"], abs=1e-9)
    assert shown["v"] - plain["v"] == pytest.approx(0.6 * true["r"], abs=1e-9)
    assert shown["x"] - plain["x"] == pytest.approx(0.6 * c + 0.2 * s, abs=1e-9)
    assert shown["y"] - plain["y"] == pytest.approx(0.6 * s - 0.2 * c, abs=1e-9)


def test_a_sensor_position_for_a_compass_is_rejected():
    with pytest.raises(BadEffect, match="psi does not depend on the sensor's position"):
        turn(SLOW, "sensor-position", {"x_P": 1.0}, COMMAND, place="psi")
    with pytest.raises(BadEffect, match="neither speed nor position"):
        turn(SLOW, "sensor-position", {"x_P": 1.0}, COMMAND)


def test_a_gyro_is_off_by_its_bias(truth):
    run = turn(SLOW, "gyro-bias", {"bias": 0.03}, COMMAND)
    assert run["r"] == pytest.approx(truth["r"] + 0.03, abs=1e-12)
    assert np.array_equal(run["psi"], truth["psi"])


@pytest.mark.parametrize("place", ["psi", "psi+r", "all"])
def test_a_late_signal_shows_the_past(place):
    """The hull has been under the first command for as long as the signal is late."""
    run = turn(SLOW, "measurement-delay", {"delay": 0.3}, COMMAND, place=place)
    longer = turn(SLOW, "linear-drag", {"coefficient": 0.0}, np.concatenate([COMMAND[:3], COMMAND]))
    assert run["psi"] == pytest.approx(longer["psi"][:-3], abs=1e-5)
    assert run["r"] == pytest.approx(longer["r"][3:] if place == "psi" else longer["r"][:-3], abs=1e-5)


def test_a_late_signal_keeps_fractions_of_a_sample():
    usual = {"measured": ("psi", "r"), "initial": {"r": 0.0}}
    run = turn(SLOW, "measurement-delay", {"delay": 0.25}, np.full(100, 0.3), place="r", **usual)
    assert run["r"] == pytest.approx(0.3 * (1.0 - np.exp(-run["t"] / 3.0)), abs=1e-4)
    late = run["psi"] - 0.3 * ((run["t"] + 0.25) - 3.0 * (1.0 - np.exp(-(run["t"] + 0.25) / 3.0)))
    assert late == pytest.approx(np.zeros(100), abs=1e-4)


def test_quantised_signals_come_in_steps(truth):
    run = turn(SLOW, "quantisation", {"step": 0.05}, COMMAND, place="psi")
    assert run["psi"] == pytest.approx(0.05 * np.round(truth["psi"] / 0.05), abs=1e-12)


def test_outliers_occur_in_the_specified_fraction_of_samples(truth):
    run = turn(SLOW, "outliers", {"share": 0.1, "size": 0.5}, COMMAND, place="r", seed=3)
    struck = run["r"] != truth["r"]
    assert 0.05 < np.mean(struck) < 0.15
    assert 0.3 < np.sqrt(np.mean((run["r"] - truth["r"])[struck] ** 2)) < 0.7
    assert np.array_equal(run["psi"], truth["psi"])


def test_a_wrong_clock_scales_only_the_stamps(truth):
    run = turn(SLOW, "time-scale", {"factor": 1.1}, COMMAND)
    assert run["t"] == pytest.approx(1.1 * truth["t"])
    for name in ("N", "psi", "r"):
        assert np.array_equal(run[name], truth[name])


def test_signals_with_late_stamps_appear_to_respond_late(truth):
    late = turn(SLOW, "time-offset", {"offset": 0.5}, COMMAND)
    early = turn(SLOW, "time-offset", {"offset": -0.5}, COMMAND)
    change = int(np.argmax(np.diff(truth["N"]) != 0.0)) + 1
    assert np.argmax(truth["r"]) == change
    assert np.argmax(late["r"]) == change + 5
    assert np.argmax(early["r"]) == change - 5
    assert np.array_equal(late["N"], truth["N"])


def test_columns_can_have_the_wrong_unit_sign_or_label(truth):
    degrees = turn(SLOW, "unit-error", {"factor": 57.2958}, COMMAND, place="r")
    assert degrees["r"] == pytest.approx(57.2958 * truth["r"])
    assert np.array_equal(degrees["psi"], truth["psi"])
    turned = turn(SLOW, "sign-error", {}, COMMAND, place="N")
    assert np.array_equal(turned["N"], -truth["N"])
    assert np.array_equal(turned["r"], truth["r"])
    swapped = turn(SLOW, "channel-swap", {}, COMMAND, place="psi+r")
    assert np.array_equal(swapped["psi"], truth["r"])
    assert np.array_equal(swapped["r"], truth["psi"])


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("dead-zon.width=0.1", "did you mean dead-zone"),
        ("gremlins.size=3", "see --list-effects"),
        ("dead-zone.wdth=0.1", "no parameter 'wdth'; did you mean width"),
        ("dead-zone", "dead-zone needs width"),
        ("dead-zone.width=wide", "Use SLUG.PARAMETER=NUMBER"),
        ("dead-zone.width=-1", "The minimum is 0"),
        ("dead-zone.width=nan", "finite"),
        ("actuator-lag.time_constant=0", "The minimum is"),
        ("compass-deviation.B=nan", r"compass-deviation\.B=nan: 'nan' is not a finite number\."),
        ("compass-deviation.B=5", r"The maximum is 1 rad\. Did you mean 0\.0873 \(5 degrees\)\?"),
        ("compass-deviation.C=-5", r"The minimum is -1 rad\. Did you mean -0\.0873"),
    ],
)
def test_an_impossible_effect_is_explained(text, reason):
    with pytest.raises(BadEffect, match=reason):
        parse_effect(text)


def test_an_effect_is_specified_with_its_place_and_several_numbers():
    effect = parse_effect("wave-disturbance@surge.amplitude=0.1,frequency=2,bandwidth=0.05")
    assert (effect.slug, effect.place) == ("wave-disturbance", "surge")
    assert effect.values == {
        "amplitude": 0.1,
        "frequency": 2.0,
        "bandwidth": 0.05,
        "gamma": 0.0,
        "direction": 0.0,
        "drift": 0.0,
    }


@pytest.mark.parametrize(
    ("slug", "place", "values", "reason"),
    [
        ("dead-zone", "X", {"width": 0.1}, "no input 'X'"),
        ("net-buoyancy", "", {"force": 1.0}, "acts on heave"),
        ("steady-current", "", {"V_x": 1.0}, "with surge or sway"),
        ("coriolis-coupling", "", {"X_vr": 1.0}, "needs a hull with sway"),
        ("gyro-bias", "psi", {"bias": 0.1}, "not a gyro rate"),
        ("quantisation", "z", {"step": 0.1}, "'z' is not measured here"),
        ("channel-swap", "psi", {}, "two columns joined by"),
        ("ground-effect", "", {"strength": 1.0, "length": 1.0}, "with heave"),
    ],
)
def test_an_effect_without_its_place_is_rejected(slug, place, values, reason):
    with pytest.raises(BadEffect, match=reason):
        turn(SLOW, slug, values, np.ones(10), place=place)
