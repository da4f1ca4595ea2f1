"""Input bias: a constant force or moment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from gcs_autotune.effects.axes import force_scale, force_unit
from gcs_autotune.effects.effect import INPUT, Applied, Effect, Family, Quantity, Scene
from gcs_autotune.sname import DOFS

__all__ = ["InputBias"]


class InputBias(Effect):
    """A constant ``bias`` in one equation: trim, a tether's steady pull, a list. Heave has ``net-buoyancy`` instead."""

    slug: ClassVar[str] = "input-bias"
    family: ClassVar[Family] = "environment"
    meaning: ClassVar[str] = "a constant force or moment: trim, tether, list, an actuator off centre"
    parameters: ClassVar[tuple[Quantity, ...]] = (Quantity("bias", INPUT, "constant force, on the side of the input"),)
    grows_with: ClassVar[tuple[str, ...]] = ("bias",)
    shown_by: ClassVar[str] = "mean of the one-step residual; free run drifts to one side"
    mistaken_for: ClassVar[tuple[str, ...]] = ("asymmetric-thrust", "gyro-bias", "wind-moment", "steady-current")
    separated_by: ClassVar[str] = "a minute with no command at all, then the same manoeuvre on another heading"

    def places(self, scene: Scene) -> tuple[str, ...]:
        """Every degree of freedom but heave, unless the base model has a constant force there."""
        there = set(scene.form.parameters)
        return tuple(d for d in scene.form.dofs if d != "heave" and f"{DOFS[d].force}_0" not in there)

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """A tenth of the largest command, to be scaled: the effect is linear."""
        return ({"bias": 0.1 * force_scale(place, scene)},)

    def derivatives(self, own: Applied) -> Mapping[str, float]:
        """``X_0``, ``N_0`` and so on."""
        return {f"{DOFS[own.place].force}_0": own["bias"]}

    def unit_of(self, name: str, place: str, scene: Scene) -> str:
        """That of the force; of the input when forces are known as fractions or angles."""
        return force_unit(place, scene)
