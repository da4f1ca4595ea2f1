"""Command-line options for a hull controlled by ArduPilot: ``--ardupilot-json`` and ``--ardupilot-params``."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from sitl.ardupilot_json.firmware import needed_parameters, parameter_text, start_commands
from sitl.ardupilot_json.physics import Physics
from sitl.ardupilot_json.serve import DEFAULT_PORT, JsonServer
from sitl.catalogue import VehicleData
from sitl.effects import HiddenEffect
from sitl.listen import AddressError, host_and_port
from sitl.modelfile import FlownModel

__all__ = ["add_options", "run_json", "write_parameters"]


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--ardupilot-json`` and ``--ardupilot-params`` to *parser*."""
    parser.add_argument(
        "--ardupilot-json",
        nargs="?",
        const=str(DEFAULT_PORT),
        metavar="[HOST:]PORT",
        help="serve the hull as external physics to ArduPilot's own SITL (its --model JSON) instead of using this "
        f"simulator's autopilot. Default port {DEFAULT_PORT} is for ArduPilot's instance 0 (instance I: "
        f"{DEFAULT_PORT} + 10 I). Prints the command that starts ArduPilot",
    )
    parser.add_argument(
        "--ardupilot-params",
        type=Path,
        metavar="FILE",
        help="write the parameters that ArduPilot needs for this vehicle to FILE, for ArduPilot's --defaults",
    )


def write_parameters(data: VehicleData, path: Path) -> None:
    """Write the parameters that ArduPilot needs to *path*. Raises ``ValueError`` if that is not possible."""
    try:
        path.write_text(parameter_text(data), encoding="utf-8")
    except OSError as error:
        raise ValueError(f"--ardupilot-params {path}: {error.strerror}") from error


def run_json(
    data: VehicleData,
    address: str,
    parameters: Path | None,
    *,
    seed: int,
    effects: Sequence[HiddenEffect],
    model: FlownModel | None,
) -> None:
    """Serve the hull of *data* at *address* until interrupted. Report the speed on standard error."""
    host, port = _read_address(address)
    server = JsonServer(Physics(data, seed=seed, effects=effects, model=model), host=host, port=port, say=_say)
    _say(f"{data.title}: external physics at {host}:{server.port}, waiting for ArduPilot. Start ArduPilot with")
    _say(f"  {start_commands(data, server.port, str(parameters or 'FILE'), host=host)}")
    if parameters is None:
        _say("  FILE with these parameters (--ardupilot-params FILE writes it):")
        _say("  " + ", ".join(f"{name} {value:.9g}" for name, value in needed_parameters(data).items()))
    began = time.monotonic()
    try:
        server.serve()
    finally:
        server.close()
        if server.frames:
            passed, wall = server.simulated, time.monotonic() - (server.began or began)
            _say(f"{server.frames} frames, {passed:.1f} s simulated in {wall:.1f} s: {passed / wall:.1f} x real time")


def _read_address(text: str) -> tuple[str, int]:
    """Parse ``PORT`` or ``HOST:PORT`` into (host, port)."""
    try:
        return host_and_port(text if ":" in text else f"127.0.0.1:{text}")
    except AddressError as error:
        raise AddressError(f"--ardupilot-json {text} is not PORT or HOST:PORT. Use e.g. {DEFAULT_PORT}") from error


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
