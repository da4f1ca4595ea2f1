"""The available effects: slug -> class. To add one, add a class and a line here."""

from __future__ import annotations

import difflib
from collections.abc import Mapping

from gcs_autotune_files import Refused, number
from sitl.effects.actuator import (
    AdvanceSpeedLoss,
    AsymmetricThrust,
    CommandCoupling,
    DeadZone,
    GainDrift,
    PropellerWash,
    QuadraticActuator,
    RudderStall,
    Saturation,
    SpeedDependentSteering,
)
from sitl.effects.bank_suction import BankSuction
from sitl.effects.bookkeeping import (
    ChannelSwap,
    SignError,
    TimeOffset,
    TimeScale,
    UnitError,
)
from sitl.effects.changing_current import ChangingCurrent
from sitl.effects.coupling import (
    CoriolisCoupling,
    MunkMoment,
    SpeedDamping,
    SwayMoment,
    SwayYawCoupling,
    VelocityProduct,
)
from sitl.effects.effect import BadEffect, HiddenEffect
from sitl.effects.environment import (
    InputBias,
    SteadyCurrent,
    TetherPull,
    WaveDisturbance,
    WindMoment,
)
from sitl.effects.hydrodynamics import (
    GroundEffect,
    LinearDrag,
    MassChange,
    NetBuoyancy,
    QuadraticDrag,
)
from sitl.effects.memory import ActuatorLag, Backlash, InputDelay, RateLimit
from sitl.effects.sensor import (
    CompassDeviation,
    GyroBias,
    MeasurementDelay,
    Outliers,
    Quantisation,
    SensorPosition,
)
from sitl.effects.shallow_water import ShallowWater
from sitl.effects.tether_line import TetherLine
from sitl.effects.wind_load import WindLoad

__all__ = ["EFFECTS", "SURROUNDINGS", "make_effect", "parse_effect"]

_CLASSES: tuple[type[HiddenEffect], ...] = (
    TimeScale,
    TimeOffset,
    UnitError,
    SignError,
    ChannelSwap,
    InputDelay,
    Saturation,
    RateLimit,
    ActuatorLag,
    Backlash,
    DeadZone,
    QuadraticActuator,
    RudderStall,
    AsymmetricThrust,
    CommandCoupling,
    GainDrift,
    SpeedDependentSteering,
    PropellerWash,
    AdvanceSpeedLoss,
    LinearDrag,
    QuadraticDrag,
    CoriolisCoupling,
    SwayYawCoupling,
    SwayMoment,
    SpeedDamping,
    MunkMoment,
    VelocityProduct,
    MassChange,
    NetBuoyancy,
    GroundEffect,
    InputBias,
    SteadyCurrent,
    ChangingCurrent,
    WindMoment,
    WindLoad,
    WaveDisturbance,
    TetherPull,
    TetherLine,
    ShallowWater,
    BankSuction,
    SensorPosition,
    CompassDeviation,
    GyroBias,
    MeasurementDelay,
    Quantisation,
    Outliers,
)

EFFECTS: Mapping[str, type[HiddenEffect]] = {kind.slug: kind for kind in _CLASSES}

SURROUNDINGS: Mapping[str, str] = {
    "current": "changing-current",
    "wind": "wind-load",
    "tether": "tether-line",
    "shallows": "shallow-water",
    "bank": "bank-suction",
}
"""Heading of a vehicle file -> slug of the effect of the surroundings whose parameters it has."""


def make_effect(slug: str, place: str = "", values: Mapping[str, float] | None = None) -> HiddenEffect:
    """Return the effect called *slug* at *place*; empty: the default place.

    Raises
    ------
    BadEffect
        There is no such effect or parameter (the message states the nearest name), or a parameter is missing.
    """
    if slug not in EFFECTS:
        near = difflib.get_close_matches(slug, EFFECTS, n=3, cutoff=0.5)
        hint = f"did you mean {' or '.join(near)}?" if near else "see --list-effects"
        raise BadEffect(f"unknown effect '{slug}'; {hint}")
    return EFFECTS[slug](place, **(values or {}))


def parse_effect(text: str) -> HiddenEffect:
    """Return the effect that *text* describes in the form ``slug[@place][.parameter=value[,parameter=value ...]]``.

    Raises
    ------
    BadEffect
        The text has another form, or :func:`make_effect` does not accept it.
    """
    head, _, tail = text.partition(".")
    slug, _, place = head.partition("@")
    values: dict[str, float] = {}
    for pair in tail.split(",") if tail else ():
        name, _, value = pair.partition("=")
        try:
            values[name.strip().removeprefix(f"{slug}.")] = number(value)
        except Refused as error:
            raise BadEffect(f"--effect {text}: {error}. Use SLUG.PARAMETER=NUMBER") from error
    return make_effect(slug.strip(), place.strip(), values)
