"""Derive surge and sway from positions, if no velocity is measured.

The position is either the distance to a flat surface ahead, or a straight track. The method for the distance is the
second approach in Miskovic2010, 6.6.2, and 7.6. For a track, north and east are rotated to ahead and starboard.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.signals.cleaning import clean, unwrap
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.sname import Dof
from gcs_autotune.trial import Channel, Trial

__all__ = ["DISTANCE", "ahead_doubt", "distance_in", "projected_track", "with_distance_ahead"]

DISTANCE = "d"

HEADING_CHANGE = np.radians(15.0)
"""Change of heading [rad] while facing the surface, above which a doubt is raised. Project choice.

At this angle ``d`` shows up to 3 % too little motion.
"""


def with_distance_ahead(trial: Trial) -> Trial:
    """Return *trial* with ``x = -d`` if it contains the distance ``d`` to a surface ahead.

    The relation is ``d_dot = -u cos(phi)`` (2.43) with phi = 0. The new ``x`` replaces a north position, which shows
    surge only if the craft heads north. If a rangefinder is slower than its messages, only new measurements are used.
    """
    if DISTANCE not in trial or not len(trial[DISTANCE]):
        return trial
    distance = _measured_anew(trial[DISTANCE])
    return replace(trial, channels={**trial.channels, "x": replace(distance, name="x", values=-distance.values)})


REPEATS, STEADY = 5, 0.9
"""Limits that identify a sensor slower than its messages. Project choice.

- ``REPEATS``: smallest number of messages per new value.
- ``STEADY``: smallest fraction of the changes whose spacing is a whole multiple of that number.
"""


def _measured_anew(channel: Channel) -> Channel:
    """Return *channel* without messages that repeat the last measurement of a slower sensor.

    A repeated value is late by up to one period of the sensor.
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
    measured = since % period == 0
    return replace(channel, t=channel.t[measured], values=channel.values[measured])


def distance_in(segment: Segment) -> Channel | None:
    """Return the measured distance ahead during a *segment* of surge, or None if it was not measured."""
    recorded = segment.measured.get(DISTANCE) if segment.dof.name == "surge" else None
    if recorded is None:
        return None
    inside = recorded.between(segment.start, float(segment.stamps[-1]))
    finite = np.isfinite(inside.values)
    return replace(inside, t=inside.t[finite], values=inside.values[finite]) if int(finite.sum()) > 1 else None


def ahead_doubt(trial: Trial) -> Doubt | None:
    """Return a doubt if the heading shows that the craft did not keep facing the surface ahead, else None."""
    if "psi" not in trial or not len(trial["psi"]):
        return None
    psi = np.unwrap(trial["psi"].values[np.isfinite(trial["psi"].values)])
    spread = float(np.quantile(psi, 0.95) - np.quantile(psi, 0.05)) if len(psi) else 0.0
    if spread <= HEADING_CHANGE:
        return None
    return Doubt(
        "not-facing",
        f"the heading of run '{trial.name}' varies by {np.degrees(spread):.0f} deg, but surge is derived from the "
        "distance to a surface. At an angle, that distance changes by only cos(angle) times the path",
        "hold the heading square to the surface. Tune the heading controller first (Miskovic2010, Algorithm 8.5)",
    )


STRAIGHT, CROOKED = 0.15, 0.6
"""Limits of the standard deviation of the heading [rad]. Project choice.

Up to ``STRAIGHT`` a track counts as straight. Above ``CROOKED`` the track is rejected. At 0.15 the projection is 1 %
too short.
"""


def projected_track(
    trial: Trial, axis: Dof, position: Channel, notes: list[Doubt], *, needed: bool = True
) -> Channel | None:
    """Return the distance travelled ahead (surge) or to starboard (sway), relative to the mean heading [m].

    Return *position* unchanged for other degrees of freedom, or if the heading or the other coordinate was not
    recorded. ``x`` and ``y`` are then taken as ahead and starboard, as in a towing tank.

    needed : whether the position is the only signal of this motion. If it is not, the result for a track that is not
        straight is None.

    Raises
    ------
    NotInformative
        The craft turned too much for its track to count as a line.
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
