"""Collect reasons not to trust an identification, each with its cause and a remedy.

:func:`collect` returns the doubts about the runs and parameters of one axis, for any method. Doubts about a
maximum-likelihood solution, for any form and effects, are in ``solution_doubts``. Doubts of a single method
(innovations of a filter, choice of a structure) are in that method's module.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gcs_autotune.identify.axis.form import Structure
from gcs_autotune.identify.axis.signals import first_names
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.problems.solution import Solution
from gcs_autotune.identify.relay.limit_cycle import PERIODS, SCATTER
from gcs_autotune.identify.result import Decision, LimitCycle, Parameter
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.models import SingleDof

__all__ = [
    "COLOUR",
    "OF_THE_RUNS",
    "POOR",
    "Findings",
    "collect",
    "delay_fitted",
    "once",
    "poor_fit",
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
"""Slugs of the doubts about the runs themselves, which apply to any model."""

WEAK = 0.30
"""Relative standard error above which a parameter counts as weakly excited."""

POOR = 70.0
"""Fit [%] of a signal below which the model counts as explaining it only in part."""

COLOUR = 0.2
"""Autocorrelation of residuals or innovations above which a doubt is raised. A smaller one hardly changes a confidence
interval."""


def once(doubts: Iterable[Doubt]) -> tuple[Doubt, ...]:
    """Return *doubts* in their order, without repeats of the same slug and cause."""
    return tuple({(d.slug, d.cause): d for d in doubts}.values())


def poor_fit(shares: Mapping[str, float]) -> Doubt | None:
    """Return a doubt about signals that the model explains only in part, or None.

    shares : fit [%] per signal.
    """
    poor = [f"{name} ({share:.0f} %)" for name, share in shares.items() if share < POOR]
    if not poor:
        return None
    return Doubt(
        "poor-fit",
        f"the model explains these signals only in part: {', '.join(poor)}",
        "inspect the plot of the fit; check for wind, current, other axes, a missing term, a drifting clock or a "
        "wrong input",
    )


def delay_fitted(solution: Solution, evidence: float) -> Doubt | None:
    """Return a doubt that a delay was fitted, or None if none was.

    evidence : decrease of the criterion with the delay.
    """
    if evidence <= 0.0 or "delay" not in solution.free:
        return None
    return Doubt(
        "delay-fitted",
        f"a delay of {solution.value('delay'):.2g} s between input and motion was fitted. It lowers BIC (misfit "
        f"with a penalty per parameter) by {evidence:.0f}",
        "supply --delay if it is known; if the actuator is slow, fit a form with 'lag' free instead",
    )


@dataclass(frozen=True, slots=True, eq=False)
class Findings:
    """Values that the checks use.

    ``noise``: standard deviation of the noise in the main signal. ``white``: whether the residuals are white, so that
    nothing is left to explain.
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


def collect(findings: Findings) -> tuple[Doubt, ...]:
    """Return the doubts of the records, then those of every check, without repeats."""
    notes = [doubt for record in findings.case.records for doubt in record.notes]
    return once([*notes, *(d for check in _CHECKS if (d := check(findings)) is not None)])


REVERSED_INPUT = Doubt(
    "reversed-input",
    "a positive input turns or pushes against the SNAME convention, so the fitted parameters are negative",
    "this is normal for a rudder angle; otherwise check wiring and sign of the channel",
)
"""Doubt for a model with negative inertia, which indicates an input of reversed sign."""


def _few_periods(f: Findings) -> Doubt | None:
    if not f.relays or f.case.cut_short or max(c.periods for c in f.relays) >= PERIODS:
        return None
    most = max(c.periods for c in f.relays)
    return Doubt(
        "few-periods",
        f"only {most} full period(s) of self-oscillation; {PERIODS} are required",
        "let the relay run longer",
    )


def _unsettled(f: Findings) -> Doubt | None:
    if not f.relays or f.case.cut_short or min(c.scatter for c in f.relays) <= SCATTER:
        return None
    worst = min(c.scatter for c in f.relays)
    cause = "only one period" if np.isinf(worst) else f"maxima and minima scatter by {100 * worst:.0f} %"
    return Doubt(
        "unsettled",
        f"the oscillation never settled ({cause}; the limit is {100 * SCATTER:.0f} %)",
        "wait for calmer water, use a larger C (output) or x_a (switching value), or let the relay run longer",
    )


def _condition(f: Findings) -> Doubt | None:
    broken = [c for c in f.relays if not c.valid]
    if not broken:
        return None
    return Doubt(
        "not-self-oscillation",
        f"{len(broken)} of {len(f.relays)} relay settings violate x_a* + |x_0| < X_m (Miskovic2010, eq. 7.12). "
        "IS-O is not valid for them; the simulated fit is",
        "use a larger C or a smaller x_a; trim away the constant force",
    )


PUSHES_BOTH_WAYS: Mapping[str, str] = {
    "yaw": "fly a manoeuvre that pushes both ways: a relay, a zig-zag",
    "surge": "fly well-separated steps ahead (throttle-steps), or pulses ahead and astern (doublets)",
}
"""Degree of freedom -> manoeuvre to fly if the input had only one sign. Those not listed need a relay or doublets."""


def _one_sided(f: Findings) -> Doubt | None:
    if any(float(r.tau.min()) < 0.0 < float(r.tau.max()) for r in f.case.records):
        return None
    return Doubt(
        "one-sided-input",
        "the input never changes sign: constant force and drag are poorly separated",
        PUSHES_BOTH_WAYS.get(f.model.dof, "fly a manoeuvre that pushes both ways: a relay, doublets"),
    )


def _saturated(f: Findings) -> Doubt | None:
    if f.case.records[0].input_units[0] != "1" or f.relays:
        return None
    share = max(_time_at(r, 0.999) for r in f.case.records)
    if share <= 0.1:
        return None
    return Doubt(
        "saturated-input",
        f"the input is at full output for {100 * share:.0f} % of the time",
        "use smaller inputs; the record does not show commands beyond the actuator's limit",
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
        f"{100 * max(shares):.0f} % of the time steps differ from the median by more than half of it",
        "request a lower, steadier message rate; the fit uses each timestamp unchanged",
    )


def _time_unit(f: Findings) -> Doubt | None:
    step = min(float(np.median(np.diff(r.main.t))) for r in f.case.records)
    if 1e-3 <= step <= 5.0:
        return None
    return Doubt(
        "time-unit",
        f"the median time step is {step:.3g} s, so the time stamps may not be in seconds",
        "name the time column t[ms] or t[us] if it is in these units",
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
        "use a finer sensor or message, or larger oscillations",
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
    return None if f.model.alpha >= 0.0 else REVERSED_INPUT


def _negative_drag(f: Findings) -> Doubt | None:
    sign = np.sign(f.model.alpha)
    names = f.model.axis.parameter_names()[1:3]
    bad = [n for n in names if sign * f.parameters[n].value < 0.0]
    if not bad:
        return None
    return Doubt(
        "negative-drag",
        f"{', '.join(bad)} is destabilising: the model diverges without input",
        "check that input and output belong together and are synchronous; check for current or a course-unstable hull",
    )


def _poor(f: Findings) -> Doubt | None:
    return None if f.white else poor_fit({first_names(f.case.records)[0]: f.fit_percent})


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
        f"two limit cycles indicate {kind[f.decision.verdict]} damping, but the simulated fit indicates "
        f"{kind[f.structure]}",
        "fly a further relay with a clearly different output C",
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
"""Checks of one axis, in the order in which their doubts are listed."""
