"""Reasons not to trust a coupled fit blindly, each with its cause and its cure."""

from __future__ import annotations

import numpy as np

from gcs_autotune.identify.coupled.case import CoupledCase
from gcs_autotune.identify.coupled.delay import Delayed
from gcs_autotune.identify.coupled.odd_run import odd_run
from gcs_autotune.identify.likelihood import Limits
from gcs_autotune.identify.result import Doubt
from gcs_autotune.identify.solution import Solution, fit_percents
from gcs_autotune.identify.whiteness import autocorrelation

__all__ = ["doubts_of", "fit_percent_of", "general_doubts"]

POOR = 70.0
"""Fit [%] of a signal below which it counts as unexplained, when its residuals are coloured as well."""

COLOUR = 0.2
"""Autocorrelation within five samples above which coloured residuals are worth a word."""

TOGETHER = 0.99
"""Correlation of two estimates above which only a combination of them is known."""

REVERSED = 2.0
"""Standard errors below zero at which an input is called reversed."""

FAR = 6.0
"""Robust standard deviations beyond which a sample is an outlier."""


def doubts_of(case: CoupledCase, chosen: Delayed, limits: Limits) -> tuple[Doubt, ...]:
    """Return what is doubtful about the chosen fit, what the records already said first."""
    solution, records = chosen.local.solution, chosen.local.records
    found = [doubt for record in case.records for doubt in record.notes]
    of_its_own = (_pieces(chosen), _reversed(solution), _delay(chosen), odd_run(solution, records, limits))
    found += [*general_doubts(solution, robust=case.robust), *(d for d in of_its_own if d is not None)]
    return tuple({(d.slug, d.cause): d for d in found}.values())


def general_doubts(solution: Solution, *, robust: bool = False) -> list[Doubt]:
    """Return what is doubtful about any solution, whatever its parameters mean."""
    asked = (
        _not_converged(solution),
        _at_bound(solution),
        _not_excited(solution),
        _together(solution),
        _poor(solution),
        _coloured(solution),
        _outliers(solution, robust=robust),
    )
    return [doubt for doubt in asked if doubt is not None]


def fit_percent_of(solution: Solution) -> float:
    """Return 100 (1 - rms/std) averaged over signals."""
    shares = list(fit_percents(solution).values())
    return float(np.mean(shares)) if shares else 0.0


def _not_converged(solution: Solution) -> Doubt | None:
    if solution.converged:
        return None
    return Doubt(
        "not-converged", "the fit did not settle", "give start values in the form, fewer free parameters, or bounds"
    )


def _pieces(chosen: Delayed) -> Doubt | None:
    if not chosen.local.pieces:
        return None
    longest = max(float(np.ptp(r.stamps)) for r in chosen.local.records)
    return Doubt(
        "short-horizon",
        f"no model of this form follows a whole run; it was fitted to pieces of {longest:.0f} s each",
        "look for a missing term, a run of another vehicle, or a craft that does not keep its course by itself",
    )


def _at_bound(solution: Solution) -> Doubt | None:
    if not solution.at_bound:
        return None
    names = ", ".join(solution.at_bound)
    return Doubt(
        "at-bound",
        f"{names} stopped at a bound: the runs would have it beyond; it was taken as known there",
        "widen the bound, or leave the parameter out if it stands at zero",
    )


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


def _reversed(solution: Solution) -> Doubt | None:
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


def _delay(chosen: Delayed) -> Doubt | None:
    if chosen.evidence <= 0.0 or "delay" not in chosen.local.solution.free:
        return None
    return Doubt(
        "delay-fitted",
        f"a delay of {chosen.local.solution.value('delay'):.3f} s between inputs and motion was fitted "
        f"(evidence {chosen.evidence:.0f})",
        "give --delay if you know it; a slow actuator looks like a delay too: free 'lag' in the form",
    )


def _poor(solution: Solution) -> Doubt | None:
    if solution.white:
        return None
    poor = [f"{name} ({share:.0f} %)" for name, share in fit_percents(solution).items() if share < POOR]
    if not poor:
        return None
    return Doubt(
        "poor-fit",
        f"the model explains these signals only in part: {', '.join(poor)}",
        "look at the fit's plot: wind, current, a missing term, a slipping clock or the wrong input may be at work",
    )


def _coloured(solution: Solution) -> Doubt | None:
    colour = max(float(np.max(np.abs(autocorrelation(s, 5)))) for s in solution.scores)
    if colour <= COLOUR or solution.white:
        return None
    return Doubt(
        "residuals-not-white",
        f"the residuals are correlated ({colour:.2f}): the model misses something; standard errors were raised for it",
        "look at the residuals; wind, waves, current, a slow actuator or a missing term may be at work",
    )


def _outliers(solution: Solution, *, robust: bool) -> Doubt | None:
    if robust:
        return None
    share = 0.0
    for r in solution.residuals:
        rough = max(1.4826 * float(np.median(np.abs(r.judged[r.known]))), r.step, 1e-300)
        share = max(share, float(np.mean(np.abs(r.judged[r.known]) > FAR * rough)))
    if share <= 0.005:
        return None
    return Doubt(
        "outliers",
        f"{100 * share:.1f} % of the samples lie far off the rest",
        "identify again with loss='soft_l1', or mend the sensor",
    )
