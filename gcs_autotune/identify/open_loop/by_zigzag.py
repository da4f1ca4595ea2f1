"""The method ``zig-zag``: inertia and drag of yaw from integrals over half periods.

Source: Miskovic2010, eq. (4.51)-(4.53).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.axis.form import FREE, Structure
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.method import Method
from gcs_autotune.identify.open_loop.answer import axis_answer
from gcs_autotune.identify.open_loop.readings import Reading
from gcs_autotune.identify.open_loop.zigzag_integrals import IntegralRows, half_periods, rows_of, solve_rows
from gcs_autotune.identify.result import AxisFit

__all__ = ["METHOD", "Nomoto", "fit_by_zigzag", "nomoto_of", "solve_zigzag"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Nomoto:
    """Nomoto's indices with their standard errors.

    - ``K`` [1/s per unit of input], ``T`` [s]: gain and time constant of yaw.
    - ``K_prime`` = K L/U, ``T_prime`` = T U/L: dimensionless indices, NaN without length L and speed U.
    """

    K: Reading
    T: Reading
    K_prime: Reading
    T_prime: Reading


def nomoto_of(theta: Array, covariance: Array, length: float = math.nan, speed: float = math.nan) -> Nomoto:
    """Return Nomoto's indices for the parameters *theta* (alpha, beta, ...), with standard errors from *covariance*.

    length, speed : length [m] and speed [m/s] of the craft, for the dimensionless indices.

    Without linear drag K and T are not defined and are NaN.
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


CLEAR = 3.0
"""Smallest distance from zero, in standard errors, of an omitted drag for which a doubt is raised. Project choice."""

WORSE = 2.0
"""Factor by which the weighted misfit must also increase without the omitted drag for a doubt to be raised.

Project choice.
"""


def fit_by_zigzag(case: Case) -> AxisFit:
    """Return the fit of yaw from the zig-zags in *case*.

    The structure is ``linear`` (Nomoto's) unless another is requested. ``Delta``, the rudder bias, is fitted if there
    are enough half periods.

    ``extra`` contains ``K`` and ``T`` with standard errors. With the options ``length`` [m] and ``speed`` [m/s] it
    contains ``K_prime`` and ``T_prime`` too. ``half_periods`` lists the results of (4.52) and (4.53) for each half
    period.

    Raises
    ------
    NotInformative
        There is no zig-zag with a measured heading, or there are too few half periods for the structure.
    """
    every = [rows for record in case.records if (rows := rows_of(record, case.delay or 0.0)) is not None]
    if not every:
        raise NotInformative(
            f"run '{case.names[0]}' contains no zig-zag with two reversals and a heading sampled often enough. Use "
            "method='output-error' for other inputs"
        )
    structure: Structure = case.structure or "linear"
    theta, covariance, error, free = solve_zigzag(every, structure)
    doubts = [*_doubts(every, structure, theta, covariance, free)]
    if not free[3]:
        doubts.append(
            Doubt(
                "no-bias",
                "too few half periods to fit a helm bias. No bias was assumed",
                "fly more half periods",
            )
        )
    if theta[1] * theta[0] < 0.0 and structure == "linear":
        doubts.append(
            Doubt(
                "unstable-craft",
                "inertia and drag have opposite signs. The craft is course-unstable with the helm amidships, so "
                "its linear model diverges",
                "use structure='affine', whose quadratic drag limits the turn rate. Fly a spiral to measure the "
                "instability loop",
            )
        )
    made = nomoto_of(theta, covariance, _number(case, "length"), _number(case, "speed"))
    extra = {
        **_named(made),
        "half_periods": [asdict(h) for rows in every for h in half_periods(rows)],
        "model_error_per_half_period": error,
    }
    return axis_answer(case, "zig-zag", structure, theta, covariance, free, doubts, extra)


def _number(case: Case, name: str) -> float:
    return float(case.options.get(name, math.nan))


def _named(made: Nomoto) -> dict[str, float]:
    names = {"K": made.K, "T": made.T, "K_prime": made.K_prime, "T_prime": made.T_prime}
    values = {n: r.value for n, r in names.items()}
    return {**values, **{f"{n}_std": r.std for n, r in names.items()}}


def solve_zigzag(every: Sequence[IntegralRows], structure: Structure) -> tuple[Array, Array, float, tuple[bool, ...]]:
    """Return theta (4,), its covariance (4, 4), the model error per row [impulse], and which parameters were fitted
    (4,).

    theta contains alpha, beta, beta_quadratic and Delta.

    Raises
    ------
    NotInformative
        There are too few half periods for the structure.
    """
    count = sum(len(rows.impulse) for rows in every)
    drags = FREE[structure][:3]
    free = (*drags, count > sum(drags) + 1)
    if count <= sum(free):  # no degree of freedom left to judge the fit
        raise NotInformative(
            f"{count} half-period equations do not determine structure '{structure}'. Fly more half periods"
        )
    theta, covariance, error, _ = solve_rows(every, free)
    return theta, covariance, error, free


def _doubts(
    every: Sequence[IntegralRows], structure: Structure, theta: Array, covariance: Array, free: Sequence[bool]
) -> list[Doubt]:
    doubts = []
    count = sum(len(rows.impulse) for rows in every)
    if structure != "affine" and count > 5:
        missing = 2 if structure == "linear" else 1
        other, spread, _, misfit = solve_rows(every, (True, True, True, free[3]))
        clear = abs(other[missing]) / max(math.sqrt(max(float(spread[missing, missing]), 0.0)), 1e-300)
        if clear > CLEAR and solve_rows(every, free)[3] > WORSE * misfit:
            kind = "nonlinear" if structure == "linear" else "linear"
            doubts.append(
                Doubt(
                    f"{kind}-drag",
                    f"the half periods also show {kind} drag ({clear:.0f} standard errors). The fit is therefore "
                    "valid only for this helm",
                    "use structure='affine' to fit both, or method='output-error' to choose",
                )
            )
    if count - sum(free) < 3:
        doubts.append(
            Doubt(
                "few-half-periods",
                f"{count} equations for {sum(free)} parameters are too few, so the standard errors are unreliable",
                "fly on",
            )
        )
    return doubts


METHOD = Method(
    "zig-zag",
    "K and T by integration over half periods (Miskovic2010, 4.4)",
    axis=fit_by_zigzag,
    options=(("length", "ship length [m], for K' and T'"), ("speed", "approach speed [m/s], for K' and T'")),
)
