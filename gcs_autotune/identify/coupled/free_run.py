"""A coupled model let loose on a run's inputs, only the initial states fitted to what was measured."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.coupled.record import CoupledRecord, prepare_coupled
from gcs_autotune.identify.least_squares import inverse_of
from gcs_autotune.identify.result import Trace
from gcs_autotune.models.coupled import CoupledModel, Simulator
from gcs_autotune.sname import DOFS, SIGNALS
from gcs_autotune.trial import Trial

__all__ = ["first_state", "free_runs", "run_freely", "simulated"]

Array = NDArray[np.float64]

ROUNDS = 8
"""Gauss-Newton steps for the initial states; the motion depends on them almost linearly."""

SETTLED = 1e-6
"""Relative decrease of the misfit at which the steps end early."""


def free_runs(model: CoupledModel, trial: Trial) -> list[Trace]:
    """Return one trace per signal of *trial*, its stretches one after the other."""
    parts = [run_freely(model, record) for record in prepare_coupled(trial, model.form)]
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


def first_state(record: CoupledRecord, states: tuple[str, ...]) -> Array:
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


def run_freely(model: CoupledModel, record: CoupledRecord) -> list[Trace]:
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
    best, cost = None, np.inf
    for _ in range(ROUNDS):
        found = simulated(simulator, model.theta, x_0, record)
        if found is None:
            break
        error = np.concatenate([(record.signals[n].values - y) / scale[n] for n, (y, _) in found.items()])
        J = np.vstack([by / scale[n] for n, (_, by) in found.items()])
        before, now = cost, float(error @ error)
        if now < cost * (1.0 - 1e-9):
            best, cost = found, now
        if not now < before * (1.0 - SETTLED):
            break
        step = inverse_of(J.T @ J + 1e-9 * np.eye(J.shape[1])) @ (J.T @ error)
        x_0 = x_0.copy()
        x_0[columns] += step
    if best is None:
        raise NotInformative(f"the model '{model.form.name}' runs away on run '{record.run}': its drag destabilises it")
    traces = []
    for name, (fitted, _) in best.items():
        signal = record.signals[name]
        rms = float(np.sqrt(np.mean((signal.values - fitted) ** 2)))
        band = np.full(len(fitted), 1.96 * rms)
        traces.append(Trace(record.run, signal.t, signal.values, fitted, band, name, SIGNALS[name][0]))
    return traces


def simulated(
    simulator: Simulator, theta: Array, x_0: Array, record: CoupledRecord
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


def _observable(state: str, record: CoupledRecord) -> bool:
    """Whether a signal of the record answers to this initial state at once."""
    if state in ("x", "y", "z", "phi", "theta", "psi"):
        return state in record.signals or (state == "psi" and ("x" in record.signals or "y" in record.signals))
    return True
