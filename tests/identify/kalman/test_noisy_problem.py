"""A drifting force as part of the model: its size, its correlation time, and what it is distinguished from."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from gcs_autotune.effects import EFFECTS, EffectInstance
from gcs_autotune.identify.kalman import NoisyProblem, ProcessNoise, filter_bank, thinned_to
from gcs_autotune.identify.problems import Limits, data_summary_of
from gcs_autotune.identify.signals import Segment, Signal
from gcs_autotune.models import Form
from gcs_autotune.trial import Channel

Array = NDArray[np.float64]

FORM = Form(
    "plain", "yaw", ("yaw",), ("k_N", "N_r"), {"I_z": 1.0}, {"N": (("N", "k_N"),)}, coriolis=False, per_inertia=("N",)
)
GAIN, DAMPING, SIZE, MEMORY, STEP = 0.5, 0.6, 0.05, 3.0, 0.2


SEA = (2.4, 0.1)
"""Frequency [rad/s] and damping ratio of the waves."""


def waves(rng: np.random.Generator, fine: float, count: int) -> Array:
    """Return waves (count,) of unit spread in steps of *fine* [s]: exact, by the matrix exponential."""
    omega, zeta = SEA
    F = expm(fine * np.array([[0.0, omega], [-omega, -2.0 * zeta * omega]]))
    L = np.linalg.cholesky(np.eye(2) - F @ F.T + 1e-15 * np.eye(2))
    state, found = rng.normal(0.0, 1.0, 2), np.empty(count)
    for i in range(count):
        found[i] = state[1]
        state = F @ state + L @ rng.normal(0.0, 1.0, 2)
    return found


def run(
    seed: int,
    *,
    square: float = 0.0,
    slide: float = 0.0,
    size: float = SIZE,
    force: float = 0.0,
    thrust: float = 1.0,
    swing: float = 0.0,
    slap: float = 0.0,
) -> Segment:
    """Return a relay run of 80 s, in steps of 0.01 s; *force*, *thrust*: offsets of this run.

    swing, slap : standard deviations of what waves of :data:`SEA` add to the heading seen, and of how they push.
    """
    rng = np.random.default_rng(seed)
    fine, count = 0.01, 8000
    t = fine * np.arange(count)
    command = np.where(np.floor(t / (4.0 + seed)) % 2 == 0, 1.0, -0.6)
    v = 0.3 * np.sin(0.11 * t + seed)
    psi, r, push = 0.0, 0.0, rng.normal(0.0, size)
    path = np.empty(count)
    keep = math.exp(-fine / MEMORY)
    sea = waves(np.random.default_rng(100 + seed), fine, count) if swing or slap else np.zeros(count)
    for i in range(count):
        path[i] = psi
        psi += fine * r
        own = thrust * GAIN * command[i] + force + slap * sea[i]
        r += fine * (own - DAMPING * r - square * abs(r) * r + slide * v[i] + push)
        push = keep * push + rng.normal(0.0, size * math.sqrt(1.0 - keep * keep))
    every = round(STEP / fine)
    at = t[::every]
    seen = path[::every] + swing * sea[::every] + rng.normal(0.0, 1e-3, len(at))
    jumps = np.flatnonzero(np.r_[True, np.diff(command) != 0.0])
    channels = {"v": Channel("v", "m/s", at, v[::every])}
    signals = {"psi": Signal("psi", at, seen, 0.0)}
    inputs = command[jumps][:, None]
    return Segment(f"run{seed}", f"run{seed}", t[jumps], inputs, ("N",), ("1",), signals, measured=channels)


def problem_of(segments: list[Segment]) -> NoisyProblem:
    """Return the yaw problem of these runs."""
    data = data_summary_of(FORM, segments, {"k_N": GAIN, "N_r": -DAMPING})
    return NoisyProblem(FORM, segments, data, Limits({}, {}))


DRAG = (EffectInstance("quadratic-drag", "yaw", {"coefficient": 0.1}),)
BEGIN = (np.array([0.3, -1.0]), (), ProcessNoise(0.02, 1.0, 3e-3))


def test_gain_damping_and_process_noise_are_identified_together() -> None:
    fit = problem_of([run(1), run(2)]).fit(*BEGIN)
    assert fit is not None
    std = np.sqrt(np.diag(fit.covariance))
    assert np.all(np.abs(fit.theta - [GAIN, -DAMPING]) < 3.0 * std[:2])
    assert abs(math.log(fit.noise.size / SIZE)) < 3.0 * std[2]
    assert abs(math.log(fit.noise.sensor / 1e-3)) < 3.0 * std[4]
    e, S = (np.concatenate([r[k] for r in fit.innovations]) for k in (1, 2))
    assert 0.85 < float(np.mean(e * e / S)) < 1.15


def test_a_force_that_vanishes_in_a_fit_is_no_longer_an_unknown() -> None:
    calm, rng = run(1, size=0.0), np.random.default_rng(1)
    psi = calm.signals["psi"]
    rough = replace(psi, values=psi.values + rng.normal(0.0, 0.03, len(psi.values)))
    problem = problem_of([replace(calm, signals={"psi": rough})])
    fit = problem.fit(np.array([GAIN, -DAMPING]), (), ProcessNoise(1e-8, 3.0, 0.03))
    assert fit is not None
    assert fit.noise.unknowns == ("sensor",)
    assert fit.covariance.shape == (fit.unknowns, fit.unknowns) == (3, 3)
    assert problem.tangent(fit) is not None


def test_too_fine_steps_of_one_trial_do_not_stop_later_fits() -> None:
    """A trial needed steps 512 times finer than a second; no later pass finished, and no cause was tried."""
    problem = problem_of([run(1)])
    before = problem.fit(BEGIN[0], DRAG, BEGIN[2], rounds=2)
    assert before is not None
    bank = problem.bank(DRAG, BEGIN[2])
    bank._max_rates = [1e6]
    assert problem.run(before.theta, DRAG, before.noise) is None
    assert problem.tangent(before) is not None
    bank._max_rates = [1e6]
    again = problem.fit(before.theta, before.effects, before.noise, rounds=0)
    assert again is not None and again.total == pytest.approx(before.total, abs=1e-3)


def test_a_drifting_force_starts_every_run_with_its_own_variance() -> None:
    problem = problem_of([run(1), run(1)])
    fit = problem.fit(*BEGIN, rounds=3)
    assert fit is not None
    assert fit.log_likelihood[0] == pytest.approx(fit.log_likelihood[1], rel=1e-9)


def test_a_trial_of_a_craft_without_inertia_leaves_no_fine_steps_behind(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """After a trial with an inertia a hundred times too small, every later pass took a hundred times as long."""
    requested: list[float] = []
    forward = filter_bank.forward

    def noted(*arguments: Any) -> float:
        requested.append(arguments[18])
        return float(forward(*arguments))

    monkeypatch.setattr(filter_bank, "forward", noted)
    problem = problem_of([run(1)])
    assert problem.run(np.array([GAIN, -200.0]), DRAG, BEGIN[2]) is not None
    fit = problem.fit(BEGIN[0], DRAG, BEGIN[2])
    assert requested[1] > 200.0  # [1/s], what steps are short against
    assert max(requested[2:]) < 10.0
    alone = problem_of([run(1)]).fit(BEGIN[0], DRAG, BEGIN[2])
    assert fit is not None and alone is not None
    assert fit.theta == pytest.approx(alone.theta, rel=1e-6)


def test_the_smoother_estimates_the_drifting_force() -> None:
    problem = problem_of([run(3, size=0.2)])
    done = problem.run(np.array([GAIN, -DAMPING]), (), ProcessNoise(0.2, MEMORY, 1e-3), full=True)
    assert done is not None
    bank, result, levels = done
    smoothed = bank.smooth(result, levels)
    variance = smoothed.variances[0][:, len(bank.states)]
    assert np.all(variance > 0.0) and np.all(variance < 0.2**2)
    filtered = result.histories[0].covariance[:, len(bank.states), len(bank.states)]
    assert np.all(variance[1:-1] <= filtered[1:-1] * (1.0 + 1e-9))
    path = smoothed.trajectories[0][:, len(bank.states)]
    assert 0.1 < float(np.std(path)) < 0.3


@pytest.mark.parametrize(("slug", "name", "how", "true"), [
    ("quadratic-drag", "coefficient", {"square": 1.5}, 1.5),
    ("sway-moment", "N_v", {"slide": 0.5}, 0.5),
])  # fmt: skip
def test_an_effect_is_identified_at_its_size_with_process_noise(
    slug: str, name: str, how: dict[str, float], true: float
) -> None:
    problem = problem_of([run(1, **how), run(2, **how)])
    plain = problem.fit(*BEGIN)
    assert plain is not None
    own = EffectInstance(slug, "yaw", {name: 0.1}, dict(EFFECTS[slug].constants("yaw", problem.data_summary)))
    fit = problem.fit(plain.theta, (own,), plain.noise)
    assert fit is not None
    assert fit.total > plain.total + 10.0
    assert abs(fit.effects[0][name] - true) < 3.5 * fit.errors_of(own)[name]


def test_bursts_weigh_less_with_a_heavy_tailed_distribution() -> None:
    segment = run(1)
    own = segment.signals["psi"]
    values = own.values.copy()
    values[150:] += 0.15
    torn = Segment(
        "torn", "torn", segment.t_in, segment.inputs, ("N",), ("1",), {"psi": Signal("psi", own.t, values, 0.0)}
    )
    problem = problem_of([torn])
    normal = problem.fit(*BEGIN)
    tailed = problem.fit(BEGIN[0], (), ProcessNoise(0.02, 1.0, 3e-3, freedom=4.0))
    assert normal is not None
    assert tailed is not None
    assert tailed.total > normal.total + 10.0


def test_inputs_sampled_faster_than_needed_are_replaced_by_their_means() -> None:
    segment = run(1)
    t = np.arange(0.0, 80.0, 0.02)
    busy = Segment("busy", "busy", t, np.sin(t)[:, None], ("N",), ("1",), {"psi": segment.signals["psi"]})
    (thin,) = thinned_to([busy], "psi", 1.0)
    assert len(thin.signals["psi"].t) == 80
    assert len(thin.t_in) < len(t) / 8
    begin, end = thin.t_in[:-2], thin.t_in[1:-1]
    assert thin.inputs[:-2, 0] == pytest.approx((np.cos(begin) - np.cos(end)) / (end - begin), abs=0.02)
    assert len(thinned_to([segment], "psi", 1.0)[0].t_in) == len(segment.t_in)


def test_the_prediction_error_grows_with_the_process_noise() -> None:
    errors = []
    for size in (1e-4, 0.1):
        problem = problem_of([run(1, size=size)])
        fit = problem.fit(np.array([GAIN, -DAMPING]), (), ProcessNoise(size, MEMORY, 1e-3), rounds=0)
        assert fit is not None
        errors.append(float(np.sqrt(np.mean(problem.ahead(fit, 5.0) ** 2))))
    assert errors[0] < 0.01
    assert errors[1] > 5.0 * errors[0]


def test_a_heading_smoothed_both_ways_is_not_a_lag() -> None:
    segments = []
    for seed in (1, 2):
        segment = run(seed)
        own = segment.signals["psi"]
        values, kept = own.values.copy(), math.exp(-STEP / 0.5)
        for _ in range(2):
            for i in range(1, len(values)):
                values[i] = kept * values[i - 1] + (1.0 - kept) * values[i]
            values = values[::-1]
        segments.append(replace(segment, signals={"psi": replace(own, values=values)}))
    problem = problem_of(segments)
    sharp = problem.fit(*BEGIN)
    blurred = problem.fit(BEGIN[0], (), replace(BEGIN[2], smoothing=STEP))
    assert sharp is not None
    assert blurred is not None
    assert blurred.total > sharp.total + 5.0
    assert 0.25 < blurred.noise.smoothing < 1.0
    assert abs(blurred.theta[1] + DAMPING) < abs(sharp.theta[1] + DAMPING)
    lag = EffectInstance("actuator-lag", "N", {"time_constant": 0.2}, {"resolution": 0.001})
    late = problem.fit(blurred.theta, (lag,), blurred.noise)
    assert late is not None
    assert late.total < blurred.total + 6.0


LINEAR: dict[str, tuple[EffectInstance, ...]] = {
    "nothing": (),
    "input-delay": (EffectInstance("input-delay", "N", {"delay": 0.73}),),
    "dead-zone": (EffectInstance("dead-zone", "N", {"width": 0.2}),),
    "actuator-lag": (EffectInstance("actuator-lag", "N", {"time_constant": 0.8}),),
    "input-bias": (EffectInstance("input-bias", "yaw", {"bias": 0.07}),),
    "sway-moment": (EffectInstance("sway-moment", "yaw", {"N_v": 0.3}),),
    "advance-speed-loss": (EffectInstance("advance-speed-loss", "N", {"loss": 0.2}, {"axis": 5.0, "gain": 1.0}),),
    "speed-damping and a delay": (
        EffectInstance("input-delay", "N", {"delay": 0.31}),
        EffectInstance("speed-damping", "yaw", {"N_|u|r": -0.4}),
    ),
}


CHOPPY = {"wave_swing": 0.03, "wave_force": 0.08, "wave_frequency": SEA[0], "wave_damping": SEA[1]}


@pytest.mark.parametrize("name", LINEAR)
@pytest.mark.parametrize("more", [{}, {"smoothing": 0.35}, CHOPPY], ids=["no waves", "smoothed", "waves"])
def test_exact_transitions_match_the_general_pass(name: str, more: dict[str, float]) -> None:
    runs = [run(1), run(2)]
    speed = Channel("u", "m/s", runs[0].stamps, 1.0 + 0.3 * np.sin(0.2 * runs[0].stamps))
    problem = problem_of([replace(r, measured={**r.measured, "u": speed}) for r in runs])
    effects, noise = LINEAR[name], replace(ProcessNoise(0.05, 2.5, 2e-3), **more)
    theta = np.array([0.45, -0.7])
    assert problem._linear(effects) is not None
    exact = problem.innovations_at(theta, effects, noise)
    done = problem.run(theta, effects, noise)
    assert exact is not None and done is not None
    for (_, e, S), history in zip(exact, done[1].histories, strict=True):
        seen = ~np.isnan(history.S[:, 0])
        assert e == pytest.approx(history.e[seen, 0], abs=1e-3 * float(np.sqrt(S.min())))
        assert S == pytest.approx(history.S[seen, 0], rel=1e-3)


@pytest.mark.parametrize("damping", [0.0, 1e-5, 1e-3, 0.3, 40.0, -0.1])
def test_exact_transitions_are_valid_at_every_damping(damping: float) -> None:
    """From a craft without damping to one that follows at once."""
    problem = problem_of([run(1)])
    noise = ProcessNoise(0.05, 2.5, 2e-3)
    exact = problem.innovations_at(np.array([0.45, -damping]), (), noise)
    done = problem.run(np.array([0.45, -damping]), (), noise)
    assert exact is not None and done is not None
    history = done[1].histories[0]
    seen = ~np.isnan(history.S[:, 0])
    assert exact[0][1] == pytest.approx(history.e[seen, 0], abs=1e-4 * float(np.sqrt(exact[0][2].min())))
    assert exact[0][2] == pytest.approx(history.S[seen, 0], rel=1e-4)


@pytest.mark.parametrize("slug", ["quadratic-drag", "tether-pull", "wind-moment", "ground-effect"])
def test_nonlinear_effects_use_the_general_pass(slug: str) -> None:
    values = {q.name: 0.1 for q in EFFECTS[slug].parameters}
    effect = EffectInstance(slug, "yaw", values, {"dives": 0.0, "bottom": 5.0})
    assert problem_of([run(1)])._linear((effect,)) is None


def test_exact_transitions_match_the_general_pass_for_velocities() -> None:
    segment = run(1)
    own = segment.signals["psi"]
    rate = Signal("r", own.t, np.gradient(own.values, own.t), 0.0)
    problem = problem_of([replace(segment, signals={"r": rate})])
    exact = problem.innovations_at(np.array([0.45, -0.7]), (), ProcessNoise(0.05, 2.5, 2e-2))
    done = problem.run(np.array([0.45, -0.7]), (), ProcessNoise(0.05, 2.5, 2e-2))
    assert exact is not None and done is not None
    history = done[1].histories[0]
    seen = ~np.isnan(history.S[:, 0])
    assert exact[0][1] == pytest.approx(history.e[seen, 0], abs=1e-6)
    assert exact[0][2] == pytest.approx(history.S[seen, 0], rel=1e-5)


def test_waves_are_identified_and_do_not_bias_the_craft() -> None:
    """Without them in the model the time constant is wrong: the heading seems to respond at once."""
    problem = problem_of([run(k, swing=0.03, slap=0.04) for k in (1, 2, 3)])
    calm = problem.fit(*BEGIN)
    begun = replace(BEGIN[2], wave_swing=0.01, wave_force=0.01, wave_frequency=2.0)
    fit = problem.fit(BEGIN[0], (), begun)
    assert calm is not None and fit is not None
    assert fit.unknowns == calm.unknowns + 4
    assert fit.total > calm.total + 50.0
    assert fit.noise.wave_frequency == pytest.approx(SEA[0], rel=0.03)
    assert fit.noise.wave_damping == pytest.approx(SEA[1], abs=0.04)
    assert fit.noise.wave_swing == pytest.approx(0.03, rel=0.25)
    assert fit.noise.wave_force == pytest.approx(0.04, rel=0.5)
    assert fit.theta == pytest.approx([GAIN, -DAMPING], rel=0.08)
    assert abs(calm.theta[1] + DAMPING) > 2.0 * abs(fit.theta[1] + DAMPING)


def test_known_waves_reduce_the_prediction_error() -> None:
    problem = problem_of([run(k, size=0.01, swing=0.03) for k in (1, 2)])
    theta, calm = np.array([GAIN, -DAMPING]), ProcessNoise(0.01, MEMORY, 0.03)
    errors = []
    for noise in (calm, replace(calm, sensor=1e-3, wave_swing=0.03, wave_force=1e-6, wave_frequency=SEA[0])):
        fit = problem.fit(theta, (), noise, rounds=0)
        assert fit is not None
        errors.append(float(np.sqrt(np.mean(problem.ahead(fit, 0.4) ** 2))))
    assert errors[1] < 0.8 * errors[0]
