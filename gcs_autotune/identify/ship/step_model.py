"""Several steps at once: one model from all their readings, weighted by what each is worth.

Two residuals a step, each zero when the model is right: the balance at the steady velocity,
``tau + Delta - (beta + beta_nn*|k_ss|)*k_ss``, and the lag ``(eta_0 - eps_v) - lag(model)`` (or the time to the knee).
With one step, one drag and no Delta this is Miskovic2010, table 4.1 exactly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.result import Structure
from gcs_autotune.identify.ship.step_table import lag, time_to
from gcs_autotune.identify.ship.steps import StepReading

__all__ = ["StepModel", "fit_readings"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class StepModel:
    """``theta`` = (alpha, beta, beta_quadratic, Delta), its covariance (4, 4), which of them were fitted, the misfit.

    ``chi2`` is the sum of squared residuals over their standard errors; ``spare`` the readings beyond parameters.
    ``covariance`` is raised by chi2/spare when that exceeds 1: the steps then differ by more than their noise.
    """

    structure: Structure
    theta: Array
    covariance: Array
    fitted: tuple[bool, bool, bool, bool]
    chi2: float
    spare: int

    @property
    def scatter(self) -> float:
        """Factor by which the steps differ beyond their noise, at least 1."""
        return math.sqrt(max(self.chi2 / self.spare, 1.0)) if self.spare > 0 else 1.0


def fit_readings(readings: Sequence[StepReading], structure: Structure) -> StepModel:
    """Fit one model to all readings.

    ``Delta`` is fitted when the steady readings suffice for it; with a single level it is taken as 0, as Miskovic2010
    does.

    Raises
    ------
    NotInformative
        No reading tells the inertia, or too few levels for the drags asked for.
    """
    if not any(r.has_lag or r.has_knee for r in readings):
        raise NotInformative("no step starts from a known velocity: its inertia cannot be read; record before the step")
    drags = 2 if structure == "affine" else 1
    levels = _levels(readings)
    if levels < drags:
        raise NotInformative(f"{levels} level(s) of input cannot tell {drags} drags: step to more levels")
    fitted = (True, structure != "nonlinear", structure != "linear", levels > drags)
    theta = _steady_part(readings, fitted)
    theta[0] = _inertia(readings, theta)
    free = np.flatnonzero(fitted)
    for _ in range(3):
        whiteners = [_whitener(r, theta) for r in readings]
        scale = np.where(theta[free] != 0.0, np.abs(theta[free]), max(np.max(np.abs([r.tau for r in readings])), 1e-9))

        def residual(x: Array, at: Array = theta, units: Array = scale, w: Sequence[Array] = whiteners) -> Array:
            moved = at.copy()
            moved[free] = x * units
            return np.concatenate([m @ _errors(r, moved) for r, m in zip(readings, w, strict=True)])

        found = least_squares(residual, theta[free] / scale, method="trf", x_scale=1.0)
        theta = theta.copy()
        theta[free] = found.x * scale
    jacobian = np.asarray(found.jac, dtype=float)
    information = jacobian.T @ jacobian
    chi2, spare = 2.0 * float(found.cost), len(found.fun) - len(free)
    covariance = np.zeros((4, 4))
    small = np.linalg.pinv(information) * np.outer(scale, scale)
    covariance[np.ix_(free, free)] = small * (max(chi2 / spare, 1.0) if spare > 0 else 1.0)
    return StepModel(structure, theta, covariance, fitted, chi2, spare)


def _levels(readings: Sequence[StepReading]) -> int:
    """Return how many different inputs were held, to a fiftieth of their range."""
    taus = np.sort([r.tau for r in readings])
    span = max(float(np.max(np.abs(taus))), 1e-300)
    return 1 + int(np.sum(np.diff(taus) > 0.02 * span))


def _steady_part(readings: Sequence[StepReading], fitted: tuple[bool, ...]) -> Array:
    """Return (0, beta, beta_quadratic, Delta) from the steady velocities by plain least squares."""
    k = np.array([r.k_ss.value for r in readings])
    table = np.column_stack([k, np.abs(k) * k, -np.ones_like(k)])[:, list(fitted[1:])]
    theta = np.zeros(4)
    tau = np.array([r.tau for r in readings])
    theta[np.flatnonzero(fitted[1:]) + 1] = np.linalg.lstsq(table, tau, rcond=None)[0]
    return theta


def _inertia(readings: Sequence[StepReading], theta: Array) -> float:
    """Return the median inertia of the steps at these drags."""
    values = []
    for r in readings:
        unit = _dynamics(r, np.array([1.0, *theta[1:]]))
        if unit is not None and abs(unit) > 0.0 and math.isfinite(unit):
            values.append((r.lag.value if r.has_lag else r.knee.value) / unit)
    return float(np.median(values)) if values else 1.0


def _dynamics(r: StepReading, theta: Array) -> float | None:
    """Return the lag or the time to the knee that a model predicts; None when there is none to compare with."""
    drags = (float(theta[1]), float(theta[2]))
    force = r.tau + float(theta[3])
    if r.has_lag:
        return lag(float(theta[0]), drags, force, r.nu_0.value)
    return time_to(float(theta[0]), drags, force, r.nu_0.value, r.level) if r.has_knee else None


def _errors(r: StepReading, theta: Array) -> Array:
    k = r.k_ss.value
    balance = r.tau + theta[3] - (theta[1] + theta[2] * abs(k)) * k
    predicted = _dynamics(r, theta)
    if predicted is None:
        return np.array([balance])
    return np.array([balance, (r.lag.value if r.has_lag else r.knee.value) - predicted])


def _whitener(r: StepReading, theta: Array) -> Array:
    """Return the matrix that makes a step's residuals uncorrelated with unit variance."""
    std, slope = r.k_ss.std, abs(theta[1] + 2.0 * theta[2] * abs(r.k_ss.value))
    least = 1e-9 * max(abs(r.tau), float(np.max(np.abs(theta[1:3]))) * abs(r.k_ss.value), 1e-12)
    force = (slope * std) ** 2 + 2.0 * (theta[2] * std**2) ** 2 + least**2
    predicted = _dynamics(r, theta)
    if predicted is None:
        return np.array([[1.0 / math.sqrt(force)]])
    reading = r.lag if r.has_lag else r.knee
    variance = reading.std**2 + (_sensitivity(r, theta) * r.nu_0.std) ** 2 + (1e-9 * abs(predicted)) ** 2
    sign = math.copysign(1.0, theta[1] + theta[2])
    shared = -sign * slope * r.shared if r.has_lag else 0.0
    covariance = np.array([[force, shared], [shared, variance]])
    result: Array = np.linalg.inv(np.linalg.cholesky(covariance))
    return result


def _sensitivity(r: StepReading, theta: Array) -> float:
    """Return how the predicted lag changes with the velocity at the step."""
    h = max(abs(r.k_ss.value) * 1e-4, 1e-9)
    drags, force = (float(theta[1]), float(theta[2])), r.tau + float(theta[3])
    if r.has_lag:
        low, high = (lag(float(theta[0]), drags, force, r.nu_0.value + d) for d in (-h, h))
    else:
        low, high = (time_to(float(theta[0]), drags, force, r.nu_0.value + d, r.level) for d in (-h, h))
    return (high - low) / (2.0 * h)
