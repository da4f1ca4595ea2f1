"""What is known of a form that was tried, when a term is needed, and the sentences that say so."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.result import Fit
from gcs_autotune.models.coupled import Form
from gcs_autotune.sname import SIGNALS

__all__ = ["CLEAR", "FormChoice", "ScoredForm", "best", "compared", "needed", "said"]

CLEAR = 2.0
"""Difference of the Bayesian criterion below which nothing is decided (Kass1995)."""


@dataclass(frozen=True, slots=True, eq=False)
class ScoredForm:
    """One form and what speaks for and against it.

    ``parameters`` fitted; ``fit_percent`` of the free run on the runs fitted; ``left_out`` error on data left out,
    in shares of the signals' swings, mean over folds, ``per_fold`` likewise; ``left_out_rms`` per signal [SI];
    ``complaints`` what is unphysical in it. ``fit`` None: it could not be fitted.
    """

    form: Form
    fit: Fit | None
    parameters: int
    fit_percent: float
    log_likelihood: float
    aic: float
    bic: float
    left_out: float
    per_fold: tuple[float, ...]
    left_out_rms: Mapping[str, float]
    rms: Mapping[str, float]
    complaints: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers as plain data."""
        return {
            "form": self.form.name,
            "free": list(self.form.free),
            "parameters": self.parameters,
            "fit_percent": self.fit_percent,
            "log_likelihood": self.log_likelihood,
            "aic": self.aic,
            "bic": self.bic,
            "left_out": self.left_out,
            "left_out_rms": dict(self.left_out_rms),
            "complaints": list(self.complaints),
        }


@dataclass(frozen=True, slots=True, eq=False)
class FormChoice:
    """The verdict over all forms tried: ``chosen``, and ``reasons`` one sentence per rival or term dropped."""

    chosen: ScoredForm
    table: tuple[ScoredForm, ...]
    reasons: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return verdict and table as plain data."""
        rows = [row.to_dict() for row in self.table]
        return {"chosen": self.chosen.form.name, "reasons": list(self.reasons), "table": rows}


def needed(richer: ScoredForm, simpler: ScoredForm) -> bool:
    """Whether both the criterion and what was left out speak for the richer form."""
    if simpler.fit is None:
        return True
    if len(simpler.complaints) > len(richer.complaints):
        return True
    return simpler.bic - richer.bic > CLEAR and not richer.left_out > simpler.left_out


def best(table: Sequence[ScoredForm]) -> ScoredForm:
    """Return the form of least criterion among those that are physical, or a simpler one if it is hardly worse.

    Raises
    ------
    NotInformative
        None could be fitted.
    """
    fitted = [row for row in table if row.fit is not None]
    if not fitted:
        raise NotInformative(f"no form could be fitted: {table[0].complaints[0]}")
    sane = [row for row in fitted if not row.complaints] or fitted
    least = min(sane, key=lambda row: row.bic)
    for row in sorted(sane, key=lambda row: row.parameters):
        if row.parameters < least.parameters and not needed(least, row):
            return row
    return least


def said(term: str, richer: ScoredForm, simpler: ScoredForm, wanted: bool) -> str:
    """Return why *term*, which *simpler* lacks, is needed or not."""
    verdict = "is needed" if wanted else "is not needed"
    return f"{term} {verdict}: {_numbers(richer, simpler)}"


def compared(chosen: ScoredForm, other: ScoredForm) -> str:
    """Return why *chosen* and not *other*."""
    if other.fit is None:
        return f"'{other.form.name}' {other.complaints[0]}"
    richer, simpler = (chosen, other) if chosen.parameters >= other.parameters else (other, chosen)
    extra = [n for n in richer.form.free if n not in simpler.form.free]
    told = f"{', '.join(extra)} ({'needed' if richer is chosen else 'not needed'}): " if extra else ""
    bad = f"; '{other.form.name}': {', '.join(other.complaints)}" if other.complaints else ""
    return f"'{chosen.form.name}' rather than '{other.form.name}': {told}{_numbers(richer, simpler)}{bad}"


def _numbers(richer: ScoredForm, simpler: ScoredForm) -> str:
    """Return the comparison in numbers: error on data left out in the worst signal's unit, and the criterion."""
    if simpler.fit is None:
        return f"without it the form {simpler.complaints[0]}"
    both = [n for n in richer.left_out_rms if n in simpler.left_out_rms]
    said = ""
    if both:
        name = max(both, key=lambda n: abs(math.log(max(simpler.left_out_rms[n], 1e-300) / richer.left_out_rms[n])))
        unit = SIGNALS[name][0]
        scale, unit = (180.0 / math.pi, unit.replace("rad", "deg")) if "rad" in unit else (1.0, unit)
        one, other = (scale * row.left_out_rms[name] for row in (simpler, richer))
        said = f"error on data left out {one:.3g} {unit} of {name} without, {other:.3g} with, "
    return f"{said}BIC {simpler.bic - richer.bic:+.1f} without"
