"""Fitting a model with effects by output error: every signal's noise level is part of the likelihood.

Minus twice the log-likelihood with the noise levels at their best is ``sum_s n_s log(RSS_s / n_s)``; its Gauss-Newton
step is that of least squares weighted with ``n_s / RSS_s``. Initial states are fitted per segment. Where changes of the
inputs are dated midway between two messages (decision 3), so is one shift of all their stamps, no farther than the
messages allow: a misdating is no effect of the craft's. What tells it from a delay is only that it is small.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import EFFECTS, DataSummary, EffectInstance, in_order
from gcs_autotune.identify.coupled.objective import Limits
from gcs_autotune.identify.coupled.start import ground_of
from gcs_autotune.identify.extended.fitted import Fitted, Rest
from gcs_autotune.identify.extended.task import Task, judged_by, typical_of
from gcs_autotune.identify.least_squares import descend
from gcs_autotune.identify.segment import Segment
from gcs_autotune.models.coupled import Form

__all__ = ["FLOOR", "Fitted", "Problem", "Rest", "judged_by", "typical_of"]

Array = NDArray[np.float64]

FLOOR = 1e-3
"""Least noise level, in shares of a signal's standard deviation: what is smaller is nobody's trouble on the water."""

ANGLES, TURN = ("phi", "theta", "psi"), 2.0
"""A heading that goes round and round is not measured the worse for it: its spread counts up to this [rad]."""

WAYS = {"x": ("u", "v"), "y": ("u", "v"), "z": ("w",)}
STRIDE = 20
"""Nor is a position for a long way gone: it counts up to what its velocities change it by in so many samples."""

TOLERANCE = 1e-8
"""Relative decrease of the cost that ends a search; the cost is some ten times the number of samples."""

LESSONS = 3
"""Rounds of fitting and learning where a disturbance is learnt from what is left over."""


class Problem:
    """Segments and a form, ready to fit with any effects.

    Parameters
    ----------
    free : base parameters to fit (all free ones when None). limits : of the base's parameters.
    held : numbers of effects that stay as they are: (slug, place, name).
    """

    def __init__(
        self,
        form: Form,
        segments: Sequence[Segment],
        scene: DataSummary,
        limits: Limits,
        free: Sequence[str] | None = None,
        held: Collection[tuple[str, str, str]] = (),
    ) -> None:
        self.form = form
        self.segments = tuple(segments)
        self.scene = scene
        self.limits = limits
        self.free = tuple(form.free if free is None else free)
        self.held = frozenset(held)
        self.floors = {n: FLOOR * min(s, _way(n, scene)) for n, s in scene.spread.items()}
        self.dating = max((s.dating for s in segments), default=0.0)

    def on(self, segments: Sequence[Segment], free: Sequence[str] | None = None) -> Problem:
        """Return the same problem on other segments (or with other base parameters free)."""
        return Problem(self.form, segments, self.scene, self.limits, self.free if free is None else free, self.held)

    def holding(self, free: Sequence[str], held: Collection[tuple[str, str, str]]) -> Problem:
        """Return the same problem with the base parameters *free* only, and the numbers *held* of effects known."""
        return Problem(self.form, self.segments, self.scene, self.limits, free, held)

    def edges(self, effects: Sequence[EffectInstance], free_effects: Sequence[tuple[int, str]]) -> tuple[Array, Array]:
        """Return the limits (f,) of the base parameters fitted, then of the effects' parameters *free_effects*."""
        low, high = self.limits.of(self.free)
        own = [EFFECTS[effects[i].slug].bounds(effects[i].place, self.scene) for i, _ in free_effects]
        pairs = [e.get(n, (-np.inf, np.inf)) for e, (_, n) in zip(own, free_effects, strict=True)]
        return np.concatenate([low, [p[0] for p in pairs]]), np.concatenate([high, [p[1] for p in pairs]])

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
        """Fit from these values on; None when the motion runs away at the start already."""
        task = Task(self, theta, in_order(effects), tuple(initial), fixed_effects, shift)
        low, high = task.limits()
        x = np.clip(task.pack(), low, high)
        learns = learn and any(EFFECTS[e.slug].is_disturbance for e in task.effects)
        if learns:
            task.learn(x)
        minimum = descend(task.local, x, low, high, trials=trials, tolerance=TOLERANCE)
        if minimum is None:
            return None
        if learns:
            for _ in range(LESSONS if trials > 1 else 0):
                task.learn(minimum.x)
                again = descend(task.local, minimum.x, low, high, trials=trials, tolerance=TOLERANCE)
                if again is None:
                    break
                minimum = again
        return task.fitted(minimum.x, minimum.converged)

    def moved(self, fitted: Fitted, by: Array) -> tuple[Array, tuple[EffectInstance, ...], tuple[Array, ...]]:
        """Return parameters, effects and initial states of a fit moved *by* (q,), in the order of its Jacobian."""
        task = Task(self, fitted.theta, fitted.effects, fitted.initial, False, fitted.shift)
        low, high = task.limits()
        theta, effects, initial, _ = task.unpack(np.clip(task.pack() + by, low, high))
        return theta, effects, tuple(initial)

    def first_states(self, segments: Sequence[Segment]) -> tuple[Array, ...]:
        """Return initial states of any segments, read off their first samples."""
        return ground_of(self.form, segments).initial

    def states(
        self, theta: Array, effects: Sequence[EffectInstance], initial: Sequence[Array], shift: float = 0.0
    ) -> Fitted | None:
        """Fit the initial states (and the shift of input stamps) only: how a given model predicts these segments."""
        alone = self.on(self.segments, free=())
        return alone.fit(theta, effects, initial, fixed_effects=True, learn=False, trials=15, shift=shift)


def _way(signal: str, scene: DataSummary) -> float:
    """Return up to where the spread of a signal counts."""
    if signal in ANGLES:
        return TURN
    speed = float(np.hypot.reduce([scene.spread.get(v, 0.0) for v in WAYS.get(signal, ())]))
    return STRIDE * scene.interval * speed if speed > 0.0 else np.inf
