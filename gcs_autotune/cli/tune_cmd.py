"""``gcs-autotune tune``: fly, identify, design, prove, keep or restore."""

from __future__ import annotations

import argparse
import shlex
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from gcs_autotune.axes import AXES
from gcs_autotune.cli.command import (
    Command,
    add_connection,
    add_envelope,
    add_experiment,
    add_fetch_log,
    add_loudness,
    add_number,
    add_output,
    add_pull_test,
    add_remote,
    check_axis_limits,
    check_files,
    check_model_file,
    check_output,
    connected,
    pull_test_of,
    settings_of,
)
from gcs_autotune.cli.remote import attending
from gcs_autotune.cli.writing import put_out
from gcs_autotune.errors import ManoeuvreError, UsageError, exit_code
from gcs_autotune.limits import finite
from gcs_autotune.tunables import STEP_OPTIONS, TUNABLES, tunable

if TYPE_CHECKING:
    from gcs_autotune.observer import Observer
    from gcs_autotune.report import Document
    from gcs_autotune.workflow import Connection, Operator, SuppliedGains, TuneSettings

__all__ = ["COMMAND", "FUNCTIONS", "RESTORED", "add_style", "carry_out", "check_style", "tune_settings"]

FUNCTIONS = ("bessel", "butterworth", "binomial")
"""Names of the reference models, listed here because importing their table takes a second."""
ALL = "all"
"""All loops of the vehicle, in the order of ``TUNABLES``."""
FIRST = next(iter(TUNABLES))
"""The axis whose settings `tune all` starts with."""
OF_ONE_LOOP = (
    *STEP_OPTIONS,
    *("leg_length", "settling_time", "full_scale", "delay", "structure", "untuned", "pull_test"),
)
"""Options that `tune all` has no use for, because they are for one loop."""
STYLES = ("normal", "gentle", "quick")
"""Names of ``design.STYLES``, listed here for the same reason."""
RESTORED = 8
"""Exit code of ``tune`` if the new gains were tested, but the old gains proved better and are restored."""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("axis", choices=[*sorted({*AXES, *TUNABLES}), ALL], help="the loop to tune")
    add_connection(parser, otherwise="sitl:charlie, sitl:videoray for depth, sitl:bluerov2-sway for position")
    add_output(parser)
    add_fetch_log(parser)
    parser.add_argument("--yes", action="store_true", help="answer yes to every question")
    parser.add_argument("--dry-run", action="store_true", help="fly, identify and design, but write no parameter")
    add_loudness(parser)
    add_remote(parser)
    parser.add_argument("--json", action="store_true", help="print the summary as JSON on standard output")
    parser.add_argument(
        "--resume",
        type=Path,
        metavar="RUN",
        help="resume the run in DIR that ended early. Its completed experiments are used if vehicle, parameters, axis "
        "and settings are unchanged",
    )
    parser.add_argument(
        "--loops",
        type=_loops,
        metavar="NAMES",
        default=(),
        help="tune all: the loops to tune, e.g. heading,depth,roll (default: speed, heading and line of a boat, "
        "heading and depth of an ROV)",
    )
    step = parser.add_argument_group("proof")
    add_number(step, "step")
    add_number(step, "step-duration", "S")
    add_number(step, "leg-length", "M")
    step.add_argument(
        "--untuned",
        action="store_true",
        help="tune line: fly although speed or heading have ArduRover's own gains. Better: tune them first",
    )
    add_experiment(parser)
    add_pull_test(parser)
    design = parser.add_argument_group("design")
    design.add_argument(
        "--model",
        type=Path,
        metavar="FILE",
        help="design from this model file (written by identify --save or diagnose), without experiments",
    )
    design.add_argument(
        "--gains",
        type=Path,
        metavar="FILE",
        help="test these gains by a step, and keep them only if better: proposed.param of a dry run, its directory, "
        "or any NAME,VALUE file",
    )
    add_number(design, "full-scale")
    add_style(design)
    design.add_argument("--function", choices=FUNCTIONS, default="bessel", help="reference model (default bessel)")
    design.add_argument(
        "--beyond-ranges",
        action="store_true",
        help="allow gains outside ArduPilot's documented ranges; the stability margins stay the same",
    )
    add_number(design, "settling-time", "S")
    add_number(design, "omega-0", "RAD_S")
    add_envelope(parser)


def _loops(text: str) -> tuple[str, ...]:
    """Return the loops that were typed, in the order of ``TUNABLES``."""
    known = [row.name for row in TUNABLES.values() if row.after is not None]
    named = [name.strip() for name in text.split(",")]
    for name in named:
        if name not in known:
            raise argparse.ArgumentTypeError(f"unknown loop '{name}'. Use names of {', '.join(known)}")
    return tuple(name for name in known if name in named)


def add_style(group: argparse._ArgumentGroup) -> None:
    """Add the option ``--style``."""
    group.add_argument(
        "--style",
        type=_style,
        metavar="STYLE",
        default=STYLES[0],
        help="margins and bandwidth: normal (default), gentle (half the bandwidth, larger margins), quick (smaller "
        "margins), or a number from 0 (gentle) over 50 (normal) to 100 (quick); settings in docs/tune.md",
    )


def _style(text: str) -> str:
    """Return the style that was typed."""
    if text not in STYLES:
        try:
            at = finite(text)
        except UsageError:
            at = -1.0
        if not 0.0 <= at <= 100.0:
            raise argparse.ArgumentTypeError(
                f"unknown style '{text}'. Use {', '.join(STYLES)}, or a number from 0 (gentle) to 100 (quick)"
            )
    return text


def check_style(args: argparse.Namespace) -> None:
    """Check that only one option sets the speed of the loop.

    Raises
    ------
    UsageError
        ``--style`` is combined with another one.
    """
    speeds = [f"--{name.replace('_', '-')}" for name in ("omega_0", "settling_time") if getattr(args, name) is not None]
    if args.style != STYLES[0] and speeds:
        raise UsageError(f"--style {args.style} and {speeds[0]} both set the speed of the loop. Use one of them")


def _run(args: argparse.Namespace) -> int:
    _check(args)
    args.connect = args.connect or args.configured_link or None
    own = "" if args.what == ALL else tunable(args.what).example
    example = own or AXES[args.axis].example
    with connected(args, args.connect or example) as connection:
        return _tune(args, connection)


def _check(args: argparse.Namespace) -> None:
    """Check that the options are consistent, before anything is opened."""
    if not hasattr(args, "what"):
        args.what, args.axis = args.axis, FIRST if args.axis == ALL else tunable(args.axis).axis
    check_axis_limits(args, ("step", "relay-hysteresis"))
    check_output(args)
    own = _own_parser()
    without = OF_ONE_LOOP if args.what == ALL else ("loops", *tunable(args.what).useless)
    useless = [name for name in without if getattr(args, name) != own.get_default(name)]
    if useless:
        names = " and ".join(f"--{name.replace('_', '-')}" for name in useless)
        raise UsageError(f"`tune {args.what}` does not use {names}. Remove what it does not use")
    if args.model is None and args.full_scale is not None:
        raise UsageError("--full-scale applies only to a model from a file. Add --model FILE")
    if args.model is not None and str(args.model) in FUNCTIONS:
        raise UsageError(f"--model needs a model file. For the reference model use --function {args.model}")
    if args.model is not None and args.gains is not None:
        raise UsageError("--gains tests existing gains and --model designs new gains. Use one of the two")
    check_style(args)
    check_model_file(args.model)
    check_files(args.gains, args.resume, args.pull_test)


def _tune(args: argparse.Namespace, connection: Connection) -> int:
    """Tune over an open link and show the result."""
    now = datetime.now()
    settings, when = tune_settings(args, connection, now), now.isoformat(timespec="seconds")
    with attending(args, "or --dry-run to change nothing") as (operator, observer):
        document, directory, endings = carry_out(args, settings, operator, observer, when)
    if not args.remote:  # else standard output is the program's
        page = [f"Report: {Path(directory) / 'report.html'}"] if directory else []
        put_out(document, *page, as_json=args.json)
    operator.ring()
    if "aborted" in endings:  # a step of several; the others were flown
        return exit_code(ManoeuvreError())
    return RESTORED if "restored" in endings else 0


def carry_out(
    args: argparse.Namespace, settings: TuneSettings, operator: Operator, observer: Observer, when: str
) -> tuple[Document, str, tuple[str, ...]]:
    """Tune what the command line states. Return the report, its directory, and the ending of each step.

    Raises
    ------
    AutotuneError
        The cause of an early end.
    """
    from gcs_autotune.report import job_document, tune_document
    from gcs_autotune.workflow import job_of, tune_all

    if args.what == ALL:
        job = tune_all(settings, operator, observer, _moment)
        return job_document(job), job.directory, tuple(step.ending for step in job.steps)
    story = job_of(args.what).run(settings, operator, observer, when)
    return tune_document(story), story.directory, (story.ending,)


def _moment() -> str:
    """Return the present local date and time, ISO 8601."""
    return datetime.now().isoformat(timespec="seconds")


def tune_settings(args: argparse.Namespace, connection: Connection, now: datetime) -> TuneSettings:
    """Return the settings of the tune set on the command line, for an open link.

    Raises
    ------
    UsageError
        Options contradict each other, or a number is out of range.
    """
    from gcs_autotune.identify import load_model
    from gcs_autotune.workflow import TuneSettings

    _check(args)
    return settings_of(
        TuneSettings,
        args,
        connection,
        now,
        getattr(args, "what", ""),
        given=None if args.model is None else load_model(args.model),
        gains=_gains(args),
        proving=_proving(args),
        pull_test=pull_test_of(args),
    )


DROPPED = {"axis", "what", "command", "out", "yes", "dry_run", "json", "remote", "model", "full_scale", "function"} | {
    *(
        "settling_time",
        "configured_link",
        "omega_0",
        "relay_hysteresis",
        "relays",
        "delay",
        "structure",
        "gains",
        "pull_test",
        "loops",
        "directory",
        "uri",
    )
}
"""Names of the options that have no effect when supplied gains are proved."""


def _own_parser() -> argparse.ArgumentParser:
    """Return a parser with the defaults of this program, without those of a settings file."""
    parser = argparse.ArgumentParser(add_help=False)
    _add_arguments(parser)
    return parser


def _proving(args: argparse.Namespace) -> str:
    """Return the command that proves the gains of a file under the present options."""
    parser = _own_parser()
    words = ["gcs-autotune", "tune", args.axis]
    for name, value in vars(args).items():
        if name not in DROPPED and value != parser.get_default(name) and value not in (None, False):
            flag = f"--{name.replace('_', '-')}"
            words += [flag] if value is True else [flag, str(value)]
    return f"{shlex.join(words)} --gains"


def _gains(args: argparse.Namespace) -> SuppliedGains | None:
    """Read the gains to prove."""
    if args.gains is None:
        return None
    from gcs_autotune.workflow import load_gains

    return load_gains(args.gains, args.axis)


COMMAND = Command(
    description="Tune one loop of an ArduPilot boat or ROV, or all of them in order. A step is flown with the present "
    "gains, then with the new gains. The new gains stay only if they follow the step better. Without --connect a "
    "simulated vehicle is used.",
    add_arguments=_add_arguments,
    run=_run,
    everyday=(
        "connect",
        "throttle",
        "style",
        "settling-time",
        "step",
        "max-distance",
        "max-time",
        "model",
        "dry-run",
        "yes",
        "out",
        "resume",
        "verbose",
        "json",
    ),
    examples=(
        ("gcs-autotune tune heading", "try it on a simulated boat"),
        ("gcs-autotune tune heading --connect /dev/ttyUSB0", "a boat on a telemetry radio"),
        ("gcs-autotune tune all --connect /dev/ttyUSB0", "all loops in order, after one question"),
        ("gcs-autotune tune depth --connect udpin:0.0.0.0:14550 --max-depth 5", "an ROV, not deeper than 5 m"),
    ),
)
