"""``gcs-autotune calibrate``: calibrate two lasers for the distance to a wall, or a camera above a pool."""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

from gcs_autotune.cli.command import Command, add_number, check_files
from gcs_autotune.cli.writing import on_replacing, put_out
from gcs_autotune.errors import UsageError
from gcs_autotune.untrusted_text import visible

__all__ = ["COMMAND"]


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", required=True)
    laser = actions.add_parser("laser", help="fit the curve of each laser dot to pictures at known distances")
    laser.add_argument(
        "table",
        type=Path,
        metavar="TABLE.csv",
        help="known distances d[cm], and the distances x_L and x_R of the dots from the picture's centre [pixels]",
    )
    laser.add_argument(
        "--pictures", default="", metavar="FOLDER", help="find the dots in these pictures, one per row of the table"
    )
    laser.add_argument("--colour", choices=("red", "green", "blue"), default="red", help="colour of the lasers")
    add_number(laser, "apart", "M", meaning="distance between the two lasers")
    laser.add_argument(
        "--out", type=Path, metavar="FILE", default=Path("lasers.json"), help="file to write (default lasers.json)"
    )
    laser.add_argument("--json", action="store_true", help="print JSON on standard output")
    camera = actions.add_parser("camera", help="fit the lens and the floor of a camera above a pool")
    camera.add_argument(
        "floor",
        type=Path,
        metavar="FLOOR.csv",
        help="four points or more: column,row [pixels], and x[m],y[m] in the plane of the marker",
    )
    camera.add_argument(
        "--boards", default="", metavar="FOLDER", help="pictures of a checkerboard, for the distortion of the lens"
    )
    camera.add_argument("--board", default="9x6", metavar="NxM", help="inner corners of the board (default 9x6)")
    camera.add_argument(
        "--out", type=Path, metavar="FILE", default=Path("camera.json"), help="file to write (default camera.json)"
    )


def _run(args: argparse.Namespace) -> int:
    return _lasers(args) if args.action == "laser" else _camera(args)


def _camera(args: argparse.Namespace) -> int:
    check_files(args.floor)
    size = re.fullmatch(r"([1-9]\d?)x([1-9]\d?)", args.board, re.ASCII)
    if size is None or min(int(size[1]), int(size[2])) < 3:
        raise UsageError("--board: not a number of inner corners from 3x3 to 99x99. For 10 by 7 squares it is 9x6")
    from gcs_autotune.vision import calibrate_camera, save_camera

    camera, error = calibrate_camera(args.floor, args.boards, (int(size[1]), int(size[2])))
    replaced = on_replacing(args.out)
    save_camera(camera, args.out)
    if args.boards:
        focal, k = camera.matrix[0][0], camera.distortion
        sys.stdout.write(f"Lens: focal length {focal:.1f} pixels, distortion k1 {k[0]:.3f}, k2 {k[1]:.3f}.\n")
    sys.stdout.write(f"Floor: rms error of the points {1000.0 * error:.1f} mm.\n")
    sys.stdout.write(f"Camera: {visible(str(args.out))}{replaced}\n")
    return 0


def _lasers(args: argparse.Namespace) -> int:
    check_files(args.table)
    from gcs_autotune.report import laser_document
    from gcs_autotune.vision import calibrate_laser, save_lasers

    found = calibrate_laser(args.table, args.pictures, apart=args.apart, colour=args.colour)
    replaced = on_replacing(args.out)
    save_lasers(found.module, args.out)
    put_out(laser_document(found), f"Calibration: {args.out}{replaced}", as_json=args.json)
    return 0


COMMAND = Command(
    description="Calibrate two lasers that measure the distance to a wall. Place the craft at a right angle to the "
    "wall at known distances, e.g. from 10 to 100 cm in steps of 5 cm. Or calibrate a camera above a pool, for "
    "`track`. Needs gcs-autotune[vision].",
    add_arguments=_add_arguments,
    run=_run,
)
