"""Coriolis coupling: a turning body's own momentum pushes it sideways and about."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from typing import ClassVar

from gcs_autotune.effects.axes import force_scale, force_unit, inertia_scale, top_speed
from gcs_autotune.effects.effect import Applied, Effect, Family, Quantity, Scene

__all__ = ["CoriolisCoupling"]

TERMS: Mapping[str, tuple[str, str, str]] = {
    "X_vr": ("surge", "sway", "yaw"),
    "Y_ur": ("sway", "surge", "yaw"),
    "N_uv": ("yaw", "surge", "sway"),
}
"""Coefficient -> equation it stands in, and the two velocities it goes with."""

SHARE = 0.2
"""Share of the largest force to begin from, at the largest speeds."""


class CoriolisCoupling(Effect):
    """``X_vr v r``, ``Y_ur u r``, ``N_uv u v``: rigid body and added mass (Miskovic, Vukic and Barisic, (4)).

    With masses ``m_u``, ``m_v``: ``X_vr = m_v``, ``Y_ur = -m_u``, ``N_uv = m_u - m_v`` (the Munk moment).
    """

    slug: ClassVar[str] = "coriolis-coupling"
    family: ClassVar[Family] = "hydrodynamics"
    meaning: ClassVar[str] = "momentum carried through a turn: the craft slides outwards, loses way and yaws with it"
    parameters: ClassVar[tuple[Quantity, ...]] = (
        Quantity("X_vr", "force s^2/(m rad)", "surge force per sway and yaw rate; the mass in sway"),
        Quantity("Y_ur", "force s^2/(m rad)", "sway force per surge and yaw rate; minus the mass in surge"),
        Quantity("N_uv", "moment s^2/m^2", "yaw moment per surge and sway (Munk)"),
    )
    shown_by: ClassVar[str] = "sway residual against u times r; surge residual in turns only"
    mistaken_for: ClassVar[tuple[str, ...]] = ("sway-yaw-coupling", "speed-dependent-steering", "steady-current")
    separated_by: ClassVar[str] = "turning circles both ways at two speeds ahead, and one turn on the spot"
    grows_with: ClassVar[tuple[str, ...]] = ("X_vr", "Y_ur", "N_uv")

    def places(self, scene: Scene) -> tuple[str, ...]:
        """Surge, sway and yaw together, where the base model has none of it; fewer have no product of two others."""
        form = scene.form
        missing = {"surge", "sway", "yaw"} - set(form.dofs)
        return () if missing or form.coriolis or set(TERMS) & set(form.parameters) else ("surge+sway+yaw",)

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """What the base's masses speak for; a fair share of the forces there are, all together and one by one.

        A base model without these forces has often put them into its masses, so the masses alone would mislead.
        """
        m_u, m_v = inertia_scale("surge", scene), inertia_scale("sway", scene)
        signs = {"X_vr": 1.0, "Y_ur": -1.0, "N_uv": 1.0 if m_u > m_v else -1.0}
        fair = {n: SHARE * sign * _per_speeds(n, scene) for n, sign in signs.items()}
        alone = tuple({n: (v if n == name else 0.0) for n, v in fair.items()} for name in TERMS)
        return ({"X_vr": m_v, "Y_ur": -m_u, "N_uv": m_u - m_v}, fair, *alone)

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """Masses are positive; the moment may have either sign."""
        return {"X_vr": (0.0, inf), "Y_ur": (-inf, 0.0), "N_uv": (-inf, inf)}

    def derivatives(self, own: Applied) -> Mapping[str, float]:
        """Themselves."""
        return {name: own[name] for name in TERMS}

    def unit_of(self, name: str, place: str, scene: Scene) -> str:
        """Force or moment per product of two speeds."""
        return f"{force_unit(TERMS[name][0], scene)} s^2/{'m^2' if name == 'N_uv' else '(m rad)'}"


def _per_speeds(name: str, scene: Scene) -> float:
    dof, first, second = TERMS[name]
    return force_scale(dof, scene) / (top_speed(first, scene) * top_speed(second, scene))
