"""Pictures to measurements: two laser dots to a distance, a marker seen from above to a run. It needs OpenCV.

* ``pictures``: read pictures of a video, a camera or a folder; ``opencv``: OpenCV, imported on first use;
* ``dots``: find two laser dots; ``laser``: calibrate them, and compute distance and angle;
* ``camera``: pixels to metres on the floor; ``marker``: find a red line or an AprilTag; ``track``: a video and a log to
  a run.
"""

from __future__ import annotations

from gcs_autotune.vision.camera import FloorCamera, calibrate_camera, load_camera, save_camera
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
from gcs_autotune.vision.marker import MARKERS, Seen
from gcs_autotune.vision.pictures import Picture, is_live, pictures
from gcs_autotune.vision.track import Track, Tracked, clock_offset, joined, track

__all__ = [
    "COLOURS",
    "MARKERS",
    "Calibration",
    "DotFinder",
    "Dots",
    "FloorCamera",
    "LaserCurve",
    "LaserModule",
    "LaserReading",
    "Picture",
    "Seen",
    "Track",
    "Tracked",
    "calibrate",
    "calibrate_camera",
    "calibrate_laser",
    "clock_offset",
    "is_live",
    "joined",
    "laser_run",
    "load_camera",
    "load_lasers",
    "pictures",
    "read_lasers",
    "save_camera",
    "save_lasers",
    "track",
]
