"""Compare the heading with the track over ground, and speeds with positions.

The course of a craft differs from its heading because of sideslip, current, motion astern, or a compass mounted in the
wrong orientation. Sideslip is small if the craft does not turn. A current is a constant velocity over ground. Motion
astern is visible in the throttle. The remaining causes are the compass, or thrust with reversed sign.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.crosscheck.agreement import Comparison, Expected, compare
from gcs_autotune.crosscheck.contradiction import Contradiction
from gcs_autotune.crosscheck.windows import Series, Windows, integral, series, windows_on
from gcs_autotune.crosscheck.wording import contradiction_from, unit_of
from gcs_autotune.trial import Channel, Trial

__all__ = ["course_of", "heading_contradictions", "speed_contradictions"]

Array = NDArray[np.float64]

SPANS = (1.0, 2.0, 4.0, 8.0, 16.0)
"""Window lengths [s] that are tried for the velocity over ground.

The shortest one with a clear velocity is used. Project choice.
"""
CLEAR = 6.0
LEAST_SPEED = 0.3
"""Least speed [m/s] for a comparison. Project choice: the current moves a slower craft as much as its thrust does."""
STRAIGHT = 0.35
"""Change of heading [rad] above which a window is not used, because of sideslip in the turn. Project choice."""
CURRENT = 0.35
"""Standard deviation of currents [m/s], which is the prior of the regression. Project choice."""
MOST_CURRENT = 2.0 * CURRENT
SLIP = 0.25
"""Velocity across the heading due to waves and manoeuvres, relative to the speed. Project choice."""
LEAST_ANGLE = math.radians(35.0)
"""Least angle [rad] between heading and track that counts as a contradiction.

Project choice: sideslip, deviation and wind explain smaller angles.
"""
AHEAD, SIDEWAYS = 0.05, 0.3
"""Least throttle ahead, relative to full, and largest sideways force, relative to the throttle, in windows that are
compared. Project choice.
"""
FEWEST, LEAST_WAY, LEAST_TIME = 4, 8.0, 5.0
"""Minimum number of windows, distance [m] and time [s] of a comparison. Project choice."""
MOSTLY = 0.7
"""Least fraction of windows in which the craft must move in the direction that the comparison yields.

Project choice.
"""
ANGLES = 72


@dataclass(frozen=True, slots=True, eq=False)
class _Track:
    """Velocity over ground for each window: north + 1j * east [m/s], heading [rad], turn within the window [rad]."""

    windows: Windows
    velocity: NDArray[np.complex128]
    heading: Array
    turn: Array
    noise: float


def _positions(trial: Trial) -> tuple[Series, Series] | None:
    if "x" not in trial or "y" not in trial:
        return None
    x, y = series(trial["x"]), series(trial["y"])
    return None if x is None or y is None else (x, y)


def _velocities(trial: Trial) -> Iterator[tuple[Windows, NDArray[np.complex128], float]]:
    """Yield the velocity over ground, for windows of increasing length."""
    known = _positions(trial)
    if known is None:
        return
    x, y = known
    t = x.t
    east = np.interp(t, y.t, y.x)
    for span in SPANS:
        span = max(span, 4.0 * min(x.beat, y.beat))
        windows = windows_on(t, span, float(t[0]), float(t[-1]))
        if windows is None or len(windows) < FEWEST:
            continue
        velocity = windows.slopes(x.x) + 1j * windows.slopes(east)
        yield windows, velocity, math.hypot(x.noise, y.noise) * float(np.median(windows.gain))


def course_of(trial: Trial) -> Series | None:
    """Return the course over ground [rad] of *trial*, without jumps, while the craft moves.

    Return None if it does not move.
    """
    for windows, velocity, noise in _velocities(trial):
        fast = np.abs(velocity) > max(LEAST_SPEED, CLEAR * noise)
        if fast.mean() < 0.8:
            continue
        t, angle = windows.middle[fast], np.unwrap(np.angle(velocity[fast]))
        return series(Channel("course", "rad", t, angle))
    return None


def _track(trial: Trial) -> _Track | None:
    psi = series(trial["psi"], angle=True) if "psi" in trial else None
    if psi is None:
        return None
    for windows, velocity, noise in _velocities(trial):
        inside = (windows.middle >= psi.t[0]) & (windows.middle <= psi.t[-1])
        fast = np.abs(velocity) > max(LEAST_SPEED, CLEAR * noise)
        half = 0.5 * windows.span
        ends = [np.interp(windows.middle + side * half, psi.t, psi.x) for side in (-1.0, 1.0)]
        turn = np.abs(ends[1] - ends[0])
        use = inside & fast & (turn < STRAIGHT) & _driven_ahead(trial, windows)
        enough = use.sum() >= FEWEST and use.sum() >= 0.1 * inside.sum()
        if enough and np.median(np.abs(velocity[use])) > CLEAR * noise:
            heading = np.interp(windows.middle, psi.t, psi.x)
            return _Track(windows, velocity[use], heading[use], turn[use], noise)
    return None


def _driven_ahead(trial: Trial, windows: Windows) -> NDArray[np.bool_]:
    """Return the windows in which the throttle drives ahead and nothing sideways; all if no throttle is recorded."""
    keep = np.ones(len(windows), dtype=bool)
    ahead = _held(trial, "X", windows)
    aside = _held(trial, "Y", windows)
    scale = 1.0
    if ahead is not None:
        scale = 1.0 if trial["X"].unit == "1" else max(float(np.max(np.abs(trial["X"].values), initial=0.0)), 1e-12)
        keep &= np.min(ahead, axis=0) > AHEAD * scale
        if aside is not None:
            keep &= np.max(np.abs(aside), axis=0) < SIDEWAYS * np.min(ahead, axis=0)
    elif aside is not None:
        keep &= np.max(np.abs(aside), axis=0) == 0.0
    return keep


def _held(trial: Trial, name: str, windows: Windows) -> Array | None:
    """Return input *name* before, in and at the end of every window (3, m)."""
    if name not in trial or not len(trial[name]):
        return None
    channel = trial[name]
    moments = [windows.middle + shift * windows.span for shift in (-1.0, -0.25, 0.5)]
    at = [np.clip(np.searchsorted(channel.t, m, side="right") - 1, 0, len(channel) - 1) for m in moments]
    return np.array([channel.values[i] for i in at])


def heading_contradictions(trial: Trial) -> Iterator[Contradiction]:
    """Yield a contradiction if the track differs from the heading, and neither sideslip, current nor motion astern
    is the reason.
    """
    track = _track(trial)
    if track is None:
        return
    angle, std, speed, share = _angle(track)
    way = float(np.sum(np.abs(track.velocity))) * track.windows.span / track.windows.overlap
    seconds = len(track.velocity) * track.windows.span / track.windows.overlap
    if way < LEAST_WAY or seconds < LEAST_TIME:
        return
    exchanged = _is_exchanged(track, speed)
    if exchanged and not _fits(track, angle, speed):
        yield _exchange(trial, way, speed)
        return
    if share < MOSTLY:
        return
    if not abs(angle) >= LEAST_ANGLE + std or _is_confirmed(trial, angle):
        return
    degrees = abs(math.degrees(angle))
    side = "" if degrees > 170.0 else " to starboard" if angle > 0.0 else " to port"
    throttle = " ahead" if "X" in trial else ""
    cause = (
        f"psi does not match the track over ground (run '{trial.name}'). The craft went {way:.0f} m{throttle} at "
        f"{speed:.1f} m/s along a track {degrees:.0f} deg off its heading{side} (+- "
        f"{max(math.degrees(std), 1.0):.0f}). The compass is mounted turned"
        f"{' or the thrust is reversed' if degrees > 120.0 else ''}"
        f"{', or x and y are exchanged' if exchanged else '. psi is more likely wrong'}"
    )
    cure = (
        f"{'check that x is north and y is east; ' if exchanged else ''}check COMPASS_ORIENT and "
        f"AHRS_ORIENTATION{', and that the propellers drive it ahead (SERVOn_REVERSED)' if degrees > 120.0 else ''}. "
        "Check this before you use any GPS "
        f"mode{'' if 'X' in trial else '. If it went that way on purpose (astern, sideways), record its X and Y'}"
    )
    suspect = "" if exchanged else "psi"
    yield Contradiction("psi against track", "turned", angle, std, suspect, ("psi", "x", "y"), cause, cure)


def _exchange(trial: Trial, way: float, speed: float) -> Contradiction:
    """Return the contradiction that the columns of the positions are exchanged."""
    cause = (
        f"x and y do not match psi (run '{trial.name}'). The craft went {way:.0f} m at {speed:.1f} m/s, and its "
        "tracks fit its headings only with x and y exchanged"
    )
    cure = "check that x is north and y is east"
    return Contradiction("psi against track", "exchanged", math.nan, math.nan, "x", ("x", "y", "psi"), cause, cure)


def _is_exchanged(track: _Track, speed: float) -> bool:
    """Return whether the track fits the heading with x and y exchanged, but not as recorded.

    A craft that slides in its turns may fit both. It still moves towards its bow, so a part of the track must lead
    astern.
    """
    swapped = replace(track, velocity=1j * np.conj(track.velocity))
    astern = float(np.mean(np.real(track.velocity * np.exp(-1j * track.heading)) < 0.0))
    return astern > 1.0 - MOSTLY and not _fits(track, 0.0, speed) and _fits(swapped, 0.0, speed)


def _fits(track: _Track, angle: float, speed: float) -> bool:
    """Return whether the craft moves along its heading rotated by *angle* [rad], with a plausible current."""
    left, current = _across(track, angle)
    along = np.real((track.velocity - current) * np.exp(-1j * (track.heading + angle)))
    return abs(current) <= MOST_CURRENT and left <= (SLIP * speed) ** 2 and float(np.mean(along > 0.0)) >= MOSTLY


def _is_confirmed(trial: Trial, angle: float) -> bool:
    """Return whether measured speeds of the craft confirm that direction, and no throttle contradicts it."""
    if "X" in trial or "u" not in trial or not len(trial["u"]):
        return False
    u = float(np.nanmedian(trial["u"].values))
    v = float(np.nanmedian(trial["v"].values)) if "v" in trial and len(trial["v"]) else 0.0
    return math.hypot(u, v) > 0.5 * LEAST_SPEED and abs(cmath.phase(cmath.exp(1j * (math.atan2(v, u) - angle)))) < 0.5


def _angle(track: _Track) -> tuple[float, float, float, float]:
    """Return the angle [rad] from heading to track, its standard error, the median speed [m/s], and a fraction.

    The fraction is that of the windows that move in this direction. For a constant angle and a constant current, the
    velocity across the rotated heading is zero. The remaining velocity across it is compared for every angle; the
    current is a regression with a prior.
    """
    best = (math.inf, 0.0, 0j)
    for angle in np.linspace(0.0, math.pi, ANGLES // 2, endpoint=False):
        left, current = _across(track, float(angle))
        if left < best[0]:
            best = left, float(angle), current
    step = 2.0 * math.pi / ANGLES
    for angle in np.linspace(best[1] - step, best[1] + step, 21):
        left, current = _across(track, float(angle))
        if left < best[0]:
            best = left, float(angle), current
    left, angle, current = best
    along = np.real((track.velocity - current) * np.exp(-1j * (track.heading + angle)))
    if float(np.median(along)) < 0.0:
        angle, along = angle + math.pi, -along
    speed = float(np.median(np.abs(track.velocity)))
    n = len(track.velocity) / track.windows.overlap
    if abs(current) > MOST_CURRENT or _is_explained_ahead(track, speed, left):
        return 0.0, math.inf, speed, 1.0
    std = math.sqrt(left / max(n, 1.0)) / max(speed, 1e-9) + _remainder(track)
    return math.remainder(angle, 2.0 * math.pi), std, speed, float(np.mean(along > 0.0))


def _is_explained_ahead(track: _Track, speed: float, least: float) -> bool:
    """Return whether the craft may have moved ahead along its heading, with a plausible current.

    least : cost of the best angle.
    """
    left, current = _across(track, 0.0)
    ahead = np.real((track.velocity - current) * np.exp(-1j * track.heading))
    if abs(current) > MOST_CURRENT or left > max(9.0 * least, (SLIP * speed) ** 2):
        return False
    same_way = abs(complex(np.mean(np.exp(1j * track.heading)))) > 0.9
    against = MOST_CURRENT if same_way else 0.0
    return float(np.median(ahead)) > -against


def _remainder(track: _Track) -> float:
    """Return the angle [rad] by which a usual current could rotate the track of a constant heading.

    If headings vary, it is near zero.
    """
    same_way = abs(complex(np.mean(np.exp(1j * track.heading))))
    return math.atan2(CURRENT, float(np.median(np.abs(track.velocity)))) * same_way**4


def _across(track: _Track, angle: float) -> tuple[float, complex]:
    """Return the mean square velocity across the heading rotated by *angle*, with the prior, and the best current."""
    direction = track.heading + angle
    across = np.imag(track.velocity * np.exp(-1j * direction))
    design = np.column_stack([-np.sin(direction), np.cos(direction)])
    n = len(across)
    weight = max(track.noise, 0.05) ** 2 / CURRENT**2 * track.windows.overlap
    normal = design.T @ design + weight * np.eye(2)
    north, east = np.linalg.solve(normal, design.T @ across)
    left = across - design @ np.array([north, east])
    cost = float(left @ left + weight * (north**2 + east**2)) / n
    return cost, complex(north, east)


# --- speeds against positions -------------------------------------------------------------------------------

_SPEED = Expected(offset=0.05, floor=0.1, way=8.0, shift=1.0)
LEAST_STEPS = 20
"""Minimum number of steps along a track for the length of the track to be known. Project choice."""


def speed_contradictions(trial: Trial) -> Iterator[Contradiction]:
    """Yield the contradictions between the length of the track and the measured speeds in *trial*."""
    known = _positions(trial)
    if _stands_ahead(trial):
        never = Comparison("still-rate", math.nan, math.nan, 0.0, 0.0, 0.0, math.nan, 0.0, math.nan)
        yield contradiction_from(trial.name, "x, y", "u", "moves", never, "u")
        return
    if known is None and not any(n in trial for n in ("y", "psi")):
        yield from _one_way(trial)
        return
    speed, name = _speed(trial)
    rate = None if speed is None else series(speed)
    if known is None or rate is None:
        return
    along = _way(trial, *known, rate)
    found = _unit_by_axes(trial, *known) if along is None else compare(along, rate, integral(rate), _SPEED)
    if found is None or found.kind in ("agrees", "unrelated", "sign"):
        return
    is_unit = found.kind == "factor" and unit_of("x, y", found)[1]
    if (
        name != "U"
        and found.kind != "still-rate"
        and not is_unit
        and abs(found.factor * found.predicted - found.predicted) < CURRENT
    ):
        return
    suspect = name if found.kind == "still-rate" else "x, y" if found.kind == "still-position" else ""
    yield contradiction_from(trial.name, "x, y", name, "moves", found, suspect)


def _unit_by_axes(trial: Trial, x: Series, y: Series) -> Comparison | None:
    """Return the comparison of north and east with the craft's speeds rotated by its heading.

    Return None unless both show the factor of the same unit. A short or noisy track has no reliable length, but its
    coordinates show a factor of a hundred.
    """
    if any(n not in trial or len(trial[n]) < 2 for n in ("u", "v", "psi")):
        return None
    t, u = trial["u"].t, trial["u"].values
    v, psi = (np.interp(t, trial[n].t, trial[n].values) for n in ("v", "psi"))
    rates = u * np.cos(psi) - v * np.sin(psi), u * np.sin(psi) + v * np.cos(psi)
    found = []
    for position, values in zip((x, y), rates, strict=True):
        rate = series(Channel("speed", "m/s", t, values))
        one = None if rate is None else compare(position, rate, integral(rate), _SPEED)
        if one is None or one.kind != "factor" or not unit_of("x, y", one)[1]:
            return None
        found.append(one)
    return found[0] if unit_of("x, y", found[0])[1] == unit_of("x, y", found[1])[1] else None


def _one_way(trial: Trial) -> Iterator[Contradiction]:
    """Yield contradictions between distance and speed ahead, for a craft that only moves ahead."""
    position, rate = (series(trial[n]) if n in trial else None for n in ("x", "u"))
    found = None if position is None or rate is None else compare(position, rate, integral(rate), _SPEED)
    if found is None or found.kind in ("agrees", "unrelated"):
        return
    if found.kind in ("factor", "sign") and abs(found.factor - 1.0) * found.predicted < CURRENT:
        return
    suspect = "u" if found.kind == "still-rate" else "x" if found.kind == "still-position" else ""
    yield contradiction_from(trial.name, "x", "u", "changes", found, suspect)


def _stands_ahead(trial: Trial) -> bool:
    """Return whether the speed ahead is always zero, although the track leads along the heading."""
    if "u" not in trial or not len(trial["u"]) or np.any(trial["u"].values != 0.0):
        return False
    track = _track(trial)
    if track is None:
        return False
    ahead = np.real(track.velocity * np.exp(-1j * track.heading))
    return float(np.median(np.abs(ahead))) > LEAST_SPEED + CURRENT


def _speed(trial: Trial) -> tuple[Channel | None, str]:
    if "U" in trial and len(trial["U"]) > 1:
        return trial["U"], "U"
    if "u" not in trial or len(trial["u"]) < 2:
        return None, ""
    u = trial["u"]
    if "v" not in trial or len(trial["v"]) < 2:
        return None, ""
    good = np.isfinite(trial["v"].values)
    v = np.interp(u.t, trial["v"].t[good], trial["v"].values[good]) if good.any() else np.zeros(len(u))
    return Channel("U", u.unit, u.t, np.hypot(u.values, v)), "u, v"


def _way(trial: Trial, x: Series, y: Series, rate: Series) -> Series | None:
    """Return the distance along the track [m], over steps so long that noise of the positions does not lengthen it."""
    east = np.interp(x.t, y.t, y.x)
    noise = math.hypot(x.noise, y.noise)
    reach = float(np.median(np.abs(rate.x)))
    span = max(float(np.median(np.diff(x.t))), 0.5 * x.beat)
    total = math.hypot(float(np.ptp(x.x)), float(np.ptp(east)))
    if total < max(2.0, 20.0 * noise) and reach < LEAST_SPEED:
        return None
    pace = max(reach, total / max(float(x.t[-1] - x.t[0]), 1e-9), 0.05)
    step = max(span, 8.0 * noise / pace)
    if step > 20.0:
        return None
    ends = np.arange(x.t[0] + step, x.t[-1] - step, step)  # smoothing holds the track back at its ends
    if len(ends) < LEAST_STEPS:
        return None
    smooth = max(round(0.5 * step / float(np.median(np.diff(x.t)))), 0)
    north, east = (_smoothed(values, smooth) for values in (x.x, east))
    moved = np.hypot(np.diff(np.interp(ends, x.t, north)), np.diff(np.interp(ends, x.t, east)))
    return series(Channel("way", "m", ends, np.concatenate([[0.0], np.cumsum(moved)])))


def _smoothed(values: Array, half: int) -> Array:
    if half < 1:
        return values
    kernel = np.ones(2 * half + 1) / (2 * half + 1)
    return np.convolve(np.pad(values, half, mode="edge"), kernel, mode="valid")
