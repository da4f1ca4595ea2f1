"""Uncertainty of a fit of one degree of freedom in physical parameters, and its Cramer-Rao bound.

The bound applies to any method.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.axis.form import PHYSICAL, Explicit, ExplicitForm
from gcs_autotune.identify.axis.start import bounds_of
from gcs_autotune.identify.problems.least_squares import inverse_of
from gcs_autotune.identify.problems.likelihood import Objective, information_of
from gcs_autotune.identify.problems.noise import Gaussian, NoiseModel, Rounded
from gcs_autotune.identify.problems.problem import Problem
from gcs_autotune.identify.problems.quick_fit import first_states
from gcs_autotune.identify.problems.reweighting import NOISE_ROUNDS
from gcs_autotune.identify.problems.solution import Solution, solve
from gcs_autotune.identify.signals.preparation import prepare
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.models import SingleDof
from gcs_autotune.trial import Trial

__all__ = ["cramer_rao", "explicit_covariance", "numbers_of", "physical_covariance", "std_of"]

Array = NDArray[np.float64]


def numbers_of(solution: Solution) -> Explicit:
    """Return the fitted explicit parameters of one degree of freedom."""
    return Explicit(*solution.theta.tolist())


def physical_covariance(solution: Solution, *, raised: bool = True) -> Array:
    """Return the covariance (5, 5) of the physical parameters.

    Arguments are those of :func:`explicit_covariance`.
    """
    G = numbers_of(solution).physical_slopes
    transformed: Array = G @ explicit_covariance(solution, raised=raised) @ G.T
    return transformed


def std_of(solution: Solution, name: str, *, raised: bool = True) -> float:
    """Return the standard error of one explicit parameter, 0 if it was not fitted."""
    if name not in solution.free:
        return 0.0
    at = solution.free.index(name)
    covariance = solution.raised_covariance if raised else solution.whole
    return float(np.sqrt(covariance[at, at]))


def explicit_covariance(solution: Solution, *, raised: bool = True) -> Array:
    """Return the covariance (5, 5) of the explicit parameters, zero for those not fitted.

    raised : whether to include the effect of coloured residuals.
    """
    names, k = solution.form.parameters, len(solution.free)
    covariance, places = np.zeros((len(names),) * 2), [names.index(n) for n in solution.free]
    covariance[np.ix_(places, places)] = solution.raised_covariance if raised else solution.whole[:k, :k]
    return covariance


def cramer_rao(
    model: SingleDof,
    trials: Trial | Sequence[Trial],
    noise_std: float | Mapping[str, float],
    free: Sequence[str] = ("alpha", "beta", "beta_quadratic", "delta"),
    quantum: float | Mapping[str, float] = 0.0,
) -> dict[str, float]:
    """Return the smallest standard deviation of an unbiased estimate of *model* from *trials*, per parameter.

    The noise is white and Gaussian with unknown level. The initial states of every run are unknown. If the records show
    that input stamps are not exact, their common shift is unknown too. The bound is then that of van Trees, with a
    prior for the shift.

    Parameters
    ----------
    noise_std : standard deviation of the position [rad or m] before rounding, or per signal name, e.g. ``{"psi": 0.01,
        "r": 0.02}``.
    free : which of ``alpha beta beta_quadratic delta delay`` are unknown.
    quantum : resolution [rad or m] of a coarse sensor, 0 for none, or per signal name. The measured
        values define the cells, so they must come from the coarse sensor.

    Raises
    ------
    NotInformative
        The model diverges on these inputs.
    """
    runs = (trials,) if isinstance(trials, Trial) else tuple(trials)
    records = [record for trial in runs for record in prepare(trial, model.dof)]
    name = records[0].main.name
    given = noise_std if isinstance(noise_std, Mapping) else {name: noise_std}
    steps = quantum if isinstance(quantum, Mapping) else {name: quantum}
    segments = [s.only(tuple(given)) for s in records]
    quanta = {n: q for n, q in steps.items() if q > 0.0}
    found = _with_states_fitted(model, segments, given, quanta)
    noise = {n: _noise_model(given[n], steps.get(n, 0.0), found, n) for n in found.noise_models}
    dated = found.shift_std > 0.0
    wanted = [n for n in PHYSICAL if n in free]
    nuisance = ["delay"] if dated and "delay" not in wanted else []
    numbers = numbers_of(found).later(found.shift)
    everything = Problem(found.form, segments, None, bounds_of(segments).limits)
    objective = Objective(everything, np.array(numbers), found.initial)
    residuals = objective.residuals(objective.pack()) or ()
    by_physical = np.linalg.inv(numbers.physical_slopes)[:, [PHYSICAL.index(n) for n in (*wanted, *nuisance)]]
    wide = [objective.wide(r) for r in residuals]
    columns = [np.hstack([J[:, : len(numbers)] @ by_physical, J[:, len(numbers) :]]) for J in wide]
    used = np.any(np.vstack(columns) != 0.0, axis=0)
    used[: len(wanted)] = True
    information = information_of(residuals, [c[:, used] for c in columns], noise)
    if dated:
        at = [*wanted, *nuisance].index("delay")
        information[at, at] += found.shift_std**-2
    variance = np.diag(inverse_of(information))[: len(wanted)]
    return dict(zip(wanted, np.sqrt(variance).tolist(), strict=True))


def _with_states_fitted(
    model: SingleDof, segments: Sequence[Segment], noise: Mapping[str, float], quanta: Mapping[str, float]
) -> Solution:
    """Return the solution at *model*, with only the initial states and the shift of stamps fitted."""
    problem = Problem(ExplicitForm.of(segments[0].dof), segments, None, bounds_of(segments).limits, ())
    theta, rounds = np.array(Explicit.of(model)), NOISE_ROUNDS if len(noise) > 1 else 1
    found = solve(problem, theta, first_states(segments), levels=noise, quanta=quanta, rounds=rounds, effort=None)
    if found is None:
        raise NotInformative("the model diverges on these inputs: its drag is destabilising, so no bound exists")
    return found


def _noise_model(sigma: float, quantum: float, found: Solution, name: str) -> NoiseModel:
    if quantum <= 0.0:
        return Gaussian(sigma)
    return Rounded(sigma, quantum, max(float(np.ptp(r.measured)) for r in found.rests if r.signal == name))
