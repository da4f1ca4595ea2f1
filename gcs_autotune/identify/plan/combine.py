"""Combine and compare the steps' estimates of shared parameters, then fit all steps at once.

Erunsal2017 (3.4) takes the plain mean of a shared parameter's estimates. Here each estimate is weighted by its
information. With covariances ``P_i`` the combination is ``(sum P_i^-1)^-1 sum P_i^-1 theta_i``. This weighting has the
smallest error, and it uses the correlations between estimates. An uncertain estimate therefore has little influence.

In the joint fit every step keeps its own equations and runs, but all share one vector of parameters. Parameters that a
step held fixed are free in the joint fit. Their uncertainty therefore adds to that of the other parameters. The
covariance is that of all runs together. The fit starts at the steps' estimates, with the noise of each signal from its
step.

If residuals are coloured (gusts, a noisy input, a missing effect), a sample contains less information than with white
noise. The joint fit then uses the low-frequency noise of each signal in each step. This is the standard deviation times
the root of ``1 + 2 sum rho_k``. The covariance is that of the weighted fit with equally coloured residuals.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gcs_autotune import chi_square
from gcs_autotune.identify.problems.initial_guess import initial_guess_of
from gcs_autotune.identify.problems.least_squares import Local, descend, inverse_of
from gcs_autotune.identify.problems.likelihood import Limits, Objective
from gcs_autotune.identify.problems.noise import NoiseModel, gaussian_noise
from gcs_autotune.identify.problems.problem import Problem
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.identify.signals.whiteness import SIGNIFICANCE, autocorrelation, scores_covariance, whiteness
from gcs_autotune.models import Form

__all__ = ["Agreement", "Joint", "Part", "StepEstimate", "agreements", "combined", "fit_jointly"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class StepEstimate:
    """Estimate of one step of a plan.

    - ``names``: names of the parameters.
    - ``values`` (k,): their values.
    - ``covariance`` (k, k): covariance of ``values``, which must be positive definite.
    """

    step: str
    names: tuple[str, ...]
    values: Array
    covariance: Array


@dataclass(frozen=True, slots=True)
class Agreement:
    """Comparison of the estimates of one shared parameter by several steps of a plan.

    - ``values``, ``stds``: estimates and their standard errors, in the order of ``steps``.
    - ``combined``, ``std``: information-weighted mean of the estimates, and its standard error.
    - ``mean``: plain mean of the estimates, as in Erunsal2017.
    - ``probability``: probability that one true value leads to estimates this far apart (chi-square).
    """

    name: str
    steps: tuple[str, ...]
    values: tuple[float, ...]
    stds: tuple[float, ...]
    combined: float
    std: float
    mean: float
    probability: float


def combined(estimates: Sequence[StepEstimate]) -> tuple[tuple[str, ...], Array, Array]:
    """Return the names (k,) of all parameters, their information-weighted values (k,), and the covariance (k, k)."""
    names = tuple(dict.fromkeys(n for e in estimates for n in e.names))
    information, weighted = np.zeros((len(names),) * 2), np.zeros(len(names))
    for e in estimates:
        places = np.array([names.index(n) for n in e.names])
        own = inverse_of(e.covariance)
        information[np.ix_(places, places)] += own
        weighted[places] += own @ e.values
    covariance = inverse_of(information)
    return names, covariance @ weighted, covariance


def agreements(estimates: Sequence[StepEstimate]) -> tuple[Agreement, ...]:
    """Return one :class:`Agreement` for each parameter that several steps estimated."""
    rows = []
    for name in dict.fromkeys(n for e in estimates for n in e.names):
        own = [e for e in estimates if name in e.names]
        if len(own) < 2:
            continue
        values = np.array([e.values[e.names.index(name)] for e in own])
        stds = np.array([float(np.sqrt(e.covariance[(e.names.index(name),) * 2])) for e in own])
        weights = stds**-2
        middle = float(np.sum(weights * values) / np.sum(weights))
        distance = float(np.sum(weights * (values - middle) ** 2))
        rows.append(
            Agreement(
                name,
                tuple(e.step for e in own),
                tuple(values.tolist()),
                tuple(stds.tolist()),
                middle,
                float(np.sum(weights) ** -0.5),
                float(np.mean(values)),
                chi_square.exceeded_by_chance(distance, len(own) - 1),
            )
        )
    return tuple(rows)


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """One step of a plan in the joint fit, with all identified parameters of its form free.

    - ``names`` (f,): names in the joint fit of the parameters ``form.free``.
    - ``noise``: name of the signal -> standard deviation of its noise.
    """

    form: Form
    names: tuple[str, ...]
    records: tuple[Segment, ...]
    noise: Mapping[str, float]


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """Result of the joint fit of all steps.

    - ``names``: names of the parameters.
    - ``values`` (k,), ``covariance`` (k, k): their values and covariance.
    - ``misfit``: misfit per sample. It is 1 if the noise equals that of the separate steps.
    """

    names: tuple[str, ...]
    values: Array
    covariance: Array
    misfit: float
    converged: bool


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    objective: Objective
    laws: Mapping[str, NoiseModel]
    columns: NDArray[np.int64]


def fit_jointly(parts: Sequence[Part], start: Mapping[str, float]) -> Joint | None:
    """Return the joint fit of all steps, or None if the simulation diverges at the start values.

    start : name of the parameter in the joint fit -> start value.
    """
    names = tuple(dict.fromkeys(n for part in parts for n in part.names))
    places, x = _placed(parts, names, start)
    k = len(names)
    everywhere = np.full(len(x), np.inf)
    still = np.concatenate([x[:k], everywhere[k:]])
    settled = descend(partial(_local, places), x, np.where(np.isinf(still), -np.inf, still), still)
    minimum = None if settled is None else descend(partial(_local, places), settled.x, -everywhere, everywhere)
    if minimum is None:
        return None
    samples = sum(len(s.t) for p in parts for r in p.records for s in r.signals.values())
    misfit = minimum.cost / max(samples - len(x), 1)
    coloured = [replace(p, laws=_slow_laws(p, minimum.x)) for p in places]
    last = descend(partial(_local, coloured), minimum.x, -everywhere, everywhere)
    if last is None:
        return None
    return Joint(names, last.x[:k], _covariance(coloured, last.x, k), misfit, minimum.converged and last.converged)


def _local(places: Sequence[_Place], vector: Array) -> Local | None:
    cost, gradient, curvature = 0.0, np.zeros(len(vector)), np.zeros((len(vector),) * 2)
    for place in places:
        own = place.objective.at(vector[place.columns], place.laws)
        if own is None:
            return None
        cost += own.cost
        gradient[place.columns] += own.gradient
        curvature[np.ix_(place.columns, place.columns)] += own.curvature
    return Local(cost, gradient, curvature)


def _slow_laws(place: _Place, x: Array) -> dict[str, NoiseModel]:
    """Return the noise models of one part, with the level of the low-frequency noise."""
    residuals = place.objective.residuals(x[place.columns]) or ()
    levels = {}
    for name, law in place.laws.items():
        own = [r.judged for r in residuals if r.signal == name]
        length = sum(len(e) for e in own)
        spread = np.sqrt(sum(float(e @ e) for e in own) / length)
        longer = sum(len(e) * _correlated_length(e) for e in own) / length
        levels[name] = max(float(spread), law.std) * float(np.sqrt(longer))
    return gaussian_noise(levels, robust=False)


def _correlated_length(error: Array) -> float:
    """Return the number of samples of *error* that equal one sample of white noise, 1 if it is white."""
    if whiteness(error) > SIGNIFICANCE:
        return 1.0
    reach = min(2 * int(np.sqrt(len(error))), len(error) - 1)
    rho = autocorrelation(error, reach)
    return max(1.0, 1.0 + 2.0 * float(np.sum((1.0 - np.arange(1, reach + 1) / (reach + 1.0)) * rho)))


def _covariance(places: Sequence[_Place], x: Array, k: int) -> Array:
    """Return the covariance (k, k) of the parameters, raised where residuals are coloured."""
    here = _local(places, x)
    assert here is not None
    whole = inverse_of(here.curvature)
    influence = []
    for place in places:
        for residual in place.objective.residuals(x[place.columns]) or []:
            slope = place.laws[residual.signal].terms(residual.judged).slope
            own = place.columns[place.objective.columns[residual.segment]]
            influence.append((residual.jacobian * slope[:, None]) @ whole[np.ix_(own, np.arange(k))])
    empirical = scores_covariance(influence)
    raised = np.sqrt(np.maximum(1.0, np.diag(empirical) / np.diag(whole)[:k]))
    covariance: Array = whole[:k, :k] * np.outer(raised, raised)
    return covariance


def _placed(parts: Sequence[Part], names: Sequence[str], start: Mapping[str, float]) -> tuple[list[_Place], Array]:
    """Return the objective of every part with its columns in the joint vector, and the start of that vector."""
    places, used, states = [], len(names), []
    for part in parts:
        form = part.form
        theta = np.array(
            [start[part.names[form.free.index(n)]] if n in form.free else form.known[n] for n in form.parameters]
        )
        initial = initial_guess_of(form, part.records).initial
        objective = Objective(Problem(form, part.records, None, Limits({}, {})), theta, initial)
        own = objective.size - len(form.free)
        shared = np.array([names.index(n) for n in part.names], dtype=np.int64)
        columns = np.concatenate([shared, used + np.arange(own)])
        places.append(_Place(objective, gaussian_noise(part.noise, robust=False), columns))
        states.append(objective.pack()[len(form.free) :])
        used += own
    return places, np.concatenate([np.array([start[n] for n in names]), *states])
