"""An ROV keeps its distance to a wall by the pictures of its camera, over MAVLink."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from gcs_autotune.link import DistanceSender, MemoryLink
from gcs_autotune.report import HeldDistance
from gcs_autotune.vision import DotFinder, LaserModule, calibrate_laser
from gcs_autotune.workflow import HoldSettings, Unattended, hold
from sitl import Server
from sitl.camera import WallCamera, write_png

from .sitl_harness import WHEN, Ear, Meddler, SitlHarness

pytest.importorskip("cv2", reason="OpenCV is not installed (gcs-autotune[vision])")

WALL = 2.0
"""Distance of the wall in the file of the vehicle [m]."""
PERIOD = 0.5
"""Time between two pictures [s]: Miskovic2010, section 8.2.1."""


class Tether:
    """Receives what a companion computer writes."""

    def __init__(self) -> None:
        self.data = bytearray()

    def receive(self, data: bytes) -> None:
        self.data += data

    def advance_to(self, t: float) -> bytes:
        return b""


class Companion(Meddler):
    """Puts the distances of rendered pictures on the vehicle's link, twice a second."""

    def __init__(self, server: Server, module: LaserModule) -> None:
        super().__init__(server)
        self._module, self._camera, self._tether = module, WallCamera("turbid", seed=1), Tether()
        self._finder = DotFinder("red", module.lines)
        self._link = MemoryLink(self._tether)
        self._sender, self._next, self.pictures = DistanceSender(self._link, 1), 0.0, 0

    def advance_to(self, t: float) -> bytes:
        out = super().advance_to(t)
        if t >= self._next:
            self._next = t + PERIOD
            at = self.server.vehicle.state
            if abs(at.psi) < 1.0:
                picture = self._camera.picture((WALL - at.x) / math.cos(at.psi), at.psi)
                beams = self._module.beams(self._finder.find(np.ascontiguousarray(picture[:, :, ::-1])))
                self._sender.wait(t)
                self._sender.send(beams, self._module.nearest, self._module.furthest)
                self._link.read(0.0)
                self.pictures += 1
        out += bytes(self._tether.data)
        self._tether.data.clear()
        return out


@pytest.mark.slow
def test_an_rov_keeps_its_distance_by_two_laser_dots_in_pictures(tmp_path: Path) -> None:
    camera, distances = WallCamera(seed=2), np.arange(0.6, 3.61, 0.2)
    for number, distance in enumerate(distances):
        write_png(tmp_path / f"{number:02d}.png", camera.picture(float(distance)))
    (tmp_path / "table.csv").write_text("d[m]\n" + "".join(f"{v:.2f}\n" for v in distances))
    module = calibrate_laser(tmp_path / "table.csv", str(tmp_path), apart=0.2).module
    harness = SitlHarness(tmp_path, "videoray-lasers")
    harness.peer = Companion(harness.server, module)
    found = hold(HoldSettings("distance", harness.settings("heading")), Unattended(), Ear(harness.said), WHEN)
    assert isinstance(found, HeldDistance)
    assert harness.peer.pictures > 100
    assert found.follows
    assert abs(found.figures.mean) < 0.03
    harness.assert_neutral()
    assert not harness.vehicle.autopilot.armed
