"""Published methods reproduced: held by tests and by ``benchmarks.published``, needed by no command.

================  ==========================================================================================
correlation       which terms a model needs, by correlation (Miskovic2007, III)
parameter_tables  a table of identified parameters, a row per experiment: do they describe one craft?
laser             distance to a surface from two laser dots (Miskovic2010, 3.4)
twin_thrusters    surge force and yaw moment of two thrusters to commands and back (ZhaoUSV)
================  ==========================================================================================
"""

from __future__ import annotations

from gcs_autotune.research.correlation import Correlation, correlations, structure_by_correlation
from gcs_autotune.research.laser import LaserCurve, angle_to_surface, calibrate, distance_to_surface
from gcs_autotune.research.parameter_tables import ParameterTable, TableFinding, diagnose_table
from gcs_autotune.research.twin_thrusters import TwinCommand, TwinThrusters

__all__ = [
    "Correlation",
    "LaserCurve",
    "ParameterTable",
    "TableFinding",
    "TwinCommand",
    "TwinThrusters",
    "angle_to_surface",
    "calibrate",
    "correlations",
    "diagnose_table",
    "distance_to_surface",
    "structure_by_correlation",
]
