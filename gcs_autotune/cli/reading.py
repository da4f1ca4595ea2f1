"""Options for reading recorded runs, common to every command that reads runs."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from gcs_autotune.cli.command import add_number
from gcs_autotune.errors import UsageError
from gcs_autotune.limits import finite
from gcs_autotune_files import clipped

if TYPE_CHECKING:
    from gcs_autotune.trial import Trial

__all__ = ["add_parameters", "add_reading", "add_runs", "full_scale", "read_others", "read_parameters", "read_runs"]


_STRETCH = re.compile("0*[1-9][0-9]{0,5}")
"""Largest segment number accepted. No log has a million segments."""


def add_runs(parser: argparse.ArgumentParser) -> None:
    """Add the positional argument for the runs to read."""
    parser.add_argument(
        "runs",
        nargs="*",
        type=Path,
        metavar="RUN",
        help="run directory, CSV file with column heads like psi[rad], telemetry log (.tlog), onboard log (.bin, "
        ".log), CSV of a log from Mission Planner or mavlogdump, PX4 ULog, MATLAB file or ROS bag",
    )


def add_reading(parser: argparse.ArgumentParser) -> None:
    """Add the options ``--pick``, ``--system-id``, ``--parameters``, ``--input``, ``--columns``, ``--full-scale``."""
    read = parser.add_argument_group("reading")
    read.add_argument("--pick", metavar="N[,N]", default="", help="segments of a log, by number (default: all)")
    add_number(read, "system-id", "ID", meaning="system id of the vehicle, if the .tlog contains several")
    add_parameters(read)
    read.add_argument(
        "--input",
        choices=("command", "speed"),
        default="command",
        help="inputs from a log: the commands to the actuators, or the shaft speeds that ESCs report (default command)",
    )
    read.add_argument(
        "--columns",
        metavar="OLD=NEW,...",
        default="",
        help="signal and unit of each column of a CSV file: t_sim=t[s],heading_deg=psi[deg],cmd=N",
    )
    read.add_argument(
        "--full-scale",
        metavar="X=F,N=F",
        default="",
        help="force [N] or moment [N m] at full output, for inputs recorded as normalised output (-1 to 1)",
    )


def add_parameters(group: argparse._ArgumentGroup) -> None:
    """Add the option ``--parameters``."""
    group.add_argument(
        "--parameters",
        type=Path,
        metavar="FILE",
        help="the vehicle's parameters (NAME,VALUE lines, as ground stations save them), for a log without them. "
        "The servo functions in them map outputs to inputs",
    )


def read_parameters(args: argparse.Namespace) -> dict[str, float] | None:
    """Return name -> value from the file of ``--parameters``; None without this option.

    Raises
    ------
    BadFile
        The file cannot be read.
    """
    if args.parameters is None:
        return None
    from gcs_autotune.mavlink import load_params

    return load_params(args.parameters)


def read_runs(args: argparse.Namespace) -> list[Trial]:
    """Return the runs on the command line. From logs, return the segments picked.

    Raises
    ------
    UsageError
        No run is named. DataError: a file cannot be used.
    """
    if not args.runs:
        raise UsageError(
            "no run given. Give a run directory, a log, or a CSV file with heads like t[s],psi[rad],N[N m]"
        )
    return _read(args, args.runs, _stretches(args.pick))


def read_others(args: argparse.Namespace, paths: Sequence[Path]) -> list[Trial]:
    """Return further runs, read in the same way, but without picking segments."""
    return _read(args, paths, ())


def _read(args: argparse.Namespace, paths: Sequence[Path], pick: tuple[int, ...]) -> list[Trial]:
    from gcs_autotune.logs import load_runs, parse_columns

    columns = parse_columns(args.columns) if args.columns else None
    given, full = read_parameters(args), full_scale(args.full_scale)
    return [
        trial.with_full_scale(full)
        for path in paths
        for trial in load_runs(
            path, pick=pick, system=args.system_id, columns=columns, parameters=given, by_speed=args.input == "speed"
        )
    ]


def full_scale(text: str) -> dict[str, float]:
    """Return force letter -> force or moment at full output [N or N m] from a text like ``X=8,N=0.17``."""
    found = {}
    for piece in text.split(",") if text else ():
        name, _, value = piece.strip().partition("=")
        try:
            found[name] = finite(value)
        except UsageError:
            found[name] = math.nan
        if len(name) != 1 or name not in "XYZKMN" or not 0.0 < found[name] < math.inf:
            raise UsageError(
                f"--full-scale {clipped(text)}: not a list of forces. Give the force [N] or moment [N m] at full "
                "output of each input, e.g. X=85,N=23"
            )
    return found


def _stretches(text: str) -> tuple[int, ...]:
    pieces = [piece.strip() for piece in text.split(",") if piece.strip()]
    if not all(_STRETCH.fullmatch(piece) for piece in pieces):
        raise UsageError(f"--pick {clipped(text)}: not a list of segment numbers. Numbers start at 1, e.g. --pick 2,3")
    return tuple(int(piece) for piece in pieces)
