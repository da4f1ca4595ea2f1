"""The tables of an identification."""

from __future__ import annotations

import math

from gcs_autotune.effects import ExtendedModel
from gcs_autotune.identify import Fit, Model, Parameter, Validation, is_of_one_axis
from gcs_autotune.report.study.study import MethodOutcome, Study
from gcs_autotune.report.toolkit.axis_fit import effect_meanings, meanings, model_table, short_name
from gcs_autotune.report.toolkit.document import Table
from gcs_autotune.report.toolkit.wording import (
    UNKNOWN,
    format_error,
    format_number,
    format_parameter,
    format_percent,
    format_seconds,
    pretty_unit,
)
from gcs_autotune.rounding import HALF_WIDTH
from gcs_autotune.sname import DOFS, signal_meaning

__all__ = [
    "choice_table",
    "estimate_tables",
    "method_table",
    "parameter_table",
    "proposal_table",
    "run_table",
    "unseen_table",
]


ABREAST = 3
"""Number of parameters per table of estimates, as many as fit in 80 columns."""

_FORCES = {
    "X": "surge force",
    "Y": "sway force",
    "Z": "heave force",
    "K": "roll moment",
    "M": "pitch moment",
    "N": "yaw moment",
}

_STATES = {
    "u": "surge",
    "v": "sway",
    "w": "heave",
    "p": "roll rate",
    "q": "pitch rate",
    "r": "yaw rate",
    "phi": "roll angle",
    "theta": "pitch angle",
    "z": "depth",
}

MASSES = ("m", "I_x", "I_y", "I_z")
"""Parameters of the rigid body. In a model without them, inertias contain the added mass."""
_INERTIAS = frozenset(dof.derivative_names()[0] for dof in DOFS.values())
"""Derivatives of a force by the acceleration in its own direction."""
_NAMED = {
    "m": "mass",
    "I_x": "moment of inertia in roll",
    "I_y": "moment of inertia in pitch",
    "I_z": "moment of inertia in yaw",
    "I_xz": "product of inertia",
    "x_G": "centre of gravity, distance ahead of the origin",
    "y_G": "centre of gravity, distance to starboard of the origin",
    "z_G": "centre of gravity, depth below the origin",
    "delay": "input delay",
    "lag": "first-order lag of the force",
    "V_x": "current to the north",
    "V_y": "current to the east",
}


def parameter_table(fit: Fit[Model]) -> Table:
    """Return a table of all parameters, rounded to their standard errors, with their Cramér-Rao bounds."""
    if is_of_one_axis(fit) and all(math.isnan(p.bound) for p in fit.parameters.values()):
        return model_table(fit)
    axis = meanings(fit) if is_of_one_axis(fit) else None
    own = fit.model.effects if isinstance(fit.model, ExtendedModel) else ()
    effects, alone = effect_meanings((*own, *fit.effects)), any(name in fit.parameters for name in MASSES)
    rows = tuple(
        (
            short_name(p.name) if axis is not None else p.name,
            "0" if p.status == "absent" else format_parameter(p.name, p.value, p.std, p.unit),
            pretty_unit(p.unit) or "1",
            _relative(p),
            _over_bound(p),
            (effects.get(p.name) or meaning_of(p.name, alone=alone)) if axis is None else axis.get(p.name, ""),
            _remark(p),
        )
        for p in fit.parameters.values()
    )
    heads = ("parameter", "value ± std", "unit", "std", "std / bound", "meaning", "remark")
    return Table(heads, "lrlrrll", rows, wide=("std", "std / bound"))


def _relative(p: Parameter) -> str:
    if p.std <= 0.0 or not math.isfinite(p.std) or p.value == 0.0:
        return ""
    return format_percent(100.0 * p.std / abs(p.value))


def _over_bound(p: Parameter) -> str:
    return format_number(p.std / p.bound, 3) if p.bound > 0.0 and math.isfinite(p.std) else ""


def _remark(p: Parameter) -> str:
    if p.status == "fitted" and HALF_WIDTH * p.std > abs(p.value) > 0.0:  # the 95 % interval includes zero
        return "may be zero"
    if p.status == "at_bound" and p.value == 0.0:
        return "none"
    return {"fitted": "", "absent": "not fitted", "fixed": "known"}.get(p.status, "AT ITS BOUND")


def meaning_of(name: str, *, alone: bool = True) -> str:
    """Return the meaning of a SNAME derivative as text; empty if unknown.

    alone : whether derivatives of accelerations contain added mass alone, and not the craft's own inertia.
    """
    if name in _NAMED:
        return _NAMED[name]
    force, _, rest = name.partition("_")
    if force not in _FORCES or not rest:
        return ""
    if rest == "0":
        return f"constant {_FORCES[force]}"
    if rest.endswith("dot"):
        moved = _STATES.get(rest[:-3], rest[:-3]).removesuffix(" rate")
        kind = "added mass" if alone or name not in _INERTIAS else "inertia with added mass"
        return f"{kind}: {_FORCES[force]} by {moved} acceleration"
    if rest in _STATES:
        return f"{_FORCES[force]} by {_STATES[rest]}"
    if len(rest) == 2 and rest[0] == rest[1] and rest[0] in _STATES:
        return f"{_FORCES[force]} by {_STATES[rest[0]]} squared"
    return f"{_FORCES[force]} by {rest}"


def method_table(study: Study) -> Table:
    """Return a table with fit and held-out prediction of each method, or the reason why it failed."""
    return Table(
        ("method", "fit", "held out", "time", "remark"), "lrrrl", tuple(_method_row(o) for o in study.outcomes)
    )


def _method_row(outcome: MethodOutcome) -> tuple[str, ...]:
    if outcome.fit is None:
        return (outcome.method, "", "", "", outcome.refusal)
    unseen = "" if outcome.unseen is None else format_percent(outcome.unseen.fit_percent)
    doubts = ", ".join(d.slug for d in outcome.fit.doubts)
    return (outcome.method, format_percent(outcome.fit.fit_percent), unseen, format_seconds(outcome.seconds), doubts)


def estimate_tables(study: Study) -> tuple[Table, ...]:
    """Return tables that compare the estimates of the methods, with :data:`ABREAST` parameters per table."""
    fits = [o.fit for o in study.outcomes if o.fit is not None]
    names = list(dict.fromkeys(n for f in fits for n, p in f.parameters.items() if p.std > 0.0))
    tables = []
    for first in range(0, len(names), ABREAST):
        some = names[first : first + ABREAST]
        rows = tuple((f.method, *(_estimate(f, n) for n in some)) for f in fits)
        tables.append(Table(("method", *some), "l" + "r" * len(some), rows))
    return tuple(tables)


def _estimate(fit: Fit[Model], name: str) -> str:
    parameter = fit.parameters.get(name)
    if parameter is None or parameter.status == "absent":
        return ""
    return format_parameter(name, parameter.value, parameter.std, parameter.unit)


def run_table(study: Study) -> Table:
    """Return a table of the runs, with their contents and their use."""
    rows = tuple((r.name, format_seconds(r.duration), str(r.samples), " ".join(r.signals), r.role) for r in study.runs)
    return Table(("run", "length", "samples", "channels", "used for"), "lrrll", rows)


def unseen_table(found: Validation | None, dof: str) -> Table:
    """Return a table with the free-run prediction of held-out data, by a fit of the degree of freedom or form *dof*."""
    pairs = () if found is None else zip(found.traces, found.statistics, strict=True)
    rows = tuple(
        (
            t.run,
            f"{t.signal}, {signal_meaning(t.signal, dof)}",
            format_percent(s.fit_percent) if math.isfinite(s.fit_percent) else UNKNOWN,
            format_error(s.rms, t.unit, 3),
            format_error(s.worst, t.unit, 3),
        )
        for t, s in pairs
    )
    return Table(("run", "signal", "fit", "rms error", "worst"), "llrrr", rows)


def choice_table(study: Study) -> Table:
    """Return a table that compares the candidate structures of a model."""
    return Table(("structure", "held-out error", "BIC - best", "verdict"), "lrrl", study.choice)


def proposal_table(study: Study) -> Table:
    """Return a table of the proposed manoeuvres, best first."""
    return Table(("manoeuvre", "how", "expected improvement", "needs"), "llll", study.proposals)
