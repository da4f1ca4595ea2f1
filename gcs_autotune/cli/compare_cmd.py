"""``gcs-autotune compare``: several runs of one craft side by side, and what changed."""

from __future__ import annotations

import argparse
from datetime import datetime
from pathlib import Path

from gcs_autotune.cli.command import Command, add_number, check_files, waiting
from gcs_autotune.cli.reading import add_parameters, read_parameters
from gcs_autotune.cli.writing import page_file, put_out, write_page

__all__ = ["COMMAND"]


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "runs",
        nargs="+",
        type=Path,
        metavar="RUN",
        help="run directories or logs of one craft (2 to 12). Runs with dates are shown in the order of their dates",
    )
    add_number(parser, "system-id", "ID", meaning="system id of the vehicle, in a .tlog with several")
    add_parameters(parser.add_argument_group("parameters"))
    parser.add_argument("--page", type=page_file, metavar="FILE", help="write the report as a page")
    parser.add_argument("--json", action="store_true", help="print JSON on standard output")


def _run(args: argparse.Namespace) -> int:
    check_files(*args.runs, args.parameters)
    with waiting(args, "comparing the runs"):
        from gcs_autotune.report import comparison_document
        from gcs_autotune.workflow import compare

        found = compare(args.runs, parameters=read_parameters(args), system=args.system_id)
        document = comparison_document(found, f"{datetime.now():%Y-%m-%d %H:%M}")
        lines = [] if args.page is None else [write_page(document, args.page, *args.runs, args.parameters)]
    put_out(document, *lines, as_json=args.json)
    return 0


COMMAND = Command(
    description="Compare runs of one craft: models, gains, and steps with these gains, and report what changed by more "
    "than the intervals (payload, fouling, a weak thruster). The first run is the reference. `watch` does the same for "
    "many logs, one line each.",
    add_arguments=_add_arguments,
    run=_run,
)
