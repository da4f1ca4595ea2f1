"""What effects on a degree of freedom ask about it: names, units, and sizes to begin from.

Behind a rudder the base model's moment is told in rudder angle, and a rudder whose positive angle turns to port makes
inertia and drag come out negative. :func:`sense` is -1 then, so that "damps" and "pulls back" keep their meaning.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects.effect import Applied, Curve, Scene
from gcs_autotune.sname import DOFS

__all__ = [
    "drag_names",
    "drag_polar",
    "force_scale",
    "force_unit",
    "inertia_scale",
    "sense",
    "sense_of",
    "stiffness_unit",
    "top_speed",
]

Array = NDArray[np.float64]

RIGID_BODY = {"surge": "m", "sway": "m", "heave": "m", "roll": "I_x", "pitch": "I_y", "yaw": "I_z"}
"""Rigid-body inertia per degree of freedom."""


def drag_names(dof: str) -> tuple[str, str]:
    """Return the derivatives of linear and quadratic drag, ``("N_r", "N_rr")`` for yaw."""
    d = DOFS[dof]
    return f"{d.force}_{d.velocity}", f"{d.force}_{d.velocity}{d.velocity}"


def _known(scene: Scene) -> Mapping[str, float]:
    return {**scene.form.start, **scene.form.known, **scene.base}


def _drives(dof: str, scene: Scene) -> Iterator[tuple[str, float | str]]:
    """Yield (channel, gain) of every input that drives *dof*."""
    for channel, pairs in scene.form.inputs.items():
        for force, gain in pairs:
            if force == DOFS[dof].force:
                yield channel, gain


def force_unit(dof: str, scene: Scene) -> str:
    """Return the unit of the force in that equation: the input's where it drives with a known gain, else SI."""
    for channel, gain in _drives(dof, scene):
        if not isinstance(gain, str):
            return scene.inputs.get(channel, "1")
    if DOFS[dof].force in scene.form.per_inertia:
        return "rad/s^2" if DOFS[dof].angular else "m/s^2"
    if scene.form.normalised:
        return "1"
    return "N m" if DOFS[dof].angular else "N"


def stiffness_unit(dof: str, scene: Scene) -> str:
    """Return force per metre or radian."""
    return f"{force_unit(dof, scene)}/{DOFS[dof].position_unit}"


def force_scale(dof: str, scene: Scene) -> float:
    """Return a size forces in that equation have: what drives it at most, else what its motion takes."""
    known, total = _known(scene), 0.0
    for channel, gain in _drives(dof, scene):
        size = abs(known.get(gain.lstrip("-"), 1.0)) if isinstance(gain, str) else abs(gain)
        total += size * scene.swing.get(channel, 0.0)
    return total or inertia_scale(dof, scene) * top_speed(dof, scene) / max(scene.pace, scene.interval)


def inertia_scale(dof: str, scene: Scene) -> float:
    """Return the magnitude of the base's inertia, 1 when it is not known."""
    return abs(_inertia(dof, scene)) or 1.0


def _inertia(dof: str, scene: Scene) -> float:
    known, d = _known(scene), DOFS[dof]
    return known.get(RIGID_BODY[dof], 0.0) - known.get(f"{d.force}_{d.velocity}dot", 0.0)


def sense(dof: str, scene: Scene) -> dict[str, float]:
    """Return the constant ``sense``: the sign of the base's inertia."""
    return {"sense": -1.0 if _inertia(dof, scene) < 0.0 else 1.0}


def sense_of(own: Applied) -> float:
    """Return the constant ``sense``, 1 where there is none."""
    return own.constants.get("sense", 1.0)


def top_speed(dof: str, scene: Scene) -> float:
    """Return the largest speed recorded, else what the positions recorded speak for; 1 when neither tells."""
    d = DOFS[dof]
    fastest = max((abs(e) for e in scene.extent.get(d.velocity, ())), default=0.0)
    return fastest or 2.0 * scene.spread.get(d.position, 0.0) / max(scene.pace, scene.interval) or 1.0


def drag_polar(own: Applied, scene: Scene, title: str) -> Curve:
    """Return drag over speed with the base's drag and the effect's, against the base's alone."""
    d = DOFS[own.place]
    linear, quadratic = drag_names(own.place)
    known, sign = _known(scene), sense_of(own)
    nu = np.linspace(-1.0, 1.0, 121) * top_speed(own.place, scene)
    plain = -sign * (known.get(linear, 0.0) + known.get(quadratic, 0.0) * np.abs(nu)) * nu
    more = own["coefficient"] * (nu if own.slug == "linear-drag" else np.abs(nu) * nu)
    velocity = f"{d.velocity} [{d.position_unit}/s]"
    return Curve(nu, plain + more, velocity, f"drag [{force_unit(own.place, scene)}]", title, plain=plain)
