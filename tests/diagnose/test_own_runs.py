"""What our own runs hold besides their manoeuvre, and constants beside forces that drift."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray
from runs_in_the_tank import towed
from test_process_noise import as_from_a_log, nobody, weathered

from gcs_autotune.diagnose import diagnose
from gcs_autotune.diagnose.intake import is_one_flight, within_manoeuvre
from gcs_autotune.diagnose.missing_force import MissingCurve, MissingForce, words_of
from gcs_autotune.diagnose.process_noise import PRESENT, search_with_process_noise
from gcs_autotune.effects import EFFECTS
from gcs_autotune.identify.kalman import NoisyFit, ProcessNoise
from gcs_autotune.identify.problems import data_summary_of, plain_form
from gcs_autotune.identify.signals import prepare_as_recorded
from gcs_autotune.sensor import moves
from gcs_autotune.trial import Channel, Trial

Array = NDArray[np.float64]

STEP = 0.1

SEEDS = [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3))]


def steered(thrust: Array, rudder: Array, *, steers: float = 0.8, trim: float = 0.02, seed: int = 1) -> Trial:
    """Return a run of a boat of inertia 4 and drag 2 whose rudder's moment goes, in part, with thrust squared."""
    rng, samples, fine = np.random.default_rng(seed), len(thrust), 20
    psi, r, path, rate = 0.0, 0.0, np.empty(samples), np.empty(samples)
    for k in range(samples):
        path[k], rate[k] = psi, r
        moment = rudder[k] * (1.0 - steers + steers * thrust[k] ** 2 / 0.64) + trim
        for _ in range(fine):
            psi += STEP / fine * r
            r += STEP / fine * (moment - 2.0 * r) / 4.0
    t = STEP * np.arange(samples)
    channels = {
        "psi": Channel("psi", "rad", t, path + 0.002 * rng.normal(size=samples)),
        "r": Channel("r", "rad/s", t, rate + 0.001 * rng.normal(size=samples)),
        "N": Channel("N", "1", t, rudder),
        "X": Channel("X", "1", t, thrust),
    }
    return Trial(f"run{seed}", channels, meta={"manoeuvre": "step"})


def helm(samples: int, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return np.asarray(np.repeat(rng.uniform(-0.5, 0.5, samples // 40 + 1), 40)[:samples], dtype=np.float64)


def thrusts(levels: Sequence[float], samples: int) -> Array:
    return np.asarray(np.repeat(levels, math.ceil(samples / len(levels)))[:samples], dtype=np.float64)


def test_approach_and_clean_up_of_an_own_run_are_left_out() -> None:
    thrust = np.concatenate([np.linspace(0.0, 0.8, 20), np.full(300, 0.8), np.linspace(0.8, 0.0, 10)])
    run = steered(thrust, helm(330, 2))
    part = within_manoeuvre(run, ["N"])
    assert part["psi"].t[0] == pytest.approx(1.5)  # three quarters of the usual thrust
    assert part["psi"].t[-1] == pytest.approx(32.3)
    assert len(part["N"]) == len(run["N"])  # an actuator that lags begins where earlier commands have left it
    assert within_manoeuvre(run, ["N", "X"]) is run
    assert within_manoeuvre(Trial("lake", run.channels), ["N"]).channels is run.channels


def test_a_run_that_mostly_coasts_is_kept_whole() -> None:
    thrust = np.concatenate([np.full(100, 0.8), np.zeros(230)])
    run = steered(thrust, helm(330, 2))
    assert within_manoeuvre(run, ["N"]) is run


@pytest.mark.slow
def test_steering_by_the_propeller_s_wash_is_identified_and_no_change_of_mass() -> None:
    ramp = np.linspace(0.9, 0.7, 400)
    runs = [steered(ramp, helm(400, 3), seed=3), steered(np.full(400, 0.8), helm(400, 4), seed=4)]
    found = diagnose(runs, dof="yaw", effects=["input-bias", "propeller-wash", "mass-change", "gain-drift"])
    assert {c.effect.slug for c in found.causes} == {"input-bias", "propeller-wash"}
    values = {c.effect.slug: next(iter(c.effect.values.values())) for c in found.causes}
    assert values["propeller-wash"] == pytest.approx(0.8, abs=0.05)
    assert found.verdict == "effect-found"


def turned(largest: float, astern: float, seed: int) -> Trial:
    """Return a run of a boat with two thrusters that are weaker astern, at 0.4 of full throttle."""
    steering, ahead = np.clip(1.6 * helm(400, seed), -largest, largest), np.full(400, 0.4)

    def push(u: Array) -> Array:
        return np.where(u < 0.0, astern * u, u)

    acting = np.asarray(0.5 * (push(ahead + steering) - push(ahead - steering)), dtype=np.float64)
    run = steered(ahead, acting, steers=0.0, trim=0.005, seed=seed)
    return replace(run, channels={**run.channels, "N": Channel("N", "1", run["N"].t, steering)})


def found_of_thrusters(largest: float, seed: int) -> dict[tuple[str, str], float]:
    runs = [turned(largest, 0.5, 10 * seed + k) for k in range(2)]
    slugs = ["input-bias", "asymmetric-thrust", "saturation", "quadratic-actuator", "actuator-lag", "time-offset"]
    found = diagnose(runs, dof="yaw", effects=slugs)
    return {(c.effect.slug, c.effect.place): next(iter(c.effect.values.values())) for c in found.causes}


@pytest.mark.parametrize("seed", SEEDS)
def test_two_thrusters_that_are_weaker_astern_are_identified_where_hard_turns_take_one_there(seed: int) -> None:
    found = found_of_thrusters(0.8, seed)
    assert set(found) == {("input-bias", "yaw"), ("asymmetric-thrust", "N+X")}
    assert found["asymmetric-thrust", "N+X"] == pytest.approx(0.5, abs=0.05)


def test_two_thrusters_that_never_went_astern_do_not_show_which_way_they_are_weaker() -> None:
    assert set(found_of_thrusters(0.4, 4)) == {("input-bias", "yaw")}


def test_runs_that_are_each_flown_once_complete_each_other() -> None:
    run = steered(np.full(60, 0.8), helm(60, 1))
    relays = [replace(run, meta={"manoeuvre": "relay", "C": size}) for size in (0.15, 0.3, 0.9)]
    assert is_one_flight([run, *relays])
    assert not is_one_flight([*relays, relays[0]])
    assert not is_one_flight([run])
    assert not is_one_flight([*relays, Trial("lake", run.channels)])


@pytest.mark.parametrize(("way", "still"), [(0.0, True), (0.5, False)])
def test_nothing_goes_with_a_velocity_that_is_noise(way: float, still: bool) -> None:
    rng, run = np.random.default_rng(1), steered(np.full(300, 0.8), helm(300, 1))
    u = Channel("u", "m/s", run["psi"].t, way + 0.02 * rng.normal(size=300))
    run = replace(run, channels={**run.channels, "u": u})
    form = plain_form([run], "yaw")
    data = data_summary_of(form, prepare_as_recorded([run], form, None)[0])
    assert ("u" in data.still) is still
    assert any("u" in place for place in EFFECTS["velocity-product"].places(data)) is not still


def test_thrust_that_a_relay_cannot_tell_from_backlash_is_called_a_dead_zone() -> None:
    runs = []
    for k, size in enumerate((0.15, 0.3, 0.9)):
        command = np.asarray(size * np.where(np.arange(300) // 15 % 2, 1.0, -1.0), dtype=np.float64)
        command[:5] = 0.0
        acting = np.sign(command) * np.maximum(np.abs(command) - 0.08, 0.0)
        run = steered(np.zeros(300), acting, steers=0.0, trim=0.0, seed=k)
        meta = {"manoeuvre": "relay", "C": size}
        runs.append(replace(run, meta=meta, channels={**run.channels, "N": Channel("N", "1", run["N"].t, command)}))
    found = diagnose(runs, dof="yaw", effects=["backlash", "dead-zone", "input-bias"])
    assert [c.effect.slug for c in found.causes] == ["dead-zone"]
    assert any({"dead-zone", "backlash"} <= set(group) for group in found.indistinguishable)


@pytest.mark.slow
def test_a_moment_that_a_recorded_command_explains_is_no_change_of_mass() -> None:
    falling = thrusts([0.9, 0.7], 400)
    runs = [steered(falling, helm(400, k), seed=k) for k in (3, 4)]
    found = diagnose(runs, dof="yaw", effects=["input-bias", "mass-change"])
    assert "mass-change" not in {c.effect.slug for c in found.causes}


def test_a_change_of_mass_that_no_command_explains_is_identified() -> None:
    runs = towed(("mass-change", "yaw", {"ratio": 1.6, "time": 12.0}))
    found = diagnose(runs, effects=["mass-change", "gain-drift", "quadratic-drag"])
    assert [c.effect.slug for c in found.causes] == ["mass-change"]


def test_inertia_that_follows_a_command_is_a_rival_of_every_change_in_time() -> None:
    assert [s for s, e in EFFECTS.items() if e.happens_at] == ["mass-change"]


@pytest.mark.parametrize("seed", [1, 2])
def test_a_constant_force_is_no_process_noise(seed: int) -> None:
    """A drifting force with a long memory is a constant, and stood in its place."""
    problem, base = as_from_a_log(towed(("input-bias", "yaw", {"bias": 0.3}), seed=seed))
    found = search_with_process_noise(problem, base, ("input-bias",), (), nobody)
    assert found is not None
    assert found.calm < PRESENT


@pytest.mark.parametrize("seed", SEEDS)
def test_a_constant_is_identified_beside_process_noise(seed: int) -> None:
    problem, base = as_from_a_log(weathered(seed, size=0.1, memory=1.0, days=[(0.15, 0.0)] * 3))
    found = search_with_process_noise(problem, base, ("input-bias",), (), nobody)
    assert found is not None and found.calm > PRESENT
    assert [a.effect.slug for a in found.accepted] == ["input-bias"]
    assert found.accepted[0].effect["bias"] == pytest.approx(0.15, abs=0.06)


@pytest.mark.parametrize("seed", SEEDS)
def test_process_noise_alone_has_no_constant(seed: int) -> None:
    problem, base = as_from_a_log(weathered(seed, size=0.1, memory=1.0))
    found = search_with_process_noise(problem, base, ("input-bias",), (), nobody)
    assert found is not None
    assert found.accepted == ()


def test_the_force_missing_has_intervals_and_says_when_it_may_be_a_constant() -> None:
    noise, covariance = ProcessNoise(0.1, 20.0, 1e-3), np.diag([0.0, 0.0, 0.1**2, 0.7**2, 0.0])
    fit = NoisyFit(cast(Any, None), np.ones(2), (), ("k_N", "N_r"), (), noise, np.ones(1), covariance, ())
    assert fit.interval_of("size") == pytest.approx((0.082, 0.122), abs=0.001)
    assert fit.interval_of("memory") == pytest.approx((5.07, 78.9), abs=0.1)
    assert fit.interval_of("smoothing") == (0.0, math.inf)
    nothing = cast(Any, SimpleNamespace(accepted=(), steps=()))
    missing = MissingForce("yaw", "1", 0.1, 20.0, math.nan, {}, (), None, (0.082, 0.122), (5.07, 78.9), 60.0)
    assert words_of(nothing, missing)[0].endswith(
        "its correlation time is 20 s (95 %: size 0.082 to 0.12, time 5.1 s to 78.9 s); these runs do not "
        "distinguish it from a constant force"
    )
    assert words_of(nothing, replace(missing, longest=600.0))[0].endswith("78.9 s)")
    assert missing.to_dict()["memory95"] == [5.07, 78.9]


def test_a_motion_that_did_not_happen_explains_no_force() -> None:
    noise = 0.02 * np.random.default_rng(1).normal(size=600)
    assert not moves(noise)
    assert moves(noise + 0.2 * np.sin(0.05 * np.arange(600)))


def test_a_curve_whose_band_holds_a_constant_varies_with_nothing() -> None:
    x, force = np.arange(4.0), np.array([0.10, 0.12, 0.11, 0.13])
    assert not MissingCurve("v", "m/s", x, force, np.full(4, 0.05), 0.6).varies
    assert MissingCurve("v", "m/s", x, force, np.full(4, 0.005), 0.6).varies
