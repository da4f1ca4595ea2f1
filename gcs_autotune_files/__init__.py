"""Load JSON and TOML files, for the tuner and the simulator. This package imports neither of them.

A file is not trusted: it may be cut off, huge, deeply nested, or contain numbers too large for a double. It is read in
two steps. Each raises :class:`Refused` with a message of one line.

* :func:`read` and :func:`parse` return plain data of limited size, depth, numbers and text.
* :func:`conform` converts it to the types of a schema (msgspec). Only whole numbers are converted to floats.

Schemas that both programs read are in :mod:`gcs_autotune_files.model`.
"""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, TypeVar

import msgspec

__all__ = [
    "DEEPEST",
    "LARGEST",
    "MOST_BYTES",
    "Refused",
    "Unreadable",
    "clipped",
    "conform",
    "number",
    "parse",
    "read",
    "read_text",
    "shown",
    "whole",
]

T = TypeVar("T")
Kind = Literal["json", "toml"]

MOST_BYTES = 32 * 1024 * 1024
"""Largest file. Project choice: a model with the covariance of 100 parameters has 0.3 MB, a lake's outline 5 MB."""
DEEPEST = 40
"""Largest number of levels of lists and tables. Project choice: our deepest file has 8, GeoJSON 9."""
LARGEST = 1e100
"""Largest number. Project choice: its cube is still a double, and the largest float32 is 3e38."""
_LONGEST_NUMBER = 400
"""Largest number of characters of a number. Project choice: a double written in full has at most 330."""
_LONGEST_WHOLE = 20
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_WORDS: Mapping[str, str] = {
    "float": "a number",
    "int": "a whole number",
    "str": "text",
    "bool": "true or false",
    "null": "nothing",
    "object": "a table",
    "array": "a list",
}
_KINDS: Mapping[str, tuple[type, ...]] = {
    "float": (int, float),
    "int": (int,),
    "str": (str,),
    "bool": (bool,),
    "object": (dict,),
    "array": (list,),
}


class Refused(ValueError):
    """The data is not as required. The message contains no path of a file."""


class Unreadable(Refused):
    """The file does not exist, or reading it is not permitted."""


def number(text: str) -> float:
    """Return the number written as *text* in ASCII digits, as ``-0.5``, ``3`` or ``1e-3``.

    Raises
    ------
    Refused
        It is written in another way (``1_0``, other digits, ``inf``), is too long, or too large.
    """
    stripped = text.strip(" \t")
    if stripped.lower().lstrip("+-") in ("nan", "inf", "infinity"):
        raise Refused(f"{shown(text)} is not a finite number")
    if len(stripped) > _LONGEST_NUMBER or _NUMBER.fullmatch(stripped) is None:
        raise Refused(f"{shown(text)} is not a number")
    value = float(stripped)
    if abs(value) > LARGEST:
        raise Refused(f"{shown(text)} is too large. The largest number is {LARGEST:g}")
    return value


def whole(text: str, most: int) -> int:
    """Return the whole number from 0 to *most* written as *text* in ASCII digits.

    Raises
    ------
    Refused
        It is written in another way, or larger.
    """
    if not (text.isascii() and text.isdecimal() and len(text) <= _LONGEST_WHOLE and int(text) <= most):
        raise Refused(f"{shown(text)} is not a whole number from 0 to {most}")
    return int(text)


def clipped(text: object, most: int = 40) -> str:
    """Return *text* without control characters, cut off after *most* characters."""
    safe = str(text)[: most + 1].encode("unicode_escape").decode()
    return safe if len(safe) <= most else f"{safe[:most]}..."


def shown(text: object, most: int = 40) -> str:
    """Return *text* in quotation marks, as :func:`clipped`."""
    return f"'{clipped(text, most)}'"


def read(path: Path, kind: Kind = "json") -> Any:
    """Return the content of a file as plain, bounded data.

    Raises
    ------
    Refused
        It cannot be read, or is not of that *kind*.
    """
    return parse(_bytes_of(path), kind)


def read_text(path: Path) -> str:
    """Return the text of a file of lines, without a byte order mark; errors as those of :func:`read`."""
    return _decoded(_bytes_of(path))


def _bytes_of(path: Path) -> bytes:
    try:
        with path.open("rb") as stream:
            data = stream.read(MOST_BYTES + 1)
    except OSError as error:
        raise Unreadable(error.strerror or str(error)) from error
    except ValueError as error:  # a NUL in the name
        raise Unreadable(str(error)) from error
    if len(data) > MOST_BYTES:
        raise Refused(f"it is larger than {MOST_BYTES // 1024 // 1024} MB")
    return data


def _decoded(data: bytes) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise Refused(f"byte {error.start + 1} is not UTF-8 text") from error


def parse(text: bytes | str, kind: Kind = "json") -> Any:
    """Return the content of *text* as plain data: finite numbers, encodable text, no name twice in one table.

    Raises
    ------
    Refused
        It is not of that *kind*, or exceeds the limits of this module.
    """
    if isinstance(text, bytes):
        text = _decoded(text)
    try:
        data = tomllib.loads(text) if kind == "toml" else _json(text)
    except RecursionError as error:
        raise Refused(f"it is nested more than {DEEPEST} levels deep") from error
    except Refused:
        raise
    except json.JSONDecodeError as error:
        raise Refused(f"line {error.lineno} is not JSON: {_short(error.msg)} at column {error.colno}") from error
    except ValueError as error:
        raise Refused(_short(str(error))) from error
    _bounded(data)
    return data


def _json(text: str) -> Any:
    return json.loads(
        text, parse_constant=_constant, parse_float=_from_json, parse_int=_whole, object_pairs_hook=_table
    )


def _constant(text: str) -> float:
    raise Refused(f"{text} is not a JSON number")


def _from_json(text: str) -> float:
    return number(text)


def _whole(text: str) -> int:
    number(text)
    return int(text)


def _table(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise Refused(f"{shown(twice)} appears twice")
    return table


def _bounded(data: Any) -> None:
    """Verify, without recursion, that plain data is finite, shallow and encodable."""
    level: list[tuple[str, Any]] = [("", data)]
    for _ in range(DEEPEST + 1):
        deeper: list[tuple[str, Any]] = []
        for place, each in level:
            if isinstance(each, (dict, list)):
                named = each.items() if isinstance(each, dict) else enumerate(each)
                for name, value in named:
                    _verify_value(place, name)
                    deeper.append((f"{place}.{name}" if place else str(name), value))
            else:
                _verify_value(place, each)
        if not deeper:
            return
        level = deeper
    raise Refused(f"it is nested more than {DEEPEST} levels deep")


def _verify_value(place: str, value: object) -> None:
    at = f"{clipped(place, 100)}: " if place else ""
    if isinstance(value, str):
        try:
            value.encode("utf-8")
        except UnicodeEncodeError:
            raise Refused(f"{at}{shown(value)} contains half a character (a lone surrogate)") from None
    elif isinstance(value, (int, float)) and not abs(value) <= LARGEST:
        if isinstance(value, float) and not math.isfinite(value):
            raise Refused(f"{at}{value:g} is not a finite number")
        large = "a whole number of more than 100 digits" if isinstance(value, int) else f"{value:g}"
        raise Refused(f"{at}{large} is too large. The largest number is {LARGEST:g}")


def conform(data: Any, form: type[T]) -> T:
    """Return plain *data* as *form*, a type of msgspec. Only whole numbers are converted, to floats.

    Raises
    ------
    Refused
        An entry is missing, unknown, of another type or out of range. The message contains its place.
    """
    try:
        return msgspec.convert(data, form, strict=True)
    except msgspec.ValidationError as error:
        raise Refused(_in_words(str(error), data)) from error


def _in_words(message: str, data: Any) -> str:
    """Return msgspec's *message* in plain words, with the name of the wrong entry."""
    what, _, path = message.partition(" - at `")
    expected = re.findall(r"`([^`]+)`", what)
    where = _place(path.rstrip("`"), data, expected[0].split(" | ") if expected else [])

    def words(found: re.Match[str]) -> str:
        return " or ".join(_WORDS.get(kind, f"'{kind}'") for kind in found[1].split(" | "))

    plain = re.sub(r"`([^`]+)`", words, what)
    plain = plain.replace("Object missing required field", "missing entry").replace(
        "Object contains unknown field", "unknown entry"
    )
    return _short(f"{where}: {plain[0].lower()}{plain[1:]}" if where else f"{plain[0].lower()}{plain[1:]}")


def _place(path: str, data: Any, expected: list[str]) -> str:
    """Return the place in the file. msgspec writes ``[...]`` for an entry of a table, without its name."""
    names: list[str] = []
    for step in re.findall(r"\[\.\.\.\]|\[\d+\]|\.[^.\[]+", path):
        if step == "[...]" and isinstance(data, dict):
            name = next((n for n, v in data.items() if not _fits(v, expected)), "...")
        else:
            name = step.strip(".[]")
        names.append(name if name == "..." else clipped(name))
        try:
            data = data[int(name)] if isinstance(data, list) else data[name]
        except (KeyError, IndexError, ValueError, TypeError):
            data = None
    return ".".join(names)


def _fits(value: object, expected: list[str]) -> bool:
    kinds = tuple(kind for name in expected for kind in _KINDS.get(name, ()))
    return isinstance(value, kinds) and (bool in kinds or not isinstance(value, bool))


def _short(text: str, most: int = 200) -> str:
    return text if len(text) <= most else f"{text[:most]}..."
