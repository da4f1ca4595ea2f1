"""What linear and quadratic drag have in common: a coefficient times a power of speed, against the motion."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from typing import ClassVar

from gcs_autotune.effects.axes import drag_names, drag_polar, force_scale, force_unit, sense, sense_of, top_speed
from gcs_autotune.effects.effect import Applied, Curve, Effect, Family, Scene
from gcs_autotune.sname import DOFS

__all__ = ["Drag"]


class Drag(Effect):
    """``coefficient`` times speed to the ``power``; ``polar`` is the title of its picture."""

    power: ClassVar[int]
    polar: ClassVar[str]
    family: ClassVar[Family] = "hydrodynamics"
    grows_with: ClassVar[tuple[str, ...]] = ("coefficient",)

    def places(self, scene: Scene) -> tuple[str, ...]:
        """Degrees of freedom whose base model has no such drag."""
        return tuple(d for d in scene.form.dofs if not self._spellings(d) & set(scene.form.parameters))

    def _spellings(self, dof: str) -> set[str]:
        """What a base model may call it."""
        d, own = DOFS[dof], drag_names(dof)[self.power - 1]
        return {own} if self.power == 1 else {own, f"{d.force}_|{d.velocity}|{d.velocity}"}

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """Shares of the largest force at the largest speed: a heading integrates, so only small ones act linearly."""
        full = force_scale(place, scene) / top_speed(place, scene) ** self.power
        return tuple({"coefficient": share * full} for share in (0.02, 0.1, 0.5))

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """Drag damps."""
        return {"coefficient": (0.0, inf)}

    def constants(self, place: str, scene: Scene) -> Mapping[str, float]:
        """Which sign damps."""
        return sense(place, scene)

    def derivatives(self, own: Applied) -> Mapping[str, float]:
        """``X_u``, ``N_r`` and so on; ``X_uu``, ``N_rr`` of the second power."""
        return {drag_names(own.place)[self.power - 1]: -sense_of(own) * own["coefficient"]}

    def curve(self, own: Applied, scene: Scene) -> Curve:
        """The drag polar."""
        return drag_polar(own, scene, self.polar)

    def unit_of(self, name: str, place: str, scene: Scene) -> str:
        """Force per that power of speed."""
        return DOFS[place].parameter_units(force_unit(place, scene))[self.power]
