"""The identified model as the control loop uses it: input in fractions of full output, with its 95 % region."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune import chi_square
from gcs_autotune.errors import NoGainsMeetSpec, UsageError
from gcs_autotune.models import SingleDof

__all__ = ["Region", "heavier", "in_fractions", "sample_region"]

PROBABILITY = 0.95
RANDOM_SAMPLES = 12
SEED = 20261120
MIN_INERTIA = 0.2
"""Smallest inertia of a sample, relative to the identified inertia. Project choice: the inertia must be positive."""


@dataclass(frozen=True, slots=True)
class Region:
    """The identified model, its covariance (5, 5), and samples on the edge of its 95 % region."""

    model: SingleDof
    covariance: NDArray[np.float64]
    samples: Sequence[SingleDof]


def in_fractions(
    model: SingleDof, covariance: NDArray[np.float64], full_scale: float | None
) -> tuple[SingleDof, NDArray[np.float64]]:
    """Return *model* and *covariance* converted to an input in fractions of full actuator output.

    full_scale : input of *model* at full output, in its unit. It is negative if full output acts in the opposite
        direction.

    Raises
    ------
    UsageError
        The model's input is not a fraction and *full_scale* is missing, or the covariance is unusable.
    NoGainsMeetSpec
        The craft responds to its actuator in the wrong direction, or not at all.
    """
    if covariance.shape != (5, 5) or not np.all(np.isfinite(covariance)):
        raise UsageError("the covariance must be a finite 5 x 5 matrix (alpha, beta, beta_quadratic, delta, delay)")
    if full_scale is None and model.input_unit != "1":
        raise UsageError(
            f"the model's input is in {model.input_unit}. Supply its full scale ({model.input_unit} at full output)"
        )
    scale = 1.0 if full_scale is None else full_scale
    if scale == 0.0 or not math.isfinite(scale):
        raise UsageError(f"the full scale must be a finite number other than zero, not {scale}")
    shrink = np.array([1.0 / scale] * 4 + [1.0])
    numbers = np.array(_numbers(model)) * shrink
    _check(model, numbers)
    fraction = replace(_rebuild(model, numbers), input_unit="1", restoring=model.restoring / scale)
    return fraction, covariance * np.outer(shrink, shrink)


def sample_region(model: SingleDof, covariance: NDArray[np.float64]) -> Region:
    """Return *model* with samples on the 95 % ellipsoid of its parameters: along its axes, and in fixed-seed
    directions.

    Samples that are not physical are moved to the nearest limit (positive inertia, drag that damps, no negative delay).
    """
    values, vectors = np.linalg.eigh(covariance)
    used = values > 1e-9 * max(float(values[-1]), 1e-300)
    if not np.any(used):
        return Region(model, covariance, ())
    axes = vectors[:, used] * np.sqrt(values[used])
    k = axes.shape[1]
    random = np.random.default_rng(SEED).standard_normal((RANDOM_SAMPLES, k))
    random /= np.linalg.norm(random, axis=1, keepdims=True)
    directions = np.vstack([np.eye(k), -np.eye(k), random])
    radius = math.sqrt(chi_square.quantile(PROBABILITY, k))
    points = np.array(_numbers(model)) + radius * directions @ axes.T
    return Region(model, covariance, tuple(_rebuild(model, _physical(model, p)) for p in points))


def heavier(region: Region, factor: float) -> Region:
    """Return *region* extended by copies of the model and of every sample with *factor* times the inertia, as with
    a payload.
    """
    if factor <= 1.0:
        return region
    more = tuple(replace(m, alpha=factor * m.alpha) for m in (region.model, *region.samples))
    return replace(region, samples=(*region.samples, *more))


def _numbers(model: SingleDof) -> tuple[float, float, float, float, float]:
    return (model.alpha, model.beta, model.beta_quadratic, model.delta, model.delay)


def _rebuild(model: SingleDof, numbers: NDArray[np.float64]) -> SingleDof:
    alpha, beta, beta_quadratic, delta, delay = (float(n) for n in numbers)
    return replace(model, alpha=alpha, beta=beta, beta_quadratic=beta_quadratic, delta=delta, delay=delay)


def _physical(model: SingleDof, numbers: NDArray[np.float64]) -> NDArray[np.float64]:
    least = np.array([MIN_INERTIA * model.alpha, min(model.beta, 0.0), min(model.beta_quadratic, 0.0), -math.inf, 0.0])
    moved: NDArray[np.float64] = np.maximum(numbers, least)
    return moved


def _check(model: SingleDof, numbers: NDArray[np.float64]) -> None:
    if not np.all(np.isfinite(numbers)):
        raise NoGainsMeetSpec(f"the {model.dof} model contains numbers that are not finite. Identify again")
    if numbers[0] <= 0.0:
        raise NoGainsMeetSpec(
            f"in the {model.dof} model the craft moves against its output (inertia {numbers[0]:.3g}). Check the "
            "actuator's direction (SERVOn_REVERSED, MOT_n_DIRECTION) before tuning"
        )
    if numbers[4] < 0.0:
        raise NoGainsMeetSpec(f"the {model.dof} model has a negative delay ({numbers[4]:.3g} s). Identify again")
    if abs(numbers[3]) >= 0.9:
        raise NoGainsMeetSpec(
            f"a constant force (trim, wind, weight) uses {abs(numbers[3]):.0%} of the {model.dof} actuator. Trim the "
            "craft first"
        )
