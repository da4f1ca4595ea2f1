"""Model the output of another simulator, so that it can be compared and extended.

Only the simulator's output is known. A plain model with linear and quadratic drag, a delay and a trim represents it.
Other effects are added only if that model misses the simulator's output. A simulation has no noise, so every small
error of its integrator would otherwise be significant. Then gain, time constant, delay and trim of both are compared.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from gcs_autotune.clock import OutOfTime
from gcs_autotune.diagnose.adequacy import correlation_of
from gcs_autotune.diagnose.plain_numbers import driven_by
from gcs_autotune.diagnose.question import ModelInQuestion, Progress, Question
from gcs_autotune.diagnose.simulation_alignment import compared
from gcs_autotune.diagnose.state import begin_with
from gcs_autotune.diagnose.strategies import SEARCH, follow
from gcs_autotune.effects import EFFECTS, EffectInstance, columns_of, in_order
from gcs_autotune.errors import UsageError
from gcs_autotune.executor import executor_for
from gcs_autotune.identify import Doubt
from gcs_autotune.identify.problems import Fitted, Problem, fit_base, plain_form
from gcs_autotune.identify.signals import Segment, prepare_as_recorded
from gcs_autotune.models import Form
from gcs_autotune.sname import SIGNALS
from gcs_autotune.trial import Trial

__all__ = ["stand_in", "surrogate_of"]

FAITHFUL, PLAIN_ENOUGH = 0.05, 0.02
"""Limits for the error of the stand-in model, relative to the motion.

FAITHFUL: above it a doubt is reported. PLAIN_ENOUGH: above it further effects of the simulator are looked for.
"""

SHED = 0.005
"""Fraction of the motion that a term of the stand-in model must explain to be kept."""

SURE = 12.0
"""Twice the log-likelihood that a term must also gain to be kept; it matters if the simulation is noisy."""


def surrogate_of(
    simulations: Sequence[Trial],
    runs: Sequence[Trial],
    *,
    dof: str | None,
    use: Sequence[str] | None,
    form: Form | None,
    effects: Sequence[str],
    progress: Progress | None = None,
    jobs: int = 1,
) -> tuple[ModelInQuestion, list[Doubt]]:
    """Return a model that reproduces the simulator's output, with its fit, and the results of the direct comparison.

    simulations : one per run, in the same order. Missing inputs are taken from the run.

    Raises
    ------
    UsageError
        The numbers of simulations and runs differ.
    """
    if len(simulations) != len(runs):
        raise UsageError(
            f"{len(runs)} run(s) but {len(simulations)} simulation(s): supply one per run, in the same order"
        )
    records = compared(simulations, runs)
    flown = records.simulations
    base = form if form is not None else plain_form(flown, dof)
    segments, doubts = prepare_as_recorded(flown, base, use)

    def told(stage: str, done: int, total: int) -> None:
        if progress is not None:
            progress(f"the simulation: {stage}", done, total)

    problem, found = stand_in(base, segments, told)
    if any(share > PLAIN_ENOUGH for share in _missed(problem, found).values()):
        slugs = [s for s in effects if EFFECTS[s].family != "data errors"]
        state = follow(
            begin_with(Question(base, segments, slugs, progress=told, executor=executor_for(jobs)), problem, found),
            SEARCH,
        )
        problem, found = state.problem, state.fitted
    for name, share in _missed(problem, found).items():
        if share > FAITHFUL:
            doubts.append(
                Doubt(
                    "simulation-not-understood",
                    f"the model fitted to the simulation misses its {name} by {100 * share:.0f} % of the motion",
                    "supply its equations as a model file (--model) instead of its output",
                )
            )
    given = ModelInQuestion(found.model, theirs=(problem, found), records=records.rows)
    return given, [*_directly(simulations, flown, runs), *records.doubts, *doubts]


def _directly(simulations: Sequence[Trial], placed: Sequence[Trial], runs: Sequence[Trial]) -> list[Doubt]:
    """Return a doubt with the direct error of the simulation for each signal, in its worst run.

    placed : the simulations with clock, signs and units corrected.
    """
    told, right = _misses(simulations, runs), _misses(placed, runs)
    if not right:
        return []
    said = f"unchanged it misses {told}" if told else "unchanged it covers other times"
    if told != right:
        said += f", with clock, signs and units corrected {right}"
    return [
        Doubt(
            "simulation-off",
            f"the errors shown are of a model fitted to the simulation; {said} (rms, worst run)",
            "supply its equations as a model file (--model), or start its runs at the state of the craft",
        )
    ]


def _misses(simulations: Sequence[Trial], runs: Sequence[Trial]) -> str:
    worst: dict[str, float] = {}
    for simulation, run in zip(simulations, runs, strict=True):
        for name in ("psi", "r", "u", "v", "w", "x", "y", "z"):
            if name not in simulation or name not in run:
                continue
            theirs, ours = simulation[name], run[name]
            inside = (ours.t >= theirs.t[0]) & (ours.t <= theirs.t[-1])
            if inside.sum() < 2:
                continue
            error = ours.values[inside] - np.interp(ours.t[inside], theirs.t, theirs.values)
            if name == "psi":
                error = np.mod(error + np.pi, 2.0 * np.pi) - np.pi
            worst[name] = max(worst.get(name, 0.0), float(np.sqrt(np.mean(error**2))))
    return ", ".join(f"{n} by {rms:.3g} {SIGNALS[n][0]}" for n, rms in worst.items())


# -- the stand-in


def stand_in(form: Form, segments: Sequence[Segment], told: Progress) -> tuple[Problem, Fitted]:
    """Return the plain model with the quadratic drag, delay and trim that it needs to follow a simulation.

    If an :class:`.Effort` around the call is used up, the best fit so far is returned.
    """
    told("plain model", 0, 1)
    problem, best = fit_base(form, segments)
    base, terms = best, _terms(problem)
    try:
        for late, drag in STARTS:
            begun = tuple(_begun(e, problem, late, drag) for e in terms)
            fit = problem.fit(base.theta, begun, base.initial, trials=60, shift=base.shift)
            best = fit if fit is not None and fit.cost < best.cost else best
            if all(share < SHED for share in _missed(problem, best).values()):
                break
        for own in _least_sure_first(best):
            best = _without(problem, best, own) or best
    except OutOfTime:
        return problem, best
    told("plain model", 1, 1)
    return problem, best


STARTS = ((0.0, 0.0), (0.3, 0.0), (0.0, 0.5), (0.3, 0.5))
"""Start values of delay [time constants] and quadratic drag (relative to the largest tried).

They are tried in order until the model follows the simulation.
"""


def _terms(problem: Problem) -> tuple[EffectInstance, ...]:
    data, found = problem.data_summary, []
    driven = driven_by(problem.form)
    for slug, places in (
        ("input-delay", list(dict.fromkeys(c for c, _ in driven.values()))),
        ("quadratic-drag", list(problem.form.dofs)),
        ("input-bias", list(driven)),
        ("net-buoyancy", [d for d in driven if d == "heave"]),
    ):
        entry = EFFECTS[slug]
        lacking = set(places)
        for place in entry.places(data):
            if lacking.issuperset(columns_of(place)):
                lacking -= set(columns_of(place))
                start = dict.fromkeys(entry.starts(place, data)[0], 0.0)
                found.append(EffectInstance(slug, place, start, dict(entry.constants(place, data))))
    return in_order(found)


def _begun(term: EffectInstance, problem: Problem, late: float, drag: float) -> EffectInstance:
    data = problem.data_summary
    if term.slug == "input-delay":
        return term.with_values({"delay": late * data.time_constant})
    if term.slug == "quadratic-drag":
        starts = EFFECTS[term.slug].starts(term.place, data)
        return term.with_values({"coefficient": drag * starts[-1]["coefficient"]})
    return term


def _least_sure_first(found: Fitted) -> list[tuple[str, str]]:
    """Return slug and place of every effect of a fit, the least significant first."""
    std = np.sqrt(np.maximum(np.diag(found.covariance(correlation_of(found))), 1e-300))[len(found.free) :]
    sure = {i: abs(found.effects[i].values[n]) / s for (i, n), s in zip(found.free_effects, std, strict=False)}
    return [(found.effects[i].slug, found.effects[i].place) for i in sorted(sure, key=lambda i: sure[i])]


def _without(problem: Problem, found: Fitted, own: tuple[str, str]) -> Fitted | None:
    """Return the fit without an effect; return None if the effect is needed."""
    rest = tuple(e for e in found.effects if (e.slug, e.place) != own)
    fit = problem.fit(found.theta, rest, found.initial, shift=found.shift)
    if fit is None:
        return None
    worth = (fit.cost - found.cost) / correlation_of(found)
    moved = max(math.sqrt(max(fit.levels[n] ** 2 - s**2, 0.0)) / problem.motion[n] for n, s in found.levels.items())
    return None if worth > SURE and moved > SHED else fit


def _missed(problem: Problem, found: Fitted) -> dict[str, float]:
    """Return a model's error of every signal beyond noise, relative to the motion."""
    noise = {n: problem.data_summary.level.get(n, 0.0) for n in found.levels}
    return {n: math.sqrt(max(s**2 - noise[n] ** 2, 0.0)) / problem.motion[n] for n, s in found.levels.items()}
