"""Would a law without a name do better in a cause's place?

A cause may bend the model the right way by the wrong law: where speeds hardly vary, drag that goes with the cube of
speed is nearly one that goes with its square. So a named law has to hold its ground against one of the same kind that
is in no book; where that is likelier by odds of twenty to one, the name is a hypothesis.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from gcs_autotune.diagnose.judging import ALIKE
from gcs_autotune.effects import EffectInstance
from gcs_autotune.identify.extended.fitting import Fitted, Problem
from gcs_autotune.models.coupled import Form
from gcs_autotune.sname import DOFS

__all__ = ["outdone_by"]

TRIALS = 30


def _cubic_drag(own: EffectInstance, form: Form) -> Sequence[str]:
    dof = DOFS[own.place]
    return (dof.force + "_" + 3 * dof.velocity,)


def _cubic_thrust(own: EffectInstance, form: Form) -> Sequence[str]:
    return [force + "_" + 3 * own.place for force, _ in form.inputs[own.place]]


LAWS: Mapping[str, tuple[Callable[[EffectInstance, Form], Sequence[str]], str]] = {
    "quadratic-drag": (_cubic_drag, "drag that grows with the cube of speed does better than with its square"),
    "quadratic-actuator": (_cubic_thrust, "thrust that grows with the cube of the command does better than its square"),
}
"""Slug -> the derivatives that would stand in its place, and in words what it would mean if they did better."""


def outdone_by(problem: Problem, fitted: Fitted) -> tuple[str, ...]:
    """Return, in words, the laws without a name that are likelier than a cause of *fitted* they stand in for."""
    found = []
    for own in fitted.effects:
        if own.slug not in LAWS:
            continue
        law, words = LAWS[own.slug]
        names = [n for n in law(own, fitted.form) if n not in fitted.form.parameters]
        rest = tuple(e for e in fitted.effects if e is not own)
        form = fitted.form.freeing(*names)
        other = Problem(form, problem.segments, problem.scene, problem.limits, (*problem.free, *names))
        values = dict(zip(fitted.form.parameters, fitted.theta.tolist(), strict=True))
        start = np.array([values.get(n, 0.0) for n in form.parameters])
        fit = other.fit(start, rest, fitted.initial, trials=TRIALS, shift=fitted.shift) if names else None
        if fit is not None and fit.cost < fitted.cost - ALIKE:
            found.append(words)
    return tuple(found)
