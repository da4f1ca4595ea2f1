"""Small faults of one file: those of cosmic-ray, and physical ones.

Texts, ``raise`` statements, and the declarations of records and compiled functions are not changed.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

__all__ = ["OPERATORS", "PHYSICAL", "Mutant", "mutants_of", "physical_mutants"]

OPERATORS = (
    *(f"ReplaceBinaryOperator_{pair}" for pair in ("Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul")),
    *(f"ReplaceComparisonOperator_{pair}" for pair in ("Lt_LtE", "LtE_Lt", "Gt_GtE", "GtE_Gt")),
    *(f"ReplaceComparisonOperator_{pair}" for pair in ("Lt_GtE", "GtE_Lt", "Gt_LtE", "LtE_Gt")),
    *(f"ReplaceComparisonOperator_{pair}" for pair in ("Eq_NotEq", "NotEq_Eq", "Is_IsNot", "IsNot_Is")),
    "ReplaceUnaryOperator_Delete_Not",
    "ReplaceUnaryOperator_Delete_USub",
    "ReplaceAndWithOr",
    "ReplaceOrWithAnd",
    "ReplaceTrueWithFalse",
    "ReplaceFalseWithTrue",
    "ReplaceBreakWithContinue",
    "ReplaceContinueWithBreak",
    "NumberReplacer",
    "AddNot",
    "ZeroIterationForLoop",
)
"""Operators of cosmic-ray whose changed code still runs.

Nine of ten of all its changes replace an operator by an unrelated one (``a << 0.5``), which any test detects.
"""

_WORDS = ("raise_stmt", "fstring", "tfpdef")
_DECLARED = ("njit(", "_LEAN", "@dataclass(")


@dataclass(frozen=True, slots=True)
class Mutant:
    """One fault in *path*: line *line* of the function *function* (``module`` outside of any), *before*, is *after*."""

    path: str
    function: str
    kind: str
    line: int
    before: str
    after: str
    source: str

    @property
    def key(self) -> str:
        """What it is, whatever line it has slipped to."""
        return f"{self.path}::{self.function}: {self.before} -> {self.after}"


def mutants_of(path: str, root: Path, draw: random.Random) -> Iterator[Mutant]:
    """Yield the faults of a file by cosmic-ray's operators, in the order drawn."""
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator

    source = (root / path).read_text(encoding="utf-8")
    nodes = list(ast_nodes(get_ast(source)))
    places: list[tuple[str, int, Any]] = []
    for name in OPERATORS:
        operator = get_operator(f"core/{name}")()
        found = [(node, place) for node in nodes for place in operator.mutation_positions(node)]
        places += [(name, k, node) for k, (node, _) in enumerate(found) if _matters(node)]
    draw.shuffle(places)
    for name, occurrence, node in places:
        changed = mutate_code(source, get_operator(f"core/{name}")(), occurrence)
        if changed is not None and changed != source and _is_python(changed):
            line, before, after = _difference(source, changed)
            if not any(word in before for word in _DECLARED):
                yield Mutant(path, _function(node), name, line, before, after, changed)


def _matters(node: Any) -> bool:
    while node is not None:
        if node.type in _WORDS:
            return False
        node = node.parent
    return True


def _function(node: Any) -> str:
    names = []
    while node is not None:
        if node.type in ("funcdef", "classdef"):
            names.append(node.name.value)
        node = node.parent
    return ".".join(reversed(names)) or "module"


def _difference(source: str, changed: str) -> tuple[int, str, str]:
    """Return line number, line before and line after of the first difference."""
    for number, (before, after) in enumerate(zip(source.splitlines(), changed.splitlines(), strict=False), start=1):
        if before != after:
            return number, before.strip(), after.strip()
    raise ValueError("no line differs")


def _is_python(source: str) -> bool:
    try:
        compile(source, "mutant", "exec")
    except SyntaxError:
        return False
    return True


PHYSICAL: tuple[tuple[str, str, str, str], ...] = (
    ("models/coupled/kernel.py", "force[i] -= c[i]", "force[i] += c[i]", "Coriolis forces with the wrong sign"),
    ("models/coupled/kernel.py", "u * cs - v * sn + vx", "u * cs + v * sn + vx", "sway to port for sway to starboard"),
    ("models/simulation.py", "- side * c * square)", "- c * square)", "quadratic drag that drives a craft astern"),
    ("design/laws/kernel.py", "integral * error < 0.0", "integral * error > 0.0", "an integrator that winds up"),
    ("design/laws/kernel.py", "-actuator.astern * size", "-actuator.ahead * size", "thrust astern as strong as ahead"),
    ("frames.py", "math.cos(math.radians(", "math.cos((", "degrees for radians"),
    ("frames.py", "north * c + east * s, east * c - north * s", "north * c - east * s, east * c + north * s",
     "the body turned against its heading"),
    ("identify/relay/iso.py", "2.0 * C / (math.pi * X_m)", "4.0 * C / (math.pi * X_m)", "describing function doubled"),
    ("link/vehicle/vehicle_config.py", "else self.low", "else self.high",
     "uneven servo ends taken as even"),
    ("link/vehicle/latency.py", "(t - sent - 0.5 * trip)", "(t - sent - trip)", "half a round trip taken as whole"),
    ("manoeuvres/envelope.py", "abs(o.psi - a.psi)", "abs(o.psi)", "a turn counted from north, not from the start"),
    ("design/verdict.py", "before.overshoot, over)", "after.overshoot, over)", "gains judged against themselves"),
)  # fmt: skip
"""(file, text, replacement of its first occurrence, physical meaning): typical mistakes of people."""


def physical_mutants(root: Path) -> Iterator[Mutant]:
    """Yield the physical faults.

    Raises
    ------
    LookupError
        A text is not there any more.
    """
    for file, text, instead, meaning in PHYSICAL:
        path = f"gcs_autotune/{file}"
        source = (root / path).read_text(encoding="utf-8")
        if text not in source:
            raise LookupError(f"{path} no longer contains {text!r}: update {__file__} ({meaning})")
        changed = source.replace(text, instead, 1)
        line, before, after = _difference(source, changed)
        yield Mutant(path, meaning, "physical", line, before, after, changed)
