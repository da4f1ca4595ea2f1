"""``gcs-autotune.toml``: settings file with the link and safety limits that are used often.

::

    [link]
    connect = "/dev/ttyUSB0,57600"
    [limits]
    max-distance = 40
    [craft.otter]
    system-id = 3
    max-speed = 2

A table ``[craft.NAME]`` contains options of one craft, of either kind. They replace those above.

The file is searched in the working folder, then in the user's configuration folder; only the first one is used. The
command line takes precedence. Numbers must be inside the table of limits, like typed ones.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from gcs_autotune.cli.command import GUARDING
from gcs_autotune.documents import load_toml
from gcs_autotune.errors import BadFile, UnknownName, UsageError
from gcs_autotune.limits import limit_of
from gcs_autotune.registry import lookup
from gcs_autotune_files import clipped

__all__ = [
    "CONFIG_NAME",
    "CONFIG_VARIABLE",
    "NO_CONFIG",
    "ConfigFile",
    "craft_of",
    "find_config",
    "read_config",
    "shown_value",
]

CONFIG_NAME = "gcs-autotune.toml"
CONFIG_VARIABLE = "GCS_AUTOTUNE_CONFIG"
"""Environment variable with the path of the file, or ``none`` for no file."""
NONE = "none"

_TEXTS = ("connect", "backend")
_PATHS = ("signing-key",)
_NUMBERS = ("baud", "system-id", "source-system")
TABLES: Mapping[str, tuple[str, ...]] = {"link": (*_TEXTS, *_PATHS, *_NUMBERS), "limits": GUARDING}
"""Table of the file -> options allowed in it, by their names on the command line."""
CRAFT = "craft"
"""Table with a table for each craft, in which all these options are allowed."""
LISTEN = 2.5
"""Longest time [s] for which a vehicle is listened for to select its craft; it sends a heartbeat once a second."""


@dataclass(frozen=True, slots=True)
class ConfigFile:
    """Settings of the file: option (without dashes) -> value as on the command line. Empty without a file.

    ``crafts``: name of a craft -> its own settings. ``craft``: the selected one.
    """

    path: Path | None = None
    values: Mapping[str, Any] = field(default_factory=dict)
    crafts: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    craft: str = ""

    def of(self, craft: str) -> ConfigFile:
        """Return the settings of the file for *craft*.

        Raises
        ------
        UsageError, UnknownName
            The file has no such craft.
        """
        if not self.crafts:
            raise UsageError(
                f"--craft {craft} needs a table [craft.{craft}] in {self.path or CONFIG_NAME}. "
                "Add it, or remove --craft"
            )
        own = lookup(self.crafts, craft, f"craft in {self.path}")
        return replace(self, values={**self.values, **own}, craft=craft)

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
    """Return the settings in the file *path*, each checked as if it had been typed.

    Raises
    ------
    BadFile
        The file cannot be read. UsageError, UnknownName: an unknown key (the message suggests the nearest) or a bad
        value.
    """
    if path is None:
        return NO_CONFIG
    try:
        tables = load_toml(path, "settings")
    except BadFile as error:
        raise BadFile(f"{error}. Correct the file, or set {CONFIG_VARIABLE}={NONE} to run without it") from error
    values: dict[str, Any] = {}
    crafts: dict[str, Mapping[str, Any]] = {}
    for table, pairs in tables.items():
        known = _found({**TABLES, CRAFT: ()}, table, f"table in {path}")
        if not isinstance(pairs, dict):
            raise UsageError(f"{path}: {table} must be a table. Write [{table}] and its settings below it")
        if table != CRAFT:
            values |= _options(path, table, pairs, known)
            continue
        for name, own in pairs.items():
            if not isinstance(own, dict):
                raise UsageError(f"{path}: [craft] {name} must be a table. Write [craft.NAME] and {name} below it")
            crafts[name] = _options(path, f"{CRAFT}.{name}", own, [key for keys in TABLES.values() for key in keys])
    return ConfigFile(path, values, crafts)


def _options(path: Path, table: str, pairs: Mapping[str, Any], known: Sequence[str]) -> dict[str, Any]:
    """Return the settings of one table of the file, checked."""
    values = {}
    for name, value in pairs.items():
        _found(dict.fromkeys(known), name, f"setting of [{table}] in {path}")
        try:
            values[name] = _value(name, value, path.parent)
        except UsageError as error:
            raise UsageError(f"{path}: [{table}] {name}: {error}") from None
    return values


def craft_of(config: ConfigFile, args: argparse.Namespace) -> str:
    """Return the name of the craft in *config* that a command is for; empty if there is none.

    It is that of ``--craft``, else the one with the same link, else the one whose system id was typed or is received on
    the link. Listening sends nothing.

    Raises
    ------
    UsageError
        Several crafts match.
    """
    link = getattr(args, "connect", None) or getattr(args, "configured_link", None)
    if getattr(args, CRAFT, None):
        return str(args.craft)
    if not config.crafts or not link or not isinstance(link, str):
        return ""
    found = [name for name, own in config.crafts.items() if own.get("connect") == link]
    by_id = {name: own["system-id"] for name, own in config.crafts.items() if "system-id" in own}
    if len(found) != 1 and by_id and not link.startswith("sitl:"):
        told = {args.system_id} if args.system_id is not None else _received(link)
        found = [name for name in found or by_id if by_id.get(name) in told]
    if len(found) > 1:
        raise UsageError(f"several crafts of {config.path} match {link}: {', '.join(found)}. Select one with --craft")
    return next(iter(found), "")


def _received(link: str) -> set[int]:
    """Return the system ids of the autopilots received on *link*."""
    from gcs_autotune.link import overhear  # takes half a second

    return {one.system for one in overhear(link, LISTEN).autopilots}


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
