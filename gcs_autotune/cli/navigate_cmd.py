"""``gcs-autotune navigate``: fuse the sensors of a log into a navigation solution at the centre of gravity."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from gcs_autotune.cli.command import Command, add_number, check_files
from gcs_autotune.cli.writing import fresh, put_out
from gcs_autotune.errors import BadFile, UsageError
from gcs_autotune.limits import finite
from gcs_autotune_files import clipped

__all__ = ["COMMAND"]

FARTHEST = 20.0
"""Longest lever arm [m]. A longer one is in millimetres or centimetres. Project choice."""
DEVICES = ("gps", "dvl", "depth")


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "log", type=Path, metavar="LOG", help="onboard log (.bin), or CSV with heads like imu.ax[m/s^2]"
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder for the runs (default runs/navigated-LOG)")
    parser.add_argument(
        "--centre",
        metavar="X,Y,Z",
        default="0,0,0",
        help="centre of gravity, in metres ahead, to starboard and down of the inertial sensor (default 0,0,0)",
    )
    parser.add_argument(
        "--arm",
        action="append",
        default=[],
        metavar="DEVICE=X,Y,Z",
        help="known place of gps, dvl or depth, in metres from the inertial sensor (default: estimated)",
    )
    add_number(parser, "rate", "HZ")
    parser.add_argument(
        "--columns", metavar="OLD=NEW,...", default="", help="source and unit of each column: acc_x=imu.ax[m/s^2]"
    )
    add_number(parser, "system-id", "ID", meaning="system id of the vehicle, if the .tlog contains several")
    parser.add_argument("--json", action="store_true", help="print JSON on standard output")


def _run(args: argparse.Namespace) -> int:
    centre, arms = _place("--centre", args.centre), dict(_arm(text) for text in args.arm)
    check_files(args.log)
    if args.log.is_dir():
        raise BadFile(f"{args.log} is a folder. Give the log file inside it")
    from gcs_autotune.logs import fresh_folder, parse_columns
    from gcs_autotune.navigation import Mounting, navigate_file
    from gcs_autotune.report import navigation_document
    from gcs_autotune.trial import save_trial

    columns = parse_columns(args.columns) if args.columns else None
    found = navigate_file(args.log, Mounting(centre, arms), args.rate, system=args.system_id, columns=columns)
    folder = fresh_folder(args.out or fresh(Path("runs") / f"navigated-{args.log.stem}"))
    try:
        for number, run in enumerate(found.runs, start=1):
            save_trial(run, folder / f"{args.log.stem}-{number:02d}.csv")
    except OSError as error:
        raise BadFile(f"{folder} cannot be written: {error.strerror}. Choose another --out") from error
    put_out(
        navigation_document(found.to_dict()),
        f"Runs: {folder}",
        f"Next: gcs-autotune identify {shlex.quote(str(folder))}",
        as_json=args.json,
    )
    return 0


def _arm(text: str) -> tuple[str, tuple[float, float, float]]:
    device, sign, place = text.partition("=")
    if not sign or device not in DEVICES:
        raise UsageError(f"--arm {clipped(text)}: not DEVICE=X,Y,Z with gps, dvl or depth. Write e.g. gps=0.4,0,-0.6")
    return device, _place(f"--arm {device}", place)


def _place(option: str, text: str) -> tuple[float, float, float]:
    """Parse three lengths [m].

    Raises
    ------
    UsageError
        They are not three numbers, or not in metres.
    """
    try:
        x, y, z = (finite(piece) for piece in text.split(","))
    except (UsageError, ValueError):
        raise UsageError(f"{option} {clipped(text)}: not three numbers in metres. Write e.g. 0.4,0,-0.6") from None
    longest = max(abs(x), abs(y), abs(z))
    if longest > FARTHEST:
        raise UsageError(
            f"{option} {clipped(text)}: {longest:g} m is too far. The largest allowed is {FARTHEST:g} m; is it in mm? "
            f"Write {x / 1000.0:g},{y / 1000.0:g},{z / 1000.0:g}"
        )
    return x, y, z


COMMAND = Command(
    description="Fuse inertial sensor, GPS, compass, DVL and depth of a log by an error-state Kalman filter with a "
    "smoother. Biases, lever arms and delays of the sensors are estimated. The runs that it writes contain position, "
    "attitude, u v w and p q r at the centre of gravity. identify uses their standard deviations as weights.",
    add_arguments=_add_arguments,
    run=_run,
    examples=(
        ("gcs-autotune navigate flight.bin", "an onboard log with IMU, GPS and compass"),
        ("gcs-autotune navigate flight.bin --centre 0.1,0,0.05 --arm gps=0.4,0,-0.6", "with measured places"),
    ),
)
