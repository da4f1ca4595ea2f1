"""Miskovic2007: S-manoeuvres of the VideoRay seen by a camera; structure found, Tables I and II, validation."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from regression_plants import DOFS, HORIZONTAL_INPUTS, TRUTH, M, camera_run, coupled

from benchmarks.published.correlation import correlations, structure_by_correlation
from gcs_autotune.identify import fit, validate
from gcs_autotune.identify.regression.physical import check_physics
from gcs_autotune.models import Form

pytestmark = pytest.mark.slow


@cache
def camera_runs() -> tuple:
    return tuple(camera_run(i, 1.5 + 0.2 * i, 0.05 + 0.01 * i) for i in range(4))


CANDIDATES = Form(
    "candidates", "", DOFS, ("X_udot", "Y_vdot", "N_rdot", "X_vdot", "x_G", "y_G", "X_u", "Y_v", "N_r"), {"m": 4.0},
    HORIZONTAL_INPUTS,
)  # fmt: skip
"""The general model (4) of the paper, with its drag linear."""

UNTIED = Form(
    "Miskovic2007", "", DOFS, ("X_udot", "N_rdot", "X_u", "Y_v", "N_r", "X_vr", "Y_ur", "N_uv"), {"Y_vdot": -1.0},
    HORIZONTAL_INPUTS, coriolis=False,
)  # fmt: skip
"""(5)-(7), couplings free of one another. Sway has no input, so its inertia is set to 1: gamma_1 and gamma_3 remain."""


def test_correlation_selects_the_terms_of_the_paper():
    table = {(c.dof, c.term): abs(c.velocity) for c in correlations(camera_runs(), CANDIDATES)}
    strong = {key for key, value in table.items() if value > 0.5 and key[1] != "m"}
    uv, rv, ur = {("yaw", "X_udot"), ("yaw", "Y_vdot")}, {("surge", "Y_vdot")}, {("sway", "X_udot")}
    assert strong == uv | rv | ur | {("yaw", "input"), ("surge", "input")}
    chosen = structure_by_correlation(CANDIDATES, correlations(camera_runs(), CANDIDATES))
    assert set(CANDIDATES.free) - set(chosen.free) == {"X_vdot", "x_G", "y_G"}


@pytest.mark.parametrize("method", ["least-squares", "instrumental-variables"])
def test_table_one_is_reproduced_with_free_couplings(method, published):
    table = published["videoray_coupled_seed_000"]
    found = fit(camera_runs(), UNTIED, method)
    p = {n: q.value for n, q in found.parameters.items()}
    alpha = (p["N_r"] / -p["N_rdot"], 1.0 / -p["N_rdot"])
    beta = (p["X_u"] / -p["X_udot"], 1.0 / -p["X_udot"], p["X_vr"] / -p["X_udot"])
    assert alpha == pytest.approx((table["yaw_table_II"]["alpha1"], table["yaw_table_II"]["alpha2"]), rel=0.02)
    assert beta == pytest.approx((table["surge_table_II"]["beta1"], table["surge_table_II"]["beta2"], 1.0), rel=0.03)
    gamma = (table["sway_table_II"]["gamma1"], table["sway_table_II"]["gamma3"])
    assert (p["Y_v"], p["Y_ur"]) == pytest.approx(gamma, rel=0.03)
    if method == "instrumental-variables":
        assert abs(p["N_uv"]) < 3.0 * found.parameters["N_uv"].std


def test_table_two_is_reproduced_by_the_constrained_variant(published):
    """alpha_3 = 0 and beta_3 = -gamma_3 = 1: equal inertia in surge and sway, as one parameter m."""
    table = published["videoray_coupled_seed_000"]
    form = Form("tied", "", DOFS, ("m", "N_rdot", "X_u", "Y_v", "N_r"), {}, HORIZONTAL_INPUTS)
    loose, tied = fit(camera_runs(), coupled(), "least-squares"), fit(camera_runs(), form, "least-squares")
    assert np.diag(tied.model.inertia) == pytest.approx(table["mass_matrix_diag"], rel=0.02)
    assert np.diag(tied.model.linear_damping) == pytest.approx(table["damping_diag"], rel=0.02)
    assert all(c.holds for c in check_physics(tied.model, np.ones((1, 6))))
    for name in ("Y_v", "N_r"):
        assert tied.parameters[name].std <= 1.05 * loose.parameters[name].std
    assert tied.fit_percent > loose.fit_percent - 0.1


def test_the_coupled_model_predicts_a_new_run_and_the_uncoupled_does_not():
    unseen = camera_run(99, 2.2, 0.07)
    whole = validate(fit(camera_runs(), coupled(), "instrumental-variables").model, unseen).fit_percent
    alone = Form("uncoupled", "", DOFS, tuple(TRUTH), {}, HORIZONTAL_INPUTS, coriolis=False).fixing({"Y_vdot": -M[1]})
    simple = validate(fit(camera_runs(), alone, "least-squares").model, unseen).fit_percent
    assert whole > 97.0
    assert simple < whole - 10.0
