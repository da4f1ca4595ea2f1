"""Run-to-run differences are integrated out exactly, equally by either pass, and estimated for each run."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm
from test_noisy_problem import DRAG, GAIN, LINEAR, problem_of, run

from gcs_autotune.identify.kalman import NoisyProblem, ProcessNoise
from gcs_autotune.identify.kalman.run_to_run import RunLikelihood
from gcs_autotune.identify.signals import Segment, Signal

Array = NDArray[np.float64]

THETA = np.array([0.45, -0.7])
OFFSETS = ProcessNoise(0.05, 2.5, 2e-3, day_force=0.06, day_thrust=0.08)
CHOPPY = replace(OFFSETS, wave_swing=0.05, wave_force=0.1, wave_frequency=2.4, wave_damping=0.15)


def short(name: str, seed: int) -> Segment:
    """Return a record of a run *name*: twelve samples half a second apart, the command changed between them."""
    rng = np.random.default_rng(seed)
    t = 0.5 * np.arange(12)
    t_in = np.array([0.0, 0.7, 2.1, 4.4])
    signal = Signal("psi", t, np.cumsum(rng.normal(0.0, 0.1, 12)), 0.0)
    return Segment(name, name, t_in, rng.normal(0.0, 1.0, (4, 1)), ("N",), ("1",), {"psi": signal})


def responses(segment: Segment, states: Array, spread: Array, noise: ProcessNoise) -> tuple[Array, Array, Array, Array]:
    """Return the mean (s,) of the samples, what every independent unit of chance adds to them (s, units), what the
    run's own constant force and thrust do (s, 2), and the drifting force by units (s, units): by steps of a
    millisecond.
    """
    k, d = THETA
    t, keep = segment.signals["psi"].t, math.exp(-0.5 / noise.memory)
    n, units = len(t), 2 + 3 * len(segment.signals["psi"].t)
    gusts = np.zeros((n, units))  # the drifting force, by unit: the first, then one more in each interval
    gusts[0, 2] = noise.size
    sea = np.zeros((n, 2, units))  # both states of the waves, by two units in each interval
    sea[0, 0, 2 + n], sea[0, 1, 3 + n] = 1.0, 1.0
    omega, zeta = noise.wave_frequency, noise.wave_damping
    F = expm(0.5 * np.array([[0.0, omega], [-omega, -2.0 * zeta * omega]]))
    L = np.linalg.cholesky(np.eye(2) - F @ F.T)
    for s in range(1, n):
        gusts[s] = keep * gusts[s - 1]
        gusts[s, 2 + s] = noise.size * math.sqrt(1.0 - keep * keep)
        sea[s] = F @ sea[s - 1]
        sea[s, :, 2 + n + 2 * s : 4 + n + 2 * s] = L
    pushes = gusts + noise.wave_force * sea[:, 1]
    order = [1, 0] if states[0] != segment.signals["psi"].values[0] else [0, 1]
    x0, v0 = states[order]
    # Columns: mean, units of chance, own force, own thrust.
    x = np.concatenate([[x0], [spread[order][0], 0.0], np.zeros(3 * n), [0.0, 0.0]])
    v = np.concatenate([[v0], [0.0, spread[order][1]], np.zeros(3 * n), [0.0, 0.0]])
    seen = [x.copy()]
    h = 1e-3
    for s in range(len(t) - 1):
        for step in range(500):
            now = t[s] + h * (step + 0.5)
            u = segment.inputs[np.searchsorted(segment.t_in, now, side="right") - 1, 0]
            f = np.concatenate([[k * u], pushes[s], [1.0, k * u]])
            kept = math.exp(d * h)
            one = (1.0 - kept) / -d
            x, v = x + one * v + (h - one) / -d * f, kept * v + one * f
        seen.append(x.copy())
    rows = np.array(seen)
    return rows[:, 0], rows[:, 1:-2] + noise.wave_swing * sea[:, 1], rows[:, -2:], gusts


@pytest.mark.parametrize("noise", [OFFSETS, CHOPPY], ids=["no waves", "waves"])
def test_integrating_out_run_offsets_matches_a_dense_gaussian(noise: ProcessNoise) -> None:
    """Two records of one run, which share its own force and thrust, and one of another."""
    segments = [short("a", 1), short("a", 2), short("b", 3)]
    problem = problem_of(segments)
    found = problem.innovations_at(THETA, (), noise)
    assert found is not None
    total = sum(-0.5 * float(np.sum(e * e / S + np.log(2.0 * np.pi * S))) for _, e, S in found)
    states, spread = problem._priors
    parts = [responses(s, states[i], spread[i], noise) for i, s in enumerate(segments)]
    dense = 0.0
    for own in ([0, 1], [2]):
        error = np.concatenate([segments[i].signals["psi"].values - parts[i][0] for i in own])
        shared = np.concatenate([parts[i][2] for i in own]) * [noise.day_force, noise.day_thrust]
        C = shared @ shared.T + noise.sensor**2 * np.eye(len(error))
        for j, i in enumerate(own):
            block = slice(12 * j, 12 * j + 12)
            C[block, block] += parts[i][1] @ parts[i][1].T
        _, size = np.linalg.slogdet(2.0 * np.pi * C)
        dense -= 0.5 * (float(size) + float(error @ np.linalg.solve(C, error)))
    assert total == pytest.approx(dense, abs=1e-5)


def test_the_drifting_force_is_separated_from_waves_as_by_a_dense_gaussian() -> None:
    """By the smoother, for each run; without run-to-run offsets."""
    noise = replace(CHOPPY, day_force=0.0, day_thrust=0.0)
    segments = [short("a", 1), short("b", 3)]
    problem = problem_of(segments)
    done = problem.run(THETA, (), noise, full=True)
    assert done is not None
    bank, result, levels = done
    smoothed = bank.smooth(result, levels)
    states, spread = problem._priors
    for i, segment in enumerate(segments):
        mean, chance, _, gusts = responses(segment, states[i], spread[i], noise)
        C = chance @ chance.T + noise.sensor**2 * np.eye(len(mean))
        expected = gusts @ chance.T @ np.linalg.solve(C, segment.signals["psi"].values - mean)
        left = gusts @ gusts.T - gusts @ chance.T @ np.linalg.solve(C, chance @ gusts.T)
        assert smoothed.trajectories[i][:, 2] == pytest.approx(expected, abs=2e-4)
        assert smoothed.variances[i][:, 2] == pytest.approx(np.diag(left), rel=2e-2)


@pytest.mark.parametrize("name", LINEAR)
def test_both_passes_integrate_out_run_offsets_equally(name: str) -> None:
    runs = [run(1), run(2)]
    speed = replace(runs[0].measured["v"], name="u")
    half = replace(runs[1], run=runs[0].run)  # a run in two records, then another
    problem = problem_of([replace(r, measured={**r.measured, "u": speed}) for r in (runs[0], half, runs[1])])
    assert problem._linear(LINEAR[name]) is not None
    exact = problem.innovations_at(THETA, LINEAR[name], OFFSETS)
    done = problem.run(THETA, LINEAR[name], OFFSETS)
    assert exact is not None and done is not None
    for (_, e, S), history in zip(exact, done[1].histories, strict=True):
        seen = ~np.isnan(history.S[:, 0])
        assert e == pytest.approx(history.e[seen, 0], abs=1e-3 * float(np.sqrt(S.min())))
        assert S == pytest.approx(history.S[seen, 0], rel=1e-3)


def offset_runs(forces: tuple[float, ...], thrusts: tuple[float, ...]) -> NoisyProblem:
    """Return runs whose constant forces and thrusts are these."""
    return problem_of([
        run(k + 1, size=0.02, force=b, thrust=1.0 + s) for k, (b, s) in enumerate(zip(forces, thrusts, strict=True))
    ])  # fmt: skip


def test_the_force_and_thrust_offsets_of_each_run_are_estimated() -> None:
    forces, thrusts = (0.06, -0.05, 0.02, -0.03), (0.08, -0.06, 0.03, -0.05)
    problem = offset_runs(forces, thrusts)
    fit = problem.fit(np.array([GAIN, -0.6]), (), ProcessNoise(0.02, 3.0, 1e-3, day_force=0.05, day_thrust=0.06))
    assert fit is not None
    run_likelihoods = problem.run_likelihoods(fit)
    assert run_likelihoods is not None
    for day, b, s in zip(run_likelihoods.offsets(0.05, 0.06), forces, thrusts, strict=True):
        assert abs(day.force - b) < 3.0 * day.force_std
        assert abs(day.thrust - s) < 3.0 * math.hypot(day.thrust_std, 0.03)  # the gain itself is the runs' mean
    force, thrust = run_likelihoods.spread(0.0, 0.5, force=True, thrust=True)
    assert 0.02 < force < 0.12
    assert 0.03 < thrust <= 0.1
    assert run_likelihoods.gain(force, thrust) > run_likelihoods.gain(0.0, 0.0) + 3.0


def test_a_force_common_to_all_runs_is_not_a_run_to_run_difference() -> None:
    problem = offset_runs((0.06, 0.06, 0.06), (0.0, 0.0, 0.0))
    fit = problem.fit(np.array([GAIN, -0.6]), (), ProcessNoise(0.02, 3.0, 1e-3))
    assert fit is not None
    run_likelihoods = problem.run_likelihoods(fit)
    assert run_likelihoods is not None
    force, thrust = run_likelihoods.spread(0.0, 0.5, force=True, thrust=True)
    assert run_likelihoods.gain(force, thrust) < run_likelihoods.gain(0.0, 0.0) + 3.0


def test_the_smoother_estimates_a_constant_force_for_each_run() -> None:
    first, second = run(1, force=0.1), run(2, force=-0.1)
    problem = problem_of([first, second])
    done = problem.run(THETA, DRAG, OFFSETS, full=True)
    fit = problem.fit(THETA, DRAG, OFFSETS, rounds=0)
    assert done is not None and fit is not None
    bank, result, levels = done
    smoothed = bank.smooth(result, levels)
    run_likelihoods = problem.run_likelihoods(fit)
    assert run_likelihoods is not None
    own = len(bank.states) + 1
    offsets = run_likelihoods.offsets(OFFSETS.day_force, OFFSETS.day_thrust)
    for path, var, day in zip(smoothed.trajectories, smoothed.variances, offsets, strict=True):
        assert path[:, own] == pytest.approx(np.full(len(path), path[-1, own]), abs=1e-6)
        assert path[0, own] == pytest.approx(day.force, abs=0.1 * day.force_std)
        assert math.sqrt(var[0, own]) == pytest.approx(day.force_std, rel=0.05)


def test_nearly_zero_run_to_run_spreads_count_as_zero() -> None:
    problem = problem_of([run(1), run(2)])
    none, hardly = (
        problem.fit(THETA, DRAG, replace(OFFSETS, day_force=s, day_thrust=s), rounds=0) for s in (0.0, 1e-7)
    )
    assert none is not None and hardly is not None
    assert hardly.total == pytest.approx(none.total, abs=1e-3)
    assert problem.ahead(hardly, 5.0) == pytest.approx(problem.ahead(none, 5.0), abs=1e-4)


def test_an_uninformative_run_keeps_its_prior() -> None:
    day = RunLikelihood("mute", np.zeros((2, 2)), np.zeros(2)).day(0.3, 0.05)
    assert (day.force, day.thrust) == (0.0, 0.0)
    assert (day.force_std, day.thrust_std) == pytest.approx((0.3, 0.05))
