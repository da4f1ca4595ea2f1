"""Find two laser dots in a picture: algorithm 3.1 of Miskovic2010.

Each dot is searched in a square around its last place. If one of them is not there, the whole picture is searched.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.vision.opencv import opencv

__all__ = ["COLOURS", "WINDOW", "Dot", "DotFinder", "Dots", "Line"]

COLOURS: Mapping[str, int] = {"blue": 0, "green": 1, "red": 2}
"""Colour of a laser -> its channel in a picture of OpenCV."""
WINDOW = 80
"""Side of a search window [pixels]: at 2 pictures/s and 0.1 m/s a dot moves less, from 0.2 m on. Project choice."""
_SMOOTH = 1.5
"""Standard deviation of the filter before the search [pixels]. Project choice."""
_LEAST = 18.0
"""Least excess of the laser's colour over the others in a dot, after the filter [grey levels]. Project choice."""
_ABOVE_NOISE = 6.0
"""Least ratio of this excess to the noise of the picture. Project choice."""
_PART = 0.4
"""Part of its brightest point from which a pixel counts as part of a dot. Project choice."""
_TRIES = 6
"""Bright points examined on each side. Project choice."""
_OFF_LINE = 8.0
"""Largest distance of a dot from its line [pixels]. Project choice."""

Dot = tuple[float, float]
"""Place of a dot (x, y) [pixels] from the centre of the picture, to the right and down."""
Line = tuple[float, float]
"""The line on which a dot moves with the distance: y at x = 0 [pixels], and dy/dx."""
_Place = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Dots:
    """What one picture shows: the dots to the left (*port*) and right (*starboard*) of its centre.

    ``searched``: whether the windows were enough.
    """

    port: Dot | None
    starboard: Dot | None
    searched: Literal["windows", "picture"]

    @property
    def missing(self) -> str:
        """What is missing, for a message; empty if both dots are there."""
        if self.port is None and self.starboard is None:
            return "no laser dot"
        if self.port is None or self.starboard is None:
            return f"one laser dot, on the {'port' if self.starboard is None else 'starboard'} side"
        return ""


class DotFinder:
    """Finds the dots in one picture after the other.

    Parameters
    ----------
    colour : colour of the lasers, in :data:`COLOURS`.
    lines : the lines of the dots of port and starboard, from a calibration. Bright points off their line are no dots.
    window : side of a search window [pixels]. 0: the whole picture is searched every time.
    """

    def __init__(
        self, colour: str = "red", lines: tuple[Line | None, Line | None] = (None, None), window: int = WINDOW
    ) -> None:
        self._channel, self._lines, self._window = COLOURS[colour], lines, window
        self._last: list[_Place] | None = None

    def forget(self) -> None:
        """Search the whole next picture."""
        self._last = None

    def find(self, bgr: NDArray[np.uint8]) -> Dots:
        """Return the dots in the picture *bgr* (height, width, 3)."""
        height, width, _ = bgr.shape
        half, middle = width // 2, (0.5 * (width - 1), 0.5 * (height - 1))
        if self._last is not None and self._window:
            near = [self._in_window(bgr, place, side, middle) for side, place in enumerate(self._last)]
            if near[0] is not None and near[1] is not None:
                return self._dots(near, middle, "windows")
        whole = [
            self._search(bgr[:, :half], (0.0, 0.0), self._lines[0], middle),
            self._search(bgr[:, half:], (float(half), 0.0), self._lines[1], middle),
        ]
        return self._dots(whole, middle, "picture")

    def _dots(self, places: list[_Place | None], middle: _Place, searched: Literal["windows", "picture"]) -> Dots:
        port, starboard = ((p[0] - middle[0], p[1] - middle[1]) if p is not None else None for p in places)
        both = [p for p in places if p is not None]
        self._last = both if len(both) == 2 else None
        return Dots(port, starboard, searched)

    def _in_window(self, bgr: NDArray[np.uint8], place: _Place, side: int, middle: _Place) -> _Place | None:
        """Search the window about *place*, on one side of the picture only."""
        height, width, _ = bgr.shape
        half = self._window // 2
        least, most = (0, width // 2) if side == 0 else (width // 2, width)
        left, right = max(least, int(place[0]) - half), min(most, int(place[0]) + half)
        top, bottom = max(0, int(place[1]) - half), min(height, int(place[1]) + half)
        return self._search(bgr[top:bottom, left:right], (float(left), float(top)), self._lines[side], middle)

    def _search(self, part: NDArray[np.uint8], origin: _Place, line: Line | None, middle: _Place) -> _Place | None:
        """Return the place in the picture of the brightest dot in *part*, whose first pixel is at *origin*."""
        if part.shape[0] < 3 or part.shape[1] < 3:
            return None
        cv2 = opencv()
        channels = cv2.split(part)
        others = cv2.max(*(c for i, c in enumerate(channels) if i != self._channel))
        excess = cv2.GaussianBlur(cv2.subtract(channels[self._channel], others).astype(np.float32), (0, 0), _SMOOTH)
        floor = float(np.median(excess[::3, ::3]))
        noise = 1.4826 * float(np.median(np.abs(excess[::3, ::3] - floor)))
        least = max(_LEAST, _ABOVE_NOISE * noise)
        for _ in range(_TRIES):
            _, peak, _, at = cv2.minMaxLoc(excess)
            if peak - floor < least:
                return None
            place = self._centroid(excess, at, floor + _PART * (peak - floor))
            spot = (origin[0] + place[0], origin[1] + place[1])
            if line is None or _off(line, spot, middle) <= _OFF_LINE:
                return spot
        return None

    @staticmethod
    def _centroid(excess: NDArray[np.float32], at: tuple[int, int], level: float) -> _Place:
        """Return the centroid of the pixels above *level* that touch the point *at*, and remove them."""
        cv2 = opencv()
        mask = np.zeros((excess.shape[0] + 2, excess.shape[1] + 2), dtype=np.uint8)
        above = (excess > level).astype(np.uint8)
        _, _, _, (x, y, w, h) = cv2.floodFill(above, mask, at, 2)
        box = (slice(y, y + h), slice(x, x + w))
        blob = above[box] == 2
        weight = np.where(blob, excess[box] - level, 0.0)
        total = float(weight.sum())
        place = (
            x + float(weight.sum(axis=0) @ np.arange(w)) / total,
            y + float(weight.sum(axis=1) @ np.arange(h)) / total,
        )
        grown = cv2.dilate(blob.astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool)
        excess[box][grown] = 0.0
        return place


def _off(line: Line, place: _Place, middle: _Place) -> float:
    """Return the distance [pixels] of *place* from *line*."""
    x, y = place[0] - middle[0], place[1] - middle[1]
    return abs(y - line[0] - line[1] * x) / math.hypot(1.0, line[1])
