"""The question of a diagnosis: runs to explain, a model in question, effects to try."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from gcs_autotune.clock import check_effort
from gcs_autotune.diagnose.result import Number
from gcs_autotune.effects import ExtendedModel
from gcs_autotune.executor import Executor, SerialExecutor
from gcs_autotune.identify.problems import Fitted, Problem
from gcs_autotune.identify.signals import Segment
from gcs_autotune.models import Form

__all__ = ["Key", "ModelInQuestion", "Progress", "Question"]

Progress = Callable[[str, int, int], None]

Key = tuple[str, str, str]
"""Key of a number: slug of the effect, place, and name of the number.

For a number of the base model: two empty strings and the name of the derivative.
"""


@dataclass(frozen=True, slots=True, eq=False)
class ModelInQuestion:
    """The model in question, with the names and signs of its owner's file.

    ``names``: number -> (name in the owner's file, sign relative to this program's). ``std``: standard errors stated in
    the file, by the file's names. ``theirs``: fit of the plain model to the simulator that this model represents; None
    for a model that was supplied itself. ``records``: errors of the simulator's file (clock, signs, units), already
    corrected.
    """

    model: ExtendedModel
    names: Mapping[Key, tuple[str, float]] = field(default_factory=dict)
    std: Mapping[str, float] = field(default_factory=dict)
    theirs: tuple[Problem, Fitted] | None = None
    records: tuple[Number, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Question:
    """The question of a diagnosis: runs to explain, separate runs, the model in question, effects to try.

    ``whole``: whole runs that a model found in pieces must also fit. ``horizon`` [s]: length of pieces set by the user;
    None: the search decides. ``progress``: called with a stage, the work done, and the total. ``executor``: runs tasks
    in parallel. ``with_noise``: whether process noise may explain the rest.

    ``one_flight``: the runs are a step and relays of one tune, so none of them predicts another. Blocks of all runs are
    then left out in turn.
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
        """Report the progress of a stage to the caller.

        Raises
        ------
        OutOfTime
            The work or time limit is reached.
        """
        if self.progress is not None:
            self.progress(stage, done, total)
        check_effort(f"{stage}, {done} of {total} done")
