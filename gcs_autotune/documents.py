"""Files of others as bounded plain data and as the types of a schema; what is wrong is a :class:`BadFile` in one line.

The loader itself is :mod:`gcs_autotune_files`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, TypeVar

from gcs_autotune.errors import BadFile
from gcs_autotune_files import Refused, conform, read

__all__ = ["conformed", "load_json", "load_toml"]

T = TypeVar("T")


def load_json(path: Path, what: str) -> Any:
    """Return what the JSON file at *path* holds; *what* it should be stands in the message.

    Raises
    ------
    BadFile
        It cannot be read, is no JSON, or is beyond the bounds of :mod:`gcs_autotune_files`.
    """
    return _load(path, "json", what)


def load_toml(path: Path, what: str) -> dict[str, Any]:
    """Return the tables of the TOML file at *path*; errors as those of :func:`load_json`."""
    tables: dict[str, Any] = _load(path, "toml", what)
    return tables


def _load(path: Path, kind: Any, what: str) -> Any:
    try:
        return read(path, kind)
    except Refused as error:
        raise BadFile(f"{path} cannot be read as {what}: {error}") from error


def conformed(data: Any, form: type[T], where: object) -> T:
    """Return plain *data* as *form*; *where* it stands begins the message.

    Raises
    ------
    BadFile
        It is not of that form.
    """
    try:
        return conform(data, form)
    except Refused as error:
        raise BadFile(f"{where}: {error}") from error
