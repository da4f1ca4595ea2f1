"""``gcs-autotune identify``: a model from a recorded run."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Literal

from gcs_autotune.cli.command import Command
from gcs_autotune.sname import DOFS

__all__ = ["COMMAND"]


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "runs", nargs="+", type=Path, metavar="RUN", help="a run directory, or CSV files with name[unit] heads"
    )
    parser.add_argument("--dof", choices=sorted(DOFS), help="degree of freedom (default: from the columns)")
    parser.add_argument(
        "--structure", choices=("linear", "nonlinear", "affine"), help="drag (default: decided by data)"
    )
    parser.add_argument("--method", default="output-error", help="output-error (default) or iso")
    parser.add_argument("--delay", type=float, metavar="S", help="known input delay (default: looked for)")
    parser.add_argument("--json", action="store_true", help="print JSON on standard output")


def _run(args: argparse.Namespace) -> int:
    from rich.console import Console

    from gcs_autotune.identify import fit_axis, load_runs
    from gcs_autotune.report import fit_summary

    trials = [trial for path in args.runs for trial in load_runs(path)]
    delay: float | Literal["auto"] = "auto" if args.delay is None else float(args.delay)
    fit = fit_axis(trials, dof=args.dof, structure=args.structure, delay=delay, method=args.method)
    if args.json:
        sys.stdout.write(json.dumps(fit.to_dict(), indent=1) + "\n")
    else:
        Console().print(fit_summary(fit))
    return 0


COMMAND = Command(
    name="identify",
    help="identify inertia, drag and constant force from a recorded run",
    description="Identify one degree of freedom, alpha*nu_dot + (beta + beta_nn*|nu|)*nu = tau + delta, from a run "
    "directory or CSV files with columns like t[s], psi[rad], r[rad/s], N[N m].",
    add_arguments=_add_arguments,
    run=_run,
)
