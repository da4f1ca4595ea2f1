"""Prediction of what a tune or an experiment will do and need, before anything moves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from gcs_autotune.craft import Observation
from gcs_autotune.errors import PreconditionFailed
from gcs_autotune.manoeuvres import Envelope, Manoeuvre, PlantState
from gcs_autotune.workflow.accompanying_step import flies_accompanying_step
from gcs_autotune.workflow.announcement import ROV_ROOM, deepest
from gcs_autotune.workflow.context import TuneContext
from gcs_autotune.workflow.excursion import (
    NO_LIMITS,
    Ahead,
    Excursion,
    VisitPreview,
    least_distance,
    too_small,
    worst_of,
)
from gcs_autotune.workflow.experiments import STEP_AHEAD, SWING_AHEAD, dive_for, dive_words
from gcs_autotune.workflow.itinerary import Itinerary, Leg, Pace, legs_of_tune
from gcs_autotune.workflow.nominal_plant import assumed_crafts, assumed_plant
from gcs_autotune.workflow.preflight import sign_check_for
from gcs_autotune.workflow.proof import SHARE

__all__ = ["excursion_of", "movements_of", "tune_legs"]


def excursion_of(context: TuneContext, now: Observation, itineraries: Sequence[Itinerary]) -> Excursion:
    """Return the excursion of a tune or an experiment, for the assumed craft that needs most and the longest of
    *itineraries*.

    Raises
    ------
    PreconditionFailed
        The run would exceed a limit that the user set; the message states the nearest sufficient value.
    """
    settings, craft = context.settings, context.craft
    envelope = replace(settings.envelope, cruise=context.speed)
    if craft.firmware.needs_way:
        context.log.say("computing the space and time needed")
        whole = _under_way(context, envelope, itineraries)
        if envelope.distance is not None and whole.distance > envelope.distance:
            most = replace(envelope, distance=None).distance_limit
            least = least_distance(
                lambda metres: _under_way(context, replace(envelope, distance=metres), itineraries).distance > metres,
                most := 2.0 * max(most, envelope.distance),
            )
            least = most if math.isnan(least) else least
            raise PreconditionFailed(too_small(_what(context), "max-distance", envelope.distance, least, "m"))
    else:
        depth_max = deepest(context.axis.dof, settings, now)
        angle, depth = _stepped(context)
        seconds = itineraries[0].seconds
        whole = Excursion(seconds, ROV_ROOM, depth_max=depth_max, heading_excursion=angle, depth_excursion=depth)
    rest = replace(whole, distance=0.0 if craft.firmware.needs_way else ROV_ROOM, usual=None)  # distance: see above
    why = rest.beyond(envelope, _what(context))
    if why:
        raise PreconditionFailed(why)
    return whole


def _stepped(context: TuneContext) -> tuple[float, float]:
    """Return how far a step of the settings moves from the start: heading [rad] and depth [m]."""
    step, kind = context.settings.step, context.axis.kind
    size = 0.0 if step is None or kind.controls_velocity else abs(step)
    return (size, 0.0) if kind.angular else (0.0, size)


def _what(context: TuneContext) -> str:
    return f"this run in {context.axis.name}"


def _under_way(context: TuneContext, envelope: Envelope, itineraries: Sequence[Itinerary]) -> Excursion:
    """Return the excursion of a boat's stages inside *envelope*: the greatest one, and that of the first of
    *itineraries*."""
    craft, settings, axis = context.craft, context.settings, context.axis
    seen = []
    for itinerary in itineraries:
        for like in assumed_crafts(craft.steered_by):
            plant = assumed_plant(craft.firmware, context.present, context.throttle, context.speed, like)
            check = sign_check_for(axis.dof, craft, context.throttle, axis.needs_speed, settings.relay_output)
            limits = replace(NO_LIMITS, distance=envelope.distance_limit, cruise=envelope.cruise)
            visit = VisitPreview(plant, limits, PlantState(), under_way=True)
            _fly_legs(visit, check, itinerary.legs, context.throttle, context.speed)
            seen.append(visit.excursion())
    return replace(worst_of(seen), usual=worst_of(seen[: len(seen) // len(itineraries)]))


def tune_legs(context: TuneContext, pace: Pace, now: Observation) -> tuple[Leg, ...]:
    """Return the stages of a tune that are flown, with durations from *pace*; not those of which an earlier run has
    the record."""
    dof, firmware = context.axis.dof, context.craft.firmware
    given = context.given is not None or context.settings.gains is not None
    dives = dive_for(dof, firmware, now) is not None
    moving = context.law.controls_velocity
    beside = flies_accompanying_step(context) and context.settings.gains is None
    legs = legs_of_tune(context.settings, dof, pace, moving=moving, given=given, dives=dives, beside=beside)
    return tuple(leg for leg in legs if not context.earlier.has(leg.trial))


def _fly_legs(visit: VisitPreview, check: Manoeuvre, legs: Sequence[Leg], throttle: float, speed: float) -> None:
    """Simulate the *check* and the *legs* of a tune or an experiment of a boat.

    A step or an oscillation about the course is simulated straight ahead at *speed* [m/s]: this needs the most space.
    """
    visit.fly(check, legs[0].stage)
    for leg in legs[1:]:
        is_step = leg.kind in STEPS
        ahead = math.inf if leg.before > 0.0 else STEP_AHEAD if is_step else SWING_AHEAD
        visit.turn_around(throttle, ahead, last=is_step)
        least = LEAST_STEP if is_step else TOLD * leg.seconds
        visit.fly(Ahead(speed, leg.seconds, leg.stage, least), leg.stage)


STEPS = ("step", "turn rate")
"""Kinds of stages in which a step proves gains."""
LEAST_STEP, TOLD = 20.0, 0.35
"""Time [s] of a step, and fraction of an oscillation's duration, after which a stage may end at the limit of the space.
Project choice.
"""


def movements_of(context: TuneContext, now: Observation) -> tuple[str, str]:
    """Return what moves during a tune as a sentence, and in one line of a terminal without turns and their limits."""
    axis, d, speed = context.axis, context.axis.kind, context.speed
    step = context.settings.step if context.settings.step is not None else d.step
    shown = f"{math.degrees(step):.0f} deg " if d.angular else f"{step:g} m "
    shown = "" if context.law.controls_velocity else shown
    turning = ", turning around if space requires" if speed else ""
    down, briefly = dive_words(axis.dof, context.craft.firmware, now)
    signs, by_throttle = d.excitation.check, d.excitation.by_throttle
    kind = "throttle steps" if by_throttle else f"relay oscillations about the present {d.excitation.title}"
    identifies = context.given is None and context.settings.gains is None
    beside = flies_accompanying_step(context) and context.settings.gains is None
    most = SHARE * context.settings.envelope.heading_excursion
    turns = (beside or d.stepped == "r") and math.isfinite(most)
    sentence = (
        f"{signs}{down}{shown}steps in {axis.name}{', steps in turn rate' * beside}"
        + f" (turning by up to {math.degrees(most):.0f} deg)" * turns
        + f" and {kind}" * identifies
        + f" under way at {speed:.1f} m/s{turning}" * bool(axis.needs_speed)
    )
    brief = (
        f"{briefly}pulses, {shown}{axis.name} steps{', turn-rate steps' * beside}"
        + f", {'throttle steps' if by_throttle else 'oscillations'}" * identifies
        + f" at {speed:.1f} m/s" * bool(axis.needs_speed)
    )
    return sentence, brief
