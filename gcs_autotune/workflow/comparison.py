"""``compare``: runs of one craft side by side, and what changed between them. Nothing is flown."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast

import numpy as np

from gcs_autotune.diagnose import CraftComparison, compare_craft
from gcs_autotune.documents import SETTING_OUT
from gcs_autotune.effects import ExtendedModel, may_be_none
from gcs_autotune.errors import AutotuneError, BadFile, NotInformative, UsageError
from gcs_autotune.identify import AxisFit, ModelFile, Structure, fit, fit_axis, load_model
from gcs_autotune.identify.thrust import with_actuator
from gcs_autotune.logs import load_runs
from gcs_autotune.manoeuvres import MANOEUVRES
from gcs_autotune.report import ComparedRun, Comparison, reference_of
from gcs_autotune.sname import DOFS
from gcs_autotune.trial import Trial, load_trial
from gcs_autotune.untrusted_text import visible
from gcs_autotune.workflow.recheck import AFTER, BEFORE
from gcs_autotune.workflow.record import SUMMARY
from gcs_autotune_files import Refused, read

__all__ = ["COMPARED", "compare", "fits_in"]

COMPARED = ("yaw", "surge", "heave")
"""Degrees of freedom of which models are compared."""

MOST_RUNS = 12
"""Most runs of one comparison: more columns cannot be read. Project choice."""


def compare(
    sources: Sequence[Path], *, parameters: Mapping[str, float] | None = None, system: int | None = None
) -> Comparison:
    """Return the comparison of run directories or logs of one craft.

    parameters : of the vehicle, for logs that do not contain them. system : system id of the vehicle in a log.

    Raises
    ------
    UsageError
        There are fewer than two sources, more than twelve, or one twice.
    BadFile
        A source cannot be read.
    NotInformative
        The runs have nothing in common that can be compared.
    """
    places = [path.resolve() for path in sources]
    if not 2 <= len(places) <= MOST_RUNS:
        raise UsageError(
            f"{len(places)} run{'s' * (len(places) != 1)} given. Give 2 to {MOST_RUNS} run directories or logs of one "
            "craft"
        )
    if len(set(places)) < len(places):
        twice = next(path for path in sources if places.count(path.resolve()) > 1)
        raise UsageError(f"{twice} is given twice. Give each run once")
    structures: dict[str, str] = {}
    actuators: dict[tuple[str, str], ExtendedModel] = {}
    for path in sources:
        for dof, model in _models_with_actuator(path).items():
            actuators.setdefault((_vehicle(path), dof), model)
    runs = []
    for path in sources:
        own = {dof: model for (vehicle, dof), model in actuators.items() if vehicle == _vehicle(path)}
        run = _read(path, parameters, system, structures, own)
        structures = {dof: fit.structure for dof, fit in run.fits.items()} | structures
        runs.append(run)
    if all(run.when for run in runs):
        runs.sort(key=lambda run: run.when)
    found = Comparison(tuple(_with_own_names(runs)), {})
    if not _comparable(found.runs):
        reasons = "; ".join(f"{run.name}: {', '.join(dict.fromkeys(run.unfitted.values()))}" for run in runs)
        raise NotInformative(f"these runs have no loop and no model in common. {reasons}")
    return replace(found, changes=_changes(found), doubts=tuple(_doubts(found)))


def fits_in(
    trials: Sequence[Trial],
    structures: Mapping[str, str],
    dofs: Sequence[str] = COMPARED,
    actuators: Mapping[str, ExtendedModel] = MappingProxyType({}),
) -> tuple[dict[str, AxisFit], dict[str, str]]:
    """Return the models of *trials* by degree of freedom, and for the others why there is none.

    structures : degree of freedom -> structure of drag, so that models can be compared; without one it is chosen.
    actuators : degree of freedom -> model with actuator effects that a run of this craft found. The fits start from it
        and have its effects.
    """
    fits: dict[str, AxisFit] = {}
    reasons: dict[str, str] = {}
    for dof in dofs:
        own = DOFS[dof]
        telling = [t for t in trials if own.force in t and (own.position in t or own.velocity in t)]
        if not telling:
            reasons[dof] = f"no run contains {own.force} together with {own.position} or {own.velocity}"
            continue
        telling = [t for t in telling if dof in _excited(t)]
        if not telling:
            reasons[dof] = f"the manoeuvres flown do not excite {dof}"
            continue
        try:
            fits[dof] = _fitted(telling, dof, structures.get(dof), actuators.get(dof))
        except AutotuneError as error:
            reasons[dof] = str(error)
    return fits, reasons


def _fitted(trials: Sequence[Trial], dof: str, structure: str | None, actuator: ExtendedModel | None) -> AxisFit:
    """Return the model of *trials*, with the effects of *actuator* if there is one.

    A model without these effects may not explain all trials, so it is fitted to those flown to identify the craft.
    """
    if actuator is None:
        return fit_axis(trials, dof=dof, structure=cast("Structure | None", structure))
    identifying = [t for t in trials if t.purpose == "identification"]
    return with_actuator(fit(trials, start=actuator), fit_axis(identifying or trials, dof=dof))


def _models_with_actuator(path: Path) -> dict[str, ExtendedModel]:
    """Return the models of one axis in a run directory with clear actuator effects, by degree of freedom."""
    files = [load_model(file) for file in sorted(path.glob("model*.json"))] if path.is_dir() else []
    return {f.model.base.form.dofs[0]: f.model for f in files if len(f.model.base.form.dofs) == 1 and _is_bent(f)}


def _is_bent(file: ModelFile) -> bool:
    """Return whether the 95 % interval of an actuator effect of the model excludes the case of no effect."""
    std = dict(zip(file.names, np.sqrt(np.maximum(np.diag(file.covariance), 0.0)).tolist(), strict=True))
    return any(
        not may_be_none(own, {n: std[label] for n in own.values if (label := own.label_of(n)) in std})
        for own in file.model.effects
    )


def _excited(trial: Trial) -> Collection[str]:
    """Return the degrees of freedom that the run was flown for. If a log does not state them, all are possible.

    A boat that gathers way before a turn would otherwise yield a poor model of surge, and with it a change that never
    was.
    """
    if "dof" in trial.meta:
        return (str(trial.meta["dof"]),)
    kind = MANOEUVRES.get(str(trial.meta.get("manoeuvre", "")))
    return COMPARED if kind is None else kind.excites


def _read(
    path: Path,
    parameters: Mapping[str, float] | None,
    system: int | None,
    structures: Mapping[str, str],
    actuators: Mapping[str, ExtendedModel],
) -> ComparedRun:
    told = _json(path / SUMMARY) if path.is_dir() else {}
    trials: Sequence[Trial]
    fits: dict[str, AxisFit]
    try:
        trials = load_runs(path, system=system, parameters=parameters)
    except NotInformative as error:
        trials, fits = (), {}
        reasons = {"all": str(error)}
    else:
        fits, reasons = fits_in(trials, structures, actuators=actuators)
    kinds = frozenset(str(t.meta["manoeuvre"]) for t in trials if t.meta.get("manoeuvre"))
    run = ComparedRun(visible(path.resolve().name), fits=fits, unfitted=reasons, manoeuvres=kinds)
    if not told:
        return run
    kept = told.get("kept")
    axis = str(told.get("axis") or "")
    names = tuple(_mapping(told.get("gains")))
    present = _json(path / AFTER) or _json(path / BEFORE)
    before, after = (_numbers(_mapping(told.get("metrics")).get(n)) for n in ("before", "after"))
    return replace(
        run,
        title=visible(str(told.get("title", ""))),
        when=visible(str(told.get("when", ""))),
        ending=visible(str(told.get("ending", ""))),
        vehicle=_vehicle(path),
        axis=visible(axis),
        gains=_numbers({n: present[n] for n in names if n in present}),
        metrics=after if kept else before,
        step=_step(path, "step-after" if kept else "step-before") if axis else None,
    )


def _vehicle(path: Path) -> str:
    """Return the identifier of the vehicle of a run directory; empty if it is unknown."""
    vehicle = _mapping(_json(path / SETTING_OUT).get("vehicle")) if path.is_dir() else {}
    return visible(str(vehicle.get("uid") or vehicle.get("system") or ""))


def _step(path: Path, name: str) -> Trial | None:
    file = next(iter(sorted(path.glob(f"trials/*-{name}.csv"))), None)
    return None if file is None else load_trial(file)


def _json(path: Path) -> Mapping[str, Any]:
    """Return what a file of a run directory contains; empty if there is no such file, as after an aborted run."""
    if not path.is_file():
        return {}
    try:
        return _mapping(read(path))
    except Refused as error:
        raise BadFile(f"{path}: {error}") from error


def _mapping(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, dict) else {}


def _numbers(value: object) -> dict[str, float]:
    return {str(n): float(v) if isinstance(v, (int, float)) else math.nan for n, v in _mapping(value).items()}


def _with_own_names(runs: Sequence[ComparedRun]) -> list[ComparedRun]:
    """Return *runs* with different names, although directories in different places may have the same name."""
    names = [run.name for run in runs]
    return [
        run if names.count(run.name) == 1 else replace(run, name=f"{run.name} ({i})") for i, run in enumerate(runs, 1)
    ]


def _comparable(runs: Sequence[ComparedRun]) -> bool:
    """Return whether at least two runs have a loop or a model in common."""
    common = [f"loop {run.axis}" for run in runs if run.metrics] + [dof for run in runs for dof in run.fits]
    return any(common.count(one) > 1 for one in common)


def _changes(found: Comparison) -> dict[str, tuple[CraftComparison, ...]]:
    changes: dict[str, tuple[CraftComparison, ...]] = {}
    for run in found.runs:
        rows = []
        for dof, now in run.fits.items():
            reference = reference_of(found.runs, dof, run)
            if reference is None or reference is run:
                continue
            first = reference.fits[dof]
            if first.model.input_unit == now.model.input_unit:
                rows.append(compare_craft(first, now))
        changes[run.name] = tuple(rows)
    return changes


def _doubts(found: Comparison) -> list[str]:
    doubts = []
    if len(found.vehicles) > 1:
        doubts.append(f"the runs are of {len(found.vehicles)} different vehicles ({', '.join(found.vehicles)})")
    for dof in COMPARED:
        units = dict.fromkeys(run.fits[dof].model.input_unit for run in found.runs if dof in run.fits)
        if len(units) > 1:
            doubts.append(
                f"the inputs in {dof} are in different units ({', '.join(units)}), so models are not compared"
            )
    axes = dict.fromkeys(run.axis for run in found.runs if run.axis)
    for axis in axes:
        speeds = [(run, _speed(run)) for run in found.runs if run.axis == axis and math.isfinite(_speed(run))]
        for (one, u), (other, v) in pairwise(speeds):
            if abs(u - v) > 0.2 * max(u, v):
                doubts.append(
                    f"{one.name} was flown at {u:.1f} m/s and {other.name} at {v:.1f} m/s. Steering depends on speed. "
                    "Fly both at the same speed"
                )
    return doubts


def _speed(run: ComparedRun) -> float:
    value = run.step.meta.get("speed") if run.step is not None else None
    return float(value) if isinstance(value, (int, float)) else math.nan
