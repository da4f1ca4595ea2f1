"""Notes for the user on the numbers of a proposal.

One note gives the margins at speeds other than that of the identification. A ship's turning scales with its speed
(Nomoto's K' and T' are constant: K = K' U/L, T = T' L/U). ArduRover divides its steering by speed above
MOT_SPD_SCA_BASE. This division cancels the effect of speed on the gain, but not that on the time constant.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from gcs_autotune.control import ReferenceModel, settling_time
from gcs_autotune.design.hunting import LONG
from gcs_autotune.design.laws import SKID, Settings
from gcs_autotune.design.margins import worst
from gcs_autotune.design.matching import DesignProblem
from gcs_autotune.design.result import Beside, Hunting, Margins
from gcs_autotune.design.selection import GainCandidate
from gcs_autotune.design.verdict import is_better
from gcs_autotune.firmware import Axis
from gcs_autotune.models import SingleDof
from gcs_autotune.sname import DOFS

__all__ = [
    "NEAR_LIMIT",
    "at_speed",
    "limit_by_loop_rate",
    "notes_on",
    "on_other_speeds",
    "other_mode_notes",
    "residual_motion",
]

LONG_DELAY = 0.05
"""Delay [s] above which a note explains that its location matters. Project choice."""
TINY = {d.name: math.radians(0.05) if d.angular else 0.005 for d in DOFS.values()}
"""Degree of freedom -> error [rad or m] below which a note does not mention it. Project choice."""
POOR_MATCH = 0.08
"""Rms deviation from the reference step, relative to the step, above which the proposal has a note. Project choice."""
NEAR_LIMIT = 0.01
"""Distance to the end of a range, relative to the range, up to which a gain counts as limited. Project choice."""
LOOP_RATE, NOTICEABLE_LOSS = "SCHED_LOOP_RATE", 1.1
"""Parameter of the autopilot's loop rate, and the ratio of margins from which a note blames a slow loop.

Project choice.
"""
ROUNDING = 1e-6
"""Distance outside a range, relative to the range, up to which a value counts as on the limit.

A vehicle stores float32. Project choice.
"""


def notes_on(
    problem: DesignProblem,
    axis: Axis,
    before: GainCandidate,
    shown: GainCandidate,
    changed: bool,
    is_refined: bool,
    wider: GainCandidate | None = None,
) -> Iterator[str]:
    """Yield notes on the validity of the gains, on problems of the present gains, and on limits of the specification.

    wider : better gains outside the documented ranges, if any.
    """
    yield from problem.law.notes(problem.model, shown.settings, problem.spec.speed)
    if axis.steers_by_way:
        yield from on_other_speeds(problem, shown.settings, shown.wanted)
    yield from _on_the_present(problem, axis)
    yield from _on_the_change(problem, before, shown, changed)
    yield from _on_the_model(problem)
    yield from _on_the_specification(problem, axis, shown, is_refined and changed)
    if wider is not None:
        yield _on_the_ranges(problem, axis, shown, wider)


def residual_motion(before: Hunting, after: Hunting, dof: str) -> Iterator[str]:
    """Yield sentences on the residual motion after a small step, with the present gains (*before*) and the new ones
    (*after*).
    """
    if max(h.amplitude for h in (before, after)) == 0.0 and max(abs(h.offset) for h in (before, after)) < TINY[dof]:
        return
    yield (
        f"after a small step the loop {_left(before, dof)} with the present gains, and {_left(after, dof)} with "
        "the new gains"
    )


def _left(h: Hunting, dof: str) -> str:
    def size(x: float) -> str:
        return f"{math.degrees(x):.2g} deg" if DOFS[dof].angular else f"{x:.2g} m"

    if h.is_limit_cycle:
        return f"oscillates by +-{size(h.amplitude)} with a period of {h.period:.0f} s"
    if h.amplitude > 0.0:
        return f"is still moving after {LONG:.0f} s, {size(abs(h.offset) + h.amplitude)} off target"
    return f"comes to rest {size(abs(h.offset))} off target" if abs(h.offset) > TINY[dof] else "comes to rest"


def _on_the_present(problem: DesignProblem, axis: Axis) -> Iterator[str]:
    for gain in axis.gains:
        old, slack = problem.settings[gain.parameter], ROUNDING * (gain.high - gain.low)
        if not gain.low - slack <= old <= gain.high + slack:
            value, low, high = (axis.names.own_value(gain.parameter, x) for x in (old, gain.low, gain.high))
            yield f"{gain.parameter} = {value:g} on the vehicle is outside its range {low:g}..{high:g}"


def _on_the_change(problem: DesignProblem, before: GainCandidate, shown: GainCandidate, changed: bool) -> Iterator[str]:
    verdict = is_better(before.prediction.metrics, shown.prediction.metrics, before.free_overshoot)
    if not changed:
        yield f"the design found no gains inside the {_ranges(problem)} ranges that are better than the present ones"
    elif not before.worst_margins.stable:
        yield "with the present gains the loop is unstable for the identified model or part of its 95 % region"
    elif not verdict.better:
        old, new = (math.degrees(c.worst_margins.phase) for c in (before, shown))
        yield (
            "the predicted step is not better than with the present gains by every criterion "
            f"({'; '.join(verdict.against)}). The worst phase margin changes from {old:.0f} to {new:.0f} deg"
        )


def _ranges(problem: DesignProblem) -> str:
    return "allowed" if problem.spec.beyond_ranges else "documented"


def _on_the_model(problem: DesignProblem) -> Iterator[str]:
    if problem.model.delay > LONG_DELAY:
        yield (
            f"the design assumes that the identified delay of {problem.model.delay:.2f} s is between autopilot and "
            "force. If it is in the telemetry link, set it as link delay for a faster loop"
        )
    if not problem.region.samples:
        yield "the model has no uncertainty, so the worst margins are those of the model itself"


def limit_by_loop_rate(problem: DesignProblem, shown: GainCandidate) -> str:
    """Return how much margin the gains lose by a loop slower than the firmware's default, or an empty string.

    It is empty if the gains meet the specification, or if the loss is less than :data:`NOTICEABLE_LOSS`.
    """
    law, settings = problem.law, shown.settings
    period = law.loop_period(settings)
    usual = law.loop_period({name: value for name, value in settings.items() if name != LOOP_RATE})
    if not shown.objections or problem.spec.loop_delay is not None or not period > usual:
        return ""
    quick = replace(problem, delay=problem.delay * usual / period)
    models = [problem.model, *problem.region.samples]
    low = worst(quick.margins({**settings, LOOP_RATE: 1.0 / usual}, shown.wanted, models))
    here = shown.worst_margins
    if max(low.gain / here.gain, low.phase / here.phase) < NOTICEABLE_LOSS:
        return ""
    return (
        f"{LOOP_RATE} is {1.0 / period:.0f} Hz, and its delay lowers the margins. At the default of {1.0 / usual:.0f} "
        f"Hz the gain margin would be {low.gain:.2f} instead of {here.gain:.2f}, and the phase margin "
        f"{math.degrees(low.phase):.0f} instead of {math.degrees(here.phase):.0f} deg"
    )


def _on_the_specification(problem: DesignProblem, axis: Axis, shown: GainCandidate, is_refined: bool) -> Iterator[str]:
    if shown.objections:
        yield (
            "the gains do not meet the specification, but are the best that the design found inside the "
            f"{_ranges(problem)} ranges. Not met: {'; '.join(shown.objections)}"
        )
    if is_refined:
        settled = settling_time(shown.wanted.kind, shown.wanted.omega_0)
        yield (
            "the gains minimise the predicted tracking error (ITAE), with actuator saturation. The search started from "
            "the best of several sets: the present gains, gains spread over the ranges, and gains matched to a "
            f"{shown.wanted.kind.capitalize()} step settling in {settled:.1f} s. Set a settling time to get "
            "the matched gains"
        )
        return
    use, velocity = problem.demand(problem.model, shown.wanted)
    fastest, error = problem.law.velocity_limit(problem.settings, problem.spec.speed), _deviation(shown)
    if use > 1.0:
        yield f"the required step needs {use:.0%} of the actuator, so the response will be slower than required"
    elif velocity > fastest:
        yield (
            "the required step needs more velocity or acceleration than the autopilot allows, so the response will be "
            "slower than required"
        )
    elif error > POOR_MATCH:
        yield f"the predicted step deviates from its reference by {error:.0%} of the step (rms)"


def _on_the_ranges(problem: DesignProblem, axis: Axis, shown: GainCandidate, wider: GainCandidate) -> str:
    """Return a note on how much the documented ranges cost, and how to try gains outside them."""
    moved = [g.parameter for g in (*problem.gains, *problem.late) if not g.low <= wider.settings[g.parameter] <= g.high]
    gains = ", ".join(f"{name} {axis.names.own_value(name, wider.settings[name]):.3g}" for name in moved)
    lower = 1.0 - wider.prediction.metrics.itae / shown.prediction.metrics.itae
    return (
        "ArduPilot's documented ranges limit these gains. The ranges were chosen for cars and copters. Beyond them, "
        f"the predicted tracking error is {lower:.0%} lower with the same margins ({gains}). To allow such gains, use "
        "--beyond-ranges"
    )


BESIDE: Mapping[str, str] = {
    "rover-yaw": "turn rates (AUTO, ACRO)",
    "sub-yaw": "turn rates (yaw stick)",
    "rover-heading": "headings (GUIDED)",
    "sub-heading": "headings (ALT_HOLD)",
}
"""Law of another mode -> what the law controls, and the names of the modes that use it."""


def other_mode_notes(beside: Beside) -> Iterator[str]:
    """Yield a sentence with the prediction for the other mode that uses the same gains."""
    yield (
        f"{BESIDE[beside.law]}: predicted tracking shortfall {beside.after:.1%} (time-weighted mean), "
        f"{beside.before:.1%} with the present gains"
        + (f". This increases the error of the main step by {beside.given_up:.0%}" if beside.given_up > 0.005 else "")
    )


def _deviation(shown: GainCandidate) -> float:
    """Return the rms deviation of the predicted step from its reference, relative to the step."""
    error = shown.prediction.position - shown.prediction.wanted
    return float(np.sqrt(np.mean(error**2))) / abs(float(shown.prediction.target[-1]))


SPEEDS = (0.5, 2.0)
"""Speeds at which margins are checked, relative to the speed of the experiment. Project choice."""
ENOUGH_GAIN, ENOUGH_PHASE = 1.6, math.radians(25.0)
"""Gain margin [ratio] and phase margin [rad] below which the note on other speeds is a warning. Project choice."""
MOST = 100.0


def at_speed(model: SingleDof, share: float) -> SingleDof:
    """Return *model*, whose input is a fraction of full rudder, scaled to *share* times the speed of its
    identification.
    """
    turn = 1.0 / share
    return replace(
        model, alpha=model.alpha * turn**2, beta=model.beta * turn, beta_quadratic=model.beta_quadratic * turn**2
    )


def on_other_speeds(problem: DesignProblem, settings: Settings, wanted: ReferenceModel) -> Iterator[str]:
    """Yield a sentence with the margins at half and twice the speed, or nothing if steering does not depend on
    speed.
    """
    speed = problem.spec.speed
    steered_by_thrust = settings.get("MOT_VEC_ANGLEMAX", 0.0) > 0.0 or settings.get(SKID, 0.0) > 0.0
    if speed is None or steered_by_thrust:
        return
    margin_words, thin = [], False
    for share in SPEEDS:
        there = replace(problem, spec=replace(problem.spec, speed=share * speed))
        margins = there.margins(settings, wanted, [at_speed(problem.model, share)])[0]
        margin_words.append(f"at {share * speed:.2f} m/s {_remaining(margins)}")
        thin = thin or not margins.stable or margins.gain < ENOUGH_GAIN or margins.phase < ENOUGH_PHASE
    yield (
        f"margins at other speeds: {'; '.join(margin_words)}. They assume a turn rate per rudder proportional to "
        "speed and a time constant inversely proportional to it"
        + (". Tune at those speeds before using these gains there" if thin else "")
    )


def _remaining(margins: Margins) -> str:
    if not margins.stable:
        return "unstable"
    gain = f"{margins.gain:.1f}" if margins.gain <= MOST else f"more than {MOST:.0f}"
    return f"a gain margin of {gain} (factor) and a phase margin of {math.degrees(margins.phase):.0f} deg"
