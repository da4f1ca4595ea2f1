"""The base model: the plain simulation everything else is measured against."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import EffectInstance
from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.coupled.limits import physical
from gcs_autotune.identify.coupled.objective import Limits
from gcs_autotune.identify.coupled.start import ground_of
from gcs_autotune.identify.extended.fitting import Fitted, Problem
from gcs_autotune.identify.extended.stretches import Stretch, scene_of
from gcs_autotune.models.coupled import CoupledModel, Form
from gcs_autotune.models.coupled.derivatives import inertia_of

__all__ = ["base_limits", "fit_base", "given_base"]

Array = NDArray[np.float64]

STEERED_BY_ANGLE = "delta"


def base_limits(form: Form) -> Limits:
    """Return the limits of the base's parameters: inertia positive, drag that damps; either sign behind a rudder."""
    limits = physical(form)
    rows = {force for force, _ in form.inputs.get(STEERED_BY_ANGLE, ())}
    low = {n: v for n, v in limits.low.items() if n[0] not in rows}
    high = {n: v for n, v in limits.high.items() if n[0] not in rows}
    for name in list(high):
        if name.endswith("dot") and inertia_of(name) is not None:
            high[name] = -1e-9
    return Limits(low, high)


def fit_base(form: Form, stretches: Sequence[Stretch], *, trials: int = 30) -> tuple[Problem, Fitted]:
    """Fit *form* from several starts, *trials* steps each, and return the problem and the best fit.

    Raises
    ------
    NotInformative
        From no start can the base model follow these runs.
    """
    limits = base_limits(form)
    ground = ground_of(form, [s.record for s in stretches])
    problem = Problem(form, stretches, scene_of(form, stretches), limits)
    best: Fitted | None = None
    with np.errstate(over="ignore", invalid="ignore"):  # a start may run away; what it leads to is judged by its cost
        starts = list(ground.starts(limits))
    for theta in starts:
        low, high = limits.of(form.parameters)
        found = problem.fit(np.clip(theta, low, high), (), ground.initial, trials=trials)
        if found is not None and (best is None or found.cost < best.cost):
            best = found
    if best is None:
        raise NotInformative(
            f"no simulation of '{form.title}' follows these runs: check columns and units, or give --dof with less"
        )
    return _known(form, stretches, limits, best), best


def given_base(
    model: CoupledModel, effects: Sequence[EffectInstance], stretches: Sequence[Stretch]
) -> tuple[Problem, Fitted | None, Fitted]:
    """Return the problem, the fit of a model taken as it is (initial states only), and the same model refitted.

    The model as it is None when it runs away on these runs. Refitted from its own numbers and, where these may be
    wrong, from the starts of any fit: a number far off must not hold the others in a valley of their own.

    Raises
    ------
    NotInformative
        From no start can the model follow these runs.
    """
    form, limits = model.form, base_limits(model.form)
    problem = Problem(form, stretches, scene_of(form, stretches, model.values), limits)
    ground = ground_of(form, [s.record for s in stretches])
    low, high = limits.of(form.parameters)
    with np.errstate(over="ignore", invalid="ignore"):
        given = problem.states(model.theta, effects, ground.initial)
        begins = [(model.theta, given.initial if given else ground.initial, given.shift if given else 0.0)]
        begins += [(np.clip(theta, low, high), ground.initial, 0.0) for theta in ground.starts(limits)]
        fits = [problem.fit(theta, effects, initial, shift=shift) for theta, initial, shift in begins]
    best = min((fit for fit in fits if fit is not None), key=lambda fit: fit.cost, default=None)
    if best is None:
        raise NotInformative(
            f"the model '{form.title}' runs away on these runs, whatever its numbers: is it about this craft, in these "
            "units?"
        )
    return _known(form, stretches, limits, best), given, best


def _known(form: Form, stretches: Sequence[Stretch], limits: Limits, fitted: Fitted) -> Problem:
    """Return the problem with the base's values in the scene."""
    values = dict(zip(form.parameters, fitted.theta.tolist(), strict=True))
    return Problem(form, stretches, scene_of(form, stretches, values), limits)
