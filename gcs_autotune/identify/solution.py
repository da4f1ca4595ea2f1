"""A fit by maximum likelihood with its uncertainty: one way to solve, one covariance, one inflation for all models.

Simulated against measured motion, each sample at its own stamp, with exact sensitivities; parameters are shared by
all runs, initial states belong to each segment, one noise level per kind of signal is estimated with them. A coarse
sensor's rounding enters the likelihood exactly when its step is given (:mod:`.noise`), started from the Gaussian fit;
otherwise the noise level is not taken below ``step/sqrt(12)``.

Standard errors come from the Fisher information with the estimated noise. When the residuals are not white the
information is overstated: each standard error is then raised to that of the sandwich estimator ``C (sum_k w_k
Gamma_k) C`` (Newey and West 1987), whose ``Gamma_k`` are the autocovariances of the scores up to ``2*sqrt(n)``
samples with Bartlett weights. Correlations between parameters stay those of the Fisher information.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import EffectInstance, in_order
from gcs_autotune.identify.fitted import Fitted
from gcs_autotune.identify.least_squares import inverse_of
from gcs_autotune.identify.likelihood import Limits, Objective, information_of
from gcs_autotune.identify.noise import NoiseModel, Rounded, gaussian_noise
from gcs_autotune.identify.problem import Problem
from gcs_autotune.identify.result import Trace
from gcs_autotune.identify.reweighting import Effort, alternate, errors_of, likeliest
from gcs_autotune.identify.segment import Segment
from gcs_autotune.identify.whiteness import all_white, correlation_time, explained, scores_covariance
from gcs_autotune.models import Form
from gcs_autotune.sname import SIGNALS

__all__ = ["THOROUGH", "Solution", "fit_percents", "solution_of", "solve", "solve_form", "traces_of"]

Array = NDArray[np.float64]

ROUNDS = 6
"""Rounds of parameters, then noise. Chosen: three or four suffice from a usable start."""

ROUNDING_ROUNDS = 20
"""Rounds of parameters, then noise, for a rounding sensor; the noise comes down from the Gaussian fit's residuals."""

THOROUGH = Effort(15)
"""From a bad start the weights matter more than the last digit."""

AT_BOUND = 1e-6
"""Distance from a bound, relative to its size, that counts as standing on it."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Solution(Fitted):
    """A fitted model with its uncertainty.

    ``noise_models`` per signal. ``whole`` (q, q) covariance of the packed vector from the expected information, that of
    ``names`` first and that of the shift last; ``raised`` (q,) factors by which coloured residuals raise standard
    errors; ``at_bound`` those of ``names`` that stand on a limit, ``blind`` those the runs say nothing about. ``rests``
    are those with samples that count; ``rows`` their Jacobians (n, q) over the noise; ``scores`` the log-likelihood's
    derivative by the prediction times the noise (for Gaussian noise: error over noise).
    """

    noise_models: Mapping[str, NoiseModel]
    rows: tuple[Array, ...]
    scores: tuple[Array, ...]
    whole: Array
    raised: Array
    log_likelihood: float
    at_bound: tuple[str, ...]
    blind: tuple[str, ...]

    @property
    def unknowns(self) -> int:
        """How many numbers were fitted, initial states included, a shift of stamps not counted."""
        return len(self.whole) - (self.shift_std > 0.0)

    @property
    def noise(self) -> dict[str, float]:
        """Standard deviation of measured minus true per signal, rounding included."""
        return {name: model.std for name, model in self.noise_models.items()}

    @property
    def quanta(self) -> dict[str, float]:
        """Steps of the signals whose rounding entered the likelihood."""
        return {name: model.quantum for name, model in self.noise_models.items() if model.quantum > 0.0}

    @property
    def white(self) -> bool:
        """Whether no signal of any segment is coloured."""
        return all_white(self.scores)

    @property
    def correlation(self) -> float:
        """How many samples make one independent one."""
        return correlation_time(self.scores)

    def bic(self, correlation: float = 1.0) -> float:
        """Bayesian information criterion, tempered by a *correlation* time (see :mod:`.axis.evidence`)."""
        n = self.samples / correlation
        return -2.0 * self.log_likelihood / correlation + self.unknowns * math.log(n)

    def rms(self, name: str) -> float:
        """Return the root mean square of what is left of all signals called *name*."""
        return float(np.sqrt(np.mean(errors_of(self.rests, name) ** 2)))

    @property
    def factors(self) -> Array:
        """Factors (f,), 1 or more, by which coloured residuals raise the standard errors of ``names``."""
        return self.raised[: len(self.names)]

    @property
    def raised_covariance(self) -> Array:
        """Covariance (f, f) of ``names``, raised for coloured residuals."""
        k = len(self.names)
        raised: Array = self.whole[:k, :k] * np.outer(self.factors, self.factors)
        return raised

    @property
    def bounds(self) -> dict[str, float]:
        """Cramer-Rao bound of each of ``names``."""
        return dict(zip(self.names, np.sqrt(np.diag(self.whole)).tolist(), strict=False))


def solve(
    problem: Problem,
    theta: Array,
    initial: Sequence[Array],
    *,
    levels: Mapping[str, float],
    effects: Sequence[EffectInstance] = (),
    quanta: Mapping[str, float] | None = None,
    shift: float = 0.0,
    robust: bool = False,
    rounds: int = ROUNDS,
    effort: Effort | None = THOROUGH,
) -> Solution | None:
    """Fit what is free in *problem* from *theta* on; None if that runs away.

    Parameters
    ----------
    theta : (p,) start values in the form's order. initial : (n,) start states per segment.
    levels : noise levels to start from, one per signal name.
    quanta : steps of the signals to be taken as rounded, per name.
    robust : soft-L1 weights, for records with outliers (signals taken as rounded bear them anyway).
    """
    objective = Objective(problem, theta, initial, in_order(effects), shift=shift)
    low, high = objective.limits()
    noise: Mapping[str, NoiseModel] = gaussian_noise(levels, robust=robust)
    found = alternate(objective, objective.pack(), noise, low, high, rounds, effort)
    if found is not None and quanta:
        noise = {n: _rounded(n, model, quanta.get(n, 0.0), problem.segments) for n, model in found[1].items()}
        found = alternate(objective, found[0].x, noise, low, high, ROUNDING_ROUNDS, effort)
    if found is None:
        return None
    minimum, noise = found
    residuals = objective.residuals(minimum.x)
    if residuals is None:  # at the edge of running away, where a finer step decides otherwise
        return None
    columns = [objective.wide(r) for r in residuals]
    theta, effects, states, shift = objective.unpack(minimum.x)
    levels = {n: model.std for n, model in noise.items()}
    fitted = Fitted(
        form=problem.form,
        theta=theta,
        effects=effects,
        free=problem.free,
        free_effects=objective.free_effects,
        initial=states,
        cost=minimum.cost,
        levels=levels,
        rests=residuals,
        jacobian=np.vstack([J / levels[r.signal] for r, J in zip(residuals, columns, strict=True)]),
        samples=sum(len(c) for c in columns),
        converged=minimum.converged,
        shift=shift,
        shift_std=problem.shift_std,
    )
    return _with_uncertainty(fitted, noise, columns, objective.known()[1], (low, high))


def solve_form(
    form: Form,
    segments: Sequence[Segment],
    theta: Array,
    initial: Sequence[Array],
    limits: Limits,
    *,
    levels: Mapping[str, float],
    free: Sequence[str] | None = None,
    shift: float = 0.0,
    robust: bool = False,
    effort: Effort = THOROUGH,
) -> Solution | None:
    """Solve for a form without effects; as :func:`solve`."""
    problem = Problem(form, segments, None, limits, free)
    return solve(problem, theta, initial, levels=levels, shift=shift, robust=robust, effort=effort)


def solution_of(problem: Problem, fitted: Fitted) -> Solution:
    """Return *fitted* with the uncertainty of its numbers."""
    columns, at = [], 0
    for rest in fitted.rests:
        count = int(rest.known.sum())
        columns.append(fitted.jacobian[at : at + count] * fitted.levels[rest.signal])
        at += count
    weight = np.zeros(fitted.jacobian.shape[1])
    weight[-1] = fitted.shift_std**-2 if fitted.shift_std else 0.0
    noise = gaussian_noise(fitted.levels)
    return _with_uncertainty(fitted, noise, columns, weight, problem.edges(fitted.effects, fitted.free_effects))


def _with_uncertainty(
    fitted: Fitted,
    models: Mapping[str, NoiseModel],
    columns: Sequence[Array],
    weight: Array,
    limits: tuple[Array, Array],
) -> Solution:
    """Return *fitted* with noise levels raised for the numbers fitted, covariance, and what colour does to it.

    models : of the noise, per signal. columns : Jacobians (n, q) of ``rests``. weight : (q,) information known
    beforehand. limits : of ``names``. What stands at a bound is taken as known there; what the runs say nothing about
    is left out.
    """
    seen_in = [(rest, J) for rest, J in zip(fitted.rests, columns, strict=True) if len(J)]
    rests, columns = tuple(rest for rest, _ in seen_in), [J for _, J in seen_in]
    names = [*fitted.names, *[""] * (len(weight) - len(fitted.names))]
    noise = likeliest(rests, models, spent=float(len(weight)))
    at_bound = _standing_at_bound(fitted.names, fitted.shared, *limits)
    information = information_of(rests, columns, noise) + np.diag(weight)
    seen = np.diag(information) > 0.0
    loose = seen & np.array([n not in at_bound for n in names], dtype=bool)
    whole = np.zeros_like(information)
    whole[np.ix_(loose, loose)] = inverse_of(information[np.ix_(loose, loose)])
    own = [noise[r.signal] for r in rests]
    pairs = list(zip(rests, own, strict=True))
    scores = tuple(model.std * model.terms(r.judged[r.known]).slope for r, model in pairs)
    rows = tuple(J / model.std for J, model in zip(columns, own, strict=True))
    last = likeliest(rests, models)
    return Solution(
        **{f.name: getattr(fitted, f.name) for f in fields(fitted) if f.name != "rests"},
        rests=rests,
        noise_models=noise,
        rows=rows,
        scores=scores,
        whole=whole,
        raised=_raised_by(whole, scores, rows),
        log_likelihood=sum(model.log_likelihood(errors_of(rests, n)) for n, model in last.items()),
        at_bound=at_bound,
        blind=tuple(n for n, s in zip(names, seen, strict=True) if n and not s),
    )


def _standing_at_bound(names: Sequence[str], x: Array, low: Array, high: Array) -> tuple[str, ...]:
    """Return which of *names*, the first entries of *x*, stand on a limit."""
    found = []
    for i, name in enumerate(names):
        for edge in (low[i], high[i]):
            if np.isfinite(edge) and abs(x[i] - edge) <= AT_BOUND * max(abs(edge), abs(x[i])):
                found.append(name)
    return tuple(dict.fromkeys(found))


def _raised_by(whole: Array, scores: Sequence[Array], rows: Sequence[Array]) -> Array:
    """Return the factors (q,), 1 or more, by which coloured residuals raise the standard errors."""
    if all_white(scores):
        return np.ones(len(whole))
    S = scores_covariance([J * s[:, None] for J, s in zip(rows, scores, strict=True)])
    sandwich, fisher = np.diag(whole @ S @ whole), np.diag(whole)
    ratio = np.sqrt(np.maximum(sandwich, 0.0) / np.where(fisher > 0.0, fisher, np.inf))
    raised: Array = np.maximum(1.0, ratio)
    return raised


def _rounded(name: str, gaussian: NoiseModel, quantum: float, segments: Sequence[Segment]) -> NoiseModel:
    if quantum <= 0.0:
        return gaussian
    span = max(float(np.ptp(s.signals[name].values)) for s in segments if name in s.signals)
    return Rounded(gaussian.sigma, quantum, span)


def traces_of(segments: Sequence[Segment], solution: Solution) -> tuple[Trace, ...]:
    """Return fit against measurement; the band is that of prediction and noise together, raised for colour."""
    raised = float(solution.factors.max(initial=1.0))
    traces = []
    for r, rows in zip(solution.rests, solution.rows, strict=True):
        spread = np.einsum("ij,jk,ik->i", rows, solution.whole, rows, optimize=True) * raised**2
        band = np.full(len(r.t), 1.96 * solution.noise[r.signal])
        band[r.known] *= np.sqrt(1.0 + np.maximum(spread, 0.0))
        run, unit = segments[r.segment].name, SIGNALS[r.signal][0]
        traces.append(Trace(run, r.t, r.measured, r.predicted, band, r.signal, unit))
    return tuple(traces)


def fit_percents(solution: Solution) -> dict[str, float]:
    """Return 100 (1 - rms/std) per signal that moves."""
    return explained((r.signal, r.measured[r.known], r.judged[r.known]) for r in solution.rests)
