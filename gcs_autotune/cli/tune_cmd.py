"""``gcs-autotune tune``: the whole journey."""

from __future__ import annotations

import argparse
import json
import math
import sys
from datetime import datetime
from pathlib import Path

from gcs_autotune.cli.command import Command, add_connection, add_envelope, add_output, envelope_from, label_of
from gcs_autotune.cli.console import ConsoleOperator

__all__ = ["COMMAND"]

DEFAULT_CONNECTIONS = {"heading": "sitl:charlie", "depth": "sitl:videoray"}
RESTORED = 8
"""Exit code: tuned, but the old gains proved better and are back."""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("axis", choices=sorted(DEFAULT_CONNECTIONS), help="the loop to tune")
    add_connection(parser)
    add_output(parser)
    parser.add_argument("--yes", action="store_true", help="answer every question with yes beforehand")
    parser.add_argument("--dry-run", action="store_true", help="fly, identify and design, but write nothing")
    parser.add_argument("--json", action="store_true", help="print the summary as JSON on standard output")
    fly = parser.add_argument_group("experiment (angles in deg, depths in m)")
    fly.add_argument("--step", type=float, help="size of the before/after step (default 30 deg or 1 m)")
    fly.add_argument("--step-duration", type=float, metavar="S", help="time given to each step (default 30 s)")
    fly.add_argument("--relay-output", type=float, metavar="C", help="relay output, fraction of full (default: found)")
    fly.add_argument("--relay-hysteresis", type=float, metavar="X_A", help="switching value (default: from the noise)")
    fly.add_argument("--throttle", type=float, help="fraction of full for boats (default: CRUISE_THROTTLE)")
    fly.add_argument("--speed", type=float, help="m/s during the steps, for boats (default: CRUISE_SPEED)")
    fly.add_argument("--control-rate", type=float, default=10.0, metavar="HZ", help="rate of our relay (default 10)")
    design = parser.add_argument_group("design")
    design.add_argument("--model", default="bessel", help="model function: bessel or butterworth (default bessel)")
    design.add_argument("--settling-time", type=float, metavar="S", help="wanted settling time")
    design.add_argument("--omega-0", type=float, metavar="RAD_S", help="wanted characteristic frequency")
    design.add_argument(
        "--structure", choices=("linear", "nonlinear", "affine"), help="drag (default: decided by data)"
    )
    design.add_argument("--delay", type=float, metavar="S", help="known input delay (default: looked for)")
    add_envelope(parser)


def _run(args: argparse.Namespace) -> int:
    from rich.console import Console

    from gcs_autotune.report import TerminalWatcher, show_tune, summarise
    from gcs_autotune.workflow import Connection, TuneSettings, tune

    now = datetime.now()
    uri = args.connect or DEFAULT_CONNECTIONS[args.axis]
    angular = args.axis == "heading"

    def inside(value: float | None) -> float | None:
        return math.radians(value) if angular and value is not None else value

    settings = TuneSettings(
        axis=args.axis,
        connection=Connection(uri, args.baud, args.system_id, args.source_system, args.seed),
        directory=args.out or Path("runs") / f"{now:%Y%m%d-%H%M%S}-{label_of(uri)}-{args.axis}",
        step=inside(args.step),
        step_duration=args.step_duration,
        relay_output=args.relay_output,
        relay_hysteresis=inside(args.relay_hysteresis),
        throttle=args.throttle,
        speed=args.speed,
        model=args.model,
        settling_time=args.settling_time,
        omega_0=args.omega_0,
        structure=args.structure,
        delay=args.delay,
        dry_run=args.dry_run,
        control_rate=args.control_rate,
        envelope=envelope_from(args),
    )
    operator = ConsoleOperator(yes=args.yes)
    with operator.listening(), TerminalWatcher(Console(stderr=True)) as watcher:
        story = tune(settings, operator, watcher, now.isoformat(timespec="seconds"))
    if args.json:
        sys.stdout.write(json.dumps(summarise(story), indent=1) + "\n")
    else:
        show_tune(Console(), story)
    return RESTORED if story.ending == "restored" else 0


COMMAND = Command(
    name="tune",
    help="swing the craft, identify it, design gains, prove them, keep or restore",
    description="Tune one loop of an ArduPilot boat or ROV: the present gains are flown first; the new ones stay "
    "only if the same step is followed better with them. Without --connect a simulated vehicle is used.",
    add_arguments=_add_arguments,
    run=_run,
)
