"""Thrusters: fit force maps to pull tests and open-water tests, and convert a required force to a command.

``pull_test`` reads the table, ``map_fit`` fits a :class:`ThrusterMap` to it and selects its structure. ``propeller``
fits K_T(J), K_Q(J) and C_n, C_v, C_T. ``twin_fit`` fits two equal thrusters. ``twin_thrusters`` converts surge force
and yaw moment to their commands.
"""

from __future__ import annotations

from gcs_autotune.thrusters.map_fit import MapCandidate, ThrusterFit, fit_thruster
from gcs_autotune.thrusters.propeller import (
    OpenWater,
    OpenWaterTest,
    PropellerFit,
    fit_bilinear,
    fit_open_water,
)
from gcs_autotune.thrusters.pull_test import (
    PullTest,
    pulls_from_log,
    read_columns,
    read_open_water,
    read_pull_test,
    write_pulls,
)
from gcs_autotune.thrusters.thruster_map import MapStructure, ThrusterMap
from gcs_autotune.thrusters.twin_fit import TwinFit, TwinTest, fit_twin, has_two_commands, read_twin_test
from gcs_autotune.thrusters.twin_thrusters import TwinCommand, TwinThrusters

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
    "TwinFit",
    "TwinTest",
    "TwinThrusters",
    "fit_bilinear",
    "fit_open_water",
    "fit_thruster",
    "fit_twin",
    "has_two_commands",
    "pulls_from_log",
    "read_columns",
    "read_open_water",
    "read_pull_test",
    "read_twin_test",
    "write_pulls",
]
