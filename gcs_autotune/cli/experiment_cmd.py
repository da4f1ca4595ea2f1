"""``gcs-autotune experiment``: swing and identify, change nothing."""

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

DEFAULT_CONNECTION = "sitl:videoray"


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("axis", choices=("heading", "depth", "surge"), help="what to swing")
    add_connection(parser, default=DEFAULT_CONNECTION)
    add_output(parser)
    parser.add_argument("--yes", action="store_true", help="answer the question with yes beforehand")
    parser.add_argument("--json", action="store_true", help="print the fit as JSON on standard output")
    fly = parser.add_argument_group("experiment (heading in deg, the rest in m)")
    fly.add_argument("--relay-output", type=float, metavar="C", help="relay output, fraction of full (default: found)")
    fly.add_argument("--relay-hysteresis", type=float, metavar="X_A", help="switching value (default: from the noise)")
    fly.add_argument("--throttle", type=float, help="fraction of full (default: cruise for boats, 0 for ROVs)")
    fly.add_argument("--speed", type=float, help="m/s about which surge swings (default: half of CRUISE_SPEED, 0)")
    fly.add_argument("--control-rate", type=float, default=10.0, metavar="HZ", help="rate of our relay (default 10)")
    fly.add_argument("--delay", type=float, metavar="S", help="known input delay (default: looked for)")
    fly.add_argument("--structure", choices=("linear", "nonlinear", "affine"), help="drag (default: decided by data)")
    add_envelope(parser)


def _run(args: argparse.Namespace) -> int:
    from rich.console import Console

    from gcs_autotune.report import TerminalWatcher, fit_summary
    from gcs_autotune.workflow import Connection, TuneSettings, experiment

    hysteresis = args.relay_hysteresis
    settings = TuneSettings(
        axis=args.axis,
        connection=Connection(args.connect, args.baud, args.system_id, args.source_system, args.seed),
        directory=args.out or Path("runs") / f"{datetime.now():%Y%m%d-%H%M%S}-{label_of(args.connect)}-{args.axis}",
        relay_output=args.relay_output,
        relay_hysteresis=math.radians(hysteresis) if args.axis == "heading" and hysteresis else hysteresis,
        throttle=args.throttle,
        speed=args.speed,
        structure=args.structure,
        delay=args.delay,
        control_rate=args.control_rate,
        envelope=envelope_from(args),
    )
    operator = ConsoleOperator(yes=args.yes)
    with operator.listening(), TerminalWatcher(Console(stderr=True)) as watcher:
        fit = experiment(settings, operator, watcher)
    if args.json:
        sys.stdout.write(json.dumps(fit.to_dict(), indent=1) + "\n")
    else:
        Console().print(fit_summary(fit))
        sys.stdout.write(f"Recorded in {settings.directory}\n")
    return 0


COMMAND = Command(
    name="experiment",
    help="swing the craft and identify it; write no parameter",
    description="Fly two self-oscillation experiments in one degree of freedom and identify it. No parameter is "
    "written. Without --connect a simulated vehicle is used.",
    add_arguments=_add_arguments,
    run=_run,
)
