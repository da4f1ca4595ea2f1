"""``python -m sitl.camera wall DIR``: write a folder of pictures of a wall, with the true distances."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path

from sitl.camera import NOISE, WallCamera, write_png

__all__ = ["main"]

_RATE = 2.0
"""Pictures per second: Miskovic2010, section 8.2.1."""


def main(argv: Sequence[str] | None = None) -> int:
    """Write the pictures that the arguments *argv* describe; return the exit code."""
    parser = argparse.ArgumentParser(prog="sitl.camera", description=__doc__)
    scenes = parser.add_subparsers(dest="scene", required=True)
    wall = scenes.add_parser("wall", help="two laser dots on a wall, from 10 to 100 cm in steps of 5 cm")
    wall.add_argument("--angle", type=float, default=0.0, help="angle to the wall [deg], -15 to 15 (default 0)")
    for scene in (wall,):
        scene.add_argument("folder", type=Path, metavar="DIR", help="folder to write")
        scene.add_argument(
            "--noise", choices=list(NOISE), default="clear", help="noise of the pictures (default clear)"
        )
        scene.add_argument("--seed", type=int, default=0, help="seed of the noise (default 0)")
    args = parser.parse_args(argv)
    if abs(args.angle) > 15.0:
        parser.error("--angle: use -15 to 15 deg. Beyond, a dot leaves the picture")
    args.folder.mkdir(parents=True, exist_ok=True)
    _write_wall(args.folder, WallCamera(args.noise, seed=args.seed), math.radians(args.angle))
    sys.stdout.write(f"{args.folder}: pictures, times.csv and truth.csv\n")
    return 0


def _write_wall(folder: Path, camera: WallCamera, angle: float) -> None:
    distances = [0.1 + 0.05 * k for k in range(19)]
    for number, distance in enumerate(distances, start=1):
        write_png(folder / f"{number:04d}.png", camera.picture(distance, angle))
    times = "".join(f"{k / _RATE:.3f}\n" for k in range(len(distances)))
    (folder / "times.csv").write_text(f"t[s]\n{times}", encoding="utf-8")
    truth = "".join(f"{100.0 * d:.1f},{math.degrees(angle):g}\n" for d in distances)
    (folder / "truth.csv").write_text(f"d[cm],angle[deg]\n{truth}", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
