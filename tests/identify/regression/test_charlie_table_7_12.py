"""Miskovic2010, table 7.12: Charlie's yaw by least squares, linear and nonlinear, on simulated self-oscillations.

Every row of the table is made the truth of a run at the boat's own sampling of 0.5 s with the compass noise assumed
here (0.5 deg); its rudder is N as Miskovic2010 has it, angle times n^2 over n^2, so amplitudes are rudder angles.
"""

from __future__ import annotations

import numpy as np
import pytest
from regression_plants import yaw_run

from gcs_autotune.identify import fit

pytestmark = pytest.mark.slow

DEG = np.pi / 180.0


def charlie(alpha: float, beta: float, quadratic: float, n2: float, seed: int) -> list:
    """Runs at C = 15 and 25 deg with x_a = 10 deg (Miskovic2010, 7.5)."""
    return [
        yaw_run((alpha, beta, quadratic), (C * DEG * n2 / 20.0, 10.0 * DEG), step=0.5, noise=0.5 * DEG, seed=seed + i)
        for i, C in enumerate((15.0, 25.0))
    ]


@pytest.mark.parametrize("method", ["least-squares", "instrumental-variables"])
@pytest.mark.parametrize("structure", ["linear", "nonlinear"])
def test_alpha_and_beta_of_every_row_are_identified(structure, method, published):
    rows = np.array(published["charlie_ls_table_7_12"]["rows"])[1::4]
    errors = []
    for k, row in enumerate(rows):
        n2, (alpha, beta) = row[1], (row[2:4] if structure == "linear" else row[5:7])
        drags = (abs(beta), 0.0) if structure == "linear" else (0.0, abs(beta))
        found = fit(charlie(alpha, *drags, n2, 10 * k), structure, method, dof="yaw", delay=0.0)
        drag = found.model.beta if structure == "linear" else found.model.beta_quadratic
        errors.append((found.model.alpha / alpha - 1.0, drag / abs(beta) - 1.0))
    worst = np.abs(errors).max(axis=0)
    limit = 0.06 if method == "instrumental-variables" else 0.12
    assert worst.max() < limit, errors


def test_the_drag_law_is_decided_from_the_runs():
    linear = charlie(7.89, 2.67, 0.0, 49.0, 0)
    nonlinear = charlie(8.35, 0.0, 24.41, 49.0, 0)
    assert fit(linear, None, "instrumental-variables", dof="yaw", delay=0.0).structure == "linear"
    assert fit(nonlinear, None, "instrumental-variables", dof="yaw", delay=0.0).structure == "nonlinear"
