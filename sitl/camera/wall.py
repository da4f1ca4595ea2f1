"""A camera that looks ahead at a flat wall with two laser dots (Miskovic2010, section 3.4, figure 3.8).

The beams are parallel to the axis of the camera, on either side of it and below. The camera is a pinhole, set back from
the lasers. With these numbers a dot is as far from the centre as table 3.1 prints it, within 10 % from 10 to 100 cm.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sitl.camera.noise import NOISE, PictureNoise, Spoiler, add_spot

__all__ = ["WallCamera"]

_WALL = (40.0, 55.0, 60.0)
"""Colour of the wall: red, green, blue. Project choice."""
_DOT = (700.0, 180.0, 160.0)
"""Brightness of a dot in red, green and blue. Its middle saturates to white, as in real pictures. Project choice."""
_DOT_SIZE = 0.004
"""Standard deviation of a dot on the wall [m]. Project choice."""


class WallCamera:
    """Camera with two lasers *apart* [m], *below* [m] its axis and *ahead* [m] of it.

    focal : focal length [pixels]. noise : name of a level in :data:`NOISE`, or its numbers.
    """

    def __init__(
        self,
        noise: str | PictureNoise = "clear",
        *,
        width: int = 640,
        height: int = 480,
        focal: float = 478.0,
        apart: float = 0.2,
        below: float = 0.03,
        ahead: float = 0.063,
        seed: int = 0,
    ) -> None:
        self.width, self.height, self.apart = width, height, apart
        self._focal, self._below, self._ahead = focal, below, ahead
        self._spoiler = Spoiler(NOISE[noise] if isinstance(noise, str) else noise, height, width, seed)

    def beams(self, distance: float, angle: float) -> tuple[float, float]:
        """Return the lengths [m] of the beams of port and starboard.

        distance : from the middle between the lasers to the wall, straight ahead [m]. angle : heading minus that at a
        right angle to the wall [rad]; if it is positive, the starboard beam is longer.
        """
        more = 0.5 * self.apart * math.tan(angle)
        return distance - more, distance + more

    def dots(self, distance: float, angle: float) -> NDArray[np.float64]:
        """Return the places (2, 2) of the dots (x, y) [pixels], that of port first."""
        sides = (-0.5 * self.apart, 0.5 * self.apart)
        places = []
        for side, length in zip(sides, self.beams(distance, angle), strict=True):
            scale = self._focal / (length + self._ahead)
            places.append((0.5 * (self.width - 1) + scale * side, 0.5 * (self.height - 1) + scale * self._below))
        return np.array(places)

    def picture(self, distance: float, angle: float = 0.0) -> NDArray[np.uint8]:
        """Return the picture (height, width, 3) at that *distance* [m] and *angle* [rad]."""
        sizes = [self._focal * _DOT_SIZE / (length + self._ahead) for length in self.beams(distance, angle)]
        return self.with_dots(self.dots(distance, angle), sizes)

    def with_dots(self, places: NDArray[np.float64], sizes: list[float]) -> NDArray[np.uint8]:
        """Return a picture with dots at *places* (n, 2) of *sizes*: standard deviations [pixels], without the blur."""
        picture = np.empty((self.height, self.width, 3), dtype=np.float32)
        picture[:] = _WALL
        blur = self._spoiler.noise.blur
        for place, size in zip(places, sizes, strict=True):
            blurred = math.hypot(size, blur)
            add_spot(picture, place, blurred, np.array(_DOT) * max(size / blurred, 0.3) ** 2)
        return self._spoiler.spoil(picture)
