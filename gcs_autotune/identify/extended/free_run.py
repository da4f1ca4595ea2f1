"""A model with effects let loose on a run's inputs, only the initial states fitted to what was measured."""

from __future__ import annotations

import numpy as np

from gcs_autotune.effects import ExtendedModel
from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.base_model import base_limits, scene_of
from gcs_autotune.identify.preparation import prepare_as_recorded
from gcs_autotune.identify.problem import Problem
from gcs_autotune.identify.result import Trace
from gcs_autotune.sname import SIGNALS
from gcs_autotune.trial import Trial

__all__ = ["free_runs"]


def free_runs(model: ExtendedModel, trial: Trial) -> list[Trace]:
    """Return one trace per signal of every segment of *trial*; the bands are 1.96 times the rms residual.

    Raises
    ------
    NotInformative
        The model runs away on this run's inputs; and as :func:`.segments.prepare_as_recorded`.
    """
    form = model.base.form
    segments, _ = prepare_as_recorded([trial], form)
    problem = Problem(form, segments, scene_of(form, segments, model.base.values), base_limits(form), free=())
    found = problem.states(model.base.theta, model.effects, problem.first_states(segments))
    if found is None:
        raise NotInformative(f"the model '{form.name}' with its effects runs away on run '{trial.name}'")
    traces = []
    for rest in found.rests:
        rms = float(np.sqrt(np.mean((rest.measured - rest.predicted) ** 2)))
        band = np.full(len(rest.t), 1.96 * rms)
        run = segments[rest.segment].run
        unit = SIGNALS[rest.signal][0]
        traces.append(Trace(run, rest.t, rest.measured, rest.predicted, band, rest.signal, unit))
    return traces
