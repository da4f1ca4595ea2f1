"""Text announced before anything moves: space, time and battery needed, and what happens if the link is lost."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace

from gcs_autotune.axes import excitation_of, position_axis
from gcs_autotune.craft import Observation
from gcs_autotune.design import STYLES, style_of
from gcs_autotune.manoeuvres import FAR_OUT, NEARLY, Envelope
from gcs_autotune.observer import Intention
from gcs_autotune.sname import DOFS
from gcs_autotune.workflow.excursion import (
    LATE,
    Excursion,
    overhead,
)
from gcs_autotune.workflow.experiments import STEP_AHEAD, SWING_AHEAD, WORKING_DEPTH
from gcs_autotune.workflow.itinerary import Itinerary
from gcs_autotune.workflow.settings import PATIENCE, CommonSettings, TuneSettings

__all__ = [
    "after_a_silence",
    "battery",
    "deepest",
    "exactly",
    "how_long",
    "in_modes",
    "in_short",
    "room",
    "some_of",
    "styled",
    "whole_of",
]

ROOM_AND_TIME = "Space, time"
"""Row of the announcement that states both, for a run whose every stage was simulated."""

REASON = 66
"""Characters of a reason beside "Not heading" in a line of the announcement, on a terminal of 80 columns."""

ROV_ROOM, BELOW = 2.0, 1.5
"""Free water [m] required around an ROV that holds its position, and below its deepest target. Project choice."""


def room(dof: str, speed: float, settings: TuneSettings, now: Observation, whole: Excursion) -> Intention:
    """Return a sentence on the free water required.

    *speed* [m/s] is a boat's speed, or 0 for a craft that stays near its start.
    """
    if speed:
        envelope = replace(settings.envelope, cruise=speed)
        metres, usual = whole.metres(envelope), (whole.usual or whole).needs
        if settings.ends_early and not excitation_of(dof).by_throttle:
            # short of turning around a boat may still fly an oscillation and a step, whatever its simulated stages take
            limit = envelope.distance_limit
            metres = max(metres, min(FAR_OUT * limit + (SWING_AHEAD + STEP_AHEAD) * speed, NEARLY * limit))
        usually = f" (usually about {usual:.0f} m)" if usual < metres else ""
        turns = FAR_OUT * envelope.distance_limit
        between = f". Between stages it turns around if it is more than {turns:.0f} m away" if turns < metres else ""
        between = ". It turns around before each stage" if not settings.ends_early else between
        far = f"up to {metres:.0f} m from the start{usually}"
        return Intention(f"need {far}{between}. A smaller --max-distance reduces this", "Space", far)
    below = ends = most = ""
    if excitation_of(dof).below_surface:
        below = f", and {deepest(dof, settings, now):.0f} m of depth"
    if DOFS[dof].restored:
        limit = math.degrees(getattr(settings.envelope, dof))
        ends = f". More than {limit:.0f} deg of {dof} ends the run (--max-{dof})"
        most = f", at most {limit:.0f} deg of {dof}"
    around, where = f"about {ROV_ROOM:g} m of free water", " around the vehicle"
    return Intention(f"need {around}{where}{below}{ends}", "Space", f"{around}{'' if most else where}{below}{most}")


def deepest(dof: str, settings: TuneSettings, now: Observation) -> float:
    """Return the greatest depth [m] that the ROV will reach, or 0 if no depth step is flown."""
    if not excitation_of(dof).below_surface:
        return 0.0
    axis = position_axis(dof)
    step = 0.0 if axis.angular else abs(settings.step) if settings.step is not None else axis.step
    return (max(now.z, WORKING_DEPTH) if math.isfinite(now.z) else WORKING_DEPTH) + step + BELOW


def whole_of(excursion: Excursion, envelope: Envelope, source: str = "") -> Intention:
    """Return a sentence on the space and time of a whole run, with its stages.

    *source* states where the numbers come from.
    """
    metres, usual, moves = excursion.metres(envelope), excursion.usual, excursion.distance >= 1.0
    dives = excursion.depth_excursion >= 0.1
    deep = f", down to {excursion.depth_max:.1f} m of depth" if dives else ""
    deep_briefly = f", {excursion.depth_max:.1f} m deep" if dives else ""
    ends = " (--max-distance ends the run there)" if excursion.needs > metres else ""
    far = f"up to {metres:.0f} m from the start{ends}" if moves else "only the water around the craft"
    at_spot = f"at the spot{deep_briefly}"
    longest = exactly(LATE * excursion.seconds)
    if usual is None:
        told = ", ".join(f"{name} {exactly(seconds)}" for name, seconds in excursion.stages)
        most = f"up to {f'--max-distance ({metres:.0f} m)' if ends else f'{metres:.0f} m from the start'}{deep_briefly}"
        return Intention(
            f"need {far}{deep}, and up to {longest}: {told}" + f"; predicted from {source}" * bool(source),
            ROOM_AND_TIME,
            f"{most if moves else at_spot}, up to {longest}",
        )
    by = f" (predicted from {source})" if source else ""
    often = exactly(LATE * usual.seconds)
    most = f", of a poorly damped loop up to {longest}"
    brief = f"up to {metres:.0f} m from the start{deep_briefly}; usually {often}, at most {longest}"
    return Intention(
        f"need {far}{deep}, and usually about {often}{most}{by}",
        ROOM_AND_TIME,
        brief if moves else f"{at_spot}; usually {often}, at most {longest}",
    )


def exactly(seconds: float) -> str:
    """Return a time [s] as minutes and seconds, rounded up to multiples of 10 s; below one minute, of 5 s."""
    step = 5 if seconds < 60.0 else 10
    minutes, rest = divmod(step * math.ceil(seconds / step), 60)
    return " ".join(([f"{minutes} min"] if minutes else []) + ([f"{rest} s"] if rest or not minutes else []))


def how_long(itinerary: Itinerary, patient: Itinerary | None = None) -> Intention:
    """Return a sentence on the duration of each stage in vehicle time. The times add up to the announced total.

    *patient* is the run if no stage ends early.
    """
    beside, legs = overhead(len(itinerary.legs)), itinerary.legs if patient is None else patient.legs
    total = itinerary.seconds + beside
    most = total if patient is None else max(patient.seconds + overhead(len(legs)), total)
    usual, longest = exactly(total), exactly(most)
    up_to = "" if longest == usual else f", up to {longest}"
    brief = f"about {usual} of the vehicle's time{up_to}"
    stages = f"{itinerary.told()}, arming and mode changes {beside:.0f} s"
    planned = {leg.stage for leg in itinerary.legs}
    further = [f"{leg.stage} {leg.total:.0f} s" for leg in legs if leg.stage not in planned]
    more = f". If these do not suffice, it also flies {', '.join(further)}" if further else ""
    rest = f": {stages}{more}. These are estimates for similar craft, updated after the first stage of each kind"
    return Intention(f"take {brief}{' if it does not settle' * bool(up_to)}{rest}", "Time", brief)


def battery(now: Observation, envelope: Envelope, seconds: float, most: float = 0.0) -> Intention:
    """Return a sentence on the battery: its state, and the charge needed for a run of *seconds* [s], at most *most*
    [s].

    The consumption is assumed: no current is read.
    """
    usual, longest = (math.ceil(20.0 * each / 3600.0) * 5 for each in (seconds, max(most, seconds)))
    share = f"about {usual} %" if longest == usual else f"about {usual} %, up to {longest} %"
    briefly = (f"about {usual} %" if longest == usual else f"{usual} to {longest} %") + " of a one-hour battery"
    draws = f"{share} of a battery that lasts an hour at this power"
    assumed = ", which is assumed"
    known = []
    if math.isfinite(now.battery_remaining):
        known.append(f"{100.0 * now.battery_remaining:.0f} % now, limit {100.0 * envelope.battery_remaining:.0f} %")
    if math.isfinite(now.battery_voltage):
        ends = f", limit {envelope.battery_voltage:g} V" if envelope.battery_voltage > 0.0 else ""
        known.append(f"{now.battery_voltage:.1f} V now{ends}")
    if not known:
        rest = ". The vehicle does not report its battery, so the battery is not monitored"
        return Intention(f"use {draws}{assumed}{rest}", "Battery", f"{briefly} (not reported, so not monitored)")
    state = ", ".join(known)
    return Intention(f"use {draws}{assumed}. State: {state}", "Battery", f"{briefly} ({state})")


def styled(name: str, *, designs: bool = True) -> Intention:
    """Return a sentence with the numbers of the style called *name*.

    designs : whether gains are designed. Otherwise existing ones are compared by what the style accepts.
    """
    style = style_of(name)
    if designs:
        margins = f"gain margin {style.gain_margin:.3g}, phase margin {math.degrees(style.phase_margin):.0f} deg"
        brief = f"{name}: bandwidth {100.0 * style.bandwidth:.0f} %, {margins}"
        return _unless_usual(style == STYLES["normal"], f"design for style {name}: {style}", "Style", brief)
    told = f"an error up to {style.slower:.2g} times as large is accepted if the actuator travels clearly less"
    return Intention(f"compare by style {name}: {told}", "Style", f"{name}: {told}")


def in_modes(modes: Sequence[str], back: str, when: str) -> Intention:
    """Return a sentence on the *modes* that are used, at least one, and on *back*, the mode to return to. Its brief
    text is for the row that also announces the arming.

    when : when the vehicle returns, as text.
    """
    *others, last = modes
    used = f"{', '.join(others)}{' and ' if others else ''}{last}"
    if list(modes) == [back]:
        return Intention(f"stay in mode {back}", brief=f"mode {back}, as now", is_usual=True)
    plural = "s" * bool(others)
    text = f"use mode{plural} {used}, and return to {back} {when}"
    return Intention(text, brief=f"mode{plural} {used}; {when} {back}", is_usual=True)


def after_a_silence(settings: CommonSettings, *, armed: bool) -> tuple[Intention, ...]:
    """Return a sentence on what happens after a lost link. It is empty if the first interruption ends the run.

    armed : whether the vehicle is armed already; it is then not armed again.
    """
    if settings.patience <= 0.0:
        return ()
    text = f"continue if messages stop for up to {settings.patience:g} s (--patience)"
    brief = f"continues after up to {settings.patience:g} s of silence (--patience)"
    if not armed:
        text += ", and arm the vehicle again if it was disarmed, after asking"
        brief += "; asks to rearm"
    return (_unless_usual(settings.patience == PATIENCE, text, "Link", brief),)


def _unless_usual(is_usual: bool, text: str, row: str, brief: str) -> Intention:
    """Return an intention that has a row only if it differs from the usual one."""
    return Intention(text, brief=brief, is_usual=True) if is_usual else Intention(text, row, brief)


def some_of(names: Sequence[str], *, asks: bool, every: bool = False) -> tuple[str, str]:
    """Return what a tune may write of the parameters *names*, as a sentence and in one line of a terminal.

    asks : whether it asks again before it writes. every : whether it writes all of them.
    """
    again = ", after asking again" if asks else ""
    some = "" if every or len(names) == 1 else "some of "
    sentence = f"write {some}{', '.join(names)}{again}{',' * asks} and restore the old values unless the new ones are"
    few = f"{some}{len(names)} parameters" if len(names) > 1 else names[0]
    return f"{sentence} better", f"{few}{again}; only better ones stay"


def in_short(reason: str) -> str:
    """Return the first clause of *reason* for one line of a terminal, or where to read a longer one."""
    first = re.split(r"[.;:] ", reason, maxsplit=1)[0]
    return first if len(first) <= REASON else "see --verbose"
