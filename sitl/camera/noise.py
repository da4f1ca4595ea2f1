"""What water and sensor add to a picture: blur, particles, glare and noise. All numbers are project choices."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["NOISE", "PictureNoise", "Spoiler"]

Array = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class PictureNoise:
    """Noise of one camera.

    grain : standard deviation of a pixel [grey levels of 255]. blur : standard deviation of a point [pixels].
    particles : bright specks per picture. glare : number of bright reflections per picture.
    """

    grain: float
    blur: float
    particles: int
    glare: int


NOISE: Mapping[str, PictureNoise] = {
    "clear": PictureNoise(grain=2.0, blur=0.8, particles=0, glare=0),
    "turbid": PictureNoise(grain=6.0, blur=1.5, particles=25, glare=0),
    "murky": PictureNoise(grain=12.0, blur=2.5, particles=80, glare=2),
}
"""Level of noise -> its numbers."""
_FIELDS = 4
"""Fields of noise that are drawn once. Each picture has one of them, shifted at random."""


class Spoiler:
    """Adds the noise to pictures of one size. The same seed gives the same pictures."""

    def __init__(self, noise: PictureNoise, height: int, width: int, seed: int) -> None:
        self.noise = noise
        self._rng = np.random.default_rng(seed)
        self._fields = self._rng.normal(0.0, noise.grain, (_FIELDS, height, width, 3)).astype(np.float32)

    def spoil(self, picture: Array) -> NDArray[np.uint8]:
        """Return *picture* (height, width, 3) with particles, glare and noise, cut to 0 to 255."""
        rng, (height, width, _) = self._rng, picture.shape
        for _ in range(self.noise.particles):
            at = rng.uniform((0.0, 0.0), (width, height))
            add_spot(picture, at, rng.uniform(0.6, 2.0), rng.uniform(40.0, 200.0) * np.array([0.8, 1.0, 1.0]))
        for _ in range(self.noise.glare):
            at = rng.uniform((0.0, 0.0), (width, height))
            add_spot(picture, at, rng.uniform(15.0, 35.0), np.full(3, rng.uniform(120.0, 300.0)))
        field = self._fields[rng.integers(_FIELDS)]
        shift = (int(rng.integers(height)), int(rng.integers(width)))
        picture += np.roll(field, shift, axis=(0, 1))
        return np.clip(np.rint(picture), 0.0, 255.0).astype(np.uint8)


def add_spot(picture: Array, at: NDArray[np.float64], size: float, colour: NDArray[np.float64]) -> None:
    """Add a Gaussian spot to *picture*.

    at : (2,) its place (x, y) [pixels]; the middle of the first pixel is 0. size : its standard deviation [pixels].
    colour : (3,) its brightness.
    """
    height, width, _ = picture.shape
    reach = int(np.ceil(4.0 * size))
    left, right = max(0, int(at[0]) - reach), min(width, int(at[0]) + reach + 2)
    top, bottom = max(0, int(at[1]) - reach), min(height, int(at[1]) + reach + 2)
    if left >= right or top >= bottom:
        return
    x, y = np.arange(left, right) - at[0], np.arange(top, bottom) - at[1]
    spot = np.exp(-0.5 * (y[:, None] ** 2 + x[None, :] ** 2) / size**2)
    picture[top:bottom, left:right] += (spot[:, :, None] * colour).astype(np.float32)
