"""The interval between the samples judged under process noise, chosen by evidence where the plain model is no base.

Judged close by, a fit follows what a model of the craft leaves out first: the autopilot's smoother, thrusters that need
time. It may then be of another craft altogether, with a time constant below the sample and a drifting force as large as
the commands, on which the sign of a hydrodynamic term comes out wrong. Judged from far off, the craft's own motion is
lost. Over the intervals in between the answer is the same: there the runs are judged.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.diagnose.candidates import candidates
from gcs_autotune.effects import EFFECTS
from gcs_autotune.identify import Limits, NoisyFit, NoisyProblem

__all__ = [
    "Look",
    "Plain",
    "changes_at",
    "commanded",
    "horizons",
    "judged_at",
    "prediction_horizon",
    "refitted",
    "rms_ahead",
    "stands",
]

Array = NDArray[np.float64]

Plain = tuple[NoisyProblem, NoisyFit]
"""The runs at some interval, and the plain model fitted there."""

OF_THE_COMMAND = 1.0
"""Share of what is commanded (both rms) from which on a drifting force is larger than the commands."""

FEWEST = 60
"""Samples that the longest run keeps at least."""

GROWTH = 1.6
"""Chosen: factor between intervals tried."""

WIDER = (2.0, 4.0)
"""Chosen: intervals, in shares of the one used, at which the plain model must come out the same."""

APART, ALIKE = 3.0, 0.25
"""Standard errors, or relative difference, within which two intervals give one number. The second because standard
errors are those of one interval, not of the model."""

BETTER = 0.9
"""Chosen: share of its error ahead that another interval must leave to be used instead."""

LEGS = 2.0
"""Chosen: correlation times of the commands that predictions are compared over."""

NICE = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
"""Times ahead [s] that people can compare."""

NEAREST, ROUGH = 3, 3
"""Chosen: terms fitted to the end at each interval, and scoring rounds of the others."""

OTHER_CRAFT = 2.0
"""Chosen: ratio of two time constants from which on a refit to fewer runs is of another craft."""

PACES, PACED = 2.0, 6
"""Chosen: factor between the time constants tried for such a refit, and scoring rounds at each."""


def commanded(problem: NoisyProblem) -> float:
    """Return the rms of the command that drives the equation, in the unit of the inputs, over all records."""
    total, weight = 0.0, 0.0
    for segment in problem.segments:
        force = _command_of(problem, segment.input_names, segment.inputs)
        held = np.diff(np.append(segment.t_in, max(float(segment.stamps[-1]), float(segment.t_in[-1]))))
        total, weight = total + float(held @ force**2), weight + float(held.sum())
    return math.sqrt(total / weight) if weight > 0.0 else 0.0


def _command_of(problem: NoisyProblem, names: Sequence[str], inputs: Array) -> Array:
    force = np.zeros(len(inputs))
    for name, column in zip(names, inputs.T, strict=True):
        for _, share in problem.form.inputs.get(name, ()):
            force += -column if str(share).startswith("-") else column
    return force


def stands(problem: NoisyProblem, fit: NoisyFit) -> bool:
    """Whether a fit is a model of the craft that a name may stand on.

    It is none where its time constant is below the record's sample, or where the force that drifts is nearly as large
    as what is commanded.
    """
    gain, damping = abs(float(fit.theta[0])), abs(float(fit.theta[1]))
    if damping * problem.data_summary.interval > 1.0:
        return False
    return fit.noise.size < OF_THE_COMMAND * gain * commanded(problem)


def prediction_horizon(problem: NoisyProblem, fit: NoisyFit) -> float | None:
    """Return how far ahead [s] predictions are to be compared; None where the runs are too short.

    Three time constants of the craft, and no less than two correlation times of the commands: of a fit that takes a
    craft for quicker than it is, the first would look no further than one sample.
    """
    times = []
    for segment in problem.segments:
        grid = np.arange(float(segment.t_in[0]), float(segment.stamps[-1]), problem.data_summary.interval)
        if len(grid) < FEWEST:
            continue
        row = np.maximum(np.searchsorted(segment.t_in, grid, side="right") - 1, 0)
        x = _command_of(problem, segment.input_names, segment.inputs)[row]
        x = x - x.mean()
        power = np.abs(np.fft.rfft(x, 2 * len(x))) ** 2
        correlation = np.fft.irfft(power)[: len(x)]
        below = np.flatnonzero(correlation < correlation[0] / math.e)
        times += [float(below[0]) * problem.data_summary.interval] if len(below) else []
    settled = 3.0 / max(abs(float(fit.theta[1])), 1e-3)
    goal = max(settled, LEGS * float(np.median(times))) if times else settled
    return _nearest(problem, goal)


def horizons(problem: NoisyProblem, fit: NoisyFit) -> tuple[float, ...]:
    """Return the horizons [s] at which a cause must lower the error: :func:`prediction_horizon`, or one time constant.

    What acts at once (a saturation, backlash) shows in the first time constant; later the drifting force hides it.
    """
    found = (prediction_horizon(problem, fit), _nearest(problem, 1.0 / max(abs(float(fit.theta[1])), 1e-3)))
    return tuple(dict.fromkeys(s for s in found if s is not None))


def _nearest(problem: NoisyProblem, goal: float) -> float | None:
    """Return the round number of seconds nearest to *goal* [s] that these runs can show, if any."""
    longest = max(float(s.stamps[-1]) - s.start for s in problem.segments)
    usable = [s for s in NICE if 3.0 * problem.interval < s < longest / 4.0]
    return min(usable, key=lambda s: abs(math.log(s / goal)), default=None)


def rms_ahead(problem: NoisyProblem, fit: NoisyFit, seconds: float) -> float:
    """Return the rms error *seconds* [s] ahead of samples all along the records, inf where the model runs away."""
    errors = problem.ahead(fit, seconds)
    return float(np.sqrt(np.mean(errors**2))) if len(errors) and np.all(np.isfinite(errors)) else math.inf


def refitted(problem: NoisyProblem, fit: NoisyFit, rounds: int, seconds: float | None) -> NoisyFit | None:
    """Return *fit*, made on more runs, refitted to those of *problem*; None where the filter runs away.

    The likelihood is that of the next sample. Of fewer runs it may prefer another craft, quicker than a sample of the
    record, whose drifting force follows each sample: its error *seconds* [s] ahead tells. So where the time constant of
    the refit is another, several are tried, and that with the smallest error ahead on the runs of *problem* is taken.
    """
    again = problem.fit(fit.theta, fit.effects, fit.noise, rounds=rounds)
    if again is None or seconds is None:
        return again
    before, after = (1.0 / max(abs(float(f.theta[1])), 1e-9) for f in (fit, again))
    if 1.0 / OTHER_CRAFT < after / before < OTHER_CRAFT:
        return again
    best, least = again, math.inf if after < problem.data_summary.interval else rms_ahead(problem, again, seconds)
    longest = max(float(s.stamps[-1]) - s.start for s in problem.segments)
    pace, slowest = min(before, after) / PACES, min(max(before, after) * PACES, longest)
    while pace <= 1.001 * slowest:
        if pace >= problem.data_summary.interval:
            fixed = _at_pace(problem, fit, math.copysign(1.0 / pace, float(fit.theta[1])))
            error = math.inf if fixed is None else rms_ahead(problem, fixed, seconds)
            if fixed is not None and error < least:
                best, least = fixed, error
        pace *= PACES
    return best


def _at_pace(problem: NoisyProblem, fit: NoisyFit, damping: float) -> NoisyFit | None:
    """Return the likeliest refit with that *damping* [1/s]."""
    name = problem.form.free[1]
    limits = Limits({**problem.limits.low, name: damping}, {**problem.limits.high, name: damping})
    held = NoisyProblem(problem.form, problem.segments, problem.data_summary, limits)
    share = damping / float(fit.theta[1] or damping)
    starts = [np.array([fit.theta[0] * k, damping]) for k in (1.0, share)]
    fits = [held.fit(start, fit.effects, fit.noise, rounds=PACED) for start in starts]
    return max((f for f in fits if f is not None), key=lambda f: f.total, default=None)


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """The runs judged at one interval: the plain model, and the model with the hydrodynamic term that predicts best.

    ``best``: the plain one where no term helps. ``error``: its rms error ahead. The likelihood is that of the next
    sample, and may prefer a model that loses the craft some seconds ahead.
    """

    problem: NoisyProblem
    plain: NoisyFit
    best: NoisyFit
    error: float

    @property
    def sound(self) -> bool:
        """Whether the best is a model of the craft."""
        return stands(self.problem, self.best)

    def agrees(self, other: Look) -> bool:
        """Whether both give the same answer: the same term, and numbers alike."""
        mine, theirs = _numbers(self.best), _numbers(other.best)
        return mine.keys() == theirs.keys() and all(_alike(*mine[n], *theirs[n]) for n in mine)


def _numbers(fit: NoisyFit) -> dict[str, tuple[float, float]]:
    """Return name -> value, standard error."""
    std = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    values = [*fit.theta.tolist(), *(fit.effects[i].values[n] for i, n in fit.free_effects)]
    names = [*fit.form.free, *(f"{fit.effects[i].slug} {fit.effects[i].place} {n}" for i, n in fit.free_effects)]
    return {n: (v, float(s)) for n, v, s in zip(names, values, std[: len(values)], strict=True)}


def _alike(a: float, a_std: float, b: float, b_std: float) -> bool:
    apart = abs(a - b)
    return apart <= APART * math.hypot(a_std, b_std) or (a * b > 0.0 and apart <= ALIKE * max(abs(a), abs(b)))


def judged_at(
    begun: Plain, at: Callable[[float], Plain | None], slugs: Sequence[str], price: float
) -> tuple[Plain, NoisyFit | None, str]:
    """Return the runs at the interval they are to be judged at, the plain model there, the best with a term more where
    it was looked for, and words where the interval matters.

    begun : where the search would judge. It stays there, without a word, where its plain model is one of the craft and
    comes out the same from further off. Else intervals are tried from the widest down. Of a stretch of two and more at
    which the same model stands, with at most one hydrodynamic term of *slugs* (which must gain *price* in
    log-likelihood), the closest is taken, if its error ahead is smaller than that of the best model where it began.
    at : the runs and the plain model at an interval [s].
    """
    problem, plain = begun
    longest = max(float(s.stamps[-1]) - s.start for s in problem.segments)
    widest = longest / FEWEST
    others = [at(k * problem.interval) for k in WIDER if k * problem.interval <= widest]
    wider = [o for o in others if o is not None]
    steady = [_alike(*a, *b) for o in wider for a, b in zip(_pairs(plain), _pairs(o[1]), strict=True)]
    if stands(problem, plain) and all(steady):
        return begun, None, ""
    seconds = prediction_horizon(problem, plain)
    if seconds is None:
        return begun, None, ""
    first = _look(problem, plain, slugs, price, seconds)
    found = _closest(begun, at, slugs, price, seconds, widest)
    if found is not None and found.error < BETTER * first.error:
        return (found.problem, found.plain), found.best, _moved(first, found, seconds)
    if all(steady):
        return begun, None, ""
    far = wider[int(np.argmin(steady)) // 2]
    words = f"sampled every {problem.interval:.2g} s the plain model has {_told(plain)}, every {far[0].interval:.2g} s "
    return begun, None, words + _told(far[1])


def _pairs(fit: NoisyFit) -> list[tuple[float, float]]:
    std = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    return [(float(fit.theta[k]), float(std[k])) for k in range(2)]


def _told(fit: NoisyFit) -> str:
    return f"a damping of {abs(float(fit.theta[1])):.2g} 1/s"


def _moved(first: Look, found: Look, seconds: float) -> str:
    term = found.best.effects[0].slug if found.best.effects else "no added term"
    return (
        f"sampled every {first.problem.interval:.2g} s the plain model has {_told(first.plain)}, and the best model an "
        f"error of {first.error:.2g} {seconds:g} s ahead; every {found.problem.interval:.2g} s or more, with {term}, "
        f"{_told(found.best)} and {found.error:.2g}; this interval is used"
    )


def _closest(
    begun: Plain, at: Callable[[float], Plain | None], slugs: Sequence[str], price: float, seconds: float, widest: float
) -> Look | None:
    """Return the closest look of the first stretch, from the widest interval down, at which one answer stands."""
    intervals = [begun[0].interval * GROWTH]
    while intervals[-1] * GROWTH <= 1.001 * widest:
        intervals.append(intervals[-1] * GROWTH)
    stretch: list[Look] = []
    seen: set[float] = set()
    for interval in reversed(intervals):
        plain = at(interval)
        if plain is None or round(plain[0].interval, 9) in seen:
            continue
        seen.add(round(plain[0].interval, 9))
        look = _look(*plain, slugs, price, seconds)
        if look.sound and all(look.agrees(other) for other in stretch):
            stretch.append(look)
        elif len(stretch) > 1:
            break
        else:
            stretch = [look] if look.sound else []
    return stretch[-1] if len(stretch) > 1 else None


def _look(problem: NoisyProblem, plain: NoisyFit, slugs: Sequence[str], price: float, seconds: float) -> Look:
    """Return the model with at most one hydrodynamic term that predicts best, of those that stand and gain *price*."""
    tangent = problem.tangent(plain)
    rough: list[NoisyFit] = []
    terms = [s for s in slugs if EFFECTS[s].family == "hydrodynamics" and EFFECTS[s].is_structural]
    for starts in candidates(problem.data_summary, (), terms):
        if tangent is None:
            break
        adapted = [problem.adapted(plain, own, tangent) for own in starts]
        tried = [problem.fit(f.theta, f.effects, f.noise, rounds=ROUGH) for f in adapted if f is not None]
        tried += [problem.fit(plain.theta, (own,), plain.noise, rounds=ROUGH) for own in starts]
        fits = [f for f in tried if f is not None]
        rough += [max(fits, key=lambda f: f.total)] if fits else []
    ends = [plain]
    for fit in sorted(rough, key=lambda f: -f.total)[:NEAREST]:
        end = problem.fit(fit.theta, fit.effects, fit.noise)
        if end is not None and end.total > plain.total + price and stands(problem, end):
            ends.append(end)
    errors = [rms_ahead(problem, end, seconds) for end in ends]
    best = int(np.argmin(errors))
    return Look(problem, plain, ends[best], errors[best])


def changes_at(problem: NoisyProblem, fit: NoisyFit, other: NoisyProblem) -> list[str]:
    """Return in words the numbers of causes in *fit* that come out otherwise where runs are judged as in *other*."""
    again = other.fit(fit.theta, fit.effects, fit.noise)
    if again is None:
        return []
    before, after = _numbers(fit), _numbers(again)
    names = [n for n in before if n not in fit.form.free]
    return [
        f"{n} {before[n][0]:.3g} every {problem.interval:.2g} s, {after[n][0]:.3g} every {other.interval:.2g} s"
        for n in names
        if not _alike(*before[n], *after[n])
    ]
