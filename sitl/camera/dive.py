"""S-manoeuvres of the VideoRay in a pool (Miskovic2007, section II.D), with the clocks of a camera and of a log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sitl.effects import BadEffect, HiddenEffect, Setting
from sitl.plants import AxisDynamics, Coupling, PlanarHull, Water, Wrench

__all__ = ["BOARDS", "Dive", "pool_dive", "write_table"]

Array = NDArray[np.float64]

BOARDS = tuple(
    ((0.35 * (-1.0) ** k, 0.3 * (-1.0) ** (k // 2), 0.1 * k), (3.5 * (k % 3 - 1), 2.0 * (-1.0) ** k, 13.0 + k % 3))
    for k in range(8)
)
"""Attitudes [rad] and places [squares] in which a board is shown."""
_STEP, _PERIOD = 0.01, 10
"""Step of the simulation [s], and steps per picture and per row of the log."""
_GYRO = 0.01
"""Standard deviation of the logged yaw rate [rad/s]. Project choice."""
_LATE, _PHASE = 100, 4
"""Steps from the start of the log to that of the video, and between a row of the log and a picture."""


@dataclass(frozen=True, slots=True, eq=False)
class Dive:
    """One dive. seen : (n, 3) x, y [m] and psi [rad] at each picture. video_t : (n,) [s] on the camera's clock.

    log : (m, 4) time [s] on the log's clock, X [N], N [N m] and measured r [rad/s]. offset : clock of the log minus
    that of the camera [s].
    """

    seen: Array
    video_t: Array
    log: Array
    offset: float


def pool_dive(seed: int, seconds: int = 40, effects: Sequence[HiddenEffect] = ()) -> Dive:
    """Return a dive of *seconds*: the yaw moment to and fro while the craft moves ahead and astern.

    effects : hidden effects on thrusters, hull and water. Their inputs are in N and N m.

    Raises
    ------
    BadEffect
        An effect has no place here, or is one on a sensor or a file.
    """
    rng = np.random.default_rng(seed)
    hull = PlanarHull(
        AxisDynamics(8.2372, 4.4283, 0.0),  # Miskovic2007, final matrices
        AxisDynamics(8.2372, 4.4283, 0.0),
        AxisDynamics(0.0372, 0.0997, 0.0),
        Water(),
        sway=AxisDynamics(8.2372, 14.9571, 0.0),
        coupling=Coupling(coriolis=True),
    )
    state = hull.state
    state.z, state.psi = 1.0, float(rng.uniform(-3.0, 3.0))
    X, N = float(rng.uniform(1.4, 2.2)), float(rng.uniform(0.05, 0.11))
    ahead, turning = _signs(rng, 10 * seconds + 12, 25, 38)[12:], _signs(rng, 10 * seconds, 12, 26)
    _begin(effects, hull, {"X": X, "N": N}, seed)
    plain = dict(hull.parameters)
    offset, start = 50.0 + 10.0 * seed, _LATE + _PHASE
    poses, log = [], []
    for k in range(100 * seconds):
        row = k // _PERIOD
        commands = {"X": X * ahead[row], "N": N * turning[row]}
        if k % _PERIOD == 0:
            log.append((offset + (k - start) * _STEP, *commands.values(), state.r + rng.normal(0.0, _GYRO)))
        if k >= start and (k - start) % _PERIOD == 0:
            poses.append((state.x, state.y, state.psi))
        hull.parameters.update(plain)
        for effect in effects:
            effect.alter_input(k * _STEP, _STEP, commands)
        wrench = Wrench(**commands)
        for effect in effects:
            effect.alter_force(k * _STEP, wrench)
            effect.alter_water(k * _STEP, hull.water)
            effect.alter_parameters(k * _STEP, hull.parameters)
        hull.step(wrench, _STEP)
    video_t: Array = np.arange(len(poses)) * np.float64(_PERIOD * _STEP)
    return Dive(np.array(poses), video_t, np.array(log), offset)


def _begin(effects: Sequence[HiddenEffect], hull: PlanarHull, most: dict[str, float], seed: int) -> None:
    """Start the *effects* on *hull*, whose largest commands are *most*."""
    setting = Setting(
        state=hull.state,
        water=hull.water,
        parameters=hull.parameters,
        dofs=("surge", "sway", "yaw"),
        inputs={"X": "surge", "N": "yaw"},
        amplitude=most,
        gain={"surge": 1.0, "yaw": 1.0},
        signals=("x", "y", "psi"),
        seed=str(seed),
        cruise=most["X"] / hull.parameters["surge.beta"],
    )
    for effect in effects:
        if effect.overrides("alter_measurement") or effect.overrides("alter_file"):
            raise BadEffect(f"{effect.slug}: a camera has no such error. Use an effect on thrusters, hull or water")
        effect.begin(setting)


def _signs(rng: np.random.Generator, rows: int, least: int, most: int) -> list[float]:
    """Return 1 and -1 in turn for *rows*, each for a random time of *least* to *most* rows.

    Equal times would repeat, and the clocks could not be aligned.
    """
    signs: list[float] = []
    while len(signs) < rows:
        signs += [1.0 if not signs or signs[-1] < 0.0 else -1.0] * int(rng.integers(least, most))
    return signs


def write_table(path: Path, head: str, rows: Array) -> None:
    """Write *rows* (n, k) as a CSV file with the header line *head*."""
    lines = [",".join(f"{v:.6f}" for v in row) for row in rows]
    path.write_text("\n".join([head, *lines, ""]), encoding="utf-8")
