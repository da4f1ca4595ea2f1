"""The directives ``run`` and ``terminal``: Python and commands in a page, executed when the site is built.

``run`` shows its code and what it prints. Blocks of one page share their names. The last expression of a block is
shown: as HTML where it has ``_repr_html_``, a figure as a picture, anything else as text. With ``:hide:`` the code is
not shown.

``terminal`` shows commands as a terminal of 80 columns does, with their output. The commands of a page share a folder
and can be followed by ``run`` blocks, for which its path is ``folder``. What fails, fails the build.
"""

from __future__ import annotations

import ast
import contextlib
import io
import os
import shlex
import tempfile
from pathlib import Path
from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.util.docutils import SphinxDirective

__all__ = ["Run", "Terminal", "executed", "on_a_terminal"]


def executed(code: str, names: dict[str, Any]) -> tuple[str, Any]:
    """Execute *code* in *names*; return what it printed and the value of its last expression, None without one."""
    tree = ast.parse(code)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        exec(compile(tree, "<page>", "exec"), names)
        value = eval(compile(ast.Expression(last.value), "<page>", "eval"), names) if last is not None else None
    return said.getvalue(), value


def on_a_terminal(commands: list[str], folder: Path) -> str:
    """Return what a terminal of 80 columns shows of *commands*, carried out in *folder*.

    Raises
    ------
    RuntimeError
        A command failed.
    """
    from gcs_autotune.cli import main

    shown = io.StringIO()
    before, columns = Path.cwd(), os.environ.get("COLUMNS")
    os.chdir(folder)
    os.environ["COLUMNS"] = "80"
    try:
        for command in commands:
            shown.write(f"$ {command}\n")
            with contextlib.redirect_stdout(shown), contextlib.redirect_stderr(shown):
                code = main(shlex.split(command)[1:])
            if code:
                raise RuntimeError(f"`{command}` ended with exit code {code}:\n{shown.getvalue()}")
    finally:
        os.chdir(before)
        os.environ.pop("COLUMNS")
        if columns is not None:
            os.environ["COLUMNS"] = columns
    return "\n".join(line.rstrip() for line in shown.getvalue().splitlines())


class Run(SphinxDirective):
    """Show a block of Python, execute it, and show its output."""

    has_content = True
    option_spec: ClassVar = {"hide": directives.flag}
    names: ClassVar[dict[str, dict[str, Any]]] = {}

    def run(self) -> list[nodes.Node]:
        """Return the block and its outcome."""
        code = "\n".join(self.content)
        names = self.names.setdefault(self.env.docname, {})
        block = nodes.literal_block(code, code)
        block["language"] = "python"
        said, value = executed(code, names)
        shown: list[nodes.Node] = [] if "hide" in self.options else [block]
        if said:
            shown.append(_text(said.rstrip("\n")))
        if hasattr(value, "savefig"):
            picture = io.StringIO()
            value.savefig(picture, format="svg")
            text = picture.getvalue()
            shown.append(nodes.raw("", text[text.index("<svg") :], format="html"))
        elif hasattr(value, "_repr_html_"):
            shown.append(nodes.raw("", value._repr_html_(), format="html"))
        elif value is not None:
            shown.append(_text(repr(value)))
        return shown


class Terminal(SphinxDirective):
    """Carry out commands, and show them with their output."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """Return the block as a terminal shows it."""
        names = Run.names.setdefault(self.env.docname, {})
        folder = names.setdefault("folder", Path(tempfile.mkdtemp()))
        block = _text(on_a_terminal(list(self.content), folder))
        block["classes"].append("terminal")
        return [block]


def _text(text: str) -> nodes.literal_block:
    block = nodes.literal_block(text, text)
    block["language"] = "text"
    return block
