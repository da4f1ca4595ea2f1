"""Identify nonlinear actuators together with the craft.

They may be weak for small commands, inactive near neutral, or weaker in one direction.

=================  =================================================================================
thrust_curve       an ROV's thrusters, from oscillations of two sizes and a step
slow_actuator      a servo with a limited rate or thrust that lags, from oscillations
surge              a boat's throttle, inertia and drag, from throttle steps
levels             a boat's thrust at each throttle level, ahead and astern
asymmetric_thrust  doubt about thrust that is weaker in one direction
=================  =================================================================================
"""

from __future__ import annotations

from gcs_autotune.identify.coupled.one_axis import with_actuator
from gcs_autotune.identify.thrust.asymmetric_thrust import with_doubt_of_thrust
from gcs_autotune.identify.thrust.levels import LevelForces, level_forces
from gcs_autotune.identify.thrust.slow_actuator import describe_slow_actuator, fit_slow_actuator
from gcs_autotune.identify.thrust.surge import CURVE, fit_surge, set_on_the_way_back, square_of
from gcs_autotune.identify.thrust.thrust_curve import (
    DEAD_ZONE,
    QUADRATIC,
    describe_thrust_curve,
    effect_number,
    either_kind,
    fit_thrust_curve,
    fit_with_actuator,
    with_doubt_of_kind,
    with_thrust_curve,
)

__all__ = [
    "CURVE",
    "DEAD_ZONE",
    "QUADRATIC",
    "LevelForces",
    "describe_slow_actuator",
    "describe_thrust_curve",
    "effect_number",
    "either_kind",
    "fit_slow_actuator",
    "fit_surge",
    "fit_thrust_curve",
    "fit_with_actuator",
    "level_forces",
    "set_on_the_way_back",
    "square_of",
    "with_actuator",
    "with_doubt_of_kind",
    "with_doubt_of_thrust",
    "with_thrust_curve",
]
