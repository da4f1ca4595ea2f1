"""Net buoyancy: the craft is heavier or lighter than the water it displaces."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from gcs_autotune.effects.axes import force_scale, force_unit
from gcs_autotune.effects.effect import Applied, Effect, Family, Quantity, Scene

__all__ = ["NetBuoyancy"]


class NetBuoyancy(Effect):
    """A constant ``force`` in heave, down positive: weight less buoyancy."""

    slug: ClassVar[str] = "net-buoyancy"
    family: ClassVar[Family] = "hydrodynamics"
    meaning: ClassVar[str] = "weight and buoyancy do not cancel: left alone the craft sinks (positive) or rises"
    parameters: ClassVar[tuple[Quantity, ...]] = (Quantity("force", "force", "weight less buoyancy, down positive"),)
    shown_by: ClassVar[str] = "mean of the heave residual; without command it goes on sinking or rising"
    mistaken_for: ClassVar[tuple[str, ...]] = ("asymmetric-thrust", "tether-pull", "gyro-bias", "dead-zone")
    separated_by: ClassVar[str] = "a minute without heave command, then equal pushes up and down at two depths"
    grows_with: ClassVar[tuple[str, ...]] = ("force",)

    def places(self, scene: Scene) -> tuple[str, ...]:
        """Heave, unless the base model has a constant force there."""
        return ("heave",) if "heave" in scene.form.dofs and "Z_0" not in scene.form.parameters else ()

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """A tenth of the largest command, to be scaled: the effect is linear."""
        return ({"force": 0.1 * force_scale(place, scene)},)

    def derivatives(self, own: Applied) -> Mapping[str, float]:
        """``Z_0``."""
        return {"Z_0": own["force"]}

    def unit_of(self, name: str, place: str, scene: Scene) -> str:
        """That of the force."""
        return force_unit(place, scene)
