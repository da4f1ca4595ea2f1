"""Find the craft in a picture from above: by a red line on its top (algorithm 3.2 of Miskovic2010), or an AprilTag."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.vision.camera import FloorCamera
from gcs_autotune.vision.opencv import opencv

__all__ = ["MARKERS", "Seen"]

_BRIGHT = 90
"""Brightness from which the red component counts as 1 [grey levels]. Project choice."""
_OTHERS = 0.65
"""Part of the red component from which the green and the blue one count as 1. Project choice."""
_SMALLEST = 20
"""Smallest group of pixels that counts as the marker. Project choice."""


@dataclass(frozen=True, slots=True)
class Seen:
    """Place [m] and heading [rad] of the marker on the floor. A line does not show which of its ends is the bow."""

    x: float
    y: float
    psi: float


def find_line(bgr: NDArray[np.uint8], camera: FloorCamera) -> Seen | None:
    """Return the largest red group in the picture; None if there is none.

    Its pixels are weighted by their red component above the others, which gives fractions of a pixel.
    """
    cv2 = opencv()
    blue, green, red = cv2.split(bgr)
    others = cv2.max(blue, green)
    # (3.10): R and not B and not G
    others_off = cv2.compare(others, cv2.convertScaleAbs(red, alpha=_OTHERS), cv2.CMP_LT)
    mask = cv2.bitwise_and(cv2.compare(red, _BRIGHT, cv2.CMP_GT), others_off)
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((2, 2), np.uint8))
    mask = cv2.dilate(mask, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5)))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask)
    if count < 2:
        return None
    label = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    left, top, width, height, area = (int(v) for v in stats[label])
    if area < _SMALLEST:
        return None
    box = (slice(top, top + height), slice(left, left + width))
    rows, columns = np.nonzero(labels[box] == label)
    weight = cv2.subtract(red[box], others[box])[rows, columns].astype(np.float64)
    places = camera.to_floor(np.column_stack([columns + left, rows + top]).astype(np.float64))
    weight /= weight.sum()
    x, y = weight @ places
    north, east = places[:, 0] - x, places[:, 1] - y
    psi = 0.5 * math.atan2(2.0 * float(weight @ (north * east)), float(weight @ (north**2 - east**2)))
    return Seen(float(x), float(y), psi)


def find_tag(bgr: NDArray[np.uint8], camera: FloorCamera) -> Seen | None:
    """Return the AprilTag (36h11) in the picture, whose upper edge points ahead; None if there is none or several."""
    corners, _, _ = _detector().detectMarkers(opencv().cvtColor(bgr, opencv().COLOR_BGR2GRAY))
    if len(corners) != 1:
        return None
    places = camera.to_floor(np.asarray(corners[0], dtype=np.float64).reshape(4, 2))
    x, y = places.mean(axis=0)
    ahead = places[:2].mean(axis=0) - places[2:].mean(axis=0)
    return Seen(float(x), float(y), math.atan2(ahead[1], ahead[0]))


def _detector() -> Any:
    aruco = opencv().aruco
    settings = aruco.DetectorParameters()
    settings.cornerRefinementMethod = aruco.CORNER_REFINE_SUBPIX
    return aruco.ArucoDetector(aruco.getPredefinedDictionary(aruco.DICT_APRILTAG_36h11), settings)


MARKERS: Mapping[str, Callable[[NDArray[np.uint8], FloorCamera], Seen | None]] = {
    "red-line": find_line,
    "apriltag": find_tag,
}
"""Name of a marker -> function that finds it. To add a marker, add a function and a line here."""
