"""What a loop is like: closed-loop poles, margins with disk margins, step and disturbance over the 95 % region.

Gain, phase and delay margins are those of :mod:`.margins`, which a design computes thousands of times. All margins know
the exact delay; the poles approximate it. ``tests/design`` compares both with python-control's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.control import FeedbackLaw, OwnDesign, step_response
from gcs_autotune.design.laws import LoopMotion, Scenario, Settings
from gcs_autotune.design.margins import margins_of, worst
from gcs_autotune.design.matching import DesignProblem
from gcs_autotune.design.open_loop import OpenLoop, Rational
from gcs_autotune.design.plant import Region, sample_region
from gcs_autotune.design.proposal import problem_of
from gcs_autotune.design.reduction import Reduction
from gcs_autotune.design.result import Margins, Proposal
from gcs_autotune.design.spec import Spec
from gcs_autotune.firmware import Axis
from gcs_autotune.models import SingleDof
from gcs_autotune.notebook import Displayed

__all__ = ["DiskMargin", "LoopAnalysis", "LoopResponse", "analyse", "analyse_own", "analyse_proposal"]

Array = NDArray[np.float64]

PUSH = 0.05
"""Constant force of the disturbance response [fraction of full output]. Project choice."""
OMEGA = np.logspace(-3.0, 2.7, 500)
"""Frequencies [rad/s] at which disk margins are searched."""


@dataclass(frozen=True, slots=True)
class DiskMargin:
    """How much gain and phase may change together: ``gain`` (ratio, up or down) and ``phase`` [rad].

    ``size`` is the disk's, balanced between S and T; zero for an unstable loop. Source: Seiler2020.
    """

    size: float
    gain: float
    phase: float


@dataclass(frozen=True, slots=True, eq=False)
class LoopResponse:
    """A step, and a constant force *push* [fraction of full] from ``push_at`` [s] on, at times t (n,) [s].

    ``position`` and ``output``: of the identified model; ``low`` and ``high``: the range of positions over its 95 %
    region. Positions are from the start of the step [rad, m, rad/s or m/s].
    """

    step: float
    push: float
    push_at: float
    t: Array
    position: Array
    low: Array
    high: Array
    output: Array


@dataclass(frozen=True, slots=True, eq=False)
class LoopAnalysis(Displayed):
    """One loop with one set of gains.

    ``loop``: the open loop at the actuator, of the state of the craft with the smallest disk margin; ``poles`` (n,):
    its closed-loop poles [rad/s], the delay approximated. ``margins`` and ``disk``: the smallest of all states of the
    identified model. ``worst_margins`` and ``worst_disk``: over its 95 % region.
    """

    loop: OpenLoop
    poles: NDArray[np.complex128]
    margins: Margins
    worst_margins: Margins
    disk: DiskMargin
    worst_disk: DiskMargin
    response: LoopResponse


def analyse(loops: Sequence[OpenLoop], region: Sequence[OpenLoop], response: LoopResponse) -> LoopAnalysis:
    """Return the analysis of a loop.

    loops : of the identified model, one for each state of the craft. region : of the samples of its 95 % region.
    """
    disks = [_disk(loop) for loop in loops]
    narrowest = min(range(len(loops)), key=lambda k: disks[k].size)
    loop, every = loops[narrowest], (*loops, *region)
    return LoopAnalysis(
        loop,
        loop.closed_loop_poles(),
        worst([margins_of(each) for each in loops]),
        worst([margins_of(each) for each in every]),
        _smallest(disks),
        _smallest([*disks, *map(_disk, region)]),
        response,
    )


def _disk(loop: OpenLoop) -> DiskMargin:
    if not np.all(loop.closed_loop_poles().real < 0.0):
        return DiskMargin(0.0, 1.0, 0.0)
    response = loop.response(OMEGA)
    size = float(np.min(2.0 * np.abs(1.0 + response) / np.abs(1.0 - response)))
    gain = (2.0 + size) / (2.0 - size) if size < 2.0 else math.inf
    return DiskMargin(size, gain, 2.0 * math.atan(0.5 * size))


def _smallest(disks: Iterable[DiskMargin]) -> DiskMargin:
    return min(disks, key=lambda disk: disk.size)


def analyse_proposal(
    proposal: Proposal,
    model: SingleDof,
    covariance: Array,
    axis: Axis,
    present: Settings,
    spec: Spec,
    reduction: Reduction | None = None,
) -> tuple[LoopAnalysis, LoopAnalysis]:
    """Return the analyses with the present and with the proposed gains; the arguments are those of ``design``.

    *present* has canonical names.
    """
    problem = problem_of(model, covariance, axis, present, spec, reduction)
    both = ({**problem.settings}, {**problem.settings, **axis.names.to_canonical(proposal.new)})
    before, after = (_with_gains(problem, settings, proposal) for settings in both)
    return before, after


def _with_gains(problem: DesignProblem, settings: Settings, proposal: Proposal) -> LoopAnalysis:
    speed, span = problem.spec.speed, float(proposal.after.t[-1])
    scenario = Scenario(problem.step, 2.0 * span, PUSH, span)

    def flown(model: SingleDof) -> LoopMotion:
        return problem.law.simulate(model, settings, scenario, speed, problem.delay, problem.actuator)

    loops = [problem.loops(settings, proposal.wanted, m) for m in (problem.model, *problem.region.samples)]
    region = [loop for group in loops[1:] for loop in group]
    return analyse(loops[0], region, _response(flown, problem.region, problem.step, PUSH, span))


def analyse_own(design: OwnDesign, covariance: Array, step: float, span: float) -> LoopAnalysis:
    """Return the analysis of a controller of our own for a *step* [rad or m], with the push after *span* [s].

    covariance : (5, 5) of the model, in units of its input.
    """
    law, push = design.law, PUSH * design.law.limits[1]
    region = sample_region(design.model, covariance)

    def flown(model: SingleDof) -> LoopMotion:
        t, position, _, output = step_response(law, model, step, 2.0 * span, push=push, push_at=span)
        return LoopMotion(t, position, output)

    # a sample's delay includes that of the sampled loop, as the design's does
    loops = [_own_loop(law, m) for m in region.samples]
    return analyse([_own_loop(law, design.model)], loops, _response(flown, region, step, PUSH, span))


def _own_loop(law: FeedbackLaw, model: SingleDof) -> OpenLoop:
    """Return the loop opened at the actuator; quadratic drag counts as compensated."""
    K_I = law.K_I if law.structure.integral else 0.0
    K_D = law.K_D if law.structure.derivative else 0.0
    return OpenLoop(Rational((K_D, law.K_P, K_I), (model.alpha, model.beta, 0.0, 0.0)), model.delay)


def _response(
    flown: Callable[[SingleDof], LoopMotion], region: Region, step: float, push: float, push_at: float
) -> LoopResponse:
    nominal = flown(region.model)
    t = nominal.t
    every = [nominal.position, *(np.interp(t, m.t, m.position) for m in map(flown, region.samples))]
    return LoopResponse(
        step, push, push_at, t, nominal.position, np.min(every, axis=0), np.max(every, axis=0), nominal.output
    )
