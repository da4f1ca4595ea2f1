"""Coupling of sway and yaw: a craft whose centres do not coincide."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, sqrt
from typing import ClassVar

from gcs_autotune.effects.axes import force_scale, force_unit, inertia_scale, top_speed
from gcs_autotune.effects.effect import Applied, Effect, Family, Quantity, Scene

__all__ = ["SwayYawCoupling"]

LARGEST = 0.95
"""Largest ``Y_rdot`` in shares of the geometric mean of both inertias: at 1 the mass matrix is singular."""


class SwayYawCoupling(Effect):
    """``Y_r r`` in sway, ``N_v v`` in yaw, and ``-Y_rdot`` off the diagonal of the mass matrix, on both sides.

    With the centre of gravity ``x_G`` ahead, ``-Y_rdot`` is ``m x_G`` (Miskovic, Vukic and Barisic, (4)).
    """

    slug: ClassVar[str] = "sway-yaw-coupling"
    family: ClassVar[Family] = "hydrodynamics"
    meaning: ClassVar[str] = "turning pushes sideways, sliding turns: centre of gravity or of drag away from midships"
    parameters: ClassVar[tuple[Quantity, ...]] = (
        Quantity("Y_r", "force s/rad", "sway force per yaw rate"),
        Quantity("N_v", "moment s/m", "yaw moment per sway velocity"),
        Quantity("Y_rdot", "force s^2/rad", "sway force per yaw acceleration, minus the mass matrix's entry"),
    )
    shown_by: ClassVar[str] = "sway residual against yaw rate, and yaw residual against sway, also without way ahead"
    mistaken_for: ClassVar[tuple[str, ...]] = ("coriolis-coupling", "channel-swap", "steady-current")
    separated_by: ClassVar[str] = "turn on the spot without way, then push sideways without turning"
    grows_with: ClassVar[tuple[str, ...]] = ("Y_r", "N_v", "Y_rdot")

    def places(self, scene: Scene) -> tuple[str, ...]:
        """Sway and yaw, where the base model has no coupling."""
        form = scene.form
        there = {"Y_r", "N_v", "Y_rdot", "N_vdot", "x_G"} & set(form.parameters)
        return ("sway+yaw",) if {"sway", "yaw"} <= set(form.dofs) and not there else ()

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """Each of the three by itself, at a fair share of the forces there are."""
        v, r = top_speed("sway", scene), top_speed("yaw", scene)
        size = {
            "Y_r": -0.3 * force_scale("sway", scene) / r,
            "N_v": -0.3 * force_scale("yaw", scene) / v,
            "Y_rdot": -0.3 * _mean_inertia(scene),
        }
        return tuple({n: (v if n == name else 0.0) for n, v in size.items()} for name in size)

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """The mass matrix stays positive definite."""
        most = LARGEST * _mean_inertia(scene) if scene.base else inf
        return {"Y_r": (-inf, inf), "N_v": (-inf, inf), "Y_rdot": (-most, most)}

    def derivatives(self, own: Applied) -> Mapping[str, float]:
        """Themselves; the mirror of ``Y_rdot`` comes with it."""
        return {name: own[name] for name in ("Y_r", "N_v", "Y_rdot")}

    def unit_of(self, name: str, place: str, scene: Scene) -> str:
        """Force over speed or acceleration."""
        per = {"Y_r": "s/rad", "N_v": "s/m", "Y_rdot": "s^2/rad"}
        return f"{force_unit('yaw' if name == 'N_v' else 'sway', scene)} {per[name]}"


def _mean_inertia(scene: Scene) -> float:
    return sqrt(inertia_scale("sway", scene) * inertia_scale("yaw", scene))
