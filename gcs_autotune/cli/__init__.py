"""The command line, with the table of commands and the table of exit codes."""

from __future__ import annotations

import argparse
import gc
import os
import re
import sys
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, NoReturn

from gcs_autotune import __version__
from gcs_autotune.cli.command import Command, what_remains
from gcs_autotune.cli.config_file import NO_CONFIG, ConfigFile, craft_of, find_config, read_config, shown_value
from gcs_autotune.cli.help import add_help
from gcs_autotune.cli.tune_cmd import RESTORED, carry_out, tune_settings
from gcs_autotune.cli.writing import folded, in_plain_signs
from gcs_autotune.errors import EXIT_CODES, AutotuneError, OperatorStopped, UsageError, exit_code
from gcs_autotune.registry import nearest_of
from gcs_autotune.untrusted_text import visible

__all__ = ["COMMANDS", "carry_out", "find_config", "main", "make_parser", "read_config", "tune_settings"]


@dataclass(frozen=True, slots=True)
class Verb:
    """One line of the table of commands: its help in the list, and its module."""

    help: str
    module: str
    attribute: str = "COMMAND"

    def load(self) -> Command:
        """Import the command's module and return the command. Only the command that runs is imported, because each
        imports the tables for its options.
        """
        command: Command = getattr(import_module(f"{__name__}.{self.module}"), self.attribute)
        return command


COMMANDS: Mapping[str, Verb] = {
    "tune": Verb("identify the craft, design gains, test them by a step, keep them if better", "tune_cmd"),
    "identify": Verb("identify inertia, damping and constant force from recorded runs", "identify_cmd"),
    "design": Verb("design gains from a model, or predict the limit cycle of a relay", "design_cmd"),
    "diagnose": Verb(
        "compare a simulation with measured runs, identify what it lacks, extend the model", "diagnose_cmd"
    ),
    "figures": Verb(
        "compute ship figures (IMO, ITTC) from a zig-zag, turning circle, spiral, pull-out or stop", "figures_cmd"
    ),
    "experiment": Verb(
        "fly relay experiments and identify one degree of freedom; writes no parameter", "experiment_cmd"
    ),
    "aboard": Verb("have the autopilot fly the experiments by a script, for slow links", "aboard_cmd"),
    "fly": Verb("fly a standard manoeuvre (zig-zag, circle, steps ...): preview, flight, figures, model", "fly_cmd"),
    "hold": Verb("hold heading or depth with a controller of our own, in manual mode", "hold_cmd"),
    "authority": Verb("compute from models what a craft can do, and the limits ArduPilot should have", "authority_cmd"),
    "recheck": Verb(
        "check how well the heading, depth or speed loop is still tuned; drives no actuator directly",
        "recheck_cmd",
    ),
    "compare": Verb("show several runs of one craft side by side, and what changed", "compare_cmd"),
    "share": Verb("pack a run into one file to send to others", "share_cmd"),
    "watch": Verb("check later logs for changes of the craft since it was tuned", "watch_cmd"),
    "study": Verb("run many simulated cases over ranges of numbers (needs gcs-autotune[study])", "study_cmd"),
    "thrusters": Verb("map a thruster's command to force from a bollard pull test", "thrusters_cmd"),
    "laser": Verb("measure distance and angle to a wall from two laser dots in a video", "laser_cmd"),
    "track": Verb("make a run from a video of the craft from above and its log", "track_cmd"),
    "calibrate": Verb("calibrate the lasers of `laser`, or the camera of `track`", "calibrate_cmd"),
    "logs": Verb("show the contents of a telemetry or onboard log, or import its runs", "logs_cmd"),
    "navigate": Verb("fuse the sensors of a log into motion at the centre of gravity, for identify", "navigate_cmd"),
    "export": Verb(
        "export a model to ArduPilot's simulator, Gazebo, Fossen's simulator or MATLAB, or as a table", "export_cmd"
    ),
    "params": Verb("save or restore a vehicle's parameters", "params_cmd"),
    "restore": Verb("restore the vehicle after an interrupted run", "restore_cmd"),
    "serve": Verb("serve a web page to start, monitor and stop runs (needs gcs-autotune[web])", "serve_cmd"),
    "sitl": Verb("run a simulated vehicle that speaks MAVLink (see `gcs-autotune sitl --help`)", "sitl_cmd"),
    "doctor": Verb(
        "check this computer: programs, clock, disk, caches, ports and connected vehicles", "doctor_cmd", "DOCTOR"
    ),
    "ports": Verb("list the ports and the vehicles received on them", "doctor_cmd", "PORTS"),
    "completion": Verb("print a completion script for bash, zsh or fish", "completion_cmd"),
}
"""Verb -> its help and the module of its command. To add a command, add a module and a line here."""
COMPLETION = "completion"
"""The only command that needs the parsers of all others."""

YOUNG = 20_000
"""Number of new objects after which the garbage collector runs. Project choice."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line with the arguments *argv* and return the exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    in_plain_signs(sys.stdout, sys.stderr)
    # Before NumPy is imported. Our matrices are small: a second thread wins nothing on an idle machine, and beside
    # other programs (a ground station, a simulator) the two wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if arguments[:1] == ["sitl"]:
        from gcs_autotune.cli.sitl_cmd import hand_over

        return hand_over(arguments[1:])
    if not arguments:
        make_parser(only=COMPLETION).print_help()
        return 0
    args = None
    # What is imported stays: by Python's own threshold (700 objects) the collector would look at it 600 times.
    usual = gc.get_threshold()
    gc.set_threshold(YOUNG, *usual[1:])
    try:
        config = read_config(find_config())
        verb = next((word for word in arguments if word in COMMANDS), None)
        args = make_parser(config, None if verb == COMPLETION else verb).parse_args(arguments)
        if craft := craft_of(config, args):
            config = config.of(craft)
            args = make_parser(config, verb).parse_args(arguments)
        if used := config.used_by(args):
            told = ", ".join(f"{name} {shown_value(value)}" for name, value in used.items())
            told = f"craft {craft}: {told}" if craft else told
            sys.stderr.write(f"{visible(f'settings of {config.path}: {told}')}\n")
        code = COMMANDS[args.command].load().run(args)
        sys.stdout.flush()
        return code
    except AutotuneError as error:
        if getattr(args, "verbose", False):
            traceback.print_exc()
        sys.stderr.write(folded(f"gcs-autotune: {visible(str(error))}", sys.stderr))
        sys.stderr.writelines(f"{visible(line)}\n" for line in (() if args is None else what_remains(args)))
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

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        """Parse, and reject what is left over here: argparse would report it from the parser of the whole program."""
        known, left = super().parse_known_args(args, namespace)
        if left:
            typed = next((word[2:].partition("=")[0] for word in left if word.startswith("--")), "")
            options = [option[2:] for option in self._option_string_actions if option.startswith("--")]
            nearest = " or ".join(f"--{name}" for name in nearest_of(typed, options)[0])
            hint = f". Did you mean {nearest}?" if nearest else ""
            self.error(f"unrecognized arguments: {' '.join(left)}{hint}")
        return known, left


def make_parser(config: ConfigFile = NO_CONFIG, only: str | None = None) -> argparse.ArgumentParser:
    """Return the parser of the whole command line, with the defaults of the settings file.

    only : the verb to be run. The others are listed without their options and are not imported.
    """
    rows = [
        (0, "done"),
        (RESTORED, "tuned, but not better in every respect: the old gains were restored"),
    ]
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
    for name, verb in COMMANDS.items():
        if only not in (None, name):
            verbs.add_parser(name, help=verb.help)
            continue
        command = verb.load()
        sub = verbs.add_parser(name, help=verb.help, description=command.description, add_help=False)
        add_help(sub, command)
        command.add_arguments(sub)
    config.apply(parser)
    verbs.choices[COMPLETION].set_defaults(whole=parser)
    return parser
