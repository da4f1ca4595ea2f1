"""Output error for coupled models: maximum likelihood over several runs at once, the reference method.

Simulated against measured motion, each sample at its own stamp, with exact sensitivities; parameters shared by all
runs, initial states of their own for every stretch, one noise level per kind of signal estimated with them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.axis.likelihood import Law, gaussian_laws
from gcs_autotune.identify.axis.objective import information_of
from gcs_autotune.identify.axis.residuals import Residual
from gcs_autotune.identify.colour import all_white, correlation_time, scores_covariance
from gcs_autotune.identify.coupled.objective import CoupledObjective, Limits
from gcs_autotune.identify.least_squares import inverse_of
from gcs_autotune.identify.rounds import Effort, alternate, errors_of, likeliest
from gcs_autotune.identify.segment import Segment
from gcs_autotune.models.coupled import Form

__all__ = ["THOROUGH", "CoupledSolution", "inflation_of", "near_bound", "solve_coupled"]

Array = NDArray[np.float64]

ROUNDS = 6
"""Rounds of parameters, then noise. Chosen: three or four suffice from a usable start."""

THOROUGH = Effort(15)
"""From a bad start the weights matter more than the last digit."""

AT_BOUND = 1e-6
"""Distance from a bound, relative to its size, that counts as standing on it."""


@dataclass(frozen=True, slots=True, eq=False)
class CoupledSolution:
    """A fitted coupled model.

    ``theta`` (p,) in the form's order; ``free`` the fitted names; ``initial`` (n,) states per record; ``whole``
    (f + states, same) covariance of the packed vector from the Fisher information, that of ``free`` first;
    ``factors`` (f,) by which coloured residuals raise the standard errors; ``blind`` names the runs say nothing about;
    ``rows`` Jacobians (n, f + states) over the noise, one per residual; ``scores`` errors over the noise.
    """

    form: Form
    theta: Array
    free: tuple[str, ...]
    initial: tuple[Array, ...]
    laws: Mapping[str, Law]
    residuals: tuple[Residual, ...]
    rows: tuple[Array, ...]
    scores: tuple[Array, ...]
    whole: Array
    factors: Array
    log_likelihood: float
    cost: float
    n: int
    converged: bool
    at_bound: tuple[str, ...]
    blind: tuple[str, ...]

    @property
    def parameters(self) -> int:
        """How many numbers were fitted, initial states included."""
        return len(self.whole)

    @property
    def noise(self) -> dict[str, float]:
        """Standard deviation of measured minus true per signal."""
        return {name: law.std for name, law in self.laws.items()}

    @property
    def white(self) -> bool:
        """Whether no signal of any stretch is coloured."""
        return all_white(self.scores)

    @property
    def correlation(self) -> float:
        """How many samples make one independent one."""
        return correlation_time(self.scores)

    def bic(self, correlation: float = 1.0) -> float:
        """Bayesian information criterion, tempered by a *correlation* time (see ``axis.evidence``)."""
        n = self.n / correlation
        return -2.0 * self.log_likelihood / correlation + self.parameters * math.log(n)

    def value(self, name: str) -> float:
        """Return a parameter's value."""
        return float(self.theta[self.form.parameters.index(name)])

    @property
    def covariance(self) -> Array:
        """Covariance (f, f) of the free parameters, raised for coloured residuals."""
        k = len(self.free)
        raised: Array = self.whole[:k, :k] * np.outer(self.factors, self.factors)
        return raised


def solve_coupled(
    form: Form,
    records: Sequence[Segment],
    theta: Array,
    initial: Sequence[Array],
    limits: Limits,
    *,
    levels: Mapping[str, float],
    free: Sequence[str] | None = None,
    robust: bool = False,
    effort: Effort = THOROUGH,
) -> CoupledSolution | None:
    """Fit the *free* parameters (all free ones of the form when None) from *theta* on; None if that runs away.

    Parameters
    ----------
    theta : (p,) start values in the form's order. initial : (n,) start states per record.
    levels : noise levels to start from, one per signal name.
    robust : soft-L1 weights, for records with outliers.
    """
    names = tuple(form.free if free is None else free)
    objective = CoupledObjective(form, tuple(records), names, theta, tuple(initial))
    low, high = objective.limits(limits)
    found = alternate(objective, objective.pack(), gaussian_laws(levels, robust=robust), low, high, ROUNDS, effort)
    if found is None:
        return None
    minimum, laws = found
    residuals = objective.residuals(minimum.x)
    if residuals is None:  # at the edge of running away, where a finer step decides otherwise
        return None
    laws = likeliest(residuals, laws, spent=float(len(minimum.x)))
    columns = [objective.columns(r) for r in residuals]
    at_bound = near_bound(names, minimum.x, low, high)
    whole, blind = _covariance(objective, residuals, columns, laws, at_bound)
    own = [laws[r.signal.name] for r in residuals]
    scores = tuple(law.std * law.terms(r.error).slope for r, law in zip(residuals, own, strict=True))
    rows = tuple(J / law.std for J, law in zip(columns, own, strict=True))
    solved_theta, solved_initial = objective.unpack(minimum.x)
    last = likeliest(residuals, laws)
    return CoupledSolution(
        form=form,
        theta=solved_theta,
        free=names,
        initial=solved_initial,
        laws=laws,
        residuals=tuple(residuals),
        rows=rows,
        scores=scores,
        whole=whole,
        factors=inflation_of(whole, scores, rows, len(names)),
        log_likelihood=sum(law.log_likelihood(errors_of(residuals, name)) for name, law in last.items()),
        cost=minimum.cost,
        n=sum(len(r.error) for r in residuals),
        converged=minimum.converged,
        at_bound=at_bound,
        blind=blind,
    )


def near_bound(names: Sequence[str], x: Array, low: Array, high: Array) -> tuple[str, ...]:
    """Return which of *names*, the first entries of *x*, stand on a limit."""
    found = []
    for i, name in enumerate(names):
        for edge in (low[i], high[i]):
            if np.isfinite(edge) and abs(x[i] - edge) <= AT_BOUND * max(abs(edge), abs(x[i])):
                found.append(name)
    return tuple(dict.fromkeys(found))


def _covariance(
    objective: CoupledObjective,
    residuals: Sequence[Residual],
    columns: Sequence[Array],
    laws: Mapping[str, Law],
    at_bound: Sequence[str],
) -> tuple[Array, tuple[str, ...]]:
    """Return the covariance of the vector, and the parameters without any information.

    What stands at a bound is taken as known there; what the runs say nothing about is left out.
    """
    information = information_of(residuals, columns, laws) + np.diag(objective.known()[1])
    names = [*objective.free, *[""] * (objective.size - len(objective.free))]
    seen = np.diag(information) > 0.0
    loose = seen & np.array([n not in at_bound for n in names], dtype=bool)
    whole = np.zeros_like(information)
    whole[np.ix_(loose, loose)] = inverse_of(information[np.ix_(loose, loose)])
    return whole, tuple(n for n, s in zip(names, seen, strict=True) if n and not s)


def inflation_of(whole: Array, scores: Sequence[Array], rows: Sequence[Array], k: int) -> Array:
    """Return the factors (k,), 1 or more, by which coloured residuals raise the standard errors."""
    if all_white(scores):
        return np.ones(k)
    S = scores_covariance([J * s[:, None] for J, s in zip(rows, scores, strict=True)])
    sandwich, fisher = np.diag(whole @ S @ whole)[:k], np.diag(whole)[:k]
    ratio = np.sqrt(np.maximum(sandwich, 0.0) / np.where(fisher > 0.0, fisher, np.inf))
    raised: Array = np.maximum(1.0, ratio)
    return raised
