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
from gcs_autotune.effects.channel_swap import ChannelSwap
from gcs_autotune.effects.compass_deviation import CompassDeviation
from gcs_autotune.effects.coriolis_coupling import CoriolisCoupling
from gcs_autotune.effects.dead_zone import DeadZone
from gcs_autotune.effects.effect import Effect
from gcs_autotune.effects.gain_drift import GainDrift
from gcs_autotune.effects.ground_effect import GroundEffect
from gcs_autotune.effects.gyro_bias import GyroBias
from gcs_autotune.effects.input_bias import InputBias
from gcs_autotune.effects.input_delay import InputDelay
from gcs_autotune.effects.linear_drag import LinearDrag
from gcs_autotune.effects.mass_change import MassChange
from gcs_autotune.effects.measurement_delay import MeasurementDelay
from gcs_autotune.effects.net_buoyancy import NetBuoyancy
from gcs_autotune.effects.outliers import Outliers
from gcs_autotune.effects.quadratic_actuator import QuadraticActuator
from gcs_autotune.effects.quadratic_drag import QuadraticDrag
from gcs_autotune.effects.quantisation import Quantisation
from gcs_autotune.effects.rate_limit import RateLimit
from gcs_autotune.effects.rudder_stall import RudderStall
from gcs_autotune.effects.saturation import Saturation
from gcs_autotune.effects.sign_error import SignError
from gcs_autotune.effects.speed_dependent_steering import SpeedDependentSteering
from gcs_autotune.effects.steady_current import SteadyCurrent
from gcs_autotune.effects.sway_yaw_coupling import SwayYawCoupling
from gcs_autotune.effects.tether_pull import TetherPull
from gcs_autotune.effects.time_offset import TimeOffset
from gcs_autotune.effects.time_scale import TimeScale
from gcs_autotune.effects.unit_error import UnitError
from gcs_autotune.effects.wave_disturbance import WaveDisturbance
from gcs_autotune.effects.wind_moment import WindMoment

__all__ = ["BOOK"]

BOOK: Mapping[str, Effect] = {
    e.slug: e
    for e in (
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
        GainDrift(),
        SpeedDependentSteering(),
        AdvanceSpeedLoss(),
        LinearDrag(),
        QuadraticDrag(),
        CoriolisCoupling(),
        SwayYawCoupling(),
        MassChange(),
        NetBuoyancy(),
        GroundEffect(),
        InputBias(),
        SteadyCurrent(),
        WindMoment(),
        WaveDisturbance(),
        TetherPull(),
        CompassDeviation(),
        GyroBias(),
        MeasurementDelay(),
        Quantisation(),
        Outliers(),
    )
}
"""Slug -> effect."""
