"""Navigation solution of a log: position, attitude and velocity at the centre of gravity, with their covariance.

=========  ======================================================================
sensors    table of the sensors, and the samples of a log
solution   repeated passes, constants, noise levels, centre of gravity
log_file   a whole file: runs for ``identify``, and beside the autopilot's estimator
kernel     the error-state Kalman filter and its smoother, compiled
=========  ======================================================================
"""

from __future__ import annotations

from gcs_autotune.navigation.log_file import NavigatedLog, navigate_file
from gcs_autotune.navigation.sensors import Readings, readings_of, store_of
from gcs_autotune.navigation.solution import Constant, Mounting, Navigation, SensorNoise, navigate

__all__ = [
    "Constant",
    "Mounting",
    "NavigatedLog",
    "Navigation",
    "Readings",
    "SensorNoise",
    "navigate",
    "navigate_file",
    "readings_of",
    "store_of",
]
