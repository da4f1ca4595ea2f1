"""Pictures to measurements: two laser dots to distance and angle. It needs OpenCV (``gcs-autotune[vision]``).

* ``pictures``: read pictures of a video, a camera or a folder; ``opencv``: OpenCV, imported on first use;
* ``dots``: find two laser dots; ``laser``: calibrate them, and compute distance and angle.
"""

from __future__ import annotations

from gcs_autotune.vision.dots import COLOURS, DotFinder, Dots
from gcs_autotune.vision.laser import (
    Calibration,
    LaserCurve,
    LaserModule,
    LaserReading,
    calibrate,
    calibrate_laser,
    laser_run,
    load_lasers,
    read_lasers,
    save_lasers,
)
from gcs_autotune.vision.pictures import Picture, is_live, pictures

__all__ = [
    "COLOURS",
    "Calibration",
    "DotFinder",
    "Dots",
    "LaserCurve",
    "LaserModule",
    "LaserReading",
    "Picture",
    "calibrate",
    "calibrate_laser",
    "is_live",
    "laser_run",
    "load_lasers",
    "pictures",
    "read_lasers",
    "save_lasers",
]
