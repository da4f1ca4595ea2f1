"""The book of effects: everything a simulation may get wrong that this package knows by name.

Adding one is one file and one line here. The order is that in which effects act on a command, a motion and a
measurement, and that in which equals are named; bookkeeping comes first, because it mimics physics.
"""

from __future__ import annotations

from collections.abc import Mapping

from gcs_autotune.effects.actuator_lag import ActuatorLag
from gcs_autotune.effects.advance_speed_loss import AdvanceSpeedLoss
from gcs_autotune.effects.asymmetric_thrust import AsymmetricThrust
from gcs_autotune.effects.backlash import Backlash
from gcs_autotune.effects.compass_deviation import CompassDeviation
from gcs_autotune.effects.dead_zone import DeadZone
from gcs_autotune.effects.effect import Effect
from gcs_autotune.effects.gain_drift import GainDrift
from gcs_autotune.effects.input_bias import InputBias
from gcs_autotune.effects.input_delay import InputDelay
from gcs_autotune.effects.quadratic_actuator import QuadraticActuator
from gcs_autotune.effects.rate_limit import RateLimit
from gcs_autotune.effects.rudder_stall import RudderStall
from gcs_autotune.effects.saturation import Saturation
from gcs_autotune.effects.speed_dependent_steering import SpeedDependentSteering

__all__ = ["BOOK"]

BOOK: Mapping[str, Effect] = {
    e.slug: e
    for e in (
        InputDelay(),
        Saturation(),
        RateLimit(),
        ActuatorLag(),
        Backlash(),
        DeadZone(),
        QuadraticActuator(),
        RudderStall(),
        AsymmetricThrust(),
        GainDrift(),
        SpeedDependentSteering(),
        AdvanceSpeedLoss(),
        InputBias(),
        CompassDeviation(),
    )
}
"""Slug -> effect."""
