"""Draw the figure of the packages from the code's imports: python3 docs/draw_architecture.py

Packages are placed in the layers of the import contract (pyproject.toml). An arrow means "imports". Arrows that a
longer path replaces are left out. Packages that nearly all others import are at the bottom, without arrows.
"""

from __future__ import annotations

import ast
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
PICTURE = ROOT / "docs" / "pictures" / "architecture.svg"

BASE = 2
"""Lowest layers, which all others may import and mostly do."""

WIDTH, BOX, ROW = 1000, (116, 34), 78
DESK, WIRE, GROUND = "#dcebf7", "#f9e3cf", "#eeeeee"


def contracts() -> dict[str, dict[str, object]]:
    """Return the import contracts by name."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    return {c["name"]: c for c in settings["tool"]["importlinter"]["contracts"]}


def layers() -> list[list[str]]:
    """Return the packages per layer, the highest first."""
    rows = contracts()["Rooms import downwards only"]["layers"]
    assert isinstance(rows, list)
    return [[room.strip() for room in row.replace(":", "|").split("|")] for row in rows]


def imports() -> dict[str, set[str]]:
    """Return the packages that each package imports, anywhere in its files."""
    rooms = {room for row in layers() for room in row}
    found: dict[str, set[str]] = {room: set() for room in rooms}
    for path in sorted((ROOT / "gcs_autotune").rglob("*.py")):
        room = path.relative_to(ROOT / "gcs_autotune").parts[0].removesuffix(".py")
        if room not in rooms:
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            for name in _names(node):
                parts = name.split(".")
                if parts[0] == "gcs_autotune" and len(parts) > 1 and parts[1] in rooms - {room}:
                    found[room].add(parts[1])
    return found


def _names(node: ast.AST) -> list[str]:
    if isinstance(node, ast.Import):
        return [a.name for a in node.names]
    if isinstance(node, ast.ImportFrom) and node.module:
        return [node.module, *(f"{node.module}.{a.name}" for a in node.names)]
    return []


def needed(graph: Mapping[str, set[str]]) -> list[tuple[str, str]]:
    """Return the arrows that no longer path replaces."""

    def below(room: str) -> set[str]:
        return {far for near in graph[room] for far in {near} | below(near)}

    return sorted(
        (room, other)
        for room, others in graph.items()
        for other in others
        if not any(other in below(between) for between in others - {other})
    )


def places(rows: Sequence[Sequence[str]], desk: set[str]) -> dict[str, tuple[float, float]]:
    """Return where the middle of each room's box stands: the desk to the left, what flies to the right."""
    found = {}
    for i, row in enumerate(rows):
        shift = (0.0, -45.0, 45.0)[i % 3]  # so that arrows pass beside the boxes between
        for group, begin, end in ((desk & set(row), 40.0, 480.0), (set(row) - desk, 480.0, 860.0)):
            for j, room in enumerate(sorted(group)):
                found[room] = (begin + (end - begin) * (j + 0.5) / len(group) + shift, 40.0 + ROW * i)
    return found


def picture() -> str:
    """Return the picture as SVG."""
    rows, graph = layers(), imports()
    drawn, ground = rows[:-BASE], rows[-BASE:]
    shown = {room for row in drawn for room in row}
    sources = contracts()["The desk never touches the wire"]["source_modules"]
    assert isinstance(sources, list)
    desk = {str(name).split(".")[1] for name in sources}
    at = places(drawn, desk)
    w, h = BOX
    height = 40 + ROW * len(drawn) + 44 * BASE + 30
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" font-family="sans-serif">',
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        '<path d="M0 0 L8 4 L0 8 z" fill="#555"/></marker></defs>',
        f'<rect width="{WIDTH}" height="{height}" fill="white"/>',
    ]
    for room, other in needed({r: graph[r] & shown for r in shown}):
        (x, y), (u, v) = at[room], at[other]
        y, v = y + h / 2, v - h / 2
        bend = (v - y) / 2
        out.append(
            f'<path d="M{x:.0f} {y:.0f} C{x:.0f} {y + bend:.0f} {u:.0f} {v - bend:.0f} {u:.0f} {v - 1:.0f}" '
            'fill="none" stroke="#555" stroke-width="1.1" marker-end="url(#tip)"/>'
        )
    for room in sorted(shown):
        x, y = at[room]
        out += _box(room, x, y, w, h, DESK if room in desk else WIRE)
    for i, row in enumerate(ground):
        out += _box(" · ".join(row), (WIDTH - 180) / 2, 40 + ROW * len(drawn) + 44 * i, WIDTH - 220, h, GROUND)
    x, y = WIDTH - 75, at["link"][1]
    u = at["link"][0] + w / 2
    out.append(f'<path d="M{u:.0f} {y:.0f} L{x - 60} {y:.0f}" stroke="#a33" stroke-width="2" stroke-dasharray="6 4"/>')
    out.append(f'<text x="{(u + x - 60) / 2:.0f}" y="{y - 7:.0f}" font-size="12" text-anchor="middle">MAVLink</text>')
    out += _box("sitl", x, y, 110, h, GROUND)
    legend = ((DESK, "never touches the wire"), (WIRE, "link, flying, whole jobs"), (GROUND, "imported by all; sitl"))
    for i, (colour, text) in enumerate(legend):
        out.append(f'<rect x="{WIDTH - 170}" y="{20 + 24 * i}" width="16" height="16" fill="{colour}" stroke="#888"/>')
        out.append(f'<text x="{WIDTH - 148}" y="{33 + 24 * i}" font-size="12">{text}</text>')
    return "\n".join([*out, "</svg>"]) + "\n"


def _box(text: str, x: float, y: float, w: float, h: float, colour: str) -> list[str]:
    return [
        f'<rect x="{x - w / 2:.0f}" y="{y - h / 2:.0f}" width="{w:.0f}" height="{h:.0f}" rx="5" fill="{colour}" '
        'stroke="#888"/>',
        f'<text x="{x:.0f}" y="{y + 5:.0f}" font-size="14" text-anchor="middle">{text}</text>',
    ]


if __name__ == "__main__":
    PICTURE.write_text(picture(), encoding="utf-8")
