"""``gcs-autotune laser``: measure distance and angle to a wall from two laser dots."""

from __future__ import annotations

import argparse
import math
import sys
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from gcs_autotune.cli.command import Command, add_connection, add_number, check_files
from gcs_autotune.cli.secret import signing_of
from gcs_autotune.cli.writing import on_replacing
from gcs_autotune.errors import BadFile
from gcs_autotune.untrusted_text import visible

if TYPE_CHECKING:
    from gcs_autotune.vision import LaserModule, LaserReading

__all__ = ["COMMAND"]


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "source",
        metavar="VIDEO",
        help="video, folder of PNG or JPEG pictures, number of a camera (0), or address of a stream (rtsp://...)",
    )
    parser.add_argument(
        "--calibration",
        type=Path,
        metavar="FILE",
        default=Path("lasers.json"),
        help="file of `gcs-autotune calibrate laser` (default lasers.json)",
    )
    parser.add_argument("--colour", choices=("red", "green", "blue"), default="red", help="colour of the lasers")
    add_number(parser, "frame-rate", "HZ")
    add_number(parser, "window", "PIXELS")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the distances as a run (CSV)")
    parser.add_argument("--quiet", action="store_true", help="print only the last line")
    add_connection(parser)


def _run(args: argparse.Namespace) -> int:
    check_files(args.calibration)
    from gcs_autotune.trial import save_trial
    from gcs_autotune.vision import is_live, laser_run, load_lasers, read_lasers

    module = load_lasers(args.calibration)
    window = None if args.window is None else round(args.window)
    readings = read_lasers(module, args.source, rate=args.frame_rate, colour=args.colour, window=window)
    few = 2 if is_live(args.source) and args.out is None else None
    kept: deque[LaserReading] = deque(maxlen=few)  # a live camera has no end
    seen = missed = whole = 0
    uri = args.connect or args.configured_link
    for reading in _sent(readings, module, uri, args) if uri else readings:
        kept.append(reading)
        seen, missed, whole = seen + 1, missed + bool(reading.missing), whole + (reading.searched == "picture")
        if not args.quiet:
            sys.stdout.write(f"{_line(reading)}\n")
            sys.stdout.flush()
    run = laser_run(list(kept), Path(args.source).name)
    if args.out is not None:
        replaced = on_replacing(args.out)
        try:
            save_trial(run, args.out)
        except OSError as error:
            raise BadFile(f"{args.out} cannot be written: {error.strerror}") from error
        sys.stdout.write(f"Run: {visible(str(args.out))}{replaced}\n")
    sys.stdout.write(f"{seen} pictures, {missed} without a distance; {whole} were searched whole.\n")
    return 0


def _line(reading: LaserReading) -> str:
    start = f"{reading.number:6d} {reading.t:9.3f} s  "
    if reading.missing:
        return f"{start}{reading.missing}"
    return f"{start}{100.0 * reading.distance:6.1f} cm {math.degrees(reading.angle):+6.1f} deg"


def _sent(
    readings: Iterator[LaserReading], module: LaserModule, uri: str, args: argparse.Namespace
) -> Iterator[LaserReading]:
    """Send each reading to the vehicle at *uri* when it is due, and yield it."""
    from gcs_autotune.link import DistanceSender, open_link
    from gcs_autotune.vision import is_live

    with ExitStack() as stack:
        transport = stack.enter_context(open_link(uri, baud=args.baud, seed=args.seed, backend=args.backend))
        sender = DistanceSender(transport, round(args.system_id or 1), signing_of(args, uri))
        for reading in readings:
            sender.wait(0.0 if is_live(args.source) else reading.t)
            sender.send((reading.port, reading.starboard), module.nearest, module.furthest)
            yield reading


COMMAND = Command(
    description="Measure the distance to a wall and the angle to it, from two laser dots in the pictures of a camera. "
    "With --connect, send them to the vehicle and to `hold distance`. Needs gcs-autotune[vision].",
    add_arguments=_add_arguments,
    run=_run,
    everyday=("calibration", "out", "connect", "colour", "frame-rate"),
    examples=(
        ("gcs-autotune laser pictures/ --out wall.csv", "read a folder of pictures and keep the distances as a run"),
        ("gcs-autotune laser 0 --connect udpout:192.168.2.1:14550", "read camera 0 and send the distances"),
    ),
)
