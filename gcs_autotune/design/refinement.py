"""The last stage of an automatic design: minimise the predicted ITAE inside the documented ranges.

Matching uses reference models that need only a fraction of the actuator's range, so that nothing saturates. A loop that
saturates may still be better. Refinement evaluates gains like the flown step: simulated with every limit, in both
directions, over the same window, without errors below the sensor's resolution. The search is bounded Nelder-Mead
(Nelder1965), because saturation and resolution make the cost nonsmooth. The search starts at points evenly spread over
a cube, which are the first points of Sobol's sequence, unscrambled.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from gcs_autotune.control import ReferenceModel
from gcs_autotune.design.laws import ALIKE, Settings
from gcs_autotune.design.margins import worst
from gcs_autotune.design.matching import NOISE_LIMIT, DesignProblem, integral_shortfall, output_noise, round_gain
from gcs_autotune.design.other_mode import OtherMode
from gcs_autotune.design.prediction import predict_as_flown, predict_error
from gcs_autotune.design.selection import (
    MIN_GAIN_MARGIN,
    MIN_PHASE_MARGIN,
    GainCandidate,
    is_tolerable,
    judge,
    max_overshoot,
)
from gcs_autotune.design.step_metrics import StepError, noise_floor
from gcs_autotune.design.verdict import is_better
from gcs_autotune.firmware import Gain
from gcs_autotune.slow_imports import scipy_stats

__all__ = ["MIN_ERROR", "any_better", "beyond", "passes", "refine", "refine_beyond", "refine_for_both", "sobol"]

Array = NDArray[np.float64]

PARTS = (1.0, 1.0 / 3.0)
"""Step sizes relative to the required step: the full step, and one small enough not to saturate. Project choice."""
GOOD_OVERSHOOT, DISLIKE = 0.05, 4.0
"""Overshoot without penalty (5 %), and penalty for more: each further 1 % counts like 4 % more ITAE. Project choice."""
PRICE = 20.0
"""Penalty for a margin or limit that is not met: each 1 % counts like 20 % more ITAE. Project choice."""
REGRET = 0.5
"""Penalty for specified margins that are not met, if only the smallest margins are required.

Each 1 % counts like half a percent of the cost. Project choice.
"""
RESERVE = 1.05
"""Factor by which margins and noise must be better than required, as a reserve for the later rounding of gains.

Project choice.
"""
RESERVE_BESIDE = 1.01
"""Value of :data:`RESERVE` if another mode counts too.

It is smaller, so that the other mode can use the reserve of the first search. Project choice.
"""
MIN_ERROR = 1e-3
"""Lower limit [s^2] of the ITAE, so that penalties still count if the error is zero. Project choice."""
HARDEST = 3
"""Number of samples of the 95 % region whose margins are checked during a descent: those with the worst margins so far.

Project choice.
"""
NOTICEABLE = 0.97
"""Cost of refined gains, relative to that of the matched gains, below which they replace the matched gains.

Project choice.
"""
HOPELESS = 3.0
"""Predicted ITAE, relative to the smallest so far, above which gains are not examined further. Project choice."""
EVALUATIONS, EVALUATIONS_OF_FIRST = 25, 12
"""Largest number of cost evaluations of a descent, per gain: in general, and of the first descents.

Project choice. The best of the first descents is continued. Over 63 crafts, the error with 25 evaluations in all
descents was 0.1 % lower on average, for 1.4 times as many evaluations.
"""
NEAR, FLAT = 1e-2, 1e-3
"""Size of a simplex, in square roots of fractions of the ranges, and spread of its costs, relative to the cost at the
start, at which a descent ends early. Project choice.
"""
ROUNDS = 2
"""Number of successive descents.

Project choice. Each starts at the end of the last one, with the samples that are worst at that point.
"""
SPREAD = 0.15
"""Size of the first simplex, in square roots of fractions of the ranges.

Project choice. The square root resolves small gains as well.
"""
SCATTER = 5
"""Logarithm (base 2) of the number of start points over the ranges.

Many are needed because the minimum may be far away if ranges limit the gains. Project choice.
"""
DESCENTS = 2
"""Number of the best start points from which descents begin. Project choice."""
SEARCHED = 8
"""Logarithm (base 2) of the number of points that are tried before the present gains count as the best.

Project choice.
"""
CLOSER = 32
"""Number of points, those with the smallest predicted ITAE, that the search of :data:`SEARCHED` evaluates fully.

Project choice.
"""
CLEARLY_LESS = 0.95
"""Relative cost below which a gain that matching leaves fixed is used.

Project choice: such a gain increases the motion of the actuator.
"""
CALM = 0.01
"""Largest actuator motion due to measurement noise (rms, fraction of full) with a gain of ``Law.late``.

Project choice: it limits wear.
"""

BESIDE = 2.0
"""Penalty for the other mode: each percent of its step that is not followed counts like 2 % more ITAE. Project choice.
"""
FEED, FEEDS = "ATC_STR_RAT_FF", (0.25, 0.5, 0.75, 1.0)
"""Name of the feed-forward, and additional start values in a search for both modes, relative to that of the model.

Project choice.
"""
WIDER = 5.0
"""Factor by which the search exceeds the documented ranges at both ends.

Project choice: margins limit the gains first.
"""
NEARLY = 0.95
"""Shortest rise time of gains for both modes, relative to that of gains for one mode, if it is limited. Project choice.
"""
YIELD = 1.05
"""Largest predicted ITAE of gains for both modes, relative to that of gains for one mode. Project choice."""


def refine(problem: DesignProblem, chosen: GainCandidate, duration: float) -> GainCandidate:
    """Return the candidate with the lowest cost over *duration* [s], which is a refined one or *chosen* itself.

    Descents begin at those of the following points with the best prediction: *chosen*, the present gains, and points
    spread over the ranges. The result must not have more objections than *chosen*, and must be noticeably better. Its
    ``wanted`` is that of *chosen*.

    If no gains meet the specified margins, the smallest margins apply. Gains that are safe to fly are never replaced by
    gains that are closer to the specification but perform worse. A last descent includes the gains of ``Law.late``, if
    that improves the result. If less than the whole bandwidth is required, the search is repeated for a slower rise.
    """
    fastest = _fastest(problem, chosen, duration)
    slowest_rise = _required_rise(problem, fastest)
    if not slowest_rise > 0.0:
        return fastest
    aims = _Aims(problem, fastest.wanted, duration, lenient=bool(fastest.objections), rise=slowest_rise)
    return _refined(aims, fastest, [fastest.settings, chosen.settings])


def _required_rise(problem: DesignProblem, fastest: GainCandidate) -> float:
    """Return the shortest rise time [s] of a loop with the required bandwidth relative to the *fastest*; 0: any."""
    share, rise = problem.spec.bandwidth, fastest.prediction.metrics.rise
    return rise / share if share < 1.0 and math.isfinite(rise) else 0.0


def _fastest(problem: DesignProblem, chosen: GainCandidate, duration: float) -> GainCandidate:
    """Return the result of :func:`refine` for the whole bandwidth."""
    aims = _Aims(problem, chosen.wanted, duration)
    best = _refined(aims, chosen, [chosen.settings, problem.settings])
    lenient = bool(best.objections)
    if lenient:
        aims = replace(aims, lenient=True)
        best = _refined(aims, chosen, [chosen.settings, best.settings, problem.settings])
    if not problem.late:
        return best
    wider = replace(problem, gains=(*problem.gains, *problem.late))
    full = {**best.settings, **{g.parameter: g.high for g in problem.late}}
    aims = _Aims(wider, best.wanted, duration, CALM, lenient)
    return _refined(aims, best, [best.settings, full], ratio=CLEARLY_LESS)


def refine_briefly(
    problem: DesignProblem, near: GainCandidate, duration: float, *, everywhere: bool = False
) -> GainCandidate:
    """Return nearly the result of :func:`refine`, from a single descent.

    The descent starts at *near*. With *everywhere*, it may also start at the best of points spread over the ranges.
    Optional gains of the law are included only if *near* has them.
    """
    noise, problem = _noise_of(problem, near), _with_late(problem, near)
    candidate = near
    for lenient in (False, True):
        cost = _Cost(_Aims(problem, near.wanted, duration, noise, lenient), candidate.settings)
        begins = [np.sqrt(problem.as_fractions(candidate.settings))]
        if everywhere and not lenient:
            begins = [min([*begins, *sobol(len(problem.gains), SCATTER)], key=cost)]
        settings = _rounded(problem, cost.settings(_descend(cost, begins[0], EVALUATIONS)))
        candidate = judge(problem, near.wanted, settings, duration)
        if not candidate.objections:
            break
    return candidate


def refine_for_both(problem: DesignProblem, best: GainCandidate, other: OtherMode, duration: float) -> GainCandidate:
    """Return gains that also serve the *other* mode, with little more error in this mode than the *best* gains.

    *best* is the result of :func:`refine`. It is returned unchanged if no gains are noticeably better for both modes.
    """
    problem = _with_late(problem, best)
    starts = [best.settings]
    if problem.law.name in ALIKE:
        law, speed = other.problem.law, problem.spec.speed
        exact = law.starts(problem.model, best.wanted, best.settings, speed)[0][FEED]
        starts += [ALIKE[problem.law.name](best.settings, share * exact) for share in FEEDS]
    aims = _Aims(problem, best.wanted, duration, _noise_of(problem, best), bool(best.objections), other)
    if problem.spec.bandwidth < 1.0:
        aims = replace(aims, rise=NEARLY * best.prediction.metrics.rise)
    return _refined(aims, best, starts, yields=True)


def refine_beyond(
    problem: DesignProblem, best: GainCandidate, other: OtherMode | None, duration: float
) -> GainCandidate:
    """Return the best gains in the wider ranges of *problem*, searched from *best*, or *best* if none are better."""
    problem = _with_late(problem, best)
    aims = _Aims(problem, best.wanted, duration, _noise_of(problem, best), bool(best.objections), other)
    return _refined(aims, best, [best.settings])


def beyond(gain: Gain) -> Gain:
    """Return *gain* with a range that exceeds the documented range by the factor :data:`WIDER` at both ends."""
    return replace(gain, low=gain.low / WIDER, high=gain.high * WIDER)


def _with_late(problem: DesignProblem, near: GainCandidate) -> DesignProblem:
    """Return *problem* with those late gains included that *near* uses."""
    taken = [g for g in problem.late if near.settings[g.parameter] > problem.law.fixed[g.parameter]]
    return replace(problem, gains=(*problem.gains, *taken))


def _noise_of(problem: DesignProblem, near: GainCandidate) -> float:
    taken = any(near.settings[name] > value for name, value in problem.law.fixed.items())
    return CALM if taken else NOISE_LIMIT


def any_better(problem: DesignProblem, before: GainCandidate, duration: float) -> GainCandidate | None:
    """Return gains that are safe to fly and better than *before*, the present gains, or None if there are none.

    Points spread over the documented ranges are tried, and descents from the best of them. Present gains that meet the
    specified margins are not replaced by gains that do not.
    """
    lenient = bool(before.objections)
    cost = _Cost(_Aims(problem, before.wanted, duration, lenient=lenient), before.settings)
    best = sorted(sobol(len(problem.gains), SEARCHED), key=cost)[:CLOSER]
    for x in (*(_descend(cost, begin, EVALUATIONS) for begin in best[:DESCENTS]), *best):
        found = judge(problem, before.wanted, _rounded(problem, cost.settings(x)), duration)
        if is_tolerable(found) and (lenient or not found.objections) and passes(problem, before, found, duration):
            return found
    return None


def passes(
    problem: DesignProblem, before: GainCandidate, candidate: GainCandidate, duration: float, slower: float = 1.0
) -> bool:
    """Return whether *candidate* is predicted to be better than *before*, the present gains, also over the time that
    the two flown steps would have in common.

    A slow error may be small at the end of *duration* [s], but too large when the flown step ends. slower : as for
    :func:`gcs_autotune.design.is_better`.
    """
    free = problem.law.free_overshoot
    if not is_better(before.prediction.metrics, candidate.prediction.metrics, free, slower=slower).better:
        return False
    if not math.isfinite(problem.spec.settled_time):
        return True
    flown = predict_as_flown(problem, (before.settings, candidate.settings), duration)
    return is_better(flown.one, flown.other, free, slower=slower).better


def _refined(
    aims: _Aims,
    chosen: GainCandidate,
    starts: Sequence[Settings],
    *,
    ratio: float = NOTICEABLE,
    yields: bool = False,
) -> GainCandidate:
    """Return the candidate with the least cost; return *chosen* unless the least cost is below *ratio* of its cost.

    yields : whether this mode may have a slightly larger error in favour of the other mode.
    """
    settings, problem = dict(chosen.settings), aims.problem
    if yields:
        aims = replace(aims, most=YIELD * _Cost(replace(aims, other=None), settings).error(settings))
    cost = _Cost(aims, settings)
    usual = _Cost(replace(aims, noise=NOISE_LIMIT), settings)
    before = usual.of(chosen.settings)  # it was chosen under the usual limit of noise
    best, least = chosen, ratio * before
    scatter = sobol(len(problem.gains), SCATTER)
    begins = sorted((*(np.sqrt(problem.as_fractions(s)) for s in starts), *scatter), key=cost)[:DESCENTS]
    x = min((_descend(cost, begin, EVALUATIONS_OF_FIRST) for begin in begins), key=cost)
    for descents in range(ROUNDS):
        if descents:
            cost = _Cost(aims, settings)
            x = _descend(cost, x, EVALUATIONS)
        settings = _rounded(problem, cost.settings(x))
        found = judge(problem, chosen.wanted, settings, aims.duration)
        acceptable = is_tolerable(found) and (aims.lenient or len(found.objections) <= len(chosen.objections))
        is_for = cost.of(settings)
        if acceptable and is_for < least:
            best, least = found, is_for
        elif is_for > before:  # two descents have ended above where they are to end below: a third would not
            break
    return best


def _rounded(problem: DesignProblem, settings: Settings) -> dict[str, float]:
    return {**settings, **{g.parameter: round_gain(settings[g.parameter], g) for g in problem.gains}}


@dataclass(frozen=True, slots=True, eq=False)
class _Aims:
    """Aims of the search: follow ``wanted`` over ``duration`` [s], with at most ``noise`` in the output.

    - ``lenient``: whether only the smallest margins are required, and the specified margins add cost.
    - ``other``: the other mode, whose shortfall also adds cost, or None.
    - ``most`` [s^2]: largest ITAE of this mode if there is another mode.
    - ``rise`` [s]: shortest rise time.
    """

    problem: DesignProblem
    wanted: ReferenceModel
    duration: float
    noise: float = NOISE_LIMIT
    lenient: bool = False
    other: OtherMode | None = None
    most: float = math.inf
    rise: float = 0.0


class _Cost:
    """Cost of a vector of gains: predicted ITAE, increased by overshoot and by every limit that is not met.

    near : settings at which the worst samples of the region are selected.
    """

    def __init__(self, aims: _Aims, near: Settings) -> None:
        self._problem, self._wanted = problem, wanted = aims.problem, aims.wanted
        self._other, self._most, self._rise = aims.other, aims.most, aims.rise
        self._held = RESERVE if aims.other is None else RESERVE_BESIDE
        self._noise, self._lenient, self._duration = aims.noise, aims.lenient, aims.duration
        least = 2.0 * noise_floor(problem.spec.noise_std, problem.spec.quantum)
        self._steps = [part * problem.step for part in PARTS if part == 1.0 or part * problem.step > least]
        self._watched = [problem.model, *problem.hardest(near, wanted, HARDEST)]
        self._least = math.inf

    def settings(self, x: Array) -> dict[str, float]:
        """Return the parameters for *x* (n,), the square roots of the gains as fractions of their ranges."""
        return self._problem.with_gains(np.square(np.clip(x, 0.0, 1.0)))

    def __call__(self, x: Array) -> float:
        """Return the cost at *x* (n,)."""
        return self.of(self.settings(x))

    def error(self, settings: Settings) -> float:
        """Return the predicted ITAE [s^2] with *settings*."""
        return self._error_of(self._flown(settings))

    def _flown(self, settings: Settings) -> list[StepError]:
        return [predict_error(self._problem, settings, step, self._duration) for step in self._steps]

    @staticmethod
    def _error_of(steps: Sequence[StepError]) -> float:
        return max(float(np.mean([m.itae for m in steps])), MIN_ERROR)

    def of(self, settings: Settings) -> float:
        """Return the cost of *settings*.

        The penalties for limits are left out if the ITAE alone already exceeds :data:`HOPELESS` times the lowest cost.
        """
        steps = self._flown(settings)
        plain = self._error_of(steps)
        dislike = DISLIKE * max(0.0, steps[0].overshoot - GOOD_OVERSHOOT - self._problem.law.free_overshoot)
        if plain * (1.0 + dislike) > HOPELESS * self._least:
            return plain * (1.0 + dislike)
        cost = plain * (1.0 + dislike + self._price(settings, steps[0]))
        if self._other is not None:
            above = PRICE * max(0.0, plain / self._most - 1.0)
            cost *= 1.0 + above + BESIDE * self._other.shortfall(settings) + PRICE * self._missed_beside(settings)
        self._least = min(self._least, cost)
        return cost

    def _missed_beside(self, settings: Settings) -> float:
        """Return the fractions by which the other mode's loop misses the margins."""
        assert self._other is not None
        problem, spec = self._other.problem, self._problem.spec
        low = worst(problem.margins(settings, self._wanted, self._watched))
        gain, phase = (MIN_GAIN_MARGIN, MIN_PHASE_MARGIN) if self._lenient else (spec.gain_margin, spec.phase_margin)
        return max(0.0, 1.0 - low.gain / (self._held * gain)) + max(0.0, 1.0 - low.phase / (self._held * phase))

    def _price(self, settings: Settings, step: StepError) -> float:
        """Return the penalty for limits that are not met, from the sum of the fractions missed."""
        problem, spec = self._problem, self._problem.spec
        reserve = 2.0 * problem.law.loop_period(settings) + problem.model.delay
        missed = integral_shortfall(problem, settings, self._wanted)
        missed += max(0.0, step.overshoot - max_overshoot(problem))
        if step.rise < self._rise:
            missed += 1.0 - step.rise / self._rise
        missed += max(0.0, self._held * output_noise(problem, settings) / self._noise - 1.0)
        margins = problem.margins(settings, self._wanted, self._watched)
        shortfall = sum(
            max(0.0, 1.0 - m.gain / (self._held * spec.gain_margin))
            + max(0.0, 1.0 - m.phase / (self._held * spec.phase_margin))
            + max(0.0, 1.0 - m.delay / (self._held * reserve))
            for m in margins
        )
        if not self._lenient:
            return PRICE * (missed + shortfall)
        least = sum(
            max(0.0, 1.0 - m.gain / (self._held * MIN_GAIN_MARGIN))
            + max(0.0, 1.0 - m.phase / (self._held * MIN_PHASE_MARGIN))
            for m in margins
        )
        return PRICE * (missed + least) + REGRET * shortfall


def _descend(cost: Callable[[Array], float], start: Array, evaluations: int) -> Array:
    """Return the minimum found by a bounded Nelder-Mead search from *start* (n,).

    evaluations : largest number of cost evaluations, per gain.
    """
    n = len(start)
    simplex = np.tile(np.clip(start, 0.0, 1.0), (n + 1, 1))
    for i in range(n):
        simplex[i + 1, i] += SPREAD if simplex[i + 1, i] < 0.5 else -SPREAD
    found = minimize(
        cost,
        start,
        method="Nelder-Mead",
        bounds=[(0.0, 1.0)] * n,
        options={
            "initial_simplex": simplex,
            "maxfev": evaluations * n,
            "xatol": NEAR,
            "fatol": FLAT * cost(simplex[0]),
        },
    )
    lowest: Array = np.clip(np.asarray(found.x, dtype=np.float64), 0.0, 1.0)
    return lowest


def sobol(dimensions: int, power: int) -> NDArray[np.float64]:
    """Return the first ``2**power`` points of Sobol's sequence, (2**power, dimensions), each in [0, 1)."""
    points: NDArray[np.float64] = scipy_stats().qmc.Sobol(dimensions, scramble=False).random_base2(power)
    return points
