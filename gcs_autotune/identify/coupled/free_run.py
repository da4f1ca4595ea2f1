"""A coupled model let loose on a run's inputs, only the initial states fitted to what was measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.least_squares import Local, descend
from gcs_autotune.identify.preparation import prepare_form
from gcs_autotune.identify.result import Trace
from gcs_autotune.identify.segment import Segment
from gcs_autotune.models.coupled import CoupledModel, Simulator
from gcs_autotune.sname import DOFS, SIGNALS
from gcs_autotune.trial import Trial

__all__ = ["first_state", "free_runs", "run_freely", "simulated"]

Array = NDArray[np.float64]

HORIZONS = (0.1, 0.35, 1.0)
"""Shares of a record the initial state is fitted to, one after the other: a craft that is unstable on its course
multiplies an error of its start many times, and the whole record then has no use for a rough one."""


def free_runs(model: CoupledModel, trial: Trial) -> list[Trace]:
    """Return one trace per signal of *trial*, its stretches one after the other."""
    parts = [run_freely(model, record) for record in prepare_form(trial, model.form)]
    names = dict.fromkeys(t.signal for traces in parts for t in traces)
    joined = []
    for name in names:
        own = [t for traces in parts for t in traces if t.signal == name]
        joined.append(
            Trace(
                trial.name,
                np.concatenate([t.t for t in own]),
                np.concatenate([t.measured for t in own]),
                np.concatenate([t.fitted for t in own]),
                np.concatenate([t.band for t in own]),
                name,
                SIGNALS[name][0],
            )
        )
    return joined


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
            if own.name not in ("surge", "sway"):
                guess[i] = float(np.polyfit(signal.t[:few], signal.values[:few], 1)[0])
    return guess


def run_freely(model: CoupledModel, record: Segment) -> list[Trace]:
    """Simulate one stretch; the bands are 1.96 times each signal's rms residual.

    Raises
    ------
    NotInformative
        The model runs away on this run's inputs.
    """
    states = Simulator(model.form).states
    free = tuple(n for n in states if not n.startswith("lagged") and _observable(n, record))
    simulator = Simulator(model.form, (), free)
    x_0 = first_state(record, states)
    columns = [states.index(n) for n in free]
    scale = {n: max(float(np.std(s.values)), 1e-9) for n, s in record.signals.items()}
    for share in HORIZONS:
        x_0 = _best_start(simulator, model.theta, x_0, columns, record.until(share), scale)
    best = simulated(simulator, model.theta, x_0, record)
    if best is None:
        raise NotInformative(f"the model '{model.form.name}' runs away on run '{record.run}': its drag destabilises it")
    traces = []
    for name, (fitted, _) in best.items():
        signal = record.signals[name]
        rms = float(np.sqrt(np.mean((signal.values - fitted) ** 2)))
        band = np.full(len(fitted), 1.96 * rms)
        traces.append(Trace(record.name, signal.t, signal.values, fitted, band, name, SIGNALS[name][0]))
    return traces


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
        found = simulated(simulator, theta, start, record)
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


def simulated(simulator: Simulator, theta: Array, x_0: Array, record: Segment) -> dict[str, tuple[Array, Array]] | None:
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
