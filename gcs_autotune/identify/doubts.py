"""Reasons not to trust an identification blindly, each with its cause and its cure: one list, one set of constants.

Of one axis, whatever the method: :func:`collect`, about its runs and its parameters. Of a solution by maximum
likelihood, whatever the form and its effects: :func:`solution_doubts`. What only one method can doubt (a filter's
innovations, a structure that was chosen) stands with that method.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gcs_autotune import chi_square
from gcs_autotune.effects import EFFECTS
from gcs_autotune.identify.axis.case import Case
from gcs_autotune.identify.problem import Fitted, Problem, label_of
from gcs_autotune.identify.relay.limit_cycle import PERIODS, SCATTER
from gcs_autotune.identify.result import Decision, Doubt, LimitCycle, Parameter, Structure
from gcs_autotune.identify.segment import Segment
from gcs_autotune.identify.simulators import ExplicitForm
from gcs_autotune.identify.solution import Solution, fit_percents
from gcs_autotune.identify.whiteness import autocorrelation
from gcs_autotune.models import SingleDof
from gcs_autotune.rounding import format_value
from gcs_autotune.sname import DOFS

__all__ = [
    "COLOUR",
    "OF_THE_RUNS",
    "POOR",
    "Findings",
    "collect",
    "delay_fitted",
    "effect_doubts",
    "once",
    "poor_fit",
    "reversed_input",
    "solution_doubts",
]

OF_THE_RUNS = (
    "few-periods",
    "unsettled",
    "not-self-oscillation",
    "one-sided-input",
    "saturated-input",
    "irregular-sampling",
    "time-unit",
    "dropped-rows",
)
"""Doubts about the runs themselves, whatever model is fitted to them."""

WEAK = 0.30
"""Relative standard error above which a parameter counts as weakly excited."""

POOR = 70.0
"""Fit [%] of a signal below which it counts as unexplained."""

COLOUR = 0.2
"""Autocorrelation of residuals or innovations that is worth a word: a smaller one hardly moves an interval."""

TOGETHER = 0.99
"""Correlation of two estimates above which only a combination of them is known."""

REVERSED = 2.0
"""Standard errors below zero at which an input is called reversed."""

FAR, OFTEN = 6.0, 0.005
"""Standard deviations beyond which a sample is an outlier; the share of them above which they are worth a word."""

SIGNIFICANCE = 0.01
"""Chance of keeping an effect that is not there."""


def once(doubts: Iterable[Doubt]) -> tuple[Doubt, ...]:
    """Return *doubts* in their order, each slug and cause once."""
    return tuple({(d.slug, d.cause): d for d in doubts}.values())


def poor_fit(shares: Mapping[str, float]) -> Doubt | None:
    """Doubt a model that leaves much of a signal unexplained; *shares* [%] per signal."""
    poor = [f"{name} ({share:.0f} %)" for name, share in shares.items() if share < POOR]
    if not poor:
        return None
    return Doubt(
        "poor-fit",
        f"the model explains these signals only in part: {', '.join(poor)}",
        "look at the fit's plot: wind, current, other axes, a missing term, a slipping clock or the wrong input "
        "may be at work",
    )


def delay_fitted(solution: Solution, evidence: float) -> Doubt | None:
    """Say that a delay was fitted, and on what *evidence* (difference of the criterion)."""
    if evidence <= 0.0 or "delay" not in solution.free:
        return None
    return Doubt(
        "delay-fitted",
        f"a delay of {solution.value('delay'):.2g} s between input and motion was fitted: with it BIC, the misfit "
        f"weighed against the count of fitted numbers, is lower by {evidence:.0f}",
        "give --delay if you know it; a slow actuator looks like a delay too: free 'lag' in a form for it",
    )


@dataclass(frozen=True, slots=True, eq=False)
class Findings:
    """What the checks look at; ``noise`` is that of the main signal."""

    case: Case
    model: SingleDof
    structure: Structure
    parameters: Mapping[str, Parameter]
    decision: Decision | None
    noise: float
    fit_percent: float

    @property
    def relays(self) -> Sequence[LimitCycle]:
        """Limit cycles of relays that were flown."""
        return self.case.cycles if self.case.relay_flown else ()


def collect(findings: Findings) -> tuple[Doubt, ...]:
    """Return the doubts of the records and of every check, in that order, each slug and cause once."""
    notes = [doubt for record in findings.case.records for doubt in record.notes]
    return once([*notes, *(d for check in _CHECKS if (d := check(findings)) is not None)])


def _few_periods(f: Findings) -> Doubt | None:
    if not f.relays or f.case.cut_short or max(c.periods for c in f.relays) >= PERIODS:
        return None
    most = max(c.periods for c in f.relays)
    return Doubt(
        "few-periods",
        f"only {most} full period(s) of self-oscillation, {PERIODS} are asked for",
        "let the relay run longer",
    )


def _unsettled(f: Findings) -> Doubt | None:
    if not f.relays or f.case.cut_short or min(c.scatter for c in f.relays) <= SCATTER:
        return None
    worst = min(c.scatter for c in f.relays)
    cause = "the single period found" if np.isinf(worst) else f"extremes that scatter by {100 * worst:.0f} %"
    return Doubt(
        "unsettled",
        f"the oscillation never settled ({cause}; the rule is {100 * SCATTER:.0f} %)",
        "wait for calmer water, use a larger C or x_a, let the relay run longer",
    )


def _condition(f: Findings) -> Doubt | None:
    broken = [c for c in f.relays if not c.valid]
    if not broken:
        return None
    return Doubt(
        "not-self-oscillation",
        f"{len(broken)} of {len(f.relays)} relay settings break condition "
        "x_a* + |x_0| < X_m (7.12): IS-O does not hold there (the exact fit still does)",
        "use a larger C or a smaller x_a; trim away the constant force",
    )


def _one_sided(f: Findings) -> Doubt | None:
    if any(float(r.tau.min()) < 0.0 < float(r.tau.max()) for r in f.case.records):
        return None
    return Doubt(
        "one-sided-input",
        "the input never changes sign: constant force and drag are told apart poorly",
        "fly a manoeuvre that pushes both ways: a relay, a zig-zag",
    )


def _saturated(f: Findings) -> Doubt | None:
    if f.case.records[0].input_units[0] != "1" or f.relays:
        return None
    share = max(_time_at(r, 0.999) for r in f.case.records)
    if share <= 0.1:
        return None
    return Doubt(
        "saturated-input",
        f"the input stands at full output for {100 * share:.0f} % of the time",
        "use smaller inputs: what the actuator was asked beyond its limit is not in the record",
    )


def _time_at(record: Segment, level: float) -> float:
    end = float(record.main.t[-1])
    held = np.diff(np.append(record.t_in, max(end, float(record.t_in[-1]))))
    total = float(held.sum())
    return float(held[np.abs(record.tau) >= level].sum()) / total if total > 0.0 else 0.0


def _irregular(f: Findings) -> Doubt | None:
    shares = []
    for record in f.case.records:
        dt = np.diff(record.main.t)
        shares.append(float(np.mean(np.abs(dt - np.median(dt)) > 0.5 * np.median(dt))))
    if max(shares) <= 0.1:
        return None
    return Doubt(
        "irregular-sampling",
        f"{100 * max(shares):.0f} % of the time steps are far from the usual one",
        "ask for a lower, steadier message rate; the fit uses each stamp as it is",
    )


def _time_unit(f: Findings) -> Doubt | None:
    step = min(float(np.median(np.diff(r.main.t))) for r in f.case.records)
    if 1e-3 <= step <= 5.0:
        return None
    return Doubt(
        "time-unit",
        f"the usual time step is {step:.3g} s: are the stamps really in seconds?",
        "head the time column t[ms] or t[us] if it is in these units",
    )


def _dropped(f: Findings) -> Doubt | None:
    if not f.case.dropped_rows:
        return None
    return Doubt(
        "dropped-rows",
        f"{f.case.dropped_rows} damaged row(s) at a file's end were left out",
        "stop the recording before copying the file",
    )


def _quantised(f: Findings) -> Doubt | None:
    step = max(r.main.step for r in f.case.records)
    if step / np.sqrt(12.0) < 0.3 * f.noise:
        return None
    return Doubt(
        "quantised",
        f"{f.case.records[0].main.name} is recorded in steps of {step:.3g} "
        f"{f.case.records[0].dof.position_unit}, coarser than its noise",
        "use a finer sensor or message; larger oscillations lessen it",
    )


def _weak(f: Findings) -> Doubt | None:
    names = f.model.axis.parameter_names()
    weak = [n for n in names[:3] if _is_weak(f.parameters[n], abs(f.parameters[n].value))]
    level = max(float(np.max(np.abs(r.tau))) for r in f.case.records)
    if _is_weak(f.parameters["delta"], level):
        weak.append("delta")
    if not weak:
        return None
    return Doubt(
        "weakly-excited",
        f"{', '.join(weak)}: standard error above {100 * WEAK:.0f} %",
        f"record longer, with larger or more different inputs{' (a second relay with another C)' if f.relays else ''}",
    )


def _is_weak(parameter: Parameter, scale: float) -> bool:
    return parameter.status == "fitted" and parameter.std > WEAK * scale


def _reversed(f: Findings) -> Doubt | None:
    if f.model.alpha >= 0.0:
        return None
    return Doubt(
        "reversed-input",
        "a positive input turns or pushes the other way than SNAME says; the parameters come out negative",
        "expected for a rudder angle; otherwise check wiring and sign of the channel",
    )


def _negative_drag(f: Findings) -> Doubt | None:
    sign = np.sign(f.model.alpha)
    names = f.model.axis.parameter_names()[1:3]
    bad = [n for n in names if sign * f.parameters[n].value < 0.0]
    if not bad:
        return None
    return Doubt(
        "negative-drag",
        f"{', '.join(bad)} does not damp: the craft would turn or run away by itself",
        "check that input and output belong together and are in step; look for current or a course-unstable hull",
    )


def _poor(f: Findings) -> Doubt | None:
    return poor_fit({f.case.records[0].main.name: f.fit_percent})


def _disagreement(f: Findings) -> Doubt | None:
    if (
        not f.relays
        or f.decision is None
        or f.structure == "affine"
        or f.decision.verdict in ("undecided", f.structure)
    ):
        return None
    kind = {"linear": "linear", "nonlinear": "quadratic"}
    return Doubt(
        "decisions-disagree",
        f"two limit cycles speak for {kind[f.decision.verdict]} damping, the exact fit for {kind[f.structure]}",
        "fly a further relay with a clearly different C",
    )


_CHECKS: tuple[Callable[[Findings], Doubt | None], ...] = (
    _few_periods,
    _unsettled,
    _condition,
    _one_sided,
    _saturated,
    _irregular,
    _time_unit,
    _dropped,
    _quantised,
    _weak,
    _reversed,
    _negative_drag,
    _poor,
    _disagreement,
)
"""Of one axis, in the order in which they are listed."""


def solution_doubts(solution: Solution) -> list[Doubt]:
    """Return what is doubtful about any solution, whatever its parameters mean.

    Of the explicit numbers of one axis only what people need no names for: :func:`collect` says the rest.
    """
    named = not isinstance(solution.form, ExplicitForm)
    asked = (
        _not_converged(solution),
        _at_bound(solution) if named else None,
        _not_excited(solution) if named else None,
        _together(solution) if named else None,
        poor_fit(fit_percents(solution)) if named and not solution.white else None,
        _coloured(solution),
        _outliers(solution),
    )
    return [doubt for doubt in asked if doubt is not None]


def _not_converged(solution: Solution) -> Doubt | None:
    if solution.converged:
        return None
    return Doubt(
        "not-converged",
        "the fit did not settle",
        "record longer; give the structure, start values or the delay; fit fewer parameters",
    )


def _at_bound(solution: Solution) -> Doubt | None:
    if not solution.at_bound:
        return None
    values = dict(zip(solution.form.parameters, solution.theta, strict=True))
    dofs = [DOFS[name] for name in solution.form.dofs]
    damping = {f"{d.force}_{n}" for d in dofs for n in (d.velocity, 2 * d.velocity)}
    none = [n for n in solution.at_bound if n in damping and values[n] == 0.0]
    held = [n for n in solution.at_bound if n not in none]
    causes, cures = [], []
    if none:
        causes.append(f"{', '.join(none)} stopped at zero, beyond which damping would push: these runs show none of it")
        cures.append("where other damping is found beside it, nothing; else fly slower and faster runs")
    if held:
        causes.append(
            f"{', '.join(held)} stopped at a bound: the runs would have it beyond; it was taken as known there"
        )
        cures.append("widen the bound, or leave the parameter out")
    return Doubt("at-bound", "; ".join(causes), "; ".join(cures))


def _not_excited(solution: Solution) -> Doubt | None:
    if not solution.blind:
        return None
    return Doubt(
        "not-excited",
        f"nothing in these runs depends on {', '.join(solution.blind)}: the values given mean nothing",
        "fly a manoeuvre that moves these degrees of freedom, or measure them; or leave the parameters out of the form",
    )


def _together(solution: Solution) -> Doubt | None:
    k = len(solution.free)
    covariance = solution.whole[:k, :k]
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(std > 0.0, std, np.inf)
    rho = np.triu(np.abs(covariance / np.outer(scale, scale)), 1)
    pairs = [(float(rho[i, j]), solution.free[i], solution.free[j]) for i, j in np.argwhere(rho > TOGETHER)]
    if not pairs:
        return None
    worst = sorted(pairs, reverse=True)[:3]
    text = "; ".join(f"{a} and {b} ({value:.4f})" for value, a, b in worst)
    return Doubt(
        "correlated",
        f"these are known only together (correlation of the estimates): {text}",
        "fix one of each pair to a value you know, or fly a manoeuvre with other speeds and turns",
    )


def reversed_input(solution: Solution) -> Doubt | None:
    """Gains called ``k_*`` are positive when labels, wiring and signs are as the form has them."""
    std = np.sqrt(np.maximum(np.diag(solution.covariance), 0.0))
    value = {n: float(solution.theta[solution.form.parameters.index(n)]) for n in solution.free}
    names = [n for n, s in zip(solution.free, std, strict=True) if n.startswith("k_") and value[n] < -REVERSED * s]
    if not names:
        return None
    channels = [c for c, pairs in solution.form.inputs.items() if any(str(g).lstrip("-") in names for _, g in pairs)]
    return Doubt(
        "reversed-input",
        f"{', '.join(names)} came out negative: {', '.join(channels)} act the other way than their names say",
        "check labels, wiring and the sign of the inputs, left against right; the model holds for the log as it is",
    )


def _coloured(solution: Solution) -> Doubt | None:
    colour = max(float(np.max(np.abs(autocorrelation(s, 5)))) for s in solution.scores)
    if colour <= COLOUR or solution.white:
        return None
    return Doubt(
        "residuals-not-white",
        f"the residuals are correlated ({colour:.2f}): the model misses something; standard errors were raised for it",
        "look at the residuals; wind, waves, current, a slow actuator, another axis or a missing term may be at work",
    )


def _outliers(solution: Solution) -> Doubt | None:
    """Samples far off the rest, unless they already weigh less; of a rounding sensor, far beyond noise and step."""
    share = 0.0
    for r in solution.residuals:
        model, errors = solution.models[r.signal], np.abs(r.judged[r.known])
        if model.robust:
            continue
        rough = max(1.4826 * float(np.median(errors)), r.step, 1e-300)
        reach = 0.5 * model.quantum + FAR * model.sigma if model.quantum > 0.0 else FAR * rough
        share = max(share, float(np.mean(errors > reach)))
    if share <= OFTEN:
        return None
    return Doubt(
        "outliers",
        f"{100 * share:.1f} % of the samples lie far off the rest",
        "identify again with --robust (in Python loss='soft_l1'), or mend the sensor",
    )


def effect_doubts(
    problem: Problem, fitted: Fitted, parameters: Mapping[str, Parameter], correlation: float
) -> Iterator[Doubt]:
    """Yield a doubt for every effect the runs do not call for: the likelihood ratio, *correlation* samples as one."""
    for own in fitted.effects:
        entry = EFFECTS[own.slug]
        others = tuple(e for e in fitted.effects if e is not own)
        without = problem.fit(fitted.theta, others, fitted.initial, shift=fitted.shift)
        pays = math.inf if without is None else without.cost - fitted.cost
        numbers = max(len(entry.parameters), 1)
        if chi_square.exceeded_by_chance(max(pays, 0.0) / correlation, numbers) > SIGNIFICANCE:
            known = ((n, v, parameters[label_of(own, n)].std) for n, v in own.values.items())
            said = ", ".join(f"{n} = {format_value(v, std)}" for n, v, std in known)
            yield Doubt(
                "effect-not-needed",
                f"these runs do not call for {own.slug} at {own.place} ({said}): without it they are followed as well",
                f"leave it out; to look for it, fly {entry.separated_by}",
            )
