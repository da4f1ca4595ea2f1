"""Persistent parameters: a text file of ``NAME,VALUE`` lines."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from gcs_autotune_files import Refused, number, read_text, shown
from sitl.autopilot import ParameterDialect

__all__ = ["keep_parameters", "read_parameters"]


def read_parameters(path: Path) -> Mapping[str, float]:
    """Return name -> value of the parameters stored in *path*; empty if there is no such file yet.

    Raises
    ------
    ValueError
        A line is not ``NAME,VALUE``.
    """
    if not path.exists():
        return {}
    values: dict[str, float] = {}
    for row, line in enumerate(_lines(path), start=1):
        name, _, value = line.partition(",")
        try:
            values[name] = number(value)
        except Refused as error:
            raise ValueError(
                f"{path}, line {row}: {shown(line)} is not NAME,VALUE. Delete the file or the line"
            ) from error
    return values


def _lines(path: Path) -> list[str]:
    try:
        return read_text(path).splitlines()
    except Refused as error:
        raise ValueError(f"{path} cannot be read: {error}") from error


def keep_parameters(store: ParameterDialect, path: Path) -> None:
    """Store every later change of a parameter in *path*. The whole file is written and then renamed."""
    changed = dict(read_parameters(path))

    def save(name: str, value: float) -> None:
        changed[name] = value
        fresh = path.with_name(path.name + ".part")
        fresh.write_text("".join(f"{key},{held!r}\n" for key, held in changed.items()), encoding="utf-8")
        fresh.replace(path)

    store.on_change = save
