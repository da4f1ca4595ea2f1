"""``gcs-autotune logs``: show the contents of a log, or write its runs as CSV files."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs_autotune.cli.command import (
    Command,
    add_connection,
    add_loudness,
    add_number,
    check_files,
    connection_of,
    uri_of,
    waiting,
    watching,
)
from gcs_autotune.cli.console import ConsoleOperator
from gcs_autotune.cli.reading import add_parameters, read_parameters
from gcs_autotune.cli.writing import fresh, on_replacing, put_out
from gcs_autotune.errors import BadFile, NotInformative
from gcs_autotune.plain_json import json_text
from gcs_autotune.untrusted_text import visible

if TYPE_CHECKING:
    from gcs_autotune.logs import Cut, Recording

__all__ = ["COMMAND"]

FORMATS = (
    "telemetry logs (.tlog), onboard logs (.bin, or .log as text), their CSV from Mission Planner or mavlogdump, "
    "QGroundControl's CSV, PX4's ULog (.ulg)"
)


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", required=True)
    show = actions.add_parser("list", help="show the messages, modes, parameters and runs in logs; write nothing")
    take = actions.add_parser("import", help="write the runs in logs as CSV files with their metadata")
    fetch = actions.add_parser("fetch", help="fetch a log from the vehicle's SD card over the link")
    add_number(fetch, "number", "N")
    fetch.add_argument("--out", type=Path, metavar="FILE", help="file to write (default log-N.bin)")
    add_connection(fetch)
    add_loudness(fetch)
    for action in (show, take):
        action.add_argument("files", nargs="+", type=Path, metavar="FILE", help=FORMATS)
        add_number(action, "system-id", "ID", meaning="system id of the vehicle, if the log contains several")
        add_parameters(action.add_argument_group("parameters"))
        action.add_argument("--json", action="store_true", help="print JSON on standard output")
    take.add_argument("--out", type=Path, metavar="DIR", help="folder for the runs (default runs/log-FILE)")
    take.add_argument(
        "--all",
        action="store_true",
        help="also write segments without input or without motion, which do not allow identification",
    )
    take.add_argument("--dry-run", action="store_true", help="list what would be imported, without writing files")


def _run(args: argparse.Namespace) -> int:
    return _fetch(args) if args.action == "fetch" else _show(args)


def _fetch(args: argparse.Namespace) -> int:
    from gcs_autotune.workflow import fetch_onboard_log

    operator = ConsoleOperator(yes=True, bell=not args.quiet)
    connection = connection_of(args, uri_of(args))
    with operator.listening(), watching(args) as observer:
        logs, log, data = fetch_onboard_log(connection, args.number, operator, observer)
    if log is None:
        for one in logs:
            when = f", {datetime.fromtimestamp(one.utc):%Y-%m-%d %H:%M}" if one.utc else ""
            sys.stdout.write(f"{one.number}: {one.size} bytes{when}\n")
        return 0
    path: Path = args.out or fresh(Path(f"log-{log.number}.bin"))
    replaced = on_replacing(path)
    try:
        path.write_bytes(data)
    except OSError as error:
        raise BadFile(f"{path} cannot be written: {error.strerror}. Choose another --out") from error
    sys.stdout.write(
        f"{visible(str(path))}{replaced}: {len(data)} bytes. Next: gcs-autotune identify {visible(str(path))}\n"
    )
    return 0


def _show(args: argparse.Namespace) -> int:
    check_files(*args.files, args.parameters)
    with waiting(args, "reading the log"):
        from gcs_autotune.logs import fresh_folder, survey, write_runs
        from gcs_autotune.report import log_document

        logs = [(path, *_read(path, args)) for path in args.files]
        surveys = [survey(log, cut) for _, log, cut in logs]
    if not args.json:
        for told in surveys:
            put_out(log_document(told))
    written: list[Path] = []
    if args.action == "import" and not args.dry_run:
        folder = fresh_folder(args.out or fresh(Path("runs") / f"log-{args.files[0].stem}"))
        labels = _labels(args.files)
        for label, (_, log, cut), told in zip(labels, logs, surveys, strict=True):
            runs = cut.runs + ([left.run for left in cut.left_out if left.run.channels] if args.all else [])
            written += write_runs(folder, label, sorted(runs, key=lambda r: int(r.meta["stretch"])), log, told)
    if args.json:
        _print({"schema": 1, "logs": surveys, "written": [str(p) for p in written]})
    else:
        for path in written:
            sys.stdout.write(f"{visible(str(path))}\n")
    if args.action == "import" and not args.dry_run and not written:
        raise NotInformative(
            "no run was written: no segment contains both input and motion. Use --all to write the other segments"
        )
    return 0


def _read(path: Path, args: argparse.Namespace) -> tuple[Recording, Cut]:
    from gcs_autotune.logs import cut_runs, format_of, record
    from gcs_autotune.trial import load_trial

    log = record(path, args.system_id, read_parameters(args))
    if log is None:
        form = format_of(path)
        if form is None and path.is_dir():
            raise BadFile(f"{path} is a folder. Give the log files inside it")
        if form is None:
            load_trial(path)  # raises BadFile for anything else than a table
        what = form.name if form else "a table of runs (name[unit] heads)"
        raise BadFile(
            f"{path} is {what}. It needs no import: gcs-autotune identify and diagnose read it. Logs are {FORMATS}"
        )
    return log, cut_runs(log)


def _labels(files: Sequence[Path]) -> list[str]:
    """Return a unique name for each file: its stem, with suffix or number if needed."""
    names = [p.stem for p in files]
    if len(set(names)) < len(names):
        names = [p.name for p in files]
    twice = {n for n in names if names.count(n) > 1}
    return [f"{name}-{i}" if name in twice else name for i, name in enumerate(names, start=1)]


def _print(data: dict[str, Any]) -> None:
    sys.stdout.write(json_text(data))


COMMAND = Command(
    description=f"Read {FORMATS}. Show their contents, or write their runs as CSV files. A run "
    "is a segment in which the vehicle is armed and stays in one mode. identify and diagnose also read logs directly.",
    add_arguments=_add_arguments,
    run=_run,
)
