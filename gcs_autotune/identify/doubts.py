"""Reasons not to trust an identification: one table, with a condition, a sentence and a remedy for each doubt.

A method calls :func:`doubts_about` with what it knows: :class:`Findings` for one axis, a ``Solution``, and the objects
that record its choices and comparisons. To add a doubt, add a row to :data:`DOUBTS`. Doubts of a single method
(innovations of a filter) are in that method's module, and those about raw runs in ``signals``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from gcs_autotune import chi_square
from gcs_autotune.effects import EFFECTS, effect_at, parameter_words
from gcs_autotune.identify.axis.evidence import UNDECIDED
from gcs_autotune.identify.axis.form import ExplicitForm, Structure
from gcs_autotune.identify.axis.run_comparison import RunComparison
from gcs_autotune.identify.axis.signals import first_names
from gcs_autotune.identify.axis.structure import Selection
from gcs_autotune.identify.axis.uncertainty import std_of
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.coupled.local import LocalFit
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.outlier_run import DifferentPair, MisfittingRun
from gcs_autotune.identify.problems.fitted import Fitted
from gcs_autotune.identify.problems.problem import Problem
from gcs_autotune.identify.problems.solution import Solution, fit_percents
from gcs_autotune.identify.relay.limit_cycle import PERIODS, SCATTER
from gcs_autotune.identify.result import Decision, LimitCycle, Parameter
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.identify.signals.whiteness import autocorrelation
from gcs_autotune.models import CoupledModel, Form, SingleDof
from gcs_autotune.rounding import counted, format_value
from gcs_autotune.sname import DOFS

__all__ = [
    "COLOUR",
    "DOUBTS",
    "OF_THE_RUNS",
    "POOR",
    "Choice",
    "DoubtRow",
    "EffectTest",
    "Findings",
    "FittedDelay",
    "Gains",
    "doubts_about",
    "inertia_unresolved",
    "reversed_input",
]

Facts = Mapping[str, object]
"""Numbers and names that fill the sentence of a doubt, by placeholder."""

WEAK = 0.30
"""Relative standard error above which a parameter counts as weakly excited. Project choice."""

POOR = 70.0
"""Fit [%] of a signal below which the model counts as explaining it only in part. Project choice."""

COLOUR = 0.2
"""Autocorrelation of residuals or innovations above which a doubt is raised. Project choice.

A smaller one hardly changes a confidence interval.
"""

TOGETHER = 0.99
"""Correlation of two estimates above which only a combination of the two parameters is known. Project choice."""

FAR, OFTEN = 6.0, 0.005
"""Limits for outliers. Project choice.

- ``FAR``: number of standard deviations above which a sample is an outlier.
- ``OFTEN``: fraction of outliers above which a doubt is raised.
"""

SIGNIFICANCE = 0.01
"""Probability that the test keeps an effect that does not exist. Project choice."""

REVERSED = 2.0
"""Number of standard errors below zero from which the gain of an input counts as reversed. Project choice."""

DELAY_CHANGE = 0.03
"""Relative change of the inertia by a delay without strong evidence, above which a doubt is raised. Project choice.

The change must also exceed three standard errors.
"""

PUSHES_BOTH_WAYS: Mapping[str, str] = {
    "yaw": "fly a manoeuvre that pushes both ways, such as a relay or a zig-zag",
    "surge": "fly well-separated steps ahead (throttle-steps), or pulses ahead and astern (doublets)",
}
"""Degree of freedom -> advice on the manoeuvre to fly if the input had only one sign.

Degrees of freedom that are not listed need a relay or doublets.
"""


# -- evidence


@dataclass(frozen=True, slots=True, eq=False)
class Findings:
    """Results for one axis that every method has.

    - ``noise``: standard deviation of the noise in the main signal.
    - ``fit_percent``: fit of the free run [%].
    - ``white``: whether the residuals are white, so that nothing remains to be explained.
    """

    case: Case
    model: SingleDof
    structure: Structure
    parameters: Mapping[str, Parameter]
    decision: Decision | None
    noise: float
    fit_percent: float
    white: bool = False

    @property
    def relays(self) -> Sequence[LimitCycle]:
        """Limit cycles of the runs, empty if no relay was flown."""
        return self.case.cycles if self.case.relay_flown else ()


@dataclass(frozen=True, slots=True, eq=False)
class Choice:
    """The structure and delay that output error chose for one axis."""

    chosen: Selection
    case: Case


@dataclass(frozen=True, slots=True, eq=False)
class FittedDelay:
    """A solution that was fitted with a delay.

    ``evidence``: decrease of the Bayesian information criterion with the delay.
    """

    solution: Solution
    evidence: float


@dataclass(frozen=True, slots=True, eq=False)
class Gains:
    """Values and standard errors of the parameters of a form."""

    form: Form
    values: Mapping[str, float]
    std: Mapping[str, float]


@dataclass(frozen=True, slots=True, eq=False)
class EffectTest:
    """A fit with effects, for the doubts about the effects.

    ``correlation``: number of samples that count as one independent sample.
    """

    problem: Problem
    fitted: Fitted
    parameters: Mapping[str, Parameter]
    correlation: float


# -- conditions: each yields the facts of its sentence, once per doubt


def _few_periods(f: Findings) -> Iterator[Facts]:
    if f.relays and not f.case.cut_short:
        most = max(c.periods for c in f.relays)
        if most < PERIODS:
            yield {"most": counted(most, "full period"), "needed": PERIODS}


def _unsettled(f: Findings) -> Iterator[Facts]:
    if f.relays and not f.case.cut_short:
        worst = min(c.scatter for c in f.relays)
        if not worst <= SCATTER:
            cause = "only one period" if np.isinf(worst) else f"maxima and minima scatter by {100 * worst:.0f} %"
            yield {"cause": cause, "limit": 100 * SCATTER}


def _condition(f: Findings) -> Iterator[Facts]:
    broken = [c for c in f.relays if not c.valid]
    if broken:
        yield {"broken": len(broken), "all": len(f.relays)}


def _one_sided(f: Findings) -> Iterator[Facts]:
    if not any(float(r.tau.min()) < 0.0 < float(r.tau.max()) for r in f.case.records):
        usual = "fly a manoeuvre that pushes both ways, such as a relay or doublets"
        yield {"manoeuvre": PUSHES_BOTH_WAYS.get(f.model.dof, usual)}


def _saturated(f: Findings) -> Iterator[Facts]:
    if f.case.records[0].input_units[0] == "1" and not f.relays:
        share = max(_time_at(r, 0.999) for r in f.case.records)
        if not share <= 0.1:
            yield {"share": 100 * share}


def _time_at(record: Segment, level: float) -> float:
    end = float(record.main.t[-1])
    held = np.diff(np.append(record.t_in, max(end, float(record.t_in[-1]))))
    total = float(held.sum())
    return float(held[np.abs(record.tau) >= level].sum()) / total if total > 0.0 else 0.0


def _irregular(f: Findings) -> Iterator[Facts]:
    shares = []
    for record in f.case.records:
        dt = np.diff(record.main.t)
        shares.append(float(np.mean(np.abs(dt - np.median(dt)) > 0.5 * np.median(dt))))
    if not max(shares) <= 0.1:
        yield {"share": 100 * max(shares)}


def _time_unit(f: Findings) -> Iterator[Facts]:
    step = min(float(np.median(np.diff(r.main.t))) for r in f.case.records)
    if not 1e-3 <= step <= 5.0:
        yield {"step": step}


def _dropped(f: Findings) -> Iterator[Facts]:
    if f.case.dropped_rows:
        yield {"rows": counted(f.case.dropped_rows, "damaged row")}


def _quantised(f: Findings) -> Iterator[Facts]:
    step, record = max(r.main.step for r in f.case.records), f.case.records[0]
    if not step / np.sqrt(12.0) < 0.3 * f.noise:
        angle = record.dof.angular
        shown = math.degrees(step) if angle else step
        yield {"signal": record.main.name, "step": shown, "unit": "deg" if angle else record.dof.position_unit}


def _weak(f: Findings) -> Iterator[Facts]:
    names = f.model.axis.parameter_names()
    weak = [n for n in names[:3] if _is_weak(f.parameters[n], abs(f.parameters[n].value))]
    level = max(float(np.max(np.abs(r.tau))) for r in f.case.records)
    if _is_weak(f.parameters["delta"], level):
        weak.append("delta")
    if weak:
        more = " (a second relay with another C)" if f.relays else ""
        yield {"limit": 100 * WEAK, "names": ", ".join(weak), "more": more}


def _is_weak(parameter: Parameter, scale: float) -> bool:
    return parameter.status == "fitted" and parameter.std > WEAK * scale


def _reversed(f: Findings) -> Iterator[Facts]:
    if not f.model.alpha >= 0.0:
        yield {}


def _negative_drag(f: Findings) -> Iterator[Facts]:
    sign = np.sign(f.model.alpha)
    names = f.model.axis.parameter_names()[1:3]
    bad = [n for n in names if sign * f.parameters[n].value < 0.0]
    if bad:
        yield {"names": ", ".join(bad)}


def _poor_axis(f: Findings) -> Iterator[Facts]:
    if not f.white:
        yield from _poor({first_names(f.case.records)[0]: f.fit_percent})


def _poor(shares: Mapping[str, float]) -> Iterator[Facts]:
    poor = [f"{name} ({share:.0f} %)" for name, share in shares.items() if share < POOR]
    if poor:
        yield {"signals": ", ".join(poor)}


def _disagreement(f: Findings) -> Iterator[Facts]:
    if f.relays and f.decision is not None and f.structure != "affine":
        verdict, kind = f.decision.verdict, {"linear": "linear", "nonlinear": "quadratic"}
        if verdict not in ("undecided", f.structure):
            yield {"cycles": kind[verdict], "fit": kind[f.structure]}


def _named(solution: Solution) -> bool:
    """Return whether the parameters of a solution have names of their own; those of one axis are in its findings."""
    return not isinstance(solution.form, ExplicitForm)


def _not_converged(solution: Solution) -> Iterator[Facts]:
    if not solution.converged:
        yield {}


def _at_bound(solution: Solution) -> Iterator[Facts]:
    if not solution.at_bound or not _named(solution):
        return
    values = dict(zip(solution.form.parameters, solution.theta, strict=True))
    dofs = [DOFS[name] for name in solution.form.dofs]
    damping = {f"{d.force}_{n}" for d in dofs for n in (d.velocity, 2 * d.velocity)}
    none = [n for n in solution.at_bound if n in damping and values[n] == 0.0]
    held = [n for n in solution.at_bound if n not in none]
    causes, cures = [], []
    if none:
        causes.append(f"{_words(none)} stopped at zero, the limit of damping. The runs fit best without it")
        cures.append("no action if other damping was identified. Otherwise fly slower and faster runs")
    if held:
        causes.append(
            f"{_words(held)} stopped at a bound and was fixed there. A value beyond the bound fits the runs better"
        )
        cures.append("widen the bound, or omit the parameter")
    yield {"causes": "; ".join(causes), "cures": "; ".join(cures)}


def _not_excited(solution: Solution) -> Iterator[Facts]:
    if solution.blind and _named(solution):
        yield {"names": _words(solution.blind)}


def _together(solution: Solution) -> Iterator[Facts]:
    if not _named(solution):
        return
    k = len(solution.names)
    covariance = solution.whole[:k, :k]
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(std > 0.0, std, np.inf)
    rho = np.triu(np.abs(covariance / np.outer(scale, scale)), 1)
    pairs = [(float(rho[i, j]), solution.names[i], solution.names[j]) for i, j in np.argwhere(rho > TOGETHER)]
    if pairs:
        worst = sorted(pairs, reverse=True)[:3]
        yield {"pairs": "; ".join(f"{_words([a])} and {_words([b])} ({value:.4f})" for value, a, b in worst)}


def _words(labels: Sequence[str]) -> str:
    """Return the labels of parameters as a list in words."""
    return ", ".join(map(parameter_words, labels))


def _poor_solution(solution: Solution) -> Iterator[Facts]:
    if _named(solution) and not solution.white:
        yield from _poor(fit_percents(solution))


def _coloured(solution: Solution) -> Iterator[Facts]:
    colour = max(float(np.max(np.abs(autocorrelation(s, 5)))) for s in solution.scores)
    if not colour <= COLOUR and not solution.white:
        yield {"colour": colour}


def _outliers(solution: Solution) -> Iterator[Facts]:
    """Signals with robust weights are skipped. For a rounding sensor the limit includes noise and resolution.

    An outlier is also far from each of its neighbours. Samples that are far off together are an error of the model.
    """
    share = 0.0
    for r in solution.rests:
        model, errors = solution.noise_models[r.signal], r.judged[r.known]
        if model.robust or not len(errors):
            continue
        rough = max(1.4826 * float(np.median(np.abs(errors))), r.step, 1e-300)
        reach = 0.5 * model.quantum + FAR * model.sigma if model.quantum > 0.0 else FAR * rough
        around = np.median(sliding_window_view(np.pad(errors, 2, mode="edge"), 5), axis=1)
        steps = np.abs(np.diff(errors, prepend=np.inf, append=np.inf))
        apart = np.minimum.reduce([np.abs(errors), np.abs(errors - around), steps[:-1], steps[1:]])
        share = max(share, float(np.mean(apart > reach)))
    if not share <= OFTEN:
        yield {"share": 100 * share}


def _pieces(local: LocalFit) -> Iterator[Facts]:
    if local.pieces:
        yield {"longest": max(float(np.ptp(r.stamps)) for r in local.records)}


def _negative_gains(g: Gains) -> list[str]:
    return [n for n in g.std if n.startswith("k_") and g.values[n] < -REVERSED * g.std[n]]


def _reversed_gains(g: Gains) -> Iterator[Facts]:
    names = _negative_gains(g)
    if names:
        channels = [c for c, pairs in g.form.inputs.items() if any(str(k).lstrip("-") in names for _, k in pairs)]
        yield {"names": ", ".join(names), "channels": ", ".join(channels)}


def _reversed_inertia(g: Gains) -> Iterator[Facts]:
    """An input drives a degree of freedom with a known gain, and its inertia is below zero by :data:`REVERSED` standard
    errors."""
    if _negative_gains(g):
        return
    driven = {force for pairs in g.form.inputs.values() for force, gain in pairs if not isinstance(gain, str)}
    inertia = np.diag(CoupledModel(g.form, {n: g.values[n] for n in g.form.parameters}).inertia)
    for dof, own in zip(g.form.dofs, inertia.tolist(), strict=True):
        spread = g.std.get(f"{DOFS[dof].force}_{DOFS[dof].velocity}dot")
        if DOFS[dof].force in driven and spread is not None and own < -REVERSED * spread:
            yield {}
            return


def _structure_undecided(c: Choice) -> Iterator[Facts]:
    if c.chosen.undecided:
        yield {"more": c.case.more_levels}


def _second_drag(c: Choice) -> Iterator[Facts]:
    """The evidence neither proves nor excludes a second damping term."""
    chosen = c.chosen
    bic = {candidate.structure: candidate.bic for candidate in chosen.candidates}
    if chosen.rival is None or bic["affine"] - bic[chosen.structure] > UNDECIDED:
        return
    drag = "a" if chosen.structure == "linear" else "c"
    one, both = (s.value(drag) / s.value("b") for s in (chosen.solution, chosen.rival))
    own, other = ("linear", "quadratic") if chosen.structure == "linear" else ("quadratic", "linear")
    yield {"own": own, "other": other, "change": 100.0 * (both / one - 1.0), "more": c.case.more_levels}


def _delay_fitted(d: FittedDelay) -> Iterator[Facts]:
    if not d.evidence <= 0.0 and "delay" in d.solution.free:
        yield {"delay": d.solution.value("delay"), "evidence": d.evidence}


def _delay_undecided(c: Choice) -> Iterator[Facts]:
    """A delay is neither proved nor excluded, by a likelihood ratio at 10 %, and would change the inertia."""
    chosen, tried = c.chosen, c.chosen.with_delay
    if tried is None or "delay" in chosen.solution.free:
        return
    ratio = chosen.delay_evidence + math.log(tried.samples / chosen.correlation)
    gain = chosen.solution.value("b")
    change = gain / tried.value("b") - 1.0
    spread = 3.0 * std_of(chosen.solution, "b", raised=False) / abs(gain)
    if not (ratio < 2.7 or abs(change) < max(DELAY_CHANGE, spread)):
        yield {"delay": tried.value("delay"), "change": 100.0 * change, "more": c.case.more_levels}


def _inertia_unresolved(c: Choice) -> Iterator[Facts]:
    if inertia_unresolved(c.chosen.solution):
        yield {}


def inertia_unresolved(solution: Solution) -> bool:
    """Return whether a drag rate of *solution* is at the limit of what the sampling resolves."""
    return "a" in solution.at_bound or "c" in solution.at_bound


def _pair_apart(c: RunComparison) -> Iterator[Facts]:
    if not c.lacks_term:
        yield from ({"one": o.pair[0], "other": o.pair[1], "sigmas": o.sigmas} for o in c.outliers if o.pair)


def _run_apart(c: RunComparison) -> Iterator[Facts]:
    if not c.lacks_term:
        yield from ({"run": o.run, "sigmas": o.sigmas} for o in c.outliers if not o.pair)


def _term_lacking(c: RunComparison) -> Iterator[Facts]:
    """Runs differ while the model does not explain most of them down to noise: no sign of another craft."""
    if c.lacks_term:
        runs = ", ".join(f"'{o.run}' by {o.sigmas:.0f} standard errors" for o in c.outliers)
        besides = f". The craft also moved in {' and '.join(c.moved_too)}, which the model does not include"
        cure = f"identify these motions as well, with --dof {c.option}" if c.option else ""
        yield {
            "runs": runs,
            "moved": besides if c.moved_too else "",
            "cure": cure or "find the missing term with `diagnose`",
        }


def _other_inertia(c: RunComparison) -> Iterator[Facts]:
    if c.other_inertia:
        yield {"runs": ", ".join(c.other_inertia)}


def _misfitting(m: MisfittingRun) -> Iterator[Facts]:
    yield {"run": m.run, "misfit": m.misfit, "relief": m.relief}


def _different(p: DifferentPair) -> Iterator[Facts]:
    yield {"one": p.runs[0], "other": p.runs[1], "relief": p.relief}


def _effect_not_needed(test: EffectTest) -> Iterator[Facts]:
    """The runs do not support an effect, by a likelihood ratio test."""
    fitted = test.fitted
    for own in fitted.effects:
        entry = EFFECTS[own.slug]
        others = tuple(e for e in fitted.effects if e is not own)
        without = test.problem.fit(fitted.theta, others, fitted.initial, shift=fitted.shift)
        pays = math.inf if without is None else without.cost - fitted.cost
        numbers = max(len(entry.parameters), 1)
        if chi_square.exceeded_by_chance(max(pays, 0.0) / test.correlation, numbers) > SIGNIFICANCE:
            known = ((n, v, test.parameters[own.label_of(n)].std) for n, v in own.values.items())
            values = ", ".join(f"{n} = {format_value(v, std)}" for n, v, std in known)
            yield {"effect": effect_at(own), "values": values, "separated_by": entry.separated_by}


# -- the table


@dataclass(frozen=True, slots=True)
class DoubtRow:
    """One row of the table of doubts.

    - ``slug``: short name of the doubt.
    - ``about``: type of the object that the doubt is about.
    - ``when``: function that yields the facts that fill ``cause`` and ``cure``, once per doubt.
    - ``cause``: sentence with placeholders.
    - ``cure``: remedy with placeholders.
    - ``of_the_runs``: whether the doubt is about the runs themselves, so that it applies to any model.
    """

    slug: str
    about: type
    when: Callable[[Any], Iterator[Facts]]
    cause: str
    cure: str
    of_the_runs: bool = False


REVERSED_CAUSE = "a positive input turns or pushes against the SNAME convention, so the fitted parameters are negative"
REVERSED_CURE = "no action for a rudder angle, where this is normal. Otherwise check wiring and sign of the channel"
POOR_CAUSE = "the model explains these signals only in part: {signals}"
POOR_CURE = (
    "inspect the plot of the fit. Check for wind, current, other axes, a missing term, a drifting clock or a "
    "wrong input"
)

DOUBTS: tuple[DoubtRow, ...] = (
    DoubtRow(
        "few-periods",
        Findings,
        _few_periods,
        "the record has only {most} of self-oscillation, and {needed} are required",
        "let the relay run longer",
        of_the_runs=True,
    ),
    DoubtRow(
        "unsettled",
        Findings,
        _unsettled,
        "the oscillation is not known to have settled ({cause}). The scatter must be at most {limit:.0f} %",
        "wait for calmer water, use a larger C (output) or x_a (switching value), or let the relay run longer",
        of_the_runs=True,
    ),
    DoubtRow(
        "not-self-oscillation",
        Findings,
        _condition,
        "{broken} of {all} relay settings violate x_a* + |x_0| < X_m (Miskovic2010, eq. 7.12). IS-O is not valid for "
        "them, but the simulated fit is",
        "use a larger C (output) or a smaller x_a (switching value). Trim the craft to remove the constant force",
        of_the_runs=True,
    ),
    DoubtRow(
        "one-sided-input",
        Findings,
        _one_sided,
        "the input never changes sign, so constant force and drag may be poorly separated",
        "{manoeuvre}",
        of_the_runs=True,
    ),
    DoubtRow(
        "saturated-input",
        Findings,
        _saturated,
        "the input is at full output for {share:.0f} % of the time",
        "use smaller inputs, because the record does not show commands beyond the actuator's limit",
        of_the_runs=True,
    ),
    DoubtRow(
        "irregular-sampling",
        Findings,
        _irregular,
        "{share:.0f} % of the time steps differ from the median by more than half of it",
        "request a lower, steadier message rate. The fit uses each time stamp unchanged",
        of_the_runs=True,
    ),
    DoubtRow(
        "time-unit",
        Findings,
        _time_unit,
        "the median time step is {step:.3g} s, so the time stamps may not be in seconds",
        "name the time column t[ms] or t[us] if it is in these units",
        of_the_runs=True,
    ),
    DoubtRow(
        "dropped-rows",
        Findings,
        _dropped,
        "left out at a file's end: {rows}",
        "stop the recording before you copy the file",
        of_the_runs=True,
    ),
    DoubtRow(
        "quantised",
        Findings,
        _quantised,
        "{signal} is recorded in steps of {step:.3g} {unit}, which is coarser than its noise",
        "use a finer sensor or message, or larger oscillations",
    ),
    DoubtRow(
        "weakly-excited",
        Findings,
        _weak,
        "these parameters have a standard error above {limit:.0f} %: {names}",
        "record longer, with larger or more varied inputs{more}",
    ),
    DoubtRow("reversed-input", Findings, _reversed, REVERSED_CAUSE, REVERSED_CURE),
    DoubtRow(
        "negative-drag",
        Findings,
        _negative_drag,
        "{names} is destabilising, so without input the motion of the model grows at some or all speeds",
        "check that input and output belong together and are synchronous. Check for current or a course-unstable hull",
    ),
    DoubtRow("poor-fit", Findings, _poor_axis, POOR_CAUSE, POOR_CURE),
    DoubtRow(
        "decisions-disagree",
        Findings,
        _disagreement,
        "two limit cycles indicate {cycles} damping, but the simulated fit indicates {fit}",
        "fly a further relay with a clearly different output C",
    ),
    DoubtRow(
        "not-converged",
        Solution,
        _not_converged,
        "the fit did not converge",
        "record longer. Otherwise supply the structure, start values or the delay, or fit fewer parameters",
    ),
    DoubtRow("at-bound", Solution, _at_bound, "{causes}", "{cures}"),
    DoubtRow(
        "not-excited",
        Solution,
        _not_excited,
        "the values of {names} are meaningless, because nothing in these runs depends on them",
        "fly a manoeuvre that moves these degrees of freedom, measure the parameters, or omit them from the form",
    ),
    DoubtRow(
        "correlated",
        Solution,
        _together,
        "only combinations of these parameters are known (with the correlation of their estimates): {pairs}",
        "fix one of each pair at a known value, or fly a manoeuvre with other outputs, speeds or turns",
    ),
    DoubtRow("poor-fit", Solution, _poor_solution, POOR_CAUSE, POOR_CURE),
    DoubtRow(
        "residuals-not-white",
        Solution,
        _coloured,
        "the error bars were widened, because the residuals are correlated ({colour:.2f}). The model may lack a term",
        "inspect the residuals. Check for wind, waves, current, a slow actuator, another axis or a missing term",
    ),
    DoubtRow(
        "outliers",
        Solution,
        _outliers,
        "{share:.1f} % of the samples are outliers",
        "identify again with --robust (in Python loss='soft_l1'), or repair the sensor",
    ),
    DoubtRow(
        "short-horizon",
        LocalFit,
        _pieces,
        "no fit of this form follows the whole runs. The model was fitted to pieces of up to {longest:.0f} s",
        "check for a missing term, a run of another vehicle, or a course-unstable craft",
    ),
    DoubtRow(
        "reversed-input",
        Gains,
        _reversed_gains,
        "{names} are negative, so {channels} act opposite to their names",
        "check labels, wiring, signs and left/right of the inputs. The model is valid for the log as recorded",
    ),
    DoubtRow("reversed-input", Gains, _reversed_inertia, REVERSED_CAUSE, REVERSED_CURE),
    DoubtRow(
        "structure-undecided",
        Choice,
        _structure_undecided,
        "linear and quadratic damping explain the record about equally well. Linear damping was used",
        "{more}",
    ),
    DoubtRow(
        "second-drag-undecided",
        Choice,
        _second_drag,
        "the error bars of damping were widened, because the runs neither prove nor exclude {other} damping in "
        "addition to {own} damping. It would change {own} damping by {change:+.0f} %",
        "{more}. A wider range of speeds separates the two",
    ),
    DoubtRow(
        "delay-fitted",
        FittedDelay,
        _delay_fitted,
        "a delay of {delay:.2g} s between input and motion was fitted. It lowers BIC (misfit with a penalty per "
        "parameter) by {evidence:.0f}",
        "supply --delay if the delay is known. If the actuator is slow, fit a form with 'lag' free instead",
    ),
    DoubtRow(
        "delay-undecided",
        Choice,
        _delay_undecided,
        "the runs neither prove nor exclude a delay of {delay:.2f} s. It would change the inertia by {change:+.0f} %",
        "supply --delay if the delay is known. Otherwise {more}",
    ),
    DoubtRow(
        "inertia-unresolved",
        Choice,
        _inertia_unresolved,
        "only the ratio of input to steady velocity is known, because the fitted time constant is shorter than a "
        "sample. The craft is that fast, or it also moves in a way that the model omits",
        "request a higher message rate. Identify a boat that drifts sideways with --dof horizontal",
    ),
    DoubtRow(
        "run-apart",
        RunComparison,
        _pair_apart,
        "runs '{one}' and '{other}' differ by {sigmas:.0f} standard errors, as if they came from two different craft",
        "check the load, speed and battery of both runs, and that both used the same vehicle. Identify them separately",
    ),
    DoubtRow(
        "run-apart",
        RunComparison,
        _run_apart,
        "run '{run}' differs from the others by {sigmas:.0f} standard errors, as if it came from a different craft",
        "check vehicle, load, speed and battery of the outlier. Identify it separately",
    ),
    DoubtRow(
        "run-apart",
        MisfittingRun,
        _misfitting,
        "run '{run}' does not fit the others. The model of the other runs misses it by {misfit:.1f} times their noise. "
        "Without it the noise falls by a factor of {relief:.1f}",
        "omit '{run}' and identify it separately. Check its vehicle, load and input scale",
    ),
    DoubtRow(
        "runs-disagree",
        RunComparison,
        _term_lacking,
        "the parameters differ between runs ({runs}). In most runs, however, the model error exceeds the noise. The "
        "difference therefore does not show that the craft changed{moved}",
        "{cure}",
    ),
    DoubtRow(
        "runs-disagree",
        RunComparison,
        _other_inertia,
        "fitted separately, these runs give a different inertia: {runs}",
        "check whether load, speed or battery changed between the runs. Identify the outlier separately",
    ),
    DoubtRow(
        "runs-disagree",
        DifferentPair,
        _different,
        "runs '{one}' and '{other}' need different models. A separate fit of each is {relief:.1f} times better",
        "check whether load, speed or battery changed between the runs. Identify them separately, or fly a third run",
    ),
    DoubtRow(
        "effect-not-needed",
        EffectTest,
        _effect_not_needed,
        "the runs do not prove {effect}: {values}",
        "omit it. To test for it, fly: {separated_by}",
    ),
)
"""All doubts, in the order in which a result lists them."""

OF_THE_RUNS = frozenset(row.slug for row in DOUBTS if row.of_the_runs)
"""Slugs of the doubts about the runs themselves, which apply to any model."""


def doubts_about(*evidence: object, rows: Sequence[DoubtRow] = DOUBTS) -> list[Doubt]:
    """Return the doubts that the *evidence* raises, in the order of the table *rows*.

    evidence : objects of any of the types that the rows are about. None stands for an object that does not exist.
    """
    return [
        Doubt(row.slug, row.cause.format(**facts), row.cure.format(**facts))
        for row in rows
        for known in evidence
        if isinstance(known, row.about)
        for facts in row.when(known)
    ]


def reversed_input(form: Form, values: Mapping[str, float], std: Mapping[str, float]) -> Doubt | None:
    """Return a doubt if a gain ``k_*`` is negative, else None.

    A negative gain indicates that labels, wiring or the sign of an input are reversed. A doubt is also raised about a
    negative inertia of a motion that an input drives with a known gain.
    """
    return next(iter(doubts_about(Gains(form, values, std))), None)
