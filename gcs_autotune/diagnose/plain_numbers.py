"""Calculate gain, time constant, delay and trim of a fitted model, with standard errors, from its step response.

The step starts from rest and is as large as the runs' commands (rms); both directions are averaged. With quadratic drag
or nonlinear thrust, the gain depends on that size. Effects count if they produce drag, a constant force, or a curve
between command and force. Drifting forces, forces that depend on the heading, and sensor errors do not count.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.diagnose.adequacy import correlation_of
from gcs_autotune.effects import EFFECTS, Drive, EffectInstance, columns_of, in_order
from gcs_autotune.identify.problems import Fitted, Problem
from gcs_autotune.identify.signals import Segment
from gcs_autotune.models import CoupledModel, Form
from gcs_autotune.sname import DOFS

__all__ = ["CONSTANT", "CURVED", "LATE", "PLAIN", "PlainNumber", "command_sizes", "driven_by", "plain_numbers"]

Array = NDArray[np.float64]

PLAIN: Mapping[str, str] = {
    "gain": "steady speed per unit of command",
    "time constant": "time to reach 63 % of the steady speed after a step",
    "delay": "time from command to force",
    "trim": "command that holds the craft still",
}
"""Number of the plain model -> its meaning."""

LATE = frozenset({"input-delay", "actuator-lag", "measurement-delay", "time-offset"})
CONSTANT = frozenset({"input-bias", "net-buoyancy", "tether-pull", "gyro-bias"})
CURVED = frozenset({"dead-zone", "saturation", "quadratic-actuator", "asymmetric-thrust", "rudder-stall"})
"""Effects of three kinds: a delay (LATE), a trim (CONSTANT), a curve between command and force (CURVED)."""

SETTLED = 1.0 - math.exp(-1.0)
_START = 0.3
"""Start value of the delay, relative to the craft's time constant."""

Key = tuple[str, str]


@dataclass(frozen=True, slots=True)
class PlainNumber:
    """One number with its standard error; ``beside``: its value and standard error without the identified causes."""

    unit: str
    value: float
    std: float
    beside: tuple[float, float]


def command_sizes(form: Form, segments: Sequence[Segment]) -> dict[str, float]:
    """Return the root mean square of every input over the time in which it is not zero."""
    sizes = {}
    for channel in form.inputs:
        square = held = 0.0
        for s in segments:
            u = s.inputs[:, s.input_names.index(channel)]
            lasts = np.diff(np.append(s.t_in, max(float(s.stamps[-1]), float(s.t_in[-1]))))
            square += float(np.sum(lasts * u**2))
            held += float(np.sum(lasts[u != 0.0]))
        sizes[channel] = math.sqrt(square / held) if held > 0.0 else 0.0
    return sizes


def driven_by(form: Form) -> dict[str, tuple[str, float | str]]:
    """Return driven degree of freedom -> (input channel, its gain). With several channels it is the first one."""
    driving: dict[str, tuple[str, float | str]] = {}
    for dof in form.dofs:
        for channel, pairs in form.inputs.items():
            for force, gain in pairs:
                if force == DOFS[dof].force:
                    driving.setdefault(dof, (channel, gain))
    return driving


def plain_numbers(
    problem: Problem, fitted: Fitted, sizes: Mapping[str, float], causes: Collection[Key] = ()
) -> dict[Key, PlainNumber]:
    """Return (kind, where) -> number of a fitted model, with delay and trim fitted in addition.

    sizes : step size of every input. causes : effects (slug, place) that ``beside`` leaves out.

    A craft without drag has neither gain nor time constant.
    """
    driven = driven_by(fitted.form)
    fit = _with_delay_and_trim(problem, fitted, driven)
    if fit is None:
        return {}
    reading = _Reading(fit, sizes, frozenset(causes))
    numbers: dict[Key, PlainNumber] = {}
    for dof, (channel, gain) in driven.items():
        axis, unit = DOFS[dof], problem.data_summary.inputs.get(channel, "1")
        rate = "rad/s" if axis.angular else "m/s"
        per = rate if unit == "1" else f"{rate}/({unit})" if " " in unit else f"{rate}/{unit}"
        for kind, own, k in (("gain", per, 0), ("time constant", "s", 1), ("trim", unit, 2)):
            where = channel if kind == "trim" else dof
            if kind == "trim" or sizes.get(channel, 0.0) > 0.0:
                reading.add(numbers, (kind, where), own, _step_of(dof, channel, gain, k))
    for channel in dict.fromkeys(c for c, _ in driven.values()):
        if any(_delays(e, channel, problem) for e in fit.effects):
            reading.add(numbers, ("delay", channel), "s", _delay_of(channel, problem))
    order = list(PLAIN)
    return dict(sorted(numbers.items(), key=lambda item: order.index(item[0][0])))


def _with_delay_and_trim(
    problem: Problem, fitted: Fitted, driven: Mapping[str, tuple[str, float | str]]
) -> Fitted | None:
    """Return the fit with a delay of every input and a constant force in every equation, where these are missing."""
    form = fitted.form
    constant = {e.place for e in fitted.effects if e.slug in CONSTANT}
    trims = [n for d in driven if d not in constant and (n := f"{DOFS[d].force}_0") not in form.parameters]
    if "heave" in driven and "net-buoyancy" in {e.slug for e in fitted.effects}:
        trims = [n for n in trims if n != "Z_0"]
    wide = form.freeing(*trims)
    values = dict(zip(form.parameters, fitted.theta.tolist(), strict=True))
    theta = np.array([values.get(n, 0.0) for n in wide.parameters])
    late = {n for e in fitted.effects if e.slug in LATE for n in columns_of(e.place)}
    everywhere = any(e.slug in LATE - {"input-delay", "actuator-lag"} for e in fitted.effects)
    lacking = [] if everywhere else [c for c in dict.fromkeys(c for c, _ in driven.values()) if c not in late]
    more = Problem(
        wide, problem.segments, problem.data_summary, problem.limits, (*problem.free, *trims), stamps=problem.stamps
    )
    best: Fitted | None = None
    for share in (0.0, _START) if lacking else (0.0,):
        delay = {"delay": share * problem.data_summary.time_constant}
        delays = [EffectInstance("input-delay", c, delay) for c in lacking]
        fit = more.fit(theta, (*fitted.effects, *delays), fitted.initial, shift=fitted.shift)
        best = fit if fit is not None and (best is None or fit.cost < best.cost) else best
    return best


Quantity = Callable[["_Numbers"], float]


@dataclass(frozen=True, slots=True, eq=False)
class _Numbers:
    """A model's numbers: base parameters by name, effects, and the step size of every input."""

    form: Form
    base: Mapping[str, float]
    effects: tuple[EffectInstance, ...]
    sizes: Mapping[str, float]

    def force(self, name: str) -> float:
        """Return a hydrodynamic derivative or constant force, including the contribution of the effects."""
        total = self.base.get(name, 0.0)
        for e in self.effects:
            if EFFECTS[e.slug].acts_on <= {"motion"}:
                total += EFFECTS[e.slug].derivatives(e).get(name, 0.0)
        return total

    def acting(self, channel: str) -> float:
        """Return the effective command for a step of the channel's size, averaged over both directions."""
        size = self.sizes.get(channel, 0.0)
        both = []
        for way in (size, -size):
            steps = {c: np.full(2, way if c == channel else 0.0) for c in self.form.inputs}
            drive = Drive(np.array([0.0, 1.0]), steps, 0.0)
            for e in in_order(self.effects):
                if e.slug in CURVED and (e.place == channel or channel in self.shared(e)):
                    drive = EFFECTS[e.slug].drive(e, drive)
            both.append(float(drive.channels[channel][-1]))
        return 0.5 * (both[0] - both[1])

    def shared(self, effect: EffectInstance) -> tuple[str, ...]:
        """Return the two thrusters that an effect has in common; empty if the effect mixes steering and throttle."""
        names = columns_of(effect.place)
        alike = len({frozenset((f, str(g).lstrip("-")) for f, g in self.form.inputs.get(n, ())) for n in names}) == 1
        return names if alike else ()


class _Reading:
    """Quantities of a fit with standard errors, by linear propagation from the fitted numbers."""

    def __init__(self, fit: Fitted, sizes: Mapping[str, float], causes: frozenset[Key]) -> None:
        self.fit, self.sizes, self.causes = fit, sizes, causes
        width = len(fit.free) + len(fit.free_effects)
        self.covariance = fit.covariance(correlation_of(fit))[:width, :width]

    def add(self, numbers: dict[Key, PlainNumber], key: Key, unit: str, of: Quantity) -> None:
        """Calculate a quantity and add it to *numbers*, if the model determines it."""
        value, std = self._uncertain(of, frozenset())
        if math.isfinite(value):
            beside = self._uncertain(of, self.causes) if self.causes and key[0] != "delay" else (value, std)
            numbers[key] = PlainNumber(unit, value, std, beside)

    def _uncertain(self, of: Quantity, without: frozenset[Key]) -> tuple[float, float]:
        width = len(self.covariance)
        value, slope = of(self._numbers(without)), np.zeros(width)
        for k in range(width):
            h = 1e-6 * max(abs(self._at(k)), 1e-6)
            slope[k] = (of(self._numbers(without, k, h)) - value) / h
        variance = float(slope @ self.covariance @ slope)
        return value, math.sqrt(max(variance, 0.0)) if math.isfinite(variance) else math.inf

    def _at(self, k: int) -> float:
        return float(self.fit.shared[k])

    def _numbers(self, without: frozenset[Key], moved: int = -1, by: float = 0.0) -> _Numbers:
        fit = self.fit
        base = CoupledModel(fit.form, dict(zip(fit.form.parameters, fit.theta.tolist(), strict=True)))
        values = {n: base[n] for n in (*fit.form.parameters, *fit.form.known)}
        effects = list(fit.effects)
        if 0 <= moved < len(fit.free):
            values[fit.free[moved]] += by
        elif moved >= 0:
            i, name = fit.free_effects[moved - len(fit.free)]
            effects[i] = effects[i].with_values({name: effects[i].values[name] + by})
        kept = tuple(e for e in effects if (e.slug, e.place) not in without)
        return _Numbers(fit.form, values, kept, self.sizes)


def _delays(effect: EffectInstance, channel: str, problem: Problem) -> bool:
    """Return whether an effect delays all measured responses to a command."""
    if effect.slug == "measurement-delay":
        return set(effect.place.split("+")) >= set(problem.data_summary.signals)
    return effect.slug == "time-offset" or (effect.slug == "input-delay" and channel in columns_of(effect.place))


def _delay_of(channel: str, problem: Problem) -> Quantity:
    return lambda numbers: sum(
        e.values["offset" if e.slug == "time-offset" else "delay"]
        for e in numbers.effects
        if _delays(e, channel, problem)
    )


def _step_of(dof: str, channel: str, gain: float | str, which: int) -> Quantity:
    """Return a function that calculates gain (0), time constant (1) or trim (2) from a model's numbers.

    The function returns NaN if the model does not determine the quantity.
    """
    axis = DOFS[dof]
    damps = f"{axis.force}_{axis.velocity}"

    def read(numbers: _Numbers) -> float:
        if isinstance(gain, str):
            share = math.copysign(1.0, -1.0 if gain.startswith("-") else 1.0) * numbers.base[gain.lstrip("-")]
        else:
            share = gain
        if which == 2:
            return -numbers.force(f"{axis.force}_0") / share if share else math.nan
        of_form = {n: v for n, v in numbers.base.items() if n in numbers.form.parameters}
        inertia = CoupledModel(numbers.form, of_form).inertia
        i = numbers.form.dofs.index(dof)
        mass = float(inertia[i, i])
        if not mass:
            return math.nan
        square = numbers.force(damps + axis.velocity) + numbers.force(f"{axis.force}_|{axis.velocity}|{axis.velocity}")
        push = share * numbers.acting(channel) / mass
        held, takes = _answer(abs(push), -numbers.force(damps) / mass, -square / mass)
        return math.copysign(held, push) / numbers.sizes[channel] if which == 0 else takes

    return read


NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)


def _answer(push: float, linear: float, quadratic: float) -> tuple[float, float]:
    """Return the final speed of ``v' = push - linear v - quadratic v^2`` and the time [s] to 63 % of it.

    Both are NaN if there is no final speed.
    """
    root = linear**2 + 4.0 * quadratic * push
    below = linear + math.sqrt(root) if root >= 0.0 else -1.0
    if push <= 0.0 or below <= 0.0:
        return math.nan, math.nan
    held = 2.0 * push / below
    v = 0.5 * SETTLED * held * (NODES + 1.0)
    takes = 0.5 * SETTLED * held * float(np.sum(WEIGHTS / (push - linear * v - quadratic * v**2)))
    return held, takes
