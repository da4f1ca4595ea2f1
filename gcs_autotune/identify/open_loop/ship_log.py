"""Heading, rudder and other channels of a run, each cleaned and with its own stamps, and the helm orders of the run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import BadFile, MissingChannel, NotInformative
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.signals.cleaning import clean, unwrap
from gcs_autotune.sensor import TURN, quantum
from gcs_autotune.trial import Channel, Trial

__all__ = ["Execute", "ShipLog", "find_executes", "ship_log", "steered"]

Array = NDArray[np.float64]

INPUTS = ("delta", "N")
"""Names of channels that may be the steering input, in order of preference."""

LEAST = 20
"""Smallest number of heading samples from which a manoeuvre is evaluated. Project choice."""

STEEPEST_RUDDER = math.pi / 2.0
"""Largest plausible rudder angle [rad]. Project choice. A larger value without a unit cannot be in radians."""


@dataclass(frozen=True, slots=True, eq=False)
class ShipLog:
    """Heading and steering of one run.

    - ``steering``: the input (rudder angle [rad] or yaw moment).
    - ``t`` (n,): stamps of the continuous heading ``psi`` (n,) [rad].
    - ``others``: name -> cleaned channel, for all other channels of the run.
    - ``step`` [rad]: resolution of the compass, 0 if none.
    """

    name: str
    steering: Channel
    t: Array
    psi: Array
    step: float
    others: Mapping[str, Channel]
    doubts: tuple[Doubt, ...]

    @property
    def floor(self) -> float:
        """Smallest standard deviation of one heading sample [rad], from the resolution of the compass."""
        return self.step / math.sqrt(12.0)

    @property
    def end(self) -> float:
        """Stamp of the last heading sample [s]."""
        return float(self.t[-1])

    def heading(self, start: float, end: float) -> tuple[Array, Array]:
        """Return the stamps [s] and headings [rad] with ``start <= t <= end``."""
        keep = (self.t >= start) & (self.t <= end)
        return self.t[keep], self.psi[keep]

    def channel(self, name: str) -> Channel | None:
        """Return the other channel called *name*, or None if it has fewer than two samples."""
        channel = self.others.get(name)
        return channel if channel is not None and len(channel) > 1 else None

    def speed(self, start: float, end: float) -> float:
        """Return the mean speed [m/s] between two times, NaN if unknown.

        The first of these sources is used: U, u and v, u alone, the track.
        """
        for names in (("U",), ("u", "v"), ("u",)):
            parts = [c.between(start, end).values for n in names if (c := self.channel(n)) is not None]
            if len(parts) == len(names) and all(len(p) for p in parts):
                return math.hypot(*(float(p.mean()) for p in parts))
        x, y = self.channel("x"), self.channel("y")
        if x is None or y is None:
            return math.nan
        px, py = x.between(start, end), y.between(start, end)
        if len(px) < 2 or len(py) < 2 or px.t[-1] <= px.t[0]:
            return math.nan
        slopes = [float(np.polyfit(c.t - c.t[0], c.values, 1)[0]) for c in (px, py)]
        return math.hypot(*slopes)


def ship_log(trial: Trial) -> ShipLog:
    """Return heading and steering of *trial*.

    Raises
    ------
    MissingChannel
        There is no heading, or neither rudder nor yaw moment.
    BadFile
        The clock jumps back, or angles without a unit cannot be radians.
    NotInformative
        There are too few samples, or the rudder never moves.
    """
    notes: list[Doubt] = []
    steering = clean(_steering(trial), trial.name, notes)
    _check_units(trial, steering, notes)
    channels = {n: clean(c, trial.name, notes) for n, c in trial.channels.items() if n != steering.name}
    if "psi" not in channels:
        raise MissingChannel(f"run '{trial.name}' has no heading psi. Ship figures need psi and delta (or N)")
    psi, rate = channels.pop("psi"), channels.get("r")
    if len(psi) < LEAST:
        raise NotInformative(
            f"run '{trial.name}' is too short. It has {len(psi)} heading samples, but {LEAST} are needed"
        )
    if len(steering) == 0 or float(np.ptp(steering.values)) == 0.0:
        raise NotInformative(
            f"the input {steering.name} of run '{trial.name}' never changes, so the run contains no manoeuvre. "
            "Check which column is the rudder"
        )
    psi = replace(psi, values=unwrap(psi.t, psi.values, rate))
    unique = {(d.slug, d.cause): d for d in notes}
    doubts = tuple(unique.values())
    return ShipLog(trial.name, steering, psi.t, psi.values, quantum(psi.values, TURN), channels, doubts)


def steered(trial: Trial) -> Trial:
    """Return *trial* with the steering input of its :class:`ShipLog` as its only yaw input, in the same unit.

    A model identified from the returned run has the same unit of helm as the figures from the log. If
    ``meta["full_rudder"]`` is known, the input is a rudder angle [rad], even if it was recorded as a normalised output.

    Raises
    ------
    MissingChannel
        There is neither a rudder angle nor a yaw moment.
    """
    steering = _steering(trial)
    others = {n: c for n, c in trial.channels.items() if n not in INPUTS}
    return replace(trial, channels={**others, steering.name: steering})


def _steering(trial: Trial) -> Channel:
    have = [n for n in INPUTS if n in trial and len(trial[n])]
    if not have:
        there = ", ".join(trial.channels) or "nothing"
        raise MissingChannel(
            f"run '{trial.name}' has neither delta nor N. Its columns are {there}. Rename the rudder column to "
            "delta[deg]"
        )
    moving = [n for n in have if float(np.ptp(trial[n].values)) > 0.0]
    steering, full = trial[(moving or have)[0]], trial.meta.get("full_rudder")
    if steering.name == "N" and steering.unit == "1" and isinstance(full, float):
        return replace(steering, name="delta", unit="rad", values=full * steering.values)
    return steering


def _check_units(trial: Trial, steering: Channel, notes: list[Doubt]) -> None:
    """Raise BadFile for a rudder angle that cannot be in radians; note a missing unit."""
    if steering.name != "delta":
        return
    if steering.unit not in ("1", "rad"):
        raise BadFile(f"the rudder angle of run '{trial.name}' is in {steering.unit}. Write delta[deg] or delta[rad]")
    if float(np.max(np.abs(steering.values), initial=0.0)) > STEEPEST_RUDDER:
        raise BadFile(
            f"the column delta of run '{trial.name}' cannot be in radians. Write delta[deg] and psi[deg] in the "
            "header line"
        )
    if steering.unit == "1":
        notes.append(
            Doubt("unit-missing", f"delta of run '{trial.name}' has no unit. Radians were assumed", "write delta[rad]")
        )


HALF = 0.5
"""Fraction of the helm change above which a change counts as a reversal. Project choice.

The beginning of the reversal is then searched backwards in time.
"""

QUIET = 0.08
"""Deviation from the previous helm, as a fraction of the reversal, up to which the reversal has not begun.

Project choice.
"""


@dataclass(frozen=True, slots=True)
class Execute:
    """A helm order.

    - ``t`` [s]: time at which the rudder starts to move.
    - ``done`` [s]: time at which the rudder reaches the new value.
    - ``before``, ``level``: input before and after the order [unit of input].
    """

    t: float
    done: float
    before: float
    level: float


def find_executes(log: ShipLog) -> tuple[Execute, ...]:
    """Return the helm orders that move the rudder from one side to the other.

    The first order, which starts from amidships, is included.
    """
    t, v = log.steering.t, log.steering.values
    high, low = float(np.percentile(v, 98)), float(np.percentile(v, 2))
    high, low = (float(np.median(v[v >= low + 0.9 * (high - low)])), float(np.median(v[v <= low + 0.1 * (high - low)])))
    if high <= 0.0 or low >= 0.0:
        return ()
    state, executes = 0, []
    last = 0
    for i, x in enumerate(v):
        new = 1 if x > HALF * high else -1 if x < HALF * low else state
        if new != state and new != 0:
            level = high if new > 0 else low
            before = 0.0 if state == 0 else (high if state > 0 else low)
            executes.append(_traced(t, v, last, i, before, level))
            state, last = new, i
    return tuple(_levelled(t, v, executes, float(t[-1])))


def _traced(t: Array, v: Array, first: int, i: int, before: float, level: float) -> Execute:
    """Return the order whose ramp contains sample *i*.

    It begins when the rudder leaves the old level, and ends when it reaches the new one.
    """
    band = QUIET * abs(level - before)
    held = np.flatnonzero(np.abs(v[first:i] - before) <= band)
    begin = first + int(held[-1]) if len(held) else first
    reached = np.flatnonzero(np.abs(v[i:] - level) <= band)
    done = i + int(reached[0]) if len(reached) else i
    if i - begin <= 1 and done == i:  # a jump: in force from its own stamp on
        return Execute(float(t[i]), float(t[i]), before, level)
    ramp = slice(begin, done + 1)
    inner = np.abs(v[ramp] - 0.5 * (before + level)) < 0.4 * abs(level - before)
    if int(inner.sum()) >= 3:
        slope, middle = np.polyfit(t[ramp][inner] - t[i], v[ramp][inner], 1)
        if slope * (level - before) > 0.0:
            start = float(t[i]) + (before - middle) / slope
            return Execute(float(np.clip(start, t[first], t[i])), float(t[done]), before, level)
    return Execute(float(t[min(begin + 1, i)]), float(t[done]), before, level)


def _levelled(t: Array, v: Array, executes: list[Execute], end: float) -> list[Execute]:
    """Return the orders, with the levels that were actually held after each."""
    mended: list[Execute] = []
    for k, e in enumerate(executes):
        until = executes[k + 1].t if k + 1 < len(executes) else end
        keep = (t >= e.done) & (t < until)
        level = float(np.median(v[keep])) if keep.any() else e.level
        mended.append(replace(e, level=level, before=mended[-1].level if mended else e.before))
    return mended
