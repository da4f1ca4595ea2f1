"""Free run: what a model makes of a record's input alone, and how far that is from what was measured."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.axis.signals import first_names
from gcs_autotune.identify.axis.start import bounds_of
from gcs_autotune.identify.first_look import first_levels, first_states
from gcs_autotune.identify.preparation import prepare
from gcs_autotune.identify.problem import Problem
from gcs_autotune.identify.result import AxisFit, Trace
from gcs_autotune.identify.reweighting import NOISE_ROUNDS
from gcs_autotune.identify.segment import Segment
from gcs_autotune.identify.simulators import ExplicitForm
from gcs_autotune.identify.solution import Solution, solve
from gcs_autotune.identify.whiteness import autocorrelation, whiteness
from gcs_autotune.models import SingleDof
from gcs_autotune.models.simulation import explicit_parameters
from gcs_autotune.sname import SIGNALS
from gcs_autotune.trial import Trial

__all__ = ["ResidualStatistics", "free_run", "free_runs", "residual_statistics", "run_freely", "run_signals"]


@dataclass(frozen=True, slots=True)
class ResidualStatistics:
    """Of measured minus simulated: count, mean, rms, mean absolute value (Miskovic2010, eq. (7.3)), largest magnitude,
    ``fit_percent`` as in :class:`Fit`, lag-1 autocorrelation, and the probability that white noise looks so.
    """

    n: int
    mean: float
    rms: float
    mean_absolute: float
    worst: float
    fit_percent: float
    lag_one: float
    whiteness_p: float


def free_run(fit: AxisFit | SingleDof, trial: Trial) -> Trace:
    """Simulate *trial* with an identified model, only the initial state fitted to it; the position, or else velocity.

    The run should be one the model was not identified from. Stretches between holes follow each other.

    Raises
    ------
    NotInformative
        When the model runs away on this input; and as :func:`gcs_autotune.identify.preparation.prepare`.
    """
    model = fit.model if isinstance(fit, AxisFit) else fit
    return _joined(trial.name, [run_freely(model, record) for record in prepare(trial, model.dof)])


def free_runs(model: SingleDof, trial: Trial) -> list[Trace]:
    """Return one trace per signal measured, position first; otherwise as :func:`free_run`."""
    records = prepare(trial, model.dof)
    parts = [run_signals(model, record, tuple(record.signals)) for record in records]
    names = dict.fromkeys(t.signal for traces in parts for t in traces)
    return [_joined(trial.name, [t for traces in parts for t in traces if t.signal == n]) for n in names]


def _joined(run: str, parts: Sequence[Trace]) -> Trace:
    return Trace(
        run,
        np.concatenate([p.t for p in parts]),
        np.concatenate([p.measured for p in parts]),
        np.concatenate([p.fitted for p in parts]),
        np.concatenate([p.band for p in parts]),
        parts[0].signal,
        parts[0].unit,
    )


def run_freely(model: SingleDof, record: Segment) -> Trace:
    """Simulate one stretch; the position, or else velocity."""
    return run_signals(model, record, first_names([record]))[0]


def run_signals(model: SingleDof, record: Segment, names: Sequence[str]) -> list[Trace]:
    """Simulate one stretch; one trace per signal of *names*, its band 1.96 times the rms residual."""
    found = _with_initial_state(model, record, tuple(names))
    return [
        Trace(
            record.name,
            r.t,
            r.measured,
            r.predicted,
            np.full(len(r.t), 1.96 * found.rms(r.signal)),
            r.signal,
            SIGNALS[r.signal][0],
        )
        for r in found.residuals
    ]


def _with_initial_state(model: SingleDof, record: Segment, names: tuple[str, ...]) -> Solution:
    segments = [replace(record.only(names), dating=0.0)]
    problem = Problem(ExplicitForm.of(record.dof), segments, None, bounds_of(segments).limits, ())
    found = solve(
        problem,
        np.array(explicit_parameters(model)),
        first_states(segments),
        levels=first_levels(segments),
        rounds=NOISE_ROUNDS if len(names) > 1 else 1,
        effort=None,
    )
    if found is None:
        raise NotInformative(f"the model runs away on run '{record.run}': its drag destabilises it at these speeds")
    return found


def residual_statistics(trace: Trace) -> ResidualStatistics:
    """Return the statistics of a trace's residuals."""
    error = trace.measured - trace.fitted
    rms = math.sqrt(float(np.mean(error**2)))
    swing = float(np.std(trace.measured))
    return ResidualStatistics(
        n=len(error),
        mean=float(error.mean()),
        rms=rms,
        mean_absolute=float(np.mean(np.abs(error))),
        worst=float(np.max(np.abs(error))),
        fit_percent=100.0 * (1.0 - rms / swing) if swing > 0.0 else 0.0,
        lag_one=float(autocorrelation(error, 1)[0]),
        whiteness_p=whiteness(error),
    )
