"""Check a vehicle file: every fault with the file, the line and the quantity."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from gcs_autotune_files import Refused, Unreadable, parse, read_text
from sitl.catalogue import BadVehicle, VehicleData, load_vehicle
from sitl.craft import Craft, Diverged
from sitl.vehicle import Vehicle
from sitl.vehicle_file import verify_entries

__all__ = ["check_vehicle"]

_HEADING = re.compile(r"\s*\[\s*([\w-]+)\s*\]")
_ENTRY = re.compile(r"\s*([\w-]+)\s*=")
_PLACE = re.compile(r"([\w-]+)(?:\.([\w|-]+))?(?:\.value(?:\.\d+)?|\.unit|\.source)?[ :]")
_UNKNOWN = re.compile(r"(?:([\w-]+): )?unknown entry '([\w-]+)'")
_FLIGHT, _LEG = ([2000] * 16, [1000] * 16, [2000, 1000] * 8, [2000, 2000, 1000, 1000] * 4, [1500] * 16), 3
"""Pulses [us] of the legs of a trial flight, and the length [s] of each. Project choice."""
_AT_LINE = re.compile(r" \(at line (\d+), column \d+\)")


def check_vehicle(path: Path) -> list[str]:
    """Return the faults of the vehicle file *path*, as ``FILE:LINE: what is wrong``; none if a vehicle starts from it.

    All entries that are wrong by themselves are listed. Only if there are none, the first contradiction between
    entries is. Only if there is none, the vehicle is flown for some seconds, to see whether its motion diverges.
    """
    try:
        text = read_text(path)
        tables = parse(text, "toml")
    except Unreadable as error:
        return [f"{path}: cannot be read: {error}"]
    except Refused as error:
        return [_located(path, "" if isinstance(error, Unreadable) else _text_of(path), str(error))]
    faults = list(dict.fromkeys(_located(path, text, fault) for fault in _faults(tables)))
    if faults:
        return faults
    try:
        data = load_vehicle(str(path))
    except BadVehicle as error:
        message = str(error).removeprefix(f"{path} is not a vehicle file: ")
        return [_located(path, text, message)]
    try:
        _fly(data)
    except KeyError as error:
        return [_located(path, text, f"parameters.{error.args[0]}: firmware '{data.firmware}' has no such parameter")]
    except Diverged as error:
        return [_located(path, text, str(error).removeprefix(f"{data.name}: "))]
    return []


def _fly(data: VehicleData) -> None:
    """Start the vehicle, and fly it with full outputs ahead, astern and against each other.

    Raises
    ------
    KeyError
        Its firmware does not have one of its parameters.
    Diverged
        Its motion diverges.
    """
    rate = Vehicle(data).rate
    craft = Craft(data)
    craft.begin("0")
    for k in range(rate * len(_FLIGHT) * _LEG):
        craft.move((k + 1) / rate, 1.0 / rate, _FLIGHT[k // (rate * _LEG)])


def _text_of(path: Path) -> str:
    try:
        return read_text(path)
    except Refused:
        return ""


def _faults(own: Mapping[str, Any]) -> Iterator[str]:
    """Yield what is wrong with each entry of a file by itself."""
    for heading, table in own.items():
        parts = table.items() if isinstance(table, dict) else ((None, table),)
        for name, entry in parts:
            try:
                verify_entries({heading: table if name is None else {name: entry}})
            except ValueError as error:
                yield str(error)


def _located(path: Path, text: str, fault: str) -> str:
    """Return *fault* with the file, and with the line of the entry that it begins with."""
    written = _AT_LINE.search(fault)
    if written:
        return f"{path}:{written[1]}: {_AT_LINE.sub('', fault)}"
    place = _UNKNOWN.match(fault) or _PLACE.match(fault)
    line = _line_of(text, place[1] or place[2], place[2] or "") if place else 0
    return f"{path}:{line}: {fault}" if line else f"{path}: {fault}"


def _line_of(text: str, heading: str, name: str) -> int:
    """Return the line of the entry *name* under *heading*, or of the heading, or of a top entry, or 0."""
    there, of_heading = "", 0
    for number, line in enumerate(text.splitlines(), start=1):
        if match := _HEADING.match(line):
            there = match[1]
            if there == heading:
                of_heading = number
        elif (match := _ENTRY.match(line)) and (
            (there == heading and match[1] == name) or (not there and match[1] == heading)
        ):
            return number
    return of_heading
