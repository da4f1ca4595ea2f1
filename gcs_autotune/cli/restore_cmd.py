"""``gcs-autotune restore``: complete the clean-up of a run that was interrupted."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from gcs_autotune.cli.command import (
    Command,
    add_connection,
    add_loudness,
    add_remote,
    check_files,
    connection_of,
    waiting,
)
from gcs_autotune.cli.remote import attending
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
    add_remote(parser)


def _run(args: argparse.Namespace) -> int:
    check_files(args.run)
    with waiting(args, "starting"):
        from gcs_autotune.workflow import is_settled, link_of, restore_run, settled_words

    if is_settled(args.run) and not args.remote:
        sys.stdout.write(f"{visible(settled_words(args.run))}\n")
        return 0
    connection = connection_of(args, args.connect or link_of(args.run))
    with attending(args) as (operator, observer):
        restored = restore_run(connection, args.run, operator, observer)
        told = [
            f"{visible(name)}: {found:g} -> {old:g}, verified by reading back"
            for name, (found, old) in restored.items()
        ]
        for line in told if args.remote else ():  # standard output is the program's
            observer.say(line)
    if not args.remote:
        sys.stdout.write("".join(f"{line}\n" for line in told))
    return 0


COMMAND = Command(
    description="Restore the vehicle after an interrupted run (lost power, lost radio, killed process): actuators "
    "neutral, parameters at their original values, verified by reading back. The run's journal lists what to restore. "
    "Parameters that another operator changed since are written only after a question. "
    "`gcs-autotune params restore` undoes a completed tune.",
    add_arguments=_add_arguments,
    run=_run,
)
