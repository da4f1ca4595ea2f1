"""``gcs-autotune design``: gains from a model at the desk, and the limit cycle of a relay before it is flown."""

from __future__ import annotations

import argparse
import math
import sys
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from gcs_autotune.axes import AXES
from gcs_autotune.cli.command import Command, add_number, check_axis_limits, check_files, waiting
from gcs_autotune.cli.hold_cmd import LAWS
from gcs_autotune.cli.tune_cmd import FUNCTIONS, STYLES, add_style, check_style
from gcs_autotune.cli.writing import fresh, on_replacing, page_file, put_out, write_page
from gcs_autotune.documents import SETTING_OUT, load_setting_out
from gcs_autotune.errors import BadFile, UsageError

if TYPE_CHECKING:
    from gcs_autotune.workflow import DeskSettings

__all__ = ["COMMAND"]

LOOPS = ("heading", "yaw", "speed", "depth", "line", "relay")
"""Names of ``workflow.desk_design.TASKS``, listed here because importing that takes a second."""
FIRMWARES = ("ardurover", "ardusub")
MOTIONS = {"yaw": "heading", "heave": "depth", "surge": "surge", "sway": "surge"}
"""Motions that a relay can excite -> the axis whose limits its hysteresis has."""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "model",
        type=Path,
        metavar="MODEL",
        help="model file of identify --save, tune or diagnose, the JSON output of identify, or a run directory",
    )
    parser.add_argument(
        "--for",
        choices=LOOPS,
        dest="loop",
        help="what to design: a loop, or relay for the limit cycle that a relay will cause (default: the loop that the "
        "run directory tuned)",
    )
    what = parser.add_argument_group("controller")
    what.add_argument(
        "--own",
        action="store_true",
        help="design the controller that `hold` flies (heading, depth), instead of the autopilot's; line is always own",
    )
    what.add_argument(
        "--firmware",
        choices=FIRMWARES,
        help="autopilot (default: that of the run or of --parameters, otherwise ardurover, for depth ardusub)",
    )
    what.add_argument(
        "--parameters",
        type=Path,
        metavar="FILE",
        help="the vehicle's present parameters (NAME,VALUE lines) (default: those of the run directory, or the "
        "firmware's defaults)",
    )
    what.add_argument(
        "--guidance", choices=LAWS, default=LAWS[0], help=f"law that follows a line (default {LAWS[0]}, as for `hold`)"
    )
    add_number(what, "approach", "DEG")
    craft = parser.add_argument_group("craft")
    add_number(craft, "full-scale", meaning="model input at full output, in the unit of the model, if not 1")
    add_number(
        craft,
        "speed",
        "M_S",
        meaning="speed at which a boat was identified",
        unset="that of the runs in the run directory; required for a model file",
    )
    add_number(craft, "throttle", meaning="throttle of a speed loop (fraction of full throttle)", unset="0.5")
    asked = parser.add_argument_group("specification (default: the best loop that keeps its margins)")
    add_style(asked)
    asked.add_argument("--function", choices=FUNCTIONS, default="bessel", help="model function (default bessel)")
    add_number(asked, "omega-0", "RAD_S")
    add_number(asked, "settling-time", "S")
    add_number(asked, "gain-margin")
    add_number(asked, "phase-margin", "DEG")
    add_number(asked, "step")
    relay = parser.add_argument_group("relay")
    relay.add_argument("--dof", choices=tuple(MOTIONS), help="degree of freedom of a relay (default yaw)")
    add_number(relay, "relay-output", "C")
    add_number(relay, "relay-hysteresis", "X_A")
    add_number(relay, "control-rate", "HZ")
    out = parser.add_argument_group("output")
    out.add_argument(
        "--page", type=page_file, metavar="FILE", help="file for the report page (default design-LOOP.html)"
    )
    out.add_argument("--no-page", action="store_true", help="write no report page")
    out.add_argument("--save", type=Path, metavar="FILE", help="write the autopilot's gains to FILE (.param)")
    out.add_argument(
        "--styles",
        type=Path,
        metavar="FILE",
        help="write nine designs from gentle to quick to FILE (.json), to compare them",
    )
    out.add_argument("--json", action="store_true", help="print JSON on standard output; no page unless --page")


def _run(args: argparse.Namespace) -> int:
    check_files(args.model, args.parameters)
    _check(args)
    with waiting(args, "starting"):
        from gcs_autotune.mavlink import save_params
        from gcs_autotune.report import DesignedGains, designed_document
        from gcs_autotune.workflow import DeskSettings, design_at_desk

    angular = AXES[args.axis].angular if args.axis in AXES else False

    def inside(value: float | None) -> float | None:
        return math.radians(value) if angular and value is not None else value

    settings = DeskSettings(
        source=args.model,
        loop=args.loop,
        own=args.own,
        firmware=args.firmware or "",
        parameters=args.parameters,
        full_scale=args.full_scale,
        speed=args.speed,
        throttle=args.throttle,
        step=inside(args.step),
        kind=args.function,
        style=args.style,
        omega_0=args.omega_0,
        settling_time=args.settling_time,
        gain_margin=args.gain_margin,
        phase_margin=None if args.phase_margin is None else math.radians(args.phase_margin),
        guidance=args.guidance,
        approach=math.radians(args.approach),
        dof=args.dof or "",
        relay_output=args.relay_output,
        relay_hysteresis=inside(args.relay_hysteresis),
        control_rate=args.control_rate,
    )
    if args.styles is not None:
        return _write_styles(settings, args.styles)
    with waiting(args, "designing"):
        designed = design_at_desk(settings)
    lines = []
    if args.save is not None:
        if not isinstance(designed, DesignedGains):
            raise UsageError("--save writes gains of the autopilot. A controller of our own runs with `hold --model`")
        lines.append(f"Gains: {args.save}{on_replacing(args.save)}")
        save_params(args.save, designed.values, comment=f"{args.loop} loop, designed from {designed.source}, not flown")
    document = designed_document(designed, datetime.now().isoformat(timespec="seconds"))
    if args.page is not None or not (args.no_page or args.json):
        page = args.page or fresh(Path(f"design-{args.loop}.html"))
        lines.append(write_page(document, page, args.model, args.parameters, args.save))
    put_out(document, *lines, as_json=args.json)
    return 0


def _write_styles(settings: DeskSettings, file: Path) -> int:
    """Write the designs from gentle to quick to *file*."""
    from gcs_autotune.plain_json import json_text
    from gcs_autotune.report import styles_compared
    from gcs_autotune.workflow import designs_of_styles

    compared, replaced = styles_compared(designs_of_styles(settings)), on_replacing(file)
    try:
        file.write_text(json_text(compared), encoding="utf-8")
    except OSError as error:
        raise BadFile(f"{file} cannot be written: {error.strerror}") from error
    sys.stdout.write(f"Designs from gentle to quick: {file}{replaced}\n")
    return 0


def _loop_of(source: Path) -> str:
    """Return the loop that the run directory at *source* tuned."""
    axis = load_setting_out(source).settings.get("axis") if (source / SETTING_OUT).is_file() else None
    if axis not in LOOPS:
        raise UsageError(f"add what to design: --for {', '.join(LOOPS[:-1])} or {LOOPS[-1]}")
    return str(axis)


def _check(args: argparse.Namespace) -> None:
    """Check that the options are consistent, before the slow imports."""
    args.loop = args.loop or _loop_of(args.model)
    args.axis = MOTIONS[args.dof or "yaw"] if args.loop == "relay" else "heading" if args.loop == "line" else args.loop
    if args.loop == "relay":
        check_axis_limits(args, ("relay-hysteresis",))
    else:
        check_axis_limits(args, ("step",))
        wrong = next((n for n in ("dof", "relay_output", "relay_hysteresis") if getattr(args, n) is not None), "")
        if wrong:
            raise UsageError(f"--{wrong.replace('_', '-')} applies only to --for relay")
    if args.omega_0 is not None and args.settling_time is not None:
        raise UsageError("use either --omega-0 or --settling-time, not both")
    check_style(args)
    if args.styles is not None:
        others = (args.own, args.loop in ("line", "relay"), args.save, args.json, args.omega_0, args.settling_time)
        if any(others) or args.style != STYLES[0]:
            raise UsageError(
                "--styles compares the styles of a loop of the autopilot. Use it without --own, --save, --json, "
                "--style, --omega-0 and --settling-time"
            )
    if args.save is not None and (args.own or args.loop in ("line", "relay")):
        raise UsageError("--save writes gains of the autopilot. Leave it out for a relay or a controller of our own")


COMMAND = Command(
    description="Design gains for a loop of ArduPilot, or for a controller of our own, from a model. It prints gains, "
    "closed-loop poles, margins, and the step and the disturbance response over the 95 % region of the model. With "
    "--for relay it predicts the limit cycle of a relay. Nothing is written to a vehicle.",
    add_arguments=_add_arguments,
    run=_run,
    everyday=(
        "for",
        "own",
        "parameters",
        "settling-time",
        "omega-0",
        "gain-margin",
        "phase-margin",
        "speed",
        "save",
        "page",
        "json",
    ),
    examples=(
        ("gcs-autotune design runs/NAME", "gains from the model of a run"),
        ("gcs-autotune design boat.json --for speed --save boat.param", "gains as a parameter file"),
        ("gcs-autotune design boat.json --for relay --dof yaw", "the limit cycle of a relay"),
    ),
)
