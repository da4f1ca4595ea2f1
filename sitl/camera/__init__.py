"""Pictures of simulated cameras: two laser dots on a wall, and a craft in a pool seen from above.

It uses NumPy only and shares no code with the reader of pictures. ``python -m sitl.camera`` writes folders of pictures.
"""

from __future__ import annotations

from sitl.camera.noise import NOISE, PictureNoise
from sitl.camera.png import write_png
from sitl.camera.wall import WallCamera

__all__ = ["NOISE", "PictureNoise", "WallCamera", "write_png"]
