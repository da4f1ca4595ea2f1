"""Nomoto's indices of a yaw model, (4.49): K the steady rate per rudder angle, T how long it takes to get there."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.ship.readings import Reading

__all__ = ["Nomoto", "nomoto_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Nomoto:
    """``K`` [1/s per unit of input] and ``T`` [s]; ``K_prime`` = K L/U and ``T_prime`` = T U/L, NaN without L and U."""

    K: Reading
    T: Reading
    K_prime: Reading
    T_prime: Reading


def nomoto_of(theta: Array, covariance: Array, length: float = math.nan, speed: float = math.nan) -> Nomoto:
    """Return the indices of (alpha, beta, ...) with the standard errors of their covariance.

    length [m], speed [m/s] : for the dimensionless indices. Without constant drag K and T are not defined: NaN.
    """
    alpha, beta = float(theta[0]), float(theta[1])
    if beta == 0.0:
        none = Reading(math.nan, math.nan)
        return Nomoto(none, none, none, none)
    gradient_T = np.array([1.0 / beta, -alpha / beta**2])
    variance_T = float(gradient_T @ covariance[:2, :2] @ gradient_T)
    K = Reading(1.0 / beta, math.sqrt(max(float(covariance[1, 1]), 0.0)) / beta**2, "1/s")
    T = Reading(alpha / beta, math.sqrt(max(variance_T, 0.0)), "s")
    return Nomoto(K, T, K.scaled(length / speed, "1"), T.scaled(speed / length, "1"))
