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

from gcs_autotune.design.result import ReferenceModel
from gcs_autotune.models import SingleDof

__all__ = ["IpdGains", "Uncertainty", "design_ipd", "stability_bound", "uncertainty_of"]

CONFIDENCE = 1.96
"""Half-width of a 95 % interval of a normal distribution, in standard errors."""

MIN_UNCERTAINTY = 0.01
"""Smallest relative uncertainty of an identification that is assumed. Project choice."""

MAX_UNCERTAINTY = 0.95
"""Largest relative uncertainty that is assumed.

The relative errors must lie in (-1, 1) (Miskovic2010, eq. (8.19)-(8.20)).
"""


@dataclass(frozen=True, slots=True)
class IpdGains:
    """Gains of ``tau = KI int(e) - KP eta - (KD - beta_quadratic*|nu|) nu`` [input unit per rad or m]."""

    KI: float
    KP: float
    KD: float
    beta_quadratic: float


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """Relative errors that the loop must tolerate, as positive fractions: inertia ``p_alpha`` and drag ``p_beta``."""

    p_alpha: float
    p_beta: float


def design_ipd(model: SingleDof, wanted: ReferenceModel) -> IpdGains:
    """Return the I-PD gains that give *model* the closed loop *wanted* (Miskovic2010, eq. (8.5)).

    The linear drag is included in ``KD``, and the controller compensates the quadratic drag.
    """
    KI = model.alpha / wanted.a3
    return IpdGains(KI, wanted.a1 * KI, wanted.a2 * KI - model.beta, model.beta_quadratic)


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
    room = wanted.a2 / wanted.a3 - 1.0 / (wanted.a1 * (1.0 - p.p_alpha))
    allowed = (1.0 + p.p_beta) / p.p_beta * room
    if _is_nonlinear(model):
        return abs(velocity), model.alpha / model.beta_quadratic * allowed
    return model.beta / model.alpha, allowed


def _is_nonlinear(model: SingleDof) -> bool:
    return model.beta == 0.0 and model.beta_quadratic != 0.0


def _relative(value: float, std: float) -> float:
    if value == 0.0 or not math.isfinite(std):
        return MAX_UNCERTAINTY if std > 0.0 else MIN_UNCERTAINTY
    return min(max(CONFIDENCE * std / abs(value), MIN_UNCERTAINTY), MAX_UNCERTAINTY)
