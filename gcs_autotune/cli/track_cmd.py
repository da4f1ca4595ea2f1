"""``gcs-autotune track``: make a run from a video of the craft from above and its telemetry log."""

from __future__ import annotations

import argparse
import math
import shlex
import sys
from pathlib import Path

from gcs_autotune.cli.command import Command, add_number, check_files
from gcs_autotune.cli.reading import add_reading, read_runs
from gcs_autotune.cli.writing import on_replacing
from gcs_autotune.errors import BadFile, UsageError
from gcs_autotune.untrusted_text import visible

__all__ = ["COMMAND"]


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("source", metavar="VIDEO", help="video from above, or a folder of PNG or JPEG pictures")
    parser.add_argument("log", type=Path, metavar="LOG", help="log or run with the commands, and the yaw rate r or psi")
    parser.add_argument(
        "--camera",
        type=Path,
        metavar="FILE",
        default=Path("camera.json"),
        help="file of `gcs-autotune calibrate camera` (default camera.json)",
    )
    parser.add_argument(
        "--marker",
        choices=("red-line", "apriltag"),
        default="red-line",
        help="red-line (default): a red line along the craft. apriltag: a tag 36h11, its upper edge ahead",
    )
    add_number(parser, "offset", "S")
    add_number(parser, "bow", "DEG")
    add_number(parser, "frame-rate", "HZ")
    parser.add_argument(
        "--out", type=Path, metavar="FILE", default=Path("track.csv"), help="run to write (default track.csv)"
    )
    add_reading(parser)


def _run(args: argparse.Namespace) -> int:
    check_files(args.log, args.camera)
    from gcs_autotune.trial import save_trial
    from gcs_autotune.vision import joined, load_camera, track

    camera = load_camera(args.camera)
    args.runs = [args.log]
    runs = read_runs(args)
    if len(runs) != 1:
        raise UsageError(f"{args.log} contains {len(runs)} runs. Choose the one in the video with --pick")
    seen = track(args.source, camera, args.marker, args.frame_rate)
    found = joined(seen, runs[0], offset=args.offset, heading=None if args.bow is None else math.radians(args.bow))
    replaced = on_replacing(args.out)
    try:
        save_trial(found.run, args.out)
    except OSError as error:
        raise BadFile(f"{args.out} cannot be written: {error.strerror}") from error
    match = "" if found.correlation is None else f" (correlation of the yaw rates {found.correlation:.3f})"
    name = visible(str(args.out))
    sys.stdout.write(f"{len(seen.t)} positions; {seen.lost} pictures without the marker.\n")
    sys.stdout.write(f"The log's clock is {found.offset:+.3f} s from the video's{match}.\n")
    sys.stdout.write(f"Run: {name}{replaced}\nNext: gcs-autotune identify {shlex.quote(name)} --dof horizontal\n")
    return 0


COMMAND = Command(
    description="Find the craft in a video from above, align the video with its log, and write a run with position, "
    "heading and commands. identify and diagnose read it. Needs gcs-autotune[vision].",
    add_arguments=_add_arguments,
    run=_run,
    everyday=("camera", "marker", "offset", "bow", "frame-rate", "out"),
    examples=(
        ("gcs-autotune track pool.mp4 dive.tlog --pick 2", "the second run of the log is in the video"),
        ("gcs-autotune track pool/ run.csv --offset 12.4", "a folder of pictures, and the time of an event in both"),
    ),
)
