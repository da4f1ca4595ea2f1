"""Surge and sway without a measured velocity: from the distance to a flat surface ahead, or from a straight track.

Source: Miskovic2010, 6.6.2 (second approach) and 7.6 for the distance. For a track, north and east are rotated into
ahead and starboard.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.cleaning import clean, unwrap
from gcs_autotune.identify.result import Doubt
from gcs_autotune.identify.segment import Segment
from gcs_autotune.sname import Dof
from gcs_autotune.trial import Channel, Trial

__all__ = ["DISTANCE", "ahead_doubt", "distance_in", "projected_track", "with_distance_ahead"]

DISTANCE = "d"

SWING = np.radians(15.0)
"""Change of heading [rad] before the surface above which a doubt is raised: ``d`` then shows up to 3 % too little
motion."""


def with_distance_ahead(trial: Trial) -> Trial:
    """Return *trial* with ``x = -d`` if it has the distance ``d``, for ``d_dot = -u cos(phi)`` (2.43), phi = 0.

    The distance made good ahead replaces a north position, which shows surge only if the craft heads north. If a
    rangefinder is slower than its messages, only new measurements are used.
    """
    if DISTANCE not in trial or not len(trial[DISTANCE]):
        return trial
    distance = _measured_anew(trial[DISTANCE])
    return replace(trial, channels={**trial.channels, "x": replace(distance, name="x", values=-distance.values)})


REPEATS, STEADY = 5, 0.9
"""Limits for a sensor that is slower than its messages.

REPEATS: number of messages in a row with one value. STEADY: fraction of its changes at whole multiples of that number.
"""


def _measured_anew(channel: Channel) -> Channel:
    """Return *channel* without the messages that repeat the last measurement of a slower sensor.

    A repeated value is late by up to a period of the sensor.
    """
    changes = np.flatnonzero(np.diff(channel.values) != 0.0) + 1
    if len(changes) < REPEATS:
        return channel
    gaps = np.diff(changes)
    period = int(np.median(gaps))
    steady = np.abs(gaps - period * np.maximum(np.round(gaps / max(period, 1)), 1)) <= 1
    if period < REPEATS or float(np.mean(steady)) < STEADY:
        return channel
    since = (
        np.arange(len(channel)) - changes[np.maximum(np.searchsorted(changes, np.arange(len(channel)), "right") - 1, 0)]
    )
    anew = since % period == 0
    return replace(channel, t=channel.t[anew], values=channel.values[anew])


def distance_in(segment: Segment) -> Channel | None:
    """Return the distance ahead as measured during a *segment* of surge; None if it was not measured."""
    recorded = segment.measured.get(DISTANCE) if segment.dof.name == "surge" else None
    if recorded is None:
        return None
    inside = recorded.between(segment.start, float(segment.stamps[-1]))
    finite = np.isfinite(inside.values)
    return replace(inside, t=inside.t[finite], values=inside.values[finite]) if int(finite.sum()) > 1 else None


def ahead_doubt(trial: Trial) -> Doubt | None:
    """Return a doubt if the craft apparently did not face the surface to which it measured the distance."""
    if "psi" not in trial or not len(trial["psi"]):
        return None
    psi = np.unwrap(trial["psi"].values[np.isfinite(trial["psi"].values)])
    swing = float(np.quantile(psi, 0.95) - np.quantile(psi, 0.05)) if len(psi) else 0.0
    if swing <= SWING:
        return None
    return Doubt(
        "not-facing",
        f"the heading of run '{trial.name}' varies by {np.degrees(swing):.0f} deg, but surge is derived from the "
        "distance to a surface. At an angle, that distance changes by only cos(angle) times the path",
        "hold the heading square to the surface. Tune the heading controller first (Miskovic2010, Algorithm 8.5)",
    )


STRAIGHT, CROOKED = 0.15, 0.6
"""Standard deviation of the heading [rad] up to which a track counts as straight, and above which it is rejected.

At 0.15 the projection is 1 % short.
"""


def projected_track(
    trial: Trial, axis: Dof, position: Channel, notes: list[Doubt], *, needed: bool = True
) -> Channel | None:
    """Return the distance run ahead (surge) or to starboard (sway) of the mean heading.

    *position* itself when it is not surge or sway, or when heading or the other coordinate was not recorded: then
    ``x`` and ``y`` are taken as ahead and starboard, as in a towing tank.

    needed : nothing else shows the motion. Where something does, a track that is no line is left out: None.

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
    if spread > STRAIGHT and not needed:
        return None
    if spread > CROOKED:
        raise NotInformative(
            f"run '{trial.name}' has no {axis.velocity}, and its heading varies by {np.degrees(spread):.0f} deg. "
            "North and east then do not determine one axis. Record the velocity, keep a straight course, or use "
            "--dof horizontal"
        )
    if spread > STRAIGHT:
        notes.append(
            Doubt(
                "not-straight",
                f"the heading of run '{trial.name}' varies by {np.degrees(spread):.0f} deg while {axis.name} is "
                "derived from positions",
                "keep a straight course, or use --dof horizontal",
            )
        )
    across = np.interp(position.t, second.t, second.values)
    north, east = (position.values, across) if position.name == "x" else (across, position.values)
    north, east = north - north[0], east - east[0]
    ahead = north * np.cos(mean) + east * np.sin(mean)
    starboard = east * np.cos(mean) - north * np.sin(mean)
    return replace(position, values=ahead if axis.name == "surge" else starboard)
