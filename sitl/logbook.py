"""What the tank's sensors make of the truth, and when."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from sitl.afloat import SIGNALS, Afloat
from sitl.effects import Effect
from sitl.sensors import Reading

__all__ = ["find_lateness", "measure"]

Array = NDArray[np.float64]


def find_lateness(effects: Sequence[Effect], measured: tuple[str, ...]) -> dict[str, float]:
    """Return by how much [s] each measured signal is late, all effects together."""
    late = dict.fromkeys(measured, 0.0)
    for effect in effects:
        for name, delay in effect.lateness().items():
            for each in measured if name == "*" else (name,):
                late[each] += delay
    return late


def measure(
    afloat: Afloat,
    effects: Sequence[Effect],
    t: Array,
    truth: Array,
    stamps: Array,
    measured: tuple[str, ...],
    late: Mapping[str, float],
    noise: Mapping[str, float],
    seed: int,
) -> dict[str, Array]:
    """Return what is reported at the file's *stamps* (n,) of the *truth* (k, 8) at *t* (k,): late, noisy, altered."""
    psi = truth[:, SIGNALS.index("psi")]
    if afloat.over_ground:
        truth[:, 4] += afloat.V_x * np.cos(psi) + afloat.V_y * np.sin(psi)
        truth[:, 5] += afloat.V_y * np.cos(psi) - afloat.V_x * np.sin(psi)
    reported = {}
    for name in measured:
        values = np.interp(stamps - late[name], t, truth[:, SIGNALS.index(name)])
        level = noise.get(name, 0.0)
        if level > 0.0:
            values += np.random.default_rng([seed, zlib.crc32(name.encode())]).normal(0.0, level, len(values))
        reported[name] = values
    alters = [e.alter_measurement for e in effects if e.overrides("alter_measurement")]
    if alters:
        _alter(alters, stamps, reported)
    return reported


def _alter(alters: Sequence[Callable[[float, Reading], None]], stamps: Array, reported: dict[str, Array]) -> None:
    reading = Reading()
    for i, t in enumerate(stamps.tolist()):
        for name, values in reported.items():
            setattr(reading, name, float(values[i]))
        for alter in alters:
            alter(t, reading)
        for name, values in reported.items():
            values[i] = getattr(reading, name)
