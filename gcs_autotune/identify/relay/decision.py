"""Linear or quadratic damping? The decision from two experiments, Miskovic2010, eq. (7.1)-(7.2).

The structure whose coefficient scatters less between two different limit cycles describes the craft better;
the scatter of ``alpha``, which is the same in both structures, measures how sure one can be.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import combinations
from typing import Literal

from gcs_autotune.identify.result import Decision, IsoEstimate
from gcs_autotune.registry import lookup

__all__ = ["MARGINS", "decide", "most_different_pair"]

MARGINS: Mapping[str, Callable[[float], float]] = {
    "none": lambda sigma_alpha: 0.0,
    "sigma": lambda sigma_alpha: sigma_alpha,
    "sigma+5": lambda sigma_alpha: sigma_alpha + 5.0,
    "sigma+10": lambda sigma_alpha: sigma_alpha + 10.0,
}
"""Name -> margin lambda [%] as a function of sigma_alpha [%]; Miskovic2010, 7.1, criteria 1 to 4."""


def decide(one: IsoEstimate, other: IsoEstimate, margin: str = "sigma") -> Decision:
    """Decide between linear (``linear``) and quadratic damping (``nonlinear``).

    Raises
    ------
    UnknownName
        When *margin* is not in :data:`MARGINS`.
    """
    sigma_alpha = _spread(one.alpha, other.alpha)
    sigma_beta = _spread(one.beta, other.beta)
    sigma_quadratic = _spread(one.beta_quadratic, other.beta_quadratic)
    width = lookup(MARGINS, margin, "decision margin")(sigma_alpha)
    difference = sigma_beta - sigma_quadratic
    verdict: Literal["linear", "nonlinear", "undecided"] = "undecided"
    if difference > width:
        verdict = "nonlinear"
    elif difference < -width:
        verdict = "linear"
    return Decision(sigma_alpha, sigma_beta, sigma_quadratic, width, verdict)


def most_different_pair(estimates: tuple[IsoEstimate, ...]) -> tuple[IsoEstimate, IsoEstimate] | None:
    """Return the two valid estimates whose velocity amplitudes differ most, or None.

    The experiments should be as different as possible (Miskovic2010, 7.3); below 10 % of difference in velocity
    amplitude the two structures predict the same drag and nothing can be decided (chosen: that is where
    the spread they disagree about falls under 5 %, the repeatability seen in Miskovic2010, Table 7.9).
    """
    usable = [e for e in estimates if e.cycle.valid]
    pairs = sorted(combinations(usable, 2), key=lambda pair: _spread(_speed(pair[0]), _speed(pair[1])))
    if not pairs or _spread(_speed(pairs[-1][0]), _speed(pairs[-1][1])) < 5.0:
        return None
    return pairs[-1]


def _speed(estimate: IsoEstimate) -> float:
    return estimate.cycle.X_m * estimate.cycle.omega


def _spread(one: float, other: float) -> float:
    """Miskovic2010, eq. (7.1): relative deviation of two values from their mean [%]."""
    total = one + other
    return 100.0 * abs((one - other) / total) if total else 100.0
