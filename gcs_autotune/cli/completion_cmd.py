"""``gcs-autotune completion``: what makes a shell complete verbs and options, made from the parsers."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from gcs_autotune.cli.command import Command
from gcs_autotune.errors import UsageError

__all__ = ["COMMAND", "SHELLS"]

SHELLS = ("bash", "zsh", "fish")


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("shell", choices=SHELLS, help="whose language")


def _run(args: argparse.Namespace) -> int:
    try:
        import shtab
    except ImportError:
        raise UsageError("shell completion is made by the package shtab: pip install shtab") from None
    from gcs_autotune.cli import make_parser

    parser = make_parser()
    _say_which_are_files(parser, shtab.FILE)
    sys.stdout.write(shtab.complete(parser, args.shell) + "\n")
    return 0


def _say_which_are_files(parser: argparse.ArgumentParser, mark: object) -> None:
    """Mark each argument that is a path, as shtab wants it."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for verb in action.choices.values():
                _say_which_are_files(verb, mark)
        elif action.type is Path:
            action.complete = mark  # type: ignore[attr-defined]


COMMAND = Command(
    name="completion",
    help="print what makes bash, zsh or fish complete verbs and options",
    description="Print a completion script. bash: `gcs-autotune completion bash > "
    "~/.local/share/bash-completion/completions/gcs-autotune`; zsh: `> ~/.zfunc/_gcs-autotune` (fpath); "
    "fish: `> ~/.config/fish/completions/gcs-autotune.fish`.",
    add_arguments=_add_arguments,
    run=_run,
)
