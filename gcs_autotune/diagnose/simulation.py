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
from gcs_autotune.rounding import counted
from gcs_autotune.sname import SIGNALS
from gcs_autotune.trial import Trial

__all__ = ["stand_in", "surrogate_of"]

FAITHFUL, PLAIN_ENOUGH = 0.05, 0.02
"""Limits for the error of the surrogate model, relative to the motion.

FAITHFUL: above it a doubt is reported. PLAIN_ENOUGH: above it further effects of the simulator are looked for.
"""

SHED = 0.005
"""Fraction of the motion that a term of the surrogate model must explain to be kept."""

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
            f"there are {counted(len(runs), 'run')} but {counted(len(simulations), 'simulation')}. Supply one "
            "simulation per run, in the same order"
        )
    records = compared(simulations, runs)
    flown = records.simulations
    base = form if form is not None else plain_form(flown, dof)
    segments, doubts = prepare_as_recorded(flown, base, use)

    def report(stage: str, done: int, total: int) -> None:
        if progress is not None:
            progress(f"the simulation: {stage}", done, total)

    problem, fitted = stand_in(base, segments, report)
    if any(share > PLAIN_ENOUGH for share in _missed(problem, fitted).values()):
        slugs = [s for s in effects if EFFECTS[s].family != "data errors"]
        state = follow(
            begin_with(Question(base, segments, slugs, progress=report, executor=executor_for(jobs)), problem, fitted),
            SEARCH,
        )
        problem, fitted = state.problem, state.fitted
    for name, share in _missed(problem, fitted).items():
        if share > FAITHFUL:
            doubts.append(
                Doubt(
                    "simulation-not-understood",
                    f"the model fitted to the simulation does not reproduce {100 * share:.0f} % of the simulated "
                    f"{name}",
                    "supply the equations as a model file (--model) instead of the output",
                )
            )
    given = ModelInQuestion(fitted.model, theirs=(problem, fitted), records=records.rows)
    return given, [*_directly(simulations, flown, runs), *records.doubts, *doubts]


def _directly(simulations: Sequence[Trial], placed: Sequence[Trial], runs: Sequence[Trial]) -> list[Doubt]:
    """Return a doubt with the direct error of the simulation for each signal, in its worst run.

    placed : the simulations with clock, signs and units corrected.
    """
    uncorrected, corrected = _misses(simulations, runs), _misses(placed, runs)
    if not corrected:
        return []
    differences = (
        f"the unmodified simulation differs from the run in {uncorrected}"
        if uncorrected
        else "the unmodified simulation does not overlap the run in time"
    )
    if uncorrected != corrected:
        differences += f". With clock, signs and units corrected it differs in {corrected}"
    return [
        Doubt(
            "simulation-off",
            f"the errors shown are those of a model fitted to the simulation. Worst run (rms): {differences}",
            "supply the simulation's equations as a model file (--model), or start its runs at the state of the craft",
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


def stand_in(form: Form, segments: Sequence[Segment], report: Progress) -> tuple[Problem, Fitted]:
    """Return the plain model with the quadratic drag, delay and trim that it needs to follow a simulation.

    If an :class:`.Effort` around the call is used up, the best fit so far is returned.
    """
    report("plain model", 0, 1)
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
    report("plain model", 1, 1)
    return problem, best


STARTS = ((0.0, 0.0), (0.3, 0.0), (0.0, 0.5), (0.3, 0.5))
"""Start values of delay [time constants] and quadratic drag (relative to the largest tried).

They are tried in order until the model follows the simulation.
"""


def _terms(problem: Problem) -> tuple[EffectInstance, ...]:
    data, effects = problem.data_summary, []
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
                effects.append(EffectInstance(slug, place, start, dict(entry.constants(place, data))))
    return in_order(effects)


def _begun(term: EffectInstance, problem: Problem, late: float, drag: float) -> EffectInstance:
    data = problem.data_summary
    if term.slug == "input-delay":
        return term.with_values({"delay": late * data.time_constant})
    if term.slug == "quadratic-drag":
        starts = EFFECTS[term.slug].starts(term.place, data)
        return term.with_values({"coefficient": drag * starts[-1]["coefficient"]})
    return term


def _least_sure_first(fitted: Fitted) -> list[tuple[str, str]]:
    """Return slug and place of every effect of a fit, the least significant first."""
    std = np.sqrt(np.maximum(np.diag(fitted.covariance(correlation_of(fitted))), 1e-300))[len(fitted.free) :]
    sure = {i: abs(fitted.effects[i].values[n]) / s for (i, n), s in zip(fitted.free_effects, std, strict=False)}
    return [(fitted.effects[i].slug, fitted.effects[i].place) for i in sorted(sure, key=lambda i: sure[i])]


def _without(problem: Problem, fitted: Fitted, own: tuple[str, str]) -> Fitted | None:
    """Return the fit without an effect; return None if the effect is needed."""
    rest = tuple(e for e in fitted.effects if (e.slug, e.place) != own)
    fit = problem.fit(fitted.theta, rest, fitted.initial, shift=fitted.shift)
    if fit is None:
        return None
    gain = (fit.cost - fitted.cost) / correlation_of(fitted)
    moved = max(math.sqrt(max(fit.levels[n] ** 2 - s**2, 0.0)) / problem.motion[n] for n, s in fitted.levels.items())
    return None if gain > SURE and moved > SHED else fit


def _missed(problem: Problem, fitted: Fitted) -> dict[str, float]:
    """Return a model's error of every signal beyond noise, relative to the motion."""
    noise = {n: problem.data_summary.level.get(n, 0.0) for n in fitted.levels}
    return {n: math.sqrt(max(s**2 - noise[n] ** 2, 0.0)) / problem.motion[n] for n, s in fitted.levels.items()}
