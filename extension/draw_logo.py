"""Draw ``extension_logo.png``, square, from the page's icon's own strokes: python3 extension/draw_logo.py"""

from __future__ import annotations

from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

SIZE = 512


def draw(path: Path) -> None:
    """Write the logo to *path*."""
    figure = Figure(figsize=(SIZE / 100, SIZE / 100), dpi=100)
    FigureCanvasAgg(figure)
    ax = figure.add_axes((0, 0, 1, 1), xlim=(0, 64), ylim=(64, 0))
    ax.axis("off")
    ax.add_patch(FancyBboxPatch((6, 6), 52, 52, boxstyle="round,pad=6,rounding_size=12", color="#0b2a3d", lw=0))
    swing = [(8, 40), (14, 20), (22, 46), (30, 24), (37, 38), (43, 31), (56, 31)]
    width = 4 * SIZE / 64 * 72 / 100
    ax.plot(*zip(*swing, strict=True), color="#56b4e9", lw=width, solid_joinstyle="round", solid_capstyle="round")
    ax.plot((8, 56), (52, 52), color="#e69f00", lw=width, solid_capstyle="round")
    figure.savefig(path, transparent=True, metadata={"Software": None})


if __name__ == "__main__":
    draw(Path(__file__).with_name("extension_logo.png"))
