"""``--help`` with the everyday options and examples of a command, and ``--help-all`` with every option."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import Any

from gcs_autotune.cli.command import Command

__all__ = ["add_help"]


def add_help(parser: argparse.ArgumentParser, command: Command) -> None:
    """Add ``--help``, and ``--help-all`` if *command* has everyday options.

    The parser was made with ``add_help=False``.
    """
    if not command.everyday:
        parser.add_argument("-h", "--help", action="help", help="show this help message and exit")
        return
    parser.add_argument(
        "-h", "--help", action=_ShortHelp, command=command, help="show everyday options and examples, and exit"
    )
    parser.add_argument("--help-all", action="help", help="show every option and exit")


class _ShortHelp(argparse.Action):
    """Print the short help of ``command`` and exit."""

    def __init__(self, option_strings: Sequence[str], dest: str, command: Command, help: str) -> None:
        super().__init__(option_strings, dest=argparse.SUPPRESS, default=argparse.SUPPRESS, nargs=0, help=help)
        self._command = command

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        sys.stdout.write(short_help(parser, self._command))
        parser.exit()


def short_help(parser: argparse.ArgumentParser, command: Command) -> str:
    """Return the usage, positional arguments, everyday options and examples of *command*."""
    formatter = parser._get_formatter()
    positional = [a for a in parser._actions if not a.option_strings]
    options = {o.removeprefix("--"): a for a in parser._actions for o in a.option_strings if o.startswith("--")}
    words = " ".join(map(_shown, positional))
    formatter.add_usage(f"{parser.prog} [OPTIONS] {words}".rstrip(), [], [])
    formatter.add_text(parser.description)
    for title, actions in (("arguments", positional), ("everyday options", [options[o] for o in command.everyday])):
        formatter.start_section(title)
        formatter.add_arguments(actions)
        formatter.end_section()
    examples = "".join(f"  {call}\n      {what}\n" for call, what in command.examples)
    count = sum(1 for a in parser._actions if a.option_strings)
    last = f"{parser.prog} --help-all lists all {count} options.\n"
    if parser.epilog:
        last = f"{parser.epilog}\n\n{last}"
    return "\n".join((formatter.format_help(), f"examples:\n{examples}", last))


def _shown(action: argparse.Action) -> str:
    name = action.metavar if isinstance(action.metavar, str) else action.dest.upper()
    return f"[{name}]" if action.nargs in ("?", "*") else f"{name} ..." if action.nargs == "+" else name
