"""A model with effects let loose on a run's inputs, only the initial states fitted to what was measured."""

from __future__ import annotations

import numpy as np

from gcs_autotune.effects import ExtendedModel
from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.extended.base import base_limits
from gcs_autotune.identify.extended.fitting import Problem
from gcs_autotune.identify.extended.stretches import scene_of, stretches_of
from gcs_autotune.identify.result import Trace
from gcs_autotune.sname import SIGNALS
from gcs_autotune.trial import Trial

__all__ = ["free_runs"]


def free_runs(model: ExtendedModel, trial: Trial) -> list[Trace]:
    """Return one trace per signal of every stretch of *trial*; the bands are 1.96 times the rms residual.

    Raises
    ------
    NotInformative
        The model runs away on this run's inputs; and as :func:`.stretches.stretches_of`.
    """
    form = model.base.form
    stretches, _ = stretches_of([trial], form)
    problem = Problem(form, stretches, scene_of(form, stretches, model.base.values), base_limits(form), free=())
    found = problem.states(model.base.theta, model.effects, problem.first_states(stretches))
    if found is None:
        raise NotInformative(f"the model '{form.name}' with its effects runs away on run '{trial.name}'")
    traces = []
    for rest in found.rests:
        rms = float(np.sqrt(np.mean((rest.measured - rest.predicted) ** 2)))
        band = np.full(len(rest.t), 1.96 * rms)
        run = stretches[rest.stretch].record.run
        unit = SIGNALS[rest.signal][0]
        traces.append(Trace(run, rest.t, rest.measured, rest.predicted, band, rest.signal, unit))
    return traces
