"""Fit two equal thrusters side by side to the surge force and yaw moment that they produce (ZhaoUSV, (4)-(7)).

Each thruster has ``T = C_n n|n| - C_v V_A |n|``, or ``T = C_T n|n|`` at rest, with the same coefficients for both.
Force and moment are fitted together, each weighted by its own noise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import BadFile, MissingChannel, NotInformative
from gcs_autotune.identify import Doubt, Parameter
from gcs_autotune.identify.problems import inverse_of
from gcs_autotune.notebook import Display, Displayed, display_of_fit
from gcs_autotune.rounding import format_number
from gcs_autotune.thrusters.pull_test import COMMANDS, read_columns
from gcs_autotune.thrusters.thruster_map import ThrusterMap
from gcs_autotune.thrusters.twin_thrusters import TwinThrusters

__all__ = ["TwinFit", "TwinTest", "fit_twin", "has_two_commands", "read_twin_test"]

Array = NDArray[np.float64]

_ROUNDS = 4
"""Rounds of fit and weights; both are constant after two."""

_UNEQUAL = 3.0
"""Standard deviations between the two thrusters' own coefficients that count as a difference. Project choice."""

_UNITS = {"rad/s": ("N s^2/rad^2", "N s^2/(m rad)"), "us": ("N/us^2", "N s/(m us)"), "1": ("N", "N s/m")}
"""Unit of the commands -> units of C_T and C_n, and of C_v."""

_PULSE_NEUTRAL = 1500.0
"""Servo pulse without thrust [us], unless supplied."""


@dataclass(frozen=True, slots=True, eq=False)
class TwinTest(Displayed):
    """Pulls of a craft with two thrusters, all arrays (k,).

    - ``port``, ``starboard``: commands in ``unit``, 0 without thrust.
    - ``X`` [N]: surge force. ``N`` [N m]: yaw moment, None if not measured.
    - ``V_A`` [m/s]: speed through the water, zeros on a bollard.
    - ``neutral``: command of the file without thrust.
    """

    port: Array
    starboard: Array
    X: Array
    V_A: Array
    N: Array | None = None
    unit: str = "rad/s"
    neutral: float = 0.0

    def without(self, keep: NDArray[np.bool_]) -> TwinTest:
        """Return the rows where *keep* (k,) is true."""
        N = None if self.N is None else self.N[keep]
        return replace(
            self, port=self.port[keep], starboard=self.starboard[keep], X=self.X[keep], V_A=self.V_A[keep], N=N
        )


@dataclass(frozen=True, slots=True, eq=False)
class TwinFit(Displayed):
    """Coefficients that both thrusters share, with the thrusters at rest in the water.

    ``noise``: standard deviations of one row, ``X`` [N] and, if measured, ``N`` [N m].
    """

    parameters: Mapping[str, Parameter]
    covariance: Array
    noise: Mapping[str, float]
    thrusters: TwinThrusters
    doubts: tuple[Doubt, ...] = ()

    def _display(self) -> Display:
        noise = ", ".join(f"{name} {format_number(std, 3)}" for name, std in self.noise.items())
        title = f"two thrusters; standard deviation of one row: {noise}"
        return display_of_fit(title, self.parameters, self.covariance, self.doubts)

    def to_dict(self) -> dict[str, Any]:
        """Return the fit as data for JSON."""
        return {
            "schema": 1,
            "kind": "twin thrusters",
            "parameters": {n: {"value": p.value, "unit": p.unit, "std": p.std} for n, p in self.parameters.items()},
            "covariance": self.covariance.tolist(),
            "noise": dict(self.noise),
            "spacing": self.thrusters.B,
            "model": self.thrusters.port.to_dict(),
            "doubts": [{"slug": d.slug, "cause": d.cause, "cure": d.cure} for d in self.doubts],
        }


def has_two_commands(path: Path) -> bool:
    """Return whether a table has a command column for each of two thrusters (``n_1`` and ``n_2``, ``pwm_1`` ...)."""
    return _pair(read_columns(path)) is not None


def _pair(columns: Mapping[str, object]) -> tuple[str, str] | None:
    pairs = ((f"{name}_1", f"{name}_2") for name in COMMANDS)
    return next((pair for pair in pairs if set(pair) <= columns.keys()), None)


def read_twin_test(path: Path, *, neutral: float | None = None) -> TwinTest:
    """Return the test in a CSV file with ``n_1``, ``n_2`` (1 is port) or ``pwm_1``, ``pwm_2``, with ``X``, and with
    ``N`` and ``V_A`` if measured. *neutral*: command without thrust; None takes 1500 us for pulses and 0 for others.

    Raises
    ------
    BadFile, MissingChannel
        The file is not a table, lacks the columns, or has a unit that does not fit.
    """
    columns = read_columns(path)
    pair = _pair(columns)
    if pair is None or "X" not in columns:
        raise MissingChannel(
            f"{path} lacks a column. It needs n_1, n_2 (or pwm_1, pwm_2) and X. Its columns are {', '.join(columns)}"
        )
    (unit, port), (other, starboard) = (columns[name] for name in pair)
    if unit != other:
        raise BadFile(f"{path}: {pair[0]} is in [{unit}] and {pair[1]} in [{other}]. Use one unit")
    for name, wanted in (("X", "N"), ("N", "N m"), ("V_A", "m/s")):
        if name in columns and columns[name][0] not in (wanted, "1"):
            raise BadFile(f"{path}: {name} in [{columns[name][0]}] cannot be used. Convert it to {wanted}")
    zero = neutral if neutral is not None else (_PULSE_NEUTRAL if unit == "us" else 0.0)
    X = columns["X"][1]
    V_A = columns["V_A"][1] if "V_A" in columns else np.zeros(len(X))
    test = TwinTest(port - zero, starboard - zero, X, V_A, columns["N"][1] if "N" in columns else None, unit, zero)
    arrays = [test.port, test.starboard, X, V_A, *([] if test.N is None else [test.N])]
    return test.without(np.all(np.isfinite(arrays), axis=0))


def fit_twin(test: TwinTest, spacing: float) -> TwinFit:
    """Return the coefficients of both thrusters, ``C_T`` or ``C_n`` and ``C_v``, whichever *test* supports.

    spacing : distance between the thrusters [m], B of ZhaoUSV (7).

    Raises
    ------
    NotInformative
        Too few rows, or thrusters that never run.
    """
    a_1, a_2 = (n * np.abs(n) for n in (test.port, test.starboard))
    b_1, b_2 = (-test.V_A * np.abs(n) for n in (test.port, test.starboard))
    if not np.any(a_1) or not np.any(a_2):
        raise NotInformative("one of the two thrusters never runs in this test. Check the two command columns")
    arm = 0.5 * spacing
    rows = [(test.X, 1.0, 1.0)] + ([] if test.N is None else [(test.N, arm, -arm)])
    y = [values for values, _, _ in rows]
    tied = [np.column_stack([p * a_1 + s * a_2]) for _, p, s in rows]
    moving = [np.column_stack([p * a_1 + s * a_2, p * b_1 + s * b_2]) for _, p, s in rows]
    choices = [(("C_T",), tied)] + ([(("C_n", "C_v"), moving)] if np.any(test.V_A) else [])
    solved = [(names, *_weighted(H, y)) for names, H in choices]
    names, theta, P, s, _ = min(solved, key=lambda found: found[-1])
    squared, per = _UNITS.get(test.unit, (f"N/({test.unit})^2", f"N s/(m {test.unit})"))
    parameters = {
        n: Parameter(n, float(theta[i]), per if n == "C_v" else squared, math.sqrt(P[i, i]))
        for i, n in enumerate(names)
    }
    low = float(min(test.port.min(), test.starboard.min())) + test.neutral
    high = float(max(test.port.max(), test.starboard.max())) + test.neutral
    C = max(float(theta[0]), 0.0)
    one = ThrusterMap(C, 0.0, C, 0.0, test.neutral, test.neutral, low, high, test.unit)
    doubts = []
    if theta[0] <= 0.0:
        doubts.append(Doubt("wrong-sign", f"{names[0]} is not positive", "check the signs of commands and force"))
    split = [np.column_stack([p * a_1, s * a_2, p * b_1 + s * b_2][: 2 + (len(names) > 1)]) for _, p, s in rows]
    if np.linalg.matrix_rank(np.vstack(split)) == split[0].shape[1]:
        own, own_P, _, _ = _weighted(split, y)
        apart = float(own[0] - own[1])
        if abs(apart) > _UNEQUAL * math.sqrt(own_P[0, 0] + own_P[1, 1] - 2.0 * own_P[0, 1]):
            cause = f"the port thruster is {100.0 * apart / float(own[1]):+.0f} % stronger than the starboard one"
            doubts.append(Doubt("unequal-thrusters", cause, "check both propellers, or measure each thruster alone"))
    noise = dict(zip("XN", s, strict=False))
    return TwinFit(parameters, P, noise, TwinThrusters(one, one, spacing), tuple(doubts))


def _weighted(H: list[Array], y: list[Array]) -> tuple[Array, Array, list[float], float]:
    """Return the estimate, its covariance, the noise of each equation, and the information criterion."""
    p, k = H[0].shape[1], sum(len(values) for values in y)
    if min(len(values) for values in y) <= p + 1:
        raise NotInformative(f"{len(y[0])} rows are too few for {p} coefficients. Measure at more commands")
    s = [max(float(np.std(values)), 1e-12) for values in y]
    for _ in range(_ROUNDS):
        A = np.vstack([h / each for h, each in zip(H, s, strict=True)])
        b = np.concatenate([values / each for values, each in zip(y, s, strict=True)])
        inverse = inverse_of(A.T @ A)
        theta = inverse @ (A.T @ b)
        left = [values - h @ theta for values, h in zip(y, H, strict=True)]
        s = [
            max(float(np.sqrt(e @ e / (len(e) - p / len(y)))), 1e-10 * max(float(np.abs(v).max()), 1e-290))
            for e, v in zip(left, y, strict=True)
        ]
    criterion = sum(2.0 * len(values) * math.log(each) for values, each in zip(y, s, strict=True)) + p * math.log(k)
    return theta, inverse, s, criterion
