"""Thrusters: from pull tests and open-water tests to force maps, and back from a wanted force to a command.

``pull_test`` reads the table, ``mapping`` fits a :class:`ThrusterMap` to it and decides its ``structure``;
``propeller`` fits K_T(J), K_Q(J) and C_n, C_v, C_T; ``twin`` shares surge force and yaw moment between two thrusters.
"""

from __future__ import annotations

from gcs_autotune.identify.thrusters.mapping import MapCandidate, ThrusterFit, fit_thruster
from gcs_autotune.identify.thrusters.propeller import (
    OpenWater,
    OpenWaterTest,
    PropellerFit,
    fit_bilinear,
    fit_open_water,
)
from gcs_autotune.identify.thrusters.pull_test import PullTest, read_columns, read_open_water, read_pull_test
from gcs_autotune.identify.thrusters.structure import MapStructure
from gcs_autotune.identify.thrusters.thruster_map import ThrusterMap
from gcs_autotune.identify.thrusters.twin import TwinCommand, TwinThrusters

__all__ = [
    "MapCandidate",
    "MapStructure",
    "OpenWater",
    "OpenWaterTest",
    "PropellerFit",
    "PullTest",
    "ThrusterFit",
    "ThrusterMap",
    "TwinCommand",
    "TwinThrusters",
    "fit_bilinear",
    "fit_open_water",
    "fit_thruster",
    "read_columns",
    "read_open_water",
    "read_pull_test",
]
