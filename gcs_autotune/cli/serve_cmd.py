"""``gcs-autotune serve``: run a tune from a web page."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from gcs_autotune.cli.command import Command
from gcs_autotune.cli.config_file import find_config, read_config
from gcs_autotune.errors import UsageError
from gcs_autotune.untrusted_text import visible
from gcs_autotune_files import Refused, shown, whole

__all__ = ["COMMAND"]

EXTRA = ("starlette", "uvicorn", "websockets", "segno")
"""Packages installed by the extra ``web``."""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--host",
        metavar="ADDRESS",
        default="127.0.0.1",
        help="address to listen on (default 127.0.0.1: this computer only). At any other address, e.g. 0.0.0.0, "
        "viewing is open and everything else needs a token, shown as link and QR code",
    )
    parser.add_argument(
        "--port", type=_port, default=8090, metavar="N", help="TCP port, or 0 for any free port (default 8090)"
    )
    parser.add_argument(
        "--runs", type=Path, default=Path("runs"), metavar="DIR", help="folder of the runs (default runs)"
    )
    parser.add_argument(
        "--allow-host",
        action="append",
        default=[],
        metavar="NAME",
        help="further host name of this server (addresses, localhost and *.local are always accepted); repeatable",
    )
    parser.add_argument(
        "--joystick-stop",
        action="store_true",
        help="offer Cockpit a STOP for a joystick button. Every viewer can then stop a run, and nothing else",
    )


def _port(text: str) -> int:
    try:
        return whole(text, 65535)
    except Refused:
        raise argparse.ArgumentTypeError(f"{shown(text, 20)} is not a TCP port. Use 0 to 65535") from None


def _run(args: argparse.Namespace) -> int:
    try:
        from gcs_autotune.web import ServeSettings, serve
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in EXTRA:
            raise
        raise UsageError(
            f"the page needs {error.name}, which is not installed. Run pip install 'gcs-autotune[web]'"
        ) from None

    def say(text: str) -> None:
        sys.stderr.write(visible(text, keep="\n") + "\n")
        sys.stderr.flush()

    config = read_config(find_config())
    preset = {**config.values, "craft": config.crafts}
    serve(ServeSettings(args.host, args.port, args.runs, tuple(args.allow_host), args.joystick_stop, preset), say)
    return 0


COMMAND = Command(
    description="Serve a web page that starts a tune or an experiment, shows it live, asks its questions, and has a "
    "STOP button. Closing the page does not end the run. Ctrl-C here stops the run and restores the vehicle.",
    add_arguments=_add_arguments,
    run=_run,
)
