"""``gcs-autotune figures``: compute IMO and ITTC figures of a zig-zag, turning circle, spiral, pull-out or stop."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from gcs_autotune.cli.command import Command, add_number, check_files, waiting
from gcs_autotune.cli.writing import page_file, put_out, write_page

__all__ = ["COMMAND"]


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "runs",
        nargs="+",
        type=Path,
        metavar="RUN",
        help="CSV files with column heads like t[s],psi[deg],delta[deg], or folders of them",
    )
    parser.add_argument(
        "--manoeuvre", metavar="NAME", help="zig-zag, turning-circle, spiral, reverse-spiral, pull-out or stopping"
    )
    add_number(parser, "length", "L")
    add_number(parser, "speed", "V", limit="trial-speed")
    add_number(parser, "scale", "S")
    parser.add_argument("--page", type=page_file, metavar="FILE", help="write the figures and diagrams as a page")
    parser.add_argument("--json", action="store_true", help="print JSON on standard output")


def _run(args: argparse.Namespace) -> int:
    check_files(*args.runs)
    with waiting(args, "computing the figures"):
        from gcs_autotune.logs import load_runs
        from gcs_autotune.report import sheets_document
        from gcs_autotune.seatrials import Particulars, ship_figures

        ship = Particulars(_known(args.length), _known(args.speed), args.scale)
        trials = [trial for path in args.runs for trial in load_runs(path)]
        sheets = [sheet for trial in trials for sheet in ship_figures(trial, ship, args.manoeuvre)]
        document = sheets_document(sheets)
        lines = [] if args.page is None else [write_page(document, args.page, *args.runs)]
    put_out(document, *lines, as_json=args.json)
    return 0


def _known(value: float | None) -> float:
    return math.nan if value is None else value


COMMAND = Command(
    description="Recognise the manoeuvre in a recorded run and print its figures with standard errors and the criteria "
    "of IMO MSC.137(76): overshoot angles, initial turning, advance, tactical diameter, stability.",
    add_arguments=_add_arguments,
    run=_run,
)
