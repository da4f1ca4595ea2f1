"""Compare the numbers of a user-supplied model with the runs.

The result is which numbers are wrong, by how much, and what correcting them gains. All identified causes are in the
model during the comparison, because a missing effect biases a refit. A number is wrong under three conditions:

1. *All numbers together*: the model with its own numbers and the identified causes is less likely than with refitted
   numbers, by more than chance. It also predicts held-out data less well.

2. *Each number*: numbers are reset to the model's values one by one, the least contradicted first. This continues as
   long as the runs permit it (backward elimination by Wald's statistic). The remaining numbers differ by three standard
   errors. These include the standard errors stated in the model's file.

3. *It matters*: the number differs by a fiftieth, and without correction the simulation's error grows by as much.

For another simulator only the output is known. The plain model is fitted to that output and to the runs. Gain, time
constant, delay and trim are compared.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.diagnose.adequacy import correlation_of
from gcs_autotune.diagnose.heldout import HeldOut, gains_of, p_value
from gcs_autotune.diagnose.plain_numbers import CONSTANT, LATE, PLAIN, PlainNumber, command_sizes, plain_numbers
from gcs_autotune.diagnose.question import Key, ModelInQuestion
from gcs_autotune.diagnose.result import Number, Numbers
from gcs_autotune.diagnose.score import LUCK, MATERIAL, error_ratio, is_needed
from gcs_autotune.diagnose.state import SearchState
from gcs_autotune.effects import EFFECTS, DataSummary, EffectInstance, ExtendedModel
from gcs_autotune.identify import ModelFile
from gcs_autotune.identify.problems import Fitted, Problem
from gcs_autotune.models import RIGID_BODY, SPECIAL, CoupledModel, Form, unit_of
from gcs_autotune.rounding import HALF_WIDTH
from gcs_autotune.sname import DOFS

__all__ = ["ModelInQuestion", "if_precise", "judge_numbers", "model_in_question"]

Array = NDArray[np.float64]

SURE, BORNE = 3.0, 2.0
"""Limits in standard errors.

SURE: difference from which a number counts as wrong. BORNE: difference up to which the runs permit the model's value.
"""

OFF = 0.02
"""Least relative difference from which a number counts as wrong."""


def model_in_question(model: ExtendedModel | ModelFile) -> ModelInQuestion:
    """Return a model with the names of its owner's file.

    A file of one degree of freedom calls the inertia ``alpha``, with positive sign.
    """
    if isinstance(model, ExtendedModel):
        return ModelInQuestion(_to_be_judged(model))
    std = {n: math.sqrt(max(v, 0.0)) for n, v in zip(model.names, np.diag(model.covariance).tolist(), strict=True)}
    if model.axis is None:
        return ModelInQuestion(_to_be_judged(model.model), {}, std)
    names: dict[Key, tuple[str, float]] = {
        ("", "", own): written for own, written in model.written_as.items() if own != "delay"
    }
    names |= {(e.slug, e.place, "delay"): ("delay", 1.0) for e in model.model.effects}
    return ModelInQuestion(model.model, names, std)


def _to_be_judged(model: ExtendedModel) -> ExtendedModel:
    """Return a model whose file fixes every number with all of them free, because all are in question.

    Only the sum of rigid-body and added mass acts. The rigid-body mass stays fixed if the file has an added mass.
    """
    form = model.base.form
    if form.free:
        return model
    gains = {g.lstrip("-") for pairs in form.inputs.values() for _, g in pairs if isinstance(g, str)}
    forces = [n for n in form.known if n not in RIGID_BODY and n not in SPECIAL and n not in gains]
    added = any(n.endswith("dot") for n in forces)
    free = [*forces, *(n for n in form.known if not added and n in ("m", "I_x", "I_y", "I_z"))]
    return replace(model, base=CoupledModel(form.freeing(*free), {**form.known, **model.base.values}))


@dataclass(frozen=True, slots=True, eq=False)
class _Weighing:
    """The comparison of the model's values (``old``) with the runs, given the causes of a finished search."""

    state: SearchState
    given: ModelInQuestion
    old: Mapping[Key, float]
    raised: float

    def values(self, fit: Fitted) -> dict[Key, tuple[float, float]]:
        """Return the fitted values, with standard errors, of those numbers that the model in question has."""
        std = np.sqrt(np.maximum(np.diag(fit.covariance(self.raised)), 0.0)).tolist()
        keys: list[Key] = [("", "", n) for n in fit.free]
        keys += [(fit.effects[i].slug, fit.effects[i].place, n) for i, n in fit.free_effects]
        triples = zip(keys, fit.shared.tolist(), std, strict=False)
        return {key: (value, s) for key, value, s in triples if key in self.old}

    def fitted(self, free: Sequence[Key], begin: Fitted) -> tuple[Problem, Fitted | None]:
        """Return the fit in which all numbers except *free* keep the model's values. Identified causes are
        always fitted.
        """
        problem = self.state.problem
        held = [key for key in self.old if key not in free]
        names = [n for n in problem.free if ("", "", n) not in held]
        alone = problem.holding(names, [key for key in held if key[0]])
        theta = begin.theta.copy()
        for _, _, name in (key for key in held if not key[0]):
            theta[begin.form.parameters.index(name)] = self.old["", "", name]
        effects = tuple(
            e.with_values({k[2]: self.old[k] for k in held if k[:2] == (e.slug, e.place)}) for e in begin.effects
        )
        return alone, alone.fit(theta, effects, begin.initial, shift=begin.shift)

    def contradicted(self) -> tuple[Problem, Fitted, dict[Key, float]]:
        """Return the fit in which only the numbers that the runs contradict are fitted.

        Also return by how much minus twice the log-likelihood rises if one of these is reset and the others are
        refitted. For a number determined only by curvature, Wald's statistic is not reliable.
        """
        problem, fit = self.state.problem, self.state.fitted
        free = list(self.values(fit))
        while True:
            z = {key: abs(v - self.old[key]) / max(s, 1e-300) for key, (v, s) in self.values(fit).items()}
            rises: dict[Key, float] = {}
            for key in sorted(free, key=lambda k: z.get(k, 0.0)):
                alone, other = self.fitted([k for k in free if k != key], fit)
                rises[key] = math.inf if other is None else other.cost - fit.cost
                if other is not None and rises[key] / self.raised < BORNE**2:
                    free.remove(key)
                    problem, fit = alone, other
                    break
            else:
                return problem, fit, rises

    def row(self, key: Key, value: float, std: float, rise: float) -> Number:
        """Return the comparison of one number.

        rise : increase of minus twice the log-likelihood if the model's own value is kept.
        """
        data_summary, fit = self.state.problem.data_summary, self.state.fitted
        name, sign = self.given.names.get(key, (_label(key), 1.0))
        stated, old = self.given.std.get(name, 0.0), self.old[key]
        clear = rise / self.raised > SURE**2 and abs(value - old) > max(SURE * stated, OFF * abs(old))
        matters = rise > 2.0 * fit.samples * math.log1p(MATERIAL)
        unit, meaning = _unit(key, data_summary, fit.form), _meaning(key, fit.form)
        return _number(name, unit, meaning, (sign * old, stated), (sign * value, std), clear and matters)


def judge_numbers(state: SearchState) -> SearchState | None:
    """Return the comparison of the numbers of the model in question with the runs; None if no model was supplied.

    Wrong numbers are corrected in the present model. The other numbers keep their supplied values.
    """
    given = state.question.given
    if given is None:
        return None
    base = given.model.base
    old: dict[Key, float] = {("", "", n): base[n] for n in state.problem.free}
    old |= {
        (e.slug, e.place, n): v
        for e in given.model.effects
        if not EFFECTS[e.slug].is_disturbance
        for n, v in e.values.items()
        if n not in EFFECTS[e.slug].fixed
    }
    weighing = _Weighing(state, given, old, correlation_of(state.fitted))
    full = weighing.values(state.fitted)
    of: Literal["model", "simulation"] = "model" if given.theirs is None else "simulation"
    problem, fit, rises = state.problem, state.fitted, dict.fromkeys(full, math.inf)
    if of == "model":
        problem, fit, rises = weighing.contradicted()
    off = _with_own_numbers(weighing, problem, fit)
    freed = weighing.values(fit)
    if given.theirs is None:
        rises = rises if off is not None else {}
        rows = [weighing.row(k, *(freed.get(k) or full[k]), rises.get(k, 0.0)) for k in full]
    else:
        rows = _as_plain(weighing, judged=off is not None)
    causes = len(fit.effects) > len(state.base.effects)
    if off is None or not any(r.wrong for r in rows):
        now, over = _counted_over(state, state.base_unseen) if causes else (state, _FITTED)
        agreeing = tuple(replace(r, wrong=False) for r in rows)
        return replace(now, numbers=Numbers(of, (*given.records, *agreeing), over=over))
    right = _better(state.base_unseen, _set_right(state, problem)) if causes else off
    gains = () if state.given_unseen is None else gains_of(state.given_unseen, right, state.parts.words)
    now, over = _counted_over(state, right) if causes else (state, _FITTED)
    numbers = Numbers(of, (*given.records, *sorted(rows, key=lambda r: not r.wrong)), gains, over)
    return replace(now, problem=problem, fitted=fit, present_unseen=off, numbers=numbers)


_Over = Literal["given", "fitted"]
_FITTED: _Over = "fitted"


def _set_right(state: SearchState, problem: Problem) -> HeldOut | None:
    """Return the held-out residuals of the model without any cause, with only the numbers that are free in *problem*.

    If an unmodelled effect distorts the runs, a fit of all numbers may predict worse than a fit of the few wrong ones.
    """
    base = state.base
    alone = problem.fit(base.theta, base.effects, base.initial, shift=base.shift)
    return None if alone is None else state.unseen(alone, problem=problem)


def _better(one: HeldOut, other: HeldOut | None) -> HeldOut:
    if other is None or not other.complete:
        return one
    return other if not one.complete or error_ratio(one, other) < 1.0 else one


def _counted_over(state: SearchState, right: HeldOut) -> tuple[SearchState, _Over]:
    """Limit the gain of the causes to their improvement over the better of two models.

    These are the model as given, and the model with corrected numbers (*right*). Return the state and which of the two
    is better.
    """
    given = state.given_unseen
    unseen = right if given is None else _better(right, given)
    return replace(state, base_unseen=unseen), "fitted" if unseen is right else "given"


def _with_own_numbers(weighing: _Weighing, problem: Problem, fit: Fitted) -> HeldOut | None:
    """Return the held-out residuals of *fit* if the model's own numbers are significantly worse; otherwise None."""
    state = weighing.state
    free = weighing.values(fit)
    if not free:
        return None
    alone, kept = weighing.fitted([], fit)
    after = state.unseen(fit, problem=problem)
    if kept is None:
        return after
    if not is_needed((kept.cost - fit.cost) / weighing.raised, fit, kept, 1) or not after.complete:
        return None
    before = state.unseen(kept, problem=alone)
    if not before.complete:
        return after
    gain = 1.0 - error_ratio(before, after)
    sure = p_value(before, after, fit.levels, weighing.raised, kept.parameters, len(weighing.old)) < LUCK
    sure = sure or _less_of_all(before, after)
    return after if sure and -len(fit.levels) * math.log1p(-min(gain, 0.999)) > MATERIAL else None


def _less_of_all(before: HeldOut, after: HeldOut) -> bool:
    """Return whether the 95 % interval of the error ratio lies below one for every signal.

    If causes fit the runs better than they predict them, the likelihood at the fit's noise levels cannot show a
    reduction of much larger errors. A bootstrap over blocks can.
    """
    ratios = [g.ci95[1] for g in gains_of(before, after, "")]
    return bool(ratios) and all(r < 1.0 - MATERIAL for r in ratios)


def _label(key: Key) -> str:
    slug, place, name = key
    return EffectInstance(slug, place, {}).label_of(name) if slug else name


def _unit(key: Key, data_summary: DataSummary, form: Form) -> str:
    slug, place, name = key
    if slug:
        return EFFECTS[slug].unit_of(name, place, data_summary)
    return unit_of(name, data_summary.inputs, normalised=form.normalised or set(data_summary.inputs.values()) == {"1"})


def _meaning(key: Key, form: Form) -> str:
    slug, place, name = key
    if slug:
        return f"{slug.replace('-', ' ')} on {place}: {name.replace('_', ' ')}"
    dof = next((d for d in form.dofs if name.startswith(DOFS[d].force + "_")), "")
    nu = DOFS[dof].velocity if dof else ""
    kinds = {f"{nu}dot": "inertia", nu: "linear drag", 2 * nu: "quadratic drag", "0": "constant force"}
    kind = kinds.get(name[2:], "") if dof else ""
    return f"{kind} in {dof}" if kind else ""


def _number(
    name: str, unit: str, meaning: str, old: tuple[float, float], new: tuple[float, float], wrong: bool
) -> Number:
    half = HALF_WIDTH * new[1]
    return Number(name, unit, meaning, old[0], old[1], new[0], new[1], (new[0] - half, new[0] + half), wrong)


# -- an external simulator as the plain model


def _as_plain(weighing: _Weighing, *, judged: bool) -> list[Number]:
    """Compare gain, time constant, delay and trim of the simulator with the runs, then the effects that both have.

    A number is wrong if it differs both with and without the identified causes. A difference that a cause explains is
    attributed to the cause.
    """
    state, given = weighing.state, weighing.given
    if given.theirs is None:
        return []
    causes = state.causes
    data, sizes = state.problem.data_summary, command_sizes(state.problem.form, state.problem.segments)
    theirs = plain_numbers(*given.theirs, sizes)
    ours = plain_numbers(state.problem, state.fitted, sizes, [(e.slug, e.place) for e in causes])
    named = {e.slug for e in causes}
    least = {"gain": 0.0, "time constant": 0.0, "delay": OFF * data.time_constant, "trim": 0.0}
    rows = []
    for (kind, where), new in ours.items():
        if (kind, where) not in theirs:
            continue
        old = theirs[kind, where]
        related_causes = {"delay": LATE, "trim": CONSTANT}.get(kind, frozenset()) & named
        floor = OFF * data.amplitude.get(where, 0.0) if kind == "trim" else least[kind]
        ways = {_off(old, value, std, floor) for value, std in ((new.value, new.std), new.beside)}
        wrong = judged and not related_causes and len(ways) == 1 and ways != {0}
        differs = abs(new.value - old.value) > SURE * math.hypot(old.std, new.std)
        explained = (bool(related_causes) and differs) or len(ways) > 1
        scale = {"delay": data.time_constant, "trim": data.amplitude.get(where, 0.0)}.get(kind, 0.0)
        old_estimate, new_estimate = (if_precise(n.value, n.std, scale or abs(n.value)) for n in (old, new))
        number = _number(f"{kind} of {where}", new.unit, PLAIN[kind], old_estimate, new_estimate, wrong)
        rows.append(replace(number, explained=explained))
    keys = [(e.slug, e.place) for e in given.model.effects]
    for effect in state.fitted.effects:
        if (effect.slug, effect.place) not in keys or effect.slug in READ_OFF:
            continue
        former = given.model.effects[keys.index((effect.slug, effect.place))]
        alone = replace(weighing, old={(effect.slug, effect.place, n): v for n, v in former.values.items()})
        for key, (value, s) in alone.values(state.fitted).items():
            z = (value - alone.old[key]) / max(s, 1e-300)
            rows.append(alone.row(key, value, s, alone.raised * z**2 if judged else 0.0))
    return rows


READ_OFF = frozenset({"input-delay", "input-bias", "net-buoyancy", "quadratic-drag"})
"""Effects of the surrogate model that gain, time constant, delay and trim already describe."""


def if_precise(value: float, std: float, scale: float) -> tuple[float, float]:
    """Return a number and its standard error; NaN if its interval is wider than *scale*."""
    return (value, std) if HALF_WIDTH * std <= scale else (math.nan, math.nan)


def _off(old: PlainNumber, value: float, std: float, least: float) -> int:
    """Return whether the simulator's number is too large (1) or too small (-1) for the runs; 0 if neither is certain.

    Without the causes the craft may have no drag, and so no finite gain or time constant. The simulator's number then
    counts as too small.
    """
    if not math.isfinite(value):
        return -1
    limit = max(SURE * math.hypot(old.std, std), OFF * abs(old.value), least)
    return 0 if abs(value - old.value) <= limit else int(math.copysign(1.0, old.value - value))
