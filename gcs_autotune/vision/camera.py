"""From pixels of a camera to metres on a plane: lens, and the floor from four points or more."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from gcs_autotune.csv_table import cells_of, numbers_of
from gcs_autotune.documents import conformed, load_json
from gcs_autotune.errors import BadFile, NotInformative
from gcs_autotune.plain_json import json_text
from gcs_autotune.sname import parse_header, to_si
from gcs_autotune.vision.opencv import opencv
from gcs_autotune.vision.pictures import pictures

__all__ = ["BOARD", "FloorCamera", "calibrate_camera", "load_camera", "save_camera"]

Array = NDArray[np.float64]
_Row3 = tuple[float, float, float]
_Matrix3 = tuple[_Row3, _Row3, _Row3]
BOARD = (9, 6)
"""Inner corners of the board: the usual one of 10 by 7 squares."""
_ITERATIONS = 30
"""Iterations that invert the lens. Project choice."""
_LEAST_BOARDS = 5
"""Least number of pictures of the board. Project choice."""
_HEADS: Mapping[str, str] = {"column": "", "row": "", "x": "m", "y": "m"}
"""Columns of a table of floor points, and their unit after reading."""


class FloorCamera(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A camera that looks down, as in its file.

    matrix : camera matrix [pixels]. distortion : k1, k2, p1, p2, k3 of OpenCV. floor : homography from undistorted,
    normalised picture coordinates to north and east on the floor [m]. width, height : size of the pictures [pixels],
    0 if unknown.
    """

    matrix: _Matrix3
    distortion: tuple[float, float, float, float, float]
    floor: _Matrix3
    width: int = 0
    height: int = 0

    def to_floor(self, pixels: Array) -> Array:
        """Return the places (n, 2) on the floor [m], north and east, of *pixels* (n, 2)."""
        plain = _undistorted(pixels, np.array(self.matrix), np.array(self.distortion))
        at = np.column_stack([plain, np.ones(len(plain))]) @ np.array(self.floor).T
        places: Array = at[:, :2] / at[:, 2:]
        return places


def _undistorted(pixels: Array, matrix: Array, distortion: Array) -> Array:
    """Return normalised coordinates (n, 2) without the distortion of the lens, by OpenCV's model.

    OpenCV's own function stops after five iterations, which leaves tenths of a pixel at the edge of a wide lens.
    """
    k1, k2, p1, p2, k3 = (float(v) for v in distortion)
    distorted = np.column_stack(
        [(pixels[:, 0] - matrix[0, 2]) / matrix[0, 0], (pixels[:, 1] - matrix[1, 2]) / matrix[1, 1]]
    )
    x, y = distorted.T
    for _ in range(_ITERATIONS if distortion.any() else 0):
        square = x * x + y * y
        stretch = 1.0 + square * (k1 + square * (k2 + square * k3))
        shift_x = 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x)
        shift_y = p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y
        x, y = (distorted[:, 0] - shift_x) / stretch, (distorted[:, 1] - shift_y) / stretch
    return np.column_stack([x, y])


def calibrate_camera(floor: Path, boards: str = "", board: tuple[int, int] = BOARD) -> tuple[FloorCamera, float]:
    """Return the camera, and the rms distance of the floor points from the homography [m].

    floor : CSV file with columns ``column, row`` [pixels] and ``x[m], y[m]``, one row per point. boards : pictures of a
    checkerboard in many attitudes, for the lens; empty for a camera without distortion. board : its inner corners.

    Raises
    ------
    BadFile
        A file cannot be read, or the floor is mirrored.
    NotInformative
        Too few points or pictures, or all points on a line.
    """
    table = _points(floor)
    pixels, places = np.column_stack(table[:2]), np.column_stack(table[2:])
    matrix, distortion, size = np.eye(3), np.zeros(5), (0, 0)
    if boards:
        matrix, distortion, size = _lens(boards, board)
    else:  # any matrix does; this one keeps the numbers near 1
        matrix = np.array([[1000.0, 0.0, 0.0], [0.0, 1000.0, 0.0], [0.0, 0.0, 1.0]])
    plain = _undistorted(pixels, matrix, distortion)
    homography, _ = opencv().findHomography(plain, places) if len(plain) >= 4 else (None, None)
    if homography is None or not np.isfinite(homography).all() or np.linalg.matrix_rank(places - places[0]) < 2:
        raise NotInformative(f"{floor}: {len(plain)} points do not define the floor. Give four, no three on one line")
    # A picture has north up and east to the right: (column, row) = (y, -x), which is not mirrored.
    a = homography / homography[2, 2]
    if a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0] < 0.0:
        raise BadFile(f"{floor}: the floor is mirrored. Seen from above, y counts to the right of x")
    rows = [tuple(float(v) for v in row) for row in (*matrix, *homography)]
    camera = conformed(
        {
            "matrix": rows[:3],
            "distortion": [float(v) for v in distortion.ravel()],
            "floor": rows[3:],
            "width": size[0],
            "height": size[1],
        },
        FloorCamera,
        floor,
    )
    return camera, float(np.sqrt(np.mean(np.sum((camera.to_floor(pixels) - places) ** 2, axis=1))))


def _points(floor: Path) -> list[Array]:
    cells = cells_of(floor, "column,row,x[m],y[m]")
    numbers = numbers_of(cells)
    points = {}
    for i, index in enumerate(numbers.columns):
        name, unit = parse_header(cells.head[index])
        values = numbers.values[:, i] * (to_si(unit)[1] if _HEADS.get(name) else 1.0)
        if name in _HEADS and not np.isfinite(values).all():
            raise BadFile(f"{floor}, row {cells.first + int(np.argmin(np.isfinite(values)))}: {name} is not a number")
        points[name] = values
    missing = [name for name in _HEADS if name not in points]
    if missing:
        raise BadFile(f"{floor} has no column {', '.join(missing)}. Its columns must be column,row,x[m],y[m]")
    return [points[name] for name in _HEADS]


def _lens(boards: str, board: tuple[int, int]) -> tuple[Array, Array, tuple[int, int]]:
    """Return camera matrix, distortion and size from pictures of a board."""
    cv2 = opencv()
    grid = np.zeros((board[0] * board[1], 3), np.float32)
    grid[:, :2] = np.mgrid[0 : board[0], 0 : board[1]].T.reshape(-1, 2)
    corners, count, size = [], 0, (0, 0)
    for picture in pictures(boards):
        count, size = picture.number, (picture.bgr.shape[1], picture.bgr.shape[0])
        is_complete, places = cv2.findChessboardCornersSB(cv2.cvtColor(picture.bgr, cv2.COLOR_BGR2GRAY), board)
        if is_complete:
            corners.append(places)
    if len(corners) < _LEAST_BOARDS:
        raise NotInformative(
            f"{boards}: {len(corners)} of {count} pictures show a board with {board[0]} x {board[1]} inner corners. "
            f"Take at least {_LEAST_BOARDS}, from several sides and up to the edges of the picture"
        )
    _, matrix, distortion, _, _ = cv2.calibrateCamera([grid] * len(corners), corners, size, None, None)
    return matrix, distortion.ravel()[:5], size


def save_camera(camera: FloorCamera, path: Path) -> None:
    """Write the camera file.

    Raises
    ------
    BadFile
        The file cannot be written.
    """
    try:
        path.write_text(json_text({"schema": 1, **msgspec.to_builtins(camera)}), encoding="utf-8")
    except OSError as error:
        raise BadFile(f"{path} cannot be written: {error.strerror}") from error


def load_camera(path: Path) -> FloorCamera:
    """Return the camera in a file.

    Raises
    ------
    BadFile
        The file is not that of a camera; the message names the quantity.
    """
    data: Any = load_json(path, "a camera file")
    where = f"{path} is not a camera file (write one with `gcs-autotune calibrate camera`)"
    if not isinstance(data, dict) or data.get("schema") != 1:
        raise BadFile(where)
    camera = conformed({k: v for k, v in data.items() if k != "schema"}, FloorCamera, where)
    for name, matrix in (("matrix", camera.matrix), ("floor", camera.floor)):
        if abs(float(np.linalg.det(np.array(matrix)))) < 1e-12:
            raise BadFile(f"{path}: {name} cannot be inverted. Calibrate again")
    return camera
