"""A room is entered by its door: what others need of it stands in its ``__init__``."""

from __future__ import annotations

import ast
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
ROOM = re.compile(r"(?:gcs_autotune|sitl)\.(\w+)\.\w")
"""What may be an import past a door, and the room it enters."""


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
