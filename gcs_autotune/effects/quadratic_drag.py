"""Quadratic drag: drag that goes with the square of speed."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from typing import ClassVar

from gcs_autotune.effects.axes import drag_names, drag_polar, force_scale, force_unit, sense, sense_of, top_speed
from gcs_autotune.effects.effect import Applied, Curve, Effect, Family, Quantity, Scene
from gcs_autotune.sname import DOFS

__all__ = ["QuadraticDrag"]


class QuadraticDrag(Effect):
    """``- coefficient |nu| nu``: pressure drag of the water shed at higher speed (thesis (6.33), ``beta_nn``)."""

    slug: ClassVar[str] = "quadratic-drag"
    family: ClassVar[Family] = "hydrodynamics"
    meaning: ClassVar[str] = "drag that goes with the square of speed: twice the force gives less than twice the speed"
    parameters: ClassVar[tuple[Quantity, ...]] = (
        Quantity("coefficient", "force s^2/m^2 or s^2/rad^2", "drag per squared speed, positive when it damps"),
    )
    shown_by: ClassVar[str] = (
        "residual against speed: an S: the simulation is too slow at low speed and too fast at high"
    )
    mistaken_for: ClassVar[tuple[str, ...]] = ("saturation", "quadratic-actuator", "linear-drag", "rudder-stall")
    separated_by: ClassVar[str] = "steps of three sizes each way, held until the speed settles, each left to coast down"
    grows_with: ClassVar[tuple[str, ...]] = ("coefficient",)

    def places(self, scene: Scene) -> tuple[str, ...]:
        """Degrees of freedom whose base model has no quadratic drag."""
        return tuple(d for d in scene.form.dofs if not _has_it(d, scene))

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """Shares of the largest force at the largest speed: a heading integrates, so only small ones act linearly."""
        full = force_scale(place, scene) / top_speed(place, scene) ** 2
        return tuple({"coefficient": share * full} for share in (0.02, 0.1, 0.5))

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """Drag damps."""
        return {"coefficient": (0.0, inf)}

    def constants(self, place: str, scene: Scene) -> Mapping[str, float]:
        """Which sign damps."""
        return sense(place, scene)

    def derivatives(self, own: Applied) -> Mapping[str, float]:
        """``X_uu``, ``N_rr`` and so on."""
        return {drag_names(own.place)[1]: -sense_of(own) * own["coefficient"]}

    def curve(self, own: Applied, scene: Scene) -> Curve:
        """The drag polar."""
        return drag_polar(own, scene, "Drag polar")

    def unit_of(self, name: str, place: str, scene: Scene) -> str:
        """Force per squared speed."""
        return DOFS[place].parameter_units(force_unit(place, scene))[2]


def _has_it(dof: str, scene: Scene) -> bool:
    d = DOFS[dof]
    return bool({drag_names(dof)[1], f"{d.force}_|{d.velocity}|{d.velocity}"} & set(scene.form.parameters))
