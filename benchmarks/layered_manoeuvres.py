"""Layered manoeuvres on every simulated vehicle that has them: error figures, and updates per second of each law.

Run: ``python3 -m benchmarks.layered_manoeuvres [VEHICLE ...] [--only NAME,..] [--seeds N] [--rates]``.

The first seed of a vehicle identifies it by relays. Later seeds and manoeuvres use these models. ``--rates`` prints
updates per second of one core instead. Exit status 1 if a run does not complete.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from benchmarks.results import count, headline
from gcs_autotune.control import AxisLoop, TimedPath, Uncertainty, design_own
from gcs_autotune.craft import Observation
from gcs_autotune.design import Actuator
from gcs_autotune.errors import AutotuneError
from gcs_autotune.identify import ModelFile
from gcs_autotune.link import MemoryLink, Transport
from gcs_autotune.manoeuvres import MANOEUVRES, FollowWall, OwnLoops, read_points
from gcs_autotune.models import SingleDof
from gcs_autotune.observer import SilentObserver
from gcs_autotune.workflow import CommonSettings, Connection, FlySettings, Unattended, fly, load_models
from sitl import Server, open_vehicle

ROV = ("hover", "goto", "orientation", "trajectory", "plane")
FLOWN = {
    "bluerov2-sway": ROV,
    "blueboat": ("goto", "orientation", "trajectory"),
    "charlie": ("goto", "orientation", "trajectory"),
    "videoray": ("goto", "orientation"),
    "videoray-lasers": ("follow-wall",),
}
"""Vehicle -> manoeuvres that it has. The VideoRay's speeds are those that its simulator reports."""
BOAT = {"goto": {"ahead": 60.0, "starboard": 30.0}, "orientation": {"heading-change": math.radians(60.0)}}
AT_REST = {
    "hover": {"duration": 30.0},
    "goto": {"ahead": 4.0, "starboard": 3.0},
    "orientation": {"heading-change": math.radians(90.0)},
    "plane": {"depth": 2.0, "ahead": 4.0},
    "follow-wall": {"length-along": 0.5},
}
POINTS = {"boat": "30,30,0 60,60,15 90,75,45", "rov": "20,4,0 40,4,4 60,0,4"}


@dataclass(frozen=True)
class Aboard(Connection):
    """A connection to *server* in this process."""

    server: Server | None = None

    def open(self) -> Transport:
        """Return a link in memory."""
        assert self.server is not None
        return MemoryLink(self.server)


def flown(vehicle: str, name: str, seed: int, models: tuple[ModelFile, ...], directory: Path) -> str:
    """Fly one manoeuvre and return its figures, or what ended it."""
    server = open_vehicle(vehicle, seed=seed)
    boat = server.vehicle.data.is_boat
    common = CommonSettings(Aboard("memory", server=server), directory)
    timed = MANOEUVRES[name].timed
    settings = FlySettings(
        name,
        common,
        {} if timed else (BOAT if boat else AT_REST)[name],
        model=models[0] if models else None,
        beside=models[1:],
        points=read_points(POINTS["boat" if boat else "rov"]) if timed else (),
    )
    try:
        result = fly(settings, Unattended(), SilentObserver(), "2026-11-26T12:00:00")
    except AutotuneError as error:
        return f"{type(error).__name__}: {error}"
    figures = [(f.slug, f.reading) for sheet in result.sheets for f in sheet.figures]
    return ", ".join(
        f"{slug} {math.degrees(r.value):.2f} deg" if r.unit == "rad" else f"{slug} {r.value:.3f} m"
        for slug, r in figures
    )


def rates() -> None:
    """Print updates per second of one core for every helm and for the wall."""
    rov = {
        "yaw": SingleDof("yaw", "1", 0.1, 0.1, 0.1),
        "surge": SingleDof("surge", "1", 0.4, 0.5, 1.0),
        "sway": SingleDof("sway", "1", 0.5, 0.6, 1.5),
        "heave": SingleDof("heave", "1", 0.6, 0.6, 1.5),
    }
    curve = Actuator(dead_zone=0.1, square=0.5)
    loops = {
        dof: AxisLoop(design_own(m, Uncertainty(0.1, 0.2), step=0.3, limits=(-0.4, 0.4)), curve.output_for)
        for dof, m in rov.items()
    }
    steered = {dof: loop for dof, loop in loops.items() if dof != "sway"}
    path = TimedPath.through((0.0, 30.0, 60.0), ((0.0, 0.0, 2.0, 0.0), (10.0, 5.0, 2.0, 0.5), (20.0, 0.0, 2.0, 1.0)))
    cases = {
        "pose (sliding mode)": OwnLoops(loops).helm(),
        "line of sight": OwnLoops(steered).helm(),
        "heading": OwnLoops(steered).helm(places=False),
    }
    seen = [
        Observation(
            0.02 * k, 0.001 * k, 0.01, x=0.01 * k, y=0.0, z=2.0, u=0.5, v=0.01, w=0.0, speed=0.5,
            d=2.0 + 0.001 * (k % 7), d_starboard=2.0,
        )
        for k in range(2000)
    ]  # fmt: skip
    for name, helm in cases.items():
        began = time.process_time()
        for now in seen:
            helm.update(path.target(now.t), now)
        print(f"{name}: {len(seen) / (time.process_time() - began):.0f} updates/s of one core")
    commands = FollowWall(math.nan, 1.0, 0.1).over(OwnLoops(loops)).commands(seen[0])
    next(commands)
    began = time.process_time()
    for now in seen[1:]:
        commands.send(now)
    print(f"wall (Kalman filter): {len(seen) / (time.process_time() - began):.0f} updates/s of one core")


def main() -> int:
    """Fly them and print one line per run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("vehicles", nargs="*", default=list(FLOWN), metavar="VEHICLE")
    parser.add_argument("--only", default="", help="names of manoeuvres, separated by commas")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--rates", action="store_true")
    args = parser.parse_args()
    if args.rates:
        rates()
        return 0
    failed = runs = 0
    only = args.only.split(",") if args.only else []
    with tempfile.TemporaryDirectory() as folder:
        for vehicle in args.vehicles:
            models: dict[str, ModelFile] = {}
            for seed in range(1, args.seeds + 1):
                for name in (n for n in FLOWN[vehicle] if not only or n in only):
                    directory = Path(folder) / f"{vehicle}-{name}-{seed}"
                    summary = flown(vehicle, name, seed, tuple(models.values()), directory)
                    if any(directory.glob("model*.json")):
                        found = load_models(directory)
                        models = {**{m.model.base.form.dofs[0]: m for m in found}, **models}
                    failed, runs = failed + (":" in summary or not summary), runs + 1
                    print(f"{vehicle} {name} seed {seed}: {summary}", flush=True)
    figures = [count("runs completed", runs - failed, runs, least=1.0)]
    headline("layered_manoeuvres", "layered manoeuvres over our own controllers", figures)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
