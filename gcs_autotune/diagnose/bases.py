"""Other bases to begin at: a signal spoilt by bookkeeping (a wrong sign, a wrong unit) spoils the fit of all."""

from __future__ import annotations

from dataclasses import dataclass

from gcs_autotune.diagnose.attempts import ROUGH
from gcs_autotune.diagnose.judging import ALIKE
from gcs_autotune.errors import AutotuneError
from gcs_autotune.identify.base_model import fit_base
from gcs_autotune.identify.extended.fitting import Fitted, Problem
from gcs_autotune.identify.segment import without_signal

__all__ = ["Bases", "without_one_signal"]


@dataclass(frozen=True, slots=True, eq=False)
class Bases:
    """The base fitted to all signals but one, judged by all, one for each signal; and the best fitted to all."""

    alone: tuple[Fitted, ...]
    best: Fitted


def without_one_signal(problem: Problem, base: Fitted) -> Bases:
    """Fit the base to all signals but one, for each that can be missed.

    Where one of these leads to a better base for all signals, that is the best; else *base* itself.
    """
    alone, best = [], base
    names = list(problem.scene.signals)
    for name in names if len(names) > 1 else ():
        try:
            _, rest = fit_base(problem.form, without_signal(problem.segments, name), trials=ROUGH)
        except AutotuneError:
            continue
        again = problem.states(rest.theta, (), base.initial)
        if again is None:
            continue
        judged = problem.fit(again.theta, (), again.initial, trials=0, shift=again.shift)
        alone += [] if judged is None else [judged]
        whole = problem.fit(again.theta, (), again.initial, shift=again.shift)
        best = whole if whole is not None and whole.cost < best.cost - ALIKE else best
    return Bases(tuple(alone), best)
