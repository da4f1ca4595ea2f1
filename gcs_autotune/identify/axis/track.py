"""Surge and sway from positions alone: north and east turned into ahead and starboard along a straight track."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.cleaning import clean, unwrap
from gcs_autotune.identify.result import Doubt
from gcs_autotune.sname import Dof
from gcs_autotune.trial import Channel, Trial

__all__ = ["along_track"]

STRAIGHT, CROOKED = 0.15, 0.6
"""Standard deviation of the heading [rad] up to which a track counts as straight, and beyond which it is no track.
Chosen: at 0.15 the projection is 1 % short."""


def along_track(trial: Trial, axis: Dof, position: Channel, notes: list[Doubt]) -> Channel:
    """Return the distance run ahead (surge) or to starboard (sway) of the mean heading.

    *position* itself when it is not surge or sway, or when heading or the other coordinate was not recorded: then
    ``x`` and ``y`` are taken as ahead and starboard, as in a towing tank.

    Raises
    ------
    NotInformative
        The craft turned too much for its track to be a line.
    """
    other = {"x": "y", "y": "x"}.get(position.name) if axis.name in ("surge", "sway") else None
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
