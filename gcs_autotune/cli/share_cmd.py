"""``gcs-autotune share``: a run in one file to send to others."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from gcs_autotune.cli.command import Command, check_files, waiting
from gcs_autotune.cli.writing import fresh, on_replacing

__all__ = ["COMMAND"]


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("run", type=Path, metavar="RUN", help="run directory")
    parser.add_argument("--out", type=Path, metavar="FILE", help="zip file to write (default: RUN.zip, here)")
    parser.add_argument(
        "--hide-position",
        action="store_true",
        help="move all positions so that the run begins at 0 degrees north and east; distances stay",
    )


def _run(args: argparse.Namespace) -> int:
    check_files(args.run)
    with waiting(args, "packing the run"):
        from gcs_autotune.workflow import share_run

        out = args.out or fresh(Path(f"{args.run.resolve().name}.zip"))
        replaced = on_replacing(out)
        packed = share_run(args.run, out, hide_position=args.hide_position)
    for name, reason in packed.left_out:
        sys.stderr.write(f"left out: {name} ({reason})\n")
    place = "positions moved" if args.hide_position else "with positions (--hide-position moves them)"
    print(f"{packed.path}: {len(packed.files)} files, {packed.size / 1e6:.1f} MB, no signing key, {place}{replaced}")
    return 0


COMMAND = Command(
    description="Pack a run directory into a zip file to share, with a README of its content. Signing keys are never "
    "packed.",
    add_arguments=_add_arguments,
    run=_run,
)
