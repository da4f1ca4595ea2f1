"""The method ``step``: open-loop step responses through Miskovic2010, table 4.1, all steps of all runs together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict

import numpy as np

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.axis.case import Case
from gcs_autotune.identify.result import AxisFit, Doubt, Structure
from gcs_autotune.identify.ship.answer import axis_answer
from gcs_autotune.identify.ship.step_evidence import row_of, unevenness_doubts
from gcs_autotune.identify.ship.step_model import StepModel, fit_readings
from gcs_autotune.identify.ship.steps import StepReading, read_steps

__all__ = ["fit_by_steps"]

CLOSE = 2.0
"""Difference of the criterion below which two structures count as undecided."""


def fit_by_steps(case: Case) -> AxisFit:
    """Identify one degree of freedom from steps of its input.

    ``extra["steps"]`` lists the readings, ``extra["table_4_1"]`` each step from rest by itself.

    Raises
    ------
    NotInformative
        No step long enough to be read.
    """
    everything = read_steps(case.records)
    readings = [r for r in everything if r.settled]
    if not any(r.has_lag or r.has_knee for r in readings):
        raise NotInformative(
            f"run '{case.names[0]}' holds no step that can be read: the input must stand still before it, and after it "
            "for five time constants or more until the velocity has settled; method='output-error' takes any input"
        )
    models = _candidates(readings, case.structure)
    if not models:
        raise NotInformative(
            f"the steps of run '{case.names[0]}' cannot tell structure '{case.structure}': step to more levels"
        )
    model, undecided = _choose(models)
    rows = [row for row in map(row_of, readings) if row is not None]
    doubts = [*_doubts(everything, model), *unevenness_doubts(rows, model.structure)]
    if undecided and case.structure is None:
        doubts.append(_undecided())
    extra = {
        "steps": [_plain(r) for r in everything],
        "table_4_1": [asdict(row) for row in rows],
        "scatter_beyond_noise": model.scatter,
    }
    return axis_answer(case, "step", model.structure, model.theta, model.covariance, model.fitted, doubts, extra)


def _candidates(readings: Sequence[StepReading], structure: Structure | None) -> list[StepModel]:
    wanted: tuple[Structure, ...] = ("linear", "nonlinear", "affine") if structure is None else (structure,)
    found = []
    for name in wanted:
        try:
            model = fit_readings(readings, name)
        except NotInformative:
            continue
        if structure is not None or name == "linear" or model.spare > 0:
            found.append(model)
    return found


def _choose(models: Sequence[StepModel]) -> tuple[StepModel, bool]:
    """Return the structure of least BIC, the noise raised to what the richest one leaves, and whether it was close."""
    models = [m for m in models if _damps(m)] or models
    if len(models) == 1:
        return models[0], models[0].spare <= 0
    unit = max(1.0, min(m.chi2 / max(m.spare, 1) for m in models))
    n = max(m.spare + sum(m.fitted) for m in models)
    scored = sorted(models, key=lambda m: m.chi2 / unit + sum(m.fitted) * math.log(n))
    gap = (scored[1].chi2 - scored[0].chi2) / unit + (sum(scored[1].fitted) - sum(scored[0].fitted)) * math.log(n)
    if gap >= CLOSE:
        return scored[0], False
    if "affine" in (scored[0].structure, scored[1].structure):
        return min(scored[:2], key=lambda m: sum(m.fitted)), False
    return min(scored[:2], key=lambda m: m.structure), True


def _damps(model: StepModel) -> bool:
    """Whether both drags have the sign of the inertia."""
    return bool(np.all(model.theta[1:3] * model.theta[0] >= 0.0))


def _doubts(everything: Sequence[StepReading], model: StepModel) -> list[Doubt]:
    found = []
    restless = [r for r in everything if not r.settled]
    if restless:
        found.append(
            Doubt(
                "not-settled",
                f"{len(restless)} of {len(everything)} step(s) had not settled when the input changed: left out",
                "hold each step for at least five time constants",
            )
        )
    if not model.fitted[3]:
        found.append(
            Doubt(
                "no-disturbance",
                "one level of input cannot tell drag from a constant force; none was assumed",
                "step to both sides",
            )
        )
    if model.spare > 0 and model.scatter > 2.0:
        found.append(
            Doubt(
                "steps-disagree",
                f"the steps differ {model.scatter:.1f} times more than their noise; standard errors were raised for it",
                "try the other structure; did load, battery or current change between the steps?",
            )
        )
    return found


def _undecided() -> Doubt:
    return Doubt(
        "structure-undecided",
        "these steps cannot tell linear from quadratic damping; the simpler was taken",
        "step to clearly different levels",
    )


def _plain(r: StepReading) -> dict[str, float | str | bool]:
    return {
        "run": r.run,
        "t": r.t,
        "tau": r.tau,
        "k_ss": r.k_ss.value,
        "k_ss_std": r.k_ss.std,
        "lag": r.lag.value,
        "lag_std": r.lag.std,
        "knee": r.knee.value,
        "knee_std": r.knee.std,
        "nu_0": r.nu_0.value,
        "settled": r.settled,
    }
