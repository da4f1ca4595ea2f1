"""Check the folder of a new run, recognise a report, and read JSON and TOML files as plain data or by a schema.

Any error in such a file raises :class:`BadFile` with a message of one line.

The loader itself, with its limits on size, is :mod:`gcs_autotune_files`.
"""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import Any, TypeVar

from msgspec import Struct

from gcs_autotune.errors import BadFile, UsageError
from gcs_autotune_files import Refused, conform, read

__all__ = [
    "MODEL",
    "REPORT_MARK",
    "SETTING_OUT",
    "SettingOut",
    "check_run_folder",
    "conformed",
    "is_report",
    "load_json",
    "load_setting_out",
    "load_toml",
    "model_file",
]

MODEL = "model.json"
"""The model file of a run directory."""
SETTING_OUT = "setting_out.json"
"""File of a run directory with the settings, vehicle and parameters at the start of the run."""
REPORT_MARK = '<meta name="generator" content="gcs-autotune">'
"""Element in the head of every report page that the program writes."""

T = TypeVar("T")


class SettingOut(Struct, frozen=True):
    """The start of a run: its settings, the vehicle's board, its fingerprint and its parameters."""

    settings: dict[str, float | str | bool | None] = {}
    vehicle: dict[str, int | str | None] = {}
    fingerprint: dict[str, float] = {}
    parameters: dict[str, float] = {}


def is_report(path: Path) -> bool:
    """Return whether the file at *path* begins like a report page of this program."""
    with path.open("rb") as file:
        head = file.read(1024)
    return head.startswith(b"<!DOCTYPE html>") and REPORT_MARK.encode() in head


def load_json(path: Path, what: str) -> Any:
    """Return the content of the JSON file at *path*. *what* is its expected type, for the message.

    Raises
    ------
    BadFile
        The file cannot be read, is not JSON, or exceeds the limits of :mod:`gcs_autotune_files`.
    """
    return _load(path, "json", what)


def model_file(path: Path) -> Path:
    """Return the model file at *path*, which may also be a run directory.

    Raises
    ------
    BadFile
        The run directory contains no model.
    """
    if not path.is_dir():
        return path
    if not (path / MODEL).is_file():
        raise BadFile(
            f"{path} contains no {MODEL}. Identify it first: gcs-autotune identify {shlex.quote(str(path))} --save FILE"
        )
    return path / MODEL


def load_setting_out(run: Path) -> SettingOut:
    """Return the start settings of the run directory *run*; it raises the errors of :func:`load_json`."""
    path = run / SETTING_OUT
    return conformed(load_json(path, "the start settings of a run"), SettingOut, path)


def load_toml(path: Path, what: str) -> dict[str, Any]:
    """Return the tables of the TOML file at *path*; it raises the errors of :func:`load_json`."""
    tables: dict[str, Any] = _load(path, "toml", what)
    return tables


def _load(path: Path, kind: Any, what: str) -> Any:
    try:
        return read(path, kind)
    except Refused as error:
        raise BadFile(f"{path} cannot be read as {what}: {error}") from error


def conformed(data: Any, form: type[T], where: object) -> T:
    """Return plain *data* converted to *form*. *where*: start of the message.

    Raises
    ------
    BadFile
        The data do not have that form.
    """
    try:
        return conform(data, form)
    except Refused as error:
        raise BadFile(f"{where}: {error}") from error


def check_run_folder(path: Path) -> None:
    """Check that a run can be stored at *path*. Nothing is created yet.

    Raises
    ------
    UsageError
        The folder already contains a run, or cannot be created.
    """
    if (path / "trials").exists():
        raise UsageError(f"{path} already contains a run. Use another --out")
    above = next(p for p in (path, *path.absolute().parents) if p.exists())
    if not above.is_dir():
        raise UsageError(f"cannot create the run directory {path}: {above} is not a directory. Use another --out")
    if not os.access(above, os.W_OK | os.X_OK):
        raise UsageError(f"cannot create the run directory {path}: {above} is not writable. Use another --out")
