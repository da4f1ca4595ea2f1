"""Parameter files in the formats of other ground stations.

``NAME,VALUE`` (Mission Planner), ``NAME VALUE`` (MAVProxy), five columns ``system component NAME VALUE TYPE``
(QGroundControl), with ``#`` comments; or JSON, ``{"NAME": value}``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path

from gcs_autotune.errors import BadFile
from gcs_autotune_files import Refused, conform, number, parse, read_text, shown

__all__ = ["load_params", "save_params", "save_qgc_params"]

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,15}")
_QGC_COLUMNS = 5
_COUNT = re.compile("[0-9]{1,3}")
_LARGEST = 3.4028235e38
_REAL32 = 9
"""MAV_PARAM_TYPE_REAL32."""


def save_params(
    path: Path, values: Mapping[str, float], *, comment: str = "", defaults: Mapping[str, float] | None = None
) -> None:
    """Write *values*: JSON when *path* ends in ``.json``, else ``NAME,VALUE`` lines under an optional comment.

    defaults : the firmware's defaults, if known. JSON also contains them, under ``defaults``.

    Raises
    ------
    BadFile
        The file cannot be written.
    """
    if path.suffix == ".json":
        known = {"defaults": dict(defaults)} if defaults else {}
        text = json.dumps({"schema": 1, "comment": comment, "parameters": dict(values), **known}, indent=1) + "\n"
    else:
        head = "".join(f"# {line}\n" for line in comment.splitlines())
        text = head + "".join(f"{name},{value:.9g}\n" for name, value in values.items())
    _write(path, text)


def save_qgc_params(
    path: Path,
    values: Mapping[str, float],
    types: Mapping[str, int],
    vehicle: tuple[int, int],
    *,
    comment: str = "",
) -> None:
    """Write *values* as QGroundControl's ``.params``: five columns separated by tabs, the only format that it reads.

    types : MAV_PARAM_TYPE by name, as reported by the vehicle (REAL32 if not). QGroundControl ignores a parameter of
        another type. vehicle : its system and component id.

    Raises
    ------
    BadFile
        The file cannot be written.
    """
    system, component = vehicle
    head = "".join(f"# {line}\n" for line in (*comment.splitlines(), "", "Vehicle-Id Component-Id Name Value Type"))
    rows = (f"{system}\t{component}\t{n}\t{v:.9g}\t{types.get(n, _REAL32)}\n" for n, v in values.items())
    _write(path, head + "".join(rows))


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise BadFile(f"{path} cannot be written: {error.strerror}. Check the folder and the disk") from error


def load_params(path: Path) -> dict[str, float]:
    """Return name -> value from a parameter file of Mission Planner, MAVProxy or QGroundControl, or a JSON file.

    Raises
    ------
    BadFile
        The file is unreadable or empty, or a line is not a parameter. The message states the line number.
    """
    if not path.exists():
        raise BadFile(f"{path} does not exist. Give a parameter file with lines NAME,VALUE")
    try:
        text = read_text(path)
    except Refused as error:
        raise BadFile(f"{path} cannot be read as a parameter file: {error}") from error
    values = _from_json(path, text) if text.lstrip().startswith("{") else _from_lines(path, text)
    if not values:
        raise BadFile(f"{path} contains no parameters. Write each as NAME,VALUE, e.g. ATC_STR_RAT_P,0.2")
    return values


def _from_json(path: Path, text: str) -> dict[str, float]:
    try:
        data = parse(text)
    except Refused as error:
        raise BadFile(f"{path} cannot be read as a parameter file: {error}") from error
    table = data.get("parameters", data)
    if not isinstance(table, dict):
        raise BadFile(f"{path}: 'parameters' must be an object of names and numbers")
    return {name: _checked(path, shown(name), name, value) for name, value in table.items()}


def _from_lines(path: Path, text: str) -> dict[str, float]:
    values: dict[str, float] = {}
    lines: dict[str, int] = {}
    for row, line in enumerate(text.splitlines(), start=1):
        cells = [cell for cell in re.split(r"[,\s]+", line.partition("#")[0].strip()) if cell]
        if not cells:
            continue
        if len(cells) == _QGC_COLUMNS and all(_COUNT.fullmatch(cells[k]) for k in (0, 1, 4)):
            cells = cells[2:4]
        if len(cells) != 2:
            raise BadFile(f"{path}, line {row}: {shown(line.strip())} is not NAME,VALUE. Write e.g. ATC_STR_RAT_P,0.2")
        name = cells[0]
        if name in lines:
            raise BadFile(f"{path}, line {row}: {shown(name)} is already in line {lines[name]}. Remove one of them")
        lines[name] = row
        values[name] = _checked(path, f"line {row}", name, cells[1])
    return values


def _checked(path: Path, where: str, name: str, value: object) -> float:
    """Return a parameter's value as a float32, the type used by every autopilot."""
    try:
        found = number(value) if isinstance(value, str) else conform(value, float)
        if abs(found) <= _LARGEST and _NAME.fullmatch(name):
            return found
    except Refused:
        pass
    raise BadFile(f"{path}, {where}: {shown(name)} = {shown(value)} is not a parameter name and a number")
