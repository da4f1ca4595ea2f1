"""Linear drag: drag that goes with speed."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from typing import ClassVar

from gcs_autotune.effects.axes import drag_names, drag_polar, force_scale, force_unit, sense, sense_of, top_speed
from gcs_autotune.effects.effect import Applied, Curve, Effect, Family, Quantity, Scene
from gcs_autotune.sname import DOFS

__all__ = ["LinearDrag"]


class LinearDrag(Effect):
    """``- coefficient nu``: skin friction and wave making at low speed. Only where the base model has none."""

    slug: ClassVar[str] = "linear-drag"
    family: ClassVar[Family] = "hydrodynamics"
    meaning: ClassVar[str] = "drag that goes with speed: slow motion dies out exponentially"
    parameters: ClassVar[tuple[Quantity, ...]] = (
        Quantity("coefficient", "force s/m or s/rad", "drag per speed, positive when it damps"),
    )
    shown_by: ClassVar[str] = "residual against speed: a straight line through zero, most telling at low speed"
    mistaken_for: ClassVar[tuple[str, ...]] = ("quadratic-drag", "dead-zone", "actuator-lag")
    separated_by: ClassVar[str] = "full speed, then no command until it lies still: the tail of the coasting tells"
    grows_with: ClassVar[tuple[str, ...]] = ("coefficient",)

    def places(self, scene: Scene) -> tuple[str, ...]:
        """Degrees of freedom whose base model has no linear drag."""
        return tuple(d for d in scene.form.dofs if drag_names(d)[0] not in scene.form.parameters)

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """Shares of the largest force at the largest speed: a heading integrates, so only small ones act linearly."""
        full = force_scale(place, scene) / top_speed(place, scene)
        return tuple({"coefficient": share * full} for share in (0.02, 0.1, 0.5))

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """Drag damps."""
        return {"coefficient": (0.0, inf)}

    def constants(self, place: str, scene: Scene) -> Mapping[str, float]:
        """Which sign damps."""
        return sense(place, scene)

    def derivatives(self, own: Applied) -> Mapping[str, float]:
        """``X_u``, ``N_r`` and so on."""
        return {drag_names(own.place)[0]: -sense_of(own) * own["coefficient"]}

    def curve(self, own: Applied, scene: Scene) -> Curve:
        """The drag polar."""
        return drag_polar(own, scene, "Linear drag")

    def unit_of(self, name: str, place: str, scene: Scene) -> str:
        """Force per speed."""
        return DOFS[place].parameter_units(force_unit(place, scene))[1]
