"""Collect reasons not to trust a maximum-likelihood solution, for any form and effects."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from gcs_autotune import chi_square
from gcs_autotune.effects import EFFECTS
from gcs_autotune.identify.axis.form import ExplicitForm
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.doubts import COLOUR, REVERSED_INPUT, poor_fit
from gcs_autotune.identify.problems.fitted import Fitted
from gcs_autotune.identify.problems.problem import Problem
from gcs_autotune.identify.problems.solution import Solution, fit_percents
from gcs_autotune.identify.result import Parameter
from gcs_autotune.identify.signals.whiteness import autocorrelation
from gcs_autotune.models import CoupledModel, Form
from gcs_autotune.rounding import format_value
from gcs_autotune.sname import DOFS

__all__ = ["effect_doubts", "reversed_input", "solution_doubts"]

TOGETHER = 0.99
"""Correlation of two estimates above which only a combination of both is known."""

FAR, OFTEN = 6.0, 0.005
"""Limits for outliers. FAR: standard deviations above which a sample is an outlier. OFTEN: fraction of outliers above
which a doubt is raised."""

SIGNIFICANCE = 0.01
"""Probability that the test keeps an effect that does not exist."""

REVERSED = 2.0
"""Standard errors below zero from which an input counts as reversed."""


def solution_doubts(solution: Solution) -> list[Doubt]:
    """Return the doubts about any solution.

    For a solution in explicit parameters of one axis, doubts that need parameter names are left out.
    :func:`.doubts.collect` returns those.
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
        "record longer; supply the structure, start values or the delay; or fit fewer parameters",
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
        causes.append(f"{', '.join(none)} stopped at zero, the limit of damping: these runs show no such damping")
        cures.append("no action if other damping was identified; otherwise fly slower and faster runs")
    if held:
        causes.append(
            f"{', '.join(held)} stopped at a bound and was fixed there. The runs fit a value beyond it better"
        )
        cures.append("widen the bound, or omit the parameter")
    return Doubt("at-bound", "; ".join(causes), "; ".join(cures))


def _not_excited(solution: Solution) -> Doubt | None:
    if not solution.blind:
        return None
    return Doubt(
        "not-excited",
        f"nothing in these runs depends on {', '.join(solution.blind)}: their values are meaningless",
        "fly a manoeuvre that moves these degrees of freedom, measure the parameters, or omit them from the form",
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
        "fix one of each pair to a known value, or fly a manoeuvre with other speeds and turns",
    )


def reversed_input(form: Form, values: Mapping[str, float], std: Mapping[str, float]) -> Doubt | None:
    """Return a doubt about negative gains ``k_*``, which indicate reversed labels, wiring or signs of inputs.

    The same holds for a negative inertia of a motion that an input drives with a known gain.
    """
    names = [n for n in std if n.startswith("k_") and values[n] < -REVERSED * std[n]]
    if not names:
        return REVERSED_INPUT if _is_backward(form, values, std) else None
    channels = [c for c, pairs in form.inputs.items() if any(str(g).lstrip("-") in names for _, g in pairs)]
    return Doubt(
        "reversed-input",
        f"{', '.join(names)} are negative: {', '.join(channels)} act opposite to their names",
        "check labels, wiring, signs and left/right of the inputs; the model is valid for the log as recorded",
    )


def _is_backward(form: Form, values: Mapping[str, float], std: Mapping[str, float]) -> bool:
    """Return whether a degree of freedom that an input drives with a known gain has a negative inertia.

    The inertia must be below zero by :data:`REVERSED` standard errors.
    """
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
        f"the residuals are correlated ({colour:.2f}), so a term is missing from the model. The standard errors "
        "were increased",
        "inspect the residuals; check for wind, waves, current, a slow actuator, another axis or a missing term",
    )


def _outliers(solution: Solution) -> Doubt | None:
    """Return a doubt about samples far from the others, or None.

    Signals with robust weights are skipped. For a rounding sensor the limit includes noise and resolution.
    """
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
        f"{100 * share:.1f} % of the samples are outliers",
        "identify again with --robust (in Python loss='soft_l1'), or repair the sensor",
    )


def effect_doubts(
    problem: Problem, fitted: Fitted, parameters: Mapping[str, Parameter], correlation: float
) -> Iterator[Doubt]:
    """Yield a doubt for every effect that the runs do not support, by a likelihood ratio test.

    correlation : number of samples that count as one independent sample.
    """
    for own in fitted.effects:
        entry = EFFECTS[own.slug]
        others = tuple(e for e in fitted.effects if e is not own)
        without = problem.fit(fitted.theta, others, fitted.initial, shift=fitted.shift)
        pays = math.inf if without is None else without.cost - fitted.cost
        numbers = max(len(entry.parameters), 1)
        if chi_square.exceeded_by_chance(max(pays, 0.0) / correlation, numbers) > SIGNIFICANCE:
            known = ((n, v, parameters[own.label_of(n)].std) for n, v in own.values.items())
            said = ", ".join(f"{n} = {format_value(v, std)}" for n, v, std in known)
            yield Doubt(
                "effect-not-needed",
                f"these runs do not support {own.slug} at {own.place} ({said}): the model fits as well without it",
                f"omit it; to test for it, fly  {entry.separated_by}",
            )
