"""Entry point of diagnosis: :func:`diagnose`, from runs to a verdict."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from gcs_autotune.clock import Budget, Deadline, OutOfTime, WallClock, check_effort, limited_to
from gcs_autotune.crosscheck import contradictions
from gcs_autotune.diagnose.excitation_check import check_alive, check_excitation
from gcs_autotune.diagnose.intake import is_one_flight, taken_in, within_manoeuvre, without_repeats
from gcs_autotune.diagnose.numbers import judge_numbers, model_in_question
from gcs_autotune.diagnose.question import ModelInQuestion, Progress, Question
from gcs_autotune.diagnose.report_builder import build_report, unfinished_report
from gcs_autotune.diagnose.result import Diagnosis
from gcs_autotune.diagnose.retries import improves_prediction, search_all_runs, search_in_pieces
from gcs_autotune.diagnose.search_with_noise import model_noise_before_joining, model_process_noise
from gcs_autotune.diagnose.simulation import surrogate_of
from gcs_autotune.diagnose.state import begin
from gcs_autotune.diagnose.strategies import SEARCH, follow
from gcs_autotune.effects import EFFECTS, ExtendedModel
from gcs_autotune.errors import UsageError
from gcs_autotune.executor import executor_for
from gcs_autotune.identify import CONTRADICTION, Doubt, ModelFile, moved_too
from gcs_autotune.identify.problems import overlooked, plain_form
from gcs_autotune.identify.signals import prepare_as_recorded, within_horizon
from gcs_autotune.models import Form
from gcs_autotune.registry import lookup
from gcs_autotune.trial import Trial

__all__ = ["diagnose"]

WORK = 1e9
"""Work limit of a diagnosis, in samples that simulations and filters process.

It corresponds to about ten minutes on one core, see docs/diagnose.md.
"""


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
    work: float = WORK,
    max_seconds: float = math.inf,
) -> Diagnosis:
    """Return the diagnosis of a simulation: what it gets wrong, and how much each cause reduces the held-out error.

    Parameters
    ----------
    unseen : runs on which the gain is measured. Without any, parts of *runs* are left out in turn.
    dof : degrees of freedom to examine, joined by commas. None: all that the file contains.
    use : signals to compare. None: all measured ones.
    form : structure of the base model, in place of the plain one.
    model : a base model with its numbers, named as in its file if it comes from one. Its wrong numbers are reported
        first, with the gain of correcting them. The model is then refitted, effects are added to it, and their gains
        are relative to the refitted model.
    simulations : output of another simulator for the same commands, one per run. A model is first fitted to it. That
        model becomes the base, and the numbers of the plain model are compared.
    effects : slugs of the effects to try. None: all.
    progress : called with a stage, the work done, and the total work of the stage.
    horizon : seconds that a simulation runs freely before it restarts at the measured state; inf for whole runs. None:
        whole runs first, then pieces if no cause helps over whole runs but much is unexplained. A result from pieces
        is a hypothesis, unless pieces were requested and the model also predicts whole runs as well as pieces.
    jobs : number of parallel processes; the result does not depend on it.
    work : maximum number of samples that simulations and filters may process, see :class:`.Budget`.
    max_seconds : time limit [s]. A search stopped by either limit reports no cause. Its verdict is ``unfinished``, and
        it reports what was tried and what is left. Within :func:`.keeping` the same call continues from there.

    Raises
    ------
    MissingChannel, BadFile, NotInformative
        The runs cannot be used; the message states the reason and what to try.
    UsageError
        Contradictory arguments. UnknownName: there is no such effect.
    """
    clock = WallClock()
    begun = clock.now()
    effort = Budget(work, None if math.isinf(max_seconds) else Deadline(clock, begun + max_seconds))
    with limited_to(effort):
        diagnosis = _diagnosed(
            runs, unseen, dof, use, form, model, simulations, effects, progress, horizon, jobs, effort
        )
    return replace(diagnosis, seconds=clock.now() - begun, work=min(effort.done, work))


def _diagnosed(
    runs: Trial | Sequence[Trial],
    unseen: Sequence[Trial],
    dof: str | None,
    use: Sequence[str] | None,
    form: Form | None,
    model: ExtendedModel | ModelFile | None,
    simulations: Sequence[Trial],
    effects: Sequence[str] | None,
    progress: Progress | None,
    horizon: float | None,
    jobs: int,
    effort: Budget,
) -> Diagnosis:
    """Run :func:`diagnose` within *effort*."""
    together = [runs] if isinstance(runs, Trial) else list(runs)
    if not together:
        raise UsageError("no run to diagnose. Supply at least one run file")
    slugs = list(EFFECTS) if effects is None else [lookup(EFFECTS, e, "effect").slug for e in effects]
    early: list[Doubt] = []
    given = None if model is None else model_in_question(model)
    if simulations:
        if given is not None:
            raise UsageError("supply either a model or a simulation's output, not both")
        given, early = surrogate_of(
            simulations, together, dof=dof, use=use, form=form, effects=slugs, progress=progress, jobs=jobs
        )
    together, doubts = taken_in(together)
    others, more = taken_in(unseen) if unseen else ([], [])
    together, repeats = without_repeats(together, others)
    check_alive(together)
    base = _form(together, dof, form, given)
    together, others = ([within_manoeuvre(run, base.inputs) for run in some] for some in (together, others))
    check_excitation(together, base, use)
    segments, notes = prepare_as_recorded(together, base, use)
    held = prepare_as_recorded(others, base, use)[0] if others else []
    contrary = [Doubt(CONTRADICTION, c.cause, c.cure) for run in (*together, *others) for c in contradictions(run, use)]
    doubts = [*contrary, *early, *doubts, *more, *repeats, *notes, *overlooked(together, base, dof, use, segments)]
    if dof is None and use is None and given is None:
        doubts += moved_too(together, base.dofs)
    whole = held or segments
    if horizon is not None:
        segments, held = within_horizon(segments, horizon), within_horizon(held, horizon)
    one = is_one_flight(together)
    question = Question(
        base, segments, slugs, held, whole, given, horizon, progress, executor_for(jobs), one_flight=one
    )
    strategies = (*SEARCH, model_noise_before_joining, search_all_runs, model_process_noise, search_in_pieces)
    state = follow(begin(question), strategies if given is None else (*strategies, judge_numbers))
    if not effort.stopped:
        chosen = state.pieces is not None or (state.with_noise is not None and bool(state.with_noise.accepted))
        try:
            check_effort("analysis of the remaining residual")
            sure = not chosen and (horizon is None or math.isinf(horizon) or improves_prediction(state, whole))
            return build_report(state, doubts, together, others, sure=sure)
        except OutOfTime:
            pass  # reported by the search under way
    with limited_to(None):  # what there is costs no more fits
        return unfinished_report(state, doubts, together, others, effort)


def _form(runs: Sequence[Trial], dof: str | None, form: Form | None, given: ModelInQuestion | None) -> Form:
    if given is not None:
        return given.model.base.form
    return form if form is not None else plain_form(runs, dof)
