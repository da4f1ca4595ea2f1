"""Every small fault that can be put into a file: found in its syntax tree, written back as text in one place.

What only words things (messages, docstrings, annotations, ``raise`` statements) is left alone: goldens hold those.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

__all__ = ["KINDS", "Mutant", "mutants_of"]

KINDS = {
    "boundary": "< for <=, > for >= and back",
    "comparison": "< for >=, == for !=, is for is not, in for not in",
    "sign": "+ for -, a minus dropped, += for -=",
    "operator": "* for / and back",
    "boolean": "and for or and back, not dropped, True for False, any for all",
    "constant": "a number doubled, one added to a whole one, zero made one",
    "extreme": "min for max and back, abs dropped",
    "branch": "a condition that never holds or always does, the branches of an expression swapped",
    "loop": "break for continue and back",
    "early": "a loop left after its first round, a function left before its last statement",
    "dropped": "a call left out, an assignment to an attribute or an item left out",
    "swapped": "the first two arguments of a call swapped",
}

_COMPARE: dict[type[ast.cmpop], list[tuple[str, str]]] = {
    ast.Lt: [("boundary", "<="), ("comparison", ">=")],
    ast.LtE: [("boundary", "<"), ("comparison", ">")],
    ast.Gt: [("boundary", ">="), ("comparison", "<=")],
    ast.GtE: [("boundary", ">"), ("comparison", "<")],
    ast.Eq: [("comparison", "!=")],
    ast.NotEq: [("comparison", "==")],
    ast.Is: [("comparison", "is not")],
    ast.IsNot: [("comparison", "is")],
    ast.In: [("comparison", "not in")],
    ast.NotIn: [("comparison", "in")],
}
_BINARY: dict[type[ast.operator], tuple[str, str]] = {
    ast.Add: ("sign", "-"),
    ast.Sub: ("sign", "+"),
    ast.Mult: ("operator", "/"),
    ast.Div: ("operator", "*"),
}
_NAMES = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "any": "all", "all": "any"}
_SYMMETRIC = ("hypot", "isclose", "same_float32", "convolve", "fmin", "fmax", "union1d")
"""Functions that give the same with their first two arguments swapped."""
_WORDS = ("say", "warning", "info", "debug", "print", "note", "warn")
"""Calls that only tell something; whether they tell it is for the goldens."""


@dataclass(frozen=True, slots=True)
class Mutant:
    """One fault: in *path*, lines counted from 1, the text *before* at (line, column) becomes *after*."""

    path: str
    function: str
    kind: str
    line: int
    column: int
    end_line: int
    end_column: int
    before: str
    after: str
    text: str = ""

    @property
    def key(self) -> str:
        """What it is, whatever line it has slipped to; a mere number or name with the line it stands in (*text*)."""
        is_bare = self.kind in ("constant", "extreme", "boolean") and len(self.before.split()) == 1
        where = f" in {self.text}" if is_bare else ""
        return f"{self.path}::{self.function}: {_one_line(self.before)} -> {_one_line(self.after)}{where}"

    def applied(self, source: str) -> str:
        """Return the source with the fault in it."""
        lines = source.encode().splitlines(keepends=True)  # columns of ast count bytes
        start, end = self.line - 1, self.end_line - 1
        head, tail = lines[start][: self.column], lines[end][self.end_column :]
        return b"".join([*lines[:start], head + self.after.encode() + tail, *lines[end + 1 :]]).decode()

    def is_python(self, source: str) -> bool:
        """Whether the source still is Python with the fault in it."""
        try:
            ast.parse(self.applied(source))
        except SyntaxError:
            return False
        return True


def _one_line(text: str) -> str:
    return " ".join(text.split())


def mutants_of(path: Path, root: Path) -> list[Mutant]:
    """Return every fault that there is for a file; a few of them may be no Python (:attr:`Mutant.is_python`)."""
    source = path.read_text(encoding="utf-8")
    found = _Finder(str(path.relative_to(root)), source)
    found.walk(ast.parse(source), "module")
    return list(dict.fromkeys(found.mutants))


class _Finder:
    def __init__(self, path: str, source: str) -> None:
        self.path = path
        self.lines = source.encode().splitlines(keepends=True)
        self.mutants: list[Mutant] = []

    def walk(self, node: ast.AST, function: str) -> None:
        """Look at *node* and at all below it, but for what only words things."""
        if isinstance(node, ast.Raise | ast.JoinedStr | ast.Import | ast.ImportFrom | ast.Assert):
            return
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            return
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Call) and _called(node.value) in _WORDS:
            return
        if isinstance(node, ast.keyword) and node.arg == "strict":  # of zip: an assertion
            return
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            return
        own = function
        if isinstance(node, ast.FunctionDef):
            own = node.name if function == "module" else f"{function}.{node.name}"
        for kind, at, after in self._faults(node):
            self._add(own, kind, at, after)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            inner = node.name if function == "module" else f"{function}.{node.name}"
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                for default in [*node.args.defaults, *(d for d in node.args.kw_defaults if d is not None)]:
                    self.walk(default, inner)
            for child in node.body:
                self.walk(child, inner)
            return
        skipped = (node.annotation,) if isinstance(node, ast.AnnAssign) else ()
        for child in ast.iter_child_nodes(node):
            if child not in skipped:
                self.walk(child, function)

    def _faults(self, node: ast.AST) -> Iterator[tuple[str, ast.AST, str]]:
        match node:
            case ast.Compare():
                yield from self._compared(node)
            case ast.BinOp() if type(node.op) in _BINARY and not _is_text(node):
                kind, sign = _BINARY[type(node.op)]
                yield kind, node, f"({self._text(node.left)}) {sign} ({self._text(node.right)})"
            case ast.UnaryOp(op=ast.USub()) if not isinstance(node.operand, ast.Constant):
                yield "sign", node, f"({self._text(node.operand)})"
            case ast.UnaryOp(op=ast.Not()):
                yield "boolean", node, f"({self._text(node.operand)})"
            case ast.BoolOp():
                word = " or " if isinstance(node.op, ast.And) else " and "
                yield "boolean", node, "(" + word.join(f"({self._text(v)})" for v in node.values) + ")"
            case ast.Constant():
                yield from self._constants(node)
            case ast.AugAssign() if type(node.op) in _BINARY:
                kind, sign = _BINARY[type(node.op)]
                yield kind, node, f"{self._text(node.target)} {sign}= {self._text(node.value)}"
            case ast.IfExp():
                body, other = self._text(node.body), self._text(node.orelse)
                yield "branch", node, f"({other}) if ({self._text(node.test)}) else ({body})"
            case ast.If() | ast.While():
                yield "branch", node.test, "False"
                if isinstance(node, ast.If):
                    yield "branch", node.test, "True"
            case ast.Continue():
                yield "loop", node, "break"
            case ast.Break():
                yield "loop", node, "continue"
            case ast.For():
                last = node.body[-1]
                if not isinstance(last, ast.Continue | ast.Break | ast.Return | ast.Raise):
                    yield "early", last, f"{self._text(last)}\n{' ' * last.col_offset}break"
            case ast.FunctionDef() if len(node.body) > 1 and not isinstance(node.body[-1], ast.Return | ast.Raise):
                last = node.body[-1]
                yield "early", last, "return"
            case ast.Call():
                yield from self._called(node)
            case ast.Expr(value=ast.Call()):
                yield "dropped", node, "pass"
            case ast.Assign(targets=[ast.Attribute() | ast.Subscript()]):
                yield "dropped", node, "pass"

    def _compared(self, node: ast.Compare) -> Iterator[tuple[str, ast.AST, str]]:
        terms = [self._text(t) for t in (node.left, *node.comparators)]
        signs = [_SIGNS[type(op)] for op in node.ops]
        for i, op in enumerate(node.ops):
            for kind, sign in _COMPARE[type(op)]:
                changed = [*signs[:i], sign, *signs[i + 1 :]]
                pairs = zip(changed, terms[1:], strict=True)
                yield kind, node, terms[0] + "".join(f" {s} {t}" for s, t in pairs)

    def _constants(self, node: ast.Constant) -> Iterator[tuple[str, ast.AST, str]]:
        if isinstance(node.value, bool):
            yield "boolean", node, str(not node.value)
        elif isinstance(node.value, int):
            yield "constant", node, str(node.value + 1)
        elif isinstance(node.value, float):
            yield "constant", node, repr(2.0 * node.value if node.value else 1.0)

    def _called(self, node: ast.Call) -> Iterator[tuple[str, ast.AST, str]]:
        name = _called(node)
        if name in _NAMES:
            kind = "boolean" if name in ("any", "all") else "extreme"
            yield kind, node.func, self._text(node.func).removesuffix(name) + _NAMES[name]
        if name == "abs" and len(node.args) == 1:
            yield "extreme", node, f"({self._text(node.args[0])})"
        plain = [a for a in node.args if not isinstance(a, ast.Starred)]
        is_symmetric = name in {*_NAMES, "isinstance", "zip", "round", *_SYMMETRIC}
        if len(plain) == len(node.args) >= 2 and not is_symmetric:
            first, second = (self._text(a) for a in node.args[:2])
            if first != second:
                rest = [self._text(a) for a in node.args[2:]]
                rest += [
                    f"{k.arg}={self._text(k.value)}" if k.arg else f"**{self._text(k.value)}" for k in node.keywords
                ]
                yield "swapped", node, f"{self._text(node.func)}({', '.join([second, first, *rest])})"

    def _text(self, node: ast.AST) -> str:
        start, end = node.lineno - 1, node.end_lineno - 1  # type: ignore[attr-defined]
        first, last = node.col_offset, node.end_col_offset  # type: ignore[attr-defined]
        if start == end:
            return self.lines[start][first:last].decode()
        middle = self.lines[start + 1 : end]
        return b"".join([self.lines[start][first:], *middle, self.lines[end][:last]]).decode()

    def _add(self, function: str, kind: str, at: ast.AST, after: str) -> None:
        before = self._text(at)
        if before != after:
            place = (at.lineno, at.col_offset, at.end_lineno, at.end_col_offset)  # type: ignore[attr-defined]
            text = self.lines[place[0] - 1].decode().strip()
            self.mutants.append(Mutant(self.path, function, kind, *place, before, after, text))


_SIGNS: dict[type[ast.cmpop], str] = {
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.Eq: "==",
    ast.NotEq: "!=",
    ast.Is: "is",
    ast.IsNot: "is not",
    ast.In: "in",
    ast.NotIn: "not in",
}


def _called(node: ast.Call) -> str:
    return node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")


def _is_text(node: ast.BinOp) -> bool:
    """Whether it joins words or types: ``"a" + "b"``, ``int | None``."""
    sides: Sequence[ast.AST] = (node.left, node.right)
    return any(
        isinstance(s, ast.JoinedStr) or (isinstance(s, ast.Constant) and isinstance(s.value, str)) for s in sides
    )
