"""Control laws of the supported autopilots: one file each, keyed by ``Axis.law``."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from gcs_autotune.design.laws.law import SKID, THROTTLE, Law, LoopMotion, LoopStart, Scenario, Settings
from gcs_autotune.design.laws.rover_heading import RoverHeading, alike
from gcs_autotune.design.laws.rover_speed import RoverSpeed
from gcs_autotune.design.laws.rover_steering import most_feed_forward
from gcs_autotune.design.laws.rover_yaw import RoverYaw
from gcs_autotune.design.laws.sub_depth import SubDepth
from gcs_autotune.design.laws.sub_heading import SubHeading
from gcs_autotune.design.laws.sub_tilt import SubTilt
from gcs_autotune.design.laws.sub_yaw import SubYaw
from gcs_autotune.models import SingleDof

__all__ = [
    "ALIKE",
    "CEILINGS",
    "LAWS",
    "OTHER_MODE",
    "SKID",
    "THROTTLE",
    "Law",
    "LoopMotion",
    "LoopStart",
    "Scenario",
    "Settings",
]

LAWS: Mapping[str, Law] = {
    law.name: law
    for law in (
        RoverHeading(),
        RoverYaw(),
        RoverSpeed(),
        SubHeading(),
        SubYaw(),
        SubDepth(),
        SubTilt("sub-roll", ("RLL", "R")),
        SubTilt("sub-pitch", ("PIT", "P")),
    )
}
"""Name in ``firmware.Axis.law`` -> control law."""

CEILINGS: Mapping[str, Callable[[SingleDof, Settings, float | None], Mapping[str, float]]] = {
    RoverHeading.name: most_feed_forward
}
"""Name of a law -> function that returns the largest useful gains for a model at a speed [m/s].

A law is present only if these gains are below the top of the documented range.
"""

_SHARED = ((RoverHeading.name, RoverYaw.name), (SubHeading.name, SubYaw.name))
OTHER_MODE: Mapping[str, str] = {one: other for pair in _SHARED for one, other in (pair, pair[::-1])}
"""Name of a law -> name of the law of another mode that uses the same gains."""

ALIKE: Mapping[str, Callable[[Settings, float], Mapping[str, float]]] = {RoverHeading.name: alike}
"""Name of a law -> function that returns gains with another feed-forward and nearly the same position step."""
