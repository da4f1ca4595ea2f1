"""``gcs-autotune sitl``: run a simulated vehicle in its own process."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections.abc import Sequence

from gcs_autotune.cli.command import Command

__all__ = ["COMMAND", "hand_over"]


def hand_over(arguments: Sequence[str]) -> int:
    """Run ``python -m sitl`` with *arguments* and return its exit code.

    The simulator is a separate program with its own options. The two packages communicate only over the link. If the
    system allows it, the simulator replaces this process, so that one signal ends both.
    """
    command = [sys.executable, "-m", "sitl", *arguments]
    if os.name == "posix":
        os.execv(command[0], command)
    process = subprocess.Popen(command)
    while True:
        try:
            return process.wait()
        except KeyboardInterrupt:  # it ends by itself: it is on the same console
            continue


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("arguments", nargs=argparse.REMAINDER, metavar="...", help="see `gcs-autotune sitl --help`")


def _run(args: argparse.Namespace) -> int:
    return hand_over(args.arguments)


COMMAND = Command(
    description="Run a simulated vehicle (`--list` lists them), or simulate only its hull for the real ArduPilot.",
    add_arguments=_add_arguments,
    run=_run,
)
