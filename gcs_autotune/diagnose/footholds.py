"""Footholds in short pieces: where whole runs are lost, causes are tried over pieces that begin where the craft was.

What an effect does adds up. A base without drag, or of a rudder that stalls, leaves the craft's heading within seconds
and never returns; what is left over says nothing of the cause any more, and no fit finds its way back. Over pieces of
a few seconds the same base is nearly right and the cause stands out. Its numbers there are where whole runs are fitted
from; whether it pays, whole runs decide, so nothing is taken on trust.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.diagnose.attempts import ROUGH, fitted_roughly, fitted_to_the_end
from gcs_autotune.diagnose.screen import Candidate, candidates, screen
from gcs_autotune.diagnose.workers import in_parallel
from gcs_autotune.effects import EFFECTS
from gcs_autotune.errors import AutotuneError
from gcs_autotune.identify.base_model import fit_base
from gcs_autotune.identify.extended.fitting import Fitted, Problem
from gcs_autotune.identify.segment import Segment

__all__ = ["footholds"]

Array = NDArray[np.float64]

SAMPLES = 30
"""Chosen: stamps of a piece: enough for its own initial states, few enough that little adds up."""

MOST_PIECES = 60
"""Of all segments together: each has initial states to fit."""

SHORT_LIST, KEPT = 8, 3
"""Candidates fitted roughly in pieces, and of these to the end and over whole runs."""

TOLD = 3.0
"""A number so many standard errors from zero is told by the pieces."""


def footholds(problem: Problem, present: Fitted, slugs: Sequence[str], jobs: int = 1) -> list[tuple[Candidate, Fitted]]:
    """Return rough fits over whole runs begun at the likeliest causes of pieces, each with its candidate.

    present : the base fitted to whole runs.
    """
    pieces = _pieces(problem.segments)
    if len(pieces) <= len(problem.segments):
        return []
    try:
        short, base = fit_base(problem.form, pieces)
    except AutotuneError:
        return []
    choices = candidates(short, (), [s for s in slugs if _moves_the_craft(s)])
    listed = screen(short, [base], [], choices, jobs=jobs)[:SHORT_LIST]
    fits = in_parallel(lambda i: fitted_roughly(short, listed[i]), len(listed), jobs)
    rough = [(c, f) for c, f in zip(listed, fits, strict=True) if f is not None and f.cost < base.cost]
    rough = sorted(rough, key=lambda r: r[1].cost)[:KEPT]

    def whole(i: int) -> Fitted | None:
        return _over_whole_runs(problem, fitted_to_the_end(short, *rough[i]), present)

    return [(_candidate(present, f), f) for f in in_parallel(whole, len(rough), jobs) if f is not None]


def _over_whole_runs(problem: Problem, fit: Fitted, present: Fitted) -> Fitted | None:
    """Return a rough fit of whole runs from the numbers of *fit*; None when the motion runs away with them.

    What pieces do not tell (the drag of a motion nobody excited) may be wild there: it is tried as in *present* too.
    """
    start = problem.first_states(problem.segments)
    for theta in (fit.theta, _where_told(fit, present)):
        first = problem.states(theta, fit.effects, start, fit.shift)
        if first is not None:
            return problem.fit(first.theta, first.effects, first.initial, trials=ROUGH, shift=first.shift)
    return None


def _where_told(fit: Fitted, present: Fitted) -> Array:
    """Return the base's numbers of *fit* where it tells them, those of *present* elsewhere."""
    theta = present.theta.copy()
    std = np.sqrt(np.maximum(np.diag(fit.covariance()), 0.0))
    for k, name in enumerate(fit.free):
        at = fit.form.parameters.index(name)
        if TOLD * std[k] < abs(fit.theta[at]):
            theta[at] = fit.theta[at]
    return theta


def _candidate(present: Fitted, fit: Fitted) -> Candidate:
    (own,) = fit.effects
    begin = replace(present, theta=fit.theta, initial=fit.initial, shift=fit.shift)
    return Candidate(own, begin, fit.cost, np.zeros(present.jacobian.shape[1]))


def _pieces(segments: Sequence[Segment]) -> list[Segment]:
    """Cut every segment into pieces of about as many samples."""
    counts = [len(s.stamps) / SAMPLES for s in segments]
    share = min(1.0, MOST_PIECES / max(sum(counts), 1.0))
    return [piece for s, n in zip(segments, counts, strict=True) for piece in s.pieces(max(int(n * share), 1))]


def _moves_the_craft(slug: str) -> bool:
    """Whether an effect can be seen in pieces: bookkeeping and sensors show over whole runs, waves need them."""
    return EFFECTS[slug].family not in ("data errors", "sensor") and not EFFECTS[slug].is_disturbance
