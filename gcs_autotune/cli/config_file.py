"""``gcs-autotune.toml``: settings file with the link and safety limits that are used often.

::

    [link]
    connect = "/dev/ttyUSB0,57600"
    [limits]
    max-distance = 40

It is searched in the working folder, then in the user's configuration folder; only the first one is used. The
command line takes precedence. Numbers must be inside the table of limits, like typed ones.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gcs_autotune.cli.command import GUARDING
from gcs_autotune.documents import load_toml
from gcs_autotune.errors import BadFile, UnknownName, UsageError
from gcs_autotune.limits import limit_of
from gcs_autotune.registry import lookup
from gcs_autotune_files import clipped

__all__ = ["CONFIG_NAME", "CONFIG_VARIABLE", "NO_CONFIG", "ConfigFile", "find_config", "read_config", "shown_value"]

CONFIG_NAME = "gcs-autotune.toml"
CONFIG_VARIABLE = "GCS_AUTOTUNE_CONFIG"
"""Environment variable with the path of the file, or ``none`` for no file."""
NONE = "none"

_TEXTS = ("connect", "backend")
_PATHS = ("signing-key",)
_NUMBERS = ("baud", "system-id", "source-system")
TABLES: Mapping[str, tuple[str, ...]] = {"link": (*_TEXTS, *_PATHS, *_NUMBERS), "limits": GUARDING}
"""Table of the file -> options allowed in it, by their names on the command line."""


@dataclass(frozen=True, slots=True)
class ConfigFile:
    """Settings of the file: option (without dashes) -> value as on the command line; empty without a file."""

    path: Path | None = None
    values: Mapping[str, Any] = field(default_factory=dict)

    def apply(self, parser: argparse.ArgumentParser) -> None:
        """Use the values as defaults of *parser* and its verbs, and show them in the help of each option."""
        said = False
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction):
                for verb in action.choices.values():
                    self.apply(verb)
            name = next((o[2:] for o in action.option_strings if o.startswith("--")), "")
            if name not in self.values or (name == "connect" and parser.get_default("configured_link") is None):
                continue
            if name == "connect":
                parser.set_defaults(configured_link=self.values[name])
            else:
                parser.set_defaults(**{action.dest: self.values[name]})
            shown = shown_value(self.values[name]).replace("%", "%%")
            action.help = f"{action.help} [{CONFIG_NAME}: {shown}]"
            said = True
        if said:
            parser.epilog = f"{parser.epilog + chr(10) * 2 if parser.epilog else ''}settings: {self.path}"

    def used_by(self, args: argparse.Namespace) -> dict[str, Any]:
        """Return the settings of the file that apply to *args*: options of this command that were not typed."""
        found = {}
        for name, value in self.values.items():
            if name == "connect":
                in_force = not args.connect and getattr(args, "configured_link", None) if "connect" in args else None
            else:
                in_force = getattr(args, name.replace("-", "_"), None)
            if in_force == value:
                found[name] = value
        return found


NO_CONFIG = ConfigFile()


def find_config() -> Path | None:
    """Return the path of the settings file; None if there is none.

    Raises
    ------
    UsageError
        The file set in the environment does not exist.
    """
    named = os.environ.get(CONFIG_VARIABLE)
    if named is not None:
        if named.lower() in (NONE, ""):
            return None
        if not Path(named).is_file():
            raise UsageError(
                f"{CONFIG_VARIABLE} is set to {named}, which is not a file. Set it to '{NONE}' to use no settings file"
            )
        return Path(named)
    here = Path(CONFIG_NAME)
    if here.is_file():
        return here.resolve()
    from platformdirs import user_config_path

    users = user_config_path("gcs-autotune") / CONFIG_NAME
    return users if users.is_file() else None


def read_config(path: Path | None) -> ConfigFile:
    """Read *path* and check each value as if it had been typed.

    Raises
    ------
    BadFile
        It cannot be read. UsageError, UnknownName: an unknown key (the message suggests the nearest) or a bad value.
    """
    if path is None:
        return NO_CONFIG
    try:
        tables = load_toml(path, "settings")
    except BadFile as error:
        raise BadFile(f"{error}. Correct the file, or set {CONFIG_VARIABLE}={NONE} to run without it") from error
    values: dict[str, Any] = {}
    for table, pairs in tables.items():
        known = _found(TABLES, table, f"table in {path}")
        if not isinstance(pairs, dict):
            raise UsageError(f"{path}: {table} must be a table. Write [{table}] and its settings below it")
        for name, value in pairs.items():
            _found(dict.fromkeys(known), name, f"setting of [{table}] in {path}")
            try:
                values[name] = _value(name, value, path.parent)
            except UsageError as error:
                raise UsageError(f"{path}: [{table}] {name}: {error}") from None
    return ConfigFile(path, values)


def _found(table: Mapping[str, Any], name: str, kind: str) -> Any:
    try:
        return lookup(table, name, kind)
    except UnknownName as error:
        hint = f"{error} Set {CONFIG_VARIABLE}={NONE} to run without the file"
        raise UnknownName(hint, name=name, nearest=error.nearest) from None


def _value(name: str, value: object, folder: Path) -> Any:
    """Return a value in the form of the command line."""
    if name in _TEXTS or name in _PATHS:
        if not isinstance(value, str) or not value:
            raise UsageError(f"must be text in quotation marks, not {clipped(repr(value))}")
        return folder / Path(value).expanduser() if name in _PATHS else value
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise UsageError(f"must be a number, not {clipped(repr(value))}")
    return limit_of(name).check(float(value))


def shown_value(value: object) -> str:
    """Return a value in the form in which it would be typed."""
    return f"{value:g}" if isinstance(value, float) else str(value)
