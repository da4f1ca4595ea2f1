"""A camera above a pool, which sees a craft with a red line on its top (Miskovic2010, section 3.5.2, figure 3.12).

The camera is a pinhole with a distorting lens. It looks down, slightly tilted. Its picture has north at the top.
"""

from __future__ import annotations

import math
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sitl.camera.noise import NOISE, PictureNoise, Spoiler

__all__ = ["PoolCamera"]

Array = NDArray[np.float64]
_WATER, _HULL, _LINE = (95.0, 150.0, 185.0), (60.0, 60.0, 55.0), (215.0, 45.0, 40.0)
"""Colours of water, hull and marker: red, green, blue. Project choices."""
_SIZES = ((0.355, 0.228), (0.30, 0.04))
"""Length and width of hull (Miskovic2007, section II) and marker (project choice) [m]."""


class PoolCamera:
    """Camera *above* [m] the plane in which the marker moves.

    focal : focal length [pixels]. tilt : angle of its axis from straight down [rad]. lens : radial distortion k1, k2 of
    a point at the distance of one focal length. noise : name of a level in :data:`NOISE`, or its numbers.
    """

    def __init__(
        self,
        noise: str | PictureNoise = "clear",
        *,
        width: int = 640,
        height: int = 480,
        focal: float = 420.0,
        above: float = 3.0,
        tilt: float = 0.06,
        lens: tuple[float, float] = (-0.22, 0.05),
        seed: int = 0,
    ) -> None:
        self.width, self.height, self._focal, self._lens = width, height, focal, lens
        c, s = math.cos(tilt), math.sin(tilt)
        turn = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
        # Columns: one metre north, one metre east, and the point of the plane below the camera, in axes of the camera.
        self._plane = turn @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, above]])
        self._rays = self._all_rays()
        self._north, self._east = self._on(self._plane)
        self._pixel = above / focal
        self._spoiler = Spoiler(NOISE[noise] if isinstance(noise, str) else noise, height, width, seed)

    @classmethod
    def of_width(cls, width: int, noise: str | PictureNoise = "clear", *, seed: int = 0) -> Self:
        """Return the camera with pictures of another *width* [pixels] and the same view."""
        return cls(noise, width=width, height=width * 3 // 4, focal=420.0 * width / 640, seed=seed)

    def _all_rays(self) -> Array:
        """Return the directions (3, height, width) of all pixels without the distortion of the lens."""
        x = (np.arange(self.width) - 0.5 * (self.width - 1)) / self._focal
        y = (np.arange(self.height) - 0.5 * (self.height - 1)) / self._focal
        pixels = np.array(np.meshgrid(x, y))
        true = pixels.copy()
        for _ in range(30):
            true = pixels / self._stretch(true)
        return np.concatenate([true, np.ones((1, self.height, self.width))])

    def _stretch(self, point: Array) -> Array:
        square = point[0] ** 2 + point[1] ** 2
        stretch: Array = 1.0 + self._lens[0] * square + self._lens[1] * square**2
        return stretch

    def _on(self, plane: Array) -> Array:
        """Return the coordinates (2, height, width) at which each pixel sees *plane*, in units of its axes."""
        point = np.tensordot(np.linalg.inv(plane), self._rays, axes=1)
        coordinates: Array = point[:2] / point[2]
        return coordinates

    def pixel(self, x: float, y: float) -> tuple[float, float]:
        """Return where the point *x* north and *y* east [m] of the marker's plane is in the picture [pixels]."""
        at = self._plane @ np.array([x, y, 1.0])
        point = at[:2] / at[2]
        column, row = self._focal * point * self._stretch(point)
        return column + 0.5 * (self.width - 1), row + 0.5 * (self.height - 1)

    def picture(self, x: float, y: float, psi: float) -> NDArray[np.uint8]:
        """Return the picture (height, width, 3) of the craft at *x* north, *y* east [m], heading *psi* [rad]."""
        picture = self._water()
        column, row = (round(v) for v in self.pixel(x, y))
        reach = math.ceil(0.3 / self._pixel)
        box = (slice(max(0, row - reach), max(0, row + reach)), slice(max(0, column - reach), max(0, column + reach)))
        north, east = self._north[box] - x, self._east[box] - y
        c, s = math.cos(psi), math.sin(psi)
        along, across = np.abs(c * north + s * east), np.abs(c * east - s * north)
        soft = self._pixel * (1.0 + 2.0 * self._spoiler.noise.blur)
        for (length, width), colour in zip(_SIZES, (_HULL, _LINE), strict=True):
            part = np.ones_like(along)
            for distance, size in ((along, length), (across, width)):
                part *= np.clip(0.5 - (distance - 0.5 * size) / soft, 0.0, 1.0)
            picture[box] += part[:, :, None].astype(np.float32) * (np.array(colour, np.float32) - picture[box])
        return self._spoiler.spoil(picture)

    def empty(self) -> NDArray[np.uint8]:
        """Return a picture (height, width, 3) without a craft."""
        return self._spoiler.spoil(self._water())

    def board(self, turn: tuple[float, float, float], place: tuple[float, float, float]) -> NDArray[np.uint8]:
        """Return a picture of a board of 10 by 7 squares.

        turn : rotation vector of the board [rad]. place : its middle in axes of the camera [squares].
        """
        angle = math.sqrt(sum(v * v for v in turn)) or 1e-12
        a, b, c = (v / angle for v in turn)
        cross = np.array([[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]])
        rotation = np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross
        middle = np.array(place) - rotation[:, :2] @ np.array([5.0, 3.5])
        s, t = self._on(np.column_stack([rotation[:, :2], middle]))
        soft = place[2] / self._focal
        wave = _checks(s, soft) * _checks(t, soft)
        inside = (s > 0.0) & (s < 10.0) & (t > 0.0) & (t < 7.0)
        border = (s > -1.0) & (s < 11.0) & (t > -1.0) & (t < 8.0)
        bright = np.where(inside, 20.0 + 115.0 * (1.0 + wave), np.where(border, 250.0, 120.0))
        return self._spoiler.spoil(np.repeat(bright[:, :, None], 3, axis=2).astype(np.float32))

    def _water(self) -> NDArray[np.float32]:
        picture = np.empty((self.height, self.width, 3), dtype=np.float32)
        picture[:] = _WATER
        return picture


def _checks(at: Array, soft: float) -> Array:
    """Return 1 and -1 in alternating unit intervals, with edges *soft* wide."""
    saw = np.abs(np.mod(at + 0.5, 2.0) - 1.0) - 0.5
    return np.clip(2.0 * saw / soft, -1.0, 1.0)
