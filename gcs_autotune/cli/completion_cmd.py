"""``gcs-autotune completion``: a shell completion script, generated from the parsers."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from gcs_autotune.cli.command import Command
from gcs_autotune.cli.writing import page_file
from gcs_autotune.errors import UsageError

__all__ = ["COMMAND", "SHELLS"]

SHELLS = ("bash", "zsh", "fish")


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("shell", choices=SHELLS, help="shell that will read the script")


def _run(args: argparse.Namespace) -> int:
    try:
        import shtab
    except ImportError:
        raise UsageError("shell completion needs the package shtab. Run pip install shtab") from None
    _made_for_a_shell(args.whole, shtab.FILE)
    sys.stdout.write(shtab.complete(args.whole, args.shell) + "\n")
    return 0


def _made_for_a_shell(parser: argparse.ArgumentParser, mark: object) -> None:
    """Prepare the parsers for shtab: mark path arguments, shorten the help of verbs to one line, and add the
    manoeuvres."""
    from gcs_autotune.manoeuvres import MANOEUVRES

    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            lines = {choice.dest: choice.help for choice in action._choices_actions}
            for name, verb in action.choices.items():
                verb.description = lines.get(name) or verb.description
                _made_for_a_shell(verb, mark)
        elif action.type in (Path, page_file):
            action.complete = mark  # type: ignore[attr-defined]
        elif action.dest == "manoeuvre":
            action.choices = [kind.name for kind in MANOEUVRES.values() if kind.is_alone]


COMMAND = Command(
    description="Print a completion script. Where to save it: bash: `gcs-autotune completion bash > "
    "~/.local/share/bash-completion/completions/gcs-autotune`; zsh: `> ~/.zfunc/_gcs-autotune` (a folder in fpath); "
    "fish: `> ~/.config/fish/completions/gcs-autotune.fish`.",
    add_arguments=_add_arguments,
    run=_run,
)
