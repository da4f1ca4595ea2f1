"""Select the terms of a model by correlation (Miskovic2007, III).

The method uses the correlation coefficient at zero lag between the velocity of a degree of freedom and every other
factor of its equation. The factors are the form's own regressors. With ``x_G`` free, those of yaw are ``v_dot + ur``
and so on, as in the paper. A term with an effect has the same sign in every run, so the mean over runs decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import UsageError
from gcs_autotune.identify.regression import NU, GriddedMotion, drives_of, motion_of
from gcs_autotune.identify.signals import Segment, prepare_form
from gcs_autotune.models import RIGID_BODY, SPECIAL, Form, force_columns, inertia_columns, inertia_of, program_of
from gcs_autotune.sname import DOFS
from gcs_autotune.trial import Trial

__all__ = ["INPUT", "Correlation", "correlations", "structure_by_correlation"]

Array = NDArray[np.float64]

INPUT = "input"
"""Name of the total force of all inputs with known gain."""

THRESHOLD = 0.5
"""Mean correlation above which a term is kept; it then explains a quarter of the motion by itself."""


@dataclass(frozen=True, slots=True)
class Correlation:
    """Correlation of one factor with one degree of freedom.

    ``term``: the parameter (or ``INPUT``) of the factor. ``velocity`` and ``acceleration``: mean over the runs of its
    correlation with the observed velocity and acceleration. ``scatter``: the standard deviation of the former.
    """

    dof: str
    term: str
    velocity: float
    acceleration: float
    scatter: float


def correlations(
    runs: Trial | Sequence[Trial], form: Form, *, use: Sequence[str] | None = None, derivative: str = "smoothing"
) -> tuple[Correlation, ...]:
    """Return the correlations of every degree of freedom of *form* with every factor that varies in its equation.

    Raises
    ------
    UsageError
        Delay, lag or current are free. Errors of the preparation of runs as :func:`gcs_autotune.identify.fit`.
    """
    odd = [n for n in form.free if n in SPECIAL]
    if odd:
        raise UsageError(
            f"correlation cannot estimate {', '.join(odd)} of '{form.name}'. Set them to known values first"
        )
    together = (runs,) if isinstance(runs, Trial) else tuple(runs)
    records = [r for run in together for r in prepare_form(run, form, use)]
    found = [_of_record(r, form, motion_of(r, form, derivative)) for r in records]
    table = []
    for dof, term in dict.fromkeys(key for one in found for key in one):
        pairs = np.array([one[dof, term] for one in found if (dof, term) in one])
        scatter = float(pairs[:, 0].std(ddof=1)) if len(pairs) > 1 else 0.0
        table.append(Correlation(dof, term, float(pairs[:, 0].mean()), float(pairs[:, 1].mean()), scatter))
    return tuple(table)


def _of_record(record: Segment, form: Form, motion: GriddedMotion) -> dict[tuple[str, str], tuple[float, float]]:
    drives = drives_of(record, form, motion.t, motion.step)
    E = force_columns(form, motion.nu, motion.eta, drives) + inertia_columns(form, motion.nu_dot)
    active = [int(a) for a in program_of(form).active]
    out = {}
    for i, dof in enumerate(form.dofs):
        velocity, acceleration = motion.nu[:, active[i]], motion.nu_dot[:, active[i]]
        for p, name in enumerate((*form.parameters, INPUT)):
            factor = -E[:, i, p]
            own = _own(name, active[i])
            if own or not _varies(factor, E[:, i]):
                continue
            out[dof, name] = (_together(velocity, factor), _together(acceleration, factor))
    return out


def _own(name: str, row: int) -> bool:
    """Return whether *name* is the inertia or the drag of this degree of freedom."""
    inertia = inertia_of(name) if name not in RIGID_BODY and name != INPUT else None
    if inertia is not None:
        return inertia.row == inertia.column == row
    nu = NU[row]
    return "_" in name and name.split("_", 1)[1] in (nu, nu * 2, f"|{nu}|{nu}", nu * 3)


def _varies(factor: Array, equation: Array) -> bool:
    return float(np.std(factor)) > 1e-9 * max(float(np.abs(equation).max()), 1e-300)


def _together(a: Array, b: Array) -> float:
    scale = float(np.std(a) * np.std(b))
    return float(np.mean((a - a.mean()) * (b - b.mean())) / scale) if scale > 0.0 else 0.0


def structure_by_correlation(form: Form, table: Sequence[Correlation], threshold: float = THRESHOLD) -> Form:
    """Return *form* without the free terms whose correlation is below *threshold* in every equation.

    Inertia and drag of each degree of freedom, constant forces and known parameters are kept.
    """
    best: dict[str, float] = {}
    for line in table:
        best[line.term] = max(best.get(line.term, 0.0), abs(line.velocity))
    diagonal = {f"{DOFS[d].force}_{DOFS[d].velocity}dot" for d in form.dofs}
    weak = [n for n in form.free if best.get(n, 1.0) < threshold and n not in diagonal and not n.endswith("_0")]
    return form.without(*(n for n in weak if not _gain(form, n)))


def _gain(form: Form, name: str) -> bool:
    """Return whether *name* is the gain of an input, which the form cannot do without."""
    return any(isinstance(g, str) and g.lstrip("-") == name for pairs in form.inputs.values() for _, g in pairs)
