"""The laser distance module: Miskovic2010, eq. (3.7)-(3.9) and Table 3.1."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gcs_autotune.errors import NotInformative
from gcs_autotune.vision import LaserCurve, calibrate

TAPE = np.arange(10.0, 100.1, 5.0)
"""Distances of the calibration [cm], Miskovic2010, 3.4."""


@pytest.mark.parametrize("side", ["right", "left"])
def test_table_3_1_is_reproduced_from_its_calibration_points(side: str, published: dict[str, Any]) -> None:
    """Miskovic2010 prints the coefficients only; its 19 distances and whole pixels are enough to find them again."""
    printed = LaserCurve(*published["laser_calibration_table_3_1"][side])
    pixels = np.array([printed.pixels(v) for v in TAPE])
    assert printed.length(pixels) == pytest.approx(TAPE)
    again = calibrate(pixels, TAPE)
    assert (again.a, again.b, again.c, again.d) == pytest.approx((printed.a, printed.b, printed.c, printed.d), rel=1e-4)
    rounded = calibrate(np.round(pixels), TAPE)
    assert rounded.length(pixels) == pytest.approx(TAPE, abs=1.5)
    assert (rounded.c, rounded.d) == pytest.approx((printed.c, printed.d), rel=0.1)


def test_distances_outside_the_curve_and_too_few_points_are_rejected() -> None:
    curve = LaserCurve(230.2, -0.03876, 83.3, -0.007234)
    with pytest.raises(NotInformative, match="outside"):
        curve.pixels(400.0)
    with pytest.raises(NotInformative, match="five"):
        calibrate([1.0, 2.0, 3.0], [30.0, 20.0, 10.0])
