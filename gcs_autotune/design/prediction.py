"""Predict a step by simulation, with the same metrics as for flown steps."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.control import ReferenceModel, wanted_step
from gcs_autotune.design.laws import LoopStart, Scenario, Settings
from gcs_autotune.design.matching import DesignProblem, output_noise
from gcs_autotune.design.result import Prediction, Proposal, Ruler, StepHalf, StepMetrics
from gcs_autotune.design.spec import Spec
from gcs_autotune.design.step_metrics import StepError, combine, step_error, step_metrics
from gcs_autotune.models import SingleDof
from gcs_autotune.settling import LOOK, TRIFLE, is_at_rest

__all__ = ["PairAsFlown", "over_windows", "predict", "predict_as_flown", "predict_error", "ruler_of"]

Array = NDArray[np.float64]

RATE = 50.0
"""Maximum rate at which samples of a prediction are stored [Hz]. Project choice."""
EVERY = 0.1
"""Time [s] between checks whether the craft is at rest. Project choice."""


class PairAsFlown(NamedTuple):
    """Predicted steps with two settings, both evaluated over the same time.

    - ``one``, ``other``: metrics with each of the settings.
    - ``windows`` [s]: durations of step and step back.
    - ``halves``: step and step back with each of the settings, up to the latest possible end.
    """

    one: StepMetrics
    other: StepMetrics
    windows: tuple[float, float]
    halves: tuple[tuple[StepHalf, StepHalf], tuple[StepHalf, StepHalf]]


def predict(
    problem: DesignProblem, model: SingleDof, wanted: ReferenceModel, settings: Settings, duration: float
) -> Prediction:
    """Simulate the step and the step back on *model* with *settings* for *duration* [s] each.

    The arrays of the result are those of the step. The metrics are those of step and step back, combined as for flown
    steps.
    """
    pair = _there_and_back(problem, model, settings, problem.step, duration)
    there = pair[0]
    ideal = problem.step * wanted_step(wanted, there.t).position
    metrics = combine([_measure(flown, ruler_of(problem.spec)) for flown in pair])
    return Prediction(there.t, np.full_like(there.t, problem.step), there.position, ideal, there.output, metrics)


def predict_error(
    problem: DesignProblem, settings: Settings, step: float, duration: float, model: SingleDof | None = None
) -> StepError:
    """Return the error, overshoot and rise time that :func:`predict` would give for a step of *step* [rad or m].

    model : model to simulate; None for the identified one.
    """
    ruler = ruler_of(problem.spec)._asdict()
    pair = _there_and_back(problem, model or problem.model, settings, step, duration)
    there, back = (step_error(half.t, half.position, half.size, **ruler) for half in pair)
    rise = 0.5 * (there.rise + back.rise)
    return StepError(0.5 * (there.itae + back.itae), max(there.overshoot, back.overshoot), rise)


def predict_as_flown(problem: DesignProblem, pair: Sequence[Settings], duration: float) -> PairAsFlown:
    """Return the predicted metrics of steps with each of two settings (*pair*), over the time that both steps last.

    A flown half ends once the craft has settled at its target, at most after *duration* [s]. The steps of a pair are
    compared over the time that both lasted. For a step already flown, the time is ``Spec.windows``. For the other step
    it is simulated. The step back begins where the step ended, and the integral is not reset. The first of the pair
    starts in the state ``Spec.start``.
    """
    known = (*problem.spec.windows, *[duration] * 2)[:2]
    flights = [
        partial(_there_and_back, problem, problem.model, settings, problem.step, duration, start=start)
        for settings, start in zip(pair, (problem.spec.start, None), strict=True)
    ]
    whole = [fly()[0] for fly in flights]
    lasted = [_over_at(problem, settings, half) for settings, half in zip(pair, whole, strict=True)]
    lasted[:1] = problem.spec.windows[:1] or lasted[:1]
    flown = [fly(turn) for fly, turn in zip(flights, lasted, strict=True)]
    over = [[_over_at(problem, s, half) for half in steps] for s, steps in zip(pair, flown, strict=True)]
    ends = [min(lengths) for lengths in zip(known, *over, strict=True)]
    one, other = ((there, steps[1]) for there, steps in zip(whole, flown, strict=True))
    ruler = ruler_of(problem.spec)
    return PairAsFlown(_read(one, ends, ruler), _read(other, ends, ruler), (ends[0], ends[1]), (one, other))


def over_windows(proposal: Proposal, windows: Sequence[float]) -> Proposal:
    """Return *proposal* with its predictions evaluated over *windows* [s], the durations that two flown steps have in
    common.

    The duration of a half depends on slow motion at the edge of a band, and the error over time depends on the
    duration. The predicted step back still starts at the predicted end of its own step. If fewer than two durations
    were recorded because a loop diverged, *proposal* is returned unchanged.
    """
    if len(windows) < 2:
        return proposal
    predictions = [
        p if p.halves is None else replace(p, metrics=_read(p.halves, windows, proposal.ruler))
        for p in (proposal.before, proposal.after)
    ]
    return replace(proposal, before=predictions[0], after=predictions[1], windows=tuple(windows))


def ruler_of(spec: Spec) -> Ruler:
    """Return the measurement properties (noise, its duration, sensor resolution) with which flown positions are
    evaluated.
    """
    return Ruler(spec.noise_std, spec.quantum, 0.5 / spec.noise_bandwidth)


def _read(halves: Sequence[StepHalf], ends: Sequence[float], ruler: Ruler) -> StepMetrics:
    return combine([_measure(_cut(half, end), ruler) for half, end in zip(halves, ends, strict=True)])


def _over_at(problem: DesignProblem, settings: Settings, half: StepHalf) -> float:
    """Return the time [s] at which a simulated *half* would be ended like a flown one; otherwise its length."""
    away = np.flatnonzero(np.abs(half.size - half.position) > problem.spec.settled_band)
    for one, other in itertools.pairwise([-1, *away.tolist(), len(half.t)]):
        begin, left = one + 1, min(other, len(half.t) - 1)
        if begin < left and (end := _waited_until(problem, settings, half, half.t[begin])) <= half.t[left]:
            return end
    return float(half.t[-1])


def _waited_until(problem: DesignProblem, settings: Settings, half: StepHalf, since: float) -> float:
    """Return the time [s] until which a craft that has been at its target since *since* is observed.

    The time is shorter if the craft is at rest.
    """
    spec = problem.spec
    output_std = output_noise(problem, settings)
    signals = ((half.position, TRIFLE * abs(half.size), spec.jitter), (half.output, TRIFLE, output_std))
    enough = since + spec.settled_time
    last = min(enough, float(half.t[-1]))
    for now in np.arange(min(max(since + spec.settled_least, LOOK), last), last, EVERY):
        seen = (half.t > now - LOOK) & (half.t <= now)
        if all(is_at_rest(half.t[seen], x[seen], enough - now, few, std, unseen=std) for x, few, std in signals):
            return float(now)
    return enough


def _cut(half: StepHalf, end: float) -> StepHalf:
    kept = int(np.searchsorted(half.t, end + 1e-9))
    return StepHalf(half.size, half.t[:kept], half.position[:kept], half.output[:kept])


def _there_and_back(
    problem: DesignProblem,
    model: SingleDof,
    settings: Settings,
    step: float,
    duration: float,
    turn: float = math.inf,
    start: LoopStart | None = None,
) -> tuple[StepHalf, StepHalf]:
    """Return step and step back. The step begins in the state *start*, without a hold, if that is given.

    With a known step duration, both are in one flight. Otherwise each is a step of a settled loop. The step back comes
    after *duration* [s], or after *turn* [s] if that is shorter.
    """
    if problem.spec.step_duration is None:
        there, back = (
            StepHalf(size, *_fly(problem, model, settings, Scenario(size, duration), 0.0)) for size in (step, -step)
        )
        return there, back
    lead, turn = problem.spec.hold if start is None else 0.0, min(turn, duration)
    scenario = Scenario(step, lead + turn + duration, lead=lead, back_at=lead + turn, start=start)
    t, position, output = _fly(problem, model, settings, scenario, lead)
    first = int(np.searchsorted(t, turn - 1e-9))
    return (
        StepHalf(step, t[: first + 1], position[: first + 1], output[: first + 1]),
        StepHalf(-step, t[first:] - t[first], position[first:] - step, output[first:]),
    )


def _fly(
    problem: DesignProblem, model: SingleDof, settings: Settings, scenario: Scenario, begin: float
) -> tuple[Array, Array, Array]:
    """Return t (n,) [s] from *begin* on, position and output, at the stored rate."""
    actuator = problem.actuator
    if not actuator.is_plain:  # noise that carries an output over the edge of a dead band works where its mean does not
        actuator = replace(actuator, dither=output_noise(problem, settings))
    motion = problem.law.simulate(model, settings, scenario, problem.spec.speed, problem.delay, actuator)
    period = problem.law.loop_period(settings)
    every = max(round(1.0 / (RATE * period)), 1)
    kept = slice(round(begin / period), None, every)
    return motion.t[kept] - begin, motion.position[kept], motion.output[kept]


def _measure(flown: StepHalf, ruler: Ruler) -> StepMetrics:
    """Measure a step as a flown one.

    The target before it is the position at rest, and errors within the noise count as zero.
    """
    t, position, output = (np.concatenate([x[:1], x]) for x in (flown.t, flown.position, flown.output))
    target = np.full_like(t, flown.size)
    target[0] = 0.0
    return step_metrics(t, target, position, output, **ruler._asdict())
