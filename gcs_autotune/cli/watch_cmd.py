"""``gcs-autotune watch``: identify each log and compare it with the first one, with which the craft was tuned."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from gcs_autotune.cli.command import Command, add_loudness, add_number
from gcs_autotune.cli.reading import add_parameters, read_parameters
from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.plain_json import json_text
from gcs_autotune.untrusted_text import visible

if TYPE_CHECKING:
    from gcs_autotune.identify import AxisFit

__all__ = ["COMMAND"]

MOTIONS = ("yaw", "surge", "heave")
"""As ``workflow.COMPARED``, which is imported only when the command runs."""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "logs",
        nargs="+",
        type=Path,
        metavar="LOG",
        help="logs of one craft, oldest first (.tlog, .bin, run directories, CSV files). The first is the reference",
    )
    parser.add_argument(
        "--dof", choices=MOTIONS, help="degree of freedom to check (default: all that each log excites)"
    )
    add_number(parser, "system-id", "ID", meaning="system id of the vehicle, in a .tlog with several")
    add_parameters(parser.add_argument_group("parameters"))
    parser.add_argument("--json", action="store_true", help="print JSON on standard output")
    add_loudness(parser)


def _run(args: argparse.Namespace) -> int:
    from gcs_autotune.diagnose import compare_craft
    from gcs_autotune.logs import load_runs
    from gcs_autotune.workflow import COMPARED, fits_in

    if len(args.logs) < 2:
        raise UsageError("fewer than two logs given. Give the log of the tune first, then at least one later log")
    given = read_parameters(args)
    references: dict[str, AxisFit] = {}
    rows = []
    for path in args.logs:
        trials = load_runs(path, system=args.system_id, parameters=given)
        structures = {dof: fit.structure for dof, fit in references.items()}
        fits, reasons = fits_in(trials, structures, (args.dof,) if args.dof else COMPARED)
        if args.verbose:
            sys.stderr.writelines(f"{visible(f'{path}, {dof}: {why}')}\n" for dof, why in reasons.items())
        for dof, fit in fits.items():
            if dof not in references:
                references[dof] = fit
                rows.append({"log": str(path), "dof": dof, "told": "the reference", "changed": False})
            else:
                rows.append({"log": str(path), **compare_craft(references[dof], fit).to_dict()})
        if path == args.logs[0] and not references:
            raise NotInformative(
                f"nothing can be identified from the reference log {path}. Use --verbose to see the reasons"
            )
    if args.json:
        sys.stdout.write(json_text({"schema": 1, "rows": rows}))
        return 0
    for row in rows:
        sign = "!" if row["changed"] else " "
        sys.stdout.write(f"{sign} {visible(str(row['log']))}, {row['dof']}: {row['told']}\n")
    if not any(row["changed"] for row in rows):
        sys.stdout.write("No change: every parameter is within its interval.\n")
    return 0


COMMAND = Command(
    description="Identify a model from each log of a craft and report when inertia, drag, thrust or trim has left its "
    "interval (payload, fouling, a weak thruster). Causes have the names of `diagnose`. Every result exits with code "
    "0.",
    add_arguments=_add_arguments,
    run=_run,
)
