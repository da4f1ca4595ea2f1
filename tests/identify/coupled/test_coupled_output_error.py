"""Coupled output error on simulated runs: correct parameters, standard errors and doubts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from coupled_plants import BOAT, horizontal, levels, sail

from gcs_autotune.errors import UsageError
from gcs_autotune.identify import Fit, fit
from gcs_autotune.models.coupled import FORMS, Form
from gcs_autotune.trial import Channel, Trial

NOISE = {"x": 0.05, "y": 0.05, "psi": 0.005, "u": 0.02, "v": 0.02, "r": 0.005}
UNITS = {"x": "m", "y": "m", "psi": "rad", "u": "m/s", "v": "m/s", "r": "rad/s"}
FORM = FORMS["horizontal"].without("Y_0")


def sailed(
    seed: int, *, seconds: float = 40.0, delay: float = 0.0, boat: dict[str, float] = BOAT, quiet: bool = False
) -> Trial:
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 0.1)
    tau = np.column_stack([levels(rng, t, 6.0, 5.0, 40.0), levels(rng, t, 4.0, -8.0, 8.0)])
    X = sail(horizontal(boat), np.zeros(6), t, t, tau, delay=delay)
    channels = {n: Channel(n, UNITS[n], t, X[:, i]) for i, n in enumerate(UNITS)}
    channels["X"], channels["N"] = Channel("X", "N", t, tau[:, 0]), Channel("N", "N m", t, tau[:, 1])
    run = Trial(f"run {seed}", channels)
    return run if quiet else noisy(run, seed)


def noisy(run: Trial, seed: int) -> Trial:
    rng = np.random.default_rng([seed, 5])
    spoilt = {n: replace(run[n], values=run[n].values + rng.normal(0.0, std, len(run[n]))) for n, std in NOISE.items()}
    return replace(run, channels={**run.channels, **spoilt})


@pytest.fixture(scope="module")
def runs() -> list[Trial]:
    return [sailed(seed) for seed in (1, 2)]


@pytest.fixture(scope="module")
def fitted(runs: list[Trial]) -> Fit:
    return fit(runs, FORM, delay=0.0)


def test_fourteen_parameters_are_identified_within_their_standard_errors(fitted: Fit) -> None:
    misses = [(fitted.parameters[n].value - BOAT[n]) / fitted.parameters[n].std for n in FORM.free]
    assert np.max(np.abs(misses)) < 4.0
    assert np.sqrt(np.mean(np.square(misses))) < 1.7


def test_the_added_noise_levels_are_identified(fitted: Fit) -> None:
    for name in ("u", "v", "r", "psi"):
        assert fitted.noise[name] == pytest.approx(NOISE[name], rel=0.1)


@pytest.mark.slow
def test_a_run_of_another_vehicle_is_reported(runs: list[Trial]) -> None:
    stranger = sailed(3, seconds=20.0, boat={**BOAT, "X_udot": -60.0, "N_r": -6.0})
    short = [run.between(0.0, 20.0) for run in runs]
    doubts = {d.slug: d for d in fit([*short, stranger], FORM, delay=0.0).doubts}
    assert "run-apart" in doubts
    assert "'run 3'" in doubts["run-apart"].cause


def test_runs_of_one_craft_raise_no_doubt(fitted: Fit) -> None:
    assert fitted.doubts == ()


def test_a_delay_is_identified_only_where_there_is_one(runs: list[Trial]) -> None:
    late = fit([sailed(seed, delay=0.35) for seed in (1, 2)], FORM)
    assert late.parameters["delay"].value == pytest.approx(0.35, abs=0.03)
    assert "delay" not in fit(runs, FORM).parameters


def test_bounds_are_kept_and_reported(runs: list[Trial]) -> None:
    held = fit(runs[:1], FORM, delay=0.0, bounds={"N_v": (-5.0, 0.0)})
    assert held.parameters["N_v"].value == 0.0
    assert held.parameters["N_v"].status == "at_bound"
    assert "at-bound" in {d.slug for d in held.doubts}


def test_damping_at_its_bound_of_zero_is_reported_as_no_damping(runs: list[Trial]) -> None:
    """The boat has damping; with bounds that only allow the opposite sign, the nearest value is none."""
    held = fit(runs[:1], FORM, delay=0.0, bounds={"N_r": (0.0, 9.0)})
    doubt = next(d for d in held.doubts if d.slug == "at-bound")
    assert doubt.cause == "N_r stopped at zero, the limit of damping. The runs fit best without it"
    assert "widen" not in doubt.cure


def test_bounds_for_parameters_that_are_not_free_are_rejected(runs: list[Trial]) -> None:
    with pytest.raises(UsageError, match="not free"):
        fit(runs, FORM, bounds={"N_vv": (0.0, 1.0)})


def test_parameters_that_the_runs_do_not_excite_are_reported(runs: list[Trial]) -> None:
    free = FORM.freeing("Y_vr")
    straight = [replace(r, channels={**r.channels, "N": replace(r["N"], values=0.0 * r["N"].values)}) for r in runs]
    result = fit(straight, free.without("N_0", "X_0"), delay=0.0, use=["u"])
    named = next(d for d in result.doubts if d.slug == "not-excited")
    assert "N_rdot" in named.cause


def test_soft_l1_tolerates_outliers(runs: list[Trial], fitted: Fit) -> None:
    rng = np.random.default_rng(5)
    spoilt = []
    for run in runs:
        u = run["u"]
        values = np.where(rng.random(len(u)) < 0.03, u.values + 2.0, u.values)
        spoilt.append(replace(run, channels={**run.channels, "u": replace(u, values=values)}))
    plain, robust = (fit(spoilt, FORM, delay=0.0, loss=loss) for loss in ("linear", "soft_l1"))
    assert "--robust" in {d.slug: d.cure for d in plain.doubts}["outliers"]
    assert robust.noise["u"] == pytest.approx(NOISE["u"], rel=0.15)

    def miss(found: Fit) -> float:
        z = [(found.parameters[n].value - BOAT[n]) / fitted.parameters[n].bound for n in FORM.free]
        return float(np.sqrt(np.mean(np.square(z))))

    assert miss(robust) < 1.5 < 5.0 < miss(plain)


def test_gps_and_compass_alone_are_enough() -> None:
    run = sailed(4, seconds=60.0)
    slow = {n: Channel(n, "m", run[n].t[::10], run[n].values[::10]) for n in ("x", "y")}
    result = fit(replace(run, channels={**slow, **{n: run[n] for n in ("psi", "X", "N")}}), FORM, delay=0.0)
    for name in ("X_udot", "Y_vdot", "N_rdot", "N_r"):
        parameter = result.parameters[name]
        assert abs(parameter.value - BOAT[name]) < 4.0 * parameter.std
        assert parameter.std < 0.2 * abs(BOAT[name])


@pytest.mark.slow
def test_errors_over_noise_seeds_match_the_standard_errors() -> None:
    """A small version of benchmarks/coupled_accuracy.py: ten seeds, fourteen parameters."""
    clean = [sailed(seed, seconds=30.0, quiet=True) for seed in (1, 2)]
    misses = []
    for seed in range(10):
        found = fit([noisy(run, 100 * seed + i) for i, run in enumerate(clean)], FORM, delay=0.0)
        misses.append([(found.parameters[n].value - BOAT[n]) / found.parameters[n].bound for n in FORM.free])
    z = np.array(misses)
    assert 0.8 < np.sqrt(np.mean(z**2)) < 1.2
    assert np.mean(np.abs(z) < 1.96) > 0.9
    assert np.max(np.abs(z.mean(axis=0))) * np.sqrt(len(z)) < 4.0


def test_thrusters_with_exchanged_labels_are_reported() -> None:
    form = Form(
        name="twin",
        title="two thrusters",
        dofs=("surge", "yaw"),
        free=("X_udot", "X_u", "N_r", "k_N"),
        known={"I_z": 1.0},
        inputs={"left": (("X", 1.0), ("N", "k_N")), "right": (("X", 1.0), ("N", "-k_N"))},
        coriolis=False,
    )
    rng = np.random.default_rng(3)
    t, dt = np.arange(0.0, 60.0, 0.1), 0.1
    left, right = (np.repeat(rng.uniform(0.0, 10.0, 30), 20) for _ in range(2))
    u, r = np.zeros(len(t)), np.zeros(len(t))
    for k in range(len(t) - 1):  # exact: two first-order lags under held inputs
        u[k + 1] = (left[k] + right[k]) / 4.0 + (u[k] - (left[k] + right[k]) / 4.0) * np.exp(-4.0 / 12.0 * dt)
        steady = 0.05 * (right[k] - left[k]) / 0.8
        r[k + 1] = steady + (r[k] - steady) * np.exp(-0.8 * dt)
    measured = {"u": u + rng.normal(0.0, 0.02, len(t)), "r": r + rng.normal(0.0, 0.005, len(t))}
    channels = {n: Channel(n, unit, t, measured[n]) for n, unit in (("u", "m/s"), ("r", "rad/s"))}
    channels |= {"left": Channel("left", "N", t, left), "right": Channel("right", "N", t, right)}
    found = fit(Trial("swapped", channels), form, delay=0.0)
    assert found.parameters["k_N"].value == pytest.approx(-0.05, rel=0.05)
    (doubt,) = [d for d in found.doubts if d.slug == "reversed-input"]
    assert "left, right" in doubt.cause
