"""Fit by maximum likelihood and calculate the uncertainty, in the same way for all models.

Simulated and measured motion are compared sample by sample, with exact sensitivities. All runs share the parameters.
Each segment has its own initial states. One noise level per kind of signal is estimated too. If the resolution of a
coarse sensor is known, the likelihood includes its exact rounding (:mod:`.noise`), starting from the Gaussian fit.
Otherwise the noise level is at least ``step/sqrt(12)``.

Standard errors come from the Fisher information with the estimated noise. If the residuals are not white, the
information is overestimated. Each standard error is then raised to that of the sandwich estimator ``C (sum_k w_k
Gamma_k) C`` (Newey and West 1987). ``Gamma_k`` are the autocovariances of the scores up to ``2*sqrt(n)`` samples, with
Bartlett weights. Correlations between parameters remain those of the Fisher information.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import EffectInstance, in_order
from gcs_autotune.identify.problems.fitted import Fitted
from gcs_autotune.identify.problems.least_squares import inverse_of
from gcs_autotune.identify.problems.likelihood import Limits, Objective, information_of
from gcs_autotune.identify.problems.noise import NoiseModel, Rounded, gaussian_noise
from gcs_autotune.identify.problems.problem import Problem
from gcs_autotune.identify.problems.reweighting import Effort, alternate, errors_of, likeliest
from gcs_autotune.identify.result import Trace
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.identify.signals.whiteness import all_white, correlation_time, explained, scores_covariance
from gcs_autotune.models import Form
from gcs_autotune.rounding import HALF_WIDTH
from gcs_autotune.sname import SIGNALS

__all__ = ["THOROUGH", "Solution", "fit_percents", "solution_of", "solve", "solve_form", "traces_of"]

Array = NDArray[np.float64]

ROUNDS = 6
"""Maximum number of rounds of fitting parameters, then noise.

From a usable start three or four suffice. Project choice.
"""

ROUNDING_ROUNDS = 20
"""Maximum number of rounds of fitting parameters, then noise, for a rounding sensor.

The noise has to decrease from the level of the Gaussian fit. Project choice.
"""

THOROUGH = Effort(15)
"""Effort for a bad start, for which correct weights are more important than full convergence. Project choice."""

AT_BOUND = 1e-6
"""Relative distance from a bound below which a parameter counts as on the bound. Project choice."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Solution(Fitted):
    """A fitted model with its uncertainty.

    - ``noise_models``: name of the signal -> noise model.
    - ``whole`` (q, q): covariance of the packed vector, from the expected information. The parameters ``names`` come
      first, the shift of stamps last.
    - ``raised`` (q,): factors by which coloured residuals raise standard errors.
    - ``at_bound``: those of ``names`` that are on a limit.
    - ``blind``: those of ``names`` on which the runs contain no information.
    - ``rests``: residuals of all signals with samples that are used.
    - ``rows``: Jacobians (n, q) of ``rests``, divided by the noise.
    - ``scores``: derivative of the log-likelihood by the prediction, times the noise. For Gaussian noise this is the
      error divided by the noise.
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
        """Number of fitted values, including initial states, without a shift of stamps."""
        return len(self.whole) - (self.shift_std > 0.0)

    @property
    def noise(self) -> dict[str, float]:
        """Name of the signal -> standard deviation of measured minus true value, including rounding."""
        return {name: model.std for name, model in self.noise_models.items()}

    @property
    def quanta(self) -> dict[str, float]:
        """Name of the signal -> resolution of the sensor, for signals whose rounding the likelihood includes."""
        return {name: model.quantum for name, model in self.noise_models.items() if model.quantum > 0.0}

    @property
    def white(self) -> bool:
        """Whether the residuals of all signals in all segments are white."""
        return all_white(self.scores)

    @property
    def correlation(self) -> float:
        """Number of samples that are equivalent to one independent sample."""
        return correlation_time(self.scores)

    def bic(self, correlation: float = 1.0) -> float:
        """Return the Bayesian information criterion, tempered by the *correlation* time.

        See :mod:`..axis.evidence`.
        """
        n = self.samples / correlation
        return -2.0 * self.log_likelihood / correlation + self.unknowns * math.log(n)

    def rms(self, name: str) -> float:
        """Return the root mean square residual of the signal *name* over all segments."""
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
        """Name of the parameter -> Cramer-Rao bound, for all of ``names``."""
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
    """Return the fit of the free parameters of *problem* that starts at *theta*, or None if the simulation diverges.

    Parameters
    ----------
    theta : (p,) start values in the form's order.
    initial : initial states (n,) per segment to start from.
    levels : name of the signal -> noise level to start from.
    quanta : name -> resolution, for the signals to be treated as rounded.
    robust : whether to use soft-L1 weights, for records with outliers. Signals treated as rounded tolerate outliers
        anyway.
    """
    objective = Objective(problem, theta, initial, in_order(effects), shift=shift)
    low, high = objective.limits()
    noise: Mapping[str, NoiseModel] = gaussian_noise(levels, robust=robust)
    fit = alternate(objective, objective.pack(), noise, low, high, rounds, effort)
    if fit is not None and quanta:
        noise = {n: _rounded(n, model, quanta.get(n, 0.0), problem.segments) for n, model in fit[1].items()}
        fit = alternate(objective, fit[0].x, noise, low, high, ROUNDING_ROUNDS, effort)
    if fit is None:
        return None
    minimum, noise = fit
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
        prior=objective.known()[1],
    )
    return _with_uncertainty(fitted, noise, columns, (low, high))


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
    """Return the fit of the free parameters of a form without effects, or None if the simulation diverges; see
    :func:`solve`.
    """
    problem = Problem(form, segments, None, limits, free)
    return solve(problem, theta, initial, levels=levels, shift=shift, robust=robust, effort=effort)


def solution_of(problem: Problem, fitted: Fitted) -> Solution:
    """Return *fitted* with the uncertainty of its parameters."""
    columns, at = [], 0
    for rest in fitted.rests:
        count = int(rest.known.sum())
        columns.append(fitted.jacobian[at : at + count] * fitted.levels[rest.signal])
        at += count
    noise = gaussian_noise(fitted.levels)
    return _with_uncertainty(fitted, noise, columns, problem.edges(fitted.effects, fitted.free_effects))


def _with_uncertainty(
    fitted: Fitted,
    models: Mapping[str, NoiseModel],
    columns: Sequence[Array],
    limits: tuple[Array, Array],
) -> Solution:
    """Return *fitted* with its covariance, and with noise levels corrected for the number of fitted values.

    Factors for coloured residuals are included. A parameter at a bound is taken as known. A parameter on which the runs
    contain no information is left out.

    models : noise model per signal.
    columns : Jacobians (n, q) of ``rests``.
    limits : lower and upper limits of ``names``.
    """
    weight = fitted.prior
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
    """Return the parameters in *names*, the first entries of *x*, that are at a limit."""
    standing = []
    for i, name in enumerate(names):
        for edge in (low[i], high[i]):
            if np.isfinite(edge) and abs(x[i] - edge) <= AT_BOUND * max(abs(edge), abs(x[i])):
                standing.append(name)
    return tuple(dict.fromkeys(standing))


def _raised_by(whole: Array, scores: Sequence[Array], rows: Sequence[Array]) -> Array:
    """Return the factors (q,), at least 1, by which coloured residuals raise the standard errors."""
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
    """Return one trace per signal and segment: measured and fitted values with their 95 % band.

    The band includes the errors of prediction and noise, raised for coloured residuals.
    """
    raised = float(solution.factors.max(initial=1.0))
    traces = []
    for r, rows in zip(solution.rests, solution.rows, strict=True):
        spread = np.einsum("ij,jk,ik->i", rows, solution.whole, rows, optimize=True) * raised**2
        band = np.full(len(r.t), HALF_WIDTH * solution.noise[r.signal])
        band[r.known] *= np.sqrt(1.0 + np.maximum(spread, 0.0))
        run, unit = segments[r.segment].name, SIGNALS[r.signal][0]
        traces.append(Trace(run, r.t, r.measured, r.predicted, band, r.signal, unit))
    return tuple(traces)


def fit_percents(solution: Solution) -> dict[str, float]:
    """Return name -> 100 (1 - rms/std) for each signal that moves."""
    return explained((r.signal, r.measured[r.known], r.judged[r.known]) for r in solution.rests)
