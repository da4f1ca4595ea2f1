"""Global search: finds what a local fit from a bad start does not, and reports how."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from coupled_plants import sail

from gcs_autotune.errors import UsageError
from gcs_autotune.identify import fit
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.coupled.limits import limits_of
from gcs_autotune.identify.problems.initial_guess import initial_guess_of
from gcs_autotune.identify.problems.solution import solve_form
from gcs_autotune.identify.signals.preparation import prepare_form
from gcs_autotune.models.coupled import form_from
from gcs_autotune.trial import Channel, Trial

ROLL = {"K_pdot": -2.0, "K_p": -0.5, "K_phi": -60.0}
"""A lightly damped roll: period 1.15 s, so that a start with another period sees one wiggle after the other."""

FORM = form_from({"name": "roll", "dofs": ["roll"], "free": list(ROLL), "inputs": {"K": {"K": 1.0}}}, "test")


@pytest.fixture(scope="module")
def run() -> Trial:
    rng = np.random.default_rng(0)
    t = np.arange(0.0, 12.0, 0.1)
    K = np.where(t < 1.0, 20.0, 0.0)

    def rates(s: np.ndarray, tau: np.ndarray) -> np.ndarray:
        return np.array([s[1], (tau[0] + ROLL["K_p"] * s[1] + ROLL["K_phi"] * s[0]) / -ROLL["K_pdot"]])

    phi = sail(rates, np.zeros(2), t, t, K[:, None])[:, 0] + rng.normal(0.0, 0.01, len(t))
    return Trial("roll decay", {"phi": Channel("phi", "rad", t, phi), "K": Channel("K", "N m", t, K)})


def test_the_global_search_finds_the_truth_where_a_local_fit_from_a_bad_start_does_not(run: Trial) -> None:
    bad = {"K_pdot": -8.0, "K_p": -0.5, "K_phi": -8.0}
    records = prepare_form(run, FORM)
    ground = initial_guess_of(FORM, records)
    limits = limits_of(FORM, Case(form=FORM, records=tuple(records), delay=0.0, names=(run.name,)))
    start = np.array([bad[n] for n in FORM.parameters])
    local = solve_form(FORM, records, start, ground.initial, limits, levels=ground.levels)
    assert local is None or local.noise["phi"] > 0.03

    found = fit(run, replace(FORM, start=bad), "global", delay=0.0, budget=600)
    for name, value in ROLL.items():
        assert abs(found.parameters[name].value - value) < 4.0 * found.parameters[name].std
    assert found.noise["phi"] == pytest.approx(0.01, rel=0.2)


def test_the_global_search_reports_which_optimiser_won_and_by_how_much(run: Trial) -> None:
    search = fit(run, FORM, "global", delay=0.0, budget=200).extra["search"]
    assert set(search["costs"]) == {"differential evolution", "multi-start"}
    assert search["costs"][search["winner"]] == min(search["costs"].values())
    assert search["margin"] >= 0.0
    assert sum(search["evaluations"].values()) <= 1.5 * 200


def test_the_same_seed_gives_the_same_result(run: Trial) -> None:
    one, two = (fit(run, FORM, "global", delay=0.0, budget=120, seed=7).extra["search"] for _ in range(2))
    assert one == two


def test_a_budget_too_small_is_rejected(run: Trial) -> None:
    with pytest.raises(UsageError, match="budget"):
        fit(run, FORM, "global", budget=3)


def test_a_single_axis_can_be_searched(run: Trial) -> None:
    t = np.arange(0.0, 20.0, 0.1)
    N = np.where((t / 3.0).astype(int) % 2 == 0, 0.5, -0.5)
    psi = sail(lambda s, tau: np.array([s[1], (tau[0] - 0.12 * s[1]) / 0.36]), np.zeros(2), t, t, N[:, None])[:, 0]
    psi = psi + np.random.default_rng(1).normal(0.0, 0.005, len(t))
    yaw = Trial("yaw", {"psi": Channel("psi", "rad", t, psi), "N": Channel("N", "N m", t, N)})
    found = fit(yaw, "linear", "global", budget=200)
    assert found.parameters["alpha_r"].value == pytest.approx(0.36, rel=0.05)
    assert found.parameters["beta_r"].value == pytest.approx(0.12, rel=0.1)
