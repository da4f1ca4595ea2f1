"""The Cramer-Rao bound: analytic, reached by estimates, and available for every method."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from experiment_plants import BOAT, Steps, Zigzag, recorded

from gcs_autotune.errors import UsageError
from gcs_autotune.identify import Fit, fit
from gcs_autotune.identify.cramer_rao import with_bounds
from gcs_autotune.identify.problems import fitted_model_of, information_on
from gcs_autotune.models import FORMS, Form
from gcs_autotune.trial import Channel, Trial

FORM = FORMS["horizontal"].without("Y_0", "Y_vv", "Y_rdot", "X_0", "N_0")
FORM = replace(FORM, start={k: 0.9 * v for k, v in BOAT.items()})
DRIFT = Form("drift", "mass alone", ("surge",), ("X_udot",), {}, {"X": (("X", 1.0),)}, coriolis=False)


def pushed(seed: int, noise: float = 0.05) -> Trial:
    """A mass of 2 kg pushed with 1 N for 5 s, then let go: velocity known in closed form."""
    t = np.arange(0.0, 10.0, 0.1)
    X = np.where(t < 5.0, 1.0, 0.0)
    u = np.minimum(t, 5.0) / 2.0 + np.random.default_rng(seed).normal(0.0, noise, len(t))
    return Trial("push", {"u": Channel("u", "m/s", t, u), "X": Channel("X", "N", t, X)})


def test_the_bound_of_a_pushed_mass_matches_the_analytic_one() -> None:
    run = pushed(1)
    subject = replace(fitted_model_of(fit(run, DRIFT, delay=0.0), run), theta=np.array([-2.0]), noise={"u": 0.05})
    # u = u_0 + min(t, 5)/m: du/dm = -min(t, 5)/m^2, the free u_0 takes its mean away.
    slope = np.minimum(np.arange(0.0, 10.0, 0.1), 5.0) / 4.0
    expected = 0.05 / math.sqrt(float(np.sum((slope - slope.mean()) ** 2)))
    assert information_on(subject).bounds["X_udot"] == pytest.approx(expected, rel=1e-9)


def test_estimates_scatter_as_the_bound_predicts() -> None:
    found = [fit(pushed(seed), DRIFT, delay=0.0).parameters["X_udot"] for seed in range(60)]
    scatter = float(np.std([p.value for p in found]))
    assert scatter == pytest.approx(float(np.mean([p.bound for p in found])), rel=0.25)


def test_the_bound_agrees_with_the_maximum_likelihood_fit() -> None:
    runs = [recorded(Steps(1), 30.0, 1), recorded(Zigzag(), 30.0, 2)]
    made = fit(runs, FORM, delay=0.0)
    bounds = information_on(fitted_model_of(made, runs)).bounds
    assert set(bounds) >= set(FORM.free) != set()
    for name in FORM.free:
        assert bounds[name] == pytest.approx(made.parameters[name].bound, rel=0.01)


def test_information_of_two_runs_is_the_sum_of_both() -> None:
    runs = [pushed(1), pushed(2)]
    made = fit(runs, DRIFT, delay=0.0)
    both = information_on(fitted_model_of(made, runs))
    one, other = (information_on(fitted_model_of(made, run)) for run in runs)
    assert one.plus(other).matrix == pytest.approx(both.matrix, rel=1e-9)


def test_bounds_are_added_to_a_fit_without_them() -> None:
    run = pushed(3)
    made = fit(run, DRIFT, delay=0.0)
    bare = replace(made, parameters={n: replace(p, bound=math.nan, std=0.5) for n, p in made.parameters.items()})
    given = with_bounds(bare, run).parameters["X_udot"]
    assert given.bound == pytest.approx(made.parameters["X_udot"].bound, rel=0.05)
    assert given.std == 0.5


def test_bounds_are_added_to_a_relay_fit_by_first_harmonic() -> None:
    t = np.arange(0.0, 40.0, 0.1)
    psi, r, sign, taus, psis = 0.0, 0.0, 1.0, [], []
    for _ in t:
        sign = -1.0 if psi > 0.2 else 1.0 if psi < -0.2 else sign
        taus.append(sign)
        psis.append(psi)
        for _ in range(10):
            r += 0.01 * (sign - 1.5 * r) / 2.0
            psi += 0.01 * r
    noisy = np.array(psis) + np.random.default_rng(4).normal(0.0, 0.01, len(t))
    run = Trial("relay", {"psi": Channel("psi", "rad", t, noisy), "N": Channel("N", "N m", t, np.array(taus))})
    bare = fit(run, dof="yaw", structure="linear", method="iso")
    full = fit(run, dof="yaw", structure="linear", delay=0.0)
    result = with_bounds(bare, run).parameters
    for name in ("alpha_r", "beta_r"):
        assert 0.3 * full.parameters[name].std < result[name].bound < 3.0 * full.parameters[name].std


def test_a_model_that_cannot_be_simulated_is_rejected() -> None:
    class Table:
        def to_dict(self) -> dict[str, object]:
            return {}

    made = Fit(
        dof="x", structure="s", method="m", model=Table(), parameters={}, covariance=np.zeros((0, 0)),
        fit_percent=0.0, used=(),
    )  # fmt: skip
    with pytest.raises(UsageError, match="Table"):
        fitted_model_of(made, pushed(1))
