"""``gcs-autotune fly``: one manoeuvre of the table, previewed, announced, flown, read."""

from __future__ import annotations

import argparse
import json
import sys
import textwrap
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from gcs_autotune.cli.command import (
    Command,
    add_connection,
    add_envelope,
    add_number,
    add_output,
    add_quiet,
    connected,
    connection_of,
    envelope_from,
    run_directory,
    see_model_file,
)
from gcs_autotune.cli.console import ConsoleOperator
from gcs_autotune.errors import UsageError
from gcs_autotune.limits import limit_of

if TYPE_CHECKING:
    from gcs_autotune.workflow import Connection, FlySettings

__all__ = ["COMMAND"]

DEFAULT_CONNECTION = "sitl:charlie"
OPTIONS = (
    "heading", "rudder", "full-rudder", "steering", "executes", "turn", "levels", "astern", "duration", "f-start",
    "f-stop", "fade-in", "fade-out", "shortest", "push",
)  # fmt: skip
"""What one manoeuvre or another takes."""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("manoeuvre", nargs="?", metavar="NAME", help="what to fly, a name that --list tells")
    parser.add_argument("--list", action="store_true", help="tell the manoeuvres there are, and what each takes")
    parser.add_argument(
        "--preview",
        action="store_true",
        help="only draw the predicted track and tell time and room, by --model or the vehicle's own figures",
    )
    add_connection(parser, otherwise=f"{DEFAULT_CONNECTION}; none for a --preview with --model")
    add_output(parser)
    group = parser.add_argument_group("manoeuvre")
    for name in OPTIONS:
        add_number(group, name, marked=True)
    group.add_argument("--first-to", choices=("starboard", "port"), default="starboard", help="the side it begins to")
    group.add_argument(
        "--force", choices=tuple("XYZKMN"), default="", help="the force driven, of those that take any (default N)"
    )
    for name, metavar in (("throttle", "X"), ("speed", "X"), ("control-rate", "HZ"), ("delay", "S"), ("patience", "S")):
        add_number(group, name, metavar)
    group.add_argument("--model", type=Path, metavar="FILE", help="model file to preview with, as identify writes them")
    add_number(group, "full-scale", "F")
    parser.add_argument("--yes", action="store_true", help="answer the question with yes beforehand")
    add_quiet(parser)
    parser.add_argument("--json", action="store_true", help="print figures and model as JSON on standard output")
    add_envelope(parser)


def _run(args: argparse.Namespace) -> int:
    if args.list:
        return _list()
    if args.manoeuvre is None:
        raise UsageError("say what to fly; `gcs-autotune fly --list` tells what there is")
    see_model_file(args.model)
    if args.preview and args.model is not None and args.connect is None:
        return _preview(args)
    with connected(args, args.connect or DEFAULT_CONNECTION) as connection:
        return _fly(args, connection)


def _list() -> int:
    from gcs_autotune.manoeuvres import MANOEUVRES

    for kind in MANOEUVRES.values():
        tells = f"Tells about {', '.join(sorted(kind.excites))}. " if kind.excites and kind.identifies else ""
        if kind.for_force:
            tells = "Tells about what is driven. "
        options = (*(["force"] if kind.for_force else []), *kind.options)
        how = f"takes {', '.join(f'--{n}' for n in options)}" if kind.make else f"flown by {kind.command}"
        text = f"{kind.help}. {tells}Room: {kind.room}; {how}."
        sys.stdout.write(f"{kind.name}\n{textwrap.fill(text, 80, initial_indent='    ', subsequent_indent='    ')}\n")
    return 0


def _settings(args: argparse.Namespace, connection: Connection, now: datetime) -> FlySettings:
    from gcs_autotune.identify.model_file import load_model
    from gcs_autotune.workflow import FlySettings, TuneSettings

    typed = {name: getattr(args, name.replace("-", "_")) for name in OPTIONS}
    return FlySettings(
        args.manoeuvre,
        TuneSettings(
            axis="heading",
            connection=connection,
            directory=run_directory(args, connection.uri, now, str(args.manoeuvre)),
            throttle=args.throttle,
            speed=args.speed,
            delay=args.delay,
            control_rate=args.control_rate,
            patience=args.patience,
            envelope=envelope_from(args),
        ),
        {name: value * limit_of(name).factor for name, value in typed.items() if value is not None},
        side=1 if args.first_to == "starboard" else -1,
        model=None if args.model is None else load_model(args.model),
        full_scale=args.full_scale,
        force=args.force,
    )


def _preview(args: argparse.Namespace) -> int:
    from gcs_autotune.workflow import preview_of_model

    now = datetime.now()
    settings = _settings(args, connection_of(args, "model"), now)
    seen = preview_of_model(settings, now.isoformat(timespec="seconds"))
    return _tell_preview(seen.preview.told(), seen.preview.trouble, seen.page)


def _tell_preview(told: str, trouble: str, page: Path | None) -> int:
    sys.stdout.write(f"Predicted: {told}\nDrawn in {page}\n")
    if trouble:
        raise UsageError(f"it had better not be flown so: {trouble}")
    return 0


def _fly(args: argparse.Namespace, connection: Connection) -> int:
    """Fly over a link that is open, and tell of it."""
    from rich.console import Console

    from gcs_autotune.report import TerminalWatcher, fit_summary, sheets_summary
    from gcs_autotune.workflow import fly

    now = datetime.now()
    settings = _settings(args, connection, now)
    operator = ConsoleOperator(yes=args.yes, bell=not args.quiet)
    with operator.listening(), TerminalWatcher(Console(stderr=True)) as watcher:
        result = fly(settings, operator, watcher, now.isoformat(timespec="seconds"), only_preview=args.preview)
    if args.preview:
        return _tell_preview(result.preview.told(), result.preview.trouble, result.page)
    if args.json:
        plain = {"sheets": [s.to_dict() for s in result.sheets], "fit": result.fit.to_dict() if result.fit else None}
        sys.stdout.write(json.dumps(plain, indent=1) + "\n")
    else:
        console = Console()
        if result.sheets:
            console.print(sheets_summary(result.sheets))
        if result.fit is not None:
            console.print(fit_summary(result.fit))
        for remark in result.remarks:
            sys.stdout.write(f"{remark}\n")
        sys.stdout.write(f"Recorded in {settings.common.directory}\nReport: {result.page}\n")
    operator.ring()
    return 0


COMMAND = Command(
    name="fly",
    help="fly a standard manoeuvre (zig-zag, circle, steps ...), its preview before, figures and model after",
    description="Preview a manoeuvre, say what will be done, fly it inside the safety limits, put everything back, and "
    "read figures and model off the record. No parameter is written. Without --connect a simulated boat is used.",
    add_arguments=_add_arguments,
    run=_run,
)
