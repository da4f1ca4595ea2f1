"""What ``tune`` says it is going to do, before anything is armed, moved or written; and whether it may."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from gcs_autotune.axes import axis_kind, excitation_of, position_axis
from gcs_autotune.craft import Observation
from gcs_autotune.errors import OperatorStopped, PreconditionFailed
from gcs_autotune.manoeuvres import FAR_OUT, NEARLY, Envelope, Manoeuvre, PlantState
from gcs_autotune.workflow.beside import flies_beside
from gcs_autotune.workflow.connection import arming
from gcs_autotune.workflow.context import TuneContext
from gcs_autotune.workflow.excursion import (
    LATE,
    NO_LIMITS,
    Ahead,
    Excursion,
    VisitPreview,
    least_distance,
    overhead,
    too_small,
    worst_of,
)
from gcs_autotune.workflow.experiments import STEP_AHEAD, SWING_AHEAD, WORKING_DEPTH, dive_for
from gcs_autotune.workflow.itinerary import Itinerary, Leg, Pace, legs_of_tune, pace_of
from gcs_autotune.workflow.nominal_plant import assumed_crafts, assumed_plant
from gcs_autotune.workflow.preflight import sign_check_for
from gcs_autotune.workflow.settings import SETTLED, CommonSettings, TuneSettings

__all__ = ["after_a_silence", "announce", "battery", "exactly", "how_long", "room", "whole_of"]

ROV_ROOM, BELOW = 2.0, 1.5
"""Chosen [m]: free water around an ROV that stays on the spot; below the deepest it is sent to."""


def announce(context: TuneContext) -> None:
    """Say what will be done and ask for leave.

    Raises
    ------
    PreconditionFailed
        A limit that was set cannot be kept.
    OperatorStopped
        The answer was no.
    """
    now, firmware, axis = context.craft.observe(), context.craft.firmware, context.axis
    gains = ", ".join(axis.names.own(g.parameter) for g in axis.gains)
    pace, slow = (
        pace_of(under_way=firmware.needs_way, skid=context.craft.skid, restless=restless) for restless in (False, True)
    )
    itinerary = context.log.itinerary = Itinerary(_legs(context, pace, now), pace.turn)
    patient = Itinerary(_legs(replace(context, settings=replace(context.settings, stop_rule=SETTLED)), slow, now))
    whole = excursion_of(context, now, (itinerary, patient) if context.settings.stop_rule != SETTLED else (itinerary,))
    context.log.announce(
        (
            arming(context.craft, now),
            f"use the modes {firmware.hold_mode} and {firmware.manual_mode}, and return to {now.mode} at the end",
            f"move: {_movements(context, now)}",
            room(context.axis.dof, context.speed, context.settings, now, whole),
            how_long(itinerary, patient.seconds),
            battery(now, context.settings.envelope, itinerary.seconds),
            *after_a_silence(context.settings, now),
            "write no parameter (dry run)"
            if context.settings.dry_run
            else f"write some of {gains}, after asking again, and restore the old values unless the new ones prove "
            f"better",
        )
    )
    if not context.agrees("Go ahead?"):
        raise OperatorStopped("not started: the answer was no. Nothing was armed, moved or written")


def excursion_of(context: TuneContext, now: Observation, itineraries: Sequence[Itinerary]) -> Excursion:
    """Return what a tune or an experiment takes, of the worst craft and of the longest of *itineraries*.

    Raises
    ------
    PreconditionFailed
        A limit that was set cannot be kept; the message has the nearest number that can.
    """
    settings, craft = context.settings, context.craft
    envelope = replace(settings.envelope, cruise=context.speed)
    if craft.firmware.needs_way:
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
        deepest = _deepest(context.axis.dof, settings, now)
        angle, depth = _stepped(context)
        seconds = itineraries[0].seconds
        whole = Excursion(seconds, ROV_ROOM, depth_max=deepest, heading_excursion=angle, depth_excursion=depth)
    rest = replace(whole, distance=0.0 if craft.firmware.needs_way else ROV_ROOM, usual=None)  # distance: see above
    why = rest.beyond(envelope, _what(context))
    if why:
        raise PreconditionFailed(why)
    return whole


def _stepped(context: TuneContext) -> tuple[float, float]:
    """Return how far a step that was given goes from where the craft began: heading [rad] and depth [m]."""
    step, dof = context.settings.step, context.axis.dof
    size = 0.0 if step is None or axis_kind(context.axis.name).stepped not in ("psi", "z") else abs(step)
    return (size, 0.0) if dof == "yaw" else (0.0, size)


def _what(context: TuneContext) -> str:
    return f"this run in {context.axis.name}"


def _under_way(context: TuneContext, envelope: Envelope, itineraries: Sequence[Itinerary]) -> Excursion:
    """Return what the stages of a boat take inside *envelope*: at most, and as the first of *itineraries* goes."""
    craft, settings, axis = context.craft, context.settings, context.axis
    seen = []
    for itinerary in itineraries:
        for like in assumed_crafts(under_way=True, skid=craft.skid):
            paper = assumed_plant(craft.firmware, context.present, context.throttle, context.speed, like)
            check = sign_check_for(
                axis.dof, craft.firmware, craft.servos, context.throttle, axis.needs_speed, settings.relay_output
            )
            limits = replace(NO_LIMITS, distance=envelope.distance_limit, cruise=envelope.cruise)
            visit = VisitPreview(paper, limits, PlantState(), under_way=True)
            _fly_legs(visit, check, itinerary.legs, context.throttle, context.speed)
            seen.append(visit.excursion())
    return replace(worst_of(seen), usual=worst_of(seen[: len(seen) // len(itineraries)]))


def _legs(context: TuneContext, pace: Pace, now: Observation) -> tuple[Leg, ...]:
    dof, firmware = context.axis.dof, context.craft.firmware
    given = context.given is not None or context.settings.gains is not None
    dives = dive_for(dof, firmware, now) is not None
    moving = context.law.controls_velocity
    way = firmware.needs_way
    beside = flies_beside(context) and context.settings.gains is None
    return legs_of_tune(
        context.settings, dof, pace, under_way=way, moving=moving, given=given, dives=dives, beside=beside
    )


def _fly_legs(visit: VisitPreview, check: Manoeuvre, legs: Sequence[Leg], throttle: float, speed: float) -> None:
    """Fly the *check* and the *legs* of a tune or an experiment of a boat on paper.

    A step or an oscillation about the course is flown straight ahead at *speed* [m/s]: that takes most water.
    """
    visit.fly(check, legs[0].stage)
    for leg in legs[1:]:
        is_step = leg.kind in STEPS
        ahead = math.inf if leg.before > 0.0 else STEP_AHEAD if is_step else SWING_AHEAD
        visit.turn_around(throttle, ahead, last=is_step)
        least = LEAST_STEP if is_step else TOLD * leg.seconds
        visit.fly(Ahead(speed, leg.seconds, leg.stage, least), leg.stage)


STEPS = ("step", "turn rate")
"""Kinds of legs that are a proof."""
LEAST_STEP, TOLD = 20.0, 0.35
"""Chosen: seconds of a step, and share of an oscillation, after which it may end where the space ends."""


def room(dof: str, speed: float, settings: TuneSettings, now: Observation, whole: Excursion) -> str:
    """Return how much free water it takes, for a boat under way at *speed* [m/s] or a craft about where it is."""
    if speed:
        envelope = replace(settings.envelope, cruise=speed)
        metres, usual = whole.metres(envelope), (whole.usual or whole).needs
        if settings.stop_rule != SETTLED and not excitation_of(dof).by_throttle:
            # short of turning around a boat may still fly an oscillation and a step, whatever its stages take on paper
            limit = envelope.distance_limit
            metres = max(metres, min(FAR_OUT * limit + (SWING_AHEAD + STEP_AHEAD) * speed, NEARLY * limit))
        usually = f", usually about {usual:.0f} m" if usual < metres else ""
        turns = FAR_OUT * envelope.distance_limit
        between = f". Between stages it turns around if it is more than {turns:.0f} m away" if turns < metres else ""
        between = ". It turns around before each stage" if settings.stop_rule == SETTLED else between
        return f"need up to {metres:.0f} m from the start{usually}{between}. A smaller --max-distance needs less"
    below = ""
    if excitation_of(dof).below_surface:
        below = f", and {_deepest(dof, settings, now):.0f} m of depth"
    return f"need about {ROV_ROOM:g} m of free water around the vehicle{below}"


def _deepest(dof: str, settings: TuneSettings, now: Observation) -> float:
    """Return the depth [m] that an ROV may come to; 0 where its depth is not stepped."""
    if not excitation_of(dof).below_surface:
        return 0.0
    step = abs(settings.step) if settings.step is not None else position_axis(dof).step
    return (max(now.z, WORKING_DEPTH) if math.isfinite(now.z) else WORKING_DEPTH) + step + BELOW


def whole_of(excursion: Excursion, envelope: Envelope, source: str = "") -> str:
    """Return how much water and time a whole visit takes, with its stages; *source*: of the numbers, in words."""
    metres, usual, moves = excursion.metres(envelope), excursion.usual, excursion.distance >= 1.0
    deep = f", down to {excursion.depth_max:.1f} m of depth" if excursion.depth_excursion >= 0.1 else ""
    ends = " (the run ends there: --max-distance)" if excursion.needs > metres else ""
    far = f"up to {metres:.0f} m from the start{ends}" if moves else "only the water around the craft"
    longest = exactly(LATE * excursion.seconds)
    if usual is None:
        told = ", ".join(f"{name} {exactly(seconds)}" for name, seconds in excursion.stages)
        return f"need {far}{deep}, and up to {longest}: {told}" + (f"; predicted from {source}" if source else "")
    near = f"usually about {min(usual.needs, metres):.0f} m from the start{deep} and" if moves else f"{far}, usually"
    most = f"up to {metres:.0f} m{ends} and " if moves else ""
    by = f" (predicted from {source})" if source else ""
    return f"need {near} {exactly(LATE * usual.seconds)}{by}. A poorly damped loop needs {most}up to {longest}"


def exactly(seconds: float) -> str:
    """Return seconds in whole tens, up, as minutes and seconds; in fives below a minute."""
    step = 5 if seconds < 60.0 else 10
    minutes, rest = divmod(step * math.ceil(seconds / step), 60)
    return " ".join(([f"{minutes} min"] if minutes else []) + ([f"{rest} s"] if rest or not minutes else []))


def how_long(itinerary: Itinerary, most: float = 0.0) -> str:
    """Return how long it takes of the vehicle's time, stage by stage; *most* [s] where nothing ends early."""
    beside = overhead(len(itinerary.legs))
    usual = _minutes(itinerary.seconds + beside)
    longest = _minutes(max(most, itinerary.seconds) + beside)
    up_to = "" if longest == usual else f", up to {longest} if it does not settle"
    return (
        f"take about {usual} of the vehicle's time{up_to}: {itinerary.told()}; estimates of similar "
        "craft, updated after the first stage of each kind"
    )


def battery(now: Observation, envelope: Envelope, seconds: float) -> str:
    """Return what is known of the battery, and what the time takes of one, with the assumption that is made."""
    share = math.ceil(20.0 * seconds / 3600.0) * 5
    draws = (
        f"about {share} % of a battery that lasts an hour at this power (assumed; the vehicle does not report its draw)"
    )
    known = []
    if math.isfinite(now.battery_remaining):
        known.append(f"{100.0 * now.battery_remaining:.0f} % now, limit {100.0 * envelope.battery_remaining:.0f} %")
    if math.isfinite(now.battery_voltage):
        ends = f", limit {envelope.battery_voltage:g} V" if envelope.battery_voltage > 0.0 else ""
        known.append(f"{now.battery_voltage:.1f} V now{ends}")
    if not known:
        return f"use {draws}; the vehicle does not report its battery, so it is not monitored"
    return f"use {draws} ({', '.join(known)})"


def after_a_silence(settings: CommonSettings, now: Observation) -> tuple[str, ...]:
    """Return what is done when the vehicle was not heard for a while; nothing where the first silence ends the run."""
    if settings.patience <= 0.0:
        return ()
    again = "" if now.armed else ", and arm again, after asking, if it was disarmed"
    return (f"continue after a silence of up to {settings.patience:g} s (--patience){again}",)


def _minutes(seconds: float) -> str:
    tens = 10 * math.ceil(seconds / 10.0)
    return f"{tens} s" if tens < 2 * 60 else f"{math.ceil(seconds / 60.0)} min"


def _movements(context: TuneContext, now: Observation) -> str:
    axis, d, speed = context.axis, axis_kind(context.axis.name), context.speed
    step = context.settings.step if context.settings.step is not None else d.step
    shown = f"{math.degrees(step):.0f} deg " if d.angular else f"{step:g} m "
    shown = "" if context.law.controls_velocity else shown
    turning = ", turning around if space requires" if speed else ""
    under_way = f" under way at {speed:.1f} m/s{turning}" if axis.needs_speed else ""
    dive = dive_for(axis.dof, context.craft.firmware, now)
    down = f"dive to {dive.settings['depth']:g} m, then " if dive is not None else ""
    signs = d.excitation.check
    kind = "throttle steps" if d.excitation.by_throttle else f"oscillations about the present {d.excitation.title}"
    swings = f" and {kind}" if context.given is None and context.settings.gains is None else ""
    beside = ", steps in turn rate" if flies_beside(context) and context.settings.gains is None else ""
    return f"{signs}{down}{shown}steps in {axis.name}{beside}{swings}{under_way}"
