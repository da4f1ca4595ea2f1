"""The simulated vehicle of a case: a vehicle file with changed numbers, and its link."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from gcs_autotune.errors import UsageError
from gcs_autotune.registry import nearest_of
from gcs_autotune_files import Refused, read

__all__ = ["NONE", "file_of_user", "link_of", "unit_in"]

_FILE = ".toml"
_UNSTATED = "SI"
"""Unit of a number that the file of the vehicle does not contain."""
NONE = "none"
"""Value of ``effect`` for a vehicle without one."""
_LENGTH_POWERS: Mapping[str, float] = {
    "kg": 3.0,
    "N": 3.0,
    "N m": 4.0,
    "kg m^2": 5.0,
    "N s/m": 2.5,
    "N s^2/m^2": 2.0,
    "N m s": 4.5,
    "N m s^2": 5.0,
    "N m/rad": 4.0,
    "N/rad": 3.0,
    "m": 1.0,
    "m/s": 0.5,
    "s": 0.5,
}
"""Unit -> power of the length ratio by Froude's law: equal density, and speed as the square root of the length."""
_SCALED = ("surge", "sway", "yaw", "heave", "pitch", "thruster", "parameters")
"""Tables of a vehicle file whose numbers change with the size of the craft; sensors and delays do not."""


def file_of_user(given: Mapping[str, Any], home: Path) -> str:
    """Return the text of the vehicle file that a case is like, if it is a file of the user; else an empty text."""
    like = str(given.get("vehicle.like", ""))
    return (home / like).read_text(encoding="utf-8") if like.endswith(_FILE) and (home / like).is_file() else ""


def link_of(given: Mapping[str, Any], folder: Path, home: Path) -> str:
    """Return the link (``sitl:``) to the vehicle of a case. Its file is written to *folder* if a number differs.

    home : folder of the study, to which the path of a vehicle file is relative.

    Raises
    ------
    UsageError
        The vehicle is missing, or a number to be multiplied is not in its file.
    """
    vehicle = {name.partition(".")[2]: value for name, value in given.items() if name.startswith("vehicle.")}
    like = vehicle.pop("like", None)
    if not isinstance(like, str):
        raise UsageError('vehicle.like is missing. Add e.g. vehicle.like = "blueboat" under fixed')
    name = like = str(home / like) if like.endswith(_FILE) else like
    if vehicle:
        path = folder / "vehicle.toml"
        path.write_text(_file_of(like, vehicle), encoding="utf-8")
        name = str(path)
    query = "&".join(f"effect={text.replace('&', '%26')}" for text in _effects(given))
    return f"sitl:{name}{'?' if query else ''}{query}"


def unit_in(likes: Collection[str], number: str, home: Path) -> str:
    """Return the unit of a *number* (HEADING.NAME) in the files of the vehicles *likes*.

    The unit is SI if no file contains the number, and empty if the files differ or one cannot be read.
    """
    heading, _, name = number.partition(".")
    try:
        files = [_tables(str(home / like) if like.endswith(_FILE) else like) for like in likes]
    except UsageError:
        return ""
    units = {file.get(heading, {}).get(name, {}).get("unit", _UNSTATED) for file in files}
    return units.pop() if len(units) == 1 else ""


def _effects(given: Mapping[str, Any]) -> list[str]:
    """Return the effects of a case in the simulator's notation, ``SLUG[@PLACE].PARAM=VALUE,...``."""
    found: dict[str, list[str]] = {}
    texts = []
    for name, value in given.items():
        first, _, rest = name.partition(".")
        if first != "effect":
            continue
        if not rest:
            texts += [] if value == NONE else str(value).split("+")
            continue
        slug, _, parameter = rest.rpartition(".")
        found.setdefault(slug, []).append(f"{parameter}={value}")
    return [*texts, *(f"{slug}.{','.join(parts)}" for slug, parts in found.items())]


def _file_of(like: str, changed: Mapping[str, Any]) -> str:
    """Return the text of a vehicle file: *like* a vehicle, with the *changed* numbers."""
    own = _tables(like)
    tables: dict[str, dict[str, Any]] = {}
    scale = changed.get("scale")
    if scale is not None:
        for heading, name, value in _scaled(own, float(scale)):
            tables.setdefault(heading, {})[name] = value
    for path, value in changed.items():
        heading, _, rest = path.partition(".")
        name, _, times = rest.partition(".")
        if not rest:
            if heading != "scale":
                raise UsageError(f"vehicle.{path}: a value is expected one level deeper, e.g. vehicle.yaw.alpha")
            continue
        if times not in ("", "times"):
            raise UsageError(f"vehicle.{path}: only 'times' may follow the name of a number")
        if times:
            present = tables.get(heading, {}).get(name, own.get(heading, {}).get(name, {}).get("value"))
            if present is None:
                raise UsageError(f"vehicle.{path}: {like} has no number {heading}.{name} to multiply")
            value = [v * value for v in present] if isinstance(present, list) else present * value
        tables.setdefault(heading, {})[name] = value
    lines = [f'title = "a case of a study, like {like}"']
    if not like.endswith(_FILE):
        lines.append(f"like = {json.dumps(like)}")
    else:
        for heading, entries in own.items():  # a file of the user cannot be named by ``like``
            if isinstance(entries, dict):
                tables[heading] = {**{n: e["value"] for n, e in entries.items()}, **tables.get(heading, {})}
            elif heading != "title":
                lines.append(f"{heading} = {json.dumps(entries)}")
    for heading, values in tables.items():
        lines.append(f"[{heading}]")
        for name, value in values.items():
            unit = own.get(heading, {}).get(name, {}).get("unit", _UNSTATED)
            lines.append(f'{name} = {{ value = {json.dumps(value)}, unit = {json.dumps(unit)}, source = "study" }}')
    return "\n".join(lines) + "\n"


def _scaled(own: Mapping[str, Any], scale: float) -> list[tuple[str, str, Any]]:
    found = []
    for heading in _SCALED:
        for name, entry in own.get(heading, {}).items():
            power = _LENGTH_POWERS.get(entry["unit"])
            if power is not None:
                value = entry["value"]
                factor = scale**power
                found.append(
                    (heading, name, [v * factor for v in value] if isinstance(value, list) else value * factor)
                )
    return found


def _tables(like: str) -> dict[str, Any]:
    """Return the tables of the vehicle *like*, a name of the simulator or a file, completed from the one it is like."""
    spec = importlib.util.find_spec("sitl")
    folders = [] if spec is None else [Path(f, "vehicles") for f in spec.submodule_search_locations or []]
    if like.endswith(_FILE):
        path = Path(like)
    else:
        path = next((p for f in folders if (p := f / f"{like.replace('-', '_')}.toml").is_file()), Path(like))
    try:
        own: dict[str, Any] = read(path, "toml")
    except Refused as error:
        known = [file.stem.replace("_", "-") for f in folders for file in sorted(f.glob(f"*{_FILE}"))]
        hint = "" if like.endswith(_FILE) else nearest_of(like, known)[1]
        raise UsageError(f"vehicle.like: the file of '{like}' cannot be read: {error}.{hint}") from error
    base = _tables(own["like"]) if isinstance(own.get("like"), str) else {}
    merged = dict(base)
    for heading, entries in own.items():
        merged[heading] = {**base.get(heading, {}), **entries} if isinstance(entries, dict) else entries
    merged.pop("like", None)
    return merged
