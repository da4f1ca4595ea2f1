"""The method ``zig-zag``: inertia and drag of yaw by integrating over half periods, (4.51)-(4.53)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.axis.case import Case
from gcs_autotune.identify.axis.structure import FREE
from gcs_autotune.identify.result import AxisFit, Doubt, Structure
from gcs_autotune.identify.ship.answer import axis_answer
from gcs_autotune.identify.ship.nomoto import Nomoto, nomoto_of
from gcs_autotune.identify.ship.zigzag_integrals import Rows, half_periods, rows_of, solve_rows

__all__ = ["fit_by_zigzag", "solve_zigzag"]

Array = NDArray[np.float64]

CLEAR = 3.0
"""Standard errors of the drag left out from zero at which it draws a doubt."""

WORSE = 2.0
"""Factor by which the weighted misfit must grow without it, for the same."""


def fit_by_zigzag(case: Case) -> AxisFit:
    """Identify yaw from zig-zags.

    The structure is ``linear`` (Nomoto's) unless another is asked for. ``Delta``, the rudder bias, is fitted when
    there are rows enough. ``extra``: ``K``, ``T`` with standard errors, ``K_prime``, ``T_prime`` with the options
    ``length`` [m] and ``speed`` [m/s]; ``half_periods`` the plain (4.52) and (4.53) of each.

    Raises
    ------
    NotInformative
        No zig-zag with a measured heading, or too few half periods for the structure.
    """
    every = [rows for record in case.records if (rows := rows_of(record, case.delay or 0.0)) is not None]
    if not every:
        raise NotInformative(
            f"run '{case.names[0]}' holds no zig-zag with two reversals and a heading sampled often enough; use "
            "method='output-error' for any other input"
        )
    structure: Structure = case.structure or "linear"
    theta, covariance, error, free = solve_zigzag(every, structure)
    doubts = [*_doubts(every, structure, theta, covariance, free)]
    if not free[3]:
        doubts.append(
            Doubt("no-bias", "too few half periods to fit a rudder bias; none was assumed", "fly more half periods")
        )
    if theta[1] * theta[0] < 0.0 and structure == "linear":
        doubts.append(
            Doubt(
                "unstable-craft",
                "inertia and drag differ in sign: with the rudder amidships the craft does not keep its course; a "
                "linear model of it runs away",
                "structure='affine' adds the drag that stops it; fly a spiral to measure the loop",
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


def solve_zigzag(every: Sequence[Rows], structure: Structure) -> tuple[Array, Array, float, tuple[bool, ...]]:
    """Return theta (4,), its covariance (4, 4), the model's error per row and what was fitted.

    Raises
    ------
    NotInformative
        Too few half periods for the structure.
    """
    count = sum(len(rows.impulse) for rows in every)
    drags = FREE[structure][:3]
    free = (*drags, count > sum(drags) + 1)
    if count <= sum(free):  # nothing left to tell how well they fit
        raise NotInformative(
            f"{count} half-period equations cannot tell structure '{structure}': fly more half periods"
        )
    theta, covariance, error, _ = solve_rows(every, free)
    return theta, covariance, error, free


def _doubts(
    every: Sequence[Rows], structure: Structure, theta: Array, covariance: Array, free: Sequence[bool]
) -> list[Doubt]:
    found = []
    count = sum(len(rows.impulse) for rows in every)
    if structure != "affine" and count > 5:
        missing = 2 if structure == "linear" else 1
        other, spread, _, misfit = solve_rows(every, (True, True, True, free[3]))
        clear = abs(other[missing]) / max(math.sqrt(max(float(spread[missing, missing]), 0.0)), 1e-300)
        if clear > CLEAR and solve_rows(every, free)[3] > WORSE * misfit:
            kind = "nonlinear" if structure == "linear" else "linear"
            found.append(
                Doubt(
                    f"{kind}-drag",
                    f"the half periods ask for {kind} drag too ({clear:.0f} standard errors); what was fitted holds "
                    "for this rudder angle only",
                    "structure='affine' fits both; method='output-error' decides",
                )
            )
    if count - sum(free) < 3:
        found.append(
            Doubt("few-half-periods", f"{count} equations for {sum(free)} numbers: errors are guesses", "fly on")
        )
    return found
