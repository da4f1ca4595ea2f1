"""The directive ``run``: Python in a page, executed when the site is built, with what it prints and shows below it.

Blocks of one page share their names. What fails, fails the build. The last expression of a block is shown: as HTML
where it has ``_repr_html_``, a figure as a picture, anything else as text.
"""

from __future__ import annotations

import ast
import contextlib
import io
from typing import Any, ClassVar

from docutils import nodes
from sphinx.util.docutils import SphinxDirective

__all__ = ["Run", "executed"]


def executed(code: str, names: dict[str, Any]) -> tuple[str, Any]:
    """Execute *code* in *names*; return what it printed and the value of its last expression, None without one."""
    tree = ast.parse(code)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        exec(compile(tree, "<page>", "exec"), names)
        value = eval(compile(ast.Expression(last.value), "<page>", "eval"), names) if last is not None else None
    return said.getvalue(), value


class Run(SphinxDirective):
    """Show a block of Python, execute it, and show its output."""

    has_content = True
    _names: ClassVar[dict[str, dict[str, Any]]] = {}

    def run(self) -> list[nodes.Node]:
        """Return the block and its outcome."""
        code = "\n".join(self.content)
        names = self._names.setdefault(self.env.docname, {})
        block = nodes.literal_block(code, code)
        block["language"] = "python"
        said, value = executed(code, names)
        shown: list[nodes.Node] = [block]
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


def _text(text: str) -> nodes.literal_block:
    block = nodes.literal_block(text, text)
    block["language"] = "text"
    return block
