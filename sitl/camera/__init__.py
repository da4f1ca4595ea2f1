"""Pictures of simulated cameras: two laser dots on a wall, and a craft in a pool seen from above.

It uses NumPy only and shares no code with the reader of pictures. ``python -m sitl.camera`` writes folders of pictures.
"""

from __future__ import annotations

from sitl.camera.dive import BOARDS, Dive, pool_dive, write_table
from sitl.camera.noise import NOISE, PictureNoise
from sitl.camera.png import write_png
from sitl.camera.pool import PoolCamera
from sitl.camera.wall import WallCamera

__all__ = [
    "BOARDS",
    "NOISE",
    "Dive",
    "PictureNoise",
    "PoolCamera",
    "WallCamera",
    "pool_dive",
    "write_png",
    "write_table",
]
