"""A package is imported through its ``__init__``, which contains what others need.

``identify`` has one module for its results and further ones for packages that build on its parts.
"""

from __future__ import annotations

import ast
import importlib
import re
from pathlib import Path

ROOT = Path(__file__).parents[1]

PAST_THE_DOOR = {
    # Compiled functions of one form each: a name for the module says which.
    ("gcs_autotune/identify/regression/drive.py", "gcs_autotune.models.coupled"),
    ("gcs_autotune/identify/regression/motion.py", "gcs_autotune.models.coupled"),
    ("gcs_autotune/identify/regression/physical.py", "gcs_autotune.models.coupled"),
}
"""(file, module): the intended imports of internals of another package."""
INNER_DOORS = {
    "gcs_autotune.identify.signals": {"diagnose", "experiments", "seatrials"},
    "gcs_autotune.identify.problems": {"diagnose", "experiments", "thrusters"},
    "gcs_autotune.identify.kalman": {"diagnose"},
    "gcs_autotune.identify.open_loop": {"seatrials"},
    "gcs_autotune.identify.relay": {"manoeuvres", "report", "seatrials", "workflow"},
    "gcs_autotune.identify.frequency": {"report", "seatrials", "workflow"},
    "gcs_autotune.identify.thrust": {"workflow"},
    "gcs_autotune.identify.plan": {"cli", "report"},
}
"""Interfaces of parts of a package, and the packages that import them."""
ROOM = re.compile(r"(?:gcs_autotune|sitl)\.(\w+)\.\w")
"""A possible import past an ``__init__``, and its package."""


def room_of(file: Path) -> str:
    """Return the package of a *file* relative to the root."""
    return file.with_suffix("").parts[1]


def imports_past_a_door(root: Path) -> set[tuple[str, str]]:
    """Return (file, module) for every import in *root* that goes past the ``__init__`` of another package."""
    found = set()
    for package in ("gcs_autotune", "sitl"):
        rooms = {path.parent.name for path in root.glob(f"{package}/*/__init__.py")}
        for path in root.glob(f"{package}/**/*.py"):
            file = path.relative_to(root)
            text = path.read_text(encoding="utf-8")
            if set(ROOM.findall(text)) <= {file.parts[1]}:  # to parse all others takes seconds
                continue
            for node in ast.walk(ast.parse(text)):
                names = [node.module] if isinstance(node, ast.ImportFrom) and node.module else []
                names += [name.name for name in node.names] if isinstance(node, ast.Import) else []
                for name in names:
                    parts = name.split(".")
                    if room_of(file) in INNER_DOORS.get(name, ()):
                        continue
                    if len(parts) > 2 and parts[0] == package and parts[1] in rooms - {file.parts[1]}:
                        found.add((file.as_posix(), name))
    return found


def test_no_package_is_imported_past_its_init_except_where_listed() -> None:
    assert imports_past_a_door(ROOT) == PAST_THE_DOOR


def test_an_import_past_an_init_is_detected(tmp_path: Path) -> None:
    for name, text in {
        "design/__init__.py": "",
        "design/laws.py": "from gcs_autotune.design.margins import worst\n",
        "report/__init__.py": "from gcs_autotune.design import worst\n",
        "report/page.py": "from gcs_autotune.design.margins import worst\nimport gcs_autotune.design.laws\n",
    }.items():
        file = tmp_path / "gcs_autotune" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    page = "gcs_autotune/report/page.py"
    assert imports_past_a_door(tmp_path) == {(page, "gcs_autotune.design.margins"), (page, "gcs_autotune.design.laws")}


def test_every_inner_interface_is_used_as_listed_and_complete() -> None:
    entered: dict[str, set[str]] = {door: set() for door in INNER_DOORS}
    needed: dict[str, set[str]] = {door: set() for door in (*INNER_DOORS, "gcs_autotune.identify")}
    for path in ROOT.glob("gcs_autotune/**/*.py"):
        text, room = path.read_text(encoding="utf-8"), room_of(path.relative_to(ROOT))
        if room == "identify" or "gcs_autotune.identify" not in text:
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ImportFrom) and node.module in needed:
                needed[node.module] |= {name.name for name in node.names}
                if node.module in entered:
                    entered[node.module].add(room)
    assert entered == INNER_DOORS
    for door, names in needed.items():
        assert set(importlib.import_module(door).__all__) == names, door
