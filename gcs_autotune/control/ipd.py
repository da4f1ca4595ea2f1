"""The controller of Miskovic2010: I-PD by reference model, and the model error that it tolerates.

The control law is Miskovic2010, section 8.1, (8.2), with gains (8.5)-(8.7) and stability bounds (8.22)-(8.27).
ArduPilot's loops are cascades, not I-PD. If a cascade matches a reference model exactly, it has the characteristic
polynomial of the reference model. The bounds then give the identification error that this polynomial tolerates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.control.feedback import FeedbackLaw
from gcs_autotune.control.reference_model import ReferenceModel
from gcs_autotune.control.structure import STRUCTURES
from gcs_autotune.models import SingleDof
from gcs_autotune.notebook import Displayed
from gcs_autotune.rounding import HALF_WIDTH
from gcs_autotune.sname import DOFS

__all__ = [
    "Uncertainty",
    "design_ipd",
    "drag_speed_limit",
    "least_inertia_ratio",
    "stability_bound",
    "uncertainty_of",
]

MIN_UNCERTAINTY = 0.01
"""Smallest relative uncertainty of an identification that is assumed. Project choice."""

MAX_UNCERTAINTY = 0.95
"""Largest relative uncertainty that is assumed.

The relative errors must lie in (-1, 1) (Miskovic2010, eq. (8.19)-(8.20)).
"""


@dataclass(frozen=True, slots=True)
class Uncertainty(Displayed):
    """Relative errors that the loop must tolerate, as positive fractions: inertia ``p_alpha`` and drag ``p_beta``."""

    p_alpha: float
    p_beta: float


def design_ipd(model: SingleDof, wanted: ReferenceModel, uncertainty: Uncertainty | None = None) -> FeedbackLaw:
    """Return the I-PD law that gives *model* the closed loop *wanted*; Miskovic2010, eq. (8.5).

    The linear drag is included in ``K_D``. The quadratic drag is compensated during motion, up to the speed at which
    the loop is stable for every error within *uncertainty* (8.26). ``delta`` is compensated as the known disturbance.
    """
    K_I = model.alpha / wanted.a3
    speed = math.inf
    if uncertainty is not None and model.beta_quadratic > 0.0:
        speed = drag_speed_limit(model, wanted, uncertainty)
    return FeedbackLaw(
        STRUCTURES["I-PD"],
        K_P=wanted.a1 * K_I,
        K_I=K_I,
        K_D=wanted.a2 * K_I - model.beta,
        drag=model.beta_quadratic,
        drag_speed=speed,
        disturbance=model.delta,
        is_angle=DOFS[model.dof].angular,
    )


def drag_speed_limit(model: SingleDof, wanted: ReferenceModel, p: Uncertainty) -> float:
    """Return the speed [rad/s or m/s] up to which quadratic drag may be compensated, Miskovic2010, eq. (8.26).

    Zero where the reference model is not stable for every error within *p*.
    """
    return max(model.alpha / model.beta_quadratic * _allowed(wanted, p), 0.0)


def uncertainty_of(model: SingleDof, covariance: NDArray[np.float64]) -> Uncertainty:
    """Return the 95 % relative errors of inertia and of the dominant drag.

    covariance : (5, 5) covariance of (alpha, beta, beta_quadratic, delta, delay).
    """
    std = np.sqrt(np.clip(np.diag(covariance), 0.0, None))
    drag, drag_std = (model.beta_quadratic, std[2]) if _is_nonlinear(model) else (model.beta, std[1])
    return Uncertainty(_relative(model.alpha, float(std[0])), _relative(drag, float(drag_std)))


def stability_bound(model: SingleDof, wanted: ReferenceModel, p: Uncertainty, velocity: float) -> tuple[float, float]:
    """Return the left and right sides of the stability condition.

    The loop is stable for every error within *p* if left < right.

    For constant drag, ``beta/alpha`` is compared with (8.22). For drag that increases with velocity, the largest
    |*velocity*| [rad/s or m/s] of the manoeuvre is compared with (8.26). The affine cases (8.24) and (8.28) are less
    strict than (8.22) and (8.26). ``p = (0.1, 0.2)`` gives (8.23) and (8.27).
    """
    if _is_nonlinear(model):
        return abs(velocity), model.alpha / model.beta_quadratic * _allowed(wanted, p)
    return model.beta / model.alpha, _allowed(wanted, p)


def least_inertia_ratio(wanted: ReferenceModel) -> float:
    """Return the smallest estimated/true inertia with a stable loop, Miskovic2010, eq. (8.15)."""
    return wanted.a3 / (wanted.a2 * wanted.a1)


def _allowed(wanted: ReferenceModel, p: Uncertainty) -> float:
    """Return the largest drag over inertia [1/s] that (8.22) and (8.26) allow."""
    return (1.0 + p.p_beta) / p.p_beta * (wanted.a2 / wanted.a3 - 1.0 / (wanted.a1 * (1.0 - p.p_alpha)))


def _is_nonlinear(model: SingleDof) -> bool:
    return model.beta == 0.0 and model.beta_quadratic != 0.0


def _relative(value: float, std: float) -> float:
    if value == 0.0 or not math.isfinite(std):
        return MAX_UNCERTAINTY if std > 0.0 else MIN_UNCERTAINTY
    return min(max(HALF_WIDTH * std / abs(value), MIN_UNCERTAINTY), MAX_UNCERTAINTY)
