"""Select the terms of a coupled model: forms are compared by information criteria and held-out errors.

A richer form is preferred to a simpler one under two conditions. Its Bayesian criterion must be lower by more than
:data:`CLEAR`, and its held-out error must not be larger. :func:`eliminate` starts with a rich form. It drops the least
certain term (smallest value over standard error, the Wald statistic) and fits again. The simpler form is kept unless
these conditions support the richer form. An unphysical form ranks below all physical ones.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.experiments.cross_validation import (
    Fold,
    amplitudes_of,
    correlation_of,
    cross_validated,
    folds_of,
    log_likelihood_of,
    rms_per_signal,
)
from gcs_autotune.identify import METHODS, Case, Fit, Model, validate
from gcs_autotune.identify.problems import Limits
from gcs_autotune.identify.signals import prepare_form
from gcs_autotune.models import RIGID_BODY, CoupledModel, Form, inertia_of
from gcs_autotune.notebook import Displayed
from gcs_autotune.registry import lookup
from gcs_autotune.sname import SIGNALS
from gcs_autotune.trial import Trial

__all__ = [
    "CLEAR",
    "FormChoice",
    "ScoredForm",
    "best",
    "choose_form",
    "compared",
    "complaints_about",
    "droppable",
    "eliminate",
    "needed",
    "term_verdict",
]

SURE = 3.0
"""Number of standard errors below zero from which negative damping is reported. Project choice."""


def complaints_about(fit: Fit[Model]) -> tuple[str, ...]:
    """Return sentences on unphysical values in *fit*: inertia that is not positive, and negative damping.

    Inertia must be symmetric positive definite (Fossen2011, (3.54)), and a craft's own drag must damp. Sway may drive
    yaw, so only the diagonal of the damping is checked.
    """
    model = fit.model
    if not isinstance(model, CoupledModel):
        return ()
    found = []
    M = model.inertia
    if float(np.linalg.eigvalsh(0.5 * (M + M.T)).min()) <= 0.0:
        found.append("its inertia is not positive")
    for name in Limits.physical(model.form).high:
        parameter = fit.parameters.get(name)
        if inertia_of(name) is None and parameter is not None and parameter.value > SURE * parameter.std:
            found.append(f"{name} is a negative damping")
    return tuple(found)


CLEAR = 2.0
"""Difference of BIC below which neither form is preferred (Kass1995)."""


@dataclass(frozen=True, slots=True, eq=False)
class ScoredForm:
    """One form with its scores.

    - ``fit``: the fit, None if the form could not be fitted.
    - ``parameters``: number of fitted parameters.
    - ``fit_percent``: fit of the free run on the fitted runs [%].
    - ``left_out``: held-out error relative to the signals' ranges, mean over folds.
    - ``per_fold``: held-out error relative to the signals' ranges, for each fold.
    - ``left_out_rms``: name of the signal -> held-out rms error [SI].
    - ``complaints``: sentences on unphysical values of the fit.
    """

    form: Form
    fit: Fit[Model] | None
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
        """Return the scores as data for JSON."""
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
class FormChoice(Displayed):
    """The selection among all forms that were tried.

    - ``chosen``: the selected form with its scores.
    - ``table``: all forms with their scores.
    - ``reasons``: one sentence per form that was not selected, or per dropped term.
    """

    chosen: ScoredForm
    table: tuple[ScoredForm, ...]
    reasons: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the selection and the table as data for JSON."""
        rows = [row.to_dict() for row in self.table]
        return {"chosen": self.chosen.form.name, "reasons": list(self.reasons), "table": rows}


def needed(richer: ScoredForm, simpler: ScoredForm) -> bool:
    """Return whether the Bayesian criterion and the held-out error both support the *richer* form."""
    if simpler.fit is None:
        return True
    if len(simpler.complaints) > len(richer.complaints):
        return True
    return simpler.bic - richer.bic > CLEAR and not richer.left_out > simpler.left_out


def best(table: Sequence[ScoredForm]) -> ScoredForm:
    """Return the physical form with the smallest Bayesian criterion, or a simpler form whose criterion is hardly
    larger.

    Raises
    ------
    NotInformative
        No form could be fitted.
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


def term_verdict(term: str, richer: ScoredForm, simpler: ScoredForm, wanted: bool) -> str:
    """Return a sentence why *term*, which *simpler* lacks, is needed or not."""
    verdict = "is needed" if wanted else "is not supported by the data"
    return f"{term} {verdict}: {_numbers(richer, simpler)}"


def compared(chosen: ScoredForm, other: ScoredForm) -> str:
    """Return a sentence why *chosen* was selected instead of *other*."""
    if other.fit is None:
        return f"'{other.form.name}' {other.complaints[0]}"
    richer, simpler = (chosen, other) if chosen.parameters >= other.parameters else (other, chosen)
    extra = [n for n in richer.form.free if n not in simpler.form.free]
    terms = f"{', '.join(extra)} ({'needed' if richer is chosen else 'not needed'}): " if extra else ""
    bad = f"; '{other.form.name}': {', '.join(other.complaints)}" if other.complaints else ""
    return f"'{chosen.form.name}' instead of '{other.form.name}': {terms}{_numbers(richer, simpler)}{bad}"


def _numbers(richer: ScoredForm, simpler: ScoredForm) -> str:
    """Return the comparison in numbers: the held-out error in the worst signal's unit, and the criterion."""
    if simpler.fit is None:
        return f"without it, {simpler.complaints[0]}"
    both = [n for n in richer.left_out_rms if n in simpler.left_out_rms]
    held_out = ""
    if both:
        name = max(both, key=lambda n: abs(math.log(max(simpler.left_out_rms[n], 1e-300) / richer.left_out_rms[n])))
        unit = SIGNALS[name][0]
        scale, unit = (180.0 / math.pi, unit.replace("rad", "deg")) if "rad" in unit else (1.0, unit)
        one, other = (scale * row.left_out_rms[name] for row in (simpler, richer))
        held_out = f"held-out error of {name} {one:.3g} {unit} without it, {other:.3g} with it; "
    return f"{held_out}BIC {simpler.bic - richer.bic:+.1f} without it"


PATIENCE = 2
"""Number of needed terms after which no better-determined term is tried. Project choice."""

CERTAIN = 10.0
"""Distance of a parameter from zero, in standard errors, above which its term is needed without a trial.

Project choice. Without the term, the criterion would increase by about the square.
"""


@dataclass(slots=True)
class _Judge:
    """Fit and score forms on the same runs, folds and correlation time."""

    trials: tuple[Trial, ...]
    method: str
    delay: float | None
    options: Mapping[str, Any]
    folds: tuple[Fold, ...]
    correlation: float = 0.0
    amplitudes: dict[str, float] = field(default_factory=dict)

    def fit(self, form: Form, trials: Sequence[Trial]) -> Fit[Model]:
        method = lookup(METHODS, self.method, "identification method")
        if method.coupled is None:
            able = ", ".join(n for n, m in METHODS.items() if m.coupled)
            raise UsageError(f"method '{self.method}' does not fit coupled forms. Use one of: {able}")
        records = tuple(r for t in trials for r in prepare_form(t, form))
        names = tuple(t.name for t in trials)
        return method.coupled(
            Case(
                form=form,
                records=records,
                delay=self.delay,
                names=names,
                trials=tuple(trials),
                options=dict(self.options),
            )
        )

    def score(self, form: Form) -> ScoredForm:
        try:
            fit = self.fit(form, self.trials)
            traces = validate(fit.model, self.trials).traces
        except NotInformative as error:
            nothing: dict[str, float] = {}
            bad = (f"could not be fitted: {error}",)
            return ScoredForm(
                form, None, len(form.free), math.nan, -math.inf, math.inf, math.inf, math.inf, (), nothing, nothing, bad
            )
        if not self.correlation:
            self.correlation, self.amplitudes = correlation_of(traces), amplitudes_of(traces)
        spent = sum(p.status in ("fitted", "at_bound") for p in fit.parameters.values())
        samples = sum(len(t.t) for t in traces)
        tempered = -2.0 * log_likelihood_of(traces) / self.correlation
        per_fold, left_out_rms = cross_validated(
            lambda runs: self.fit(_started(form, fit), runs), self.folds, self.amplitudes
        )
        return ScoredForm(
            form=form,
            fit=fit,
            parameters=spent,
            fit_percent=fit.fit_percent,
            log_likelihood=-0.5 * tempered * self.correlation,
            aic=tempered + 2.0 * spent,
            bic=tempered + spent * math.log(max(samples / self.correlation, 2.0)),
            left_out=float(np.mean(per_fold)) if per_fold else math.nan,
            per_fold=tuple(per_fold),
            left_out_rms=left_out_rms,
            rms=rms_per_signal(traces),
            complaints=complaints_about(fit),
        )


def choose_form(
    trials: Trial | Sequence[Trial],
    forms: Sequence[Form],
    method: str = "output-error",
    *,
    delay: float | None = 0.0,
    **options: Any,
) -> FormChoice:
    """Return the selection among *forms*, after fitting each of them.

    Raises
    ------
    UsageError
        No form was supplied, the forms have different inputs, or the method fits none of them.
    NotInformative
        No form could be fitted.
    """
    judge = _judge(trials, forms, method, delay, options)
    table: list[ScoredForm] = []
    for form in sorted(forms, key=lambda f: -len(f.free)):
        table.append(judge.score(_near(form, table)))
    chosen = best(table)
    reasons = [compared(chosen, other) for other in table if other is not chosen]
    return FormChoice(chosen, tuple(table), tuple(reasons))


def eliminate(
    trials: Trial | Sequence[Trial],
    form: Form,
    method: str = "output-error",
    *,
    delay: float | None = 0.0,
    **options: Any,
) -> FormChoice:
    """Return the form that remains after dropping the terms of *form* that *trials* do not support, with all steps.

    One term is dropped at a time, the least certain first.

    Raises
    ------
    UsageError, NotInformative
        Exceptions are those of :func:`choose_form`.
    """
    judge = _judge(trials, [form], method, delay, options)
    now = judge.score(form)
    if now.fit is None:
        raise NotInformative(f"'{form.name}' {now.complaints[0]}")
    table, reasons, kept = [now], [], set[str]()
    while True:
        weakest = _weakest(now, kept)
        if weakest is None:
            break
        assert now.fit is not None
        sure = _sureness(now.fit, weakest)
        if sure > CERTAIN:
            reasons.append(
                f"all remaining terms are needed: {weakest} is the weakest, {sure:.0f} standard errors from zero"
            )
            break
        name = _shorter(now.form.name, weakest)
        simpler = judge.score(_started(now.form, now.fit, name).without(weakest))
        table.append(simpler)
        wanted = needed(now, simpler)
        reasons.append(term_verdict(weakest, now, simpler, wanted))
        if wanted:
            kept.add(weakest)
            if len(kept) >= PATIENCE:
                break
        else:
            now = simpler
    return FormChoice(now, tuple(table), tuple(reasons))


def droppable(form: Form) -> tuple[str, ...]:
    """Return the names of the free parameters that may be dropped from *form*: all except diagonal inertias and
    input gains.
    """
    gains = {g.lstrip("-") for pairs in form.inputs.values() for _, g in pairs if isinstance(g, str)}
    kept = set(RIGID_BODY) | gains
    found = []
    for name in form.free:
        inertia = inertia_of(name) if name not in kept and "_" in name else None
        if name not in kept and not (inertia is not None and inertia.row == inertia.column):
            found.append(name)
    return tuple(found)


def _judge(
    trials: Trial | Sequence[Trial], forms: Sequence[Form], method: str, delay: float | None, options: Mapping[str, Any]
) -> _Judge:
    runs = (trials,) if isinstance(trials, Trial) else tuple(trials)
    if not forms or not runs:
        raise UsageError("a structure is chosen from at least one form and one run. Give both")
    if len({tuple(f.inputs) for f in forms}) > 1:
        raise UsageError("the forms have different inputs and cannot be compared. Use forms with the same inputs")
    return _Judge(runs, method, delay, options, folds_of(runs, tuple(forms[0].inputs)))


def _started(form: Form, fit: Fit[Model], name: str = "") -> Form:
    """Return *form* with the result of *fit* as start values."""
    model = fit.model
    assert isinstance(model, CoupledModel)
    start = {n: model[n] for n in form.free}
    return replace(form, name=name or form.name, start=start, optional=())


def _near(form: Form, table: Sequence[ScoredForm]) -> Form:
    """Return *form* with start values from the smallest richer form fitted before; unchanged if there is none."""
    for row in reversed(table):
        alike = row.form.inputs == form.inputs and row.form.known == form.known
        if row.fit is not None and alike and set(form.free) <= set(row.form.free):
            return _started(form, row.fit)
    return form


def _shorter(name: str, dropped: str) -> str:
    return f"{name} {dropped}" if " - " in name else f"{name} - {dropped}"


def _weakest(scored: ScoredForm, kept: set[str]) -> str | None:
    assert scored.fit is not None
    sure = {name: _sureness(scored.fit, name) for name in droppable(scored.form) if name not in kept}
    return min(sure, key=lambda n: sure[n]) if sure else None


def _sureness(fit: Fit[Model], name: str) -> float:
    """Return the distance of a term from zero in standard errors; 0 for a term that is not determined."""
    parameter = fit.parameters[name]
    return abs(parameter.value) / parameter.std if parameter.std > 0.0 else 0.0
