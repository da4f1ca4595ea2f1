"""Random open-loop manoeuvres, as fractions of full command at the sample times."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.craft import Craft, log_uniform

__all__ = ["MANOEUVRES", "can_turn_fully", "draw_commands", "driving"]

Array = NDArray[np.float64]
Rng = np.random.Generator


def _held(t: Array, level: Callable[[int], float], hold: Callable[[], float]) -> Array:
    """Return *level* of each step, held for the times that *hold* returns."""
    u, until, now, k = np.zeros(len(t)), -1.0, 0.0, 0
    for i, moment in enumerate(t):
        if moment >= until:
            now, until, k = level(k), moment + hold(), k + 1
        u[i] = now
    return u


def _steps(rng: Rng, t: Array, pace: float) -> Array:
    """Return steps of random sizes."""
    return _held(t, lambda k: rng.uniform(-1.0, 1.0), lambda: pace * rng.uniform(0.7, 4.0))


def _zigzag(rng: Rng, t: Array, pace: float) -> Array:
    """Return equal commands to either side, reversed at nearly equal times."""
    size, hold = rng.uniform(0.4, 1.0), pace * rng.uniform(1.0, 4.0)
    return _held(t, lambda k: size * (-1.0) ** k, lambda: hold * rng.uniform(0.8, 1.25))


def _relay(rng: Rng, t: Array, pace: float) -> Array:
    """Return a square wave whose size changes half-way."""
    size, hold = rng.uniform(0.4, 1.0), pace * rng.uniform(0.8, 3.0)
    second = size * rng.uniform(0.3, 0.8)
    half = t[len(t) // 2]
    first = np.where(np.floor(t / hold) % 2 == 0, size, -size)
    return np.where(t < half, first, first * second / size)


def _prbs(rng: Rng, t: Array, pace: float) -> Array:
    """Return a random binary sequence."""
    size, bit = rng.uniform(0.4, 1.0), pace * rng.uniform(0.4, 1.2)
    return _held(t, lambda k: size * (1.0 if rng.random() < 0.5 else -1.0), lambda: bit)


def _doublets(rng: Rng, t: Array, pace: float) -> Array:
    """Return doublets of random sizes with pauses."""
    sizes = rng.uniform(0.15, 1.0, 400) * rng.choice([-1.0, 1.0], 400)
    hold = pace * rng.uniform(0.7, 2.5)
    return _held(t, lambda k: (1.0, -1.0, 0.0)[k % 3] * sizes[(k // 3) % 400], lambda: hold)


def _sweep(rng: Rng, t: Array, pace: float) -> Array:
    """Return a sine of increasing frequency."""
    low, high = rng.uniform(0.1, 0.3) / pace, rng.uniform(1.0, 3.0) / pace
    span = max(t[-1], 1e-9)
    phase = low * span / np.log(high / low) * ((high / low) ** (t / span) - 1.0)
    return rng.uniform(0.4, 1.0) * np.sin(phase + rng.uniform(0.0, 2.0 * np.pi))


MANOEUVRES: Mapping[str, Callable[[Rng, Array, float], Array]] = {
    "steps": _steps,
    "zig-zag": _zigzag,
    "relay": _relay,
    "prbs": _prbs,
    "doublets": _doublets,
    "sweep": _sweep,
}


def driving(rng: Rng, t: Array, pace: float) -> Array:
    """Return the steering of a person: held commands, ramps and pauses of random duration, mostly small."""
    u, now, begin = np.zeros(len(t)), 0.0, 0
    while begin < len(t):
        end = int(np.searchsorted(t, t[begin] + pace * rng.exponential(3.0))) + 1
        after = float(np.clip(rng.normal(0.0, 0.4), -1.0, 1.0))
        kind = rng.choice(3, p=(0.5, 0.25, 0.25))
        part = u[begin:end]
        part[:] = (after, np.linspace(now, after, len(part)), 0.0)[kind]
        now, begin = float(part[-1]), end
    return u


def _turns(rng: Rng, t: Array, around: float) -> Array:
    """Return a full turn to one side and one back, of *around* (fraction of full command) each."""
    turned = np.where(t < 0.55 * t[-1], around, -around)
    return turned if rng.random() < 0.5 else -turned


def _reach(craft: Craft) -> float:
    """Return the heading change [rad] at full command in the first half of a run, from rest."""
    return craft.top["yaw"] * max(0.5 * craft.duration - craft.time_constant("yaw"), 0.0)


def can_turn_fully(craft: Craft) -> bool:
    """Return whether a run is long enough for a full turn to either side."""
    return _reach(craft) > 4.0 * np.pi


def _ahead(rng: Rng, t: Array, pace: float) -> Array:
    """Return commands ahead, with some astern."""
    astern = rng.uniform(0.0, 0.4)
    return _held(t, lambda k: rng.uniform(-astern, 1.0), lambda: pace * rng.uniform(1.0, 4.0))


def draw_commands(rng: Rng, craft: Craft, name: str, *, turns: bool) -> dict[str, Array]:
    """Return the commands of one run by channel, at the sample times; *turns*: with full turns of the heading."""
    t = craft.interval * np.arange(craft.samples)
    commands = {}
    for channel, dof in craft.drives.items():
        pace = max(craft.time_constant(dof), 3.0 * craft.interval)
        if dof == "surge" and len(craft.dofs) > 1:
            share = _ahead(rng, t, pace)
        elif dof == craft.main:
            share = MANOEUVRES[name](rng, t, pace)
        else:
            share = MANOEUVRES[str(rng.choice(list(MANOEUVRES)))](rng, t, pace)
        if dof == "yaw" and turns:
            around = min(1.5 * 2.0 * np.pi / max(_reach(craft), 1e-9), 0.75)
            share = _turns(rng, t, around) + max(1.0 - around, 0.25) * share
        share = np.clip(share, -1.0, 1.0)
        if rng.random() < 0.5:
            quiet = t < rng.uniform(0.0, 0.05) * t[-1]
            share = np.where(quiet, 0.0, share)
        commands[channel] = craft.full[channel] * share * log_uniform(rng, 0.7, 1.0)
    return commands
