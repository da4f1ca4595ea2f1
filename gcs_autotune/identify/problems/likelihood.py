"""Likelihood of any fit: of parameters, effects, initial states and the shift of stamps.

The vector of unknowns contains the free base parameters, the free parameters of effects, and the free initial states of
every segment. If the samples of a run have common errors (``Signal.common``), their causes follow. They are fitted too,
with their prior, so that such an error counts once and not for every sample. If input changes are time-stamped midway
between two messages (decision 3), a common shift of all their stamps comes last. The shift must not be fitted as an
effect or as inertia. It differs from a delay only by its small size, which its prior expresses (:class:`.StampPrior`).

Noise is treated in one of two ways. :meth:`Objective.at` uses supplied noise models (:class:`.noise.NoiseModel`:
Gaussian, robust or rounded). They are for fits that estimate noise and vector in turn (:mod:`.reweighting`).
:meth:`Objective.concentrated` sets Gaussian levels to their optimum at every step. The cost is then ``sum_s n_s
log(RSS_s / n_s)``. Its Gauss-Newton step is that of least squares weighted with ``n_s / RSS_s``. Costs of models with
different effects can then be compared.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import EFFECTS, DataSummary, EffectInstance, EffectResidual
from gcs_autotune.identify.problems.free_numbers import FreeNumbers, StampedProblem
from gcs_autotune.identify.problems.least_squares import Local
from gcs_autotune.identify.problems.limits import Limits
from gcs_autotune.identify.problems.noise import NoiseModel
from gcs_autotune.identify.problems.simulators import SegmentSimulator, free_states, simulator_of, typical_of
from gcs_autotune.identify.signals.segment import Segment

__all__ = [
    "Limits",
    "Objective",
    "Residual",
    "first_input",
    "information_of",
    "judged_by",
]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

REMEMBERED = 3
"""Number of vectors whose residuals are cached. Project choice.

Each round of noise estimation starts at the vector where the last one ended.
"""

LAGGED = 1.0
"""Prior standard deviation of the first value of a lagged input, in units of the range of that input.

Project choice.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Residual:
    """Residual of one signal in one segment.

    - ``t``, ``measured``, ``predicted`` (n,): stamps [s], measured values and predicted values.
    - ``judged`` (n,): measured minus predicted, over the relative standard deviation of each sample if that is known.
      Common errors are subtracted. If the errors of neighbouring samples are known to be correlated, this is what is
      new in each of them. If a disturbance among the effects explains a fraction of this difference, that fraction is
      subtracted. NaN marks samples that the disturbance explains completely.
    - ``jacobian`` (n, k): derivatives of the prediction in the segment's own columns, empty without sensitivities.
    - ``step``: resolution of the sensor, 0 if negligible.
    - ``penalty``: contribution of a disturbance to minus twice the log-likelihood.
    - ``fold``: index of the block of data that is left out.
    """

    segment: int
    signal: str
    t: Array
    measured: Array
    predicted: Array
    judged: Array
    jacobian: Array = field(default_factory=lambda: np.zeros((0, 0)))
    step: float = 0.0
    penalty: float = 0.0
    fold: int = 0

    @property
    def known(self) -> NDArray[np.bool_]:
        """Mask (n,) of the samples that the cost includes."""
        return np.isfinite(self.judged)


class Objective(FreeNumbers):
    """Cost of a fit as a function of one packed vector of all unknowns.

    Parameters
    ----------
    theta : (p,) all base parameters in the form's order, with values for those not free.
    initial : initial states (n,) per segment, with values for those not free.
    effects : in the order in which they act.
    shift : start value of the shift of stamps [s].
    fixed_effects, fixed_states : whether the parameters of effects, and the initial states, are not fitted.
    patience : maximum number of integration steps per stamp. A stiffer model does not fit the sampling.
    """

    def __init__(
        self,
        problem: StampedProblem,
        theta: Array,
        initial: Sequence[Array],
        effects: Sequence[EffectInstance] = (),
        *,
        shift: float = 0.0,
        fixed_effects: bool = False,
        fixed_states: bool = False,
        patience: int | None = None,
    ) -> None:
        form, free = problem.form, problem.free
        places = np.array([form.parameters.index(n) for n in free], dtype=np.int64)
        super().__init__(problem, theta, places, effects, fixed_effects=fixed_effects)
        self.problem, self.initial = problem, tuple(initial)
        self.shift, self.dated = shift, problem.dating > 0.0
        self.levels: dict[str, float] = {}
        self._recent: dict[bytes, tuple[Residual, ...] | None] = {}
        self.scales = _scales(problem.segments)
        typical = [] if problem.summary is None else self._typical(problem.summary)
        used = self.shared
        by_names: dict[tuple[str, ...], SegmentSimulator] = {}
        self.simulators: list[SegmentSimulator] = []
        self.columns: list[Index] = []
        self.state_places: list[Index] = []
        for segment in problem.segments:
            names = () if fixed_states else free_states(form, self.effects, segment)
            if names not in by_names:
                by_names[names] = simulator_of(
                    form,
                    self.effects,
                    free,
                    self.free_effects,
                    names,
                    typical=typical,
                    data_summary=problem.summary,
                    dated=self.dated,
                    patience=patience,
                )
            simulator = by_names[names]
            self.simulators.append(simulator)
            self.columns.append(np.concatenate([np.arange(self.shared), used + np.arange(len(names))]))
            self.state_places.append(np.array([simulator.states.index(n) for n in names], dtype=np.int64))
            used += len(names)
        self.common: dict[str, Index] = {}
        for segment in problem.segments:
            causes = max((signal.common.shape[1] for signal in segment.signals.values()), default=0)
            if segment.run not in self.common:
                self.common[segment.run] = used + np.arange(causes)
                used += causes
        self.size = used + self.dated
        late = [used] if self.dated else []
        self.columns = [
            np.concatenate([own, late, self.common[segment.run]]).astype(np.int64)
            for own, segment in zip(self.columns, problem.segments, strict=True)
        ]

    def _typical(self, data_summary: DataSummary) -> list[float]:
        sizes = [typical_of(own, data_summary) for own in self.effects]
        return [sizes[i][name] for i, name in self.free_effects]

    def pack(self) -> Array:
        """Return the vector (q,) of the current values of all free parameters and states."""
        states = [x_0[at] for x_0, at in zip(self.initial, self.state_places, strict=True)]
        causes = np.zeros(sum(map(len, self.common.values())))
        return np.concatenate([self.pack_shared(), *states, causes, [self.shift] if self.dated else []])

    def unpack(self, x: Array) -> tuple[Array, tuple[EffectInstance, ...], tuple[Array, ...], float]:
        """Return all parameters, the effects, the initial states per segment, and the shift of stamps [s].

        This is the inverse of :meth:`pack`.
        """
        theta, effects = self.unpack_shared(x)
        initial = []
        for x_0, at, columns in zip(self.initial, self.state_places, self.columns, strict=True):
            mine = x_0.copy()
            mine[at] = x[columns[self.shared : self.shared + len(at)]]
            initial.append(mine)
        return theta, effects, tuple(initial), float(x[-1]) if self.dated else 0.0

    def limits(self) -> tuple[Array, Array]:
        """Return the lower and the upper limits (q,) of the vector."""
        low, high = self.problem.edges(self.effects, self.free_effects)
        rest = np.full(self.size - self.shared, np.inf)
        if self.dated:
            rest[-1] = self.problem.stamps.reach * self.problem.dating
        return np.concatenate([low, -rest]), np.concatenate([high, rest])

    def residuals(self, x: Array) -> tuple[Residual, ...] | None:
        """Return the residuals at *x* (q,) with Jacobians, or None if a simulation diverges.

        Results of the last vectors are cached.
        """
        key = x.tobytes()
        if key not in self._recent:
            while len(self._recent) >= REMEMBERED:
                del self._recent[next(iter(self._recent))]
            self._recent[key] = self.predicted(x, sensitivities=True)
        return self._recent[key]

    def predicted(self, x: Array, *, sensitivities: bool) -> tuple[Residual, ...] | None:
        """Return the residuals at *x* (q,), or None if a simulation diverges.

        sensitivities : whether to calculate the Jacobians.
        """
        theta, effects, initial, shift = self.unpack(x)
        residuals = []
        for i, segment in enumerate(self.problem.segments):
            motion = self.simulators[i].predict(theta, effects, initial[i], segment, shift, sensitivities=sensitivities)
            if motion is None:
                return None
            causes = x[self.common[segment.run]]
            for name, signal in segment.signals.items():
                prediction, by = motion[name]
                error, fee = signal.values - prediction, 0.0
                if len(causes):
                    common = signal.common if len(signal.common) else np.zeros((len(error), len(causes)))
                    error, by = error - common @ causes, np.hstack([by, common]) if len(by) else by
                if effects:
                    left = EffectResidual(segment.run, name, signal.t, error, signal.values, self._level(name))
                    error, by, fee = judged_by(effects, left, by)
                if name in self.scales:
                    size = signal.std / self.scales[name]
                    error, by = error / size, by / size[:, None] if len(by) else by
                if name in self.scales and len(signal.alike):
                    error, by = _whitened(error, signal.alike), _whitened(by, signal.alike)
                residuals.append(Residual(i, name, signal.t, signal.values, prediction, error, by, signal.step, fee))
        return tuple(residuals)

    def _level(self, name: str) -> float:
        known = 1.0 if self.problem.summary is None else self.problem.summary.level.get(name, 1.0)
        return self.levels.get(name, known)

    def at(self, x: Array, noise: Mapping[str, NoiseModel]) -> Local | None:
        """Return cost, half the gradient and curvature at *x* (q,), or None if a simulation diverges.

        noise : noise model per signal.
        """
        residuals = self.residuals(x)
        if residuals is None:
            return None
        prior, weight = self.known()
        off = x - prior
        cost, gradient, curvature = float(weight @ off**2), weight * off, np.diag(weight)
        for residual in residuals:
            error, J, own = residual.judged, residual.jacobian, self.columns[residual.segment]
            if not (good := residual.known).all():
                error, J = error[good], J[good]
            terms = noise[residual.signal].terms(error)
            cost += float(terms.deviance.sum()) + residual.penalty
            gradient[own] -= J.T @ terms.slope
            curvature[np.ix_(own, own)] += J.T @ (terms.curvature[:, None] * J)
        return Local(cost, gradient, curvature)

    def concentrated(self, x: Array, floors: Mapping[str, float]) -> Local | None:
        """Return cost, half the gradient and curvature at *x* with optimal noise levels, or None if a simulation
        diverges.

        floors : smallest noise level per signal.
        """
        residuals = self.residuals(x)
        if residuals is None:
            return None
        sums, counts = sums_of(residuals)
        prior, weight = self.known()
        off = x - prior
        cost, gradient, curvature = float(weight @ off**2), weight * off, np.diag(weight)
        for name, total in sums.items():
            n, floor = counts[name], floors[name]
            cost += n * np.log((total + n * floor**2) / n / floor**2)
        for residual in residuals:
            n, floor = counts[residual.signal], floors[residual.signal]
            share = n / (sums[residual.signal] + n * floor**2)
            e, J, own = residual.judged, residual.jacobian, self.columns[residual.segment]
            if not (good := residual.known).all():
                e, J = e[good], J[good]
            cost += residual.penalty
            gradient[own] -= share * (J.T @ e)
            curvature[np.ix_(own, own)] += share * (J.T @ J)
        if not np.isfinite(cost) or not np.all(np.isfinite(gradient)):
            return None
        return Local(float(cost), gradient, curvature)

    def learn(self, x: Array, floors: Mapping[str, float]) -> None:
        """Update the disturbances from the residuals at *x*, and set the values of this objective to those at *x*."""
        theta, effects, initial, shift = self.unpack(x)
        craft = tuple(e for e in effects if not EFFECTS[e.slug].is_disturbance)
        plain = Objective(self.problem, theta, initial, craft, shift=shift, fixed_effects=True)
        residuals = plain.predicted(plain.pack(), sensitivities=False)
        if residuals is None:
            return
        sums, counts = sums_of(residuals)
        levels = {n: max(float(np.sqrt(sums[n] / max(counts[n], 1))), floors[n]) for n in sums}
        runs = self.problem.segments
        left = [
            EffectResidual(runs[r.segment].run, r.signal, r.t, r.judged, r.measured, levels[r.signal])
            for r in residuals
        ]
        self.effects = tuple(EFFECTS[e.slug].learn(e, left) if EFFECTS[e.slug].is_disturbance else e for e in effects)
        self._recent.clear()
        self.theta, self.initial, self.shift, self.levels = theta, initial, shift, levels

    def known(self) -> tuple[Array, Array]:
        """Return the expected value (q,) and the information (q,) of the prior of each element of the vector.

        The shift of stamps is expected to be zero, and so are the causes of common errors, with a standard deviation
        of one. A lagged input is expected to equal the input in force.
        """
        prior, weight = np.zeros(self.size), np.zeros(self.size)
        for segment, simulator, columns in zip(self.problem.segments, self.simulators, self.columns, strict=True):
            for name, at in zip(simulator.free_states, columns[self.shared :], strict=False):
                if name.startswith("lagged "):
                    channel = segment.input_names.index(name.removeprefix("lagged "))
                    own = segment.inputs[:, channel]
                    prior[at] = first_input(segment)[channel]
                    weight[at] = (LAGGED * max(float(np.ptp(own)), 1e-9)) ** -2
        for places in self.common.values():
            weight[places] = 1.0
        if self.dated:
            weight[-1] = self.problem.shift_std**-2
        return prior, weight

    def wide(self, residual: Residual) -> Array:
        """Return the Jacobian (n, q) of *residual* by the whole vector, with one row for each sample used."""
        good = residual.known
        table = np.zeros((int(good.sum()), self.size))
        table[:, self.columns[residual.segment]] = residual.jacobian[good]
        return table


def _scales(segments: Sequence[Segment]) -> dict[str, float]:
    """Return signal -> standard deviation of a typical sample, for signals whose samples all have one.

    The fit estimates the noise level of this sample. The others have the same noise times their own standard deviation
    over the typical one.
    """
    deviations: dict[str, list[Array]] = {}
    for segment in segments:
        for name, signal in segment.signals.items():
            deviations.setdefault(name, []).append(signal.std if len(signal.std) else np.zeros(1))
    joined = {name: np.concatenate(stds) for name, stds in deviations.items()}
    return {name: float(np.median(stds)) for name, stds in joined.items() if np.all(stds > 0.0)}


def _whitened(rows: Array, alike: Array) -> Array:
    """Return what is new in each of *rows* (n,) or (n, k), with the variance of the row itself.

    alike : correlation (n,) of the error of each row with that of the row before. The error is that of a process with
        a decaying memory.
    """
    if not len(rows):
        return rows
    before = np.concatenate([np.zeros_like(rows[:1]), rows[:-1]])
    own = alike if rows.ndim == 1 else alike[:, None]
    new: Array = (rows - own * before) / np.sqrt(1.0 - own**2)
    return new


def sums_of(residuals: Sequence[Residual]) -> tuple[dict[str, float], dict[str, int]]:
    """Return the sum of squared residuals and the number of samples used, each per signal."""
    sums: dict[str, float] = {}
    counts: dict[str, int] = {}
    for residual in residuals:
        good = residual.judged[residual.known]
        sums[residual.signal] = sums.get(residual.signal, 0.0) + float(good @ good)
        counts[residual.signal] = counts.get(residual.signal, 0) + len(good)
    return sums, counts


def judged_by(effects: Sequence[EffectInstance], left: EffectResidual, columns: Array) -> tuple[Array, Array, float]:
    """Return the residual (n,), its derivatives (n, k) and the penalty after subtracting all disturbances among
    *effects*.
    """
    fee = 0.0
    for own in effects:
        if EFFECTS[own.slug].is_disturbance:
            error, columns, more = EFFECTS[own.slug].judge(own, left, columns)
            left, fee = _with_error(left, error), fee + more
    return left.error, columns, fee


def _with_error(left: EffectResidual, error: Array) -> EffectResidual:
    return EffectResidual(left.run, left.signal, left.t, error, left.measured, left.level)


def first_input(segment: Segment) -> Array:
    """Return the inputs (m,) in force at the start of the segment."""
    row = int(np.searchsorted(segment.t_in, segment.start, side="right")) - 1
    first: Array = segment.inputs[max(row, 0)]
    return first


def information_of(residuals: Sequence[Residual], columns: Sequence[Array], noise: Mapping[str, NoiseModel]) -> Array:
    """Return the expected information (p, p) on parameters whose Jacobians are *columns* (n, p) each.

    The noise levels are unknown too. The information lost by estimating them, ``I_ps I_ss^-1 I_sp``, is subtracted.
    """
    p = columns[0].shape[1]
    total = np.zeros((p, p))
    for name, model in noise.items():
        mixed, own = np.zeros(p), 0.0
        for residual, J in zip(residuals, columns, strict=True):
            if residual.signal == name:
                by_truth, by_both, by_sigma = model.information(residual.judged[residual.known]).T
                total += J.T @ (by_truth[:, None] * J)
                mixed += J.T @ by_both
                own += float(by_sigma.sum())
        if own > 0.0:
            total -= np.outer(mixed, mixed) / own
    return total
