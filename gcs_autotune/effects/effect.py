"""The interface of an effect: a submodel between a plain simulation and the measured motion.

An effect overrides only the hooks (methods) that it needs. The hooks form the chain from commands to measurements:

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
from gcs_autotune.notebook import Displayed
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
"""Stage of the chain that an effect acts on -> names of the hooks of this stage."""

INPUT, SIGNAL = "input unit", "signal unit"
"""Placeholders in units such as ``input unit/s``, for the unit of the input (or signal) at the effect's place."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """A parameter of an effect: name, unit (may contain :data:`INPUT` or :data:`SIGNAL`) and meaning."""

    name: str
    unit: str
    meaning: str


@dataclass(frozen=True, slots=True)
class EffectInstance(Displayed):
    """An effect at one place, with values, as an element of an extended model.

    - ``slug``: name of the effect.
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
        """Sign of the base model's inertia, from the constant ``sense``: 1 by default, -1 if the inertia is
        negative.
        """
        return self.constants.get("sense", 1.0)

    def label_of(self, name: str) -> str:
        """Return the label that a fit uses for the parameter *name* of the effect, such as ``dead-zone@N.width``."""
        return f"{self.slug}@{self.place}.{name}"

    def with_values(self, values: Mapping[str, float]) -> EffectInstance:
        """Return the instance with *values* replaced."""
        return replace(self, values={**self.values, **values})

    def to_dict(self) -> dict[str, object]:
        """Return the instance as data for a model file."""
        return {
            "slug": self.slug,
            "place": self.place,
            "values": dict(self.values),
            "constants": dict(self.constants),
        }


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """Inputs of one run.

    Each value of ``channels[name]`` (j,) is held from its stamp in ``t`` (j,) to the next. The first value also applies
    before its stamp.

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
        """Return the inputs with the channel *name* replaced (or added) by *values* (j,), at the same stamps."""
        return replace(self, channels={**self.channels, name: values})

    def on(self, t: Array) -> Drive:
        """Return the inputs at the stamps *t* (k,), held from the old stamps."""
        at = np.maximum(np.searchsorted(self.t, t, side="right") - 1, 0)
        return replace(self, t=t, channels={n: v[at] for n, v in self.channels.items()})


@dataclass(frozen=True, slots=True, eq=False)
class Observed:
    """Predicted signals of one run: ``signals[name]`` (s,) at the stamps ``t`` (s,), the same for all signals."""

    t: Array
    signals: Mapping[str, Array]
    start: float
    run: str = ""

    def with_signal(self, name: str, values: Array) -> Observed:
        """Return the prediction with the signal *name* replaced by *values* (s,)."""
        return replace(self, signals={**self.signals, name: values})


@dataclass(frozen=True, slots=True, eq=False)
class EffectResidual:
    """Residual (measured minus predicted) of one signal of one run.

    It contains the stamps (n,), the values (n,), and the fitted noise level of the signal over all runs.
    """

    run: str
    signal: str
    t: Array
    error: Array
    measured: Array
    level: float


@dataclass(frozen=True, slots=True, eq=False)
class EffectCurve(Displayed):
    """Plot data of an effect: ``y`` over ``x``, with axis labels; ``polar`` if ``x`` is a heading [rad].

    ``plain`` (n,): the curve without the effect, for comparison. None means zero.
    """

    x: Array
    y: Array
    x_label: str
    y_label: str
    title: str
    plain: Array | None = None
    polar: bool = False


def columns_of(place: str) -> tuple[str, ...]:
    """Return the columns (or degrees of freedom) of *place*: ``u`` and ``v`` for ``"u+v"`` and for ``"u+v@run"``."""
    return tuple(place.partition("@")[0].split("+"))


def concerns(place: str, run: str) -> bool:
    """Return whether an effect at *place* acts in *run*.

    An effect at ``"N@run"`` acts only in the run called ``run``.
    """
    _, one, name = place.partition("@")
    return not one or name == run


class Effect:
    """One row of the table of effects. Class attributes describe the effect, and methods implement it (see the module).

    - ``words``: its name in a sentence; by default its slug with blanks.
    - ``plain``: the first sentence of a report, for the owner of the craft. Words in braces are filled in:
      ``{simulation}`` (the simulation, or a plain one), ``{motion}`` (turning, diving), ``{command}`` (throttle,
      rudder) and ``{signal}`` (heading, depth).
    - ``shown_by``: the residual that indicates the effect.
    - ``mistaken_for``: slugs of similar effects.
    - ``separated_by``: the manoeuvre that distinguishes it from these.
    """

    slug: ClassVar[str]
    family: ClassVar[Family]
    meaning: ClassVar[str]
    words: ClassVar[str] = ""
    plain: ClassVar[str] = ""
    parameters: ClassVar[tuple[Quantity, ...]] = ()
    shown_by: ClassVar[str]
    mistaken_for: ClassVar[tuple[str, ...]] = ()
    separated_by: ClassVar[str]
    fixed: ClassVar[tuple[str, ...]] = ()
    """Parameters that least squares does not fit: they are selected from :meth:`starts`, or estimated by
    :meth:`learn`."""
    happens_at: ClassVar[tuple[str, ...]] = ()
    """Parameters that are times in the run.

    A fit of a time may end in a local minimum, one oscillation too early or too late.
    """
    yields_to: ClassVar[tuple[str, ...]] = ()
    """Slugs of more common causes, which are reported before this effect if the runs do not distinguish them."""
    form_of: ClassVar[tuple[str, ...]] = ()
    """Slugs of the same cause with a simpler law.

    If the runs support the simpler law equally well, it is reported first, together with this effect.
    """
    is_structural: ClassVar[bool] = False
    """Whether a first model of such a craft usually omits the effect.

    Examples are the order of the drag, coupling, speed, thrust curve and delay. Other effects indicate a fault of the
    craft, its surroundings or the record.
    """
    grows_with: ClassVar[tuple[str, ...]] = ()
    """Parameters that scale the effect.

    If all of them are multiplied by a factor, the size of the effect changes by about that factor.
    """
    neutral: ClassVar[Mapping[str, float]] = MappingProxyType({})
    """Values of the parameters in ``grows_with`` at which the effect is zero.

    For parameters that are not listed, the value is 0.
    """

    acts_on: ClassVar[frozenset[Stage]] = frozenset()
    """Stages of the chain that the effect acts on, derived from the hooks that its class defines."""
    is_disturbance: ClassVar[bool] = False
    """Whether the effect is a disturbance that no simulation predicts.

    :meth:`learn` then estimates it from the residual.
    """
    is_rounding: ClassVar[bool] = False
    """Whether the residual has heavy tails by construction. It is True if the class defines :meth:`normal`."""

    def __init_subclass__(cls) -> None:
        def defines(hook: str) -> bool:
            return getattr(cls, hook) is not getattr(Effect, hook)

        cls.acts_on = frozenset(stage for stage, hooks in HOOKS.items() if any(map(defines, hooks)))
        cls.is_disturbance, cls.is_rounding = defines("learn"), defines("normal")

    # -- where it may sit, and where a search for it begins

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the places at which the runs of *data* can show the effect, or an empty tuple."""
        raise NotImplementedError

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return a few sets of start values.

        From at least one of them a fit converges for any relevant size of the effect.
        """
        return ({},)

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the smallest and the largest value of each parameter."""
        return {}

    def constants(self, place: str, data: DataSummary) -> Mapping[str, float]:
        """Return name -> constant of the effect at *place*.

        Constants are calculated from the runs once and not fitted.
        """
        return {}

    def followers(self, effect: EffectInstance, data: DataSummary) -> tuple[EffectInstance, ...]:
        """Return alternatives to an effect that :attr:`happens_at` one time: effects that depend on a recorded
        command instead.
        """
        return ()

    # -- what it does

    def retime(self, effect: EffectInstance, t: Array, start: float, *, inputs: bool) -> Array:
        """Return the file's stamps *t* (n,), of input or of signal columns, converted to true time."""
        return t

    def inputs(self, effect: EffectInstance) -> tuple[str, ...]:
        """Return the names of the inputs that :meth:`drive` adds (``payload``, or names that :meth:`derivatives`
        uses).
        """
        return ()

    def drive(self, effect: EffectInstance, drive: Drive) -> Drive:
        """Return *drive* with the commands converted to actuator outputs."""
        return drive

    def derivatives(self, effect: EffectInstance) -> Mapping[str, float]:
        """Return forces to be added to those of the base model.

        The keys are names of SNAME derivatives (:mod:`gcs_autotune.models.coupled.derivatives`).
        """
        return {}

    def observe(self, effect: EffectInstance, seen: Observed) -> Observed:
        """Return *seen* with the true signals converted to those that the sensors report."""
        return seen

    def learn(self, effect: EffectInstance, left: Sequence[EffectResidual]) -> EffectInstance:
        """Return *effect* with values estimated from the residuals *left*.

        Only disturbances and sensor faults need this method.
        """
        return effect

    def judge(self, effect: EffectInstance, left: EffectResidual, columns: Array) -> tuple[Array, Array, float]:
        """Return the residual (n,) without this disturbance, the derivatives (n, k) of that residual, and a penalty.

        Samples that the disturbance explains entirely become NaN. Let m of n samples remain, with mean square s^2 over
        all runs of the signal. Then ``m log(s^2) + penalty`` compares with ``n log(s^2)`` of the raw residual. Both are
        minus twice the log-likelihood of all n samples, less ``n (1 + log(2 pi))``.
        """
        return left.error, columns, 0.0

    def normal(self, effect: EffectInstance, left: EffectResidual) -> Array:
        """Return the noise (n,) in a residual whose distribution this effect changes, for a test of the tails.

        The scale of the noise is arbitrary.
        """
        raise NotImplementedError

    def uncertainty(self, effect: EffectInstance, left: Sequence[EffectResidual]) -> Mapping[str, float]:
        """Return name -> standard error of the values that :meth:`learn` has estimated.

        Standard errors of fitted values come from the fit.
        """
        return {}

    def turns(self, effect: EffectInstance) -> bool:
        """Return whether this disturbance turns the craft. Its track then follows the measured heading."""
        return False

    # -- documentation

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve | None:
        """Return plot data of the effect, or None if there is nothing to plot."""
        return None

    def unit_of(self, name: str, place: str, data: DataSummary) -> str:
        """Return the unit of the parameter *name* at *place*."""
        unit = next(q.unit for q in self.parameters if q.name == name)
        first = columns_of(place)[0]
        return unit.replace(INPUT, data.inputs.get(first, "1")).replace(SIGNAL, data.signals.get(first, "1"))
