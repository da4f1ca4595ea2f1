"""``gcs-autotune serve``: the tune on a page."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from gcs_autotune.cli.command import Command
from gcs_autotune.errors import UsageError
from gcs_autotune.untrusted_text import visible
from gcs_autotune_files import Refused, shown, whole

__all__ = ["COMMAND"]

EXTRA = ("starlette", "uvicorn", "websockets", "segno")
"""What the extra ``web`` brings."""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--host",
        metavar="ADDRESS",
        default="127.0.0.1",
        help="address to listen on (default 127.0.0.1: this machine only); with any other, 0.0.0.0 say, a token is "
        "needed to do more than look, and is shown as link and QR code",
    )
    parser.add_argument("--port", type=_port, default=8090, metavar="N", help="TCP port, 0: any (default 8090)")
    parser.add_argument(
        "--runs", type=Path, default=Path("runs"), metavar="DIR", help="where runs are kept (default runs)"
    )
    parser.add_argument(
        "--allow-host",
        action="append",
        default=[],
        metavar="NAME",
        help="a name by which browsers call this server, besides addresses, localhost and *.local; repeatable",
    )
    parser.add_argument(
        "--joystick-stop",
        action="store_true",
        help="offer Cockpit a STOP for a joystick button: whoever can look may then stop a run, and do nothing else",
    )


def _port(text: str) -> int:
    try:
        return whole(text, 65535)
    except Refused:
        raise argparse.ArgumentTypeError(f"{shown(text, 20)} is no port: 0 to 65535") from None


def _run(args: argparse.Namespace) -> int:
    try:
        from gcs_autotune.web import ServeSettings, serve
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in EXTRA:
            raise
        raise UsageError(
            f"the page needs {error.name}, which is not installed: pip install 'gcs-autotune[web]'"
        ) from None

    def say(text: str) -> None:
        sys.stderr.write(visible(text, keep="\n") + "\n")
        sys.stderr.flush()

    serve(ServeSettings(args.host, args.port, args.runs, tuple(args.allow_host), args.joystick_stop), say)
    return 0


COMMAND = Command(
    name="serve",
    help="a page to start runs on, watch them live and stop them (extra: web)",
    description="Serve one page: start a tune or an experiment, watch it, answer its questions, and STOP. The run is a "
    "process of its own: closing the page changes nothing about it, Ctrl-C here stops it and puts everything back.",
    add_arguments=_add_arguments,
    run=_run,
)
