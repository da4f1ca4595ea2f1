"""Notes for the user beside the numbers of a proposal.

One note gives the margins at speeds other than that of the identification. A ship's turning scales with its speed
(Nomoto's K' and T' are constant: K = K' U/L, T = T' L/U). ArduRover divides its steering by speed above
MOT_SPD_SCA_BASE. The two cancel in the gain, but not in the time constant.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from gcs_autotune.control import ReferenceModel, settling_time
from gcs_autotune.design.hunting import LONG
from gcs_autotune.design.laws import SKID, Settings
from gcs_autotune.design.matching import DesignProblem
from gcs_autotune.design.result import Beside, Hunting, Margins
from gcs_autotune.design.selection import GainCandidate
from gcs_autotune.design.verdict import is_better
from gcs_autotune.firmware import Axis
from gcs_autotune.models import SingleDof
from gcs_autotune.sname import DOFS

__all__ = ["NEAR_LIMIT", "at_speed", "notes_on", "on_other_speeds", "other_mode_notes", "said"]

LONG_DELAY = 0.05
"""Delay [s] above which a note explains that its location matters. It is set by hand."""
TINY = {d.name: math.radians(0.05) if d.angular else 0.005 for d in DOFS.values()}
"""Errors [rad or m] below which a note does not mention them."""
POOR_MATCH = 0.08
"""Rms deviation from the reference step, relative to it, above which a note is given. It is set by hand."""
NEAR_LIMIT = 0.01
"""Distance to the end of a range, relative to the range, at which a gain counts as limited. It is set by hand."""
ROUNDING = 1e-6
"""Distance outside a range, relative to it, that counts as on the limit, because a vehicle stores float32."""


def notes_on(
    problem: DesignProblem,
    axis: Axis,
    before: GainCandidate,
    shown: GainCandidate,
    changed: bool,
    is_refined: bool,
    wider: GainCandidate | None = None,
) -> Iterator[str]:
    """Yield notes: validity of the gains, problems of the present ones, limits of the specification.

    wider : better gains outside the documented ranges.
    """
    yield from problem.law.notes(problem.model, shown.settings, problem.spec.speed)
    if axis.steers_by_way:
        yield from on_other_speeds(problem, shown.settings, shown.wanted)
    yield from _on_the_present(problem, axis)
    yield from _on_the_change(before, shown, changed)
    yield from _on_the_model(problem)
    yield from _on_the_specification(problem, axis, shown, is_refined and changed)
    if wider is not None:
        yield _on_the_ranges(problem, axis, shown, wider)


def said(before: Hunting, after: Hunting, dof: str) -> Iterator[str]:
    """Yield sentences on the residual motion after a small step, with the present and the proposed gains."""
    if max(h.amplitude for h in (before, after)) == 0.0 and max(abs(h.offset) for h in (before, after)) < TINY[dof]:
        return
    yield (
        f"after a small step the loop {_left(before, dof)} with the present gains, and {_left(after, dof)} with "
        "the new gains"
    )


def _left(h: Hunting, dof: str) -> str:
    def size(x: float) -> str:
        return f"{math.degrees(x):.2g} deg" if DOFS[dof].angular else f"{x:.2g} m"

    if h.swings:
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


def _on_the_change(before: GainCandidate, shown: GainCandidate, changed: bool) -> Iterator[str]:
    if not changed:
        yield "no gains inside the documented ranges are better than the present ones"
    elif not before.worst_margins.stable:
        yield "with the present gains the loop is unstable for the identified model or part of its 95 % region"
    elif not is_better(before.prediction.metrics, shown.prediction.metrics, before.free_overshoot).better:
        old, new = (math.degrees(c.worst_margins.phase) for c in (before, shown))
        yield (
            "the predicted step is not better than with the present gains. Only the worst phase margin changes, from "
            f"{old:.0f} to {new:.0f} deg"
        )


def _on_the_model(problem: DesignProblem) -> Iterator[str]:
    if problem.model.delay > LONG_DELAY:
        yield (
            f"the design assumes that the identified delay of {problem.model.delay:.2f} s is between autopilot and "
            "force. If it is in the telemetry link, set it as link delay for a faster loop"
        )
    if not problem.region.samples:
        yield "the model has no uncertainty, so the worst margins are those of the model itself"


def _on_the_specification(problem: DesignProblem, axis: Axis, shown: GainCandidate, is_refined: bool) -> Iterator[str]:
    for objection in shown.objections:
        yield (
            "the gains do not meet the specification, but are the best inside the documented ranges. Not met: "
            f"{objection}"
        )
    if is_refined:
        settled = settling_time(shown.wanted.kind, shown.wanted.omega_0)
        yield (
            "the gains minimise the predicted tracking error (ITAE), with actuator saturation. The search started "
            f"from the present gains or from gains matched to a {shown.wanted.kind} step settling in {settled:.1f} "
            "s. Set a settling time to get the matched gains"
        )
        return
    use, velocity = problem.demand(problem.model, shown.wanted)
    if use > 1.0 or velocity > problem.law.velocity_limit(problem.settings, problem.spec.speed):
        yield (f"the required step needs {use:.0%} of the actuator, so the response will be slower than required")
    elif _lags(shown):
        yield "the documented ranges limit how closely the step follows the reference"


def _on_the_ranges(problem: DesignProblem, axis: Axis, shown: GainCandidate, wider: GainCandidate) -> str:
    """Return a note on how much the documented ranges cost, and how to try gains outside them."""
    moved = [g.parameter for g in (*problem.gains, *problem.late) if not g.low <= wider.settings[g.parameter] <= g.high]
    gains = ", ".join(f"{name} {axis.names.own_value(name, wider.settings[name]):.3g}" for name in moved)
    old, new = shown.prediction.metrics.itae, wider.prediction.metrics.itae
    return (
        "ArduPilot's documented ranges limit these gains. The ranges were chosen for cars and copters. Beyond them, "
        f"the predicted tracking error is {new:.3g} instead of {old:.3g} s^2 with the same margins ({gains}). To "
        "allow such gains, use --beyond-ranges"
    )


BESIDE: Mapping[str, str] = {
    "rover-yaw": "turn rates (AUTO, ACRO)",
    "sub-yaw": "turn rates (yaw stick)",
    "rover-heading": "headings (GUIDED)",
    "sub-heading": "headings (ALT_HOLD)",
}
"""Law of another mode -> what it controls, and the names of its modes."""


def other_mode_notes(beside: Beside) -> Iterator[str]:
    """Yield the prediction for the other mode with the same gains."""
    yield (
        f"{BESIDE[beside.law]}: predicted tracking shortfall {beside.after:.1%} (time-weighted mean), "
        f"{beside.before:.1%} with the present gains"
        + (f". This increases the error of the main step by {beside.given_up:.0%}" if beside.given_up > 0.005 else "")
    )


def _lags(shown: GainCandidate) -> bool:
    error = shown.prediction.position - shown.prediction.wanted
    return float(np.sqrt(np.mean(error**2))) > POOR_MATCH * abs(float(shown.prediction.target[-1]))


SPEEDS = (0.5, 2.0)
"""Speeds at which margins are checked, relative to that of the experiment."""
ENOUGH_GAIN, ENOUGH_PHASE = 1.6, math.radians(25.0)
"""Gain and phase margin below which the sentence is a warning."""
MOST = 100.0


def at_speed(model: SingleDof, share: float) -> SingleDof:
    """Return *model* (input a fraction of full rudder) at *share* times the speed of its identification."""
    turn = 1.0 / share
    return replace(
        model, alpha=model.alpha * turn**2, beta=model.beta * turn, beta_quadratic=model.beta_quadratic * turn**2
    )


def on_other_speeds(problem: DesignProblem, settings: Settings, wanted: ReferenceModel) -> Iterator[str]:
    """Yield a sentence with the margins at half and twice the speed; nothing if steering does not depend on speed."""
    speed = problem.spec.speed
    steered_by_thrust = settings.get("MOT_VEC_ANGLEMAX", 0.0) > 0.0 or settings.get(SKID, 0.0) > 0.0
    if speed is None or steered_by_thrust:
        return
    told, thin = [], False
    for share in SPEEDS:
        there = replace(problem, spec=replace(problem.spec, speed=share * speed))
        margins = there.margins(settings, wanted, [at_speed(problem.model, share)])[0]
        told.append(f"{share * speed:.2f} m/s {_remaining(margins)}")
        thin = thin or not margins.stable or margins.gain < ENOUGH_GAIN or margins.phase < ENOUGH_PHASE
    yield (
        f"margins at other speeds: {'; '.join(told)}. They assume a turn rate per rudder proportional to speed and a "
        "time constant inversely proportional to it"
        + (". Tune at those speeds before using these gains there" if thin else "")
    )


def _remaining(margins: Margins) -> str:
    if not margins.stable:
        return "unstable"
    gain = f"{margins.gain:.1f}" if margins.gain <= MOST else f"more than {MOST:.0f}"
    return f"a gain margin of {gain} (factor) and a phase margin of {math.degrees(margins.phase):.0f} deg"
