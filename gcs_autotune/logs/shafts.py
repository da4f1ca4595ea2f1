"""Speeds of the shafts that ESCs report (ESC_TELEMETRY, RPM), as inputs in place of the commands.

Thrust at rest is proportional to n|n| (Miskovic2010, (2.4)). The speed at full command, which scales it to 1, is
estimated from the log itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.firmware import Output
from gcs_autotune.logs.sample_store import Note, SampleStore

__all__ = ["Shafts", "shafts_of"]

Array = NDArray[np.float64]

SOURCES = ("esc", "rpm")
"""Sources of shaft speeds, in order of preference."""
LARGEST_MISFIT = 0.3
"""Rms difference between speed and command, as a part of the speed's rms, above which they disagree. Project choice."""
LARGEST_LAG = 0.25
"""Time constant of a motor [s] above which the command is a poor input. Project choice."""


@dataclass(frozen=True, slots=True)
class _Scaled:
    """One shaft: fraction of full thrust (n,), sums of squares of its speed and of the misfit [1/s^2], lag [s]."""

    shares: Array
    power: float
    error: float
    lag: float


@dataclass(frozen=True, slots=True)
class Shafts:
    """Thrust of each output as a fraction of that at full command, (outputs, n), at the times ``t`` [s] (n,).

    ``misfit``: rms difference between speed and lagging command, as a part of the speed's rms. ``lag`` [s]: largest
    time constant of a motor.
    """

    t: Array
    shares: Array
    misfit: float
    lag: float

    def doubts(self, *, by_speed: bool) -> list[Note]:
        """Return a doubt if speeds and commands disagree. A lag is one only if the inputs are not *by_speed*."""
        if self.misfit > LARGEST_MISFIT:
            return [
                (
                    "shafts-disagree",
                    f"the shaft speeds that the ESCs report differ from the commands by {self.misfit:.0%} (rms)",
                    "check propellers, ESCs and their order. --input speed identifies from the speeds",
                )
            ]
        if self.lag > LARGEST_LAG and not by_speed:
            return [
                (
                    "shafts-lag",
                    f"the shafts follow the commands with a time constant of about {self.lag:g} s",
                    "use --input speed, which does not need a model of the motors",
                )
            ]
        return []


def shafts_of(store: SampleStore, outputs: Sequence[Output], t: Array, commands: Array) -> Shafts | None:
    """Return the shafts of *outputs*, or None if the log does not contain a speed for each.

    t : (m,) time stamps [s] of the outputs. commands : (outputs, m), normalised. Most ESCs report no direction. It is
    then that of the command.
    """
    for source in SOURCES:
        numbers = _numbers(store, source, outputs)
        if numbers:
            break
    else:
        return None
    series = [store.series(f"{source}.{number}") for number in numbers]
    times = series[0][0]
    held = np.clip(np.searchsorted(t, times, side="right") - 1, 0, len(t) - 1)
    found = [
        _scaled(times, np.interp(times, stamps, speeds), command[held])
        for (stamps, speeds), command in zip(series, commands, strict=True)
    ]
    power, error = sum(shaft.power for shaft in found), sum(shaft.error for shaft in found)
    slowest = max(shaft.lag for shaft in found)
    return Shafts(times, np.array([shaft.shares for shaft in found]), float(np.sqrt(error / power)), slowest)


def _numbers(store: SampleStore, source: str, outputs: Sequence[Output]) -> list[int]:
    """Return the number of each output's ESC: that of its channel, or else the ESCs in the order of the outputs."""
    there, channels = store.numbered(source), [output.channel for output in outputs]
    turning = [n for n in there if np.any(store.series(f"{source}.{n}")[1])]
    if set(turning) <= set(channels) <= set(there):
        return channels if turning else []
    order = np.argsort(np.argsort(channels))
    return [turning[k] for k in order] if len(turning) == len(outputs) else []


CLEARLY = 1e-3
"""Reduction of the squared differences, as a part of the speed's own, above which the second law is taken. Project
choice."""
LAGS = (0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.6, 0.8, 1.2)
"""Time constants [s] tried for the motor. Project choice."""


def _scaled(t: Array, n: Array, command: Array) -> _Scaled:
    """Return the thrust of one shaft and how its speed follows the command.

    The speed is proportional to the square root of the command, as on an ESC with a linear thrust, or clearly better to
    the command itself. A run with one size of command does not distinguish them. A lag of the motor is fitted, so that
    it does not change the scale. A shaft that reports no direction turns in that of the lagging command.
    """
    power, is_blind = float(n @ n), bool(np.all(n >= 0.0))
    best, full, lag, signed = np.inf, 1.0, 0.0, n
    for shape in (np.sign(command) * np.sqrt(np.abs(command)), command):
        for T in LAGS:
            followed = _lagged(t, shape, T)
            turned = n * np.where(followed < 0.0, -1.0, 1.0) if is_blind else n
            weight = float(followed @ followed)
            scale = float(followed @ turned) / weight if weight > 0.0 else 0.0
            error = float(np.sum((turned - scale * followed) ** 2))
            if scale > 0.0 and error < best - CLEARLY * power:
                best, full, lag, signed = error, scale, T, turned
    return _Scaled(signed * np.abs(signed) / full**2, power, min(best, power), lag)


def _lagged(t: Array, values: Array, T: float) -> Array:
    """Return *values*, each held until the next, through a lag of time constant *T* [s]."""
    if T == 0.0:
        return values
    kept = np.exp(-np.diff(t) / T)
    out = np.empty(len(values))
    out[0] = now = values[0]
    for k, (keep, value) in enumerate(zip(kept.tolist(), values[:-1].tolist(), strict=True), start=1):
        now = value + keep * (now - value)
        out[k] = now
    return out
