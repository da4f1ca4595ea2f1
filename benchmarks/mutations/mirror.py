"""Tests that mirror a file: those named after it, those that import it, and those that import its exported names."""

from __future__ import annotations

import ast
from functools import cache, lru_cache
from pathlib import Path

__all__ = ["mirroring"]

FEWEST = 3
"""With fewer test files, those of the importing modules run too."""


def mirroring(path: str, root: Path) -> list[str]:
    """Return the test files for a product file, the closest first and the smaller of the equally close.

    A test is one step away when it is called after the file, two when it imports the module itself, three when it
    imports one of its names from the room; with fewer than :data:`FEWEST` of these those of the files that import it.
    """
    module = path.removesuffix(".py").replace("/", ".").removesuffix(".__init__")
    found = dict(_directly(module, root))
    for farther in (10, 20):
        if len(found) >= FEWEST:
            break
        for user in _users(module if farther == 10 else module.rpartition(".")[0], root):
            for test, distance in _directly(user, root).items():
                found.setdefault(test, farther + distance)
    return sorted(found, key=lambda test: (found[test], (root / test).stat().st_size))


def _directly(module: str, root: Path) -> dict[str, int]:
    parts = module.split(".")
    named = {f"test_{parts[-1]}", f"test_{parts[-1]}s", *(["test_" + "_".join(parts[-2:])])}
    public = _public(module, root)
    found = {}
    for test, imports in _tests(str(root)).items():
        stem = Path(test).stem
        if stem in named and parts[1] in test:
            found[test] = 1
        elif any(m == module for m, _ in imports):
            found[test] = 2
        elif any(module.startswith(m + ".") and name in public for m, name in imports):
            found[test] = 3
    return found


def _public(module: str, root: Path) -> set[str]:
    tree = ast.parse((root / _file_of(module, root)).read_text(encoding="utf-8"))
    for node in tree.body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "__all__":
            return set(ast.literal_eval(node.value))
    return {n.name for n in tree.body if isinstance(n, ast.FunctionDef | ast.ClassDef)}


def _file_of(module: str, root: Path) -> str:
    path = module.replace(".", "/")
    return f"{path}.py" if (root / f"{path}.py").exists() else f"{path}/__init__.py"


@cache
def _imports(path: Path) -> set[tuple[str, str]]:
    """Return (module, name) of every import, ("module", "") of plain ones; modules of a package as modules too."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found |= {(node.module, a.name) for a in node.names} | {(f"{node.module}.{a.name}", "") for a in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {(f".{node.module or a.name}", a.name) for a in node.names}
        elif isinstance(node, ast.Import):
            found |= {(a.name, "") for a in node.names}
    return found


@lru_cache(maxsize=1)
def _tests(root: str) -> dict[str, set[tuple[str, str]]]:
    """Return the imports of every test file, with those of the helpers beside it that it imports."""
    found = {}
    files = sorted((Path(root) / "tests").rglob("*.py"))
    imports = {f: _imports(f) for f in files}
    for file in files:
        if file.name.startswith("test_") and "ardupilot" not in file.parts:
            found[str(file.relative_to(root))] = imports[file] | {
                pair
                for module, _ in imports[file]
                if (helper := file.parent / (module.lstrip(".").split(".")[0] + ".py")) in imports
                for pair in imports[helper]
            }
    return found


@lru_cache(maxsize=256)
def _users(module: str, root: Path) -> list[str]:
    found = []
    for file in sorted((root / module.split(".")[0]).rglob("*.py")):
        if any(m == module for m, _ in _imports(file)):
            found.append(str(file.relative_to(root)).removesuffix(".py").replace("/", ".").removesuffix(".__init__"))
    return [user for user in found if user != module]
