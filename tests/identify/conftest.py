"""Fixture: recorded runs of test plants."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from axis_plants import Plant, fly

from gcs_autotune.trial import Channel, Trial

CHANNELS = {"yaw": ("psi", "r", "N"), "heave": ("z", "w", "Z"), "surge": ("x", "u", "X"), "sway": ("y", "v", "Y")}
UNITS = {
    "yaw": ("rad", "rad/s", "N m"),
    "heave": ("m", "m/s", "N"),
    "surge": ("m", "m/s", "N"),
    "sway": ("m", "m/s", "N"),
}


@pytest.fixture(scope="session")
def record() -> Callable[..., Trial]:
    """record(plant, command, ...) -> Trial with noise on request."""

    def make(
        plant: Plant,
        command: Callable[[float, float], float],
        duration: float = 40.0,
        *,
        dt: float = 0.1,
        delay: float = 0.0,
        h: float = 0.01,
        noise: float = 0.0,
        rate_noise: float | None = None,
        seed: int = 0,
        dof: str = "yaw",
        name: str = "run",
        meta: dict[str, Any] | None = None,
    ) -> Trial:
        t, eta, nu, tau = fly(plant, command, duration, dt=dt, delay=delay, h=h)
        rng = np.random.default_rng(seed)
        (p, v, f), (pu, vu, fu) = CHANNELS[dof], UNITS[dof]
        position = eta + rng.normal(0.0, noise, len(t)) if noise else eta
        if dof == "yaw":
            position = np.arctan2(np.sin(position), np.cos(position))
        channels = {p: Channel(p, pu, t, position), f: Channel(f, fu, t, tau)}
        if rate_noise is not None:
            channels[v] = Channel(v, vu, t, nu + rng.normal(0.0, rate_noise, len(t)))
        return Trial(name, channels, meta=meta or {})

    return make
