"""What a diagnosis is asked: runs to explain, a model in question, effects to try."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from gcs_autotune.clock import check_effort
from gcs_autotune.diagnose.result import Number
from gcs_autotune.effects import ExtendedModel
from gcs_autotune.executor import Executor, SerialExecutor
from gcs_autotune.identify import Fitted, Problem, Segment
from gcs_autotune.models import Form

__all__ = ["Key", "ModelInQuestion", "Progress", "Question"]

Progress = Callable[[str, int, int], None]

Key = tuple[str, str, str]
"""A number of an effect: its slug, its place, its name. Of the base: two empty words and the derivative."""


@dataclass(frozen=True, slots=True, eq=False)
class ModelInQuestion:
    """The model in question, and how its owner knows it.

    ``names``: number -> (name in the owner's file, sign by which it differs from ours); ``std``: standard error of a
    number, by the name in the file, where the file states one. ``theirs``: how the plain model fits the simulator that
    this model stands for; None for a model that was given itself. ``records``: what is wrong in the simulator's file
    itself (clock, signs, units), and was set right before.
    """

    model: ExtendedModel
    names: Mapping[Key, tuple[str, float]] = field(default_factory=dict)
    std: Mapping[str, float] = field(default_factory=dict)
    theirs: tuple[Problem, Fitted] | None = None
    records: tuple[Number, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Question:
    """What is asked: runs to explain, runs kept apart, the model in question, effects to try.

    ``whole``: the runs a model found in pieces must hold for. ``horizon`` [s]: pieces asked for by whoever asks; None
    leaves that to the search. ``progress``: called with a stage, how much of it is done, and how much there is;
    ``executor``: does what can be done at the same time.
    ``with_noise``: whether process noise may explain what is left over. ``one_flight``: the runs complete each other
    (a step and a relay of one tune), so that none of them predicts the other: blocks of all are left out in turn.
    """

    form: Form
    segments: Sequence[Segment]
    slugs: Sequence[str]
    unseen: Sequence[Segment] = ()
    whole: Sequence[Segment] = ()
    given: ModelInQuestion | None = None
    horizon: float | None = None
    progress: Progress | None = None
    executor: Executor = field(default_factory=SerialExecutor)
    with_noise: bool = True
    one_flight: bool = False

    def say(self, stage: str, done: int, total: int) -> None:
        """Report progress.

        Raises
        ------
        OutOfTime
            The work or the time given is used up.
        """
        if self.progress is not None:
            self.progress(stage, done, total)
        check_effort(f"{stage}, {done} of {total} done")
