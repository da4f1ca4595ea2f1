"""What ``tune`` says it is going to do, before anything is armed, moved or written; and whether it may."""

from __future__ import annotations

import math

from gcs_autotune.craft import Observation
from gcs_autotune.errors import OperatorStopped
from gcs_autotune.workflow.aboard import TWITCHING
from gcs_autotune.workflow.experiments import dive_for
from gcs_autotune.workflow.preflight import ANNOUNCED
from gcs_autotune.workflow.settings import DEFAULTS
from gcs_autotune.workflow.voyage import Voyage

__all__ = ["announce"]

DOF_NAMES = {"yaw": "heading", "heave": "depth"}
"""Degree of freedom -> what oscillates, to people."""


def announce(voyage: Voyage) -> None:
    """Say what will be done and ask for leave.

    Raises
    ------
    OperatorStopped
        The answer was no.
    """
    now, firmware, axis = voyage.craft.observe(), voyage.craft.firmware, voyage.axis
    gains = ", ".join(axis.names.own(g.parameter) for g in axis.gains)
    voyage.tale.announce(
        (
            ("leave the vehicle armed, as it is" if now.armed else "arm the vehicle, and disarm it at the end")
            + f"; {TWITCHING}",
            f"use the modes {firmware.hold_mode} and {firmware.manual_mode}, and go back to {now.mode} at the end",
            f"move: {_movements(voyage, now)}",
            "write no parameter (dry run)"
            if voyage.settings.dry_run
            else f"write some of {gains}, after asking again; the old values come back unless the new prove better",
        )
    )
    if not voyage.agrees("Go ahead?"):
        raise OperatorStopped("not started: the answer was no; nothing was armed, moved or written")


def _movements(voyage: Voyage, now: Observation) -> str:
    axis, d, speed = voyage.axis, DEFAULTS[voyage.axis.dof], voyage.speed
    step = voyage.settings.step if voyage.settings.step is not None else d.step
    shown = f"{math.degrees(step):.0f} deg " if d.signal == "psi" else f"{step:g} m "
    shown = "" if voyage.law.controls_velocity else shown
    room = f", turning about in between; about {100.0 * speed:.0f} m of free water around" if speed else ""
    under_way = f" under way at {speed:.1f} m/s{room}" if axis.needs_speed else ""
    dive = dive_for(axis.dof, voyage.craft.firmware.kind, now)
    down = f"dive to {dive.settings['depth']:g} m, then " if dive is not None else ""
    signs = ANNOUNCED.get(axis.dof, "")
    kind = "throttle steps" if axis.dof == "surge" else f"oscillations about the present {DOF_NAMES[axis.dof]}"
    swings = f" and {kind}" if voyage.given is None and voyage.settings.gains is None else ""
    return f"{signs}{down}{shown}steps in {axis.name}{swings}{under_way}"
