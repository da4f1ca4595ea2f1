"""The interface of an effect: a submodel between a plain simulation and the measured motion.

An effect overrides only the hooks that it needs. They form the chain from commands to measurements:

===============  ===========================================================================================
``retime``       converts the file's stamps to true time (wrong clocks)
``drive``        converts commands to actuator outputs, and adds inputs of the effect's own (``inputs``)
``derivatives``  returns forces in the equations of motion, as SNAME derivatives with values
``observe``      converts true signals to those that the sensors report
``learn``        estimates the parameters of a disturbance from the residual, because no simulation predicts it
``judge``        returns the residual with that disturbance removed
``normal``       returns the noise behind that residual, if its distribution has heavy tails by construction
===============  ===========================================================================================

The simulator has effects of the same slugs and parameter names, deliberately implemented separately.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects.summary import DataSummary
from gcs_autotune.trial import Channel

__all__ = [
    "INPUT",
    "SIGNAL",
    "Drive",
    "Effect",
    "EffectCurve",
    "EffectInstance",
    "EffectResidual",
    "Family",
    "Observed",
    "Quantity",
    "columns_of",
    "concerns",
]

Array = NDArray[np.float64]

Family = Literal["data errors", "actuator", "hydrodynamics", "environment", "sensor"]

Stage = Literal["clock", "commands", "motion", "sensors"]
HOOKS: Mapping[Stage, tuple[str, ...]] = {
    "clock": ("retime",),
    "commands": ("drive", "inputs"),
    "motion": ("derivatives",),
    "sensors": ("observe",),
}
"""Stage of the chain that an effect acts on -> the hooks that do it."""

INPUT, SIGNAL = "input unit", "signal unit"
"""Placeholders in units such as ``input unit/s``, for the unit of the input (or signal) at the effect's place."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """A parameter of an effect: name, unit (with :data:`INPUT` or :data:`SIGNAL` in it) and meaning."""

    name: str
    unit: str
    meaning: str


@dataclass(frozen=True, slots=True)
class EffectInstance:
    """An effect at a place, with values: a part of an extended model.

    - ``place``: the input, signal or degree of freedom (``"N"``, ``"psi"``, ``"yaw"``; several joined by ``+``).
    - ``values``: the fitted parameters, SI.
    - ``constants``: numbers read from the runs once, such as a reference speed.
    """

    slug: str
    place: str
    values: Mapping[str, float]
    constants: Mapping[str, float] = field(default_factory=dict)

    def __getitem__(self, name: str) -> float:
        """Return the value or constant *name*."""
        return self.values[name] if name in self.values else self.constants[name]

    @property
    def sense(self) -> float:
        """The constant ``sense``: -1 if the base model's inertia is negative, 1 by default."""
        return self.constants.get("sense", 1.0)

    def label_of(self, name: str) -> str:
        """Return what a fit calls a parameter of the effect: ``dead-zone@N.width``."""
        return f"{self.slug}@{self.place}.{name}"

    def with_values(self, values: Mapping[str, float]) -> EffectInstance:
        """Return the instance with some values replaced."""
        return replace(self, values={**self.values, **values})

    def to_dict(self) -> dict[str, object]:
        """Return the instance as plain data."""
        return {
            "slug": self.slug,
            "place": self.place,
            "values": dict(self.values),
            "constants": dict(self.constants),
        }


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """Inputs of one run; each value of ``channels[name]`` (j,) is held from its stamp in ``t`` (j,) to the next.

    The first value also holds before its stamp.

    - ``measured``: the run's recorded channels, for effects that depend on a measured quantity.
    - ``start`` [s]: the run's first stamp.
    - ``run``: its name.
    """

    t: Array
    channels: Mapping[str, Array]
    start: float
    measured: Mapping[str, Channel] = field(default_factory=dict)
    run: str = ""

    def with_channel(self, name: str, values: Array) -> Drive:
        """Return the inputs with one channel replaced (or added), at the same stamps."""
        return replace(self, channels={**self.channels, name: values})

    def on(self, t: Array) -> Drive:
        """Return the inputs at other stamps (k,), held from the old ones."""
        at = np.maximum(np.searchsorted(self.t, t, side="right") - 1, 0)
        return replace(self, t=t, channels={n: v[at] for n, v in self.channels.items()})


@dataclass(frozen=True, slots=True, eq=False)
class Observed:
    """Predicted signals of one run: ``signals[name]`` (s,) at the stamps ``t`` (s,), all signals at all stamps."""

    t: Array
    signals: Mapping[str, Array]
    start: float
    run: str = ""

    def with_signal(self, name: str, values: Array) -> Observed:
        """Return the prediction with one signal replaced."""
        return replace(self, signals={**self.signals, name: values})


@dataclass(frozen=True, slots=True, eq=False)
class EffectResidual:
    """Residual (measured minus predicted) of one signal of one run.

    It contains stamps, values (n,), and the fitted noise level of the signal over all runs.
    """

    run: str
    signal: str
    t: Array
    error: Array
    measured: Array
    level: float


@dataclass(frozen=True, slots=True, eq=False)
class EffectCurve:
    """Plot data of an effect: ``y`` over ``x``, with axis labels; ``polar`` if ``x`` is a heading [rad].

    ``plain`` (n,): the curve without the effect, for comparison; None if that is zero.
    """

    x: Array
    y: Array
    x_label: str
    y_label: str
    title: str
    plain: Array | None = None
    polar: bool = False


def columns_of(place: str) -> tuple[str, ...]:
    """Return the columns (or degrees of freedom) of a place: ``u`` and ``v`` for ``"u+v"`` and for ``"u+v@run"``."""
    return tuple(place.partition("@")[0].split("+"))


def concerns(place: str, run: str) -> bool:
    """Return whether an effect at *place* acts in *run*; ``"N@run"`` acts only in the run of that name."""
    _, one, name = place.partition("@")
    return not one or name == run


class Effect:
    """One row of the table of effects: class attributes describe it, methods implement it (see the module).

    - ``plain``: the first sentence of a report, for the owner of the boat. Words in braces are filled in: ``{craft}``
      (boat or vehicle), ``{simulation}`` (the simulation, or a plain one), ``{motion}`` (turning, diving),
      ``{command}`` (throttle, rudder) and ``{signal}`` (heading, depth).
    - ``shown_by``: the residual that indicates the effect.
    - ``mistaken_for``: slugs of similar effects.
    - ``separated_by``: the manoeuvre that distinguishes it from these.
    """

    slug: ClassVar[str]
    family: ClassVar[Family]
    meaning: ClassVar[str]
    plain: ClassVar[str] = ""
    parameters: ClassVar[tuple[Quantity, ...]] = ()
    shown_by: ClassVar[str]
    mistaken_for: ClassVar[tuple[str, ...]] = ()
    separated_by: ClassVar[str]
    fixed: ClassVar[tuple[str, ...]] = ()
    """Parameters that least squares does not fit: they are selected from :meth:`starts`, or estimated by
    :meth:`learn`."""
    happens_at: ClassVar[tuple[str, ...]] = ()
    """Parameters that are times in the run. A fit of such a time may end in a local minimum, one oscillation too early
    or too late."""
    yields_to: ClassVar[tuple[str, ...]] = ()
    """Slugs of more common causes, which are reported before this one if runs do not distinguish them."""
    form_of: ClassVar[tuple[str, ...]] = ()
    """Slugs of the same cause with a simpler law.

    If runs support the simpler law as well, it is reported first, together with this one.
    """
    is_structural: ClassVar[bool] = False
    """Whether a first model of such a craft usually omits the effect.

    Examples are the order of the drag, coupling, speed, thrust curve and delay. Other effects indicate a fault of the
    craft, its surroundings or the record.
    """
    grows_with: ClassVar[tuple[str, ...]] = ()
    """Parameters that scale the effect: if all are multiplied by a factor, its size changes by about that factor."""
    neutral: ClassVar[Mapping[str, float]] = MappingProxyType({})
    """Values of the parameters in ``grows_with`` at which the effect vanishes; 0 for parameters not listed."""

    acts_on: ClassVar[frozenset[Stage]] = frozenset()
    """Stages of the chain that the effect acts on; derived from the hooks that a class defines."""
    is_disturbance: ClassVar[bool] = False
    """Whether it is a disturbance, which no simulation predicts: :meth:`learn` estimates it from the residual."""
    is_rounding: ClassVar[bool] = False
    """Whether the residual has heavy tails by construction; set if a class defines :meth:`normal`."""

    def __init_subclass__(cls) -> None:
        def defines(hook: str) -> bool:
            return getattr(cls, hook) is not getattr(Effect, hook)

        cls.acts_on = frozenset(stage for stage, hooks in HOOKS.items() if any(map(defines, hooks)))
        cls.is_disturbance, cls.is_rounding = defines("learn"), defines("normal")

    # -- where it may sit, and where a search for it begins

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the places where these runs can show the effect; empty if they cannot."""
        raise NotImplementedError

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return a few start values, at least one of them close enough for a fit of any size that matters."""
        return ({},)

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the smallest and the largest value of each parameter."""
        return {}

    def constants(self, place: str, data: DataSummary) -> Mapping[str, float]:
        """Return numbers that are read from the runs once and not fitted."""
        return {}

    def followers(self, effect: EffectInstance, data: DataSummary) -> tuple[EffectInstance, ...]:
        """Return alternatives to an effect that :attr:`happens_at` one time: effects that follow a recorded command
        instead."""
        return ()

    # -- what it does

    def retime(self, effect: EffectInstance, t: Array, start: float, *, inputs: bool) -> Array:
        """Convert the file's stamps *t*, of input or of signal columns, to true time."""
        return t

    def inputs(self, effect: EffectInstance) -> tuple[str, ...]:
        """Return the inputs that :meth:`drive` adds (``payload``, or names that :meth:`derivatives` use)."""
        return ()

    def drive(self, effect: EffectInstance, drive: Drive) -> Drive:
        """Convert commands to actuator outputs."""
        return drive

    def derivatives(self, effect: EffectInstance) -> Mapping[str, float]:
        """Return forces to be added to those of the base model.

        They are SNAME derivatives (:mod:`gcs_autotune.models.coupled.derivatives`).
        """
        return {}

    def observe(self, effect: EffectInstance, seen: Observed) -> Observed:
        """Convert true signals to those that the sensors report."""
        return seen

    def learn(self, effect: EffectInstance, left: Sequence[EffectResidual]) -> EffectInstance:
        """Estimate the values from the residuals; only for disturbances and sensor faults."""
        return effect

    def judge(self, effect: EffectInstance, left: EffectResidual, columns: Array) -> tuple[Array, Array, float]:
        """Return the residual (n,) and its derivatives (n, k) with this disturbance removed, and a penalty.

        Samples that the disturbance explains entirely become NaN. Let m of n samples be left, with mean square s^2 over
        all runs of the signal. Then ``m log(s^2) + penalty`` compares with ``n log(s^2)`` of the raw residual. Both are
        minus twice the log-likelihood of all n samples, less ``n (1 + log(2 pi))``.
        """
        return left.error, columns, 0.0

    def normal(self, effect: EffectInstance, left: EffectResidual) -> Array:
        """Return the noise (n,) behind a residual whose distribution this effect changes, to test its tails.

        Its scale is arbitrary.
        """
        raise NotImplementedError

    def uncertainty(self, effect: EffectInstance, left: Sequence[EffectResidual]) -> Mapping[str, float]:
        """Return standard errors of the values that :meth:`learn` has estimated; those of fitted values come from the
        fit."""
        return {}

    # -- what is told of it

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve | None:
        """Return plot data of the effect; None if there is nothing to plot."""
        return None

    def unit_of(self, name: str, place: str, data: DataSummary) -> str:
        """Return the unit of a parameter at a place."""
        unit = next(q.unit for q in self.parameters if q.name == name)
        first = columns_of(place)[0]
        return unit.replace(INPUT, data.inputs.get(first, "1")).replace(SIGNAL, data.signals.get(first, "1"))
