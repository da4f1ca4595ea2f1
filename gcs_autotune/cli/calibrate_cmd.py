"""``gcs-autotune calibrate``: calibrate two lasers for the distance to a wall."""

from __future__ import annotations

import argparse
from pathlib import Path

from gcs_autotune.cli.command import Command, add_number, check_files
from gcs_autotune.cli.writing import on_replacing, put_out

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


def _run(args: argparse.Namespace) -> int:
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
    "wall at known distances, e.g. from 10 to 100 cm in steps of 5 cm. Needs gcs-autotune[vision] to read pictures.",
    add_arguments=_add_arguments,
    run=_run,
)
