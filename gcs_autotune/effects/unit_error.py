"""Unit error: a column's numbers are in another unit than its head says."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

from gcs_autotune.effects.effect import Applied, Drive, Effect, Family, Observed, Quantity, Scene
from gcs_autotune.effects.visibility import input_scale_shows, signal_scale_shows

__all__ = ["SLIPS", "UnitError"]

SLIPS: Mapping[str, tuple[float, ...]] = {
    "rad": (180.0 / math.pi, 0.5 / math.pi),
    "rad/s": (180.0 / math.pi, 30.0 / math.pi, 0.5 / math.pi),
    "m": (1.0 / 0.3048, 100.0, 1000.0),
    "m/s": (3600.0 / 1852.0, 3.6, 1.0 / 0.3048, 1.852, 100.0, 1000.0),
    "N": (1.0 / 9.80665, 0.001, 0.22480894),
    "N m": (1.0 / 9.80665, 0.001, 0.73756215),
    "1": (100.0,),
}
"""SI unit -> number in the file per number in SI, for the usual slips; each also happens the other way round."""


class UnitError(Effect):
    """The file's number is ``factor`` times the true one. The factor is one of :data:`SLIPS`, chosen and not fitted."""

    slug: ClassVar[str] = "unit-error"
    family: ClassVar[Family] = "bookkeeping"
    meaning: ClassVar[str] = "the numbers of a column are in another unit than its head says"
    parameters: ClassVar[tuple[Quantity, ...]] = (Quantity("factor", "1", "number in the file per true number in SI"),)
    shown_by: ClassVar[str] = (
        "one column against its own kin: a position changes 57.3, 3.6 or 1.94 times what its rate says"
    )
    mistaken_for: ClassVar[tuple[str, ...]] = ("time-scale", "steady-current")
    separated_by: ClassVar[str] = "a known motion: one full turn, or a measured length sailed both ways"
    fixed: ClassVar[tuple[str, ...]] = ("factor",)

    def places(self, scene: Scene) -> tuple[str, ...]:
        """Columns whose scale something else in the file checks."""
        signals = tuple(s for s, unit in scene.signals.items() if unit in SLIPS and signal_scale_shows(s, scene))
        inputs = tuple(c for c, unit in scene.inputs.items() if unit in SLIPS and input_scale_shows(c, scene))
        return signals + inputs

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """Every usual slip of this unit, both ways round."""
        unit = scene.signals.get(place, scene.inputs.get(place, ""))
        return tuple({"factor": f} for slip in SLIPS[unit] for f in (slip, 1.0 / slip))

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """What the table of slips spans."""
        return {"factor": (1e-3, 1e3)}

    def drive(self, own: Applied, drive: Drive) -> Drive:
        """Read the true command from the column."""
        u = drive.channels.get(own.place)
        return drive if u is None else drive.with_channel(own.place, u / own["factor"])

    def observe(self, own: Applied, seen: Observed) -> Observed:
        """Write the signal in the wrong unit."""
        y = seen.signals.get(own.place)
        return seen if y is None else seen.with_signal(own.place, y * own["factor"])
