"""Select the drag law of one degree of freedom by three criteria: two experiments (Miskovic2010), BIC, held-out error.

The fit contains the two-experiment decision (Miskovic2010 (7.1)-(7.2)) and the Bayesian criterion of its candidates.
This module adds the free-run error on left-out runs (or blocks of one run).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np

from gcs_autotune.experiments.cross_validation import amplitudes_of, cross_validated, folds_of
from gcs_autotune.identify import DAMPING, AxisFit, Decision, Structure, fit_axis, structure_of, validate
from gcs_autotune.notebook import Displayed
from gcs_autotune.sname import signal_meaning
from gcs_autotune.trial import Trial

__all__ = ["AxisChoice", "ScoredDrag", "weigh_drags"]

ALIKE = 0.02
"""Relative difference of held-out errors below which they count as equal. Project choice."""


@dataclass(frozen=True, slots=True)
class ScoredDrag:
    """One drag structure with its information criterion (NaN if the method has none) and its held-out rms error
    [SI].
    """

    structure: Structure
    bic: float
    left_out: float
    per_fold: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class AxisChoice(Displayed):
    """The drag structure of a fit, and the result of each criterion.

    ``signal``: name of the signal for which the held-out errors are calculated.
    """

    chosen: Structure
    decision: Decision | None
    table: tuple[ScoredDrag, ...]
    signal: str
    reasons: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the choice as data for JSON."""
        rows = [{"structure": r.structure, "bic": r.bic, "left_out": r.left_out} for r in self.table]
        verdict = None if self.decision is None else self.decision.verdict
        return {
            "chosen": self.chosen,
            "two_experiments": verdict,
            "signal": self.signal,
            "table": rows,
            "reasons": list(self.reasons),
        }


def weigh_drags(fit: AxisFit, trials: Trial | Sequence[Trial]) -> AxisChoice:
    """Return the scores of each drag structure, with the structure that *fit* has.

    Every structure is fitted by output error, with the delay of *fit*, to all runs but one (or to three quarters of a
    single run). The data left out are then simulated freely.

    Raises
    ------
    NotInformative
        :func:`gcs_autotune.identify.free_run.validate` raised the error.
    """
    runs = (trials,) if isinstance(trials, Trial) else tuple(trials)
    traces = validate(fit.model, runs).traces
    amplitudes = amplitudes_of(traces)
    signal = traces[0].signal
    folds = folds_of(runs, (*(d for d in ("delta", fit.model.axis.force)),))
    bic = {c.structure: c.bic for c in fit.candidates}
    table = []
    for structure in get_args(Structure):

        def refit(train: Sequence[Trial], structure: Structure = structure) -> AxisFit:
            return fit_axis(train, dof=fit.dof, structure=structure, delay=fit.model.delay)

        per_fold, rms = cross_validated(refit, folds, amplitudes)
        broken = any(math.isinf(e) for e in per_fold)
        left_out = math.inf if broken or not rms else rms[signal]
        table.append(ScoredDrag(structure, bic.get(structure, math.nan), left_out, tuple(per_fold)))
    parts = f"{len(folds)} parts of the run" if len(runs) == 1 else "runs"
    reasons = _reasons(fit, table, signal, parts)
    return AxisChoice(structure_of(fit.structure), fit.decision, tuple(table), signal, reasons)


def _reasons(fit: AxisFit, table: Sequence[ScoredDrag], signal: str, parts: str) -> tuple[str, ...]:
    reasons = []
    if fit.decision is not None:
        d = fit.decision
        verdict = "undecided" if d.verdict == "undecided" else f"indicates {DAMPING[d.verdict]}"
        reasons.append(
            f"two experiments (Miskovic2010, 7.2): the linear damping differs by {d.sigma_beta:.1f} %, the quadratic "
            f"by {d.sigma_beta_quadratic:.1f} % (margin {d.margin:.1f} %): {verdict}"
        )
    best = min(table, key=lambda row: row.left_out)
    own = next(row for row in table if row.structure == fit.structure)
    seen = f"{signal_meaning(signal, fit.dof).split(',')[0]}, delay {fit.model.delay:.2g} s"
    what = f"{parts} held out in turn ({seen})"
    if not math.isfinite(best.left_out):
        reasons.append(f"{what}: not each can be predicted from the others")
    elif best.left_out < (1.0 - ALIKE) * own.left_out:
        reasons.append(f"{what}: {DAMPING[best.structure]} predicts better than {DAMPING[own.structure]}")
    else:
        how = "best" if best is own else f"about as well as {DAMPING[best.structure]}"
        reasons.append(f"{what}: {DAMPING[own.structure]} predicts {how}")
    known = [row for row in table if np.isfinite(row.bic)]
    if known:
        reasons.append(
            f"Bayesian information criterion (BIC): best with {DAMPING[min(known, key=lambda row: row.bic).structure]}"
        )
        if own.bic <= min(row.bic for row in known) and best.left_out < (1.0 - ALIKE) * own.left_out:
            reasons.append("the criteria disagree, so treat the choice as uncertain. More runs can decide it")
    return tuple(reasons)
