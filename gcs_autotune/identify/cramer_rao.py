"""Cramer-Rao bounds: the smallest standard errors that any unbiased method can reach with the same runs.

:func:`with_bounds` adds the bounds to a fit of any method. For one axis they come from :func:`cramer_rao`, whose
likelihood includes rounding sensors and inexact stamps. For forms they come from the Fisher information of white noise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import DataError, NotInformative, UsageError
from gcs_autotune.identify.axis.form import PHYSICAL, Explicit, ExplicitForm
from gcs_autotune.identify.axis.start import bounds_of
from gcs_autotune.identify.axis.uncertainty import numbers_of
from gcs_autotune.identify.problems.information import fitted_model_of, information_on
from gcs_autotune.identify.problems.least_squares import inverse_of
from gcs_autotune.identify.problems.likelihood import Objective, information_of
from gcs_autotune.identify.problems.noise import Gaussian, NoiseModel, Rounded
from gcs_autotune.identify.problems.problem import Problem
from gcs_autotune.identify.problems.quick_fit import first_states
from gcs_autotune.identify.problems.reweighting import NOISE_ROUNDS
from gcs_autotune.identify.problems.solution import Solution, solve
from gcs_autotune.identify.result import AxisFit, Fit, Model, is_of_one_axis
from gcs_autotune.identify.signals.preparation import prepare
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.models import SingleDof
from gcs_autotune.trial import Trial

__all__ = ["cramer_rao", "with_bounds"]

Array = NDArray[np.float64]

ModelT = TypeVar("ModelT", bound=Model)


def with_bounds(fit: Fit[ModelT], trials: Trial | Sequence[Trial]) -> Fit[ModelT]:
    """Return *fit* with the Cramer-Rao bound of every fitted parameter.

    A fit of one degree of freedom uses its own likelihood, including rounding sensors and inexact stamps. A fit of
    several degrees of freedom uses :func:`information_on`. A parameter without information has an infinite bound. The
    fit is returned unchanged if its bounds are known, or if its model cannot be simulated on the runs.
    """
    if all(math.isfinite(p.bound) for p in fit.parameters.values() if p.status == "fitted"):
        return fit
    try:
        if is_of_one_axis(fit) and not fit.model.axis.restored:
            bounds = _axis_bounds(fit, trials)
        else:
            bounds = information_on(fitted_model_of(fit, trials)).bounds
    except (DataError, UsageError):
        return fit
    parameters = {n: replace(p, bound=bounds.get(n, p.bound)) for n, p in fit.parameters.items()}
    return replace(fit, parameters=parameters)


def _axis_bounds(fit: AxisFit, trials: Trial | Sequence[Trial]) -> dict[str, float]:
    model = fit.model
    names = dict(zip(PHYSICAL, fit.parameters, strict=True))
    free = [n for n, label in names.items() if fit.parameters[label].status == "fitted"]
    given: Mapping[str, float] = fit.extra.get("sigma") or fit.noise
    noise = {n: float(s) for n, s in given.items() if n in (model.axis.position, model.axis.velocity) and s > 0.0}
    quantum = {n: float(q) for n, q in (fit.extra.get("quantum") or {}).items() if n in noise}
    bounds = cramer_rao(model, trials, noise or fit.noise_std, free, quantum)
    return {names[n]: bound for n, bound in bounds.items()}


def cramer_rao(
    model: SingleDof,
    trials: Trial | Sequence[Trial],
    noise_std: float | Mapping[str, float],
    free: Sequence[str] = ("alpha", "beta", "beta_quadratic", "delta"),
    quantum: float | Mapping[str, float] = 0.0,
) -> dict[str, float]:
    """Return parameter -> smallest standard deviation that an unbiased estimate of *model* from *trials* can have.

    The noise is white and Gaussian with unknown level. The initial states of every run are unknown. If the records show
    that input stamps are not exact, their common shift is unknown too. The result is then the bound of van Trees, with
    a prior for the shift.

    Parameters
    ----------
    noise_std : standard deviation of the position [rad or m] before rounding, or per signal name, e.g. ``{"psi": 0.01,
        "r": 0.02}``.
    free : unknown parameters, some of ``alpha``, ``beta``, ``beta_quadratic``, ``delta`` and ``delay``.
    quantum : resolution [rad or m] of a coarse sensor, or per signal name. 0 if rounding is negligible. The measured
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
    solution = _with_states_fitted(model, segments, given, quanta)
    noise = {n: _noise_model(given[n], steps.get(n, 0.0), solution, n) for n in solution.noise_models}
    dated = solution.shift_std > 0.0
    wanted = [n for n in PHYSICAL if n in free]
    nuisance = ["delay"] if dated and "delay" not in wanted else []
    numbers = numbers_of(solution).later(solution.shift)
    everything = Problem(solution.form, segments, None, bounds_of(segments).limits)
    objective = Objective(everything, np.array(numbers), solution.initial)
    residuals = objective.residuals(objective.pack()) or ()
    by_physical = np.linalg.inv(numbers.physical_slopes)[:, [PHYSICAL.index(n) for n in (*wanted, *nuisance)]]
    wide = [objective.wide(r) for r in residuals]
    columns = [np.hstack([J[:, : len(numbers)] @ by_physical, J[:, len(numbers) :]]) for J in wide]
    used = np.any(np.vstack(columns) != 0.0, axis=0)
    used[: len(wanted)] = True
    information = information_of(residuals, [c[:, used] for c in columns], noise)
    causes = [place - len(numbers) + by_physical.shape[1] for own in objective.common.values() for place in own]
    known = np.isin(np.flatnonzero(used), causes)
    information[known, known] += 1.0
    if dated:
        at = [*wanted, *nuisance].index("delay")
        information[at, at] += solution.shift_std**-2
    variance = np.diag(inverse_of(information))[: len(wanted)]
    return dict(zip(wanted, np.sqrt(variance).tolist(), strict=True))


def _with_states_fitted(
    model: SingleDof, segments: Sequence[Segment], noise: Mapping[str, float], quanta: Mapping[str, float]
) -> Solution:
    """Return the solution at *model*, with only the initial states and the shift of stamps fitted."""
    problem = Problem(ExplicitForm.of(segments[0].dof), segments, None, bounds_of(segments).limits, ())
    theta, rounds = np.array(Explicit.of(model)), NOISE_ROUNDS if len(noise) > 1 else 1
    solution = solve(problem, theta, first_states(segments), levels=noise, quanta=quanta, rounds=rounds, effort=None)
    if solution is None:
        raise NotInformative(
            "the model diverges on these inputs because its drag is destabilising. No bound on its error exists"
        )
    return solution


def _noise_model(sigma: float, quantum: float, solution: Solution, name: str) -> NoiseModel:
    if quantum <= 0.0:
        return Gaussian(sigma)
    return Rounded(sigma, quantum, max(float(np.ptp(r.measured)) for r in solution.rests if r.signal == name))
