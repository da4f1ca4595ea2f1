"""Advance-speed loss: a propeller pushes less, the faster the water already flows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from gcs_autotune.effects.actuator import Actuator
from gcs_autotune.effects.effect import Applied, Curve, Quantity, Scene
from gcs_autotune.models.coupled.derivatives import FORCES, STATES
from gcs_autotune.sname import DOFS, SIGNALS, Dof

__all__ = ["AdvanceSpeedLoss"]

GAIN, AXIS = "gain", "axis"
"""Constants: magnitude of the base model's force per input, and which force (0 to 5: X Y Z K M N)."""

RUDDER = "rad"
"""Inputs of this unit are angles, not thrusters."""

PER_SPEED = "s/m or s/rad"


class AdvanceSpeedLoss(Actuator):
    """The force of a thruster is lowered by ``loss |force| nu``: the bilinear thruster.

    Miskovic2010, (2.4): ``T_|n|n |n| n - T_|n|u_a |n| u_a``; ZhaoUSV, eq. (4). ``nu`` is the velocity
    through the water along the thruster's axis, which must drive one degree of freedom only. It is a term ``X_|X|u`` of
    the equations of motion and sees what acts, whatever other effects made of the command. Where the input's gain is
    fitted, the force meant is that of the base model's gain.
    """

    slug: ClassVar[str] = "advance-speed-loss"
    meaning: ClassVar[str] = (
        "a propeller loses thrust with the speed of the water it works in: strong from rest, weak at speed"
    )
    parameters: ClassVar[tuple[Quantity, ...]] = (
        Quantity("loss", PER_SPEED, "share of the thrust lost per speed ahead, gained per speed astern"),
    )
    grows_with: ClassVar[tuple[str, ...]] = ("loss",)
    shown_by: ClassVar[str] = "residual against speed, under power: grows with the speed; none while drifting to a stop"
    mistaken_for: ClassVar[tuple[str, ...]] = ("linear-drag", "quadratic-drag", "saturation")
    separated_by: ClassVar[str] = (
        "steady speed at half and at full command, each followed by drifting to a stop with no command: the loss acts "
        "under power only and brakes more at full command, drag acts all the time"
    )

    def places(self, scene: Scene) -> tuple[str, ...]:
        """Every thruster along one simulated axis."""
        return tuple(n for n in super().places(scene) if _axis(n, scene) is not None and scene.inputs[n] != RUDDER)

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """A fifth and two thirds of the thrust at the highest speed."""
        return tuple({"loss": share / _fastest(place, scene)} for share in (0.2, 0.67))

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """No gain with speed; at the highest speed at most a few times what it gives from rest."""
        return {"loss": (0.0, 4.0 / _fastest(place, scene))}

    def constants(self, place: str, scene: Scene) -> Mapping[str, float]:
        """The gain of the input, and which axis it drives."""
        ((force, gain),) = scene.form.inputs[place]
        size = abs(scene.base.get(gain.lstrip("-"), 1.0)) if isinstance(gain, str) else abs(gain)
        return {GAIN: size, AXIS: float(FORCES.index(force))}

    def derivatives(self, own: Applied) -> Mapping[str, float]:
        """``X_|X|u`` and so on."""
        i = int(own[AXIS])
        return {f"{FORCES[i]}_|{own.place}|{STATES[i]}": -own["loss"] * own[GAIN]}

    def curve(self, own: Applied, scene: Scene) -> Curve:
        """Force at full command over speed ahead."""
        force, velocity = FORCES[int(own[AXIS])], STATES[int(own[AXIS])]
        nu = np.linspace(0.0, _fastest(own.place, scene), 101)
        rest = np.full_like(nu, own[GAIN] * scene.swing[own.place])
        unit = scene.inputs[own.place] if own[GAIN] == 1.0 else SIGNALS[force][0]
        x_label, y_label = f"{velocity} [{SIGNALS[velocity][0]}]", f"{force} at full {own.place} [{unit}]"
        return Curve(nu, rest * (1.0 - own["loss"] * nu), x_label, y_label, "Thrust over speed", plain=rest)

    def unit_of(self, name: str, place: str, scene: Scene) -> str:
        """Seconds per metre, or per radian."""
        dof = _axis(place, scene)
        return "s/rad" if dof is not None and dof.angular else "s/m"


def _axis(place: str, scene: Scene) -> Dof | None:
    """Return the only degree of freedom an input drives, None when it drives none or several."""
    pairs = scene.form.inputs.get(place, ())
    driven = [DOFS[d] for d in scene.form.dofs for force, _ in pairs if DOFS[d].force == force]
    return driven[0] if len(pairs) == 1 and len(driven) == 1 else None


def _fastest(place: str, scene: Scene) -> float:
    """Return the highest speed along an input's axis: measured, or guessed from how far the position goes."""
    dof = _axis(place, scene)
    if dof is None:
        return 1.0
    if dof.velocity in scene.extent:
        found = max(abs(v) for v in scene.extent[dof.velocity])
    else:
        spread = scene.spread.get(dof.position, 1.0)
        found = spread / min(scene.pace, scene.duration)
    return max(found, 1e-9)
