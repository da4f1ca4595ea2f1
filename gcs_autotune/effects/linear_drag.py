"""Linear drag: drag that goes with speed."""

from __future__ import annotations

from typing import ClassVar

from gcs_autotune.effects.drag import Drag
from gcs_autotune.effects.effect import Quantity

__all__ = ["LinearDrag"]


class LinearDrag(Drag):
    """``- coefficient nu``: skin friction and wave making at low speed. Only where the base model has none."""

    slug: ClassVar[str] = "linear-drag"
    power: ClassVar[int] = 1
    polar: ClassVar[str] = "Linear drag"
    meaning: ClassVar[str] = "drag that goes with speed: slow motion dies out exponentially"
    parameters: ClassVar[tuple[Quantity, ...]] = (
        Quantity("coefficient", "force s/m or s/rad", "drag per speed, positive when it damps"),
    )
    shown_by: ClassVar[str] = "residual against speed: a straight line through zero, most telling at low speed"
    mistaken_for: ClassVar[tuple[str, ...]] = ("quadratic-drag", "dead-zone", "actuator-lag")
    separated_by: ClassVar[str] = "full speed, then no command until it lies still: the tail of the coasting tells"
