"""``gcs-autotune restore``: complete the clean-up of a run that was interrupted."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from gcs_autotune.cli.command import Command, add_connection, add_loudness, check_files, connection_of, watching
from gcs_autotune.cli.console import ConsoleOperator
from gcs_autotune.untrusted_text import visible

__all__ = ["COMMAND"]


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "run",
        nargs="?",
        type=Path,
        metavar="RUN",
        help="run directory or its journal.jsonl (default: the newest in runs/ with something left to restore)",
    )
    parser.add_argument(
        "--yes",
        action="store_true",
        help="do not ask before writing. Parameters that another operator changed since the run stay, with exit code 9",
    )
    add_connection(parser, otherwise="the link of the run", of_run=True)
    add_loudness(parser)


def _run(args: argparse.Namespace) -> int:
    check_files(args.run)
    from gcs_autotune.workflow import is_settled, link_of, restore_run

    if is_settled(args.run):
        sys.stdout.write("Nothing to restore: this run has already restored everything.\n")
        return 0
    operator = ConsoleOperator(yes=args.yes, bell=not args.quiet)
    connection = connection_of(args, args.connect or link_of(args.run))
    with operator.listening(), watching(args) as observer:
        restored = restore_run(connection, args.run, operator, observer)
    for name, (found, old) in restored.items():
        sys.stdout.write(f"{visible(name)}: {found:g} -> {old:g}, verified by reading back\n")
    return 0


COMMAND = Command(
    description="Restore the vehicle after an interrupted run (lost power, lost radio, killed process): actuators "
    "neutral, parameters at their original values, verified by reading back. The run's journal lists what to restore. "
    "Parameters that another operator changed since are written only after a question.",
    add_arguments=_add_arguments,
    run=_run,
)
