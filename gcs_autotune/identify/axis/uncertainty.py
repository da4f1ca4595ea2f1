"""How sure a fit is: physical covariance, correlated residuals, and the bound no method can beat.

Standard errors come from the Fisher information with the estimated noise. When the residuals are not white
the information is overstated: each standard error is then raised to that of the sandwich estimator
``C (sum_k w_k Gamma_k) C`` (Newey1987), whose ``Gamma_k`` are the autocovariances of the scores up to
``2*sqrt(n)`` samples with Bartlett weights. Correlations between parameters stay those of the Fisher information.
"Residual" here is the standardised score: for Gaussian noise error over noise; for a rounding sensor the errors
themselves repeat with the limit cycle, their scores are white when the model is right.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify import colour
from gcs_autotune.identify.axis.likelihood import Gaussian, Law, Rounded
from gcs_autotune.identify.axis.objective import Timing, information_of, timing_of
from gcs_autotune.identify.axis.output_error import Solution, solve
from gcs_autotune.identify.axis.residuals import Residual
from gcs_autotune.identify.axis.start import bounds_of
from gcs_autotune.identify.colour import all_white, autocorrelation, scores_covariance, whiteness
from gcs_autotune.identify.least_squares import inverse_of
from gcs_autotune.identify.preparation import prepare
from gcs_autotune.identify.segment import Segment
from gcs_autotune.models import SingleDof
from gcs_autotune.models.simulation import explicit_parameters
from gcs_autotune.trial import Trial

__all__ = [
    "autocorrelation",
    "correlation_time",
    "cramer_rao",
    "inflated",
    "inflation",
    "is_white",
    "physical_covariance",
    "physical_values",
    "whiteness",
]

Array = NDArray[np.float64]

PHYSICAL = ("alpha", "beta", "beta_quadratic", "delta", "delay")
"""The physical parameters, in the order of every covariance."""


def physical_covariance(theta: Array, covariance: Array) -> Array:
    """Return the covariance of (alpha, beta, beta_quadratic, delta, delay) from that of (b, a, c, d, T)."""
    G = _physical_jacobian(theta)
    transformed: Array = G @ covariance @ G.T
    return transformed


def physical_values(theta: Array) -> Array:
    """Return (alpha, beta, beta_quadratic, delta, delay) of (b, a, c, d, T)."""
    b, a, c, d, delay = theta
    return np.array([1.0 / b, a / b, c / b, d / b, delay])


def is_white(solution: Solution) -> bool:
    """Return whether no signal of any stretch is coloured (Bonferroni over the stretches)."""
    return all_white(solution.scores)


def correlation_time(solution: Solution) -> float:
    """Return how many samples make one independent one; see :func:`gcs_autotune.identify.colour.correlation_time`."""
    return colour.correlation_time(solution.scores)


def inflation(solution: Solution) -> Array:
    """Return the factors (5,), 1 or more, by which coloured residuals raise the standard errors of theta."""
    factors = np.ones(5)
    factors[solution.free] = _raised(solution)[: int(solution.free.sum())]
    return factors


def inflated(solution: Solution) -> Array:
    """Return the covariance of all that was fitted, in the columns of ``solution.whole``, raised likewise."""
    factors = _raised(solution)
    covariance: Array = factors[:, None] * solution.whole * factors
    return covariance


def _raised(solution: Solution) -> Array:
    """Return the factor of every fitted number, initial states included."""
    fisher = np.diag(solution.whole)
    if is_white(solution):
        return np.ones(len(fisher))
    S = scores_covariance([rows * own[:, None] for own, rows in zip(solution.scores, solution.rows, strict=True)])
    sandwich = np.diag(solution.whole @ S @ solution.whole)
    ratio = np.sqrt(np.maximum(sandwich, 0.0) / np.where(fisher > 0.0, fisher, np.inf))
    return np.maximum(1.0, ratio)


def cramer_rao(
    model: SingleDof,
    trials: Trial | Sequence[Trial],
    noise_std: float | Mapping[str, float],
    free: Sequence[str] = ("alpha", "beta", "beta_quadratic", "delta"),
    quantum: float | Mapping[str, float] = 0.0,
) -> dict[str, float]:
    """Return the smallest standard deviation any unbiased estimate of *model* can have from these *trials*.

    White Gaussian noise of unknown level; the initial states of every run are unknown too, and so is a common shift
    of the input stamps where the records tell that these are not exact (then a van Trees bound).

    Parameters
    ----------
    noise_std : of the position [rad or m], before rounding; or per signal name, e.g. ``{"psi": 0.01, "r": 0.02}``.
    free : which of ``alpha beta beta_quadratic delta delay`` are unknown.
    quantum : step [rad or m] to which a coarse sensor rounds, 0 for none; or per signal name. The measured
        values tell where the cells lie, so they must be those of the coarse sensor.

    Raises
    ------
    NotInformative
        When the model runs away on these inputs.
    """
    runs = (trials,) if isinstance(trials, Trial) else tuple(trials)
    records = [record for trial in runs for record in prepare(trial, model.dof)]
    name = records[0].main.name
    given = noise_std if isinstance(noise_std, Mapping) else {name: noise_std}
    steps = quantum if isinstance(quantum, Mapping) else {name: quantum}
    timing = timing_of(records, model.delay)
    found = _with_states_fitted(model, records, given, {n: q for n, q in steps.items() if q > 0.0}, timing)
    laws = {n: _law(given[n], steps.get(n, 0.0), found, n) for n in found.laws}
    wanted = [n for n in PHYSICAL if n in free]
    shift = [] if timing is None or "delay" in wanted else ["delay"]
    columns = [_physical_columns(r, found, [*wanted, *shift], len(records)) for r in found.residuals]
    used = np.any(np.vstack(columns) != 0.0, axis=0)
    used[: len(wanted)] = True
    information = information_of(found.residuals, [c[:, used] for c in columns], laws)
    if timing is not None:
        at = [*wanted, *shift].index("delay")
        information[at, at] += timing.std**-2
    variance = np.diag(inverse_of(information))[: len(wanted)]
    return dict(zip(wanted, np.sqrt(variance).tolist(), strict=True))


def _physical_columns(residual: Residual, found: Solution, wanted: Sequence[str], runs: int) -> Array:
    """Return the residual's Jacobian (n, wanted + 2 runs) by the wanted physical parameters and the initial states."""
    initial = np.zeros((len(residual.error), 2 * runs))
    initial[:, 2 * residual.record : 2 * residual.record + 2] = residual.jacobian[:, 5:]
    physical = residual.jacobian[:, :5] @ _explicit_by_physical(found.theta)
    return np.hstack([physical[:, [PHYSICAL.index(n) for n in wanted]], initial])


def _with_states_fitted(
    model: SingleDof,
    records: Sequence[Segment],
    noise: Mapping[str, float],
    quanta: Mapping[str, float],
    timing: Timing | None,
) -> Solution:
    """Return the solution of *model* as it is, only the initial states (and the time shift) fitted."""
    theta, fixed = np.array(explicit_parameters(model)), np.zeros(5, dtype=bool)
    found = solve(records, tuple(noise), theta, fixed, bounds_of(records), noise=noise, quanta=quanta, timing=timing)
    if found is None:
        raise NotInformative("the model runs away on these inputs: its drag destabilises it, no bound exists")
    return found


def _law(sigma: float, quantum: float, found: Solution, name: str) -> Law:
    if quantum <= 0.0:
        return Gaussian(sigma)
    span = max(float(np.ptp(r.signal.values)) for r in found.residuals if r.signal.name == name)
    return Rounded(sigma, quantum, span)


def _explicit_by_physical(theta: Array) -> Array:
    """Return the Jacobian of ``(b, a, c, d, T)`` by ``(alpha, beta, beta_quadratic, delta, delay)``."""
    return np.asarray(np.linalg.inv(_physical_jacobian(theta)), dtype=np.float64)


def _physical_jacobian(theta: Array) -> Array:
    b, a, c, d, _ = theta
    G = np.diag([-1.0 / b**2, 1.0 / b, 1.0 / b, 1.0 / b, 1.0])
    G[1:4, 0] = [-a / b**2, -c / b**2, -d / b**2]
    return G
