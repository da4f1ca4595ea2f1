"""No test may pass without an assertion: one inside a loop or a branch may never be reached.

From the syntax tree alone. A loop counts if its iterable is clearly not empty: a literal, a range up to a
number, a name that stands for one of these in the file, or these sorted, counted, zipped, paired. For anything else a
test has to assert how many there are, or that there are some.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Sequence
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
ASSERTING = {"raises", "fail", "warns", "deprecated_call"}
PASSED_ON = {"enumerate", "zip", "sorted", "reversed", "list", "tuple", "set", "product", "items", "values", "keys"}
DRAWN = {"linspace", "arange", "logspace", "geomspace", "range"}

Function = ast.FunctionDef | ast.AsyncFunctionDef


def functions_of(tree: ast.AST) -> list[Function]:
    return [n for n in ast.walk(tree) if isinstance(n, Function)]


class Reader:
    """The state while a file is read: ``filled`` names of non-empty values, and helpers that assert."""

    def __init__(self, tree: ast.Module, helpers: Iterable[str]) -> None:
        self.helpers = set(helpers)
        self.filled: set[str] = set()
        for statement in tree.body:
            self._assigned(statement)

    def asserts(self, function: Function) -> bool:
        """Whether an assertion is reached on every path."""
        known = set(self.filled)
        found = self._reached(function.body)
        self.filled = known
        return found

    def _reached(self, body: Sequence[ast.stmt]) -> bool:
        return any(self._is_reached(statement) for statement in body)

    def _is_reached(self, node: ast.stmt) -> bool:
        self._assigned(node)
        match node:
            case ast.Assert(test=ast.Call(func=ast.Name(id="all"), args=[ast.GeneratorExp() as every])):
                return self._is_filled(every)
            case ast.Assert():
                return True
            case ast.For():
                return self._is_filled(node.iter) and self._reached(node.body)
            case ast.If():
                return self._reached(node.body) and self._reached(node.orelse)
            case ast.Match():
                return all(self._reached(case.body) for case in node.cases)
            case ast.Try():
                whole = self._reached(node.body + node.orelse) and all(self._reached(h.body) for h in node.handlers)
                return whole or self._reached(node.finalbody)
            case ast.With() | ast.AsyncWith():
                return any(self._calls(item) for item in node.items) or self._reached(node.body)
            case ast.While() | ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                return False
            case _:
                return self._calls(node)

    def _calls(self, node: ast.AST) -> bool:
        """Whether an asserting helper is called: outside of what a comprehension or a lambda may never get to."""
        calls = [n for n in ast.walk(node) if isinstance(n, ast.Call)]
        return any(
            _name(c.func) in ASSERTING
            or any(k.arg == "check" and ast.unparse(k.value) == "True" for k in c.keywords)
            or _name(c.func).startswith("assert")
            or (isinstance(c.func, ast.Name) and c.func.id in self.helpers)
            for c in calls
        )

    def _assigned(self, node: ast.stmt) -> None:
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None and self._is_filled(node.value):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            self.filled |= {t.id for t in targets if isinstance(t, ast.Name)}

    def _is_filled(self, node: ast.expr) -> bool:
        match node:
            case ast.Constant():
                return bool(node.value)
            case ast.Tuple() | ast.List() | ast.Set():
                return any(not isinstance(e, ast.Starred) or self._is_filled(e.value) for e in node.elts)
            case ast.Dict():
                return any(k is not None or self._is_filled(v) for k, v in zip(node.keys, node.values, strict=True))
            case ast.Name():
                return node.id in self.filled
            case ast.BinOp(op=ast.Add() | ast.BitOr()):
                return self._is_filled(node.left) or self._is_filled(node.right)
            case ast.IfExp():
                return self._is_filled(node.body) and self._is_filled(node.orelse)
            case ast.BinOp(op=ast.Mult()):
                return self._is_filled(node.left) and self._is_filled(node.right)
            case ast.ListComp() | ast.SetComp() | ast.DictComp() | ast.GeneratorExp():
                return all(not g.ifs and self._is_filled(g.iter) for g in node.generators)
            case ast.Call() if _name(node.func) in DRAWN:
                return bool(node.args) and all(self._is_filled(a) or _is_zero(a) for a in node.args)
            case ast.Call() if _name(node.func) in PASSED_ON:
                given = [node.func.value] if isinstance(node.func, ast.Attribute) and not node.args else node.args
                filled = [self._is_filled(a) for a in given]
                strict = any(k.arg == "strict" and ast.unparse(k.value) == "True" for k in node.keywords)
                return any(filled) if strict else bool(filled) and all(filled)
        return False


def _is_zero(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant | ast.UnaryOp)


def _name(node: ast.expr) -> str:
    return node.attr if isinstance(node, ast.Attribute) else getattr(node, "id", "")


def asserting_helpers(trees: Iterable[ast.Module]) -> set[str]:
    """Return the names of all functions other than tests that assert, or call one that does."""
    helpers: set[str] = set()
    silent = [
        (reader, function)
        for reader, tree in [(Reader(tree, ()), tree) for tree in trees]
        for function in functions_of(tree)
        if not function.name.startswith("test_")
    ]
    while True:
        for reader, _ in silent:
            reader.helpers = helpers
        found = [(reader, f) for reader, f in silent if reader.asserts(f)]
        if not found:
            return helpers
        helpers = helpers | {f.name for _, f in found}
        silent = [pair for pair in silent if pair not in found]


def vacuous(tree: ast.Module, helpers: Iterable[str]) -> list[str]:
    """Return the tests of a file that may end without a single assertion."""
    reader = Reader(tree, helpers)
    tests = [f for f in functions_of(tree) if f.name.startswith("test_")]
    return [f"{f.lineno}: {f.name}" for f in tests if not reader.asserts(f)]


@pytest.fixture(scope="module")
def trees() -> dict[str, ast.Module]:
    files = sorted(TESTS.rglob("*.py"))
    assert len(files) > 200
    return {str(f.relative_to(TESTS)): ast.parse(f.read_text(encoding="utf-8")) for f in files}


@pytest.mark.slow
def test_every_test_reaches_an_assertion_on_every_path(trees: dict[str, ast.Module]) -> None:
    helpers = asserting_helpers(trees.values())
    found = [f"{name}:{test}" for name, tree in trees.items() for test in vacuous(tree, helpers)]
    assert found == [], "assert how many there are before looking at each, or parametrize over them:\n  " + "\n  ".join(
        found
    )


@pytest.mark.parametrize(
    ("body", "is_vacuous"),
    [
        ("for x in found():\n  assert x", True),
        ("for x in (1, 2):\n  assert x", False),
        ("for x in range(SEEDS):\n  assert x", False),
        ("for x, y in zip(TABLE.items(), found()):\n  assert x", True),
        ("for x, y in enumerate(sorted(TABLE.items())):\n  assert x", False),
        ("for x in [y for y in TABLE if y > 3]:\n  assert x", True),
        ("assert all(x > 3 for x in found())", True),
        ("assert all(x > 3 for x in TABLE)", False),
        ("if found():\n  assert x", True),
        ("if found():\n  assert x\nelse:\n  assert y", False),
        ("look(3)", True),
        ("see(3)", False),
        ("with raises(ValueError):\n  look(3)", False),
        ("harness.assert_as_found()", False),
        ("try:\n  look(3)\nexcept ValueError:\n  assert x", True),
        ("assert found()\nfor x in found():\n  assert x", False),
    ],
)
def test_vacuous_tests_are_distinguished_from_others(body: str, is_vacuous: bool) -> None:
    lines = "\n".join("    " + line for line in body.splitlines())
    text = f"SEEDS = 3\nTABLE = {{1: 2}}\ndef see(x):\n    assert x\ndef test_it():\n{lines}\n"
    tree = ast.parse(text)
    assert bool(vacuous(tree, asserting_helpers([tree]))) is is_vacuous
