"""Fit a thruster map, the characteristic of Miskovic2010, eq. (2.8), to a pull test.

Each candidate structure (dead zone, shape) is fitted by least squares, so that the force rises with the command. The
Bayesian information criterion selects one.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify import Doubt, Parameter, Status
from gcs_autotune.identify.problems import Local, descend, inverse_of
from gcs_autotune.notebook import Display, Displayed, display_of_fit
from gcs_autotune.rounding import HALF_WIDTH, format_number
from gcs_autotune.slow_imports import scipy_stats
from gcs_autotune.thrusters.pull_test import PullTest, resolution
from gcs_autotune.thrusters.thruster_map import MapStructure, ThrusterMap, all_structures

__all__ = ["MapCandidate", "ThrusterFit", "fit_thruster", "map_doubts"]

Array = NDArray[np.float64]

SURE = 1e-3
"""False-alarm probability of each test. A lower p-value raises a doubt. Project choice."""


def map_doubts(
    pulls: PullTest,
    thruster: ThrusterMap,
    parameters: Mapping[str, Parameter],
    fitted: Array,
    structure: MapStructure,
    noise: float,
) -> tuple[Doubt, ...]:
    """Return the doubts about the map *thruster* fitted to *pulls*.

    fitted : (n,) forces of the map for the pulls.
    noise : standard deviation of one pull [N].
    """
    doubts: list[Doubt] = []
    error = pulls.force - fitted
    if not (structure.ahead and structure.astern):
        side, other = ("ahead", "astern") if structure.ahead else ("astern", "ahead")
        doubts.append(
            Doubt(
                "one-sided",
                f"the test contains only pulls {side}, so the map has no force {other}",
                f"pull {other} too",
            )
        )
    low, high = thruster.dead_zone
    edge_error = max(parameters["x_f"].std, parameters["x_b"].std)
    if structure.dead != "none" and 4.0 * edge_error > high - low:
        doubts.append(
            Doubt(
                "dead-zone-unsure",
                f"the dead zone {low:.4g} to {high:.4g} {thruster.unit} is uncertain by {HALF_WIDTH * edge_error:.2g}",
                "pull at several small commands on both sides of it",
            )
        )
    chance = _lack_of_fit(pulls, error, structure.count)
    if chance < SURE:
        doubts.append(
            Doubt(
                "lack-of-fit",
                f"repeated pulls agree with each other better than with the map (probability by chance {chance:.1g})",
                "check the residuals for voltage sag, a kink of the speed controller, or a test tank that is too small",
            )
        )
    chance = _uneven(fitted, error) if noise > resolution(pulls.force) else 1.0
    if chance < SURE:
        doubts.append(
            Doubt(
                "scatter-grows",
                "strong pulls scatter differently from weak ones, but the standard errors assume equal scatter",
                "repeat the strong pulls and check the battery between them",
            )
        )
    outlying = np.flatnonzero(np.abs(error) > 5.0 * max(1.4826 * float(np.median(np.abs(error))), 1e-3 * noise))
    if noise > 0.0 and len(error) >= 10 and 0 < len(outlying) <= 0.1 * len(error):
        commands = ", ".join(f"{pulls.command[i]:.4g}" for i in outlying[:5])
        doubts.append(
            Doubt("outlying-pulls", f"pulls at commands {commands} are far from the map", "repeat or omit these pulls")
        )
    return tuple(doubts)


def _lack_of_fit(pulls: PullTest, error: Array, parameters: int) -> float:
    """Return the p-value of structure in the residuals, from an F test on repeated commands; 1 without repetitions."""
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
    """Return the p-value of scatter that depends on the size of the force (rank correlation)."""
    if len(error) < 12 or float(np.ptp(np.abs(error))) == 0.0:
        return 1.0
    chance = float(scipy_stats().spearmanr(np.abs(fitted), np.abs(error)).pvalue)
    return 1.0 if math.isnan(chance) else chance


STARTS = 3
"""Number of the best points of the grid of edges at which a search starts.

Project choice. Several are needed because the cost has kinks where an edge passes a pull.
"""

GRID = (1, 21, 13)
"""Number of start values of each edge parameter, for no, one and two edge parameters. Project choice."""


@dataclass(frozen=True, slots=True)
class MapCandidate:
    """One fitted structure, with the numbers for the selection.

    ``rms`` [N]: root mean square residual.
    """

    structure: str
    rms: float
    free_parameters: int
    bic: float


@dataclass(frozen=True, slots=True, eq=False)
class ThrusterFit(Displayed):
    """A thruster map with its uncertainty.

    - ``covariance`` (7, 7): covariance of ``parameters``, in the order ``a_f b_f a_b b_b x_f x_b offset``.
    - ``offset``: zero error of the dynamometer [N], which is not included in the map.
    - ``noise``: standard deviation of one pull [N].
    """

    map: ThrusterMap
    structure: MapStructure
    parameters: Mapping[str, Parameter]
    covariance: Array
    noise: float
    fit_percent: float
    candidates: tuple[MapCandidate, ...]
    doubts: tuple[Doubt, ...]
    pulls: PullTest

    def _display(self) -> Display:
        title = (
            f"thruster map of {self.pulls.name}, {self.structure.name}, fit {self.fit_percent:.1f} %; standard "
            f"deviation of one pull {format_number(self.noise, 3)} N"
        )
        return display_of_fit(title, self.parameters, self.covariance, self.doubts)

    def to_dict(self) -> dict[str, object]:
        """Return the fit as data for JSON."""
        return {
            "schema": 1,
            "source": self.pulls.name,
            "model": self.map.to_dict(),
            "structure": self.structure.name,
            "dead_zone": list(self.map.dead_zone),
            "parameters": {
                n: {"value": p.value, "unit": p.unit, "std": p.std, "status": p.status}
                for n, p in self.parameters.items()
            },
            "covariance": self.covariance.tolist(),
            "noise": self.noise,
            "fit_percent": self.fit_percent,
            "candidates": [
                {"structure": c.structure, "rms": c.rms, "free_parameters": c.free_parameters, "bic": c.bic}
                for c in self.candidates
            ],
            "doubts": [{"slug": d.slug, "cause": d.cause, "cure": d.cure} for d in self.doubts],
        }


@dataclass(frozen=True, slots=True, eq=False)
class _Solved:
    structure: MapStructure
    theta: Array
    reach: tuple[float, float]
    rss: float
    bic: float


def fit_thruster(
    pulls: PullTest, *, neutral: float | None = None, structure: MapStructure | None = None
) -> ThrusterFit:
    """Return the map of one thruster, fitted to *pulls*.

    Parameters
    ----------
    neutral : command of zero force, if known. None means 0 for commands of both signs. For other commands (pulse
        widths) the neutral command is then fitted.
    structure : structure of the map. None selects it by the Bayesian information criterion.

    Raises
    ------
    NotInformative
        There are too few pulls for any structure.
    """
    direction = _direction(pulls)
    x, scale = direction * pulls.command, float(np.std(pulls.force))
    if neutral is None and (np.min(x) < 0.0 < np.max(x) or np.min(np.abs(x)) == 0.0):
        neutral = 0.0
    middle = None if neutral is None else direction * neutral
    ahead, astern = _sides(pulls.force)
    wanted = (structure,) if structure is not None else all_structures(ahead, astern, middle)
    solved = [s for s in (_solve(x, pulls.force, w, scale) for w in wanted if w.count + 2 <= len(pulls)) if s]
    if not solved:
        raise NotInformative(
            f"pull test '{pulls.name}': {len(pulls)} pulls are too few to fit and test a map. Pull at ten or more "
            "commands"
        )
    best = min(solved, key=lambda s: s.bic)
    return _fit(pulls, x, direction, best, solved)


def _direction(pulls: PullTest) -> int:
    slope = float(np.sum((pulls.command - pulls.command.mean()) * (pulls.force - pulls.force.mean())))
    return -1 if slope < 0.0 else 1


def _sides(force: Array) -> tuple[bool, bool]:
    """Return whether the thruster was pulled ahead and astern; each needs at least a tenth of the strongest pull."""
    strongest = float(np.max(np.abs(force)))
    return bool(np.max(force) > 0.1 * strongest), bool(np.min(force) < -0.1 * strongest)


def _model(x: Array, s: MapStructure, theta: Array, reach: tuple[float, float]) -> tuple[Array, Array]:
    """Return the forces (n,) and their derivatives by the parameters (n, p)."""
    c, k = s.slopes.shape[1], s.edges.shape[1]
    slopes, edges = s.slopes @ theta[:c], s.edges @ theta[c : c + k] + (s.neutral or 0.0)
    value, by_slopes, by_edges = np.zeros(len(x)), np.zeros((len(x), 4)), np.zeros((len(x), 2))
    for side, (sign, far) in enumerate(zip((1.0, -1.0), reach, strict=True)):
        if not (s.ahead, s.astern)[side]:
            continue
        distance = np.maximum(sign * (x - edges[side]), 0.0)
        late = distance**2 / (2.0 * far)
        first, last = slopes[2 * side], slopes[2 * side + 1]
        by_slopes[:, 2 * side], by_slopes[:, 2 * side + 1] = sign * (distance - late), sign * late
        value += sign * (first * (distance - late) + last * late)
        by_edges[:, side] = np.where(distance > 0.0, -(first + (last - first) * distance / far), 0.0)
    J = np.hstack([by_slopes @ s.slopes, by_edges @ s.edges, np.ones((len(x), int(s.offset)))])
    return value + (theta[-1] if s.offset else 0.0), J


def _solve(x: Array, force: Array, s: MapStructure, scale: float) -> _Solved | None:
    """Fit one structure from the best points of a grid of edges."""
    c, k = s.slopes.shape[1], s.edges.shape[1]
    low = np.full(s.count, -np.inf)
    low[:c] = 0.0
    if s.dead != "none":
        low[c + k - 1] = 0.0
    best: _Solved | None = None
    for edge, reach in _starts(x, force, s):

        def local(theta: Array, reach: tuple[float, float] = reach) -> Local:
            value, J = _model(x, s, theta, reach)
            error = (value - force) / scale
            return Local(float(error @ error), J.T @ error / scale, J.T @ J / scale**2)

        found = descend(local, edge, low, np.full(s.count, np.inf))
        if found is None:
            continue
        rss = found.cost * scale**2
        if best is None or rss < best.rss:
            n = len(x)
            floor = max(1e-12 * scale**2, resolution(force) ** 2 / 12.0)
            bic = n * math.log(max(rss / n, floor)) + s.count * math.log(n)
            best = _Solved(s, found.x, reach, rss, bic)
    return best


def _starts(x: Array, force: Array, s: MapStructure) -> list[tuple[Array, tuple[float, float]]]:
    """Return start vectors: the best few linear least-squares fits over a grid of edges."""
    c, k = s.slopes.shape[1], s.edges.shape[1]
    lowest, highest = float(x.min()), float(x.max())
    span = highest - lowest
    middle = np.linspace(lowest, highest, GRID[k]) - (s.neutral or 0.0)
    width = np.linspace(0.0, 0.45 * span, GRID[k])
    axes = [middle] * (k - (s.dead != "none")) + [width] * (s.dead != "none")
    ranked = []
    for edge in itertools.product(*axes):
        edges = s.edges @ np.array(edge) + (s.neutral or 0.0) if k else np.full(2, s.neutral or 0.0)
        reach = (max(highest - edges[0], 0.0) + 0.05 * span, max(edges[1] - lowest, 0.0) + 0.05 * span)
        if s.same_sides:
            reach = (max(reach), max(reach))
        theta = np.concatenate([np.zeros(c), np.array(edge), np.zeros(int(s.offset))])
        J = _model(x, s, theta, reach)[1]
        linear = np.concatenate([J[:, :c], J[:, c + k :]], axis=1)
        coefficients = inverse_of(linear.T @ linear + 1e-12 * np.eye(linear.shape[1])) @ (linear.T @ force)
        coefficients[:c] = np.maximum(coefficients[:c], 0.0)
        theta[:c], theta[c + k :] = coefficients[:c], coefficients[c:]
        error = linear @ coefficients - force
        ranked.append((float(error @ error), theta, reach))
    ranked.sort(key=lambda r: r[0])
    return [(theta, reach) for _, theta, reach in ranked[:STARTS]]


def _fit(pulls: PullTest, x: Array, direction: int, best: _Solved, solved: list[_Solved]) -> ThrusterFit:
    s, theta = best.structure, best.theta
    c, k = s.slopes.shape[1], s.edges.shape[1]
    value, J = _model(x, s, theta, best.reach)
    held = np.zeros(s.count, dtype=bool)
    held[:c] = theta[:c] <= 0.0
    if s.dead != "none":
        held[c + k - 1] = theta[c + k - 1] <= 0.0
    freedom = max(len(x) - s.count, 1)
    noise = math.sqrt(best.rss / freedom)
    own = inverse_of(J.T @ J) * noise**2  # those at their bound too: leaving them out makes the edges look too sure
    turn = _to_named(s, best.reach)
    named = turn @ theta + np.array([0.0, 0.0, 0.0, 0.0, s.neutral or 0.0, s.neutral or 0.0, 0.0])
    covariance = turn @ own @ turn.T
    thruster = ThrusterMap(
        a_f=float(named[0]),
        b_f=float(named[1]),
        a_b=float(named[2]),
        b_b=float(named[3]),
        x_f=float(named[4]),
        x_b=float(named[5]),
        low=float(pulls.command.min()),
        high=float(pulls.command.max()),
        unit=pulls.unit,
        direction=direction,
    )
    names = ("a_f", "b_f", "a_b", "b_b", "x_f", "x_b", "offset")
    parameters = {
        n: Parameter(n, float(v), unit, math.sqrt(max(covariance[i, i], 0.0)), _status(turn[i], held))
        for i, (n, v, unit) in enumerate(zip(names, named, _units(pulls.unit), strict=True))
    }
    candidates = sorted(
        (MapCandidate(o.structure.name, math.sqrt(o.rss / len(x)), o.structure.count, o.bic) for o in solved),
        key=lambda o: o.bic,
    )
    fit_percent = 100.0 * (1.0 - math.sqrt(best.rss / len(x)) / float(np.std(pulls.force)))
    doubts = map_doubts(pulls, thruster, parameters, value, s, noise)
    return ThrusterFit(thruster, s, parameters, covariance, noise, fit_percent, tuple(candidates), doubts, pulls)


def _to_named(s: MapStructure, reach: tuple[float, float]) -> Array:
    """Return the derivatives (7, p) of ``a_f b_f a_b b_b x_f x_b offset`` by the fit's own parameters."""
    c, k = s.slopes.shape[1], s.edges.shape[1]
    turn = np.zeros((7, s.count))
    for side, far in enumerate(reach):
        first, last = s.slopes[2 * side], s.slopes[2 * side + 1]
        turn[2 * side, :c], turn[2 * side + 1, :c] = (last - first) / (2.0 * far), first
    turn[4:6, c : c + k] = s.edges
    if s.offset:
        turn[6, -1] = 1.0
    return turn


def _status(row: Array, held: NDArray[np.bool_]) -> Status:
    used = row != 0.0
    if not np.any(used):
        return "absent"
    return "at_bound" if np.all(held[used]) else "fitted"


def _units(unit: str) -> tuple[str, ...]:
    per = "N" if unit == "1" else f"N/{unit if '/' not in unit else f'({unit})'}"
    square = "N" if unit == "1" else f"{per}^2"
    return (square, per, square, per, unit, unit, "N")
