"""``python -m sitl.camera``: write a folder of pictures of a wall or a pool, with the true distances or positions."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sitl.camera import BOARDS, NOISE, Dive, PoolCamera, WallCamera, pool_dive, write_png, write_table
from sitl.effects import BadEffect, HiddenEffect, parse_effect

__all__ = ["main"]

_RATE = 2.0
"""Pictures of the wall per second: Miskovic2010, section 8.2.1."""
_CORNERS = ((1.2, -1.2), (1.2, 1.2), (-1.2, 1.2), (-1.2, -1.2))
"""Points on the floor of the pool, x and y [m]."""


def main(argv: Sequence[str] | None = None) -> int:
    """Write the pictures that the arguments *argv* describe; return the exit code."""
    parser = argparse.ArgumentParser(prog="sitl.camera", description=__doc__)
    scenes = parser.add_subparsers(dest="scene", required=True)
    wall = scenes.add_parser("wall", help="two laser dots on a wall, from 10 to 100 cm in steps of 5 cm")
    wall.add_argument("--angle", type=float, default=0.0, help="angle to the wall [deg], -15 to 15 (default 0)")
    pool = scenes.add_parser("pool", help="S-manoeuvre of the VideoRay seen from above, its log, floor and boards")
    pool.add_argument("--seconds", type=int, default=40, help="length, 5 to 120 s (default 40)")
    pool.add_argument("--width", type=int, default=640, help="width of a picture, 160 to 1920 pixels (default 640)")
    pool.add_argument(
        "--effect",
        action="append",
        default=[],
        type=_effect,
        metavar="EFFECT",
        help="hidden effect, such as input-delay@N.delay=0.3, in N and N m (`sitl --list-effects`); may be repeated",
    )
    for scene in (wall, pool):
        scene.add_argument("folder", type=Path, metavar="DIR", help="folder to write")
        scene.add_argument("--noise", choices=list(NOISE), default="clear", help="noise (default clear)")
        scene.add_argument("--seed", type=int, default=0, help="seed of noise and manoeuvre (default 0)")
    args = parser.parse_args(argv)
    args.folder.mkdir(parents=True, exist_ok=True)
    if args.scene == "wall":
        if not abs(args.angle) <= 15.0:
            parser.error("--angle: use -15 to 15 deg. Beyond, a dot leaves the picture")
        _write_wall(args.folder, WallCamera(args.noise, seed=args.seed), math.radians(args.angle))
        sys.stdout.write(f"{args.folder}: pictures, times.csv and truth.csv\n")
        return 0
    if not 5 <= args.seconds <= 120:
        parser.error("--seconds: use 5 to 120 s")
    if not 160 <= args.width <= 1920:
        parser.error("--width: use 160 to 1920 pixels")
    try:
        dive = pool_dive(args.seed, args.seconds, args.effect)
    except BadEffect as error:
        parser.error(f"--effect: {error}")
    _write_pool(args.folder, PoolCamera.of_width(args.width, args.noise, seed=args.seed), dive)
    sys.stdout.write(f"{args.folder}: pictures, times.csv, log.csv, floor.csv, truth.csv and boards\n")
    return 0


def _write_wall(folder: Path, camera: WallCamera, angle: float) -> None:
    distances = [0.1 + 0.05 * k for k in range(19)]
    for number, distance in enumerate(distances, start=1):
        write_png(folder / f"{number:04d}.png", camera.picture(distance, angle))
    write_table(folder / "times.csv", "t[s]", np.arange(len(distances))[:, None] / _RATE)
    truth = np.column_stack([100.0 * np.array(distances), np.full(len(distances), math.degrees(angle))])
    write_table(folder / "truth.csv", "d[cm],angle[deg]", truth)


def _effect(text: str) -> HiddenEffect:
    try:
        return parse_effect(text)
    except BadEffect as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _write_pool(folder: Path, camera: PoolCamera, dive: Dive) -> None:
    for number, (x, y, psi) in enumerate(dive.seen, start=1):
        write_png(folder / f"{number:04d}.png", camera.picture(x, y, psi))
    write_table(folder / "times.csv", "t[s]", dive.video_t[:, None])
    write_table(folder / "truth.csv", "t[s],x[m],y[m],psi[rad]", np.column_stack([dive.video_t, dive.seen]))
    write_table(folder / "log.csv", "t[s],X[N],N[N m],r[rad/s]", dive.log)
    write_table(folder / "floor.csv", "column,row,x[m],y[m]", np.array([(*camera.pixel(*at), *at) for at in _CORNERS]))
    (folder / "boards").mkdir(exist_ok=True)
    for number, (turn, place) in enumerate(BOARDS, start=1):
        write_png(folder / "boards" / f"{number:02d}.png", camera.board(turn, place))


if __name__ == "__main__":
    sys.exit(main())
