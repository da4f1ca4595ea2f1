"""The table of effects: everything that this package can identify as wrong in a simulation.

To add an effect, add one class, and one line in this module. In another package, add one class, and one line in its
``pyproject.toml`` (entry points of the group :data:`GROUP`). The order of the table is that in which effects act on a
command, a motion and a measurement. The order also decides which of two equally likely effects is reported. Errors of
the data come first, because they can look like physical effects.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from gcs_autotune.effects.actuator import (
    AsymmetricThrust,
    Backlash,
    DeadZone,
    QuadraticActuator,
    RudderStall,
    Saturation,
)
from gcs_autotune.effects.actuator_dynamics import ActuatorLag, GainDrift, InputDelay, RateLimit
from gcs_autotune.effects.bank_suction import BankSuction
from gcs_autotune.effects.changing_current import ChangingCurrent
from gcs_autotune.effects.command_coupling import CommandCoupling
from gcs_autotune.effects.data_errors import ChannelSwap, SignError, TimeOffset, TimeScale, UnitError
from gcs_autotune.effects.effect import Effect, EffectInstance
from gcs_autotune.effects.environment import InputBias, SteadyCurrent, TetherPull, WindMoment
from gcs_autotune.effects.hydrodynamics import (
    CoriolisCoupling,
    GroundEffect,
    LinearDrag,
    MassChange,
    NetBuoyancy,
    QuadraticDrag,
    SwayYawCoupling,
)
from gcs_autotune.effects.inflow import AdvanceSpeedLoss, PropellerWash, SpeedDependentSteering
from gcs_autotune.effects.sensor import CompassDeviation, GyroBias, MeasurementDelay, SensorPosition
from gcs_autotune.effects.sensor_noise import Outliers, Quantisation
from gcs_autotune.effects.shallow_water import ShallowWater
from gcs_autotune.effects.summary import DataSummary
from gcs_autotune.effects.tether_line import TetherLine
from gcs_autotune.effects.velocity_products import MunkMoment, SpeedDamping, SwayMoment, VelocityProduct
from gcs_autotune.effects.wave_disturbance import WaveDisturbance
from gcs_autotune.effects.wind_load import WindLoad
from gcs_autotune.errors import UsageError
from gcs_autotune.models import Form
from gcs_autotune.rounding import HALF_WIDTH
from gcs_autotune.sname import DOFS, SIGNALS

__all__ = [
    "CRAFT",
    "EFFECTS",
    "GROUP",
    "effect_at",
    "effect_words",
    "limit_sentence",
    "parameter_words",
    "usual_bounds",
]


GROUP = "gcs_autotune.effects"
"""Entry-point group for effects of other packages: ``[project.entry-points."gcs_autotune.effects"]``."""

OURS: tuple[Effect, ...] = (
    TimeScale(),
    TimeOffset(),
    UnitError(),
    SignError(),
    ChannelSwap(),
    InputDelay(),
    Saturation(),
    RateLimit(),
    ActuatorLag(),
    Backlash(),
    DeadZone(),
    QuadraticActuator(),
    RudderStall(),
    AsymmetricThrust(),
    CommandCoupling(),
    GainDrift(),
    SpeedDependentSteering(),
    PropellerWash(),
    AdvanceSpeedLoss(),
    LinearDrag(),
    QuadraticDrag(),
    CoriolisCoupling(),
    SwayYawCoupling(),
    SwayMoment(),
    SpeedDamping(),
    MunkMoment(),
    VelocityProduct(),
    MassChange(),
    NetBuoyancy(),
    GroundEffect(),
    InputBias(),
    SteadyCurrent(),
    ChangingCurrent(),
    WindMoment(),
    WindLoad(),
    WaveDisturbance(),
    TetherPull(),
    TetherLine(),
    ShallowWater(),
    BankSuction(),
    SensorPosition(),
    CompassDeviation(),
    GyroBias(),
    MeasurementDelay(),
    Quantisation(),
    Outliers(),
)


class Effects(Mapping[str, Effect]):
    """Table of effects by slug: the built-in effects, then those of other packages, which are loaded on first use."""

    def __init__(self) -> None:
        self._rows: dict[str, Effect] | None = None

    def _table(self) -> dict[str, Effect]:
        if self._rows is None:
            self._rows = {e.slug: e for e in OURS}
            for effect in _offered():
                self._rows.setdefault(effect.slug, effect)
        return self._rows

    def __getitem__(self, slug: str) -> Effect:
        return self._table()[slug]

    def __iter__(self) -> Iterator[str]:
        return iter(self._table())

    def __len__(self) -> int:
        return len(self._table())


def _offered() -> Iterator[Effect]:
    """Yield the effects of other packages.

    Raises
    ------
    UsageError
        An entry point cannot be loaded, or is not an effect.
    """
    from importlib.metadata import entry_points  # slow to import, and no other module here needs it

    for point in entry_points(group=GROUP):
        try:
            effect = point.load()()
        except (ImportError, AttributeError, TypeError) as error:
            raise UsageError(f"the effect '{point.name}' ({point.value}) cannot be loaded: {error}") from error
        if not isinstance(effect, Effect):
            raise UsageError(
                f"the entry point '{point.name}' ({point.value}) does not produce a gcs_autotune.effects.Effect. "
                "Correct it"
            )
        yield effect


EFFECTS = Effects()
"""Slug -> effect, for all known effects."""


def effect_words(slug: str) -> str:
    """Return the slug of an effect as words: ``dead-zone`` is ``dead zone``, ``N_u`` is ``velocity product (N_u)``."""
    if slug in EFFECTS and EFFECTS[slug].words:
        return EFFECTS[slug].words
    return slug.replace("-", " ") if slug.islower() else f"velocity product ({slug})"


def limit_sentence(limit: str) -> str:
    """Return a sentence on an output *limit*, as text, above which the force of a model is constant."""
    return f"Above {limit} of the autopilot's full output, the force of the model stays constant"


def effect_at(effect: EffectInstance) -> str:
    """Return an effect and its place as words: ``dead zone (N)``."""
    return f"{effect_words(effect.slug)} ({effect.place})"


def parameter_words(label: str) -> str:
    """Return a parameter's label as words: ``dead-zone@N.width`` is ``width of the dead zone (N)``. A name of the base
    model, such as ``N_r``, stays as it is.
    """
    slug, at, rest = label.partition("@")
    place, _, name = rest.rpartition(".")
    return f"{name} of the {effect_words(slug)} ({place})" if at else label


CRAFT = "largest command 1, time constant 1 s, signals of standard deviation 1, one run of 60 s at 10 Hz"

DURATION, INTERVAL, PACE = 60.0, 0.1, 1.0
NOISE = 0.01
_UNITS = {**dict.fromkeys("XYZ", "N"), "N": "N m", "delta": "rad"}


def may_be_none(effect: EffectInstance, std: Mapping[str, float]) -> bool:
    """Return whether the 95 % intervals of an effect's numbers include the case of no effect.

    std : standard errors of the fitted numbers. A standard error that is not finite means that the number is unknown.
    """
    entry = EFFECTS[effect.slug]
    growing = set(entry.grows_with) & set(effect.values)
    if not growing or set(std) & growing != growing:
        return False
    return not any(abs(effect[n] - entry.neutral.get(n, 0.0)) > HALF_WIDTH * std[n] for n in growing)


def usual_bounds(effect: Effect) -> Mapping[str, tuple[float, float]]:
    """Return parameter -> (smallest, largest) of *effect* at its first place on a reference craft.

    Infinite means no bound.

    Raises
    ------
    LookupError
        None of the reference craft has a place for the effect.
    """
    for data in _SCENES:
        for place in effect.places(data):
            bounds = effect.bounds(place, data)
            return {q.name: bounds.get(q.name, (-float("inf"), float("inf"))) for q in effect.parameters}
    raise LookupError(f"{effect.slug} does not apply to any reference craft. Add a craft to which it applies")


def _data_summary(
    dofs: tuple[str, ...], drives: Mapping[str, str], signals: tuple[str, ...], *, drag: bool = True
) -> DataSummary:
    inputs = {channel: ((DOFS[dof].force, 1.0),) for channel, dof in drives.items()}
    base: dict[str, float] = {}
    for dof in dofs:
        d = DOFS[dof]
        base |= {f"{d.force}_{d.velocity}dot": -1.0} | ({f"{d.force}_{d.velocity}": -1.0 / PACE} if drag else {})
    form = Form("plain", "a craft that is easy to scale", dofs, tuple(base), {}, inputs, coriolis=False)
    return DataSummary(
        form=form,
        inputs={c: _UNITS[c] for c in drives},
        signals={s: SIGNALS[s][0] for s in signals},
        amplitude=dict.fromkeys(drives, 1.0),
        spread=dict.fromkeys(signals, 1.0),
        level=dict.fromkeys(signals, NOISE),
        channels=frozenset((*drives, *signals)),
        interval=INTERVAL,
        time_constant=PACE,
        duration=DURATION,
        quantum=dict.fromkeys(signals, 0.0),
        extent=dict.fromkeys((*drives, *signals), (-1.0, 1.0)),
        rms=dict.fromkeys((*drives, *signals), 1.0),
        base=base,
        runs=("run1", "run2"),
    )


_SCENES = (
    _data_summary(
        ("surge", "sway", "heave", "yaw"),
        {"X": "surge", "Y": "sway", "Z": "heave", "N": "yaw"},
        ("u", "v", "w", "r", "psi", "x", "y", "z"),
    ),
    _data_summary(("yaw",), {"delta": "yaw"}, ("r", "psi", "u", "v")),
    _data_summary(("yaw",), {"N": "yaw"}, ("r", "psi"), drag=False),
    _data_summary(("yaw",), {"N": "yaw"}, ("r", "psi", "u", "v")),
)
"""Reference craft for the bounds of effects.

In order: all degrees of freedom without a rudder; yaw by a rudder; no linear drag; flow measured but not simulated.
"""
