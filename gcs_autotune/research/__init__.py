"""Reproductions of published methods, checked by tests and by ``benchmarks.published``; no command uses them.

================  ==========================================================================================
correlation       selection of model terms by correlation (Miskovic2007, III)
parameter_tables  test whether a table of identified parameters, one row per experiment, describes one craft
twin_thrusters    surge force and yaw moment of two thrusters to commands and back (ZhaoUSV)
================  ==========================================================================================
"""

from __future__ import annotations

from gcs_autotune.research.correlation import Correlation, correlations, structure_by_correlation
from gcs_autotune.research.parameter_tables import ParameterTable, TableFinding, diagnose_table
from gcs_autotune.research.twin_thrusters import TwinCommand, TwinThrusters

__all__ = [
    "Correlation",
    "ParameterTable",
    "TableFinding",
    "TwinCommand",
    "TwinThrusters",
    "correlations",
    "diagnose_table",
    "structure_by_correlation",
]
