"""The command line: one table of commands, one table of exit codes."""

from __future__ import annotations

import argparse
import gc
import os
import re
import sys
import traceback
from collections.abc import Mapping, Sequence
from typing import NoReturn

from gcs_autotune import __version__
from gcs_autotune.cli import (
    completion_cmd,
    diagnose_cmd,
    doctor_cmd,
    experiment_cmd,
    export_cmd,
    figures_cmd,
    fly_cmd,
    identify_cmd,
    logs_cmd,
    params_cmd,
    recheck_cmd,
    restore_cmd,
    serve_cmd,
    sitl_cmd,
    thrusters_cmd,
    tune_cmd,
    watch_cmd,
)
from gcs_autotune.cli.command import Command
from gcs_autotune.cli.config_file import NO_CONFIG, ConfigFile, find_config, read_config, shown_value
from gcs_autotune.cli.tune_cmd import tune_settings
from gcs_autotune.errors import EXIT_CODES, AutotuneError, OperatorStopped, UsageError, exit_code
from gcs_autotune.registry import nearest_of
from gcs_autotune.untrusted_text import visible

__all__ = ["COMMANDS", "find_config", "main", "make_parser", "read_config", "tune_settings"]

COMMANDS: Mapping[str, Command] = {
    c.name: c
    for c in (
        tune_cmd.COMMAND,
        identify_cmd.COMMAND,
        diagnose_cmd.COMMAND,
        figures_cmd.COMMAND,
        experiment_cmd.COMMAND,
        fly_cmd.COMMAND,
        recheck_cmd.COMMAND,
        watch_cmd.COMMAND,
        thrusters_cmd.COMMAND,
        logs_cmd.COMMAND,
        export_cmd.COMMAND,
        params_cmd.COMMAND,
        restore_cmd.COMMAND,
        serve_cmd.COMMAND,
        sitl_cmd.COMMAND,
        doctor_cmd.DOCTOR,
        doctor_cmd.PORTS,
        completion_cmd.COMMAND,
    )
}
"""Verb -> command; adding one is one file and one line."""

YOUNG = 20_000
"""Number of new objects before the garbage collector runs; chosen."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    # Before NumPy is imported. Our matrices are small: a second thread wins nothing on an idle machine, and beside
    # other programs (a ground station, a simulator) the two wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if arguments[:1] == [sitl_cmd.COMMAND.name]:
        return sitl_cmd.hand_over(arguments[1:])
    args = None
    # What is imported stays: by Python's own threshold (700 objects) the collector would look at it 600 times.
    usual = gc.get_threshold()
    gc.set_threshold(YOUNG, *usual[1:])
    try:
        config = read_config(find_config())
        args = make_parser(config).parse_args(arguments)
        if used := config.used_by(args):
            told = ", ".join(f"{name} {shown_value(value)}" for name, value in used.items())
            sys.stderr.write(f"{visible(f'settings of {config.path}: {told}')}\n")
        code = COMMANDS[args.command].run(args)
        sys.stdout.flush()
        return code
    except AutotuneError as error:
        if getattr(args, "verbose", False):
            traceback.print_exc()
        sys.stderr.write(f"gcs-autotune: {visible(str(error))}\n")
        return exit_code(error)
    except KeyboardInterrupt:  # at the desk: what flies takes signals itself, and cleans up
        if getattr(args, "verbose", False):
            traceback.print_exc()
        sys.stderr.write("\ngcs-autotune: ended by Ctrl-C\n")
        return exit_code(OperatorStopped())
    except BrokenPipeError:  # who reads standard output has had enough (`| head`)
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return exit_code(AutotuneError())
    finally:
        gc.set_threshold(*usual)


class _Parser(argparse.ArgumentParser):
    """Parser whose errors are one sentence, like every other error, and point to ``--help``."""

    def error(self, message: str) -> NoReturn:
        """Raise *message* without argparse's prefix, with the nearest spelling of an unknown name."""
        wrong = re.search(r"invalid choice: '(.*?)' \(choose from (.*)\)$", message)
        hint = nearest_of(wrong[1], re.findall(r"[^', ]+", wrong[2]))[1] if wrong else ""
        raise UsageError(f"{message.removeprefix('argument ')}{'.' if hint else ''}{hint} (see `{self.prog} --help`)")


def make_parser(config: ConfigFile = NO_CONFIG) -> argparse.ArgumentParser:
    """Return the parser of the whole command line, with the defaults of the settings file."""
    rows = [(0, "done"), (tune_cmd.RESTORED, "tuned, but the old gains proved better and were restored")]
    rows += [(code, meaning) for _, code, meaning in EXIT_CODES]
    codes = "\n".join(f"  {code:3d}  {meaning}" for code, meaning in sorted(rows))
    parser = _Parser(
        prog="gcs-autotune",
        description="Identify and tune ArduPilot boats and ROVs over MAVLink.",
        epilog=f"exit codes:\n{codes}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"gcs-autotune {__version__}")
    verbs = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for command in COMMANDS.values():
        sub = verbs.add_parser(command.name, help=command.help, description=command.description)
        command.add_arguments(sub)
    config.apply(parser)
    verbs.choices[completion_cmd.COMMAND.name].set_defaults(whole=parser)
    return parser
