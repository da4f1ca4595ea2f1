"""Single axes by filters; with gusts, prediction error against output error."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_autotune.identify import fit
from gcs_autotune.trial import Channel, Trial

INERTIA, DRAG, GUST, NOISE = 1.5, 0.9, 0.15, 0.01


def yaw_run(seed: int, *, gust: float = GUST, duration: float = 40.0, dt: float = 0.1) -> Trial:
    """Yaw with linear drag under a random telegraph input, gusts as white noise on the rate (Euler, fine steps)."""
    rng = np.random.default_rng(seed)
    fine = 10
    h, n = dt / fine, round(duration / dt)
    psi = r = 0.0
    rows = []
    N = np.repeat(rng.choice([-0.6, 0.6], n // 20 + 1), 20)[:n]
    for k in range(n):
        rows.append((k * dt, psi, r))
        for _ in range(fine):
            psi += h * r
            r += h * (N[k] - DRAG * r) / INERTIA + gust * np.sqrt(h) * rng.standard_normal()
    t, heading, rate = np.array(rows).T
    return Trial(
        f"gusty {seed}",
        {
            "N": Channel("N", "N m", t, N),
            "r": Channel("r", "rad/s", t, rate + NOISE * rng.standard_normal(n)),
            "psi": Channel("psi", "rad", t, heading + NOISE * rng.standard_normal(n)),
        },
    )


def estimates(method: str, seeds: range) -> tuple[np.ndarray, np.ndarray]:
    """Return errors and standard errors (seeds, 2) of inertia and drag."""
    errors, stds = [], []
    for seed in seeds:
        options = {} if method != "output-error" else {"delay": 0.0}
        found = fit(yaw_run(seed), "linear", method, dof="yaw", **options)
        a, b = found.parameters["alpha_r"], found.parameters["beta_r"]
        errors.append((a.value - INERTIA, b.value - DRAG))
        stds.append((a.std, b.std))
    return np.array(errors), np.array(stds)


@pytest.mark.slow
def test_with_gusts_prediction_error_is_more_accurate_than_output_error():
    seeds = range(8)
    pem, pem_std = estimates("prediction-error", seeds)
    oe, oe_std = estimates("output-error", seeds)
    assert np.all(np.sqrt(np.mean(pem**2, axis=0)) < 0.8 * np.sqrt(np.mean(oe**2, axis=0)))
    z, z_oe = (np.sqrt(np.mean((e / s) ** 2)) for e, s in ((pem, pem_std), (oe, oe_std)))
    assert 0.6 < z < 1.5
    assert abs(np.log(z)) < abs(np.log(z_oe))


@pytest.mark.parametrize("method", ["ekf", "ukf", "smoother", "prediction-error"])
def test_an_axis_without_process_noise_is_identified_by_every_filter(method):
    found = fit(yaw_run(3, gust=0.0), "linear", method, dof="yaw")
    assert found.model.alpha == pytest.approx(INERTIA, abs=4.0 * found.parameters["alpha_r"].std)
    assert found.model.beta == pytest.approx(DRAG, abs=4.0 * found.parameters["beta_r"].std)
    assert found.parameters["alpha_r"].std < 0.02
    assert found.fit_percent > 90.0


def test_linear_drag_is_chosen_if_no_structure_is_requested():
    assert fit(yaw_run(4, gust=0.0), None, "smoother", dof="yaw").structure == "linear"
