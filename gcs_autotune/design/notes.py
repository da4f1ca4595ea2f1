"""What a user should read beside the numbers of a proposal.

Among it what is left of the margins when a boat goes faster or slower than it was identified at: a ship's turning
scales with its speed (Nomoto's K' and T' are constant: K = K' U/L, T = T' L/U), ArduRover divides its steering by speed
above MOT_SPD_SCA_BASE. The two cancel in the gain, not in the time constant.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from gcs_autotune.design.hunting import LONG, Hunting
from gcs_autotune.design.laws import SKID, Settings
from gcs_autotune.design.matching import DesignProblem
from gcs_autotune.design.reference_model import settling_time
from gcs_autotune.design.result import Margins, ReferenceModel
from gcs_autotune.design.selection import GainCandidate
from gcs_autotune.design.verdict import is_better
from gcs_autotune.firmware import Axis
from gcs_autotune.models import SingleDof
from gcs_autotune.sname import DOFS

__all__ = ["at_speed", "notes_on", "on_other_speeds", "said"]

LONG_DELAY = 0.05
"""A delay [s] beyond which it matters where it lies."""
TINY = {d.name: math.radians(0.05) if d.angular else 0.005 for d in DOFS.values()}
"""Errors [rad or m] not worth a word."""
POOR_MATCH = 0.08
"""Chosen: an rms distance from the wanted step, as a fraction of it, that is worth a word."""
NEAR_LIMIT = 0.01
"""Chosen: gains so near the end of their range, as a share of it, are held by it."""
ROUNDING = 1e-6
"""A vehicle keeps its parameters in float32; so far outside a range (relative to it) is still on its limit."""


def notes_on(
    problem: DesignProblem, axis: Axis, before: GainCandidate, shown: GainCandidate, changed: bool, is_refined: bool
) -> Iterator[str]:
    """Yield sentences: where the gains hold, what is odd about the present ones, what the wish met."""
    yield from problem.law.notes(problem.model, shown.settings, problem.spec.speed)
    if axis.steers_by_way:
        yield from on_other_speeds(problem, shown.settings, shown.wanted)
    yield from _on_the_present(problem, axis)
    yield from _on_the_change(before, shown, changed)
    yield from _on_the_model(problem)
    yield from _on_the_wish(problem, axis, shown, is_refined and changed)


def said(before: Hunting, after: Hunting, dof: str) -> Iterator[str]:
    """Yield what is left going on after a small step, with the present gains and with those proposed."""
    if max(h.amplitude for h in (before, after)) == 0.0 and max(abs(h.offset) for h in (before, after)) < TINY[dof]:
        return
    yield f"left alone after a small step: {_left(before, dof)} with the present gains, {_left(after, dof)} with these"


def _left(h: Hunting, dof: str) -> str:
    def size(x: float) -> str:
        return f"{math.degrees(x):.2g} deg" if DOFS[dof].angular else f"{x:.2g} m"

    if h.swings:
        return f"it hunts {size(h.amplitude)} either way every {h.period:.0f} s"
    if h.amplitude > 0.0:
        return f"it is still creeping after {LONG:.0f} s, {size(abs(h.offset) + h.amplitude)} off"
    return f"it stands {size(abs(h.offset))} off" if abs(h.offset) > TINY[dof] else "it comes to rest"


def _on_the_present(problem: DesignProblem, axis: Axis) -> Iterator[str]:
    for gain in axis.gains:
        old, slack = problem.settings[gain.parameter], ROUNDING * (gain.high - gain.low)
        if not gain.low - slack <= old <= gain.high + slack:
            value, low, high = (axis.names.own_value(gain.parameter, x) for x in (old, gain.low, gain.high))
            yield f"{gain.parameter} = {value:g} on the craft is outside its range {low:g}..{high:g}"


def _on_the_change(before: GainCandidate, shown: GainCandidate, changed: bool) -> Iterator[str]:
    if not changed:
        yield "no gains found inside the documented ranges do better than the present ones: nothing to change"
    elif not before.worst_margins.stable:
        yield "with the present gains the loop is, or may be, unstable on the identified craft"
    elif not is_better(before.prediction.metrics, shown.prediction.metrics, before.free_overshoot).better:
        old, new = (math.degrees(c.worst_margins.phase) for c in (before, shown))
        yield (
            "the predicted step is not better than with the present gains; what changes is the reserve: worst "
            f"phase margin {old:.0f} -> {new:.0f} deg"
        )


def _on_the_model(problem: DesignProblem) -> Iterator[str]:
    if problem.model.delay > LONG_DELAY:
        yield (
            f"the identified delay of {problem.model.delay:.2f} s is taken to lie between autopilot and force; if "
            "it is in the telemetry link, give it as link delay: the loop may then be faster"
        )
    if not problem.region.samples:
        yield "the model came without uncertainty, so the worst margins are those of the model itself"


def _on_the_wish(problem: DesignProblem, axis: Axis, shown: GainCandidate, is_refined: bool) -> Iterator[str]:
    for objection in shown.objections:
        yield f"less than wished for, but the best the documented ranges allow: {objection}"
    if is_refined:
        settled = settling_time(shown.wanted.kind, shown.wanted.omega_0)
        yield (
            f"the gains began at those matched to a {shown.wanted.kind} step settling in {settled:.1f} s, or at the "
            "present ones, and were then chosen for the least predicted error over time, letting the actuator "
            "saturate; give a settling time to have the matched ones"
        )
        yield from _on_the_ranges(problem, axis, shown)
        return
    use, velocity = problem.demand(problem.model, shown.wanted)
    if use > 1.0 or velocity > problem.law.velocity_limit(problem.settings, problem.spec.speed):
        yield (
            f"the wanted step needs {use:.0%} of the actuator: the craft cannot follow it exactly and "
            "will be slower than asked for"
        )
    elif _lags(shown):
        yield "the documented ranges keep the step from following the wanted one more closely"


def _on_the_ranges(problem: DesignProblem, axis: Axis, shown: GainCandidate) -> Iterator[str]:
    """Say which documented ranges hold the gains, and what following the wanted step would take without them."""
    exact = problem.law.starts(problem.model, shown.wanted, problem.settings, problem.speed)[0]
    held, takes = [], []
    for g in problem.gains:
        value, near = shown.settings[g.parameter], NEAR_LIMIT * (g.high - g.low)
        end = g.high if value >= g.high - near else g.low if value <= g.low + near else None
        if end is not None and (exact[g.parameter] - end) * (1.0 if end == g.high else -1.0) > near:
            limit, wish = (axis.names.own_value(g.parameter, x) for x in (end, exact[g.parameter]))
            held.append(f"{g.parameter} ({'most' if end == g.high else 'least'} {limit:.3g})")
            takes.append(f"{g.parameter} {wish:.2g}")
    if held:
        settled = settling_time(shown.wanted.kind, shown.wanted.omega_0)
        yield (
            f"documented ranges hold back {' and '.join(held)}: a {shown.wanted.kind} step settling in {settled:.1f} s "
            f"would take {', '.join(takes)}. ArduPilot does take such values; this tool never writes them"
        )


def _lags(shown: GainCandidate) -> bool:
    error = shown.prediction.position - shown.prediction.wanted
    return float(np.sqrt(np.mean(error**2))) > POOR_MATCH * abs(float(shown.prediction.target[-1]))


SPEEDS = (0.5, 2.0)
"""Shares of the experiment's speed that are looked at."""
ENOUGH_GAIN, ENOUGH_PHASE = 1.6, math.radians(25.0)
"""Chosen: below these the sentence is a warning."""
MOST = 100.0


def at_speed(model: SingleDof, share: float) -> SingleDof:
    """Return *model* (input a fraction of full rudder) at *share* times the speed it was identified at."""
    turn = 1.0 / share
    return replace(
        model, alpha=model.alpha * turn**2, beta=model.beta * turn, beta_quadratic=model.beta_quadratic * turn**2
    )


def on_other_speeds(problem: DesignProblem, settings: Settings, wanted: ReferenceModel) -> Iterator[str]:
    """Yield a sentence with the margins at half and twice the speed; nothing for a craft that does not steer by way."""
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
        f"if it turns as ships do (rate per rudder in proportion to speed, time constant inversely) there remain at "
        f"{' and at '.join(told)}" + ("; do not go there with these gains before tuning there" if thin else "")
    )


def _remaining(margins: Margins) -> str:
    if not margins.stable:
        return "no margin at all: the loop is unstable"
    gain = f"{margins.gain:.1f}" if margins.gain <= MOST else f"more than {MOST:.0f}"
    return f"a factor of {gain} in gain and {math.degrees(margins.phase):.0f} deg of phase"
