"""From the fit of throttle steps to what the design takes: the model with its thrust curve, and what is said of it."""

from __future__ import annotations

from gcs_autotune.design import Actuator, Reduction
from gcs_autotune.design.reduction import Remark
from gcs_autotune.identify import AxisFit
from gcs_autotune.identify.surge import CURVE, square_of

__all__ = ["reduction_of"]

STRAIGHT = 0.2
"""A bend of the thrust curve below this is not worth a word."""


def reduction_of(fit: AxisFit) -> Reduction | None:
    """Return the model of a surge fit with its thrust curve; None when it has none."""
    if CURVE not in fit.extra:
        return None
    square = square_of(fit)
    curve = Remark(
        "quadratic-actuator",
        fit.model.axis.force,
        f"thrust goes by {square:.0%} with the square of the throttle; the margins hold at both ends of the step",
        f"MOT_THST_EXPO about {min(max(square, -1.0), 1.0):.2f} would straighten it (then tune again)",
    )
    remarks = (curve,) if abs(square) > STRAIGHT else ()
    return Reduction(fit.model, fit.model.axis.force, fit.craft_covariance, Actuator(square=square), remarks=remarks)
