"""Second looks, where the search found nothing although much is left.

:func:`search_all_runs` looks over all runs together where those kept apart show what the others do not,
:func:`search_in_pieces` over pieces of them where free runs are lost and nothing pays over whole runs.
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
from gcs_autotune.identify import Doubt, Fitted, Segment, within_horizon
from gcs_autotune.sname import DOFS

__all__ = ["improves_prediction", "search_all_runs", "search_in_pieces"]

PACES = 30.0
"""Chosen: a piece lasts so many of the base model's slowest time constants; all it can show settles many times over."""

FAR = 1.5
"""Error of runs a model was not fitted to, over the noise of those it was, beyond which it does not hold for them."""

ANOTHER_CRAFT = 100.0
"""Chosen: factor between the time constant of the base when it was first fitted and as it stands, from which on the two
are not the same craft."""

FEWEST_PIECES = 2
"""Fewest pieces of the longest run worth a second look."""


def search_in_pieces(state: SearchState) -> SearchState | None:
    """Search pieces that begin where the craft was measured to be; what they name must hold over whole runs.

    On real water a free run drifts off within minutes, whatever the model: gusts and eddies add up in the heading.
    Where the plain model diverges, every candidate does, and none seems to improve it. Cut into pieces, the same runs
    may show causes. These are hypotheses. They are kept only if together they clearly improve the prediction of
    held-out pieces and of whole runs.
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
            f"no model of the craft fits, so no cause is reported: in pieces of {seconds:.3g} s the time constant of "
            f"the plain fit moved by more than a factor of {ANOTHER_CRAFT:g}",
            "check columns, units and clocks first; then record in calmer water, or with larger commands held longer",
        )
        return replace(state, doubts=(*state.doubts, lost), cut=(*state.cut, *again.cut))
    doubt = Doubt(
        "short-horizon",
        f"over whole runs no cause improves prediction; the causes reported were found in pieces of {seconds:.3g} s",
        "treat them as hypotheses; repeat in calm water, or record a run in which the craft returns to rest",
    )
    return replace(again, pieces=seconds, doubts=(*state.doubts, doubt), cut=(*state.cut, *again.cut))


def search_all_runs(state: SearchState) -> SearchState | None:
    """Search all runs together, parts left out in turn, where those kept apart show what the others do not."""
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
        "the runs to fit alone do not predict the held-out runs; the causes were found in all runs together",
        "fit runs with the same sizes of command as those to be predicted; here the gain is of parts left out in turn",
    )
    return replace(both, doubts=(*state.doubts, doubt), cut=(*state.cut, *both.cut))


def _is_another_craft(state: SearchState) -> bool:
    """Whether the base is not the craft any more that it was when first fitted: a name beside it means nothing."""
    model, first = state.base.model.base, state.problem.data_summary.time_constant
    now = []
    for i, dof in enumerate(model.form.dofs):
        damping = f"{DOFS[dof].force}_{DOFS[dof].velocity}"
        if damping in model.form.parameters and model[damping]:
            now.append(abs(float(model.inertia[i, i]) / model[damping]))
    return bool(now) and not 1.0 / ANOTHER_CRAFT < max(now) / first < ANOTHER_CRAFT


def _is_lost(state: SearchState) -> bool:
    """Whether nothing was found although much is left."""
    if state.fitted.effects != state.base.effects:
        return False
    return whiteness_of(tests_of(state.problem, state.fitted)) <= WHITE


def _contradicted(state: SearchState) -> bool:
    """Whether nothing was found in the runs to fit, and yet the runs kept apart are predicted far worse than those.

    Nothing: they show nothing, or what they show is explained, in all or in part, by causes that foretell nothing.
    """
    if state.fitted.effects or not state.base_unseen.complete:
        return False
    if _is_lost(state):
        return any(_refuted(step) or explains_all(state.problem, step) for step in state.steps)
    errors = rms_of(state.base_unseen.rests)
    return any(errors[n] > FAR * level for n, level in state.fitted.levels.items() if n in errors)


def _refuted(step: SearchStep[Fitted]) -> bool:
    """Return whether some candidate clearly improves the fit of the fitted runs but no prediction of held-out runs.

    Runs of one size of command each know nothing of what the next size does: only together they tell the law.
    """
    paying = [j for j in step.judged if j.evidence > 0.0 and j.gained > j.needed]
    return bool(paying) and not any(is_material(j) and j.p < LUCK for j in paying)


def _surely_gains(state: SearchState) -> bool:
    """Whether all that was found surely lowers the error of some signal left out.

    Each cause did when it came, over what was there before; what its rivals took the place of counts no more.
    """
    return any(g.ci95[1] < 1.0 for g in gains_of(state.base_unseen, state.present_unseen, state.parts.words))


def _holds_over(state: SearchState, whole: Sequence[Segment]) -> bool:
    """Whether what was found lowers the error over *whole* runs too, all signals together."""
    before, after = (_error(state, fitted, whole) for fitted in (state.base, state.fitted))
    if after is None:
        return False
    if before is None:
        return True
    logs = [math.log(max(after[n], 1e-300) / before[n]) for n in before if before[n] > 0.0]
    return bool(logs) and float(np.mean(logs)) < 0.0


def improves_prediction(state: SearchState, whole: Sequence[Segment]) -> bool:
    """Whether the model found in pieces leaves no more than :data:`FAR` times their noise over *whole* runs as well."""
    errors = _error(state, state.fitted, whole)
    return errors is not None and all(errors[n] <= FAR * level for n, level in state.fitted.levels.items())


def _error(state: SearchState, fitted: Fitted, whole: Sequence[Segment]) -> dict[str, float] | None:
    problem = state.problem.on(whole)
    found = problem.states(fitted.theta, fitted.effects, problem.first_states(whole))
    return None if found is None else rms_of(found.rests)
