"""The interface of an effect: a submodel between a plain simulation and the measured motion.

An effect overrides the hooks it needs and nothing else; the chain from commands to measurements runs through them:

===============  ==========================================================================================
``retime``       the file's stamps made the craft's own time (wrong clocks)
``drive``        commands made what the actuators do, and inputs of its own added (``inputs``)
``derivatives``  forces in the equations of motion, as SNAME derivatives with values
``observe``      true signals made what the sensors report
``learn``        for disturbances that no simulation foretells: parameters from what is left over ...
``judge``        ... and the residual as that disturbance leaves it
``normal``       ... and, where that has heavy tails by construction, the noise behind it
===============  ==========================================================================================

The simulator has effects of the same slugs and parameter names, written apart from these on purpose.
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
"""What an effect acts on -> the hooks by which it does."""

INPUT, SIGNAL = "input unit", "signal unit"
"""Stand for the unit of the input (or signal) an effect sits on, in units such as ``input unit/s``."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """A parameter of an effect: name, unit (with :data:`INPUT` or :data:`SIGNAL` in it) and meaning."""

    name: str
    unit: str
    meaning: str


@dataclass(frozen=True, slots=True)
class EffectInstance:
    """An effect at a place, with values: a part of an extended model.

    ``place`` names the input, signal or degree of freedom (``"N"``, ``"psi"``, ``"yaw"``; several joined by ``+``);
    ``values`` the fitted parameters, SI; ``constants`` numbers read off the runs once (a reference speed, say).
    """

    slug: str
    place: str
    values: Mapping[str, float]
    constants: Mapping[str, float] = field(default_factory=dict)

    def __getitem__(self, name: str) -> float:
        """Return a value or a constant."""
        return self.values[name] if name in self.values else self.constants[name]

    @property
    def sense(self) -> float:
        """The constant ``sense``: -1 if the base model's inertia is negative, 1 by default."""
        return self.constants.get("sense", 1.0)

    def with_values(self, values: Mapping[str, float]) -> EffectInstance:
        """Return it with some values replaced."""
        return replace(self, values={**self.values, **values})

    def to_dict(self) -> dict[str, object]:
        """Return plain data."""
        return {
            "slug": self.slug,
            "place": self.place,
            "values": dict(self.values),
            "constants": dict(self.constants),
        }


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """Inputs of one run: each value of ``channels[name]`` (j,) holds from its stamp ``t`` (j,) on, the first before it.

    ``measured`` are the run's own channels, for effects that go with something measured; ``start`` [s] its first stamp;
    ``run`` its name.
    """

    t: Array
    channels: Mapping[str, Array]
    start: float
    measured: Mapping[str, Channel] = field(default_factory=dict)
    run: str = ""

    def with_channel(self, name: str, values: Array) -> Drive:
        """Return it with one channel replaced (or added), at the same stamps."""
        return replace(self, channels={**self.channels, name: values})

    def on(self, t: Array) -> Drive:
        """Return it held at other stamps (k,), for effects that change between the old ones."""
        at = np.maximum(np.searchsorted(self.t, t, side="right") - 1, 0)
        return replace(self, t=t, channels={n: v[at] for n, v in self.channels.items()})


@dataclass(frozen=True, slots=True, eq=False)
class Observed:
    """What is predicted of one run: ``signals[name]`` (s,) at the stamps ``t`` (s,), all signals at all of them."""

    t: Array
    signals: Mapping[str, Array]
    start: float
    run: str = ""

    def with_signal(self, name: str, values: Array) -> Observed:
        """Return it with one signal replaced."""
        return replace(self, signals={**self.signals, name: values})


@dataclass(frozen=True, slots=True, eq=False)
class EffectResidual:
    """Measured minus predicted of one signal of one run: stamps, values (n,), and the noise level fitted to all."""

    run: str
    signal: str
    t: Array
    error: Array
    measured: Array
    level: float


@dataclass(frozen=True, slots=True, eq=False)
class EffectCurve:
    """An effect drawn: ``y`` over ``x``, with words at the axes; ``polar`` when ``x`` is a heading [rad].

    ``plain`` (n,): the same without the effect, for comparison; None when that is zero.
    """

    x: Array
    y: Array
    x_label: str
    y_label: str
    title: str
    plain: Array | None = None
    polar: bool = False


def columns_of(place: str) -> tuple[str, ...]:
    """Return the columns (or degrees of freedom) a place names: ``"u+v"`` and ``"u+v@run"`` are ``u`` and ``v``."""
    return tuple(place.partition("@")[0].split("+"))


def concerns(place: str, run: str) -> bool:
    """Return whether an effect at *place* sits in *run*: ``"N@run"`` in that one only."""
    _, one, name = place.partition("@")
    return not one or name == run


class Effect:
    """One row of the table of effects. Class attributes say what it is, methods what it does; see the module's head.

    ``plain``: the sentence that a report begins with, for the owner of the boat. Words in braces are filled in:
    ``{craft}`` (boat or vehicle), ``{simulation}`` (the simulation, or a plain one), ``{motion}`` (turning, diving),
    ``{command}`` (throttle, rudder) and ``{signal}`` (heading, depth).
    ``shown_by``: which residual gives it away; ``mistaken_for``: slugs of what it is easily taken for;
    ``separated_by``: the manoeuvre that tells them apart.
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
    """Parameters least squares leaves alone: only chosen among :meth:`starts`, or learnt."""
    happens_at: ClassVar[tuple[str, ...]] = ()
    """Parameters that are moments of the run: a fit may end one oscillation too early or late."""
    yields_to: ClassVar[tuple[str, ...]] = ()
    """Slugs reported before this one if runs do not distinguish them: the more common causes."""
    form_of: ClassVar[tuple[str, ...]] = ()
    """Slugs of the same cause by a plainer law: where that holds too, it is named first, and both together."""
    is_structural: ClassVar[bool] = False
    """Whether a first model of such a craft merely leaves it out (order of the drag, coupling, speed, thrust curve,
    delay), where others are wrong with the craft, its surroundings or the record."""
    grows_with: ClassVar[tuple[str, ...]] = ()
    """Parameters that, taken times a factor together, make the effect that factor as large, nearly."""
    neutral: ClassVar[Mapping[str, float]] = MappingProxyType({})
    """Values at which those of ``grows_with`` have no effect, where that is not 0; they grow from there."""

    acts_on: ClassVar[frozenset[Stage]] = frozenset()
    """Its place in the chain; derived from the hooks that a class defines."""
    is_disturbance: ClassVar[bool] = False
    """Whether it is a disturbance, which no simulation predicts: :meth:`learn` estimates it from the residual."""
    is_rounding: ClassVar[bool] = False
    """What it leaves has heavy tails by construction; set by :meth:`normal`."""

    def __init_subclass__(cls) -> None:
        def defines(hook: str) -> bool:
            return getattr(cls, hook) is not getattr(Effect, hook)

        cls.acts_on = frozenset(stage for stage, hooks in HOOKS.items() if any(map(defines, hooks)))
        cls.is_disturbance, cls.is_rounding = defines("learn"), defines("normal")

    # -- where it may sit, and where a search for it begins

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the places where these runs could show it; none when they cannot."""
        raise NotImplementedError

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return a few start values, one of them near enough to any size that matters."""
        return ({},)

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return smallest and largest value per parameter."""
        return {}

    def constants(self, place: str, data: DataSummary) -> Mapping[str, float]:
        """Return numbers read from the runs once."""
        return {}

    def followers(self, effect: EffectInstance, data: DataSummary) -> tuple[EffectInstance, ...]:
        """Return what an effect that :attr:`happens_at` a time would be if it followed a recorded command instead."""
        return ()

    # -- what it does

    def retime(self, effect: EffectInstance, t: Array, start: float, *, inputs: bool) -> Array:
        """Return the craft's own time at the file's stamps *t*, of the inputs' or of the signals' columns."""
        return t

    def inputs(self, effect: EffectInstance) -> tuple[str, ...]:
        """Return inputs that :meth:`drive` adds (``payload``, or names that :meth:`derivatives` use)."""
        return ()

    def drive(self, effect: EffectInstance, drive: Drive) -> Drive:
        """Return what the actuators make of the commands."""
        return drive

    def derivatives(self, effect: EffectInstance) -> Mapping[str, float]:
        """Return forces as SNAME derivatives (:mod:`gcs_autotune.models.coupled.derivatives`), added to the base's."""
        return {}

    def observe(self, effect: EffectInstance, seen: Observed) -> Observed:
        """Return what the sensors make of the truth."""
        return seen

    def learn(self, effect: EffectInstance, left: Sequence[EffectResidual]) -> EffectInstance:
        """Return the values that what is left over speaks for. Only disturbances and faults of sensors."""
        return effect

    def judge(self, effect: EffectInstance, left: EffectResidual, columns: Array) -> tuple[Array, Array, float]:
        """Return the residual (n,) and its derivatives (n, k) as this disturbance leaves them, and a penalty.

        Samples the disturbance accounts for wholly become NaN. With m of n left, of mean square s^2 over all runs of
        the signal, ``m log(s^2) + penalty`` compares with ``n log(s^2)`` of the raw residual: both are minus twice the
        log-likelihood of all n samples, less ``n (1 + log(2 pi))``.
        """
        return left.error, columns, 0.0

    def normal(self, effect: EffectInstance, left: EffectResidual) -> Array:
        """Return the noise (n,) behind an error whose law this changes, on any scale, to test its tails."""
        raise NotImplementedError

    def uncertainty(self, effect: EffectInstance, left: Sequence[EffectResidual]) -> Mapping[str, float]:
        """Return standard errors of the values :meth:`learn` found; those of fitted ones come from the fit."""
        return {}

    # -- what is told of it

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve | None:
        """Return its picture."""
        return None

    def unit_of(self, name: str, place: str, data: DataSummary) -> str:
        """Return the unit of a parameter at a place."""
        unit = next(q.unit for q in self.parameters if q.name == name)
        first = columns_of(place)[0]
        return unit.replace(INPUT, data.inputs.get(first, "1")).replace(SIGNAL, data.signals.get(first, "1"))
