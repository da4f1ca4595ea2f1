"""``hold distance`` flown by pictures of two laser dots, beside rangefinders that measure at the same rate.

A camera on the simulated VideoRay takes two pictures of the wall per second. The laser module reads them, and its
companion computer sends them 0.1 s later as DISTANCE_SENSOR messages. Everything runs in simulated time::

    python3 -m benchmarks.hold_by_pictures --seeds 1     # a minute
    python3 -m benchmarks.hold_by_pictures               # 5 seeds
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from collections import deque
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.results import Figure, count, headline
from gcs_autotune.errors import AutotuneError
from gcs_autotune.link import DistanceSender, MemoryLink, Transport
from gcs_autotune.observer import SilentObserver
from gcs_autotune.report import HeldDistance
from gcs_autotune.vision import DotFinder, LaserModule, calibrate_laser
from gcs_autotune.workflow import Connection, HoldSettings, TuneSettings, Unattended, hold
from sitl import Server, open_vehicle
from sitl.camera import NOISE, WallCamera
from sitl.camera.__main__ import main as render

APART, PERIOD, LATE = 0.2, 0.5, 0.1
"""Distance between the lasers [m], time between two pictures [s] (Miskovic2010, section 8.2.1), and time until their
distance is sent [s]. The first and the last are project choices."""
WALL = 0.6
"""Distance to the wall at the start [m]: the lasers are calibrated from 0.1 to 1 m."""
SEEN = (0.02, 3.0)
"""Lengths of a beam whose dot is in the picture [m]."""
STEP = 0.2
"""Step of the distance [m]."""


class Wire:
    """Store the data of the companion computer."""

    def __init__(self) -> None:
        self.data = bytearray()

    def receive(self, data: bytes) -> None:
        """Keep *data*."""
        self.data += data

    def advance_to(self, t: float) -> bytes:
        """Return nothing: the companion computer needs no answer."""
        return b""


class Watched:
    """A vehicle before a wall whose true distance is noted twice a second. With a *camera*, pictures measure it."""

    def __init__(self, server: Server, module: LaserModule | None, camera: WallCamera | None) -> None:
        self.server, self._module, self._camera = server, module, camera
        self._finder = DotFinder("red", module.lines) if module else None
        self._wire = Wire()
        self._sender = DistanceSender(MemoryLink(self._wire), 1)
        self._due: deque[tuple[float, tuple[float, float]]] = deque()
        self._next = 0.0
        self.truth: list[tuple[float, float]] = []
        self.pictures = self.missed = 0

    def receive(self, data: bytes) -> None:
        """Pass *data* to the vehicle."""
        self.server.receive(data)

    def advance_to(self, t: float) -> bytes:
        """Run to *t* [s]; return what vehicle and companion computer send."""
        out = bytearray()
        while self._next <= t:
            out += self.server.advance_to(self._next)
            self._look()
            self._next += PERIOD
        out += self.server.advance_to(t)
        while self._due and self._due[0][0] <= t:
            when, beams = self._due.popleft()
            self._sender.wait(when)
            assert self._module is not None
            self._sender.send(beams, self._module.nearest, self._module.furthest)
        out += self._wire.data
        self._wire.data.clear()
        return bytes(out)

    def _look(self) -> None:
        state, finder = self.server.vehicle.state, self.server.vehicle.rangefinder
        turned = math.remainder(state.psi - finder.heading, math.tau)
        normal = finder.wall - state.x * math.cos(finder.heading) - state.y * math.sin(finder.heading)
        self.truth.append((self._next, normal))
        if self._camera is None or self._finder is None or self._module is None:
            return
        beams = (math.nan, math.nan)
        if math.cos(turned) > 0.1:
            beams = self._camera.beams(normal / math.cos(turned), turned)
        if all(SEEN[0] < beam < SEEN[1] for beam in beams):
            picture = self._camera.picture(normal / math.cos(turned), turned)
        else:
            picture = self._camera.with_dots(np.empty((0, 2)), [])
        read = self._module.beams(self._finder.find(np.ascontiguousarray(picture[:, :, ::-1])))
        self.pictures, self.missed = self.pictures + 1, self.missed + math.isnan(sum(read))
        self._due.append((self._next + LATE, read))


@dataclass(frozen=True)
class Aboard(Connection):
    """A connection to *peer* in this process."""

    peer: Watched | None = None

    def open(self) -> Transport:
        """Return a link in memory."""
        assert self.peer is not None
        return MemoryLink(self.peer)


def flown(folder: Path, seed: int, module: LaserModule | None, noise: str) -> tuple[float, float, Watched] | str:
    """Return true rms and reported rms of the distance error [m] over the last half of each leg, or what ended it."""
    file = folder / "wall.toml"
    file.write_text(
        'title = "VideoRay near a wall"\nlike = "videoray-lasers"\n[rangefinder]\n'
        f'wall = {{ value = {WALL}, unit = "m", source = "Chosen: within reach of the dots" }}\n',
        encoding="utf-8",
    )
    server = open_vehicle(str(file), seed=seed)
    peer = Watched(server, module, WallCamera(noise, seed=seed) if module else None)
    tune = TuneSettings(Aboard("memory", peer=peer), folder / f"{seed}-{noise}-{module is not None}", axis="heading")
    try:
        held = hold(HoldSettings("distance", tune, apart=APART, distance_step=STEP), Unattended(), SilentObserver())
    except AutotuneError as error:
        return f"{type(error).__name__}: {error}"
    assert isinstance(held, HeldDistance)
    targets = [(m.t, float(m.detail["value"])) for m in held.trial.marks if m.kind == "target"]
    t, distance = np.array(peer.truth).T
    t -= server.vehicle.seconds - 1e-3 * server.vehicle.ms
    ends = [begin for begin, _ in targets[1:]] + [held.trial.end]
    errors = [
        distance[(t >= 0.5 * (begin + end)) & (t <= end)] - target
        for (begin, target), end in zip(targets, ends, strict=True)
    ]
    late = np.concatenate(errors)
    return float(np.sqrt(np.mean(late**2))), held.figures.rms, peer


def main() -> int:
    """Fly them, and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--noise", choices=list(NOISE), default="turbid", help="noise of the pictures")
    args = parser.parse_args()
    figures = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        render(["wall", str(folder / "wall")])
        module = calibrate_laser(folder / "wall" / "truth.csv", str(folder / "wall"), apart=APART).module
        for means, used in (("pictures", module), ("rangefinders", None)):
            true, pictures, missed = [], 0, 0
            for seed in range(1, args.seeds + 1):
                found = flown(folder, seed, used, args.noise)
                if isinstance(found, str):
                    print(f"{means}, seed {seed}: {found}")
                    continue
                rms, reported, peer = found
                true.append(rms)
                pictures, missed = pictures + peer.pictures, missed + peer.missed
                print(
                    f"{means}, seed {seed}: true error {100.0 * rms:.2f} cm rms, reported {100.0 * reported:.2f} cm; "
                    f"{peer.missed} of {peer.pictures} pictures without a distance",
                    flush=True,
                )
            figures.append(count(f"{means}: runs that keep the distance", len(true), args.seeds, least=1.0))
            if true:
                figures.append(Figure(f"{means}: true rms error, mean of the runs", 100.0 * float(np.mean(true)), "cm"))
            if pictures:
                figures.append(count(f"{means}: pictures with a distance", pictures - missed, pictures))
    headline("hold_by_pictures", "hold distance flown by pictures of two laser dots", figures)
    return 0


if __name__ == "__main__":
    sys.exit(main())
