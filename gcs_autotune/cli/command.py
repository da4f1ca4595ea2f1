"""What a command of the command line is, and the option groups several of them share."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from gcs_autotune.cli.secret import PASSPHRASE_VARIABLE, signing_of
from gcs_autotune.cli.writing import fresh
from gcs_autotune.manoeuvres import Envelope

if TYPE_CHECKING:
    from gcs_autotune.workflow import Connection

__all__ = [
    "Command",
    "add_connection",
    "add_envelope",
    "add_experiment",
    "add_output",
    "connection_of",
    "envelope_from",
    "run_directory",
]


@dataclass(frozen=True, slots=True)
class Command:
    """One verb: its name, one-line help, options, and what it does (returning the exit code)."""

    name: str
    help: str
    description: str
    add_arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], int]


def add_connection(
    parser: argparse.ArgumentParser, default: str | None = None, otherwise: str = "", required: bool = False
) -> None:
    """Add ``--connect`` and its companions; *otherwise* says in words what stands in for a missing default."""
    group = parser.add_argument_group("connection")
    fallback = "" if required else f" (default {default or otherwise})"
    group.add_argument(
        "--connect",
        metavar="URI",
        default=default,
        required=required,
        help="udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT, /dev/ttyUSB0,57600 (MAVSDK's "
        "udpin://, udpout://, tcpin://, tcpout://, serial:// mean the same), or sitl:NAME for a simulated vehicle "
        "started for you; 'sitl:NAME?effect=dead-zone.width=0.05&seed=3' hides an effect in it "
        f"(`gcs-autotune sitl --list-effects`), '?model=FILE' flies a model file{fallback}",
    )
    group.add_argument(
        "--backend",
        metavar="NAME",
        default="pymavlink",
        help="what carries the messages: pymavlink (our own sockets and ports) or mavsdk (default pymavlink)",
    )
    group.add_argument("--baud", type=int, default=57600, help="serial speed when the URI has none (default 57600)")
    group.add_argument("--system-id", type=int, metavar="ID", help="the vehicle's system id, when several are heard")
    group.add_argument(
        "--source-system",
        type=int,
        metavar="ID",
        help="our own system id (default: the one the vehicle takes commands from, MAV_GCS_SYSID)",
    )
    group.add_argument(
        "--signing-key",
        type=Path,
        metavar="FILE",
        help="sign with the key (32 bytes) or passphrase (one line) in FILE; what the vehicle does not sign is refused",
    )
    group.add_argument(
        "--signing-passphrase",
        action="store_true",
        help=f"the same with a passphrase asked for on the terminal; without either, that in {PASSPHRASE_VARIABLE} is "
        "taken, if there is one",
    )
    group.add_argument("--seed", type=int, default=1, help="noise seed of a sitl: vehicle (default 1)")


def add_output(parser: argparse.ArgumentParser) -> None:
    """Add ``--out``."""
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="run directory to make (default runs/<date>-<time>-<vehicle>-<axis>)",
    )


def add_envelope(parser: argparse.ArgumentParser) -> None:
    """Add the safety limits."""
    d = Envelope()
    group = parser.add_argument_group("safety limits; leaving one ends the manoeuvre with neutral actuators")
    limits: tuple[tuple[str, float | None, str] | tuple[str, None, str, str], ...] = (
        ("--max-heading-excursion", math.degrees(d.heading_excursion), "from the starting heading, deg"),
        ("--max-depth-excursion", d.depth_excursion, "from the starting depth, m"),
        ("--max-depth", None, "greatest depth, m"),
        ("--min-depth", None, "least depth, m"),
        ("--max-speed", None, "over ground, m/s", f"{d.speed_limit:g}, or 1.5 times cruise"),
        ("--max-distance", None, "from the start, m", f"{d.distance_limit:g}, or 100 s of cruise"),
        ("--max-roll", math.degrees(d.roll), "deg"),
        ("--max-pitch", math.degrees(d.pitch), "deg"),
        ("--min-battery-voltage", None, "V"),
        ("--min-battery", 100.0 * d.battery_remaining, "remaining, percent"),
        ("--max-time", d.time, "of one manoeuvre, s"),
    )
    for flag, default, text, *words in limits:
        shown = words[0] if words else "off" if default is None else f"{default:g}"
        group.add_argument(flag, type=float, metavar="X", default=default, help=f"{text} (default {shown})")


def envelope_from(args: argparse.Namespace) -> Envelope:
    """Build the envelope from the options of :func:`add_envelope` (degrees and percent end here)."""
    return Envelope(
        heading_excursion=math.radians(args.max_heading_excursion),
        depth_excursion=args.max_depth_excursion,
        depth_max=math.inf if args.max_depth is None else args.max_depth,
        depth_min=0.0 if args.min_depth is None else args.min_depth,
        speed=args.max_speed,
        distance=args.max_distance,
        roll=math.radians(args.max_roll),
        pitch=math.radians(args.max_pitch),
        battery_voltage=0.0 if args.min_battery_voltage is None else args.min_battery_voltage,
        battery_remaining=args.min_battery / 100.0,
        time=args.max_time,
    )


def add_experiment(parser: argparse.ArgumentParser) -> None:
    """Add the options of the self-oscillation experiment and of its identification."""
    group = parser.add_argument_group("experiment (angles in deg, the rest in m)")
    group.add_argument("--relay-output", type=float, metavar="C", help="output, fraction of full (default: found)")
    group.add_argument("--relay-hysteresis", type=float, metavar="X_A", help="switching value (default: by the noise)")
    group.add_argument(
        "--relays",
        type=int,
        choices=(2, 3),
        default=3,
        help="self-oscillations at most; a third only where two cannot tell",
    )
    group.add_argument("--throttle", type=float, help="fraction of full (default: cruise for boats, 0 for ROVs)")
    group.add_argument("--speed", type=float, help="m/s meanwhile (default: from CRUISE_SPEED for boats, 0 for ROVs)")
    group.add_argument("--control-rate", type=float, metavar="HZ", help="rate of our relay (default 25, simulated 10)")
    group.add_argument("--delay", type=float, metavar="S", help="known input delay (default: looked for)")
    group.add_argument("--structure", choices=("linear", "nonlinear", "affine"), help="drag (default: decided by data)")


def connection_of(args: argparse.Namespace, uri: str) -> Connection:
    """Build the connection to *uri* from the options of :func:`add_connection`."""
    from gcs_autotune.workflow import Connection

    return Connection(
        uri, args.baud, args.system_id, args.source_system, args.seed, args.backend, signing_of(args, uri)
    )


def run_directory(args: argparse.Namespace, uri: str, now: datetime) -> Path:
    """Return ``--out``, or a new folder below ``runs/`` named for time, vehicle and axis."""
    if args.out is not None:
        return Path(args.out)
    label = "".join(c if c.isalnum() else "-" for c in uri.removeprefix("sitl:").partition("?")[0]).strip("-")
    return fresh(Path("runs") / f"{now:%Y%m%d-%H%M%S}-{label}-{args.axis}")
