"""Retry the search if it found nothing although much is unexplained.

:func:`search_all_runs` searches all runs together if the fitted runs show no cause but do not predict the separate
runs. :func:`search_in_pieces` searches pieces of the runs if free runs diverge and no cause helps over whole runs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gcs_autotune.diagnose.adequacy import WHITE, explains_all, tests_of, whiteness_of
from gcs_autotune.diagnose.heldout import gains_of, rms_of
from gcs_autotune.diagnose.score import LUCK, SearchStep, is_material
from gcs_autotune.diagnose.search_with_noise import NO_MODEL, model_process_noise, no_model_with_noise
from gcs_autotune.diagnose.state import SearchState, begin
from gcs_autotune.diagnose.strategies import SEARCH, follow
from gcs_autotune.identify import Doubt
from gcs_autotune.identify.problems import Fitted
from gcs_autotune.identify.signals import Segment, within_horizon
from gcs_autotune.sname import DOFS

__all__ = ["improves_prediction", "search_all_runs", "search_in_pieces"]

PACES = 30.0
"""Length of a piece in the base model's slowest time constants. The motion settles many times within it."""

FAR = 1.5
"""Ratio of the error on other runs to the noise of the fitted runs, above which a model does not predict them."""

ANOTHER_CRAFT = 100.0
"""Ratio of the base model's first and present time constants, above which they describe different craft."""

FEWEST_PIECES = 2
"""Minimum number of pieces in the longest run for a search in pieces."""


def search_in_pieces(state: SearchState) -> SearchState | None:
    """Search pieces of the runs that start at the measured state; the causes must also hold over whole runs.

    On real water a free simulation diverges within minutes, whatever the model: gusts and eddies add up in the heading.
    If the plain model diverges, every candidate does, and none seems to improve it. Cut into pieces, the same runs may
    show causes. These are hypotheses. They are kept only if together they clearly improve the prediction of held-out
    pieces and of whole runs.
    """
    question = state.question
    seconds = PACES * state.problem.data_summary.time_constant
    if (
        question.horizon is not None
        or no_model_with_noise(state)
        or (state.with_noise is not None and (bool(state.with_noise.accepted) or len(question.form.dofs) == 1))
        or state.problem.data_summary.duration < FEWEST_PIECES * seconds
        or not _is_lost(state)
    ):
        return None
    segments, unseen = within_horizon(question.segments, seconds), within_horizon(question.unseen, seconds)
    again = follow(begin(replace(question, segments=segments, unseen=unseen, with_noise=False)), SEARCH)
    if again.fitted.effects == again.base.effects or not (_surely_gains(again) and _holds_over(again, question.whole)):
        return replace(state, cut=(*state.cut, *again.cut))
    if _is_another_craft(again):
        lost = Doubt(
            NO_MODEL,
            f"no model of the craft fits, so no cause is reported. With the runs cut into pieces of {seconds:.3g} s, "
            f"the time constant of the plain model changed by more than a factor of {ANOTHER_CRAFT:g}",
            "check columns, units and clocks first. Then record in calmer water, or use larger commands held longer",
        )
        return replace(state, doubts=(*state.doubts, lost), cut=(*state.cut, *again.cut))
    doubt = Doubt(
        "short-horizon",
        "no cause improves prediction over whole runs. The reported causes improve it only with the runs cut into "
        f"pieces of {seconds:.3g} s",
        "treat the causes as hypotheses. Repeat in calm water, or record a run in which the craft returns to rest",
    )
    return replace(again, pieces=seconds, doubts=(*state.doubts, doubt), cut=(*state.cut, *again.cut))


def search_all_runs(state: SearchState) -> SearchState | None:
    """Search all runs together, if the fitted runs alone show no cause but do not predict the separate runs.

    Parts of all runs are left out in turn.
    """
    question = state.question
    if not question.unseen or question.given is not None or not _contradicted(state):
        return None
    both = follow(begin(replace(question, segments=[*question.segments, *question.unseen], unseen=())), SEARCH)
    if not both.fitted.effects:
        both = follow(both, (model_process_noise,))
    if not both.fitted.effects:
        return replace(state, cut=(*state.cut, *both.cut))
    doubt = Doubt(
        "validation-was-needed",
        "the fitted runs do not predict the held-out runs. The causes were therefore identified in all runs together",
        "use the same command sizes in the fitted and the held-out runs. The gain shown is for parts held out in turn",
    )
    return replace(both, doubts=(*state.doubts, doubt), cut=(*state.cut, *both.cut))


def _is_another_craft(state: SearchState) -> bool:
    """Return whether the base differs so much from its first fit that causes added to it mean nothing."""
    model, first = state.base.model.base, state.problem.data_summary.time_constant
    now = []
    for i, dof in enumerate(model.form.dofs):
        damping = f"{DOFS[dof].force}_{DOFS[dof].velocity}"
        if damping in model.form.parameters and model[damping]:
            now.append(abs(float(model.inertia[i, i]) / model[damping]))
    return bool(now) and not 1.0 / ANOTHER_CRAFT < max(now) / first < ANOTHER_CRAFT


def _is_lost(state: SearchState) -> bool:
    """Return whether no cause was found although the residuals are not white."""
    if state.fitted.effects != state.base.effects:
        return False
    return whiteness_of(tests_of(state.problem, state.fitted)) <= WHITE


def _contradicted(state: SearchState) -> bool:
    """Return whether the fitted runs show no cause, but their model predicts the separate runs far worse.

    The fitted runs show no cause if their residuals are noise, or if all causes that explain them predict no other
    runs.
    """
    if state.fitted.effects or not state.base_unseen.complete:
        return False
    if _is_lost(state):
        return any(_refuted(step) or explains_all(state.problem, step) for step in state.steps)
    errors = rms_of(state.base_unseen.rests)
    return any(errors[n] > FAR * level for n, level in state.fitted.levels.items() if n in errors)


def _refuted(step: SearchStep[Fitted]) -> bool:
    """Return whether some candidate clearly improves the fit, but none improves the prediction of held-out runs.

    If each run has commands of one size, no run predicts a run of another size. Only together do they identify the law.
    """
    paying = [j for j in step.judged if j.evidence > 0.0 and j.gained > j.needed]
    return bool(paying) and not any(is_material(j) and j.p < LUCK for j in paying)


def _surely_gains(state: SearchState) -> bool:
    """Return whether all causes together significantly lower the held-out error of some signal.

    Each cause did so when it was accepted. Gains of causes that were replaced later do not count.
    """
    return any(g.ci95[1] < 1.0 for g in gains_of(state.base_unseen, state.present_unseen, state.parts.words))


def _holds_over(state: SearchState, whole: Sequence[Segment]) -> bool:
    """Return whether the causes also lower the error over *whole* runs, all signals together."""
    before, after = (_error(state, fitted, whole) for fitted in (state.base, state.fitted))
    if after is None:
        return False
    if before is None:
        return True
    logs = [math.log(max(after[n], 1e-300) / before[n]) for n in before if before[n] > 0.0]
    return bool(logs) and float(np.mean(logs)) < 0.0


def improves_prediction(state: SearchState, whole: Sequence[Segment]) -> bool:
    """Return whether the errors over *whole* runs are at most :data:`FAR` times the noise of the pieces."""
    errors = _error(state, state.fitted, whole)
    return errors is not None and all(errors[n] <= FAR * level for n, level in state.fitted.levels.items())


def _error(state: SearchState, fitted: Fitted, whole: Sequence[Segment]) -> dict[str, float] | None:
    problem = state.problem.on(whole)
    states = problem.states(fitted.theta, fitted.effects, problem.first_states(whole))
    return None if states is None else rms_of(states.rests)
