"""A video from above and a telemetry log to one run: position and heading of the craft, and its commands."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import BadFile, MissingChannel, NotInformative
from gcs_autotune.notebook import Displayed
from gcs_autotune.smoothing import local_polynomials
from gcs_autotune.sname import INPUTS
from gcs_autotune.trial import Channel, Trial
from gcs_autotune.vision.camera import FloorCamera
from gcs_autotune.vision.marker import MARKERS
from gcs_autotune.vision.pictures import pictures

__all__ = ["Track", "Tracked", "clock_offset", "joined", "track"]

Array = NDArray[np.float64]
GAP = 1.0
"""Longest time [s] without a picture or without telemetry. Project choice."""
LEAST_SEEN = 0.5
"""Least part of the pictures that must show the marker. Project choice."""
LEAST_CORRELATION = 0.6
"""Least correlation of the two yaw rates. Project choice."""
_STEP, _COARSE = 0.02, 5
"""Interval at which yaw rates are compared [s], and of the first search in such intervals. Project choices."""
_LEAST_OVERLAP = 5.0
"""Least common time of video and log [s]. Project choice."""
_RIVALS, _APART, _ALIKE = 5, 0.6, 0.02
"""Offsets that are compared, their least distance [s], and the difference of correlations that distinguishes them.
Project choices."""
_WIDTH = 9
"""Samples of a local polynomial for the yaw rate. Project choice."""


@dataclass(frozen=True, slots=True, eq=False)
class Track(Displayed):
    """What a video shows. t : (n,) [s] of the video. x, y : (n,) [m]. psi : (n,) [rad], continuous.

    lost : number of pictures without the marker. by_line : whether bow and stern may be exchanged.
    """

    name: str
    t: Array
    x: Array
    y: Array
    psi: Array
    lost: int
    by_line: bool


@dataclass(frozen=True, slots=True, eq=False)
class Tracked(Displayed):
    """The run, the time of the log minus that of the video [s], and the correlation of the yaw rates, if used."""

    run: Trial
    offset: float
    correlation: float | None


def track(source: str, camera: FloorCamera, marker: str = "red-line", rate: float | None = None) -> Track:
    """Return the track of the craft in the pictures of *source*. marker : its name in ``MARKERS``.

    Raises
    ------
    BadFile
        A picture cannot be read, has another size than the calibration, or does not follow the one before.
    NotInformative
        Too few pictures show the marker.
    """
    find, rows, count, first_lost, last = MARKERS[marker], [], 0, 0, -math.inf
    for picture in pictures(source, rate):
        height, width, _ = picture.bgr.shape
        if camera.width and (width, height) != (camera.width, camera.height):
            raise BadFile(
                f"{source}, picture {picture.number}: {width} x {height} pixels, but the camera is calibrated for "
                f"{camera.width} x {camera.height}"
            )
        if math.isfinite(last) and picture.t - last > GAP:
            raise BadFile(
                f"{source}, picture {picture.number}: the time jumps by {picture.t - last:.2f} s. Cut the video there"
            )
        last, count = picture.t, picture.number
        marking = find(picture.bgr, camera)
        if marking is None:
            first_lost = first_lost or picture.number
            continue
        rows.append((picture.t, marking.x, marking.y, marking.psi))
    if count < 2:
        raise NotInformative(f"{source} contains one picture only. A run needs a video, or a picture every 0.1 s")
    if len(rows) < max(2, LEAST_SEEN * count):
        raise NotInformative(
            f"{source}: {len(rows)} of {count} pictures show the marker ({marker}). The first without it is picture "
            f"{first_lost}. Check the light and --marker"
        )
    t, x, y, psi = np.array(rows).T
    is_line = marker == "red-line"
    psi = np.unwrap(psi, period=math.pi if is_line else math.tau)
    return Track(Path(source).name, t, x, y, psi, count - len(rows), is_line)


def joined(seen: Track, log: Trial, *, offset: float | None = None, heading: float | None = None) -> Tracked:
    """Return a run on the clock of the log: ``x y psi`` of the video, and the commands of the log.

    offset : time of the log minus that of the video [s]; None: from the yaw rates. heading : first heading [rad], to
    distinguish bow and stern of a line; None: from the command ``X``, which drives the craft ahead.

    Raises
    ------
    MissingChannel
        The log contains no command, or no yaw rate to compare.
    NotInformative
        The yaw rates do not match, video and log do not overlap, or bow and stern cannot be distinguished.
    BadFile
        The log has a gap.
    """
    commands = [name for name in INPUTS if name in log and len(log[name])]
    if not commands:
        have = ", ".join(log.channels) or "nothing"
        raise MissingChannel(f"{log.name}: no command (X, Y, N, delta ...). It contains {have}")
    correlation = None
    if offset is None:
        offset, correlation = clock_offset(seen, log)
    t = seen.t + offset
    start, end = max(t[0], log.start), min(t[-1], log.end)
    if end - start < _LEAST_OVERLAP:
        raise NotInformative(
            f"{seen.name} ({t[0]:.1f} to {t[-1]:.1f} s on the clock of the log) and {log.name} ({log.start:.1f} to "
            f"{log.end:.1f} s) have less than {_LEAST_OVERLAP:.0f} s in common. Check --offset"
        )
    _verify_no_gap(log, commands, start, end)
    psi = seen.psi + (math.pi if seen.by_line and _is_backwards(seen, log, offset, heading) else 0.0)
    values = {"x": (seen.x, "m"), "y": (seen.y, "m"), "psi": (psi, "rad")}
    channels = {n: Channel(n, unit, t, v).between(start, end) for n, (v, unit) in values.items()}
    for name in commands:
        held = log[name]
        first = max(0, int(np.searchsorted(held.t, start, side="right")) - 1)
        last = int(np.searchsorted(held.t, end, side="right"))
        stamps = np.maximum(held.t[first:last], start)
        channels[name] = Channel(name, held.unit, stamps, held.values[first:last])
    meta: dict[str, Any] = {**log.meta, "source": f"{seen.name} and {log.name}", "clock_offset": offset}
    return Tracked(Trial(f"{log.name} from above", channels, log.marks, meta=meta), offset, correlation)


def _verify_no_gap(log: Trial, commands: Sequence[str], start: float, end: float) -> None:
    """Raise for a time without telemetry. A command may be logged only when it changes."""
    names = [n for n in ("r", "psi") if n in log] or commands
    stamps = np.unique(np.concatenate([log[n].between(start, end).t for n in names]))
    gaps = np.diff(stamps)
    if len(gaps) and gaps.max() > GAP:
        at = int(np.argmax(gaps))
        raise BadFile(
            f"{log.name}: no {' or '.join(names)} from {stamps[at]:.2f} to {stamps[at + 1]:.2f} s. Cut the log there"
        )


def clock_offset(seen: Track, log: Trial) -> tuple[float, float]:
    """Return the time of the log minus that of the video [s] at which the yaw rates match best, and their correlation.

    Raises
    ------
    MissingChannel
        The log contains neither ``r`` nor ``psi``.
    NotInformative
        Too short, or no clear match.
    """
    if "r" in log and len(log["r"]) > _WIDTH:
        t, r = log["r"].t, log["r"].values
    elif "psi" in log and len(log["psi"]) > _WIDTH:
        t = log["psi"].t
        r = _rate(t, np.unwrap(log["psi"].values), t)
    else:
        raise MissingChannel(f"{log.name}: no yaw rate r or heading psi to compare with the video. Use --offset")
    if min(t[-1] - t[0], seen.t[-1] - seen.t[0]) < _LEAST_OVERLAP:
        raise NotInformative(f"{seen.name} or {log.name} is shorter than {_LEAST_OVERLAP:.0f} s. Use --offset")
    grid = np.arange(seen.t[0], seen.t[-1], _STEP)
    video = _rate(seen.t, seen.psi, grid)

    def match(offset: float) -> float:
        at = grid + offset
        common = (at >= t[0]) & (at <= t[-1])
        if common.sum() * _STEP < max(_LEAST_OVERLAP, 0.5 * min(t[-1] - t[0], grid[-1] - grid[0])):
            return -1.0
        a, b = video[common], np.interp(at[common], t, r)
        a, b = a - a.mean(), b - b.mean()
        size = math.sqrt(float(a @ a) * float(b @ b))
        return float(a @ b) / size if size > 0.0 else -1.0

    coarse = np.arange(t[0] - grid[-1], t[-1] - grid[0], _COARSE * _STEP)
    scores = np.array([match(float(v)) for v in coarse])
    offsets = []
    for _ in range(_RIVALS):
        best = float(coarse[int(np.argmax(scores))])
        scores[np.abs(coarse - best) < _APART] = -1.0
        for step in (_STEP, 0.1 * _STEP):
            near = best + step * np.arange(-_COARSE - 1, _COARSE + 2)
            best = float(near[int(np.argmax([match(float(v)) for v in near]))])
        offsets.append((match(best), best))
    highest = max(offsets)[0]
    if highest < LEAST_CORRELATION:
        raise NotInformative(
            f"the yaw rates of {seen.name} and {log.name} do not match (best correlation {highest:.2f}). Use --offset"
        )
    alike = [(_surge_match(seen, log, offset), offset, c) for c, offset in offsets if c > highest - _ALIKE]
    alike.sort(reverse=True)
    if len(alike) > 1 and alike[0][0] - alike[1][0] < _ALIKE:
        raise NotInformative(
            f"{seen.name} matches {log.name} at offsets of {alike[0][1]:.2f} and {alike[1][1]:.2f} s, because the "
            "turns repeat. Use --offset"
        )
    return alike[0][1], alike[0][2]


def _surge_match(seen: Track, log: Trial, offset: float) -> float:
    """Return the part of the acceleration ahead that the command ``X`` and the speed explain; 0 without ``X``."""
    if "X" not in log or len(log["X"]) < 2:
        return 0.0
    at = np.arange(max(seen.t[0], log.start - offset), min(seen.t[-1], log.end - offset), 0.1)
    psi, moves = np.interp(at, seen.t, seen.psi), []
    width = min(2 * _WIDTH + 1, len(seen.t))
    north, east = (local_polynomials(seen.t, v, at, width, 3) for v in (seen.x, seen.y))
    for order in (1, 2):
        moves.append(np.cos(psi) * north.derivative(order) + np.sin(psi) * east.derivative(order))
    X = np.array([log["X"].held_at(float(v)) for v in at + offset])
    table = np.column_stack([X, moves[0], np.ones(len(at))])
    residual = moves[1] - table @ np.linalg.lstsq(table, moves[1], rcond=None)[0]
    return 1.0 - float(np.var(residual) / max(np.var(moves[1]), 1e-12))


def _rate(t: Array, psi: Array, at: Array) -> Array:
    return local_polynomials(t, psi, at, min(_WIDTH, len(t)), 2).derivative(1)


def _is_backwards(seen: Track, log: Trial, offset: float, heading: float | None) -> bool:
    """Return whether the heading of a line points astern."""
    if heading is not None:
        return math.cos(seen.psi[0] - heading) < 0.0
    width = min(_WIDTH, len(seen.t))
    north = local_polynomials(seen.t, seen.x, seen.t, width, 2).derivative(1)
    east = local_polynomials(seen.t, seen.y, seen.t, width, 2).derivative(1)
    ahead = north * np.cos(seen.psi) + east * np.sin(seen.psi)
    if "X" in log and len(log["X"]):
        X = np.array([log["X"].held_at(v) for v in seen.t + offset])
        size = math.sqrt(float(ahead @ ahead) * float(X @ X))
        agreement = float(ahead @ X) / size if size > 0.0 else 0.0
        if abs(agreement) > 0.3:
            return agreement < 0.0
    raise NotInformative(
        f"{seen.name}: the motion does not show which end of the line is the bow. Give the first heading: --bow DEG"
    )
