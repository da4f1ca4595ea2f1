"""Thrusters: fit force maps to pull tests and open-water tests, and convert a required force to a command.

``pull_test`` reads the table, ``map_fit`` fits a :class:`ThrusterMap` to it and selects its structure. ``propeller``
fits K_T(J), K_Q(J) and C_n, C_v, C_T.
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

__all__ = [
    "MapCandidate",
    "MapStructure",
    "OpenWater",
    "OpenWaterTest",
    "PropellerFit",
    "PullTest",
    "ThrusterFit",
    "ThrusterMap",
    "fit_bilinear",
    "fit_open_water",
    "fit_thruster",
    "pulls_from_log",
    "read_columns",
    "read_open_water",
    "read_pull_test",
    "write_pulls",
]
