"""``gcs-autotune fly``: preview, announce and fly a manoeuvre or a plan, and evaluate it."""

from __future__ import annotations

import argparse
import sys
import textwrap
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from gcs_autotune.cli.command import (
    Command,
    add_connection,
    add_envelope,
    add_fetch_log,
    add_loudness,
    add_number,
    add_output,
    add_remote,
    check_model_file,
    check_output,
    connected,
    connection_of,
    settings_of,
    uri_of,
)
from gcs_autotune.cli.remote import attending
from gcs_autotune.cli.writing import put_out
from gcs_autotune.errors import UsageError
from gcs_autotune.limits import limit_of

if TYPE_CHECKING:
    from gcs_autotune.axes import AxisKind
    from gcs_autotune.workflow import CommonSettings, Connection, FlightPlan, FlightResult, Precision

__all__ = ["COMMAND", "add_flight", "run_flight"]

DEFAULT_CONNECTION = "sitl:charlie"
OPTIONS = (
    "heading", "rudder", "full-rudder", "steering", "executes", "turn", "levels", "astern", "duration", "f-start",
    "f-stop", "fade-in", "fade-out", "shortest", "push", "tilt", "set-point", "hysteresis", "second-set-point",
    "second-hysteresis", "wall-hysteresis", "least-distance", "ahead", "starboard", "heading-change", "depth",
    "wall-distance", "length-along", "apart",
)  # fmt: skip
"""Names of the options that manoeuvres have."""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "manoeuvre",
        nargs="?",
        metavar="NAME|PLAN.toml",
        help="what to fly: a name from --list, or a plan file",
    )
    parser.add_argument("--list", action="store_true", help="list the manoeuvres and their options")
    parser.add_argument(
        "--preview",
        action="store_true",
        help="plot the predicted track and show the time and space needed, without flying. Uses --model or the "
        "vehicle's parameters",
    )
    parser.add_argument(
        "--resume",
        type=Path,
        metavar="DIR",
        help="continue the plan in DIR without repeating completed runs. With --until: start from the runs in DIR",
    )
    parser.add_argument(
        "--until",
        metavar="PRECISION",
        help="identify after each run and fly the most informative manoeuvre next, until these relative standard "
        "errors are reached: 'N_r 5%%, Y_v 10%%'",
    )
    parser.add_argument(
        "--form",
        default="",
        help="with --until: degree of freedom or coupled form to identify (default: the smallest form with these "
        "parameters)",
    )
    add_number(parser, "total-time", "MIN", marked=True)
    add_connection(parser, otherwise=f"{DEFAULT_CONNECTION}; a --preview with --model needs none")
    add_output(parser)
    group = add_flight(parser, OPTIONS)
    group.add_argument("--first-to", choices=("starboard", "port"), default="starboard", help="side of the first turn")
    group.add_argument(
        "--force",
        choices=tuple("XYZKMN"),
        default="",
        help="force or moment to drive, for manoeuvres that offer the choice (default N)",
    )
    group.add_argument(
        "--points", default="", metavar="LIST", help="timed points of a trajectory: 's,m ahead,m to starboard ...'"
    )
    group.add_argument(
        "--model",
        type=Path,
        metavar="FILE|DIR",
        help="model file (written by identify --save), or models of a run, for the preview and for our own controllers",
    )
    add_number(group, "full-scale", "F")


def add_flight(parser: argparse.ArgumentParser, options: Sequence[str]) -> argparse._ArgumentGroup:
    """Add the *options* of a manoeuvre and those of every flight; return their group."""
    group = parser.add_argument_group("manoeuvre")
    for name in options:
        add_number(group, name, marked=True)
    for name, metavar in (("throttle", "X"), ("speed", "X"), ("control-rate", "HZ"), ("delay", "S"), ("patience", "S")):
        add_number(group, name, metavar)
    parser.add_argument(
        "--area",
        metavar="POLYGON|GEOJSON",
        help="area the craft must stay in: corners 'lat,lon lat,lon lat,lon' in degrees, or a GeoJSON file. The "
        "vehicle's own fence also applies",
    )
    parser.add_argument("--yes", action="store_true", help="answer yes to every question")
    add_fetch_log(parser)
    add_loudness(parser)
    add_remote(parser)
    parser.add_argument("--json", action="store_true", help="print figures and model as JSON on standard output")
    add_envelope(parser)
    return group


def _run(args: argparse.Namespace) -> int:
    if args.list:
        return _list()
    check_output(args)
    if args.until is None and (args.form or args.total_time is not None):
        raise UsageError(f"--{'form' if args.form else 'total-time'} needs --until. Add e.g. --until 'N_r 5%, Y_v 10%'")
    if args.manoeuvre is None and args.resume is None and args.until is None:
        raise UsageError("no manoeuvre given. See `gcs-autotune fly --list`")
    _verify_known(args)
    if args.model is not None and not args.model.is_dir():
        check_model_file(args.model)
    _precision(args)
    if args.preview and args.model is not None and args.connect is None:
        return _preview(args)
    return run_flight(args)


def _verify_known(args: argparse.Namespace) -> None:
    """Reject an unknown manoeuvre before the slow imports."""
    from gcs_autotune.manoeuvres import MANOEUVRES
    from gcs_autotune.registry import lookup

    if args.manoeuvre is not None and not args.manoeuvre.endswith(".toml"):
        lookup(MANOEUVRES, args.manoeuvre, "manoeuvre")


def run_flight(
    args: argparse.Namespace, otherwise: str = DEFAULT_CONNECTION, *, recheck: AxisKind | None = None
) -> int:
    """Open the link (default *otherwise*), fly, show the result and return the exit code. *recheck*: axis whose loop is
    evaluated.
    """
    check_output(args)
    with connected(args, uri_of(args, otherwise)) as connection:
        return _fly(args, connection) if recheck is None else _recheck(args, connection, recheck)


def _recheck(args: argparse.Namespace, connection: Connection, axis: AxisKind) -> int:
    """Fly over an open link and show the verdict on the loop of *axis*."""
    from gcs_autotune.report import recheck_document
    from gcs_autotune.workflow import recheck

    now = datetime.now()
    plan, common = _plan(args, connection, now, f"recheck-{axis.name}")
    with attending(args) as (operator, observer):
        when = now.isoformat(timespec="seconds")
        found = recheck(plan, axis, operator, observer, when, _runs(common.directory))
        if args.remote:
            observer.say(found.text)
    if args.remote:
        return 0
    page = common.directory / "report.html"
    put_out(recheck_document(found), f"Recorded in {common.directory}", f"Report: {page}", as_json=args.json)
    operator.ring()
    return 0


def _runs(directory: Path) -> Path:
    """Return the folder of earlier runs: the parent of *directory*, or ``runs``."""
    beside = directory.parent
    return beside if beside != Path() else Path("runs")


def _list() -> int:
    from gcs_autotune.manoeuvres import MANOEUVRES

    for kind in MANOEUVRES.values():
        excites = f"Excites {', '.join(sorted(kind.excites))}. " if kind.excites and kind.identifies else ""
        if kind.for_force and kind.is_alone:
            excites = "Excites the motion of the driven force. "
        options = (*(["force"] if kind.for_force else []), *kind.options)
        takes = f" Takes {', '.join(f'--{n}' for n in options)}." if options else ""
        how = takes if kind.is_alone else f" Flown by {kind.command}."
        text = f"{kind.help}. {excites}Space: {kind.room}.{how}"
        filled = textwrap.fill(text, 80, initial_indent="    ", subsequent_indent="    ", break_on_hyphens=False)
        sys.stdout.write(f"{kind.name}\n{filled}\n")
    return 0


def _precision(args: argparse.Namespace) -> Precision | None:
    """Return the precision required by ``--until``. It is parsed before anything is opened.

    Who limits the time of such a trial by ``--max-time`` means the whole trial, not each of its manoeuvres.
    """
    if args.until is None:
        return None
    from gcs_autotune.workflow import precision_of

    row, each = limit_of("total-time"), limit_of("max-time")
    minutes = row.default if args.total_time is None else args.total_time
    assert minutes is not None  # the table has a default
    seconds = minutes * row.factor
    if args.total_time is None and args.max_time != each.default:
        seconds = min(seconds, args.max_time * each.factor)
    return precision_of(args.until, args.form, seconds)


def _plan(
    args: argparse.Namespace, connection: Connection, now: datetime, label: str = ""
) -> tuple[FlightPlan, CommonSettings]:
    """Return the flight plan and the settings common to its runs. *label*: name for the run directory."""
    from gcs_autotune.logs import load_runs
    from gcs_autotune.manoeuvres import MANOEUVRES, read_area, read_points
    from gcs_autotune.registry import lookup
    from gcs_autotune.workflow import (
        PLAN_FILE,
        CommonSettings,
        FlightPlan,
        FlySettings,
        first_run,
        load_flight_plan,
        load_models,
    )

    until = _precision(args)
    goes_on = args.resume is not None and until is None
    what = str(args.resume / PLAN_FILE) if goes_on else str(args.manoeuvre or "")
    of_plan = what.endswith(".toml")
    typed = {name: value for name in OPTIONS if (value := getattr(args, name.replace("-", "_"))) is not None}
    if of_plan and (typed or args.force):
        raise UsageError(
            f"--{next(iter(typed), 'force')} does not apply to a plan. Set it in the plan file, under [defaults] or "
            f"[[run]]"
        )
    if of_plan and until is not None:
        raise UsageError(
            "--until does not apply to a plan, which lists all its runs. Use --until with one manoeuvre or without any"
        )
    common = settings_of(CommonSettings, args, connection, now, label or Path(what).stem or "trial")
    models = () if args.model is None else load_models(args.model)
    model, beside = (models[0], models[1:]) if models else (None, ())
    area = None if args.area is None else read_area(args.area)
    if of_plan:
        plan = load_flight_plan(Path(what), common, model, args.full_scale, beside)
        return (plan if area is None else replace(plan, area=area)), common
    axis = lookup(MANOEUVRES, what, "manoeuvre").of(args.force).axis if what else ""
    options = {name: value * limit_of(name, axis or "heading").factor for name, value in typed.items()}
    side = 1 if args.first_to == "starboard" else -1
    if until is None:
        points = read_points(args.points) if args.points else ()
        settings = FlySettings(
            what, common, options, side, model, args.full_scale, args.force, points=points, beside=beside
        )
        return replace(FlightPlan.of(settings), area=area), common
    first = (
        FlySettings(what, common, {}, side, model, args.full_scale, args.force) if what else first_run(until, common)
    )
    own = {name: value for name, value in options.items() if name in first.kind.options}
    settings = replace(first, options={**first.options, **own}, side=side)
    known = () if args.resume is None else tuple(load_runs(args.resume))
    return replace(FlightPlan.of(settings), area=area, until=until, options=options, known=known), common


def _preview(args: argparse.Namespace) -> int:
    from gcs_autotune.workflow import preview_of_model

    now = datetime.now()
    plan, common = _plan(args, connection_of(args, "model"), now)
    return _tell_preview(preview_of_model(plan, common, now.isoformat(timespec="seconds")))


def _tell_preview(result: FlightResult) -> int:
    put_out(result.document, f"Report: {result.page}")
    rejections = [run.rejection for run in result.runs if run.rejection]
    if rejections:
        raise UsageError(f"this manoeuvre would not be flown: {rejections[0]}")
    return 0


def _fly(args: argparse.Namespace, connection: Connection) -> int:
    """Fly over an open link and show the result."""
    from gcs_autotune.workflow import fly_plan

    now = datetime.now()
    plan, common = _plan(args, connection, now)
    with attending(args) as (operator, observer):
        when = now.isoformat(timespec="seconds")
        result = fly_plan(plan, common, operator, observer, when, only_preview=args.preview)
        if args.remote:  # standard output is the program's
            for remark in result.remarks:
                observer.say(remark)
    if args.remote:
        return 0
    if args.preview:
        return _tell_preview(result)
    lines = (f"Recorded in {common.directory}", f"Report: {result.page}")
    put_out(result.document, *lines, as_json=args.json)
    operator.ring()
    return 0


COMMAND = Command(
    description="Preview a manoeuvre, fly it within the safety limits, restore the vehicle, and compute "
    "figures and a model from the record. No parameter is written. Without --connect a simulated boat is used.",
    add_arguments=_add_arguments,
    run=_run,
    everyday=(
        "list",
        "preview",
        "connect",
        "throttle",
        "force",
        "area",
        "max-distance",
        "max-time",
        "resume",
        "yes",
        "out",
        "verbose",
        "json",
    ),
    examples=(
        ("gcs-autotune fly --list", "all manoeuvres, with their space and options"),
        ("gcs-autotune fly zig-zag --preview", "space and time, without flying"),
        ("gcs-autotune fly zig-zag --connect /dev/ttyUSB0 --throttle 0.5", "a zig-zag at half throttle"),
    ),
)
