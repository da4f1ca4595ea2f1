"""Ours: ``fit(runs, form)`` by output error, begun where least squares ends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.real_runs.methods import Predict
from benchmarks.real_runs.runs import FIRST, OUTPUTS, Run
from gcs_autotune.identify import fit
from gcs_autotune.models.coupled import FORMS, CoupledModel
from gcs_autotune.models.coupled.derivatives import SPECIAL
from gcs_autotune.trial import Channel, Trial

__all__ = ["first_motion", "fitted", "train", "trial_of"]

HORIZON = 60.0
"""Seconds a simulation runs freely in training: several time constants of sway and yaw of both crafts."""

_UNITS = {"u": "m/s", "v": "m/s", "r": "rad/s", "force_left": "N", "force_right": "N", "delta": "rad"}


def trial_of(run: Run, inputs: Sequence[str]) -> Trial:
    """Return *run* as a trial, only what was measured in it."""
    channels = {n: Channel(n, _UNITS[n], run.t, run.U[:, i]) for i, n in enumerate(inputs)}
    for i, n in enumerate(OUTPUTS):
        channels[n] = Channel(n, _UNITS[n], run.t[run.seen[:, i]], run.Y[run.seen[:, i], i])
    channels["psi"] = Channel("psi", "rad", run.t, run.psi)
    return Trial(run.name, channels)


def first_motion(run: Run) -> tuple[NDArray[np.float64], float]:
    """Return u, v, r and the heading at sample ``FIRST - 1``, off lines through the samples up to it."""
    t = run.t[:FIRST] - run.t[FIRST - 1]
    lines = [float(np.polyfit(t, y, 1)[1]) for y in (*run.Y[:FIRST].T, run.psi[:FIRST])]
    return np.array(lines[:3]), lines[3]


def fitted(runs: Sequence[Run], form: str) -> CoupledModel:
    """Fit the shipped form; physical signs required. The regression uses forces only, so not the compass."""
    structure = FORMS[form]
    trials = [trial_of(r, tuple(structure.inputs)) for r in runs]
    forces = structure.without(*SPECIAL)
    rough = fit(trials, forces, "least-squares", delay=0.0).parameters
    begun = replace(structure, start={n: rough[n].value for n in forces.free})
    model = fit(trials, begun, delay=0.0, physical=True, horizon=HORIZON).model
    assert isinstance(model, CoupledModel)
    return model


def train(runs: Sequence[Run], form: str) -> Predict:
    """Fit."""
    structure, model = FORMS[form], fitted(runs, form)

    def predict(run: Run) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
        nu, psi = first_motion(run)
        drives = {n: run.U[:, i] for i, n in enumerate(structure.inputs)}
        initial = {"u": nu[0], "v": nu[1], "r": nu[2], "psi": psi}
        motion = model.simulate(run.t, drives, run.t[FIRST - 1 :], initial).values
        Y = run.Y.copy()
        Y[FIRST - 1 :] = np.column_stack([motion[n] for n in OUTPUTS])
        heading = run.psi.copy()
        heading[FIRST - 1 :] = motion["psi"]
        return Y, heading

    return predict
