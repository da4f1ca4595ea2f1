"""Select the speed of the loop: try specifications from the fastest to slower ones and evaluate the results."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from gcs_autotune.control import ReferenceModel, omega_for_settling, reference_model, settling_time
from gcs_autotune.design.laws import Settings
from gcs_autotune.design.margins import worst
from gcs_autotune.design.matching import (
    NOISE_LIMIT,
    DesignProblem,
    match,
    output_noise,
)
from gcs_autotune.design.prediction import predict
from gcs_autotune.design.result import Margins, Prediction
from gcs_autotune.errors import NoGainsMeetSpec

__all__ = [
    "MIN_GAIN_MARGIN",
    "MIN_PHASE_MARGIN",
    "OVERSHOOT",
    "GainCandidate",
    "choose",
    "is_tolerable",
    "judge",
    "max_overshoot",
    "objections",
]

OVERSHOOT, WORST_OVERSHOOT = 0.12, 0.25
"""Largest overshoot of the predicted step, as a fraction of the step.

Project choice: the proof on the water allows 15 %.

If the present gains have more overshoot, up to ``WORST_OVERSHOOT``, the same overshoot is allowed.
"""
MIN_GAIN_MARGIN, MIN_PHASE_MARGIN, MAX_OVERSHOOT = 2.0, math.radians(30.0), 0.4
"""Smallest margins [ratio, rad] and largest overshoot of a proposal if the ranges exclude the default specification.

Such a proposal has a note. Project choice.
"""
SLOWER = 0.8
"""Ratio of the speeds of successive specifications. Project choice."""
TRIES = 12
SPANS = 8.0
"""Time over which candidates are compared, in settling times of the fastest specification. Project choice."""
PATIENCE = 2
"""Number of slower specifications that are tried after an acceptable one.

Project choice: a specification limited by the ranges may not be the best.
"""
NOTICEABLE = 0.9
"""Predicted ITAE of a slower specification, relative to that of the faster one, below which the slower one is
preferred. Project choice.
"""
FASTEST, SLOWEST = 20.0, 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class GainCandidate:
    """One specification with gains for it, the predicted step with these gains, and the objections to them."""

    wanted: ReferenceModel
    settings: Settings
    margins: Margins
    worst_margins: Margins
    prediction: Prediction
    objections: tuple[str, ...]
    free_overshoot: float = 0.0


def choose(problem: DesignProblem, patience: int = PATIENCE) -> GainCandidate:
    """Return the best acceptable candidate.

    It is the candidate for the user's specification. Without one, it is the fastest candidate that no slower candidate
    clearly improves on.

    patience : number of slower specifications tried after an acceptable one.

    Raises
    ------
    NoGainsMeetSpec
        No candidate is acceptable. The message states why the last one failed and what to try.
    """
    tried: list[GainCandidate] = []
    best: GainCandidate | None = None
    for wanted in _specifications(problem):
        fastest = (tried[0].wanted if tried else wanted).omega_0
        span = problem.spec.step_duration or SPANS * settling_time(wanted.kind, fastest)
        gains = match(problem, wanted, tried[-1].settings if tried else None)
        settings = {**problem.settings, **problem.law.fixed, **problem.spec.measured, **gains}
        tried.append(judge(problem, wanted, settings, span))
        if not tried[-1].objections and (best is None or _score(tried[-1]) < NOTICEABLE * _score(best)):
            best = tried[-1]
        elif best is not None:
            patience -= 1
        if best is not None and patience <= 0:
            break
    if best is None and problem.spec.is_automatic:
        best = _tolerable(tried)
    if best is None:
        raise _refusal(problem, tried[-1])
    return best


def _tolerable(tried: Sequence[GainCandidate]) -> GainCandidate | None:
    """Return the fastest candidate among those that are safe to fly and not noticeably worse than the best."""
    safe = [c for c in tried if is_tolerable(c)]
    least = min((_score(c) for c in safe), default=0.0)
    return next((c for c in safe if _score(c) * NOTICEABLE <= least), None)


def _score(candidate: GainCandidate) -> float:
    return candidate.prediction.metrics.itae


def is_tolerable(candidate: GainCandidate) -> bool:
    """Return whether *candidate*, which misses the specification, is safe: stable over the region, with the
    smallest margins.
    """
    low = candidate.worst_margins
    return (
        low.stable
        and low.gain >= MIN_GAIN_MARGIN
        and low.phase >= MIN_PHASE_MARGIN
        and candidate.prediction.metrics.overshoot <= MAX_OVERSHOOT + candidate.free_overshoot
    )


def judge(problem: DesignProblem, wanted: ReferenceModel, settings: Settings, duration: float) -> GainCandidate:
    """Return *settings* as a candidate, with margins, prediction and objections, for a step recorded for *duration*
    [s].
    """
    found = problem.margins(settings, wanted, [problem.model, *problem.region.samples])
    margins, low = found[0], worst(found)
    prediction = predict(problem, problem.model, wanted, settings, duration)
    found_wanting = tuple(objections(problem, settings, low, prediction))
    return GainCandidate(wanted, settings, margins, low, prediction, found_wanting, problem.law.free_overshoot)


def objections(problem: DesignProblem, settings: Settings, low: Margins, prediction: Prediction) -> Iterator[str]:
    """Yield objections to *settings*, whose worst margins are *low* and whose predicted step is *prediction*."""
    spec = problem.spec
    if not low.stable:
        yield "the loop is unstable for part of the 95 % region of the identified model"
    else:
        if low.gain < spec.gain_margin:
            yield f"gain margin {low.gain:.2f} is less than {spec.gain_margin:.2f}"
        if low.phase < spec.phase_margin:
            has, wants = math.degrees(low.phase), math.degrees(spec.phase_margin)
            digits = 0 if wants - has >= 1.0 else 1
            yield f"phase margin {has:.{digits}f} deg is less than {wants:.0f} deg"
        needed = 2.0 * problem.law.loop_period(settings) + problem.model.delay
        if low.delay < needed:
            yield f"delay margin {low.delay:.2f} s is less than the required {needed:.2f} s"
    metrics = prediction.metrics
    most = max_overshoot(problem)
    if metrics.overshoot > most:
        yield f"predicted overshoot {metrics.overshoot:.0%} is more than {most:.0%}"
    noise = output_noise(problem, settings)
    if noise > NOISE_LIMIT:
        yield f"measurement noise would move the actuator by {noise:.1%} rms, which is more than {NOISE_LIMIT:.0%}"


def max_overshoot(problem: DesignProblem) -> float:
    """Return the largest allowed predicted overshoot, relative to the step."""
    return max(OVERSHOOT, min(problem.present_overshoot, WORST_OVERSHOOT)) + problem.law.free_overshoot


def _specifications(problem: DesignProblem) -> Iterator[ReferenceModel]:
    spec = problem.spec
    if spec.omega_0 is not None:
        yield reference_model(spec.kind, spec.omega_0)
        return
    if spec.settling_time is not None:
        yield reference_model(spec.kind, omega_for_settling(spec.kind, spec.settling_time))
        return
    omega = _fastest(problem)
    for _ in range(TRIES):
        yield reference_model(spec.kind, omega)
        omega *= SLOWER


def _fastest(problem: DesignProblem) -> float:
    """Return the characteristic frequency [rad/s] of the fastest specification that can be followed.

    Actuator, velocity limit and total delay limit it.
    """
    spec, model = problem.spec, problem.model
    limit = problem.law.velocity_limit(problem.settings, spec.speed)
    low, high = math.log(SLOWEST), math.log(min(FASTEST, 1.0 / max(model.delay + problem.delay, 1.0 / FASTEST)))

    def is_flyable(log_omega: float) -> bool:
        use, velocity = problem.demand(model, reference_model(spec.kind, math.exp(log_omega)))
        return use <= spec.actuator_use and velocity <= limit

    if not is_flyable(low):
        raise NoGainsMeetSpec(
            f"the constant force on the craft ({abs(model.delta):.0%} of full output) leaves too little of the "
            f"actuator for a step (limit {spec.actuator_use:.0%}). Trim the craft or allow more actuator use"
        )
    if is_flyable(high):
        return math.exp(high)
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if is_flyable(middle) else (low, middle)
    return math.exp(low)


def _refusal(problem: DesignProblem, last: GainCandidate) -> NoGainsMeetSpec:
    settled = settling_time(last.wanted.kind, last.wanted.omega_0)
    return NoGainsMeetSpec(
        f"no gains inside the documented ranges give an acceptable {problem.law.name} loop. The last attempt, "
        f"settling in {settled:.1f} s, failed: {'; '.join(last.objections)}. Try a longer settling time, a smaller "
        "step, or a longer experiment for less uncertainty"
    )
