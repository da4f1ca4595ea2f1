"""A bare hull in open loop: commands in, hidden effects, and the recorded file.

The hull is uncoupled, except by effects. Steps are short compared with every time constant and end at the time stamps
of the file.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sitl.effects import HiddenEffect, Setting
from sitl.plants import AxisDynamics, PlanarHull, Water, Wrench
from sitl.sensors import SensorReading

__all__ = ["INPUTS", "SIGNALS", "Command", "Hull", "open_loop"]

Array = NDArray[np.float64]
Command = Array | Sequence[float] | Sequence[tuple[float, float]]
"""Values at the file's time stamps (n,), or steps as (time [s] of the step, value after it). Before the first step it
is 0.
"""

SIGNALS = ("x", "y", "z", "psi", "u", "v", "w", "r")
"""Measurable signals, SI and radians; the heading is continuous."""

_Step = Callable[[float, float, tuple[float, ...]], tuple[float, ...]]
"""Function of time [s], step [s] and state, in the order of :data:`SIGNALS`, that returns the state after the step."""

INPUTS: Mapping[str, str] = {"X": "surge", "Y": "sway", "Z": "heave", "N": "yaw", "delta": "yaw"}
"""Input channel -> degree of freedom that it drives."""

_STEPS_PER_TIME_CONSTANT = 32
"""Steps per time constant.

The error of Heun's rule is proportional to the inverse square of this number: about 2e-4.
"""
_STEPS_PER_SAMPLE = 4
_STEPS_PER_RADIAN = 16
"""Steps per radian of waves, or per time constant of an effect."""


@dataclass(frozen=True, slots=True)
class Hull:
    """A plain hull: for each degree of freedom inertia (> 0), linear and quadratic drag (0 if absent), SI.

    ``gain`` [N m/rad]: moment per rudder angle ``delta``; ``bottom`` [m]: depth of the water.
    """

    dofs: tuple[str, ...]
    inertia: Mapping[str, float]
    linear: Mapping[str, float]
    quadratic: Mapping[str, float] = field(default_factory=dict)
    gain: float = 1.0
    bottom: float = 10.0

    def axis(self, dof: str) -> AxisDynamics:
        """Return inertia, linear and quadratic drag of the degree of freedom *dof*. The inertia is infinite if the hull
        does not have it.
        """
        if dof not in self.dofs:
            return AxisDynamics(math.inf, 0.0, 0.0)
        return AxisDynamics(self.inertia[dof], self.linear.get(dof, 0.0), self.quadratic.get(dof, 0.0))


def open_loop(
    hull: Hull,
    commands: Mapping[str, Command],
    *,
    duration: float,
    interval: float,
    measured: tuple[str, ...],
    effects: Sequence[HiddenEffect] = (),
    noise: Mapping[str, float] | None = None,
    seed: int = 0,
    initial: Mapping[str, float] | None = None,
    stamps_jitter: float = 0.0,
) -> dict[str, Array]:
    """Drive *hull* with *commands* and return the columns of the recorded file: ``t``, inputs and signals, (n,) each, n
    = duration/interval.

    Commands are constant from one time stamp to the next. With a wrong clock (``time-scale``) duration, interval and
    commands are in true time, but the file's time stamps are not. For late signals (``time-offset``,
    ``measurement-delay``) the hull starts earlier by the delay, in the *initial* state and with the first command.

    Parameters
    ----------
    duration, interval : [s].
    measured : recorded signals, from :data:`SIGNALS`.
    noise : standard deviation of white noise per measured signal.
    initial : state at the start, 0 by default. stamps_jitter : largest deviation of the time stamps from the even grid
    [s],
        below half an interval.

    Raises
    ------
    ValueError
        A command, signal or degree of freedom is unknown, or the numbers do not define a run.
    BadEffect
        The hull has no place for an effect.
    """
    _check(hull, commands, measured, duration, interval, stamps_jitter)
    stamps = _stamps(duration, interval, stamps_jitter, seed)
    held = {name: _held(command, stamps) for name, command in commands.items()}
    heun = _Heun(hull)
    setting = _setting(hull, heun.plant, held, measured, seed, initial or {})
    for effect in effects:
        effect.begin(setting)
    late, run = _lateness(effects, measured), _Run(hull, heun, effects, held, stamps)
    begun = -max([0.0, *late.values()])
    last = float(stamps[-1])
    ended = last - min([0.0, *late.values()])
    state = tuple(float((initial or {}).get(name, 0.0)) for name in SIGNALS)
    knots = np.concatenate([[begun][: begun < 0.0], stamps, [ended][: ended > last]])
    t, truth = _integrate(run, _shortest(hull, setting, effects), knots, state)
    columns = {"t": stamps, **held, **_measure(run, t, truth, late, noise or {}, seed)}
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
            raise ValueError(f"this hull has no input '{name}'. Its degrees of freedom are {', '.join(hull.dofs)}")
    for name in measured:
        if name not in SIGNALS:
            raise ValueError(f"'{name}' cannot be measured. Use one of {', '.join(SIGNALS)}")
    if not (interval > 0.0 and round(duration / interval) >= 2 and 0.0 <= jitter < 0.5 * interval):
        raise ValueError("the run needs at least two samples, and a jitter below half an interval")


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
        raise ValueError(f"a command must be {len(stamps)} values, one per time stamp, or pairs (time, value)")
    at = np.searchsorted(values[:, 0], stamps + 1e-9, side="right") - 1
    return np.where(at >= 0, values[np.maximum(at, 0), 1], 0.0)


def _setting(
    hull: Hull,
    plant: PlanarHull,
    held: Mapping[str, Array],
    measured: tuple[str, ...],
    seed: int,
    initial: Mapping[str, float],
) -> Setting:
    amplitude = {name: float(np.max(np.abs(values))) for name, values in held.items()}
    return Setting(
        state=plant.state,
        water=plant.water,
        parameters=plant.parameters,
        dofs=hull.dofs,
        inputs={name: INPUTS[name] for name in held},
        amplitude=amplitude,
        gain={"yaw": hull.gain if "delta" in held else 1.0},
        signals=measured,
        seed=str(seed),
        cruise=_cruise(hull, held, initial),
    )


def _cruise(hull: Hull, held: Mapping[str, Array], initial: Mapping[str, float]) -> float:
    """Return the speed [m/s] that the rms command ahead holds, or the initial one."""
    if "X" not in held:
        return initial.get("u", 0.0)
    force, axis = float(np.sqrt(np.mean(np.square(held["X"])))), hull.axis("surge")
    return _steady(axis, force)


def _steady(axis: AxisDynamics, force: float) -> float:
    if axis.beta2 > 0.0:
        return (math.sqrt(axis.beta**2 + 4.0 * axis.beta2 * force) - axis.beta) / (2.0 * axis.beta2)
    return force / axis.beta if axis.beta > 0.0 else 0.0


def _shortest(hull: Hull, setting: Setting, effects: Sequence[HiddenEffect]) -> float:
    """Return the longest step [s] that is short compared with the time constants of hull and effects."""
    longest = math.inf
    for dof in hull.dofs:
        axis = hull.axis(dof)
        force = sum(setting.gain.get(dof, 1.0) * setting.amplitude[n] for n, d in setting.inputs.items() if d == dof)
        rate = axis.beta + 2.0 * axis.beta2 * _steady(axis, force)
        longest = min(longest, axis.alpha / rate / _STEPS_PER_TIME_CONSTANT if rate > 0.0 else math.inf)
    return min([longest, *(effect.quickness(setting) / _STEPS_PER_RADIAN for effect in effects)])


@dataclass(frozen=True, slots=True, eq=False)
class _Run:
    """A hull with its effects, driven by commands ``held`` (n,) from one of the ``stamps`` (n,) to the next."""

    hull: Hull
    heun: _Heun
    effects: Sequence[HiddenEffect]
    held: Mapping[str, Array]
    stamps: Array


def _integrate(run: _Run, longest: float, knots: Array, state: tuple[float, ...]) -> tuple[Array, Array]:
    """Return times (k,) and true states (k, 8) from the first to the last of *knots*.

    longest : step [s].
    """
    hull, heun, effects, held, stamps = run.hull, run.heun, run.effects, run.held, run.stamps
    heun.pushes = [e.alter_force for e in effects if e.overrides("alter_force")]
    heun.flows = [e.alter_water for e in effects if e.overrides("alter_water")]
    drives = [e.alter_input for e in effects if e.overrides("alter_input")]
    changes = [e.alter_parameters for e in effects if e.overrides("alter_parameters")]
    step = heun.stepper(hull, state)
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
        _set_thrust(hull, heun.thrust, inputs)
        commands = dict(inputs)
        for k in range(count):
            t = begin + k * dt
            if drives or changes:
                heun.take(state)
            if changes:
                heun.restore()
                for change in changes:
                    change(t, heun.plant.parameters)
            if drives:
                inputs.update(commands)
                for drive in drives:
                    drive(t, dt, inputs)
                _set_thrust(hull, heun.thrust, inputs)
            state = step(t, dt, state)
            times.append(t + dt)
            states.append(state)
    return np.array(times), np.array(states)


def _set_thrust(hull: Hull, wrench: Wrench, inputs: Mapping[str, float]) -> None:
    get = inputs.get
    wrench.X, wrench.Y, wrench.Z = get("X", 0.0), get("Y", 0.0), get("Z", 0.0)
    wrench.N = get("N", 0.0) + hull.gain * get("delta", 0.0)


class _Heun:
    """Integrates a hull by Heun's rule, second order.

    ``thrust``: forces of its actuators. ``pushes``: forces of effects. ``flows``: changes of the water by effects.
    """

    def __init__(self, hull: Hull) -> None:
        surge, sway, heave, yaw = (hull.axis(dof) for dof in ("surge", "sway", "heave", "yaw"))
        self.plant = PlanarHull(surge, heave, yaw, Water(bottom=hull.bottom), sway=sway)
        self.thrust = Wrench()
        self.pushes: list[Callable[[float, Wrench], None]] = []
        self.flows: list[Callable[[float, Water], None]] = []
        self._wrench = Wrench()
        self._plain = dict(self.plant.parameters)

    def restore(self) -> None:
        """Restore the hull's inertia and drag without effects."""
        self.plant.parameters.update(self._plain)

    def stepper(self, hull: Hull, state: Sequence[float]) -> _Step:
        """Return the function that integrates this hull from *state*. A hull that only turns or only dives has a faster
        one.
        """
        if any(
            speed
            for speed, dof in zip(state[4:], ("surge", "sway", "heave", "yaw"), strict=True)
            if dof not in hull.dofs
        ):
            return self.step
        if hull.dofs == ("yaw",):
            return self.step_alone("yaw")
        if hull.dofs == ("heave",):
            return self.step_alone("heave")
        return self.step

    def take(self, state: Sequence[float]) -> None:
        """Set the plant's state to *state*, in the order of :data:`SIGNALS`."""
        at = self.plant.state
        at.x, at.y, at.z, at.psi, at.u, at.v, at.w, at.r = state

    def slope(self, t: float, state: Sequence[float]) -> tuple[float, ...]:
        """Return the time derivative of *state* (Fossen2011, equations 2.40 and 6.112)."""
        _, _, _, psi, u, v, w, r = state
        wrench = self._pushed(t, state) if self.pushes else self.thrust
        water = self.flowing(t, state) if self.flows else self.plant.water
        udot, vdot, wdot, _, _, rdot = self.plant.acceleration((u, v, w, 0.0, 0.0, r), wrench)
        c, s = math.cos(psi), math.sin(psi)
        return c * u - s * v + water.V_x, s * u + c * v + water.V_y, w, r, udot, vdot, wdot, rdot

    def step_alone(self, dof: str) -> _Step:
        """Return the step function by Heun's rule for a hull that moves only in *dof* (``yaw`` or ``heave``)."""
        at, force = (SIGNALS.index("psi"), "N") if dof == "yaw" else (SIGNALS.index("z"), "Z")
        alpha, beta, beta2 = f"{dof}.alpha", f"{dof}.beta", f"{dof}.beta2"
        p = self.plant.parameters

        def step(t: float, dt: float, state: tuple[float, ...]) -> tuple[float, ...]:
            position, nu = state[at], state[at + 4]
            before = after = getattr(self.thrust, force)
            first = (getattr(self._pushed(t, state), force) if self.pushes else before) - (
                p[beta] + p[beta2] * abs(nu)
            ) * nu
            there = nu + dt * first / p[alpha]
            if self.pushes:
                after = getattr(self._pushed(t + dt, _with(state, at, position + dt * nu, there)), force)
            second = after - (p[beta] + p[beta2] * abs(there)) * there
            half = 0.5 * dt
            return _with(state, at, position + half * (nu + there), nu + half * (first + second) / p[alpha])

        return step

    def _pushed(self, t: float, state: Sequence[float]) -> Wrench:
        """Return the combined force of actuators and effects in that *state*."""
        self.take(state)
        thrust, wrench = self.thrust, self._wrench
        wrench.X, wrench.Y, wrench.Z, wrench.N = thrust.X, thrust.Y, thrust.Z, thrust.N
        for push in self.pushes:
            push(t, wrench)
        return wrench

    def flowing(self, t: float, state: Sequence[float]) -> Water:
        """Return the water as it is at time *t* [s] where the hull is."""
        self.take(state)
        for flow in self.flows:
            flow(t, self.plant.water)
        return self.plant.water

    def step(self, t: float, dt: float, state: tuple[float, ...]) -> tuple[float, ...]:
        """Return the state after *dt* [s] by Heun's rule."""
        first = self.slope(t, state)
        second = self.slope(t + dt, [s + dt * a for s, a in zip(state, first, strict=True)])
        half = 0.5 * dt
        return tuple([s + half * (a + b) for s, a, b in zip(state, first, second, strict=True)])


def _with(state: tuple[float, ...], at: int, position: float, speed: float) -> tuple[float, ...]:
    return (*state[:at], position, *state[at + 1 : at + 4], speed, *state[at + 5 :])


def _lateness(effects: Sequence[HiddenEffect], measured: tuple[str, ...]) -> dict[str, float]:
    """Return the total delay [s] of each measured signal from all effects."""
    late = dict.fromkeys(measured, 0.0)
    for effect in effects:
        for name, delay in effect.lateness().items():
            for each in measured if name == "*" else (name,):
                late[each] += delay
    return late


def _measure(
    run: _Run, t: Array, truth: Array, late: Mapping[str, float], noise: Mapping[str, float], seed: int
) -> dict[str, Array]:
    """Return the reported values at the file's stamps for the *truth* (k, 8) at *t* (k,): late, noisy, altered.

    late : delay [s] of each measured signal. noise : standard deviation by signal.
    """
    heun, effects, stamps = run.heun, run.effects, run.stamps
    water, psi = heun.plant.water, truth[:, SIGNALS.index("psi")]
    if water.over_ground:
        V_x, V_y = _current(heun, t, truth)
        truth[:, 4] += V_x * np.cos(psi) + V_y * np.sin(psi)
        truth[:, 5] += V_y * np.cos(psi) - V_x * np.sin(psi)
    reported = {}
    for name in late:
        values = np.interp(stamps - late[name], t, truth[:, SIGNALS.index(name)])
        level = noise.get(name, 0.0)
        if level > 0.0:
            values += np.random.default_rng([seed, zlib.crc32(name.encode())]).normal(0.0, level, len(values))
        reported[name] = values
    alters = [e.alter_measurement for e in effects if e.overrides("alter_measurement")]
    if alters:
        places = np.column_stack([np.interp(stamps, t, column) for column in truth.T])
        _alter(alters, heun, stamps, places, reported)
    return reported


def _current(heun: _Heun, t: Array, truth: Array) -> tuple[Array, Array]:
    """Return the water's velocity north and east (k,) at the times *t* (k,), where the hull is."""
    if not heun.flows:
        return np.full(len(t), heun.plant.water.V_x), np.full(len(t), heun.plant.water.V_y)
    velocity = np.empty((len(t), 2))
    for row, when, state in zip(velocity, t.tolist(), truth.tolist(), strict=True):
        water = heun.flowing(when, state)
        row[:] = water.V_x, water.V_y
    return velocity[:, 0], velocity[:, 1]


def _alter(
    alters: Sequence[Callable[[float, SensorReading], None]],
    heun: _Heun,
    stamps: Array,
    states: Array,
    reported: dict[str, Array],
) -> None:
    """Apply the effects to the *reported* values, for the hull's *states* (n, 8) at those *stamps*."""
    reading = SensorReading()
    for i, (t, state) in enumerate(zip(stamps.tolist(), states.tolist(), strict=True)):
        heun.take(state)
        for name, values in reported.items():
            setattr(reading, name, float(values[i]))
        for alter in alters:
            alter(t, reading)
        for name, values in reported.items():
            values[i] = getattr(reading, name)
