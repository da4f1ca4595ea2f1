"""``gcs-autotune aboard``: a script on the autopilot flies the experiments, for a link too slow to fly them."""

from __future__ import annotations

import argparse
from datetime import datetime
from typing import TYPE_CHECKING

from gcs_autotune.cli.command import (
    Command,
    add_connection,
    add_envelope,
    add_loudness,
    add_number,
    add_output,
    add_remote,
    check_axis_limits,
    check_output,
    connected,
    settings_of,
    uri_of,
)
from gcs_autotune.cli.remote import attending
from gcs_autotune.cli.writing import put_out

if TYPE_CHECKING:
    from gcs_autotune.workflow import Connection

__all__ = ["COMMAND"]


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("axis", choices=("heading", "depth"), help="degree of freedom to identify")
    add_connection(parser)
    add_output(parser)
    parser.add_argument("--yes", action="store_true", help="answer yes to every question")
    add_loudness(parser)
    add_remote(parser)
    parser.add_argument("--json", action="store_true", help="print the fit as JSON on standard output")
    group = parser.add_argument_group("experiment")
    for name, metavar in (("relay-output", "C"), ("relay-hysteresis", "X_A"), ("throttle", "X"), ("speed", "X")):
        add_number(group, name, metavar)
    for name in ("delay", "patience", "silence"):
        add_number(group, name, "S")
    group.add_argument(
        "--structure",
        choices=("linear", "nonlinear", "affine"),
        help="damping of the model: linear, nonlinear (quadratic) or affine (both) (default: chosen from the data)",
    )
    add_envelope(parser)


def _run(args: argparse.Namespace) -> int:
    check_axis_limits(args, ("relay-hysteresis",))
    check_output(args)
    with connected(args, uri_of(args)) as connection:
        return _aboard(args, connection)


def _aboard(args: argparse.Namespace, connection: Connection) -> int:
    """Have it flown over an open link, and show the result."""
    from gcs_autotune.report import fit_document
    from gcs_autotune.workflow import AboardSettings, TuneSettings, fly_aboard

    now = datetime.now()
    settings = settings_of(TuneSettings, args, connection, now)
    with attending(args) as (operator, observer):
        fit = fly_aboard(AboardSettings(settings, args.silence), operator, observer, now.isoformat(timespec="seconds"))
    if not args.remote:  # else standard output is the program's
        page = settings.directory / "report.html"
        put_out(fit_document(fit), f"Recorded in {settings.directory}", f"Report: {page}", as_json=args.json)
    operator.ring()
    return 0


COMMAND = Command(
    description="Upload a Lua script that flies two relays and a step on the autopilot itself, fetch its log and "
    "identify the model. For links too slow for `experiment`. Needs scripting (SCR_ENABLE 1) and MAVLink FTP. The "
    "script is removed and all parameters are restored at the end.",
    add_arguments=_add_arguments,
    run=_run,
)
