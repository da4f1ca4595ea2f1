"""A towing tank: a bare hull in open loop, with hidden effects, and the file its crew would write down.

Steps (:mod:`sitl.afloat`) are short against every time constant there is and end on the stamps of the file.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from sitl.afloat import SIGNALS, Afloat, Hull
from sitl.body import AxisDynamics, Loads
from sitl.effects import Effect, Setting
from sitl.logbook import find_lateness, measure

__all__ = ["INPUTS", "SIGNALS", "Command", "Hull", "tow"]

Array = NDArray[np.float64]
Command = Array | Sequence[float] | Sequence[tuple[float, float]]
"""Values on the file's stamps (n,), or steps as (time [s], value from then on); before the first step: 0."""

INPUTS: Mapping[str, str] = {"X": "surge", "Y": "sway", "Z": "heave", "N": "yaw", "delta": "yaw"}
"""Input channel -> degree of freedom it drives."""

_STEPS_PER_TIME_CONSTANT = 32
"""Heun's error per time constant goes with its inverse square: about 2e-4."""
_STEPS_PER_SAMPLE = 4
_STEPS_PER_RADIAN = 16
"""Per radian of waves, or time constant of an effect."""


def tow(
    hull: Hull,
    commands: Mapping[str, Command],
    *,
    duration: float,
    interval: float,
    measured: tuple[str, ...],
    effects: Sequence[Effect] = (),
    noise: Mapping[str, float] | None = None,
    seed: int = 0,
    initial: Mapping[str, float] | None = None,
    stamps_jitter: float = 0.0,
) -> dict[str, Array]:
    """Drive *hull* with *commands* and return the file: ``t``, inputs and signals, (n,) each, n = duration/interval.

    Commands are held from one stamp to the next. With a wrong clock (``time-scale``) duration, interval and commands
    are in true time, the file's stamps are not. Late signals (``time-offset``, ``measurement-delay``) are those of a
    hull that has been afloat under the first command that much longer, from the *initial* state on.

    Parameters
    ----------
    duration, interval : [s].
    measured : of :data:`SIGNALS`.
    noise : standard deviation of white noise per measured signal.
    initial : state at the start, 0 where not given.
    stamps_jitter : stamps are off the even grid by up to this [s], below half an interval.

    Raises
    ------
    ValueError
        A command, signal or degree of freedom is unknown, or the numbers make no run.
    BadEffect
        The hull has no place for an effect.
    """
    _check(hull, commands, measured, duration, interval, stamps_jitter)
    stamps = _stamps(duration, interval, stamps_jitter, seed)
    held = {name: _held(command, stamps) for name, command in commands.items()}
    afloat = Afloat(hull)
    setting = _setting(hull, afloat, held, measured, seed, initial or {})
    for effect in effects:
        effect.begin(setting)
    late = find_lateness(effects, measured)
    begun = -max([0.0, *late.values()])
    last = float(stamps[-1])
    ended = last - min([0.0, *late.values()])
    state = tuple(float((initial or {}).get(name, 0.0)) for name in SIGNALS)
    knots = np.concatenate([[begun][: begun < 0.0], stamps, [ended][: ended > last]])
    t, truth = _sail(hull, afloat, effects, _shortest(hull, setting, effects), held, stamps, knots, state)
    columns = {"t": stamps, **held, **measure(afloat, effects, t, truth, stamps, measured, late, noise or {}, seed)}
    for effect in effects:
        effect.alter_file(columns)
    return columns


def _check(
    hull: Hull,
    commands: Mapping[str, Command],
    measured: tuple[str, ...],
    duration: float,
    interval: float,
    jitter: float,
) -> None:
    for name in commands:
        if INPUTS.get(name) not in hull.dofs:
            raise ValueError(f"this hull has no input '{name}'; it moves in {', '.join(hull.dofs)}")
    for name in measured:
        if name not in SIGNALS:
            raise ValueError(f"'{name}' cannot be measured; {', '.join(SIGNALS)} can")
    if not (interval > 0.0 and round(duration / interval) >= 2 and 0.0 <= jitter < 0.5 * interval):
        raise ValueError("a run needs two samples at least, and a jitter below half an interval")


def _stamps(duration: float, interval: float, jitter: float, seed: int) -> Array:
    t: Array = interval * np.arange(round(duration / interval), dtype=np.float64)
    if jitter:
        t[1:] += np.random.default_rng([seed, zlib.crc32(b"stamps")]).uniform(-jitter, jitter, len(t) - 1)
    return t


def _held(command: Command, stamps: Array) -> Array:
    values = np.asarray(command, dtype=float)
    if values.ndim == 1 and len(values) == len(stamps):
        return values.copy()
    if values.ndim != 2 or values.shape[1] != 2:
        raise ValueError(f"a command is {len(stamps)} values, one per stamp, or pairs (time, value)")
    at = np.searchsorted(values[:, 0], stamps + 1e-9, side="right") - 1
    return np.where(at >= 0, values[np.maximum(at, 0), 1], 0.0)


def _setting(
    hull: Hull,
    afloat: Afloat,
    held: Mapping[str, Array],
    measured: tuple[str, ...],
    seed: int,
    initial: Mapping[str, float],
) -> Setting:
    swing = {name: float(np.max(np.abs(values))) for name, values in held.items()}
    return Setting(
        motion=afloat,
        axes={dof: getattr(afloat, dof) for dof in hull.dofs},
        inputs={name: INPUTS[name] for name in held},
        swing=swing,
        gain={"yaw": hull.gain if "delta" in held else 1.0},
        signals=measured,
        seed=str(seed),
        cruise=_cruise(hull, held, initial),
        bottom=hull.bottom,
    )


def _cruise(hull: Hull, held: Mapping[str, Array], initial: Mapping[str, float]) -> float:
    """Return the speed [m/s] its rms command ahead holds, or the one it begins with."""
    if "X" not in held:
        return initial.get("u", 0.0)
    force, axis = float(np.sqrt(np.mean(np.square(held["X"])))), hull.axis("surge")
    return _steady(axis, force)


def _steady(axis: AxisDynamics, force: float) -> float:
    if axis.beta2 > 0.0:
        return (math.sqrt(axis.beta**2 + 4.0 * axis.beta2 * force) - axis.beta) / (2.0 * axis.beta2)
    return force / axis.beta if axis.beta > 0.0 else 0.0


def _shortest(hull: Hull, setting: Setting, effects: Sequence[Effect]) -> float:
    """Return the longest step [s] that is short against hull and effects."""
    longest = math.inf
    for dof in hull.dofs:
        axis = hull.axis(dof)
        force = sum(setting.gain.get(dof, 1.0) * setting.swing[n] for n, d in setting.inputs.items() if d == dof)
        rate = axis.beta + 2.0 * axis.beta2 * _steady(axis, force)
        longest = min(longest, axis.alpha / rate / _STEPS_PER_TIME_CONSTANT if rate > 0.0 else math.inf)
    return min([longest, *(effect.quickness(setting) / _STEPS_PER_RADIAN for effect in effects)])


def _sail(
    hull: Hull,
    afloat: Afloat,
    effects: Sequence[Effect],
    longest: float,
    held: Mapping[str, Array],
    stamps: Array,
    knots: Array,
    state: tuple[float, ...],
) -> tuple[Array, Array]:
    """Return times (k,) and true states (k, 8) from the first to the last of *knots* (stamps, and before and after)."""
    afloat.pushes = [e.alter_force for e in effects if e.overrides("alter_force")]
    drives = [e.alter_input for e in effects if e.overrides("alter_input")]
    changes = [e.alter_parameters for e in effects if e.overrides("alter_parameters")]
    step = afloat.stepper(hull, state)
    inputs = dict.fromkeys(held, 0.0)
    rows = {name: values.tolist() for name, values in held.items()}
    row = np.maximum(np.searchsorted(stamps, knots + 1e-12, side="right") - 1, 0).tolist()
    ends = knots.tolist()
    times, states = [ends[0]], [state]
    longest = min(longest, float(np.median(np.diff(stamps))) / _STEPS_PER_SAMPLE)
    for begin, end, i in zip(ends, ends[1:], row, strict=False):
        count = max(1, math.ceil((end - begin) / longest - 1e-9))
        dt = (end - begin) / count
        for name, values in rows.items():
            inputs[name] = values[i]
        _ask(hull, afloat.asked, inputs)
        told = dict(inputs)
        for k in range(count):
            t = begin + k * dt
            if drives or changes:
                afloat.take(state)
            if changes:
                afloat.restore()
                for change in changes:
                    change(t, afloat)
            if drives:
                inputs.update(told)
                for drive in drives:
                    drive(t, dt, inputs)
                _ask(hull, afloat.asked, inputs)
            state = step(t, dt, state)
            times.append(t + dt)
            states.append(state)
    return np.array(times), np.array(states)


def _ask(hull: Hull, asked: Loads, inputs: Mapping[str, float]) -> None:
    get = inputs.get
    asked.X, asked.Y, asked.Z = get("X", 0.0), get("Y", 0.0), get("Z", 0.0)
    asked.N = get("N", 0.0) + hull.gain * get("delta", 0.0)
