"""``gcs-autotune thrusters``: compute a thruster's map from a pull test, or a propeller's coefficients from an
open-water test."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from gcs_autotune.cli.command import Command, add_number
from gcs_autotune.cli.writing import put_out
from gcs_autotune.errors import UsageError
from gcs_autotune.limits import finite
from gcs_autotune_files import clipped

__all__ = ["COMMAND"]


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "file", type=Path, metavar="FILE", help="CSV file with column heads n[rpm],T[N] or pwm[us],T[kgf]"
    )
    parser.add_argument(
        "--command", dest="column", metavar="COLUMN", help="column of the command (default: n, command, pwm ...)"
    )
    parser.add_argument("--force", metavar="COLUMN", help="column of the force (default: T, force, thrust ...)")
    parser.add_argument(
        "--forces",
        metavar="F,F,...|LOG.csv",
        help="pull of each row [N], instead of a column. Or the log of a load cell (t[s], force[N]), matched by "
        "time to the levels of fly bollard-staircase",
    )
    add_number(parser, "neutral", "C")
    twin = parser.add_argument_group("two thrusters: columns n_1, n_2 (or pwm_1, pwm_2), X and optionally N, V_A")
    add_number(twin, "spacing", "M")
    water = parser.add_argument_group("open-water test: columns n, V_A, T and optionally Q")
    add_number(water, "diameter", "M")
    add_number(water, "density", "KG_M3")
    parser.add_argument("--json", action="store_true", help="print JSON on standard output")


def _run(args: argparse.Namespace) -> int:
    from gcs_autotune.report import propeller_document, thruster_document, twin_document
    from gcs_autotune.thrusters import (
        fit_bilinear,
        fit_open_water,
        fit_thruster,
        fit_twin,
        has_two_commands,
        pulls_from_log,
        read_columns,
        read_open_water,
        read_pull_test,
        read_twin_test,
    )

    if args.spacing is None and args.column is None and has_two_commands(args.file):
        raise UsageError(f"{args.file} has the commands of two thrusters. State their distance: --spacing M")
    if args.spacing is not None:
        document = twin_document(fit_twin(read_twin_test(args.file, neutral=args.neutral), args.spacing))
    elif args.diameter is not None or (args.column is None and "V_A" in read_columns(args.file)):
        test = read_open_water(args.file)
        found = fit_bilinear(test) if args.diameter is None else fit_open_water(test, args.diameter, rho=args.density)
        document = propeller_document(found)
    else:
        if args.forces is not None and args.forces.endswith(".csv"):
            pulls: list[float] | None
            pulls, offset = pulls_from_log(args.file, Path(args.forces), force=args.force)
            sys.stderr.write(
                f"Load cell clock offset from the vehicle's: {offset:+.1f} s, estimated from the levels.\n"
            )
        else:
            pulls = _pulls(args.forces)
        fit = fit_thruster(
            read_pull_test(args.file, command=args.column, force=args.force, pulls=pulls), neutral=args.neutral
        )
        document = thruster_document(fit)
    put_out(document, as_json=args.json)
    return 0


def _pulls(text: str | None) -> list[float] | None:
    """Parse ``0,1.2,4.8``."""
    if text is None:
        return None
    try:
        return [finite(piece) for piece in text.split(",")]
    except UsageError as error:
        raise UsageError(
            f"--forces {clipped(text)}: {error}. Give the pull of each row in newtons, separated by commas"
        ) from None


COMMAND = Command(
    description="Identify a thruster's force over command from a bollard pull test: coefficients ahead and astern, "
    "dead zone, and the inverse map. Or identify K_T(J), K_Q(J) and C_n, C_v of a propeller from an open-water test. "
    "Or identify the coefficients that two equal thrusters share, and the commands for a surge force and yaw moment.",
    add_arguments=_add_arguments,
    run=_run,
)
