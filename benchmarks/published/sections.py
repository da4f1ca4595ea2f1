"""The sections: key in the JSON (or example) -> function that computes it."""

from __future__ import annotations

from collections.abc import Mapping

from benchmarks.published.charlie import charlie
from benchmarks.published.coupled_horizontal import videoray_horizontal
from benchmarks.published.examples import delay_and_sampling, falcon, nonlinear_yaw
from benchmarks.published.filters import ekf_vs_least_squares
from benchmarks.published.laser_and_surge import laser, surge
from benchmarks.published.model_comparison import beside_least_squares, beside_steps
from benchmarks.published.relay_tables import automarine, videoray
from benchmarks.published.section import Compute
from benchmarks.published.step_table import automarine_steps
from benchmarks.published.tugboat import tugboat

__all__ = ["SECTIONS"]

SECTIONS: Mapping[str, Compute] = {
    "videoray_iso_table_7_9": videoray,
    "automarine_iso_table_7_11": automarine,
    "automarine_step_table_7_10": automarine_steps,
    "examples_6_2_and_6_3": delay_and_sampling,
    "falcon_seed_002": falcon,
    "nonlinear_yaw_tables_7_5_7_6": nonlinear_yaw,
    "laser_calibration_table_3_1": laser,
    "surge_iso_videoray_7_6": surge,
    "charlie_ls_table_7_12": charlie,
    "videoray_coupled_seed_000": videoray_horizontal,
    "model_comparison_7_3_3": beside_least_squares,
    "model_comparison_7_4_3": beside_steps,
    "tugboat_seed_004_table_1": tugboat,
    "ekf_vs_ls_seed_001_table_3_percent": ekf_vs_least_squares,
}
"""Name -> function."""
