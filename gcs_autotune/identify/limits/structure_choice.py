"""Which terms does a coupled model need? Forms fitted, weighed by criteria and by errors on data left out.

A richer form is preferred to a simpler one only if both speak for it: its Bayesian criterion is lower by more than
:data:`CLEAR`, and it predicts what was left out no worse. :func:`eliminate` walks from a rich form downwards: it drops
the term the fit is least sure of (smallest value over standard error, the Wald statistic), fits again, and keeps the
simpler form unless the loss is justified by that rule.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.identify.coupled.case import CoupledCase
from gcs_autotune.identify.coupled.record import prepare_coupled
from gcs_autotune.identify.limits.evidence import (
    correlation_of,
    cross_validated,
    log_likelihood_of,
    rms_per_signal,
    swings_of,
)
from gcs_autotune.identify.limits.folds import Fold, folds_of
from gcs_autotune.identify.limits.form_verdict import CLEAR, FormChoice, ScoredForm, best, compared, needed, said
from gcs_autotune.identify.limits.sanity import complaints_about
from gcs_autotune.identify.methods import METHODS
from gcs_autotune.identify.result import Fit
from gcs_autotune.identify.validate import validate
from gcs_autotune.models.coupled import CoupledModel, Form
from gcs_autotune.models.coupled.derivatives import RIGID_BODY, inertia_of
from gcs_autotune.registry import lookup
from gcs_autotune.trial import Trial

__all__ = ["CLEAR", "FormChoice", "ScoredForm", "choose_form", "droppable", "eliminate"]

PATIENCE = 2
"""Terms found to be needed after which no better-determined term is tried."""

CERTAIN = 10.0
"""Standard errors from zero at which a term is needed without trial: the criterion would rise by about the square."""


@dataclass(slots=True)
class _Judge:
    """Fits and scores forms on the same runs, folds and correlation time."""

    trials: tuple[Trial, ...]
    method: str
    delay: float | None
    options: Mapping[str, Any]
    folds: tuple[Fold, ...]
    correlation: float = 0.0
    swings: dict[str, float] = field(default_factory=dict)

    def fit(self, form: Form, trials: Sequence[Trial]) -> Fit:
        method = lookup(METHODS, self.method, "identification method")
        if method.coupled is None:
            able = ", ".join(n for n, m in METHODS.items() if m.coupled)
            raise UsageError(f"method '{self.method}' does not fit coupled forms; these do: {able}")
        records = tuple(r for t in trials for r in prepare_coupled(t, form))
        names = tuple(t.name for t in trials)
        return method.coupled(
            CoupledCase(form, records, self.delay, False, names, tuple(trials), options=dict(self.options))
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
            self.correlation, self.swings = correlation_of(traces), swings_of(traces)
        spent = sum(p.status in ("fitted", "at_bound") for p in fit.parameters.values())
        samples = sum(len(t.t) for t in traces)
        tempered = -2.0 * log_likelihood_of(traces) / self.correlation
        per_fold, left_out_rms = cross_validated(
            lambda runs: self.fit(_started(form, fit), runs), self.folds, self.swings
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
    """Fit every form of *forms* and choose.

    Raises
    ------
    UsageError
        No form given, forms with different inputs, a method that fits none.
    NotInformative
        None could be fitted.
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
    """Drop the terms of *form* that these runs do not justify, one at a time, the least certain first.

    Raises
    ------
    UsageError, NotInformative
        As :func:`choose_form`.
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
                f"{weakest} is needed, and what is left with it: {sure:.0f} standard errors from zero or more"
            )
            break
        name = _shorter(now.form.name, weakest)
        simpler = judge.score(_started(now.form, now.fit, name).without(weakest))
        table.append(simpler)
        wanted = needed(now, simpler)
        reasons.append(said(weakest, now, simpler, wanted))
        if wanted:
            kept.add(weakest)
            if len(kept) >= PATIENCE:
                break
        else:
            now = simpler
    return FormChoice(now, tuple(table), tuple(reasons))


def droppable(form: Form) -> tuple[str, ...]:
    """Return the free parameters a form can do without: all but inertias on the diagonal and input gains."""
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
        raise UsageError("a choice of structure needs at least one form and one run")
    if len({tuple(f.inputs) for f in forms}) > 1:
        raise UsageError("the forms have different inputs: they do not answer the same question")
    return _Judge(runs, method, delay, options, folds_of(runs, tuple(forms[0].inputs)))


def _started(form: Form, fit: Fit, name: str = "") -> Form:
    """Return *form* with the search begun where *fit* ended."""
    model = fit.model
    assert isinstance(model, CoupledModel)
    start = {n: model[n] for n in form.free}
    return replace(form, name=name or form.name, start=start, optional=())


def _near(form: Form, table: Sequence[ScoredForm]) -> Form:
    """Return *form* begun from the smallest richer form fitted before it, as it is when there is none."""
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


def _sureness(fit: Fit, name: str) -> float:
    """Return how many standard errors a term is from zero; 0 for what is not determined at all."""
    parameter = fit.parameters[name]
    return abs(parameter.value) / parameter.std if parameter.std > 0.0 else 0.0
