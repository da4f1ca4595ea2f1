"""Miskovic2010, table 3.1 (laser calibration) and section 7.6 (VideoRay's surge by distance to a wall)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.published.relay_tables import reading
from benchmarks.published.section import Row, Section, rows_of
from benchmarks.published.water import Relay, relay_run
from gcs_autotune.identify.relay.iso import estimate
from gcs_autotune.identify.relay.limit_cycle import find_cycles
from gcs_autotune.vision import LaserCurve, calibrate

__all__ = ["laser", "surge"]

TAPE = np.arange(10.0, 100.1, 5.0)
"""The calibration's distances [cm], Miskovic2010, 3.4."""


def laser(tables: Mapping[str, Any]) -> list[Section]:
    """Return the coefficients calibrated from pixels that the printed ones give for the printed distances."""
    rows: list[Row] = []
    for side in ("right", "left"):
        printed = tables["laser_calibration_table_3_1"][side]
        curve = LaserCurve(*printed)
        again = calibrate(np.array([curve.pixels(v) for v in TAPE]), TAPE)
        rows += rows_of(side, ("a", "b", "c", "d"), printed, (again.a, again.b, again.c, again.d))
    basis = "round trip: the calibration pairs are not printed, so they are made from the printed curve"
    return [Section("Table 3.1: laser calibration", basis, tuple(rows), 0.8)]


def surge(tables: Mapping[str, Any]) -> list[Section]:
    """Return the limit cycle of the craft that IS-O identifies from the printed one: both must agree.

    Miskovic2010 prints neither C nor the parameters, so they are per unit of C.
    """
    table = tables["surge_iso_videoray_7_6"]
    x_s, X_m, omega = table["x_a_star_cm"], table["X_m_cm"], table["omega_rad_s"]
    got = estimate(reading(1.0, x_s / 100.0, X_m / 100.0, omega))
    run = relay_run((got.alpha, 0.0, got.beta_quadratic, 0.0), Relay(1.0, x_s / 100.0), 300.0, "surge", dt=0.01, h=0.01)
    (cycle,) = find_cycles(run, "surge")
    rows = rows_of("surge", ("X_m [cm]", "omega [rad/s]"), (X_m, omega), (100.0 * cycle.X_m, cycle.omega))
    basis = f"simulated with the result of IS-O: alpha {got.alpha:.3g}, beta_uu {got.beta_quadratic:.3g} per unit of C"
    return [Section("Section 7.6: VideoRay surge by distance", basis, tuple(rows), 5.0)]
