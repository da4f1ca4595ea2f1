"""Reasons not to trust a solution by maximum likelihood blindly, whatever its form, its parameters and its effects."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from gcs_autotune import chi_square
from gcs_autotune.effects import EFFECTS
from gcs_autotune.identify.axis.form import ExplicitForm
from gcs_autotune.identify.doubts import COLOUR, REVERSED_INPUT, poor_fit
from gcs_autotune.identify.fitted import Fitted
from gcs_autotune.identify.free_numbers import label_of
from gcs_autotune.identify.problem import Problem
from gcs_autotune.identify.result import Doubt, Parameter
from gcs_autotune.identify.solution import Solution, fit_percents
from gcs_autotune.identify.whiteness import autocorrelation
from gcs_autotune.models import CoupledModel, Form
from gcs_autotune.rounding import format_value
from gcs_autotune.sname import DOFS

__all__ = ["effect_doubts", "reversed_input", "solution_doubts"]

TOGETHER = 0.99
"""Correlation of two estimates above which only a combination of them is known."""

FAR, OFTEN = 6.0, 0.005
"""Standard deviations beyond which a sample is an outlier; the share of them above which they are worth a word."""

SIGNIFICANCE = 0.01
"""Chance of keeping an effect that is not there."""

REVERSED = 2.0
"""Standard errors below zero at which an input is called reversed."""


def solution_doubts(solution: Solution) -> list[Doubt]:
    """Return what is doubtful about any solution, whatever its parameters mean.

    Of the explicit numbers of one axis only what people need no names for: ``doubts.collect`` says the rest.
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
        "the fit did not converge",
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
        causes.append(f"{', '.join(none)} stopped at zero, beyond which damping drives: these runs show none of it")
        cures.append("nothing if other damping was found; otherwise fly slower and faster runs")
    if held:
        causes.append(f"{', '.join(held)} stopped at a bound: the runs prefer a value beyond it; it was fixed there")
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
    k = len(solution.names)
    covariance = solution.whole[:k, :k]
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(std > 0.0, std, np.inf)
    rho = np.triu(np.abs(covariance / np.outer(scale, scale)), 1)
    pairs = [(float(rho[i, j]), solution.names[i], solution.names[j]) for i, j in np.argwhere(rho > TOGETHER)]
    if not pairs:
        return None
    worst = sorted(pairs, reverse=True)[:3]
    text = "; ".join(f"{a} and {b} ({value:.4f})" for value, a, b in worst)
    return Doubt(
        "correlated",
        f"these are known only in combination (correlation of the estimates): {text}",
        "fix one of each pair to a value you know, or fly a manoeuvre with other speeds and turns",
    )


def reversed_input(form: Form, values: Mapping[str, float], std: Mapping[str, float]) -> Doubt | None:
    """Gains called ``k_*`` are positive when labels, wiring and signs are as the form has them; so are inertias of what
    an input drives with a gain that is known."""
    names = [n for n in std if n.startswith("k_") and values[n] < -REVERSED * std[n]]
    if not names:
        return REVERSED_INPUT if _is_backward(form, values, std) else None
    channels = [c for c, pairs in form.inputs.items() if any(str(g).lstrip("-") in names for _, g in pairs)]
    return Doubt(
        "reversed-input",
        f"{', '.join(names)} came out negative: {', '.join(channels)} act opposite to their names",
        "check labels, wiring and the sign of the inputs, left against right; the model holds for the log as it is",
    )


def _is_backward(form: Form, values: Mapping[str, float], std: Mapping[str, float]) -> bool:
    """Whether a degree of freedom that an input drives with a known gain has a negative inertia, surely."""
    driven = {force for pairs in form.inputs.values() for force, gain in pairs if not isinstance(gain, str)}
    inertia = np.diag(CoupledModel(form, {n: values[n] for n in form.parameters}).inertia)
    for dof, own in zip(form.dofs, inertia.tolist(), strict=True):
        spread = std.get(f"{DOFS[dof].force}_{DOFS[dof].velocity}dot")
        if DOFS[dof].force in driven and spread is not None and own < -REVERSED * spread:
            return True
    return False


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
    for r in solution.rests:
        model, errors = solution.noise_models[r.signal], np.abs(r.judged[r.known])
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
        "identify again with --robust (in Python loss='soft_l1'), or repair the sensor",
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
                f"these runs do not support {own.slug} at {own.place} ({said}): without it they are followed as well",
                f"leave it out; to look for it, fly {entry.separated_by}",
            )
