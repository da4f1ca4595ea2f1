"""Weather for the tank: a moment that wanders, with bursts, and a heading that somebody smoothed.

The moment is an Ornstein-Uhlenbeck process, stepped by the tank; bursts come and go besides, as wakes do. The file's
heading is smoothed forwards and backwards, and its turn rate is made from that. Nothing here shares code with what has
to find an effect beneath it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, MutableMapping

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.craft import Craft, log_uniform
from benchmarks.blind.foreign import Foreign
from sitl.effects import EffectParameter

__all__ = ["CALM", "HIDDEN", "Weather", "drawn_weather", "smoothed"]

Array = NDArray[np.float64]
Rng = np.random.Generator

HIDDEN = (
    "input-delay",
    "dead-zone",
    "quadratic-drag",
    "asymmetric-thrust",
    "input-bias",
    "saturation",
    "actuator-lag",
    "quadratic-actuator",
)
"""Effects hidden beneath it, by turns; between them ``CALM``."""

CALM = "clean"
"""Stands for no effect at all."""


class Weather(Foreign):
    """A moment that wanders, and bursts."""

    slug = "weather"
    parameters = (
        EffectParameter("spread", "N m"),
        EffectParameter("memory", "s"),
        EffectParameter("burst", "N m"),
        EffectParameter("every", "s"),
    )

    def reset(self) -> None:
        """Begin anywhere."""
        self._force = self.draw.gauss(0.0, self["spread"])
        self._burst, self._left = 0.0, 0.0

    def alter_input(self, t: float, dt: float, inputs: MutableMapping[str, float]) -> None:
        """Push."""
        keep = math.exp(-dt / self["memory"])
        self._force = keep * self._force + self.draw.gauss(0.0, self["spread"] * math.sqrt(1.0 - keep * keep))
        self._left -= dt
        if self._left <= 0.0:
            self._burst = 0.0
            if self.draw.random() < dt / self["every"]:
                self._burst = self.draw.gauss(0.0, self["burst"])
                self._left = self.draw.expovariate(1.0 / self["memory"])
        inputs[self.channel] += self._force + self._burst


def drawn_weather(rng: Rng, craft: Craft) -> Mapping[str, float]:
    """Return weather of 10 to 100 % of full command, remembered for half to five time constants; bursts in half."""
    spread = craft.full[craft.input] * log_uniform(rng, 0.1, 1.0)
    memory = craft.pace * log_uniform(rng, 0.5, 5.0)
    return {
        "spread": spread,
        "memory": memory,
        "burst": spread * rng.uniform(1.0, 3.0) if rng.random() < 0.5 else 0.0,
        "every": craft.duration * rng.uniform(0.1, 0.3),
    }


def smoothed(file: Mapping[str, Array], width: int) -> dict[str, Array]:
    """Return the file with its heading smoothed forwards and backwards over *width* samples, and its rate from that."""
    found = dict(file)
    if width > 1:
        keep = 1.0 - 1.0 / width
        psi = file["psi"].copy()
        for _ in range(2):
            for i in range(1, len(psi)):
                psi[i] = keep * psi[i - 1] + (1.0 - keep) * psi[i]
            psi = psi[::-1]
        found["psi"] = psi
    found["r"] = np.gradient(found["psi"], file["t"])
    return found
