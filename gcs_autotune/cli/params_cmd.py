"""``gcs-autotune params``: save parameters to a file, or restore them from one."""

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
    uri_of,
    waiting,
)
from gcs_autotune.cli.remote import attending
from gcs_autotune.cli.writing import on_replacing
from gcs_autotune.untrusted_text import visible

__all__ = ["COMMAND"]


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", required=True)
    save = actions.add_parser("save", help="write the vehicle's whole parameter list to a file")
    save.add_argument(
        "file", type=Path, metavar="FILE", help="file to write: NAME,VALUE lines, or JSON if its name ends in .json"
    )
    add_connection(save)
    add_loudness(save)
    restore = actions.add_parser(
        "restore",
        help="write the parameters in a file, e.g. to undo a completed tune, and verify each by reading back "
        "(`gcs-autotune restore` completes the clean-up of an interrupted run)",
    )
    restore.add_argument(
        "file", type=Path, metavar="FILE", help="file written by `params save`, or directory of a tune"
    )
    restore.add_argument("--yes", action="store_true", help="do not ask before writing")
    add_connection(restore, otherwise="the link of the run that wrote the file", of_run=True)
    add_loudness(restore)
    add_remote(restore)


def _run(args: argparse.Namespace) -> int:
    saving = args.action == "save"
    check_files(None if saving else args.file)
    with waiting(args, "starting"):
        from gcs_autotune.workflow import link_of, restore_parameters, save_parameters

    connection = connection_of(args, uri_of(args) if saving else args.connect or link_of(args.file))
    if saving:
        args.yes, args.remote = True, False
    with attending(args) as (operator, observer):
        if saving:
            replaced = on_replacing(args.file)
            count, changed = save_parameters(connection, args.file, operator, observer)
            own = "" if changed is None else f" ({changed} differ from the firmware's defaults)"
            sys.stdout.write(f"{count} parameters saved to {args.file}{replaced}{own}\n")
        else:
            restored = restore_parameters(connection, args.file, operator, observer)
            told = [f"{visible(name)}: {found:g} -> {wanted:g}" for name, (found, wanted) in restored.items()]
            what = f"{len(restored)} parameter{'s' if len(restored) != 1 else ''}"
            told.append(f"{what} changed. All parameters in {args.file} verified by reading back")
            for line in told:  # with --remote standard output is the program's
                observer.say(line) if args.remote else sys.stdout.write(f"{line}\n")
    return 0


COMMAND = Command(
    description="Save a vehicle's parameters to a file, or restore them from a file.",
    add_arguments=_add_arguments,
    run=_run,
)
