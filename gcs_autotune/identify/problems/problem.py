"""Define a fit: segments and a form, to be fitted with any effects.

In :meth:`Problem.fit` every noise level is optimal at every step (:meth:`.Objective.concentrated`). The costs of models
with different effects can therefore be compared. Initial states are fitted per segment.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import EFFECTS, DataSummary, EffectInstance, in_order
from gcs_autotune.identify.problems.fitted import Fitted
from gcs_autotune.identify.problems.free_numbers import StampedProblem
from gcs_autotune.identify.problems.initial_guess import initial_guess_of
from gcs_autotune.identify.problems.least_squares import Rules, descend
from gcs_autotune.identify.problems.likelihood import Objective, sums_of
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.kept_results import recalled

__all__ = ["Problem"]

Array = NDArray[np.float64]

FLOOR = 1e-3
"""Smallest noise level, relative to a signal's standard deviation.

Project choice: smaller errors do not matter in practice.
"""

ANGLES, TURN = ("phi", "theta", "psi"), 2.0
"""Names of the angles, and the largest spread of an angle [rad] that is used for the noise floor. Project choice.

The spread is limited because an angle that turns several times is not measured less accurately.
"""

WAYS = {"x": ("u", "v"), "y": ("u", "v"), "z": ("w",)}
STRIDE = 20
"""Number of samples over which a position's change counts as its spread for the noise floor. Project choice.

The whole distance covered would be too large a spread.
"""

TOLERANCE = 1e-8
"""Relative decrease of the cost that ends a search. The cost is about ten times the number of samples.

Project choice.
"""

LESSONS = 3
"""Number of rounds of fitting and updating, if a disturbance is learnt from the residuals. Project choice."""


class Problem(StampedProblem):
    """Segments and a form, to be fitted with any effects.

    Parameters are those of :class:`.StampedProblem`.
    """

    @cached_property
    def motion(self) -> Mapping[str, float]:
        """Name of the signal -> spread that is used for its noise floor."""
        spread = {} if self.summary is None else self.summary.spread
        return {name: min(s, _way(name, self.data_summary)) for name, s in spread.items()}

    @cached_property
    def floors(self) -> Mapping[str, float]:
        """Name of the signal -> smallest noise level."""
        return {name: FLOOR * s for name, s in self.motion.items()}

    def on(self, segments: Sequence[Segment], free: Sequence[str] | None = None) -> Problem:
        """Return the same problem on other *segments*, or with only the base parameters *free* fitted."""
        chosen = self.free if free is None else free
        return Problem(self.form, segments, self.summary, self.limits, chosen, self.held, self.stamps)

    def holding(self, free: Sequence[str], held: Collection[tuple[str, str, str]]) -> Problem:
        """Return the same problem with only the base parameters *free*.

        held : parameters of effects that are fixed.
        """
        return Problem(self.form, self.segments, self.summary, self.limits, free, held, self.stamps)

    def fit(
        self,
        theta: Array,
        effects: Sequence[EffectInstance],
        initial: Sequence[Array],
        *,
        trials: int = 30,
        fixed_effects: bool = False,
        learn: bool = True,
        shift: float = 0.0,
    ) -> Fitted | None:
        """Return the fit from these start values, or None if the motion diverges at them.

        Within :func:`.keeping` the result of a known fit is reused and only evaluated.
        """
        effects = in_order(effects)

        def calculate() -> Fitted | None:
            return self._fit(theta, effects, initial, trials, fixed_effects=fixed_effects, learn=learn, shift=shift)

        if trials == 0:
            return calculate()
        return recalled(
            lambda: ("fit", self, theta, effects, initial, trials, fixed_effects, learn, shift),
            calculate,
            _plain_fit,
            partial(self._refit, fixed_effects=fixed_effects),
        )

    def _refit(self, kept: dict[str, Any] | None, *, fixed_effects: bool) -> Fitted | None:
        """Return a fit from the cached data of :func:`_plain_fit`."""
        if kept is None:
            return None
        effects = in_order([EffectInstance(**e) for e in kept["effects"]])
        initial = [np.array(x_0, dtype=np.float64) for x_0 in kept["initial"]]
        theta, shift = np.array(kept["theta"], dtype=np.float64), float(kept["shift"])
        objective = Objective(self, theta, initial, effects, shift=shift, fixed_effects=fixed_effects)
        objective.levels = dict(kept["learnt"])
        return _fitted(self, objective, objective.pack(), bool(kept["converged"]))

    def _fit(
        self,
        theta: Array,
        effects: Sequence[EffectInstance],
        initial: Sequence[Array],
        trials: int,
        *,
        fixed_effects: bool,
        learn: bool,
        shift: float,
    ) -> Fitted | None:
        objective = Objective(self, theta, initial, effects, shift=shift, fixed_effects=fixed_effects)
        low, high = objective.limits()
        x = np.clip(objective.pack(), low, high)
        learns = learn and any(EFFECTS[e.slug].is_disturbance for e in objective.effects)
        if learns:
            objective.learn(x, self.floors)
        cost = partial(objective.concentrated, floors=self.floors)
        minimum = descend(cost, x, low, high, trials=trials, rules=Rules(TOLERANCE))
        if minimum is None:
            return None
        if learns:
            for _ in range(LESSONS if trials > 1 else 0):
                objective.learn(minimum.x, self.floors)
                again = descend(cost, minimum.x, low, high, trials=trials, rules=Rules(TOLERANCE))
                if again is None:
                    break
                minimum = again
        return _fitted(self, objective, minimum.x, minimum.converged)

    def moved(self, fitted: Fitted, by: Array) -> tuple[Array, tuple[EffectInstance, ...], tuple[Array, ...]]:
        """Return the parameters, effects and initial states of *fitted*, changed by *by* (q,).

        The order of *by* is that of the columns of the Jacobian.
        """
        objective = Objective(self, fitted.theta, fitted.initial, fitted.effects, shift=fitted.shift)
        theta, effects, initial, _ = objective.unpack(np.clip(objective.pack() + by, *objective.limits()))
        return theta, effects, initial

    def first_states(self, segments: Sequence[Segment]) -> tuple[Array, ...]:
        """Return the initial states (n,) of each of *segments*, estimated from the first samples."""
        return initial_guess_of(self.form, segments).initial

    def states(
        self, theta: Array, effects: Sequence[EffectInstance], initial: Sequence[Array], shift: float = 0.0
    ) -> Fitted | None:
        """Return a fit of only the initial states and the shift of input stamps, or None if the motion diverges.

        The result shows how well a model predicts these segments.
        """
        alone = self.on(self.segments, free=())
        return alone.fit(theta, effects, initial, fixed_effects=True, learn=False, trials=15, shift=shift)


def _fitted(problem: Problem, objective: Objective, x: Array, converged: bool) -> Fitted | None:
    """Return the fit with the parameters *x*, at which the search ended."""
    residuals = objective.residuals(x)
    if residuals is None:
        return None
    sums, counts = sums_of(residuals)
    floors = problem.floors
    levels = {n: float(np.sqrt(s / max(counts[n], 1) + floors[n] ** 2)) for n, s in sums.items()}
    prior, weight = objective.known()
    cost = sum(r.penalty for r in residuals) + float(weight @ (x - prior) ** 2)
    cost += sum(counts[n] * np.log(levels[n] ** 2 / floors[n] ** 2) for n in sums)
    theta, effects, initial, shift = objective.unpack(x)
    return Fitted(
        form=problem.form,
        theta=theta,
        effects=effects,
        free=problem.free,
        free_effects=objective.free_effects,
        initial=initial,
        cost=float(cost),
        levels=levels,
        rests=tuple(replace(r, jacobian=np.zeros((len(r.t), 0))) for r in residuals),
        jacobian=np.vstack([objective.wide(r) / levels[r.signal] for r in residuals]),
        samples=sum(counts.values()),
        converged=converged,
        shift=shift,
        shift_std=problem.shift_std,
        prior=weight,
        learnt=objective.levels,
    )


def _plain_fit(fitted: Fitted | None) -> dict[str, Any] | None:
    """Return the parameters of a fit as data for JSON.

    All other results can be calculated from them.
    """
    if fitted is None:
        return None
    return {
        "theta": fitted.theta.tolist(),
        "effects": [e.to_dict() for e in fitted.effects],
        "initial": [x_0.tolist() for x_0 in fitted.initial],
        "shift": fitted.shift,
        "converged": fitted.converged,
        "learnt": dict(fitted.learnt),
    }


def _way(signal: str, data_summary: DataSummary) -> float:
    """Return the largest spread of a signal that is used for its noise floor."""
    if signal in ANGLES:
        return TURN
    speed = float(np.hypot.reduce([data_summary.spread.get(v, 0.0) for v in WAYS.get(signal, ())]))
    return STRIDE * data_summary.interval * speed if speed > 0.0 else np.inf
