"""``gcs-autotune identify``: a model from a recorded run."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Literal

from gcs_autotune.cli.command import Command
from gcs_autotune.errors import UsageError
from gcs_autotune.sname import DOFS

__all__ = ["COMMAND"]


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "runs", nargs="+", type=Path, metavar="RUN", help="a run directory, CSV files with name[unit] heads, .tlog or .bin logs"
    )
    parser.add_argument("--dof", choices=sorted(DOFS), help="degree of freedom (default: from the columns)")
    parser.add_argument(
        "--structure", choices=("linear", "nonlinear", "affine"), help="drag (default: decided by data)"
    )
    parser.add_argument("--method", default="output-error", help="output-error (default) or iso")
    parser.add_argument("--delay", type=float, metavar="S", help="known input delay (default: looked for)")
    parser.add_argument("--pick", metavar="N[,N]", default="", help="stretches of a log to use, by number (default: all)")
    parser.add_argument("--system-id", type=int, metavar="ID", help="the vehicle, in a .tlog that heard several")
    parser.add_argument(
        "--columns",
        metavar="OLD=NEW[UNIT],...",
        default="",
        help="what a file's own column names mean, e.g. t_sim=t[s],heading_deg=psi[deg],cmd=N",
    )
    parser.add_argument("--json", action="store_true", help="print JSON on standard output")


def _run(args: argparse.Namespace) -> int:
    from rich.console import Console

    from gcs_autotune.identify import fit_axis
    from gcs_autotune.logs import load_runs, parse_columns
    from gcs_autotune.report import fit_summary

    columns = parse_columns(args.columns) if args.columns else None
    pick = _numbers(args.pick)
    trials = [
        trial
        for path in args.runs
        for trial in load_runs(path, pick=pick, system=args.system_id, columns=columns)
    ]
    delay: float | Literal["auto"] = "auto" if args.delay is None else float(args.delay)
    fit = fit_axis(trials, dof=args.dof, structure=args.structure, delay=delay, method=args.method)
    if args.json:
        sys.stdout.write(json.dumps(fit.to_dict(), indent=1) + "\n")
    else:
        Console().print(fit_summary(fit))
    return 0


def _numbers(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(piece) for piece in text.split(",") if piece.strip())
    except ValueError:
        raise UsageError(f"--pick {text}: give the numbers of stretches, e.g. --pick 2,3") from None


COMMAND = Command(
    name="identify",
    help="identify inertia, drag and constant force from a recorded run",
    description="Identify one degree of freedom, alpha*nu_dot + (beta + beta_nn*|nu|)*nu = tau + delta, from a run "
    "directory, CSV files with columns like t[s], psi[rad], r[rad/s], N[N m], telemetry logs (.tlog) or logs on board "
    "(.bin).",
    add_arguments=_add_arguments,
    run=_run,
)
