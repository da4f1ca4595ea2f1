"""``gcs-autotune authority``: compute what a craft can do from its models, and the limits ArduPilot should have."""

from __future__ import annotations

import argparse
import shlex
from datetime import datetime
from pathlib import Path

from gcs_autotune.cli.command import Command, add_number, check_files, waiting
from gcs_autotune.cli.reading import add_parameters, full_scale, read_parameters
from gcs_autotune.cli.writing import on_replacing, page_file, put_out, write_page
from gcs_autotune.errors import UsageError

__all__ = ["COMMAND"]


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "models",
        nargs="+",
        type=Path,
        metavar="MODEL|RUN",
        help="model files (of identify --save, tune or diagnose) or run directories of one craft: a heading and a "
        "speed run, further heading runs at other speeds, or one coupled model",
    )
    add_number(parser, "throttle", meaning="working throttle (fraction of full throttle)", unset="CRUISE_THROTTLE")
    add_parameters(parser.add_argument_group("vehicle"))
    parser.add_argument(
        "--full-scale",
        metavar="X=F,N=F",
        default="",
        help="force [N] or moment [N m] at full output, for models whose inputs are not normalised",
    )
    parser.add_argument("--save", type=Path, metavar="FILE", help="write the proposed parameters (NAME,VALUE lines)")
    parser.add_argument("--page", type=page_file, metavar="FILE", help="write the report as a page")
    parser.add_argument("--json", action="store_true", help="print JSON on standard output")


def _run(args: argparse.Namespace) -> int:
    check_files(*args.models, args.parameters)
    with waiting(args, "computing the limits of the craft"):
        from gcs_autotune.design import limits_for
        from gcs_autotune.mavlink import save_params
        from gcs_autotune.report import authority_document
        from gcs_autotune.workflow import authority

        found = authority(
            args.models,
            parameters=read_parameters(args),
            full_scale=full_scale(args.full_scale),
            throttle=args.throttle,
        )
        limits = limits_for(found)
    if args.save is not None and not limits:
        raise UsageError("--save: these models determine no parameter. Give a heading and a speed run of a boat")
    document = authority_document(found, limits, f"{datetime.now():%Y-%m-%d %H:%M}")
    lines = []
    if args.save is not None:
        replaced = on_replacing(args.save)
        rules = "\n".join(f"{row.name}: {row.rule}" for row in limits)
        save_params(args.save, {row.name: row.value for row in limits}, comment=f"gcs-autotune authority\n{rules}")
        lines.append(
            f"Parameters: {args.save}{replaced}. To write them: gcs-autotune params restore "
            f"{shlex.quote(str(args.save))} --connect URI"
        )
    if args.page is not None:
        lines.append(write_page(document, args.page, *args.models, args.parameters, args.save))
    put_out(document, *lines, as_json=args.json)
    return 0


COMMAND = Command(
    description="Compute from identified models what a craft can do, with 95 % intervals: turning circle, turn rates, "
    "speeds, stopping distances, steerage limit, and what it can hold against. It proposes limits and motor "
    "parameters for ArduRover and lists what the models do not determine. Nothing is flown or written to a vehicle.",
    add_arguments=_add_arguments,
    run=_run,
)
