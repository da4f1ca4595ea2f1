"""Surge read off the distance to a flat surface ahead, Miskovic2010, 6.6.2 (second approach) and 7.6."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gcs_autotune.identify.result import Doubt
from gcs_autotune.trial import Trial

__all__ = ["DISTANCE", "ahead_doubt", "with_ahead"]

DISTANCE = "d"

SWING = np.radians(15.0)
"""Change of heading [rad] before the surface that is worth a word: then ``d`` shows up to 3 % too little motion."""


def with_ahead(trial: Trial) -> Trial:
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
