"""Runs of random steps in the simulator's tank, for diagnosis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.trial import Channel, Trial
from sitl.effects import HiddenEffect
from sitl.effects.table import make_effect
from sitl.open_loop import Hull, open_loop

__all__ = ["BOAT", "HULL", "Hidden", "sailed", "squares", "towed"]

HULL = Hull(("yaw",), {"yaw": 2.0}, {"yaw": 1.0})
BOAT = Hull(("surge", "sway", "yaw"), {"surge": 5.0, "sway": 7.0, "yaw": 2.0}, {"surge": 2.0, "sway": 9.0, "yaw": 1.0})
UNITS = {"psi": "rad", "r": "rad/s", "u": "m/s", "v": "m/s", "x": "m", "y": "m", "N": "N m", "X": "N"}

Array = NDArray[np.float64]
Hidden = tuple[str, str, dict[str, float]] | HiddenEffect
"""An effect hidden: slug, place and values of one the simulator has, or one made for the test."""


def towed(
    *effects: Hidden, runs: int = 2, samples: int = 300, noise: float = 0.005, seed: int = 1, full: float = 1.0
) -> list[Trial]:
    """Return runs of random steps of up to *full* [N m] every 2.5 s, with *effects* hidden in them."""
    rng = np.random.default_rng(seed)
    found = []
    for k in range(runs):
        steps: Sequence[float] = np.repeat(full * rng.uniform(-1.0, 1.0, samples // 25 + 1), 25)[:samples]
        columns = open_loop(
            HULL,
            {"N": steps},
            duration=samples * 0.1,
            interval=0.1,
            measured=("psi", "r"),
            effects=[e if isinstance(e, HiddenEffect) else make_effect(*e) for e in effects],
            noise={"psi": noise, "r": noise},
            seed=10 * seed + k,
        )
        found.append(_filed(f"run{k}", columns))
    return found


def squares(
    *sizes: float, period: float, effects: Sequence[Hidden] = (), noise: float = 0.005, seed: int = 1
) -> list[Trial]:
    """Return a run of square waves of each size [N m], halves and quarters of the *period* [s] in between."""
    return [
        _filed(
            f"run{k}",
            open_loop(
                HULL,
                {"N": _square(size, period)},
                duration=30.0,
                interval=0.1,
                measured=("psi", "r"),
                effects=[e if isinstance(e, HiddenEffect) else make_effect(*e) for e in effects],
                noise={"psi": noise, "r": noise},
                seed=10 * seed + k,
            ),
        )
        for k, size in enumerate(sizes)
    ]


def _square(size: float, period: float) -> list[tuple[float, float]]:
    steps, t, way = [], 0.0, 1.0
    for k in range(round(60.0 / period) + 1):
        steps.append((t, way * size))
        t, way = t + period / (2.0, 4.0, 3.0)[k % 3], -way
    return [step for step in steps if step[0] < 30.0]


def sailed(*effects: Hidden, samples: int = 250, seed: int = 1) -> list[Trial]:
    """Return two runs of a boat under way, turned by random steps, with everything measured."""
    rng = np.random.default_rng(seed)
    measured = ("u", "v", "r", "psi", "x", "y")
    found = []
    for k in range(2):
        steps: Sequence[float] = np.repeat(rng.uniform(-1.0, 1.0, 10), 25)[:samples]
        columns = open_loop(
            BOAT,
            {"N": steps, "X": np.repeat(rng.uniform(1.0, 3.0, 5), 50)[:samples]},
            duration=0.1 * samples,
            interval=0.1,
            measured=measured,
            effects=[e if isinstance(e, HiddenEffect) else make_effect(*e) for e in effects],
            noise=dict.fromkeys(measured, 0.005),
            seed=10 * seed + k,
        )
        found.append(_filed(f"run{k}", columns))
    return found


def _filed(name: str, columns: dict[str, Array]) -> Trial:
    t = columns.pop("t")
    return Trial(name, {n: Channel(n, UNITS[n], t, v) for n, v in columns.items()})
