"""Free run: what a model of any kind makes of a run's input alone, only initial states fitted to what was measured.

:func:`validate` on runs the model has not seen; :func:`run_freely` on the segments of a method that has no simulation
of its own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import ExtendedModel
from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.identify.axis.form import ExplicitForm
from gcs_autotune.identify.axis.signals import first_names
from gcs_autotune.identify.axis.start import bounds_of
from gcs_autotune.identify.base_model import base_limits, data_summary_of
from gcs_autotune.identify.least_squares import Local, descend
from gcs_autotune.identify.preparation import prepare, prepare_as_recorded, prepare_form
from gcs_autotune.identify.problem import Problem
from gcs_autotune.identify.quick_fit import first_levels, first_states
from gcs_autotune.identify.result import AxisFit, Doubt, Trace
from gcs_autotune.identify.reweighting import NOISE_ROUNDS
from gcs_autotune.identify.segment import Segment
from gcs_autotune.identify.solution import solve
from gcs_autotune.identify.whiteness import autocorrelation, explained, whiteness
from gcs_autotune.models import CoupledModel, Simulator, SingleDof, explicit_parameters
from gcs_autotune.sname import DOFS, SIGNALS
from gcs_autotune.trial import Trial

__all__ = [
    "RUNS_AWAY",
    "ResidualStatistics",
    "Validation",
    "first_state",
    "fit_percent_of",
    "free_run",
    "join",
    "residual_statistics",
    "rms_of",
    "run_freely",
    "runs_or_doubt",
    "validate",
]

Array = NDArray[np.float64]

RUNS_AWAY = "runs-away"
"""Slug of the doubt that the model found cannot be simulated on its own runs."""

HORIZONS = (0.1, 0.35, 1.0)
"""Shares of a record the initial state is fitted to, one after the other: a craft that is unstable on its course
multiplies an error of its start many times, and the whole record then has no use for a rough one."""


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


@dataclass(frozen=True, slots=True, eq=False)
class Validation:
    """How well a model predicts: one trace and its statistics per run and signal."""

    traces: tuple[Trace, ...]
    statistics: tuple[ResidualStatistics, ...]

    @property
    def fit_percent(self) -> float:
        """100 (1 - rms/std), averaged over runs and signals; 0 is as good as the mean, below 0 worse."""
        return float(np.mean([s.fit_percent for s in self.statistics])) if self.statistics else math.nan

    def to_dict(self) -> dict[str, Any]:
        """Return the statistics as plain data."""
        rows = [
            {"run": t.run, "signal": t.signal, "unit": t.unit, "rms": s.rms, "fit_percent": s.fit_percent, "n": s.n}
            for t, s in zip(self.traces, self.statistics, strict=True)
        ]
        return {"fit_percent": self.fit_percent, "runs": rows}


def validate(model: Any, runs: Trial | Sequence[Trial]) -> Validation:
    """Simulate *runs* with *model*, only initial states fitted to them.

    Raises
    ------
    UsageError
        The model is of a kind that cannot be simulated on a run.
    NotInformative
        The model runs away on a run's input; and as the preparation of the runs.
    """
    if not isinstance(model, (SingleDof, CoupledModel, ExtendedModel)):
        raise UsageError(f"a {type(model).__name__} cannot be validated on runs")
    together = (runs,) if isinstance(runs, Trial) else tuple(runs)
    traces = [trace for run in together for trace in _on_trial(model, run)]
    return Validation(tuple(traces), tuple(residual_statistics(t) for t in traces))


def join(parts: Sequence[Validation]) -> Validation:
    """Return several validations as one."""
    return Validation(
        tuple(t for part in parts for t in part.traces), tuple(s for part in parts for s in part.statistics)
    )


def free_run(fit: AxisFit | SingleDof, trial: Trial) -> Trace:
    """Simulate *trial* with a model of one axis, only the initial state fitted to it; the position, or else velocity.

    The run should be one the model was not identified from. Stretches between holes follow each other.

    Raises
    ------
    NotInformative
        When the model runs away on this input; and as :func:`gcs_autotune.identify.preparation.prepare`.
    """
    model = fit if isinstance(fit, SingleDof) else fit.model
    return _joined(trial.name, [run_freely(model, record)[0] for record in prepare(trial, model.dof)])


def _on_trial(model: SingleDof | CoupledModel | ExtendedModel, trial: Trial) -> list[Trace]:
    """Return one trace per signal of *trial*, its stretches one after the other."""
    if isinstance(model, ExtendedModel):
        return _with_effects(model, trial)
    if isinstance(model, SingleDof):
        parts = [run_freely(model, r, tuple(r.signals)) for r in prepare(trial, model.dof)]
    else:
        parts = [run_freely(model, r) for r in prepare_form(trial, model.form)]
    names = dict.fromkeys(t.signal for traces in parts for t in traces)
    return [_joined(trial.name, [t for traces in parts for t in traces if t.signal == n]) for n in names]


def _joined(run: str, parts: Sequence[Trace]) -> Trace:
    t, measured, fitted, band = (
        np.concatenate([getattr(p, n) for p in parts]) for n in ("t", "measured", "fitted", "band")
    )
    return Trace(run, t, measured, fitted, band, parts[0].signal, parts[0].unit)


def _trace(run: str, signal: str, t: Array, measured: Array, fitted: Array) -> Trace:
    """Return a trace whose band is 1.96 times its rms residual."""
    rms = math.sqrt(float(np.mean((measured - fitted) ** 2)))
    return Trace(run, t, measured, fitted, np.full(len(t), 1.96 * rms), signal, SIGNALS[signal][0])


def runs_or_doubt(
    model: SingleDof | CoupledModel, segments: Sequence[Segment]
) -> tuple[tuple[Trace, ...], tuple[Doubt, ...]]:
    """Simulate all *segments*, or say in a doubt that the model found runs away on its own runs."""
    try:
        return tuple(t for s in segments for t in run_freely(model, s)), ()
    except NotInformative as error:
        cure = (
            "fly what shows the drag (coast down, steps at several speeds), give start values, leave terms out of the "
            "form, or use output-error"
        )
        return (), (Doubt(RUNS_AWAY, str(error), cure),)


def fit_percent_of(traces: Sequence[Trace]) -> float:
    """Return 100 (1 - rms/std) averaged over signals, each over all runs; NaN where nothing moves."""
    shares = explained((t.signal, t.measured, t.measured - t.fitted) for t in traces)
    return float(np.mean(list(shares.values()))) if shares else math.nan


def rms_of(traces: Sequence[Trace]) -> float:
    """Return the root mean square of what is left over in all *traces*; NaN without any."""
    return (
        math.sqrt(float(np.mean(np.concatenate([(t.measured - t.fitted) ** 2 for t in traces]))))
        if traces
        else math.nan
    )


def run_freely(model: SingleDof | CoupledModel, segment: Segment, names: Sequence[str] = ()) -> list[Trace]:
    """Simulate one stretch; one trace per signal.

    names : of the signals a model of one axis is compared with, its position (or else velocity) when none are given.

    Raises
    ------
    NotInformative
        The model runs away on this run's inputs.
    """
    if isinstance(model, SingleDof):
        return _axis(model, segment.only(tuple(names) or first_names([segment])))
    states = Simulator(model.form).states
    free = tuple(n for n in states if not n.startswith("lagged") and _observable(n, segment))
    simulator = Simulator(model.form, (), free)
    x_0 = first_state(segment, states)
    columns = [states.index(n) for n in free]
    scale = {n: max(float(np.std(s.values)), 1e-9) for n, s in segment.signals.items()}
    for share in HORIZONS:
        x_0 = _best_start(simulator, model.theta, x_0, columns, segment.until(share), scale)
    best = _simulated(simulator, model.theta, x_0, segment)
    if best is None:
        raise NotInformative(f"the model '{model.form.name}' diverges on run '{segment.run}': its drag destabilises it")
    signals = segment.signals
    return [_trace(segment.name, n, signals[n].t, signals[n].values, fitted) for n, (fitted, _) in best.items()]


def _axis(model: SingleDof, segment: Segment) -> list[Trace]:
    segments = [replace(segment, dating=0.0)]
    found = solve(
        Problem(ExplicitForm.of(segment.dof), segments, None, bounds_of(segments).limits, ()),
        np.array(explicit_parameters(model)),
        first_states(segments),
        levels=first_levels(segments),
        rounds=NOISE_ROUNDS if len(segment.signals) > 1 else 1,
        effort=None,
    )
    if found is None:
        raise NotInformative(f"the model diverges on run '{segment.run}': its drag destabilises it at these speeds")
    return [_trace(segment.name, r.signal, r.t, r.measured, r.predicted) for r in found.rests]


def _with_effects(model: ExtendedModel, trial: Trial) -> list[Trace]:
    form = model.base.form
    segments, _ = prepare_as_recorded([trial], form)
    problem = Problem(form, segments, data_summary_of(form, segments, model.base.values), base_limits(form), free=())
    found = problem.states(model.base.theta, model.effects, problem.first_states(segments))
    if found is None:
        raise NotInformative(f"the model '{form.name}' with its effects diverges on run '{trial.name}'")
    return [_trace(segments[r.segment].run, r.signal, r.t, r.measured, r.predicted) for r in found.rests]


def first_state(record: Segment, states: tuple[str, ...]) -> Array:
    """Guess the state at ``record.start`` from the first samples; 0 where nothing is measured."""
    guess = np.zeros(len(states))
    for i, name in enumerate(states):
        if name in record.signals:
            signal = record.signals[name]
            few = min(5, len(signal.values))
            line = np.polyfit(signal.t[:few] - record.start, signal.values[:few], 1 if few > 2 else 0)
            guess[i] = float(np.polyval(line, 0.0))
            continue
        own = next((d for d in DOFS.values() if d.velocity == name and d.position in record.signals), None)
        if own is not None and not any(n in record.signals for n in ("u", "v") if name in ("u", "v")):
            signal = record.signals[own.position]
            few = min(8, len(signal.values))
            if not own.along_ground:
                guess[i] = float(np.polyfit(signal.t[:few], signal.values[:few], 1)[0])
    return guess


def _best_start(
    simulator: Simulator,
    theta: Array,
    x_0: Array,
    columns: Sequence[int],
    record: Segment,
    scale: Mapping[str, float],
) -> Array:
    """Return *x_0* with its *columns* fitted to the record by damped least squares; as it was when it runs away."""

    def local(x: Array) -> Local | None:
        start = x_0.copy()
        start[columns] = x
        found = _simulated(simulator, theta, start, record)
        if found is None:
            return None
        error = np.concatenate([(record.signals[n].values - y) / scale[n] for n, (y, _) in found.items()])
        J = np.vstack([by / scale[n] for n, (_, by) in found.items()])
        return Local(float(error @ error), -(J.T @ error), J.T @ J)

    far = np.full(len(columns), np.inf)
    minimum = descend(local, x_0[columns], -far, far)
    if minimum is None:
        return x_0
    fitted = x_0.copy()
    fitted[columns] = minimum.x
    return fitted


def _simulated(
    simulator: Simulator, theta: Array, x_0: Array, record: Segment
) -> dict[str, tuple[Array, Array]] | None:
    """Return every signal of *record* at its own stamps with sensitivities; None when the motion runs away."""
    stamps = record.stamps
    found = simulator.run(theta, x_0, record.t_in, record.inputs, stamps)
    if found is None:
        return None
    X, S = found
    result = {}
    for name, signal in record.signals.items():
        at = np.searchsorted(stamps, signal.t)
        value, by = simulator.outputs(theta, X, S, name)
        result[name] = (value[at], by[at])
    return result


def _observable(state: str, record: Segment) -> bool:
    """Whether a signal of the record answers to this initial state at once."""
    if state in ("x", "y", "z", "phi", "theta", "psi"):
        return state in record.signals or (state == "psi" and ("x" in record.signals or "y" in record.signals))
    return True


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
