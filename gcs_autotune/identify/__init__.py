"""From recorded runs to a model with its uncertainty.

:func:`identify` is the door. Behind it:

==================  ===========================================================================
record, files       signals chosen, cleaned and cut; runs found on disk
limit_cycle         the cycle of a relay experiment, and a monitor that says when to stop it
cycle_reading       limit cycles read off a record
iso, matrix_iso     first-harmonic identification (IS-O), for one degree of freedom and for any linear process
decision            linear or nonlinear drag from two limit cycles
start               where the exact fit starts
output_error        the exact fit: ``objective`` what it minimises, ``likelihood`` of noise and rounding,
                    ``residuals`` measured minus simulated, ``least_squares`` the descent
structure           which drag, and is there a delay: candidates weighed by ``evidence``
uncertainty         covariance, correlated residuals, Cramer-Rao bound
signals             position, velocity or both
doubts, fit_doubts  reasons not to trust the result, with cause and cure
validation          free run on a record
by_output_error, by_iso   the methods
==================  ===========================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Literal

from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.identify.by_iso import fit_by_iso
from gcs_autotune.identify.by_output_error import fit_by_output_error
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.cleaning import quantum
from gcs_autotune.identify.cycle_reading import find_cycles
from gcs_autotune.identify.decision import decide
from gcs_autotune.identify.files import load_runs
from gcs_autotune.identify.limit_cycle import LimitCycleMonitor, MonitorState
from gcs_autotune.identify.record import guess_dof, prepare
from gcs_autotune.identify.result import Fit, LimitCycle, Structure
from gcs_autotune.identify.structure import FREE
from gcs_autotune.identify.uncertainty import cramer_rao
from gcs_autotune.identify.validation import ResidualStatistics, free_run, residual_statistics
from gcs_autotune.registry import lookup
from gcs_autotune.sname import DOFS, Dof
from gcs_autotune.trial import Trial

__all__ = [
    "METHODS",
    "Fit",
    "LimitCycleMonitor",
    "MonitorState",
    "ResidualStatistics",
    "Structure",
    "cramer_rao",
    "decide",
    "find_cycles",
    "free_run",
    "identify",
    "load_runs",
    "quantum",
    "residual_statistics",
]

METHODS: Mapping[str, Callable[[Case], Fit]] = {
    "output-error": fit_by_output_error,
    "iso": fit_by_iso,
}
"""Name -> method."""


def identify(
    trials: Trial | Sequence[Trial],
    *,
    dof: str | None = None,
    structure: Structure | None = None,
    delay: Literal["auto"] | float = "auto",
    method: str = "output-error",
    use: Sequence[str] | None = None,
    loss: Literal["linear", "soft_l1"] = "linear",
) -> Fit:
    """Identify one degree of freedom from one or more recorded runs.

    Parameters
    ----------
    dof : name in ``DOFS``; guessed from what moves when None.
    structure : ``linear``, ``nonlinear`` or ``affine`` drag; decided by evidence when None.
    delay : between input and motion [s]; ``auto`` fits one and keeps it on strong evidence only.
    method : name in :data:`METHODS`.
    use : ``("position",)``, ``("velocity",)`` or both; chosen when None, see :mod:`gcs_autotune.identify.signals`.
    loss : ``soft_l1`` bears with outliers.

    Returns
    -------
    Fit
        With all of ``alpha_*``, ``beta_*``, ``beta_**``, ``delta`` and ``delay``; a poor answer carries doubts.

    Raises
    ------
    MissingChannel, BadFile, NotInformative
        The record cannot be used; the message says why and what to try.
    UsageError
        Arguments that contradict the runs or each other.
    """
    runs = (trials,) if isinstance(trials, Trial) else tuple(trials)
    if not runs:
        raise NotInformative("no run was given to identify from")
    fit = lookup(METHODS, method, "identification method")
    if structure is not None:
        lookup({str(name): name for name in FREE}, structure, "drag structure")
    if loss not in ("linear", "soft_l1"):
        raise UsageError(f"loss '{loss}' is not known; use linear or soft_l1")
    if delay != "auto" and not 0.0 <= float(delay) < 60.0:
        raise UsageError(f"a delay of {delay} s makes no sense: give seconds, 0 or more")
    axis = _common_axis(runs, dof)
    records = [record for run in runs for record in prepare(run, axis)]
    _check_one_input({r.input_name for r in records}, {r.input_unit for r in records})
    return fit(
        Case(
            records=records,
            cycles=_cycles(runs, axis),
            structure=structure,
            delay=None if delay == "auto" else float(delay),
            use=use,
            robust=loss == "soft_l1",
            names=tuple(run.name for run in runs),
            dropped_rows=sum(int(run.meta.get("dropped_rows", 0)) for run in runs),
        )
    )


def _common_axis(runs: Sequence[Trial], dof: str | None) -> Dof:
    if dof is not None:
        return lookup(DOFS, dof, "degree of freedom")
    guesses = [guess_dof(run) for run in runs]
    if any(g != guesses[0] for g in guesses):
        names = ", ".join(f"{r.name}: {g.name}" for r, g in zip(runs, guesses, strict=True))
        raise UsageError(f"the runs are about different degrees of freedom ({names}): give --dof or fewer runs")
    return guesses[0]


def _check_one_input(names: set[str], units: set[str]) -> None:
    if len(names) > 1 or len(units) > 1:
        raise UsageError(
            f"the runs have different inputs ({', '.join(sorted(names))} in {', '.join(sorted(units))}): "
            "identify them one by one"
        )


def _cycles(runs: Sequence[Trial], axis: Dof) -> list[LimitCycle]:
    return [cycle for run in runs for cycle in find_cycles(run, axis)]
