"""The door of diagnosis: :func:`diagnose`, from runs to a verdict."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.diagnose.explained import explains_all
from gcs_autotune.diagnose.heldout import METRIC, rms_of
from gcs_autotune.diagnose.intake import taken_in, without_repeats
from gcs_autotune.diagnose.numbers import Given, given_of, judge_numbers
from gcs_autotune.diagnose.pieces import FAR, foretells, holds_over, horizon_for
from gcs_autotune.diagnose.result import Diagnosis
from gcs_autotune.diagnose.search import Search, begin_search
from gcs_autotune.diagnose.simulated import surrogate_of
from gcs_autotune.diagnose.telling import WHITE, told_of
from gcs_autotune.diagnose.whiteness import tests_of, whiteness_of
from gcs_autotune.diagnose.worth import check_alive, check_worth
from gcs_autotune.effects import EFFECTS, ExtendedModel
from gcs_autotune.errors import UsageError
from gcs_autotune.identify.base_model import fit_base, given_base, overlooked, plain_form
from gcs_autotune.identify.model_file import ModelFile
from gcs_autotune.identify.preparation import prepare_as_recorded
from gcs_autotune.identify.result import Doubt
from gcs_autotune.identify.segment import Segment, within_horizon
from gcs_autotune.models.coupled import Form
from gcs_autotune.registry import lookup
from gcs_autotune.trial import Trial

__all__ = ["METRIC", "diagnose"]

Array = NDArray[np.float64]

Progress = Callable[[str, int, int], None]


def diagnose(
    runs: Trial | Sequence[Trial],
    *,
    unseen: Sequence[Trial] = (),
    dof: str | None = None,
    use: Sequence[str] | None = None,
    form: Form | None = None,
    model: ExtendedModel | ModelFile | None = None,
    simulations: Sequence[Trial] = (),
    effects: Sequence[str] | None = None,
    progress: Progress | None = None,
    horizon: float | None = None,
    jobs: int = 1,
) -> Diagnosis:
    """Say what a simulation gets wrong, name the cause, and measure the gain on data it has not seen.

    Parameters
    ----------
    unseen : runs to measure the gain on; without any, parts of *runs* are left out in turn.
    dof : degrees of freedom to look at, joined by commas; all in the file when None.
    use : signals to compare; all measured when None.
    form : the base model's structure instead of the plain one. model : a base model with its numbers, as a file names
        them where it comes from one: first it is told which of these are wrong, and what setting them right gains;
        effects are looked for on top of the same model refitted, and their gains counted over it.
    simulations : what somebody else's simulator made of the same commands, one per run. It is modelled itself first;
        that model takes its place, and the plain model's numbers are compared.
    effects : slugs to try; the whole book when None.
    progress : called with a stage, how much of it is done, and how much there is.
    horizon : seconds a simulation runs freely before it starts again at what was measured, inf for whole runs; None:
        whole runs, and pieces where nothing pays over whole runs but much is left. What is found in pieces is a
        hypothesis, unless pieces were asked for and the model foretells whole runs down to the noise of pieces.
    jobs : processes to share the work among; the answer is the same.

    Raises
    ------
    MissingChannel, BadFile, NotInformative
        The runs cannot be used; the message says why and what to try.
    UsageError
        Contradictory arguments; an effect that is not in the book.
    """
    begun = time.perf_counter()
    together = [runs] if isinstance(runs, Trial) else list(runs)
    if not together:
        raise UsageError("no run was given to diagnose")
    slugs = list(EFFECTS) if effects is None else [lookup(EFFECTS, e, "effect").slug for e in effects]
    early: list[Doubt] = []
    given = None if model is None else given_of(model)
    if simulations:
        if given is not None:
            raise UsageError("give either a model or a simulation's output, not both")
        given, early = surrogate_of(simulations, together, dof=dof, use=use, form=form, effects=slugs)
    together, doubts = taken_in(together)
    others, more = taken_in(unseen) if unseen else ([], [])
    together, repeats = without_repeats(together, others)
    check_alive(together)
    base_form = _form(together, dof, form, given)
    check_worth(together, base_form, use)
    segments, notes = prepare_as_recorded(together, base_form, use)
    held = prepare_as_recorded(others, base_form, use)[0] if others else []
    doubts += [*more, *repeats, *notes, *overlooked(together, base_form, dof, use, segments)]
    whole = held or segments
    if horizon is not None:
        segments, held = within_horizon(segments, horizon), within_horizon(held, horizon)
    search, pieces = _search(base_form, segments, held, given, slugs, progress, jobs), ""
    search.run()
    shorter = horizon_for(search) if horizon is None and _lost(search) else None
    if shorter is not None:
        again = _search(
            base_form, within_horizon(segments, shorter), within_horizon(held, shorter), given, slugs, progress, jobs
        )
        again.run()
        if again.fitted.effects != again.base.effects and holds_over(again, whole):
            search, pieces = again, f"; in pieces of {shorter:.3g} s"
            doubts.append(_short_sighted(shorter))
        else:
            shorter = None
    if held and given is None and shorter is None and _contradicted(search):
        # What the runs to fit do not show the runs to predict do: all are looked at together, parts left out in turn.
        both = _search(base_form, [*segments, *held], [], given, slugs, progress, jobs)
        both.run()
        if both.fitted.effects:
            search = both
            doubts.append(_needed_all())
    numbers = None if given is None else judge_numbers(search, given)
    doubts = [*early, *doubts]
    sure = shorter is None and (horizon is None or math.isinf(horizon) or foretells(search, whole))
    words = search.parts.words + pieces
    return told_of(search, words, doubts, together, others, time.perf_counter() - begun, numbers=numbers, sure=sure)


def _contradicted(search: Search) -> bool:
    """Whether nothing was found in the runs to fit, and yet the runs kept apart are predicted far worse than those.

    Nothing: they show nothing, or all they show is explained by a cause whose numbers they cannot tell.
    """
    if search.fitted.effects or not search.base_unseen.complete:
        return False
    if _lost(search):
        return any(explains_all(search.problem, step) for step in search.steps)
    errors = rms_of(search.base_unseen.rests)
    return any(errors[n] > FAR * level for n, level in search.fitted.levels.items() if n in errors)


def _needed_all() -> Doubt:
    return Doubt(
        "validation-was-needed",
        "what the runs to fit show, if anything, does not predict the runs kept apart; the causes were found in all "
        "together",
        "fit runs with as many sizes of command as those to be predicted; the gain is of parts left out in turn",
    )


def _lost(search: Search) -> bool:
    """Whether nothing was found although much is left."""
    if search.fitted.effects != search.base.effects:
        return False
    return whiteness_of(tests_of(search.problem, search.fitted)) <= WHITE


def _short_sighted(horizon: float) -> Doubt:
    return Doubt(
        "short-horizon",
        f"over whole runs no cause paid; the causes named were found in pieces of {horizon:.3g} s",
        "take them for hypotheses; calm water, or a run on which the craft comes back to rest, would tell",
    )


def _form(runs: Sequence[Trial], dof: str | None, form: Form | None, given: Given | None) -> Form:
    if given is not None:
        return given.model.base.form
    return form if form is not None else plain_form(runs, dof)


def _search(
    form: Form,
    segments: list[Segment],
    unseen: list[Segment],
    given: Given | None,
    slugs: Sequence[str],
    progress: Progress | None,
    jobs: int,
) -> Search:
    as_it_is = None
    if given is None:
        problem, fitted = fit_base(form, segments)
    else:
        problem, as_it_is, fitted = given_base(given.model.base, given.model.effects, segments)
    return begin_search(problem, fitted, unseen, slugs, given=as_it_is, progress=progress, jobs=jobs)
