"""Runs of the program itself: what they contain apart from the manoeuvre, and constant forces among drifting ones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray
from open_loop_runs import towed
from test_process_noise import as_from_a_log, drifting_runs, no_progress

from benchmarks import own_runs
from gcs_autotune.diagnose import diagnose, process_noise, strategies
from gcs_autotune.diagnose.intake import is_one_flight, within_manoeuvre
from gcs_autotune.diagnose.missing_force import MissingCurve, MissingForce, words_of
from gcs_autotune.diagnose.process_noise import PRESENT, search_with_process_noise
from gcs_autotune.diagnose.question import Question
from gcs_autotune.diagnose.score import ALIKE
from gcs_autotune.diagnose.state import SearchState, begin
from gcs_autotune.effects import EFFECTS, EffectInstance
from gcs_autotune.errors import PreconditionFailed
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


def test_approach_and_clean_up_of_a_run_of_the_program_are_left_out() -> None:
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


def causes_with_thrusters(largest: float, seed: int) -> dict[tuple[str, str], float]:
    runs = [turned(largest, 0.5, 10 * seed + k) for k in range(2)]
    slugs = ["input-bias", "asymmetric-thrust", "saturation", "quadratic-actuator", "actuator-lag", "time-offset"]
    found = diagnose(runs, dof="yaw", effects=slugs)
    return {(c.effect.slug, c.effect.place): next(iter(c.effect.values.values())) for c in found.causes}


@pytest.mark.parametrize("seed", SEEDS)
def test_thrusters_weaker_astern_are_identified_if_hard_turns_run_one_astern(seed: int) -> None:
    found = causes_with_thrusters(0.8, seed)
    assert set(found) == {("input-bias", "yaw"), ("asymmetric-thrust", "N+X")}
    assert found["asymmetric-thrust", "N+X"] == pytest.approx(0.5, abs=0.05)


def test_thrusters_that_never_ran_astern_show_no_asymmetry() -> None:
    assert set(causes_with_thrusters(0.4, 4)) == {("input-bias", "yaw")}


def test_different_manoeuvres_flown_once_each_count_as_one_flight() -> None:
    run = steered(np.full(60, 0.8), helm(60, 1))
    relays = [replace(run, meta={"manoeuvre": "relay", "C": size}) for size in (0.15, 0.3, 0.9)]
    assert is_one_flight([run, *relays])
    assert not is_one_flight([*relays, relays[0]])
    assert not is_one_flight([run])
    assert not is_one_flight([*relays, Trial("lake", run.channels)])


@pytest.mark.parametrize(("way", "still"), [(0.0, True), (0.5, False)])
def test_no_effect_depends_on_a_velocity_that_is_only_noise(way: float, still: bool) -> None:
    rng, run = np.random.default_rng(1), steered(np.full(300, 0.8), helm(300, 1))
    u = Channel("u", "m/s", run["psi"].t, way + 0.02 * rng.normal(size=300))
    run = replace(run, channels={**run.channels, "u": u})
    form = plain_form([run], "yaw")
    data = data_summary_of(form, prepare_as_recorded([run], form, None)[0])
    assert ("u" in data.still) is still
    assert any("u" in place for place in EFFECTS["velocity-product"].places(data)) is not still


def test_thrust_that_a_relay_cannot_distinguish_from_backlash_is_reported_as_a_dead_zone() -> None:
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
def test_a_moment_that_a_recorded_command_explains_is_not_reported_as_a_change_of_mass() -> None:
    falling = thrusts([0.9, 0.7], 400)
    runs = [steered(falling, helm(400, k), seed=k) for k in (3, 4)]
    found = diagnose(runs, dof="yaw", effects=["input-bias", "mass-change"])
    assert "mass-change" not in {c.effect.slug for c in found.causes}


def test_a_change_of_mass_that_no_command_explains_is_identified() -> None:
    runs = towed(("mass-change", "yaw", {"ratio": 1.6, "time": 12.0}))
    found = diagnose(runs, effects=["mass-change", "gain-drift", "quadratic-drag"])
    assert [c.effect.slug for c in found.causes] == ["mass-change"]


def test_a_change_of_mass_is_the_only_effect_that_happens_at_a_time() -> None:
    assert [s for s, e in EFFECTS.items() if e.happens_at] == ["mass-change"]


@pytest.mark.parametrize("seed", [1, 2])
def test_a_constant_force_is_not_taken_for_process_noise(seed: int) -> None:
    """A drifting force with a long memory is a constant, and replaced it."""
    problem, base = as_from_a_log(towed(("input-bias", "yaw", {"bias": 0.3}), seed=seed))
    found = search_with_process_noise(problem, base, ("input-bias",), (), no_progress)
    assert found is not None
    assert found.calm < PRESENT


@pytest.mark.parametrize("seed", SEEDS)
def test_a_constant_force_is_identified_together_with_process_noise(seed: int) -> None:
    problem, base = as_from_a_log(drifting_runs(seed, size=0.1, memory=1.0, offsets=[(0.15, 0.0)] * 3))
    found = search_with_process_noise(problem, base, ("input-bias",), (), no_progress)
    assert found is not None and found.calm > PRESENT
    assert [a.effect.slug for a in found.accepted] == ["input-bias"]
    assert found.accepted[0].effect["bias"] == pytest.approx(0.15, abs=0.06)


@pytest.mark.parametrize("seed", SEEDS)
def test_process_noise_alone_yields_no_constant_force(seed: int) -> None:
    problem, base = as_from_a_log(drifting_runs(seed, size=0.1, memory=1.0))
    found = search_with_process_noise(problem, base, ("input-bias",), (), no_progress)
    assert found is not None
    assert found.accepted == ()


def test_the_missing_force_has_intervals_and_a_note_when_it_may_be_constant() -> None:
    noise, covariance = ProcessNoise(0.1, 20.0, 1e-3), np.diag([0.0, 0.0, 0.1**2, 0.7**2, 0.0])
    fit = NoisyFit(cast(Any, None), np.ones(2), (), ("k_N", "N_r"), (), noise, np.ones(1), covariance, ())
    assert fit.interval_of("size") == pytest.approx((0.082, 0.122), abs=0.001)
    assert fit.interval_of("memory") == pytest.approx((5.07, 78.9), abs=0.1)
    assert fit.interval_of("smoothing") == (0.0, math.inf)
    nothing = cast(Any, SimpleNamespace(accepted=(), steps=()))
    missing = MissingForce("yaw", "1", 0.1, 20.0, math.nan, {}, (), None, (0.082, 0.122), (5.07, 78.9), 60.0)
    assert words_of(nothing, missing)[0].endswith(
        "Its correlation time is 20 s (95 % intervals: size 0.082 to 0.12, time 5.1 s to 78.9 s). These runs do not "
        "distinguish it from a constant force"
    )
    assert words_of(nothing, replace(missing, longest=600.0))[0].endswith("78.9 s)")
    assert missing.to_dict()["memory95"] == [5.07, 78.9]


def test_a_motion_within_the_noise_explains_no_force() -> None:
    noise = 0.02 * np.random.default_rng(1).normal(size=600)
    assert not moves(noise)
    assert moves(noise + 0.2 * np.sin(0.05 * np.arange(600)))


def test_a_curve_whose_band_contains_a_constant_does_not_vary() -> None:
    x, force = np.arange(4.0), np.array([0.10, 0.12, 0.11, 0.13])
    assert not MissingCurve("v", "m/s", x, force, np.full(4, 0.05), 0.6).varies
    assert MissingCurve("v", "m/s", x, force, np.full(4, 0.005), 0.6).varies


def pushed_ahead(seed: int, levels: Sequence[float]) -> Trial:
    """Return a run of a boat with quadratic thrust and drag that only moves ahead, in a drifting force."""
    rng, fine, keep = np.random.default_rng(seed), 0.02, math.exp(-0.02 / 2.0)
    X = np.repeat(np.asarray(levels, dtype=np.float64), 25)
    u, push, speed = 1.5 * math.sqrt(X[0]), 0.0, np.empty(len(X))
    for k in range(len(X)):
        speed[k] = u
        for _ in range(10):
            u += fine * (0.25 * X[k] ** 2 - 0.11 * u * abs(u) + push)
            push = keep * push + rng.normal(0.0, 0.01 * math.sqrt(1.0 - keep * keep))
    t = 0.2 * np.arange(len(X))
    seen = speed + 0.02 * rng.normal(size=len(X))
    return Trial(f"run{seed}", {"u": Channel("u", "m/s", t, seen), "X": Channel("X", "1", t, X)})


@pytest.mark.slow
def test_curves_of_thrust_and_drag_replace_the_constant_that_was_tried_first() -> None:
    levels = (0.3, 0.8, 0.5, 0.2, 0.7, 0.35, 0.9, 0.4)
    problem, base = as_from_a_log([pushed_ahead(40 + k, np.roll(levels, k).tolist()) for k in range(3)])
    slugs = ("input-bias", "quadratic-drag", "quadratic-actuator")
    found = search_with_process_noise(problem, base, slugs, (), no_progress)
    assert found is not None
    assert {a.effect.slug for a in found.accepted} == {"quadratic-drag", "quadratic-actuator"}


def dead_and_square(seed: int) -> list[Trial]:
    """Return runs of a craft with a dead zone of 0.3 and quadratic drag, in a drifting moment."""
    found = []
    for run in drifting_runs(seed, square=0.0, size=0.05):
        N, psi = run["N"], run["psi"]
        rng, heading, r, path = np.random.default_rng(seed), 0.0, 0.0, np.empty(len(N))
        for k, u in enumerate(N.values):
            path[k] = heading
            acting = math.copysign(max(abs(u) - 0.3, 0.0), u)
            for _ in range(10):
                heading += 0.02 * r
                r += 0.02 * (acting - 0.2 * r - abs(r) * r)
        seen = path + 1e-3 * rng.normal(size=len(N))
        found.append(replace(run, channels={"psi": Channel("psi", "rad", psi.t, seen), "N": N}))
    return found


@pytest.mark.slow
def test_two_causes_are_accepted_together_if_neither_is_certain_alone() -> None:
    problem, base = as_from_a_log(dead_and_square(1))
    slugs = ("quadratic-drag", "dead-zone")
    found = search_with_process_noise(problem, base, slugs, (), no_progress)
    assert found is not None and found.steps
    first = next(j for j in found.steps[0].judged if j.effect.slug == "quadratic-drag")
    unsure = replace(first, lacks="not-sure", gained=first.needed + 1.0)
    step = replace(found.steps[0], judged=(unsure,), accepted=None)
    begun = replace(found, steps=(), fit=found.plain)
    pair = process_noise._pair(begun, step, slugs, no_progress)
    assert pair is not None
    assert {a.effect.slug for a in pair.accepted} == {"quadratic-drag", "dead-zone"}
    weak = replace(step, judged=(replace(unsure, lacks="weak"),))
    assert process_noise._pair(begun, weak, slugs, no_progress) is None


def stepped_rov(seed: int) -> Trial:
    """Return yaw steps of a small ROV with quadratic drag alone, a quadratic thrust curve and a slight bias."""
    rng, interval, parts = np.random.default_rng(seed), 0.1, 400
    N = np.repeat([0.0, 0.67, 0.335, 0.0, -0.67, -0.335, 0.0], [16, 97, 98, 98, 98, 98, 100])
    psi, r, heading = np.empty(len(N)), np.empty(len(N)), 0.0
    rate = 0.0
    for k, u in enumerate(N):
        psi[k], r[k] = heading, rate
        force = 0.34 * u + 0.66 * u * abs(u) / 0.67 + 0.0018
        for _ in range(parts):
            heading += interval / parts * rate
            rate += interval / parts * (force - 0.055 * rate * abs(rate)) / 0.0217
    t = interval * np.arange(len(N))
    noisy = {
        "psi": ("rad", psi + 0.0044 * rng.normal(size=len(N))),
        "r": ("rad/s", r + 0.004 * rng.normal(size=len(N))),
    }
    columns = {"N": ("1", N), **noisy}
    return Trial("steps", {n: Channel(n, unit, t, values) for n, (unit, values) in columns.items()})


@pytest.mark.slow
def test_three_causes_that_help_only_together_are_found_although_a_force_seems_to_drift(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(strategies, "needs_process_noise", lambda state: (state, True))
    run = stepped_rov(1)
    some = ["quadratic-drag", "dead-zone", "quadratic-actuator", "input-bias", "backlash", "advance-speed-loss"]
    form = plain_form([run], "yaw")
    found = strategies.add_causes(begin(Question(form, prepare_as_recorded([run], form, None)[0], some)))
    causes = {e.slug: e for e in found.causes}
    drag, _ = causes.pop("quadratic-drag"), causes.pop("input-bias")
    (thrust,) = causes.values()
    # commands of two sizes do not distinguish a curve from a dead zone: the drag beside a dead zone is a quarter less
    assert thrust.slug in ("quadratic-actuator", "dead-zone")
    assert drag["coefficient"] == pytest.approx(0.055 if thrust.slug == "quadratic-actuator" else 0.0414, rel=0.02)
    last = [step for step in found.steps if step.accepted][-1].judged
    assert {j.effect.slug for j in last[:2]} == {"quadratic-actuator", "dead-zone"}
    assert last[0].evidence == pytest.approx(last[1].evidence, abs=ALIKE)
    assert last[1].gain > 0.9  # scored on held-out data too


def throttled(levels: Sequence[float], seconds: Sequence[float], seed: int) -> Trial:
    """Return throttle steps of a boat whose thrust and drag are both quadratic, as of Charlie: 1.5 m/s at full
    throttle.
    """
    rng, interval, parts = np.random.default_rng(seed), 0.1, 20
    X = np.repeat(levels, [round(s / interval) for s in seconds])
    u, speed = np.empty(len(X)), 1.07
    for k, output in enumerate(X):
        u[k] = speed
        for _ in range(parts):
            speed += interval / parts * (output**2 - speed**2 / 2.25) / 4.0
    t = interval * np.arange(len(X))
    noisy = {"X": ("1", X), "u": ("m/s", u + 0.02 * rng.normal(size=len(X)))}
    return Trial(f"throttle-{seed}", {n: Channel(n, unit, t, values) for n, (unit, values) in noisy.items()})


def test_quadratic_drag_and_a_quadratic_thrust_curve_are_found_although_neither_improves_the_fit_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(strategies, "needs_process_noise", lambda state: (state, True))
    runs = [
        throttled((0.8, 0.36, 1.0, 0.0, 0.8), (1.0, 12.1, 11.8, 12.0, 0.5), 1),
        throttled((0.8, 0.0, 1.0, 0.56, 0.8), (1.0, 12.0, 12.0, 10.5, 0.5), 2),
    ]
    form = plain_form(runs, "surge")
    some = ["quadratic-drag", "quadratic-actuator", "input-bias", "dead-zone", "advance-speed-loss"]
    segments = [segment for run in prepare_as_recorded(runs, form, None) for segment in run]
    begun = begin(Question(form, segments, some))
    found = strategies.add_causes(begun)
    first = found.steps[0].judged
    assert next(j for j in first if j.effect.slug == "quadratic-drag").evidence < 0.0
    assert {e.slug for e in found.causes} == {"quadratic-drag", "quadratic-actuator"}


def with_forces(run: Trial, slugs: Sequence[str]) -> SearchState:
    """Return a search in which *slugs* were accepted, fitted to *run*."""
    form = plain_form([run], "yaw")
    state = begin(Question(form, prepare_as_recorded([run], form, None)[0], list(EFFECTS)))
    data = state.problem.data_summary
    forces = tuple(EffectInstance(s, "yaw", dict(EFFECTS[s].starts("yaw", data)[0])) for s in slugs)
    fit = state.problem.fit(state.base.theta, forces, state.base.initial)
    assert fit is not None
    return state.with_model(fit)


def test_two_forces_that_cancel_except_for_a_constant_are_replaced_by_it() -> None:
    state = with_forces(steered(np.full(300, 0.8), helm(300, 5)), ["wind-moment", "tether-pull"])
    plain = strategies.plain_constants(state)
    assert plain is not None
    assert [e.slug for e in plain.causes] == ["input-bias"]
    assert plain.causes[0]["bias"] == pytest.approx(0.02, abs=0.002)
    assert strategies.plain_constants(plain) is None


def test_a_wind_that_the_runs_show_is_not_replaced_by_a_constant() -> None:
    rudder = 0.4 + 0.2 * helm(300, 6)
    run = steered(np.full(300, 0.8), rudder, trim=0.0)
    psi = run["psi"]
    wind, path, r, heading = 0.3, np.empty(len(psi)), 0.0, 0.0
    for k in range(len(psi)):
        path[k] = heading
        for _ in range(20):
            heading += STEP / 20 * r
            r += STEP / 20 * (rudder[k] + wind * math.sin(heading) - 2.0 * r) / 4.0
    noise = 0.002 * np.random.default_rng(1).normal(size=len(psi))
    run = replace(run, channels={"psi": Channel("psi", "rad", psi.t, path + noise), "N": run["N"]})
    state = with_forces(run, ["wind-moment"])
    assert [e.slug for e in state.causes] == ["wind-moment"]
    assert strategies.plain_constants(state) is None


def test_a_flight_that_the_vehicle_rejected_is_not_repeated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    flights = []

    def refuse(case: own_runs.Case, place: Path) -> None:
        flights.append(place)
        (place / "trials").mkdir(parents=True)
        raise PreconditionFailed("the craft is not stable on course")

    monkeypatch.setattr(own_runs, "_fly", refuse)
    case = own_runs.Case("cybership2", "zig-zag", "", 1)
    first, second = (own_runs.run_case(case, tmp_path) for _ in range(2))
    assert first.rejected and second.rejected
    assert first.summary == second.summary == "PreconditionFailed: the craft is not stable on course"
    assert len(flights) == 1
