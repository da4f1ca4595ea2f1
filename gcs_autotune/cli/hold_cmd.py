"""``gcs-autotune hold``: hold heading or depth with a controller of our own, from this computer."""

from __future__ import annotations

import argparse
import math
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from gcs_autotune.axes import AXES
from gcs_autotune.cli.command import (
    Command,
    add_connection,
    add_envelope,
    add_experiment,
    add_fetch_log,
    add_loudness,
    add_number,
    add_output,
    add_remote,
    check_axis_limits,
    check_model_file,
    check_output,
    connected,
    settings_of,
)
from gcs_autotune.cli.remote import attending
from gcs_autotune.cli.tune_cmd import FUNCTIONS
from gcs_autotune.cli.writing import put_out

if TYPE_CHECKING:
    from gcs_autotune.workflow import Connection

__all__ = ["COMMAND"]

HELD = {"heading": "heading", "depth": "depth", "line": "heading", "distance": "heading", "position": "heading"}
"""What can be held -> the axis that is identified for it; ``workflow.hold.TASKS`` has the tasks."""
EXAMPLES = {"distance": "sitl:videoray-lasers", "position": "sitl:bluerov2-sway"}
"""What is held -> the simulated vehicle used by default, where it is not that of the axis."""
POSITION = ("sliding", "pid")
"""Names of the position laws, listed here for the same reason."""
LAWS = ("direct", "indirect", "integral", "adaptive")
"""Names of the line laws, listed here because importing their table takes a second."""
OTHERWISE = 8
"""Exit code: flown, but the step did not follow its model function."""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("axis", choices=tuple(HELD), help="what to hold")
    add_connection(
        parser,
        otherwise="sitl:charlie for heading and line, sitl:videoray for depth, sitl:videoray-lasers for distance, "
        "sitl:bluerov2-sway for position",
    )
    add_output(parser)
    add_fetch_log(parser)
    parser.add_argument("--yes", action="store_true", help="answer yes to every question")
    add_loudness(parser)
    add_remote(parser)
    parser.add_argument("--json", action="store_true", help="print the result as JSON on standard output")
    flown = parser.add_argument_group("flight")
    add_number(flown, "step")
    add_number(flown, "step-duration", "S")
    add_number(flown, "for", "S")
    add_number(flown, "line-offset", "M")
    add_number(flown, "line-length", "M")
    add_number(flown, "approach", "DEG")
    add_number(flown, "apart", "M")
    add_number(flown, "distance-step", "M")
    flown.add_argument("--guidance", choices=LAWS, default=LAWS[0], help="law that follows a line (default direct)")
    flown.add_argument(
        "--law", choices=POSITION, default=POSITION[0], help="law that holds a position (default sliding)"
    )
    add_experiment(parser)
    design = parser.add_argument_group("controller")
    design.add_argument(
        "--model",
        type=Path,
        metavar="FILE|DIR",
        help="design from this model (of identify --save or diagnose) or the models of this run, without experiments "
        "in their motions",
    )
    add_number(design, "full-scale")
    design.add_argument("--function", choices=FUNCTIONS, default="bessel", help="model function (default bessel)")
    add_number(design, "omega-0", "RAD_S")
    add_envelope(parser)


def _run(args: argparse.Namespace) -> int:
    args.what, args.axis = args.axis, HELD[args.axis]
    check_axis_limits(args, ("step", "relay-hysteresis"))
    check_output(args)
    if args.model is not None and not args.model.is_dir():
        check_model_file(args.model)
    args.connect = args.connect or args.configured_link or None
    example = EXAMPLES.get(args.what, AXES[args.axis].example)
    with connected(args, args.connect or example) as connection:
        return _hold(args, connection)


def _hold(args: argparse.Namespace, connection: Connection) -> int:
    from gcs_autotune.report import hold_document
    from gcs_autotune.workflow import HoldSettings, TuneSettings, hold, load_models

    now = datetime.now()
    tune = settings_of(TuneSettings, args, connection, now, f"hold-{args.what}")
    settings = HoldSettings(
        args.what,
        tune,
        () if args.model is None else load_models(args.model),
        seconds=getattr(args, "for"),
        offset=args.line_offset,
        length=args.line_length,
        guidance=args.guidance,
        approach=math.radians(args.approach),
        apart=args.apart,
        distance_step=args.distance_step,
        law=args.law,
    )
    with attending(args) as (operator, observer):
        held = hold(settings, operator, observer, now.isoformat(timespec="seconds"))
    if not args.remote:  # else standard output is the program's
        put_out(hold_document(held), f"Report: {tune.directory / 'report.html'}", as_json=args.json)
    operator.ring()
    return 0 if held.follows else OTHERWISE


COMMAND = Command(
    description="Hold heading or depth with a controller of our own, which runs on this computer and drives the "
    "actuators in manual mode. The craft is identified by relays first, unless a model is supplied. No parameter is "
    "written. Without --connect a simulated vehicle is used.",
    add_arguments=_add_arguments,
    run=_run,
    everyday=(
        "connect",
        "for",
        "model",
        "law",
        "throttle",
        "step",
        "max-distance",
        "max-time",
        "yes",
        "out",
        "verbose",
        "json",
    ),
    examples=(
        ("gcs-autotune hold heading", "try it on a simulated boat"),
        ("gcs-autotune hold line --connect /dev/ttyUSB0", "follow a line ahead"),
        (
            "gcs-autotune hold depth --connect udpin:0.0.0.0:14550 --model runs/DEPTH",
            "an ROV with the model of an earlier run",
        ),
    ),
)
