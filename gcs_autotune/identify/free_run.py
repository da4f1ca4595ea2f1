"""Free run: simulate a model of any kind from the inputs of a run.

Only the initial states are fitted to the measurements. :func:`validate` is for runs that the model was not fitted to.
:func:`run_freely` is for the segments of a method without its own simulation.
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
from gcs_autotune.identify.axis.form import ExplicitForm, as_coupled
from gcs_autotune.identify.axis.signals import first_names
from gcs_autotune.identify.axis.start import bounds_of
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.problems.base_model import base_limits, data_summary_of
from gcs_autotune.identify.problems.least_squares import Local, descend
from gcs_autotune.identify.problems.problem import Problem
from gcs_autotune.identify.problems.quick_fit import first_levels, first_states
from gcs_autotune.identify.problems.reweighting import NOISE_ROUNDS
from gcs_autotune.identify.problems.solution import solve
from gcs_autotune.identify.result import AxisFit, Trace
from gcs_autotune.identify.signals.preparation import prepare, prepare_as_recorded, prepare_form, since_release
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.identify.signals.whiteness import autocorrelation, explained, whiteness
from gcs_autotune.models import CoupledModel, Simulator, SingleDof, explicit_parameters
from gcs_autotune.notebook import Display, Displayed, Table
from gcs_autotune.rounding import HALF_WIDTH, format_number
from gcs_autotune.sname import DOFS, SIGNALS
from gcs_autotune.trial import Trial

__all__ = [
    "RUNS_AWAY",
    "ResidualStatistics",
    "Validation",
    "first_state",
    "fit_percent_of",
    "free_run",
    "residual_statistics",
    "rms_of",
    "run_freely",
    "runs_or_doubt",
    "validate",
]

Array = NDArray[np.float64]

RUNS_AWAY = "runs-away"
"""Slug of the doubt that a model diverges in a simulation of its own runs."""

HORIZONS = (0.1, 0.35, 1.0)
"""Fractions of a record to which the initial state is fitted, one after the other. Project choice.

In an unstable craft an error of the initial state grows. A rough initial state therefore cannot be fitted to the whole
record at once.
"""


@dataclass(frozen=True, slots=True)
class ResidualStatistics(Displayed):
    """Statistics of the residuals (measured minus simulated) of one signal in one run.

    - ``n``: number of samples.
    - ``mean``, ``rms``: mean and root mean square.
    - ``mean_absolute``: mean absolute value (Miskovic2010, eq. (7.3)).
    - ``worst``: largest magnitude.
    - ``fit_percent``: 100 (1 - rms/std), as in :class:`Fit`.
    - ``lag_one``: autocorrelation at lag 1.
    - ``whiteness_p``: probability that white noise is at least this coloured.
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
class Validation(Displayed):
    """Prediction quality of a model: one trace and its statistics per run and signal. ``print`` shows a table of it."""

    traces: tuple[Trace, ...]
    statistics: tuple[ResidualStatistics, ...]

    @classmethod
    def joined(cls, parts: Sequence[Validation]) -> Validation:
        """Return the traces and statistics of several validations as one validation."""
        return cls(tuple(t for part in parts for t in part.traces), tuple(s for part in parts for s in part.statistics))

    @property
    def fit_percent(self) -> float:
        """Average of 100 (1 - rms/std) over runs and signals, or NaN without any.

        0 is as good as the mean value, and negative is worse than the mean value.
        """
        return float(np.mean([s.fit_percent for s in self.statistics])) if self.statistics else math.nan

    def _display(self) -> Display:
        rows = (
            (t.run, t.signal, f"{format_number(s.rms, 3)} {t.unit}", f"{s.fit_percent:.1f} %", str(s.n))
            for t, s in zip(self.traces, self.statistics, strict=True)
        )
        heads = ("run", "signal", "residual (rms)", "fit", "samples")
        return Display(f"simulation of runs, fit {self.fit_percent:.1f} % on average", (Table(heads, tuple(rows)),))

    def to_dict(self) -> dict[str, Any]:
        """Return the fit percentages, and the rms residual per run and signal, as data for JSON."""
        rows = [
            {"run": t.run, "signal": t.signal, "unit": t.unit, "rms": s.rms, "fit_percent": s.fit_percent, "n": s.n}
            for t, s in zip(self.traces, self.statistics, strict=True)
        ]
        return {"fit_percent": self.fit_percent, "runs": rows}


def validate(model: Any, runs: Trial | Sequence[Trial]) -> Validation:
    """Simulate *runs* with *model*, and return its traces and statistics. Only the initial states are fitted.

    Raises
    ------
    UsageError
        This kind of model cannot be simulated on a run.
    NotInformative
        The model diverges on the inputs of a run, or a run cannot be prepared.
    """
    if not isinstance(model, (SingleDof, CoupledModel, ExtendedModel)):
        raise UsageError(f"a {type(model).__name__} cannot be validated on runs. Use output-error")
    together = (runs,) if isinstance(runs, Trial) else tuple(runs)
    traces = [trace for run in together for trace in _on_trial(model, run)]
    return Validation(tuple(traces), tuple(residual_statistics(t) for t in traces))


def free_run(fit: AxisFit | SingleDof, trial: Trial) -> Trace:
    """Simulate *trial* with a model of one axis, and return the trace of its position or, if not measured, its
    velocity.

    Only the initial state is fitted. Use a run that the model was not identified from. The stretches between gaps are
    joined into one trace.

    Raises
    ------
    NotInformative
        The model diverges on this input, or :func:`gcs_autotune.identify.signals.preparation.prepare` raised the error.
    """
    model = fit if isinstance(fit, SingleDof) else fit.model
    return _joined(trial.name, [run_freely(model, record)[0] for record in _prepared(trial, model)])


def _prepared(trial: Trial, model: SingleDof) -> list[Segment]:
    """Return the segments of *trial*. A model from a relay does not show how strongly the thrusters held the craft."""
    return since_release([trial], prepare(trial, model.dof))


def _on_trial(model: SingleDof | CoupledModel | ExtendedModel, trial: Trial) -> list[Trace]:
    """Return one trace per signal of *trial*, with its stretches joined."""
    if isinstance(model, ExtendedModel):
        return _with_effects(model, trial)
    if isinstance(model, SingleDof):
        parts = [run_freely(model, r, tuple(r.signals)) for r in _prepared(trial, model)]
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
    """Return a trace with a 95 % band of 1.96 times the rms residual."""
    rms = math.sqrt(float(np.mean((measured - fitted) ** 2)))
    return Trace(run, t, measured, fitted, np.full(len(t), HALF_WIDTH * rms), signal, SIGNALS[signal][0])


def runs_or_doubt(
    model: SingleDof | CoupledModel, segments: Sequence[Segment]
) -> tuple[tuple[Trace, ...], tuple[Doubt, ...]]:
    """Return the free-run traces of all *segments* and no doubt, or no traces and a doubt if the model diverges."""
    try:
        return tuple(t for s in segments for t in run_freely(model, s)), ()
    except NotInformative as error:
        cure = (
            "fly manoeuvres that determine the drag (coast-down, steps at several speeds), supply start values, omit "
            "terms of the form, or use output-error"
        )
        return (), (Doubt(RUNS_AWAY, str(error), cure),)


def fit_percent_of(traces: Sequence[Trace]) -> float:
    """Return 100 (1 - rms/std) of *traces*, averaged over the signals that move, or NaN if no signal moves.

    The rms and the standard deviation of each signal are taken over all runs.
    """
    shares = explained((t.signal, t.measured, t.measured - t.fitted) for t in traces)
    return float(np.mean(list(shares.values()))) if shares else math.nan


def rms_of(traces: Sequence[Trace]) -> float:
    """Return the root mean square residual of all *traces*, or NaN without traces."""
    return (
        math.sqrt(float(np.mean(np.concatenate([(t.measured - t.fitted) ** 2 for t in traces]))))
        if traces
        else math.nan
    )


def run_freely(model: SingleDof | CoupledModel, segment: Segment, names: Sequence[str] = ()) -> list[Trace]:
    """Simulate one segment freely, and return one trace per signal.

    names : signals with which a model of one axis is compared. The default is its position or, if not measured, its
        velocity.

    Raises
    ------
    NotInformative
        The model diverges on the inputs of this run.
    """
    if isinstance(model, SingleDof):
        segment = segment.only(tuple(names) or first_names([segment]))
        if not model.axis.restored:
            return _axis(model, segment)
        model = as_coupled(model, segment.input_names[0])
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
        raise _diverges(f"the model '{model.form.name}'", segment)
    signals = segment.signals
    return [_trace(segment.name, n, signals[n].t, signals[n].values, fitted) for n, (fitted, _) in best.items()]


def _diverges(model: str, segment: Segment) -> NotInformative:
    """Return the error that *model*, in words, diverges on *segment*."""
    return NotInformative(f"{model} diverges on run '{segment.run}'. Check the signs of its drag and inertia")


def _axis(model: SingleDof, segment: Segment) -> list[Trace]:
    segments = [replace(segment, dating=0.0)]
    solution = solve(
        Problem(ExplicitForm.of(segment.dof), segments, None, bounds_of(segments).limits, ()),
        np.array(explicit_parameters(model)),
        first_states(segments),
        levels=first_levels(segments),
        rounds=NOISE_ROUNDS if len(segment.signals) > 1 else 1,
        effort=None,
    )
    if solution is None:
        raise _diverges("the model", segment)
    return [_trace(segment.name, r.signal, r.t, r.measured, r.predicted) for r in solution.rests]


def _with_effects(model: ExtendedModel, trial: Trial) -> list[Trace]:
    form = model.base.form
    segments, _ = prepare_as_recorded([trial], form)
    problem = Problem(form, segments, data_summary_of(form, segments, model.base.values), base_limits(form), free=())
    fitted = problem.states(model.base.theta, model.effects, problem.first_states(segments))
    if fitted is None:
        raise NotInformative(f"the model '{form.name}' with its effects diverges on run '{trial.name}'")
    return [_trace(segments[r.segment].run, r.signal, r.t, r.measured, r.predicted) for r in fitted.rests]


def first_state(record: Segment, states: tuple[str, ...]) -> Array:
    """Return an estimate (n,) of *states* at ``record.start`` from the first samples.

    A state that was not measured is 0.
    """
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
    """Return *x_0* with its *columns* fitted to the record by damped least squares.

    Return *x_0* unchanged if the simulation diverges.
    """

    def local(x: Array) -> Local | None:
        start = x_0.copy()
        start[columns] = x
        predicted = _simulated(simulator, theta, start, record)
        if predicted is None:
            return None
        error = np.concatenate([(record.signals[n].values - y) / scale[n] for n, (y, _) in predicted.items()])
        J = np.vstack([by / scale[n] for n, (_, by) in predicted.items()])
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
    """Return every signal of *record* at its own stamps, with sensitivities, or None if the motion diverges."""
    stamps = record.stamps
    motion = simulator.run(theta, x_0, record.t_in, record.inputs, stamps)
    if motion is None:
        return None
    X, S = motion
    result = {}
    for name, signal in record.signals.items():
        at = np.searchsorted(stamps, signal.t)
        value, by = simulator.outputs(theta, X, S, name)
        result[name] = (value[at], by[at])
    return result


def _observable(state: str, record: Segment) -> bool:
    """Return whether a signal of the record depends directly on this initial state."""
    if state in ("x", "y", "z", "phi", "theta", "psi"):
        return state in record.signals or (state == "psi" and ("x" in record.signals or "y" in record.signals))
    return True


def residual_statistics(trace: Trace) -> ResidualStatistics:
    """Return the statistics of the residuals (measured minus fitted) of *trace*."""
    error = trace.measured - trace.fitted
    rms = math.sqrt(float(np.mean(error**2)))
    measured_std = float(np.std(trace.measured))
    return ResidualStatistics(
        n=len(error),
        mean=float(error.mean()),
        rms=rms,
        mean_absolute=float(np.mean(np.abs(error))),
        worst=float(np.max(np.abs(error))),
        fit_percent=100.0 * (1.0 - rms / measured_std) if measured_std > 0.0 else 0.0,
        lag_one=float(autocorrelation(error, 1)[0]),
        whiteness_p=whiteness(error),
    )
