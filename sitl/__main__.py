"""``python -m sitl NAME``: run one simulated vehicle as a separate process."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from types import FrameType

from gcs_autotune_files import Refused, clipped, number, whole
from sitl import VEHICLES, Server, UnknownVehicle, open_vehicle
from sitl.ardupilot_json import add_options, run_json, write_parameters
from sitl.autopilot import GENERATIONS
from sitl.catalogue import load_vehicle
from sitl.check import check_vehicle
from sitl.clock import Pacer
from sitl.eeprom import keep_parameters, read_parameters
from sitl.effects import EFFECTS, parse_effect
from sitl.listen import AddressError, CannotListen, open_link, serve_free_running
from sitl.lockstep import serve_lockstep
from sitl.mavlink import demand_signatures, read_key
from sitl.modelfile import read_model

__all__ = ["main"]

_OK, _USAGE, _IN_USE = 0, 2, 3
_SLOWEST, _QUICKEST = 0.01, 1000.0
"""Range of simulated seconds per second. Project choice."""
_DEFAULT_ADDRESS = "udp:127.0.0.1:14550"


def _seed(text: str) -> int:
    """Parse a seed from the command line."""
    try:
        return whole(text, 2**32 - 1)
    except Refused as error:
        raise _Usage(f"--seed: {error}") from None


class _Stopped(BaseException):
    """Raised when the process receives a request to end."""


def _stop(number: int, frame: FrameType | None) -> None:
    raise _Stopped


def _make_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="sitl", description="A simulated ArduRover/ArduSub-style vehicle that speaks MAVLink 2."
    )
    parser.add_argument(
        "vehicle", nargs="?", help=f"one of {', '.join(VEHICLES)}, or the path of a vehicle file (.toml)"
    )
    parser.add_argument(
        "--check", type=Path, metavar="FILE", help="check a vehicle file: name line and quantity of what is wrong"
    )
    parser.add_argument("--list", action="store_true", help="list the vehicles")
    parser.add_argument(
        "--listen",
        metavar="ADDRESS",
        default=_DEFAULT_ADDRESS,
        help="udpin:HOST:PORT or udp: (listens; connect with udpout:), udpout:HOST:PORT (sends first; connect with "
        "udpin:), tcpin:HOST:PORT or tcp: (listens; connect with tcp:), "
        f"serial:DEVICE[,BAUD]; default {_DEFAULT_ADDRESS}",
    )
    parser.add_argument("--speedup", default="1", help="simulated seconds per second; default 1")
    parser.add_argument("--lockstep", action="store_true", help="take simulated time from standard input")
    parser.add_argument("--seed", default="0", help="seed of the sensor noise; default 0")
    parser.add_argument(
        "--param",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="set a parameter before boot; repeatable",
    )
    parser.add_argument(
        "--firmware-names",
        choices=list(GENERATIONS),
        default="own",
        help="firmware generation whose parameter names and units are used (values are converted); own: mid-2025",
    )
    parser.add_argument(
        "--effect",
        action="append",
        default=[],
        metavar="SLUG[@PLACE].PARAM=VALUE[,...]",
        help="add an effect, e.g. dead-zone.width=0.05, backlash@throttle.width=0.1. Inputs are normalised output, "
        "other values SI. Repeatable",
    )
    parser.add_argument(
        "--model",
        type=Path,
        metavar="FILE",
        help="simulate hull dynamics and effects of a model file (of 'gcs-autotune diagnose')",
    )
    parser.add_argument("--list-effects", action="store_true", help="list the effects and their parameters")
    parser.add_argument(
        "--signing-key",
        type=Path,
        metavar="FILE",
        help="obey only messages signed with the key in FILE (32 bytes, or a passphrase in one line)",
    )
    parser.add_argument("--eeprom", type=Path, metavar="FILE", help="keep written parameters in FILE")
    add_options(parser)
    return parser


class _Usage(ValueError):
    """Raised when the command line is not valid."""


def _read_presets(arguments: Sequence[str]) -> dict[str, float]:
    presets: dict[str, float] = {}
    for argument in arguments:
        name, _, value = argument.partition("=")
        try:
            presets[name] = number(value)
        except Refused as error:
            raise _Usage(f"--param {clipped(argument)} is not NAME=VALUE with a finite number") from error
    return presets


def _speedup(text: str) -> float:
    try:
        speedup = number(text)
        if _SLOWEST <= speedup <= _QUICKEST:
            return speedup
    except Refused:
        pass
    raise _Usage(
        f"--speedup {clipped(text)} is not valid. Use {_SLOWEST:g} to {_QUICKEST:g} simulated seconds per second. A "
        "slow computer runs as fast as it can"
    )


def _open(args: argparse.Namespace) -> Server:
    if args.vehicle is None:
        raise _Usage(f"no vehicle selected. Use one of {', '.join(VEHICLES)}")
    args.speedup = _speedup(args.speedup)
    args.seed = _seed(args.seed)
    load_vehicle(args.vehicle)
    presets = dict(read_parameters(args.eeprom)) if args.eeprom else {}
    presets.update(_read_presets(args.param))
    try:
        effects = [parse_effect(text) for text in args.effect]
        model = read_model(args.model) if args.model else None
        server = open_vehicle(
            args.vehicle,
            seed=args.seed,
            parameters=presets,
            effects=effects,
            model=model,
            names=args.firmware_names,
        )
        if args.signing_key:
            demand_signatures(server.codec, read_key(args.signing_key))
    except KeyError as error:
        raise _Usage(f"the firmware of {args.vehicle} has no parameter {error}") from error
    if args.eeprom:
        keep_parameters(server.vehicle.dialect, args.eeprom)
    return server


def _run(args: argparse.Namespace) -> None:
    server = _open(args)
    if args.lockstep:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        serve_lockstep(server, sys.stdin.buffer, sys.stdout.buffer)
        return
    link = open_link(args.listen)
    try:
        print(f"{server.vehicle.data.title}: {args.listen}, speed-up {args.speedup:g}", file=sys.stderr, flush=True)
        serve_free_running(server, link, Pacer(args.speedup))
    finally:
        link.close()


def _run_under_ardupilot(args: argparse.Namespace) -> None:
    """Serve the bare hull to ArduPilot's own firmware, or write the parameters that it needs."""
    if args.vehicle is None:
        raise _Usage(f"no vehicle selected. Use one of {', '.join(VEHICLES)}")
    strange = [name for name in ("param", "eeprom", "lockstep") if getattr(args, name)]
    if strange:
        raise _Usage(f"--{strange[0]} applies to this simulator's autopilot. For ArduPilot use --ardupilot-params FILE")
    data = load_vehicle(args.vehicle)
    if args.ardupilot_params:
        write_parameters(data, args.ardupilot_params)
    if args.ardupilot_json:
        effects = [parse_effect(text) for text in args.effect]
        model = read_model(args.model) if args.model else None
        run_json(data, args.ardupilot_json, args.ardupilot_params, seed=_seed(args.seed), effects=effects, model=model)


def _show_vehicles() -> None:
    for name in VEHICLES:
        print(f"{name:16} {load_vehicle(name).title}")


def _check(path: Path) -> int:
    """Print what is wrong with the vehicle file *path*, and return the exit code."""
    faults = check_vehicle(path)
    for fault in faults:
        print(f"sitl: {clipped(fault, 400)}", file=sys.stderr)
    if not faults:
        print(f"{path}: {load_vehicle(str(path)).title}: no faults found")
    return _USAGE if faults else _OK


def _show_effects() -> None:
    for slug, kind in EFFECTS.items():
        print(f"{slug:26} {kind.meaning}")
        for p in kind.parameters:
            default = "" if p.default is None else f" (default {p.default:g})"
            print(f"{'':26}   {p.name} [{p.unit}]{': ' if p.meaning else ''}{p.meaning}{default}")
        print(f"{'':26}   on a vehicle: {kind.on_vehicles}")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line *argv* and return the exit code: 0 ok, 2 wrong usage, 3 address not available."""
    args = _make_parser().parse_args(argv)
    before = {number: signal.signal(number, _stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        if args.check:
            return _check(args.check)
        if args.list:
            _show_vehicles()
        elif args.list_effects:
            _show_effects()
        elif args.ardupilot_json or args.ardupilot_params:
            _run_under_ardupilot(args)
        else:
            _run(args)
    except (UnknownVehicle, AddressError, ValueError) as error:
        print(f"sitl: {error}", file=sys.stderr)
        return _USAGE
    except CannotListen as error:
        print(f"sitl: {error}", file=sys.stderr)
        return _IN_USE
    except (_Stopped, BrokenPipeError):
        return _OK
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    return _OK


if __name__ == "__main__":
    sys.exit(main())
