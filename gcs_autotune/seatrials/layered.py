"""Figures of a layered manoeuvre: how far the craft was from its planned path, and how it arrived."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from gcs_autotune.control import TimedPath
from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.open_loop import Reading
from gcs_autotune.seatrials.criteria import Particulars, Sheet, judged, known
from gcs_autotune.sname import wrap
from gcs_autotune.trial import Trial

__all__ = ["layered_sheet"]

LATE = 2.0 / 3.0
"""Fraction of the run after which the craft counts as arrived, for the heading of a turn or a held pose."""


def layered_sheet(run: Trial, ship: Particulars) -> Sheet:
    """Return the figures of a run along a planned path, or along a wall.

    Raises
    ------
    NotInformative
        The record contains no path and no distance to a wall.
    """
    kind = str(run.meta.get("manoeuvre", ""))
    figures = _wall(run) if "path" not in run.meta else _path(run)
    if not figures:
        raise NotInformative(f"the record of {kind} contains neither its path nor a distance to a wall")
    rows = known(*(judged(slug, name, Reading(value, math.nan, unit)) for slug, name, value, unit in figures))
    return Sheet(run.name, kind, kind, rows, "", ())


def _path(run: Trial) -> list[tuple[str, str, float, str]]:
    places, velocities = (_fours(run.meta[name]) for name in ("path", "path_velocity"))
    path = TimedPath(tuple(float(t) for t in run.meta["path_t"]), places, velocities)
    start = next((m.t for m in run.marks if m.kind == "target"), run.start)
    t = run["psi"].t
    t = t[(t >= start) & (t <= start + path.seconds + 60.0)]
    wanted = [path.target(float(at - start)) for at in t]
    psi = np.interp(t, run["psi"].t, run["psi"].values)
    turned = np.array([wrap(float(a) - w.position[3]) for a, w in zip(psi, wanted, strict=True)])
    late = t >= start + LATE * (t[-1] - start)
    found = []
    if math.isfinite(places[0][0]):
        x, y = (np.interp(t, run[name].t, run[name].values) for name in ("x", "y"))
        at = np.array([w.position[:2] for w in wanted])
        away = np.hypot(x - at[:, 0], y - at[:, 1])
        across = _across(path, np.column_stack([x, y]))
        end = np.hypot(x - places[-1][0], y - places[-1][1])
        if not np.ptp(np.array(places)[:, :2], axis=0).any():  # a hover: the path is one point
            found += [
                ("target-rms", "distance to the point, rms", _rms(away), "m"),
                ("target-most", "distance to the point, greatest", float(away.max()), "m"),
            ]
        else:
            found += [
                ("target-rms", "distance to the moving target, rms", _rms(away), "m"),
                ("path-rms", "distance to the path, rms", _rms(across), "m"),
                ("path-most", "distance to the path, greatest", float(across.max()), "m"),
                ("arrival", "closest to the end", float(end.min()), "m"),
            ]
    if not any(velocities[-1][:2]):
        found.append(("heading-rms", "heading error in the last third, rms", _rms(turned[late]), "rad"))
    if "z" in run and "Z" in run and run["Z"].values.any() and math.isfinite(places[0][2]):
        z = np.interp(t, run["z"].t, run["z"].values)
        depth = np.array([w.position[2] for w in wanted])
        found.append(("depth-rms", "depth error, rms", _rms(z - depth), "m"))
    return found


def _fours(rows: Sequence[Sequence[float | None]]) -> tuple[tuple[float, float, float, float], ...]:
    """Return rows of four numbers; an unknown one is NaN, which a file contains as null."""
    known_rows = [[math.nan if value is None else float(value) for value in row] for row in rows]
    return tuple((a, b, c, d) for a, b, c, d in known_rows)


def _across(path: TimedPath, places: np.ndarray) -> np.ndarray:
    """Return the distance of *places* (n, 2) to the nearest point of the path (n,) [m]."""
    on = np.array([path.places[0][:2], *path.places_on_it()])
    steps = on[1:] - on[:-1]
    length = np.maximum(np.sum(steps**2, axis=1), 1e-12)
    share = np.clip(np.einsum("ijk,jk->ij", places[:, None] - on[None, :-1], steps) / length, 0.0, 1.0)
    nearest = on[None, :-1] + share[:, :, None] * steps[None]
    return np.asarray(np.min(np.linalg.norm(places[:, None] - nearest, axis=2), axis=1))


def _wall(run: Trial) -> list[tuple[str, str, float, str]]:
    targets = [(m.t, float(m.detail["value"])) for m in run.marks if m.kind == "target"]
    if not targets or "d" not in run:
        return []
    error = run["d"].between(targets[-1][0], run.end).values - targets[-1][1]
    error = error[np.isfinite(error)]
    if not len(error):
        return []
    return [
        ("distance-rms", "distance to the wall, error along it, rms", _rms(error), "m"),
        ("distance-mean", "distance to the wall, error along it, mean", float(np.mean(error)), "m"),
    ]


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else math.nan
