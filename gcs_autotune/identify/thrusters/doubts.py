"""What to doubt about a thruster map."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.result import Doubt, Parameter
from gcs_autotune.identify.thrusters.pull_test import PullTest, resolution
from gcs_autotune.identify.thrusters.structure import MapStructure
from gcs_autotune.identify.thrusters.thruster_map import ThrusterMap
from gcs_autotune.slow_imports import scipy_stats

__all__ = ["map_doubts"]

Array = NDArray[np.float64]

SURE = 1e-3
"""Chance of a false alarm below which a test raises a doubt."""


def map_doubts(
    pulls: PullTest,
    thruster: ThrusterMap,
    parameters: Mapping[str, Parameter],
    fitted: Array,
    structure: MapStructure,
    noise: float,
) -> tuple[Doubt, ...]:
    """Return the doubts; *fitted* (n,) are the forces the map gives for the pulls, *noise* [N]."""
    found: list[Doubt] = []
    error = pulls.force - fitted
    if not (structure.ahead and structure.astern):
        side, other = ("ahead", "astern") if structure.ahead else ("astern", "ahead")
        found.append(
            Doubt(
                "one-sided", f"the thruster was pulled {side} only; {other} the map gives nothing", f"pull {other} too"
            )
        )
    low, high = thruster.dead_zone
    edge_error = max(parameters["x_f"].std, parameters["x_b"].std)
    if structure.dead != "none" and 4.0 * edge_error > high - low:
        found.append(
            Doubt(
                "dead-zone-unsure",
                f"the dead zone {low:.4g} to {high:.4g} {thruster.unit} is known to {1.96 * edge_error:.2g} only",
                "pull at several small commands on both sides of it",
            )
        )
    chance = _lack_of_fit(pulls, error, structure.count)
    if chance < SURE:
        found.append(
            Doubt(
                "lack-of-fit",
                f"repeated pulls agree better with each other than with the map (chance {chance:.1g})",
                "look at the residuals: voltage sag, a kink of the speed controller, or a tank too small",
            )
        )
    chance = _uneven(fitted, error) if noise > resolution(pulls.force) else 1.0
    if chance < SURE:
        found.append(
            Doubt(
                "scatter-grows",
                "strong pulls scatter differently from weak ones; the standard errors take one scatter for all",
                "repeat the strong pulls and check the battery between them",
            )
        )
    outlying = np.flatnonzero(np.abs(error) > 5.0 * max(1.4826 * float(np.median(np.abs(error))), 1e-3 * noise))
    if noise > 0.0 and len(error) >= 10 and 0 < len(outlying) <= 0.1 * len(error):
        commands = ", ".join(f"{pulls.command[i]:.4g}" for i in outlying[:5])
        found.append(
            Doubt("outlying-pulls", f"pulls at {commands} lie far off the map", "repeat them, or leave them out")
        )
    return tuple(found)


def _lack_of_fit(pulls: PullTest, error: Array, parameters: int) -> float:
    """Return the chance of the residuals' structure, by the F test on repeated commands; 1 without repetitions."""
    levels, place = np.unique(pulls.command, return_inverse=True)
    counts = np.bincount(place)
    means = np.bincount(place, error) / counts
    pure = float(np.sum((error - means[place]) ** 2))
    inside, between = len(error) - len(levels), len(levels) - parameters
    pure = max(pure, inside * resolution(pulls.force) ** 2 / 12.0)
    if inside < 3 or between < 1 or pure <= 0.0:
        return 1.0
    ratio = float(np.sum(counts * means**2)) / between / (pure / inside)
    return float(scipy_stats().f.sf(ratio, between, inside))


def _uneven(fitted: Array, error: Array) -> float:
    """Return the chance that scatter does not depend on the size of the force (rank correlation of the two)."""
    if len(error) < 12 or float(np.ptp(np.abs(error))) == 0.0:
        return 1.0
    chance = float(scipy_stats().spearmanr(np.abs(fitted), np.abs(error)).pvalue)
    return 1.0 if math.isnan(chance) else chance
