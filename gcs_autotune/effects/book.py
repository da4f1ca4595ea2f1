"""The book of effects: everything a simulation may get wrong that this package knows by name.

Adding one is one file and one line here. The order is that in which effects act on a command, a motion and a
measurement, and that in which equals are named; bookkeeping comes first, because it mimics physics.
"""

from __future__ import annotations

from collections.abc import Mapping

from gcs_autotune.effects.compass_deviation import CompassDeviation
from gcs_autotune.effects.dead_zone import DeadZone
from gcs_autotune.effects.effect import Effect
from gcs_autotune.effects.input_bias import InputBias

__all__ = ["BOOK"]

BOOK: Mapping[str, Effect] = {
    e.slug: e
    for e in (
        DeadZone(),
        InputBias(),
        CompassDeviation(),
    )
}
"""Slug -> effect."""
