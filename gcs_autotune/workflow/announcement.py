"""What ``tune`` says it is going to do, before anything is armed, moved or written; and whether it may."""

from __future__ import annotations

import math
from dataclasses import replace

from gcs_autotune.axes import axis_kind, excitation_of, position_axis
from gcs_autotune.craft import Observation
from gcs_autotune.errors import OperatorStopped
from gcs_autotune.manoeuvres import NEARLY, Envelope
from gcs_autotune.workflow.beside import flies_beside
from gcs_autotune.workflow.connection import arming
from gcs_autotune.workflow.context import TuneContext
from gcs_autotune.workflow.experiments import STEP_AHEAD, SWING_AHEAD, WORKING_DEPTH, dive_for
from gcs_autotune.workflow.itinerary import Itinerary, Leg, Pace, legs_of_tune, pace_of
from gcs_autotune.workflow.runner import FAR_OUT
from gcs_autotune.workflow.settings import SETTLED, TuneSettings

__all__ = ["after_a_silence", "announce", "battery", "how_long", "room"]

ROV_ROOM, BELOW = 2.0, 1.5
"""Chosen [m]: free water around an ROV that stays on the spot; below the deepest it is sent to."""


def announce(context: TuneContext) -> None:
    """Say what will be done and ask for leave.

    Raises
    ------
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
    context.log.announce(
        (
            arming(context.craft, now),
            f"use the modes {firmware.hold_mode} and {firmware.manual_mode}, and go back to {now.mode} at the end",
            f"move: {_movements(context, now)}",
            room(context.axis.dof, context.speed, context.settings, now),
            how_long(itinerary, patient.seconds),
            battery(now, context.settings.envelope, itinerary.seconds),
            *after_a_silence(context.settings, now),
            "write no parameter (dry run)"
            if context.settings.dry_run
            else f"write some of {gains}, after asking again; the old values come back unless the new prove better",
        )
    )
    if not context.agrees("Go ahead?"):
        raise OperatorStopped("not started: the answer was no; nothing was armed, moved or written")


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


def room(dof: str, speed: float, settings: TuneSettings, now: Observation) -> str:
    """Return how much free water it takes, for a boat under way at *speed* [m/s] or a craft about where it is."""
    if speed and settings.stop_rule == SETTLED:
        return f"need about {100.0 * speed:.0f} m of free water around"
    if speed:
        limit = replace(settings.envelope, cruise=speed).distance_limit
        reach = min(FAR_OUT * limit + (SWING_AHEAD + STEP_AHEAD) * speed, NEARLY * limit)
        return (
            f"need up to {reach:.0f} m of free water around: it turns about once it is {FAR_OUT * limit:.0f} m away, "
            "sooner with a smaller --max-distance"
        )
    below = ""
    if excitation_of(dof).below_surface:
        step = abs(settings.step) if settings.step is not None else position_axis(dof).step
        start = max(now.z, WORKING_DEPTH) if math.isfinite(now.z) else WORKING_DEPTH
        below = f", and {start + step + BELOW:.0f} m of depth"
    return f"need about {ROV_ROOM:g} m of free water around{below}"


def how_long(itinerary: Itinerary, most: float = 0.0) -> str:
    """Return how long it takes of the vehicle's time, stage by stage; *most* [s] where nothing ends early."""
    usual = _minutes(itinerary.seconds)
    longest = _minutes(max(most, itinerary.seconds))
    up_to = "" if longest == usual else f", up to {longest} where it comes to no rest"
    return (
        f"take about {usual} of the vehicle's time{up_to}: {itinerary.told()}; estimates from craft "
        "that steer alike, mended as the first stage of each kind is flown"
    )


def battery(now: Observation, envelope: Envelope, seconds: float) -> str:
    """Return what is known of the battery, and what the time takes of one, with the assumption that is made."""
    share = math.ceil(20.0 * seconds / 3600.0) * 5
    draws = f"about {share} % of one that lasts an hour at this power (assumed: the vehicle does not tell its draw)"
    known = []
    if math.isfinite(now.battery_remaining):
        known.append(
            f"{100.0 * now.battery_remaining:.0f} % now, ended below {100.0 * envelope.battery_remaining:.0f} %"
        )
    if math.isfinite(now.battery_voltage):
        ends = f", ended below {envelope.battery_voltage:g} V" if envelope.battery_voltage > 0.0 else ""
        known.append(f"{now.battery_voltage:.1f} V now{ends}")
    if not known:
        return f"draw on the battery, {draws}; the vehicle tells nothing of it, so it is not guarded"
    return f"draw on the battery ({', '.join(known)}), {draws}"


def after_a_silence(settings: TuneSettings, now: Observation) -> tuple[str, ...]:
    """Return what is done when the vehicle was not heard for a while; nothing where the first silence ends the run."""
    if settings.patience <= 0.0:
        return ()
    again = "" if now.armed else ", and arm again, after asking, what was disarmed meanwhile"
    return (f"go on after a silence of up to {settings.patience:g} s (--patience){again}",)


def _minutes(seconds: float) -> str:
    tens = 10 * math.ceil(seconds / 10.0)
    return f"{tens} s" if tens < 2 * 60 else f"{math.ceil(seconds / 60.0)} min"


def _movements(context: TuneContext, now: Observation) -> str:
    axis, d, speed = context.axis, axis_kind(context.axis.name), context.speed
    step = context.settings.step if context.settings.step is not None else d.step
    shown = f"{math.degrees(step):.0f} deg " if d.angular else f"{step:g} m "
    shown = "" if context.law.controls_velocity else shown
    turning = ", turning about where the room asks" if speed else ""
    under_way = f" under way at {speed:.1f} m/s{turning}" if axis.needs_speed else ""
    dive = dive_for(axis.dof, context.craft.firmware, now)
    down = f"dive to {dive.settings['depth']:g} m, then " if dive is not None else ""
    signs = d.excitation.check
    kind = "throttle steps" if d.excitation.by_throttle else f"oscillations about the present {d.excitation.title}"
    swings = f" and {kind}" if context.given is None and context.settings.gains is None else ""
    beside = ", steps in turn rate" if flies_beside(context) and context.settings.gains is None else ""
    return f"{signs}{down}{shown}steps in {axis.name}{beside}{swings}{under_way}"
