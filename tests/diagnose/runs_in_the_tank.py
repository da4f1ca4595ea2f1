"""Runs of random steps in the simulator's tank, for diagnosis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gcs_autotune.trial import Channel, Trial
from sitl.effects import Effect
from sitl.effects.table import make_effect
from sitl.tank import Hull, tow

__all__ = ["HULL", "Hidden", "towed"]

HULL = Hull(("yaw",), {"yaw": 2.0}, {"yaw": 1.0})
UNITS = {"psi": "rad", "r": "rad/s", "N": "N m"}

Hidden = tuple[str, str, dict[str, float]] | Effect
"""An effect hidden: slug, place and values of one the simulator has, or one made for the test."""


def towed(
    *effects: Hidden, runs: int = 2, samples: int = 300, noise: float = 0.005, seed: int = 1, full: float = 1.0
) -> list[Trial]:
    """Return runs of random steps of up to *full* [N m] every 2.5 s, with *effects* hidden in them."""
    rng = np.random.default_rng(seed)
    found = []
    for k in range(runs):
        steps: Sequence[float] = np.repeat(full * rng.uniform(-1.0, 1.0, samples // 25 + 1), 25)[:samples]
        columns = tow(
            HULL,
            {"N": steps},
            duration=samples * 0.1,
            interval=0.1,
            measured=("psi", "r"),
            effects=[e if isinstance(e, Effect) else make_effect(*e) for e in effects],
            noise={"psi": noise, "r": noise},
            seed=10 * seed + k,
        )
        t = columns.pop("t")
        found.append(Trial(f"run{k}", {n: Channel(n, UNITS[n], t, v) for n, v in columns.items()}))
    return found
