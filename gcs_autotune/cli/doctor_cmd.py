"""``gcs-autotune doctor`` and ``gcs-autotune ports``: check this computer, and list the vehicles on its ports."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from gcs_autotune.cli.command import Command, add_number, waiting
from gcs_autotune.cli.config_file import find_config
from gcs_autotune.cli.writing import folded
from gcs_autotune.plain_json import json_text
from gcs_autotune.untrusted_text import visible

__all__ = ["DOCTOR", "PORTS"]

UNFIT = 1
"""Exit code of ``doctor`` if something prevents a tune."""
SIGNS = {"fine": " ", "note": "!", "wrong": "X"}


def _add_listening(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--connect",
        metavar="URI",
        action="append",
        help="listen on this link only (default: every serial port at 57600 and 115200 baud, and UDP 14550)",
    )
    add_number(parser, "listen", "S")
    parser.add_argument("--json", action="store_true", help="print JSON on standard output")


def _doctor(args: argparse.Namespace) -> int:
    with waiting(args, "checking this computer"):
        from gcs_autotune.workflow import examine

        findings = list(examine(Path("runs"), find_config()))
    if not args.json:
        for finding in findings:
            _print(SIGNS[finding.state], finding.what, finding.told + (f". {finding.cure}" if finding.cure else ""))
    ports = _listen(args, told=not args.json)
    wrong = sum(f.state == "wrong" for f in findings)
    if args.json:
        sys.stdout.write(json_text({"schema": 1, "findings": [asdict(f) for f in findings], "ports": ports}))
    elif wrong:
        sys.stdout.write(f"\nNot ready: correct the {'line' if wrong == 1 else f'{wrong} lines'} marked X.\n")
    else:
        _close("This computer is ready. ", ports)
    return UNFIT if wrong else 0


def _ports(args: argparse.Namespace) -> int:
    ports = _listen(args, told=not args.json)
    if args.json:
        sys.stdout.write(json_text({"schema": 1, "ports": ports}))
    else:
        _close("", ports)
    return 0


def _close(verdict: str, ports: Sequence[Mapping[str, object]]) -> None:
    """Print the *verdict*, what was received, and the next command on a line of its own."""
    found, command = _next(ports)
    sys.stdout.write("\n" + folded(f"{verdict}{found}:", sys.stdout) + f"  gcs-autotune tune heading{command}\n")


def _next(ports: Sequence[Mapping[str, object]]) -> tuple[str, str]:
    """Return what was received and what the next command does, and the options of this command."""
    uris = [str(port["uri"]) for port in ports if port["systems"]]
    if not uris:
        from gcs_autotune.link import is_serial

        wired = any(is_serial(str(port["uri"])) for port in ports)
        check = "cable, the baud rate and the network" if wired else "network"
        text = f"No vehicle was found. To connect one, check its power and the {check}. To try a simulated vehicle"
        return text, ""
    heard = "A vehicle was found." if len(uris) == 1 else f"Vehicles were found on {len(uris)} links."
    return f"{heard} Next", f" --connect {visible(shlex.quote(uris[0]))}"


def _listen(args: argparse.Namespace, *, told: bool) -> list[dict[str, object]]:
    """Listen on each port in turn and print the result of each. A terminal shows what is being listened to."""
    from rich.console import Console

    with waiting(args, "looking for ports"):
        from gcs_autotune.workflow import listened_to

    found: list[dict[str, object]] = []
    uris: Iterable[str] | None = args.connect
    with Console(stderr=True).status("looking for ports") as status:
        for name, heard in listened_to(args.listen, uris, say=lambda text: status.update(visible(text))):
            if told:
                link = f"; --connect {heard.uri}" if heard.autopilots else ""
                _print(" ", "port", f"{name}: {heard.description}{link}")
            found.append(
                {
                    "port": name,
                    "uri": heard.uri,
                    "told": heard.description,
                    "systems": [a.system for a in heard.autopilots],
                }
            )
    return found


def _print(sign: str, what: str, text: str) -> None:
    sys.stdout.write(folded(f"{sign} {what:9s} {visible(text)}", sys.stdout, 12 * " "))
    sys.stdout.flush()


DOCTOR = Command(
    description="Check whether this computer can run a tune, and listen on its ports. Nothing is sent and nothing "
    "moves. A line with X prevents a tune (exit code 1). A line with ! is a caution.",
    add_arguments=_add_listening,
    run=_doctor,
)
PORTS = Command(
    description="List this computer's serial ports and UDP 14550, the vehicle received on each, and its --connect "
    "option. Nothing is sent.",
    add_arguments=_add_listening,
    run=_ports,
)
