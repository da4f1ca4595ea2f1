"""``gcs-autotune experiment``: fly relay experiments and identify a model. No parameter is written."""

from __future__ import annotations

import argparse
from datetime import datetime
from typing import TYPE_CHECKING

from gcs_autotune.axes import AXES, OTHER_NAMES, axis_kind
from gcs_autotune.cli.command import (
    Command,
    add_connection,
    add_envelope,
    add_experiment,
    add_fetch_log,
    add_loudness,
    add_output,
    add_pull_test,
    add_remote,
    check_axis_limits,
    check_files,
    check_output,
    connected,
    pull_test_of,
    settings_of,
    uri_of,
)
from gcs_autotune.cli.remote import attending
from gcs_autotune.cli.writing import put_out
from gcs_autotune.errors import UsageError

if TYPE_CHECKING:
    from gcs_autotune.workflow import Connection

__all__ = ["COMMAND"]

DEFAULT_CONNECTION = "sitl:videoray"


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("axis", choices=(*AXES, *OTHER_NAMES), help="degree of freedom to identify")
    add_connection(parser, otherwise=DEFAULT_CONNECTION)
    add_output(parser)
    add_fetch_log(parser)
    parser.add_argument("--yes", action="store_true", help="answer yes to every question")
    add_loudness(parser)
    add_remote(parser)
    parser.add_argument("--json", action="store_true", help="print the fit as JSON on standard output")
    add_experiment(parser)
    add_pull_test(parser)
    add_envelope(parser)


def _run(args: argparse.Namespace) -> int:
    check_axis_limits(args, ("relay-hysteresis",))
    check_output(args)
    check_files(args.pull_test)
    if args.pull_test is not None and not axis_kind(args.axis).excitation.by_throttle:
        raise UsageError(f"--pull-test is for `experiment surge`, not for {args.axis}. Remove it")
    with connected(args, uri_of(args, DEFAULT_CONNECTION)) as connection:
        return _experiment(args, connection)


def _experiment(args: argparse.Namespace, connection: Connection) -> int:
    """Fly and identify over an open link, and show the result."""
    from gcs_autotune.report import fit_document
    from gcs_autotune.workflow import TuneSettings, experiment

    now = datetime.now()
    settings = settings_of(TuneSettings, args, connection, now, pull_test=pull_test_of(args))
    with attending(args) as (operator, observer):
        fit = experiment(settings, operator, observer, now.isoformat(timespec="seconds"))
    if not args.remote:  # else standard output is the program's
        page = settings.directory / "report.html"
        put_out(fit_document(fit), f"Recorded in {settings.directory}", f"Report: {page}", as_json=args.json)
    operator.ring()
    return 0


COMMAND = Command(
    description="Fly two relay experiments in one degree of freedom and identify its model. No parameter is written. "
    "Without --connect a simulated vehicle is used.",
    add_arguments=_add_arguments,
    run=_run,
    everyday=(
        "connect",
        "throttle",
        "relay-output",
        "relay-hysteresis",
        "max-distance",
        "max-time",
        "yes",
        "out",
        "verbose",
        "json",
    ),
    examples=(
        ("gcs-autotune experiment heading", "try it on a simulated boat"),
        ("gcs-autotune experiment surge --connect /dev/ttyUSB0", "the speed of a boat"),
    ),
)
