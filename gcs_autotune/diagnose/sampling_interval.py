"""Choose the interval to which runs are thinned, if the plain model with process noise is not usable.

At short intervals a fit follows what the craft model omits: the autopilot's smoother and the thrusters' lag. Its time
constant may then be below the sampling interval, and its drifting force as large as the commands. A hydrodynamic term
may have the wrong sign. At long intervals the craft's own motion is lost. Between them is a range in which the result
does not depend on the interval. The runs are thinned to an interval in that range.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.diagnose.candidates import candidates
from gcs_autotune.effects import EFFECTS, effect_words
from gcs_autotune.identify.kalman import NoisyFit, NoisyProblem
from gcs_autotune.identify.problems import Limits

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
"""The runs thinned to one sampling interval, and the plain model fitted to them."""

OF_THE_COMMAND = 1.0
"""Ratio of the drifting force to the commanded force (both rms) above which a fit is not a model of the craft."""

FEWEST = 60
"""Minimum number of samples that the longest run keeps."""

GROWTH = 1.6
"""Ratio of successive sampling intervals that are tried."""

WIDER = (2.0, 4.0)
"""Factors on the present sampling interval, at which the plain model must lead to the same result."""

APART, ALIKE = 3.0, 0.25
"""Limits within which the estimates of a number at two intervals count as equal: APART standard errors, or the relative
difference ALIKE.

The relative limit is needed because standard errors apply to one interval, not to the model.
"""

BETTER = 0.9
"""Ratio of prediction errors ahead, below which another interval replaces the original one."""

LEGS = 2.0
"""Minimum horizon of compared predictions, in correlation times of the commands."""

NICE = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
"""Values [s] to which the prediction horizon is rounded. Project choice."""

NEAREST, ROUGH = 3, 3
"""NEAREST: number of terms fitted to convergence at each interval. ROUGH: scoring iterations of rough fits."""

OTHER_CRAFT = 2.0
"""Ratio of two time constants from which a refit to fewer runs is considered a different craft."""

PACES, PACED = 2.0, 6
"""Grid for such a refit: ratio of successive time constants, and scoring iterations at each."""


def commanded(problem: NoisyProblem) -> float:
    """Return the rms of the command in the equation over all records, in the unit of the inputs."""
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
    """Return whether a fit is a model of the craft, so that causes may be added to it.

    The time constant must not be below the record's sampling interval. The drifting force must be smaller than the
    commanded force.
    """
    gain, damping = abs(fit.gain), abs(fit.damping)
    if damping * problem.data_summary.interval > 1.0:
        return False
    return fit.noise.size < OF_THE_COMMAND * gain * commanded(problem)


def prediction_horizon(problem: NoisyProblem, fit: NoisyFit) -> float | None:
    """Return the horizon [s] at which predictions are compared; return None if the runs are too short.

    It is three time constants of the craft, and at least two correlation times of the commands. The second limit
    matters if the fitted time constant is far too small.
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
    settled = 3.0 / max(abs(fit.damping), 1e-3)
    goal = max(settled, LEGS * float(np.median(times))) if times else settled
    return _nearest(problem, goal)


def horizons(problem: NoisyProblem, fit: NoisyFit) -> tuple[float, ...]:
    """Return the horizons [s] at which a cause may lower the error: :func:`prediction_horizon` and one time constant.

    Effects that act at once (saturation, backlash) are visible within the first time constant. Later the drifting force
    hides them.
    """
    possible = (prediction_horizon(problem, fit), _nearest(problem, 1.0 / max(abs(fit.damping), 1e-3)))
    return tuple(dict.fromkeys(s for s in possible if s is not None))


def _nearest(problem: NoisyProblem, goal: float) -> float | None:
    """Return the rounded horizon [s] nearest to *goal* [s] that these runs permit; return None if there is none."""
    longest = max(float(s.stamps[-1]) - s.start for s in problem.segments)
    usable = [s for s in NICE if 3.0 * problem.interval < s < longest / 4.0]
    return min(usable, key=lambda s: abs(math.log(s / goal)), default=None)


def rms_ahead(problem: NoisyProblem, fit: NoisyFit, seconds: float) -> float:
    """Return the rms error of predictions *seconds* [s] ahead, over the whole records; inf if the model diverges."""
    errors = problem.ahead(fit, seconds)
    return float(np.sqrt(np.mean(errors**2))) if len(errors) and np.all(np.isfinite(errors)) else math.inf


def refitted(problem: NoisyProblem, fit: NoisyFit, rounds: int, seconds: float | None) -> NoisyFit | None:
    """Return *fit*, made on more runs, refitted to the runs of *problem*; None if the filter diverges.

    The likelihood is that of the next sample. With fewer runs it may prefer a time constant below the sampling
    interval, with a drifting force that follows each sample. The error *seconds* [s] ahead reveals this. If the time
    constant changes, several are tried. The fit with the smallest error ahead on the runs of *problem* is returned.
    """
    again = problem.fit(fit.theta, fit.effects, fit.noise, rounds=rounds)
    if again is None or seconds is None:
        return again
    before, after = (1.0 / max(abs(f.damping), 1e-9) for f in (fit, again))
    if 1.0 / OTHER_CRAFT < after / before < OTHER_CRAFT:
        return again
    best, least = again, math.inf if after < problem.data_summary.interval else rms_ahead(problem, again, seconds)
    longest = max(float(s.stamps[-1]) - s.start for s in problem.segments)
    pace, slowest = min(before, after) / PACES, min(max(before, after) * PACES, longest)
    while pace <= 1.001 * slowest:
        if pace >= problem.data_summary.interval:
            fixed = _at_pace(problem, fit, math.copysign(1.0 / pace, fit.damping))
            error = math.inf if fixed is None else rms_ahead(problem, fixed, seconds)
            if fixed is not None and error < least:
                best, least = fixed, error
        pace *= PACES
    return best


def _at_pace(problem: NoisyProblem, fit: NoisyFit, damping: float) -> NoisyFit | None:
    """Return the likeliest refit with the damping fixed at *damping* [1/s]."""
    name = problem.form.free[1]
    limits = Limits({**problem.limits.low, name: damping}, {**problem.limits.high, name: damping})
    held = NoisyProblem(problem.form, problem.segments, problem.data_summary, limits)
    share = damping / (fit.damping or damping)
    starts = [np.array([fit.gain * k, damping]) for k in (1.0, share)]
    fits = [held.fit(start, fit.effects, fit.noise, rounds=PACED) for start in starts]
    return max((f for f in fits if f is not None), key=lambda f: f.total, default=None)


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """The runs thinned to one interval, with the plain model and the best model.

    ``best``: the model with the hydrodynamic term that predicts best; the plain model if no term helps. ``error``: its
    rms error ahead. The likelihood is not used for this choice, because it is that of the next sample. It may prefer a
    model that predicts badly some seconds ahead.
    """

    problem: NoisyProblem
    plain: NoisyFit
    best: NoisyFit
    error: float

    @property
    def sound(self) -> bool:
        """Whether the best fit at this interval is a model of the craft."""
        return stands(self.problem, self.best)

    def agrees(self, other: Look) -> bool:
        """Return whether two sampling intervals lead to the same result: the same term and equal numbers."""
        mine, theirs = _numbers(self.best), _numbers(other.best)
        return mine.keys() == theirs.keys() and all(_alike(*mine[n], *theirs[n]) for n in mine)


def _numbers(fit: NoisyFit) -> dict[str, tuple[float, float]]:
    """Return name -> (value, standard error) of all fitted numbers."""
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
    """Return the runs thinned to a suitable interval, and the plain model at that interval. Also return the best model
    with one more term, if that was tried, and a description if the interval matters.

    begun : the runs at the interval of the search so far. It is kept if its plain model is a model of the craft and
    gives the same result at longer intervals. Otherwise intervals are tried from the longest down.

    A stretch of two or more intervals qualifies if the same model holds there. It may have at most one hydrodynamic
    term of *slugs*, which must gain *price* in log-likelihood. The shortest of these intervals is taken if its error
    ahead is below that of the best model at the original interval.

    at : function that returns the runs and the plain model at an interval [s].
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
    chosen = _closest(begun, at, slugs, price, seconds, widest)
    if chosen is not None and chosen.error < BETTER * first.error:
        return (chosen.problem, chosen.plain), chosen.best, _moved(first, chosen, seconds)
    if all(steady):
        return begun, None, ""
    far = wider[int(np.argmin(steady)) // 2]
    words = (
        f"sampled every {problem.interval:.2g} s, the plain model has {_damping_words(plain)}. Sampled every "
        f"{far[0].interval:.2g} s, it has "
    )
    return begun, None, words + _damping_words(far[1])


def _pairs(fit: NoisyFit) -> list[tuple[float, float]]:
    std = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    return [(float(fit.theta[k]), float(std[k])) for k in range(2)]


def _damping_words(fit: NoisyFit) -> str:
    return f"a damping of {abs(fit.damping):.2g} 1/s"


def _moved(first: Look, chosen: Look, seconds: float) -> str:
    term = effect_words(chosen.best.effects[0].slug) if chosen.best.effects else "no added term"
    return (
        f"with samples {first.problem.interval:.2g} s apart, the plain model has {_damping_words(first.plain)} and the "
        f"best model's error is {first.error:.2g} at {seconds:g} s ahead. With samples {chosen.problem.interval:.2g} s "
        f"or more apart, the best model ({term}) has {_damping_words(chosen.best)} and its error is "
        f"{chosen.error:.2g}. The longer interval is used"
    )


def _closest(
    begun: Plain, at: Callable[[float], Plain | None], slugs: Sequence[str], price: float, seconds: float, widest: float
) -> Look | None:
    """Return the result at the shortest interval of a stretch of intervals that give the same result.

    The first such stretch counts, from the widest interval down. Return None if there is none.
    """
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
    """Return the model with at most one hydrodynamic term that predicts best.

    Only terms that gain *price* and leave a model of the craft are considered.
    """
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
    """Return, in words, the numbers of causes in *fit* that differ when fitted at the interval of *other*."""
    again = other.fit(fit.theta, fit.effects, fit.noise)
    if again is None:
        return []
    before, after = _numbers(fit), _numbers(again)
    names = [n for n in before if n not in fit.form.free]
    return [
        f"{n} {before[n][0]:.3g} with samples {problem.interval:.2g} s apart, {after[n][0]:.3g} with samples "
        f"{other.interval:.2g} s apart"
        for n in names
        if not _alike(*before[n], *after[n])
    ]
