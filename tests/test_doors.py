"""A room is entered by its door: what others need of it stands in its ``__init__``.

``identify`` has a door for its results and further ones for rooms that build on its parts.
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
"""(file, module): the imports of another room's inside that are meant."""
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
"""Doors of parts of a room, and the rooms that enter by them."""
ROOM = re.compile(r"(?:gcs_autotune|sitl)\.(\w+)\.\w")
"""What may be an import past a door, and the room it enters."""


def room_of(file: Path) -> str:
    """Return the room that a *file* relative to the root belongs to."""
    return file.with_suffix("").parts[1]


def imports_past_a_door(root: Path) -> set[tuple[str, str]]:
    """Return (file, module) for every import of *root*'s packages that goes past another room's ``__init__``."""
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


def test_no_room_is_entered_past_its_door_but_where_it_is_meant() -> None:
    assert imports_past_a_door(ROOT) == PAST_THE_DOOR


def test_an_import_past_a_door_is_seen(tmp_path: Path) -> None:
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


def test_every_inner_door_is_entered_by_those_it_is_for_and_holds_what_they_need() -> None:
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
