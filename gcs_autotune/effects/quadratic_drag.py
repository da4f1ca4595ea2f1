"""Quadratic drag: drag that goes with the square of speed."""

from __future__ import annotations

from typing import ClassVar

from gcs_autotune.effects.drag import Drag
from gcs_autotune.effects.effect import Quantity

__all__ = ["QuadraticDrag"]


class QuadraticDrag(Drag):
    """``- coefficient |nu| nu``: pressure drag of the water shed at higher speed (Miskovic2010 (6.33), ``beta_nn``)."""

    slug: ClassVar[str] = "quadratic-drag"
    power: ClassVar[int] = 2
    polar: ClassVar[str] = "Drag polar"
    meaning: ClassVar[str] = "drag that goes with the square of speed: twice the force gives less than twice the speed"
    parameters: ClassVar[tuple[Quantity, ...]] = (
        Quantity("coefficient", "force s^2/m^2 or s^2/rad^2", "drag per squared speed, positive when it damps"),
    )
    shown_by: ClassVar[str] = (
        "residual against speed: an S: the simulation is too slow at low speed and too fast at high"
    )
    mistaken_for: ClassVar[tuple[str, ...]] = ("saturation", "quadratic-actuator", "linear-drag", "rudder-stall")
    separated_by: ClassVar[str] = "steps of three sizes each way, held until the speed settles, each left to coast down"
