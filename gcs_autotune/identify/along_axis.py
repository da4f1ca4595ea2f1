"""Surge and sway where no velocity was recorded: from the distance to a flat surface ahead, or from a straight track.

Miskovic2010, 6.6.2 (second approach) and 7.6 for the distance; north and east are turned into ahead and starboard.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.cleaning import clean, unwrap
from gcs_autotune.identify.result import Doubt
from gcs_autotune.sname import Dof
from gcs_autotune.trial import Channel, Trial

__all__ = ["DISTANCE", "ahead_doubt", "projected_track", "with_distance_ahead"]

DISTANCE = "d"

SWING = np.radians(15.0)
"""Change of heading [rad] before the surface that is worth a word: then ``d`` shows up to 3 % too little motion."""


def with_distance_ahead(trial: Trial) -> Trial:
    """Return *trial* with ``x = -d`` where it has the distance ``d``, for ``d_dot = -u cos(phi)`` (2.43), phi = 0.

    The way made good ahead takes the place of a north position, which says nothing about surge unless the craft
    heads north.
    """
    if DISTANCE not in trial or not len(trial[DISTANCE]):
        return trial
    distance = trial[DISTANCE]
    return replace(trial, channels={**trial.channels, "x": replace(distance, name="x", values=-distance.values)})


def ahead_doubt(trial: Trial) -> Doubt | None:
    """Return a doubt when the craft did not face the surface it measured its distance to, as far as one can tell."""
    if "psi" not in trial or not len(trial["psi"]):
        return None
    psi = np.unwrap(trial["psi"].values[np.isfinite(trial["psi"].values)])
    swing = float(np.quantile(psi, 0.95) - np.quantile(psi, 0.05)) if len(psi) else 0.0
    if swing <= SWING:
        return None
    return Doubt(
        "not-facing",
        f"the heading of run '{trial.name}' swings by {np.degrees(swing):.0f} deg while surge is read off the distance "
        "to a surface: the distance changes by cos(angle) only",
        "hold the heading square to the surface (the angle controller first, Miskovic2010, Algorithm 8.5)",
    )


STRAIGHT, CROOKED = 0.15, 0.6
"""Standard deviation of the heading [rad] up to which a track counts as straight, and beyond which it is no track.
Chosen: at 0.15 the projection is 1 % short."""


def projected_track(trial: Trial, axis: Dof, position: Channel, notes: list[Doubt]) -> Channel:
    """Return the distance run ahead (surge) or to starboard (sway) of the mean heading.

    *position* itself when it is not surge or sway, or when heading or the other coordinate was not recorded: then
    ``x`` and ``y`` are taken as ahead and starboard, as in a towing tank.

    Raises
    ------
    NotInformative
        The craft turned too much for its track to be a line.
    """
    other = {"x": "y", "y": "x"}.get(position.name) if axis.along_ground else None
    if other is None or other not in trial or "psi" not in trial or min(len(trial[other]), len(trial["psi"])) < 2:
        return position
    second, psi = clean(trial[other], trial.name, notes), clean(trial["psi"], trial.name, notes)
    heading = unwrap(psi.t, psi.values, None)
    mean, spread = float(np.mean(heading)), float(np.std(heading))
    if spread > CROOKED:
        raise NotInformative(
            f"run '{trial.name}' has no {axis.velocity}, and its heading varies by {np.degrees(spread):.0f} deg: north "
            "and east tell nothing of one axis; record the velocity, keep straight, or identify --dof horizontal"
        )
    if spread > STRAIGHT:
        notes.append(
            Doubt(
                "not-straight",
                f"the heading of run '{trial.name}' varies by {np.degrees(spread):.0f} deg while {axis.name} is read "
                "off positions",
                "keep straight, or identify --dof horizontal",
            )
        )
    across = np.interp(position.t, second.t, second.values)
    north, east = (position.values, across) if position.name == "x" else (across, position.values)
    north, east = north - north[0], east - east[0]
    ahead = north * np.cos(mean) + east * np.sin(mean)
    starboard = east * np.cos(mean) - north * np.sin(mean)
    return replace(position, values=ahead if axis.name == "surge" else starboard)
