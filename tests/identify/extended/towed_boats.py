"""Yaw runs of a bare hull in the towing tank, with effects hidden in it; nothing here is shared with the tuner."""

from __future__ import annotations

import numpy as np

from gcs_autotune.trial import Channel, Trial
from sitl.effects.table import make_effect
from sitl.open_loop import Hull, open_loop

INERTIA, DRAG = 2.0, 1.5
NOISE = {"psi": 0.01, "r": 0.02}


def yaw_run(seed: int, effects: dict[str, dict[str, float]], *, duration: float = 60.0) -> Trial:
    """Return a run of random steps of the moment, up to 1 N m, at 10 Hz; *effects*: ``slug@place`` -> values."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration, 2.5)
    steps = [(float(a), float(b)) for a, b in zip(t, rng.uniform(-1.0, 1.0, len(t)), strict=True)]
    hidden = [make_effect(*_parts(name), values) for name, values in effects.items()]
    hull = Hull(("yaw",), {"yaw": INERTIA}, {"yaw": DRAG})
    table = open_loop(
        hull,
        {"N": steps},
        duration=duration,
        interval=0.1,
        measured=("psi", "r"),
        effects=hidden,
        noise=NOISE,
        seed=seed,
    )
    units = {"N": "N m", "psi": "rad", "r": "rad/s"}
    channels = {n: Channel(n, u, table["t"], table[n]) for n, u in units.items()}
    return Trial(f"run{seed}", channels)


def _parts(name: str) -> tuple[str, str]:
    slug, _, place = name.partition("@")
    return slug, place
