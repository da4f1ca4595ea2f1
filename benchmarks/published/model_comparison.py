"""Miskovic2010, 7.3.3 and 7.4.3: models by self-oscillation beside the conventional model of the same craft.

The text prints bounds, read from figures 7.4 to 7.7 and 7.12 to 7.15. The models are those that tables 7.9 and 7.11
print, the conventional ones are the means of tables 7.8 (least squares) and 7.10 (step responses). Sums of absolute
errors, (7.13) and (7.14), need the measured runs, which are not published.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.published.section import Row, Section
from benchmarks.published.step_table import MEANS
from gcs_autotune.experiments import compare_dof
from gcs_autotune.models import SingleDof

__all__ = ["beside_least_squares", "beside_steps"]

LEAST_SQUARES = (5.26e-4, 25.95e-6)
"""Means of table 7.8: alpha_r [N m s^2/deg], beta_rr [N m s^2/deg^2]."""
SAMPLE = 0.1
"""Interval between samples [s]."""


def beside_least_squares(tables: Mapping[str, Any]) -> list[Section]:
    """VideoRay, 7.3.3."""
    rows = tables["videoray_iso_table_7_9"]["rows"]
    models = [(row[5] * 1e-4, row[7] * 1e-6) for row in rows]
    inertia, _, steady, rise = _apart(models, LEAST_SQUARES, 0.171, 0.0221)
    samples = [r / SAMPLE for r in rise]
    return [
        Section(
            "7.3.3: VideoRay, self-oscillation beside least squares",
            "computed from the printed parameters; largest of 15 experiments",
            (
                Row("alpha_r apart [%]", 25.0, max(inertia)),
                Row("steady rate apart at 0.171 N m [deg/s]", 20.0, max(steady)),
                Row("T_N apart by > 3 samples [runs]", 1.0, float(sum(s > 3.0 for s in samples))),
            ),
            below=True,
        )
    ]


def beside_steps(tables: Mapping[str, Any]) -> list[Section]:
    """AutoMarine, 7.4.3."""
    rows = tables["automarine_iso_table_7_11"]["rows"]
    models = [(row[5] * 1e-4, row[7] * 1e-6) for row in rows]
    inertia, drag, steady, rise = _apart(models, (MEANS["alpha_r"] * 1e-4, MEANS["beta_rr"] * 1e-6), 0.0646, 0.034)
    return [
        Section(
            "7.4.3: AutoMarine, self-oscillation beside step responses",
            "computed from the printed parameters; largest of 32 experiments. The text states about 30 % of alpha_r",
            (
                Row("alpha_r apart [%]", 30.0, max(inertia), counts=False),
                Row("beta_rr apart [%]", 25.0, max(drag)),
                Row("steady rate apart at 0.0646 N m [deg/s]", 8.0, max(steady)),
                Row("T_N apart [s]", 0.35, max(rise)),
            ),
            below=True,
        )
    ]


def _apart(
    models: Sequence[tuple[float, float]], reference: tuple[float, float], largest: float, smallest: float
) -> tuple[list[float], list[float], list[float], list[float]]:
    """Return the differences of *models* (alpha_r, beta_rr) from *reference*: both parameters [%], (7.7) [deg/s] and
    (7.11) [s]."""
    found = [compare_dof((_model(one), _model(reference)), largest, smallest, interval=SAMPLE) for one in models]
    shares = [[100.0 * abs(one[i] / reference[i] - 1.0) for one in models] for i in (0, 1)]
    return shares[0], shares[1], [math.degrees(d.steady_apart) for d in found], [d.rise_apart for d in found]


def _model(parameters: tuple[float, float]) -> SingleDof:
    alpha, beta = parameters
    degrees = math.degrees(1.0)
    return SingleDof("yaw", "N m", alpha * degrees, 0.0, beta * degrees**2)
