"""The class of a command, and the option groups that several commands share."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, fields, replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from gcs_autotune.axes import axis_kind
from gcs_autotune.cli.console import BELL_VARIABLE
from gcs_autotune.cli.secret import PASSPHRASE_VARIABLE, signing_of
from gcs_autotune.cli.writing import fresh
from gcs_autotune.documents import check_run_folder, load_json, model_file
from gcs_autotune.errors import BadFile, UsageError
from gcs_autotune.limits import Limit, axes_of, finite, limit_of

if TYPE_CHECKING:
    from gcs_autotune.manoeuvres import Envelope
    from gcs_autotune.mavlink import SigningKey
    from gcs_autotune.report import StageBar, TerminalObserver
    from gcs_autotune.thrusters import PullTest
    from gcs_autotune.workflow import CommonSettings, Connection

_Settings = TypeVar("_Settings", bound="CommonSettings")

__all__ = [
    "Command",
    "add_connection",
    "add_envelope",
    "add_experiment",
    "add_fetch_log",
    "add_loudness",
    "add_number",
    "add_output",
    "add_pull_test",
    "add_remote",
    "check_axis_limits",
    "check_files",
    "check_model_file",
    "check_output",
    "connected",
    "connection_of",
    "envelope_from",
    "progress_bar",
    "pull_test_of",
    "run_directory",
    "settings_of",
    "uri_of",
    "waiting",
    "watching",
    "what_remains",
]


GUARDING = (
    "max-heading-excursion",
    "max-depth-excursion",
    "max-depth",
    "min-depth",
    "max-speed",
    "max-turn-rate",
    "max-distance",
    "max-roll",
    "max-pitch",
    "min-battery-voltage",
    "min-battery",
    "max-time",
)
"""Names of the safety limits, in the order of the help."""


@dataclass(frozen=True, slots=True)
class Command:
    """One verb of the command line: its description, its options, and the function that runs it and returns the
    exit code.

    everyday : options that ``--help`` shows, in this order; empty: all. examples : call -> what it does.
    """

    description: str
    add_arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], int]
    everyday: tuple[str, ...] = ()
    examples: tuple[tuple[str, str], ...] = ()


def add_number(
    group: argparse._ActionsContainer,
    name: str,
    metavar: str = "X",
    *,
    limit: str = "",
    meaning: str = "",
    unset: str = "",
    default: float | None = None,
    const: float | None = None,
    marked: bool = False,
) -> None:
    """Add the option *name* (without dashes) for a number; range and help come from the table of limits.

    limit : its name in the table, if different.
    meaning, unset : help text and words on an absent option, both instead of the table's.
    const : value of the option without an argument.
    marked : whether an absent option gives None, whatever the default.

    Ranges that differ by axis are checked by :func:`check_axis_limits`.
    """
    rows = axes_of(limit or name)
    row = rows[0]
    if const is None:
        group.add_argument(
            f"--{name}",
            type=_typed(rows),
            metavar=metavar,
            default=row.default if len(rows) == 1 and default is None and not marked else default,
            help=_help(rows, meaning, unset),
        )
    else:
        group.add_argument(
            f"--{name}", type=_typed(rows), metavar=metavar, nargs="?", const=const, help=_help(rows, meaning, unset)
        )


def _typed(rows: Sequence[Limit]) -> Callable[[str], float]:
    """Return a function for argparse that parses a number and rejects values outside its limits."""

    def read(text: str) -> float:
        try:
            return rows[0].parse(text) if len(rows) == 1 else finite(text)
        except UsageError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    read.__name__ = "number"
    return read


def _help(rows: Sequence[Limit], meaning: str, unset: str) -> str:
    if len(rows) == 1:
        row = replace(rows[0], meaning=meaning, unset=unset) if meaning else rows[0]
        return row.help.replace("%", "%%")
    return "; ".join(dict.fromkeys(row.help for row in rows)).replace("%", "%%")


def check_axis_limits(args: argparse.Namespace, names: Sequence[str]) -> None:
    """Check the numbers whose range depends on ``args.axis``.

    Raises
    ------
    UsageError
        A number is out of range; the message names it.
    """
    for name in names:
        value = getattr(args, name.replace("-", "_"))
        if value is None:
            continue
        try:
            limit_of(name, args.axis).check(value)
        except UsageError as error:
            raise UsageError(f"--{name}: {error}") from None


def add_connection(parser: argparse.ArgumentParser, otherwise: str = "", *, of_run: bool = False) -> None:
    """Add ``--connect`` and its related options, read with :func:`uri_of`.

    otherwise : default shown in the help; empty if the option is required. of_run : the link belongs to a recorded
    run, and no settings file changes it.
    """
    group = parser.add_argument_group("connection")
    if not of_run:
        parser.set_defaults(configured_link="")
        group.add_argument(
            "--craft",
            metavar="NAME",
            help="use the settings [craft.NAME] of gcs-autotune.toml (default: those of the craft with this link, or "
            "whose system id is received)",
        )
    fallback = f" (default {otherwise})" if otherwise else ""
    group.add_argument(
        "--connect",
        metavar="URI",
        help="link to the vehicle: udpin:HOST:PORT (listens), udpout:HOST:PORT (sends first), tcp:HOST:PORT "
        "(connects), tcpin:HOST:PORT (listens) or /dev/ttyUSB0,57600 "
        "(MAVSDK's udpin://, udpout://, tcpin://, tcpout://, serial:// also work). sitl:NAME "
        "starts a simulated vehicle, sitl:FILE.toml your own. 'sitl:NAME?effect=dead-zone.width=0.05&seed=3' adds "
        f"an effect (`gcs-autotune sitl --list-effects`). 'sitl:NAME?model=FILE' simulates a model file{fallback}",
    )
    group.add_argument(
        "--backend",
        metavar="NAME",
        default="pymavlink",
        help="library that carries the messages: pymavlink (own sockets and ports) or mavsdk (default pymavlink)",
    )
    add_number(group, "baud", "BAUD")
    add_number(group, "system-id", "ID")
    add_number(group, "source-system", "ID")
    group.add_argument(
        "--signing-key",
        type=Path,
        metavar="FILE",
        help="sign messages with the key (32 bytes) or passphrase (one line) in FILE; unsigned messages are rejected",
    )
    group.add_argument(
        "--signing-passphrase",
        action="store_true",
        help="sign messages with a passphrase typed at the terminal. Without --signing-key and this option, the "
        f"passphrase in {PASSPHRASE_VARIABLE} is used, if set",
    )
    add_number(group, "seed", "N")


def uri_of(args: argparse.Namespace, otherwise: str = "") -> str:
    """Return the link of the command line, else that of the settings file, else *otherwise*.

    Raises
    ------
    UsageError
        There is no link.
    """
    uri = args.connect or args.configured_link or otherwise
    if not uri:
        raise UsageError("no vehicle given. Use --connect URI; `gcs-autotune ports` lists the vehicles in reach")
    return str(uri)


def add_output(parser: argparse.ArgumentParser) -> None:
    """Add the option ``--out`` for the run directory."""
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="run directory to create (default runs/<date>-<time>-<link>-<axis>)",
    )


def add_fetch_log(parser: argparse.ArgumentParser) -> None:
    """Add the option ``--fetch-log``."""
    parser.add_argument(
        "--fetch-log",
        action="store_true",
        help="after the run, fetch the vehicle's own log into the run directory and identify from it too. "
        "A vehicle without logs is rejected before arming",
    )


def add_loudness(parser: argparse.ArgumentParser) -> None:
    """Add the options ``--quiet`` and ``--verbose``."""
    loudness = parser.add_mutually_exclusive_group()
    loudness.add_argument(
        "--quiet",
        action="store_true",
        help="suppress the progress line and the bell; warnings, prompts and results are still shown "
        f"(bell only: {BELL_VARIABLE}=off in the environment)",
    )
    loudness.add_argument(
        "--verbose",
        action="store_true",
        help="keep every progress line; show the vehicle's text messages and the traceback of an error",
    )


def watching(args: argparse.Namespace) -> TerminalObserver:
    """Return the progress display of a vehicle; :func:`add_loudness` sets how much it shows."""
    from rich.console import Console

    from gcs_autotune.report import TerminalObserver

    return TerminalObserver(Console(stderr=True), quiet=args.quiet, verbose=args.verbose)


def progress_bar(args: argparse.Namespace, given: float = math.inf) -> StageBar:
    """Return the progress display of a long calculation; :func:`add_loudness` sets how much it shows.

    given : time limit of the calculation [s].
    """
    from rich.console import Console

    from gcs_autotune.report import StageBar

    console = Console(stderr=True, quiet=args.quiet or (args.json and not args.verbose))
    return StageBar(console, verbose=args.verbose, given=given)


@contextmanager
def waiting(args: argparse.Namespace, what: str) -> Iterator[None]:
    """Show a spinner with *what* on a terminal, during work without progress of its own that may take a second.

    Write nothing to standard output during it: the spinner would divert it.
    """
    from rich.console import Console

    with Console(stderr=True, quiet=getattr(args, "quiet", False) or getattr(args, "json", False)).status(what):
        yield


def add_remote(parser: argparse.ArgumentParser) -> None:
    """Add the option ``--remote``."""
    parser.add_argument(
        "--remote",
        action="store_true",
        help="let a program operate the run: progress and questions as JSON lines on standard output, STOP and answers "
        "on standard input. End of input is a STOP (docs/serve.md)",
    )


def add_envelope(parser: argparse.ArgumentParser) -> None:
    """Add the options for the safety limits."""
    group = parser.add_argument_group("safety limits (when one is exceeded, the manoeuvre ends with neutral actuators)")
    for name in GUARDING:
        add_number(group, name)


def envelope_from(args: argparse.Namespace) -> Envelope:
    """Return the safety envelope set by the options of :func:`add_envelope`, in SI and radians."""
    from gcs_autotune.manoeuvres import Envelope

    return Envelope(
        heading_excursion=math.radians(args.max_heading_excursion),
        depth_excursion=args.max_depth_excursion,
        depth_max=math.inf if args.max_depth is None else args.max_depth,
        depth_min=args.min_depth,
        speed=args.max_speed,
        turn_rate=math.inf if args.max_turn_rate is None else math.radians(args.max_turn_rate),
        distance=args.max_distance,
        roll=math.radians(args.max_roll),
        pitch=math.radians(args.max_pitch),
        battery_voltage=0.0 if args.min_battery_voltage is None else args.min_battery_voltage,
        battery_remaining=args.min_battery / 100.0,
        time=args.max_time,
    )


def add_experiment(parser: argparse.ArgumentParser) -> None:
    """Add the options of the self-oscillation experiment and of its identification."""
    group = parser.add_argument_group("experiment")
    add_number(group, "relay-output", "C")
    add_number(group, "relay-hysteresis", "X_A")
    add_number(group, "relays", "N")
    group.add_argument(
        "--stop-rule",
        choices=("design", "settled"),
        default="design",
        help="design (default): end a relay as soon as the gains are known. settled: fly until five periods agree "
        "within 10 %%, fly every step to its end, and turn a boat around before each manoeuvre",
    )
    add_number(group, "throttle")
    add_number(group, "speed")
    add_number(group, "control-rate", "HZ")
    add_number(group, "delay", "S")
    add_number(group, "patience", "S")
    group.add_argument(
        "--structure",
        choices=("linear", "nonlinear", "affine"),
        help="damping of the model: linear, nonlinear (quadratic) or affine (both) (default: chosen from the data)",
    )


def add_pull_test(parser: argparse.ArgumentParser) -> None:
    """Add the option of the pull test that supplies the thrust curve."""
    parser.add_argument(
        "--pull-test",
        type=Path,
        metavar="FILE",
        help="thrust curve from a pull test of one thruster: a CSV file with the columns command[1] or pwm[us], and "
        "force[N] or T[kgf] (see `thrusters`)",
    )


def pull_test_of(args: argparse.Namespace) -> PullTest | None:
    """Return the pull test of ``--pull-test``; None without the option."""
    if args.pull_test is None:
        return None
    from gcs_autotune.thrusters import read_pull_test

    return read_pull_test(args.pull_test)


@contextmanager
def connected(args: argparse.Namespace, uri: str) -> Iterator[Connection]:
    """Open *uri* first, before the slow imports, and yield the connection.

    Raises
    ------
    UsageError, UnknownName, CannotOpenLink
        The link cannot be opened.
    """
    from gcs_autotune.link import open_link

    signing = signing_of(args, uri)
    with ExitStack() as stack:
        with waiting(args, "starting"):
            link = stack.enter_context(open_link(uri, baud=args.baud, seed=args.seed, backend=args.backend))
            connection = replace(_connection(args, uri, signing), opened=link)
        yield connection


def check_output(args: argparse.Namespace) -> None:
    """Check that ``--out`` can store the run, before a link is opened.

    Raises
    ------
    UsageError
        The directory already contains a run, or cannot be created.
    """
    if args.out is not None:
        check_run_folder(args.out)


def check_files(*paths: Path | None) -> None:
    """Check that the files to read exist, before the slow imports.

    Raises
    ------
    BadFile
        A file is missing.
    """
    for path in paths:
        if path is not None and not path.exists():
            raise BadFile(f"{path} does not exist. Give a file or a run directory")


def check_model_file(path: Path | None) -> None:
    """Check that a model file can be read, before anything is opened. Its contents are checked later.

    Raises
    ------
    BadFile
        The file cannot be read.
    """
    if path is None:
        return
    check_files(path)
    if not isinstance(load_json(model_file(path), "a model file"), dict):
        raise BadFile(
            f"{path} is not a model file: it contains no JSON object with a model. Write one with identify --save"
        )


def connection_of(args: argparse.Namespace, uri: str) -> Connection:
    """Return the settings of the connection to *uri* from the options of :func:`add_connection`."""
    signing = signing_of(args, uri)
    with waiting(args, "starting"):
        return _connection(args, uri, signing)


def _connection(args: argparse.Namespace, uri: str, signing: SigningKey | None) -> Connection:
    from gcs_autotune.workflow import Connection

    return Connection(uri, args.baud, args.system_id, args.source_system, args.seed, args.backend, signing)


def run_directory(args: argparse.Namespace, uri: str, now: datetime, what: str = "") -> Path:
    """Return ``--out``, or a new folder below ``runs/`` named after the time, the vehicle and *what* was done (its
    axis). It is kept in *args*, for :func:`what_remains`.
    """
    label = "".join(c if c.isalnum() else "-" for c in uri.removeprefix("sitl:").partition("?")[0]).strip("-")
    name = f"{now:%Y%m%d-%H%M%S}-{label}-{what or args.axis}"
    directory = Path(args.out) if args.out is not None else fresh(Path("runs") / name)
    args.directory = directory
    return directory


OPTIONS = {"most_relays": "relays", "model": "function"}
"""Settings of a run whose option has another name."""


def settings_of(
    kind: type[_Settings], args: argparse.Namespace, connection: Connection, now: datetime, what: str = "", **more: Any
) -> _Settings:
    """Return the settings of a run that the options in *args* and *more* set. Angles are converted to radians.

    An option that is not set, or that the command does not have, leaves the setting's own default. The run directory is
    that of :func:`run_directory`.

    Raises
    ------
    UsageError
        A number is out of range.
    """
    set_here: dict[str, Any] = {f.name: getattr(args, OPTIONS.get(f.name, f.name), None) for f in fields(kind)}
    set_here |= {"connection": connection, "directory": run_directory(args, connection.uri, now, what)}
    set_here |= {"envelope": envelope_from(args), **more}
    if "axis" in set_here and axis_kind(args.axis).angular:
        angles = ("step", "relay_hysteresis")
        set_here |= {n: math.radians(set_here[n]) for n in angles if set_here[n] is not None}
    return kind(**{name: value for name, value in set_here.items() if value is not None})


def what_remains(args: argparse.Namespace) -> Iterator[str]:
    """Yield what a run that ended early has left on disk. The run itself states how to continue it."""
    directory: Path | None = getattr(args, "directory", None)
    if directory is None:
        return
    page = directory / "report.html"
    if page.exists():
        yield f"Report: {page}"
    elif any(directory.glob("trials/*.csv")):
        yield f"Recorded in {directory}"
