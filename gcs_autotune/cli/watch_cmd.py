"""``gcs-autotune watch``: identify each log and compare it with the first one, with which the craft was tuned."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from gcs_autotune.cli.command import Command, add_loudness, add_number
from gcs_autotune.cli.reading import add_parameters, read_parameters
from gcs_autotune.errors import AutotuneError, NotInformative, UsageError
from gcs_autotune.plain_json import json_text
from gcs_autotune.untrusted_text import visible

if TYPE_CHECKING:
    from gcs_autotune.identify import AxisFit
    from gcs_autotune.trial import Trial

__all__ = ["COMMAND"]

DOFS = ("yaw", "surge", "heave")


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "logs",
        nargs="+",
        type=Path,
        metavar="LOG",
        help="logs of one craft, oldest first (.tlog, .bin, run directories, CSV files). The first is the reference",
    )
    parser.add_argument("--dof", choices=DOFS, help="degree of freedom to check (default: all that each log excites)")
    add_number(parser, "system-id", "ID", meaning="system id of the vehicle, in a .tlog with several")
    add_parameters(parser.add_argument_group("parameters"))
    parser.add_argument("--json", action="store_true", help="print JSON on standard output")
    add_loudness(parser)


def _run(args: argparse.Namespace) -> int:
    from gcs_autotune.diagnose import compare_craft
    from gcs_autotune.logs import load_runs

    if len(args.logs) < 2:
        raise UsageError("fewer than two logs given. Give the log of the tune first, then at least one later log")
    given = read_parameters(args)
    references: dict[str, AxisFit] = {}
    rows = []
    for path in args.logs:
        trials = load_runs(path, system=args.system_id, parameters=given)
        for dof in (args.dof,) if args.dof else DOFS:
            try:
                structure = references[dof].structure if dof in references else None
                fit = _identified(trials, dof, structure)
            except AutotuneError as error:
                if args.verbose:
                    sys.stderr.write(f"{visible(f'{path}, {dof}: {error}')}\n")
                continue
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


def _identified(trials: list[Trial], dof: str, structure: str | None) -> AxisFit:
    from typing import cast

    from gcs_autotune.identify import Structure, fit_axis
    from gcs_autotune.sname import DOFS as NAMES

    own = NAMES[dof]
    telling = [t for t in trials if own.force in t and (own.position in t or own.velocity in t)]
    if not telling:
        raise NotInformative(f"no run contains {own.force} together with {own.position} or {own.velocity}")
    return fit_axis(telling, dof=dof, structure=cast("Structure | None", structure))


COMMAND = Command(
    description="Identify a model from each log of a craft and report when inertia, drag, thrust or trim has left its "
    "interval (payload, fouling, a weak thruster). Causes have the names of `diagnose`. Every result exits with code "
    "0.",
    add_arguments=_add_arguments,
    run=_run,
)
