"""Where a search begins for what no regression on the equations of motion can see: one table for all methods."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from gcs_autotune.models.coupled.compass import COEFFICIENTS
from gcs_autotune.models.coupled.derivatives import WALLS

__all__ = ["SPECIAL_START", "SpecialStart"]


class SpecialStart(NamedTuple):
    """A start value and how far from it the truth may well be (standard deviation), in the parameter's unit."""

    value: float
    spread: float


SPECIAL_START: Mapping[str, SpecialStart] = {
    "delay": SpecialStart(0.0, 0.2),
    "lag": SpecialStart(0.2, 0.3),
    **dict.fromkeys(("V_x", "V_y", "drift_x", "drift_y"), SpecialStart(0.0, 0.3)),
    **dict.fromkeys(COEFFICIENTS, SpecialStart(0.0, 0.1)),
    "reach": SpecialStart(1.0, 1.0),
    "bottom": SpecialStart(0.0, 3.0),
    **dict.fromkeys(WALLS, SpecialStart(0.0, 1.0)),
}
"""Name in ``derivatives.SPECIAL`` -> start. No delay, no current, a true compass, no wall; a lag a thruster may have
[s]; the bottom is felt a metre away, because in no reach at all it cannot be computed."""
