"""Common style of all figures, and their conversion to reproducible SVG for the page."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Literal

from markupsafe import Markup, escape

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.transforms import Bbox

__all__ = [
    "AFTER",
    "BAND",
    "BEFORE",
    "FAINT",
    "INK",
    "PAPER",
    "PENS",
    "WANTED",
    "legend",
    "new_axes",
    "new_columns",
    "new_row",
    "pens",
    "to_svg",
]


BEFORE = "#d55e00"

AFTER = "#0072b2"

WANTED = "#009e73"

INK = "#222222"

FAINT = "#8a8a8a"

BAND = "#9ecae1"
"""Colours from the colour-blind-safe palette of Okabe2008."""

GRID = "#e6e6e6"

PAPER = "#ffffff"

PENS: Mapping[str, str] = {
    BEFORE: "before",
    AFTER: "after",
    WANTED: "wanted",
    INK: "ink",
    FAINT: "faint",
    BAND: "band",
    GRID: "grid",
    PAPER: "paper",
}
"""Colour -> the page's variable ``--plot-*`` (``style.css``) that replaces it, so that a dark page has dark plots."""

WIDTH = 5.6
"""Figure width [in]; the page scales the figure to its column. Project choice."""

_STYLE: dict[Any, object] = {
    "font.family": "sans-serif",
    "font.size": 8.8,
    "text.color": INK,
    "text.parse_math": False,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": GRID,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "xtick.color": INK,
    "ytick.color": INK,
    "lines.linewidth": 1.4,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "axes.unicode_minus": True,
    "svg.fonttype": "none",
    "path.simplify": True,
}


@contextmanager
def pens(name: str) -> Iterator[None]:
    """Return a context that applies the style, and the identifier salt of figure *name*, for plotting and saving.

    The user's matplotlibrc is ignored, so that the report looks the same on every computer.
    """
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update({**_STYLE, "svg.hashsalt": name})
        yield


def new_axes(heights: tuple[float, ...], *, share: bool = True) -> tuple[Figure, list[Axes]]:
    """Return a figure with stacked axes, one per height [in], and the list of its axes. By default they share the time
    axis.
    """
    from matplotlib.figure import Figure

    top, bottom, gap = 0.28, 0.48, 0.14
    total = sum(heights) + top + bottom + gap * (len(heights) - 1)
    figure = Figure(figsize=(WIDTH, total))
    stack: list[Axes] = []
    y = total - top
    for height in heights:
        y -= height
        box = (0.13, y / total, 0.85, height / total)
        stack.append(figure.add_axes(box, sharex=stack[0] if stack and share else None))
        y -= gap
    if share:
        for axes in stack[:-1]:
            axes.tick_params(labelbottom=False)
    return figure, stack


def new_columns(count: int, heights: tuple[float, ...]) -> tuple[Figure, list[list[Axes]]]:
    """Return a figure of *count* columns, each with one axes per height [in], and its axes. Rows share the value axis,
    columns the time axis.
    """
    from matplotlib.figure import Figure

    top, bottom, gap, left, between = 0.28, 0.48, 0.14, 0.13, 0.03
    total = sum(heights) + top + bottom + gap * (len(heights) - 1)
    figure = Figure(figsize=(WIDTH, total))
    width = (0.98 - left - between * (count - 1)) / count
    columns: list[list[Axes]] = []
    for k in range(count):
        column: list[Axes] = []
        y = total - top
        for row, height in enumerate(heights):
            y -= height
            box = (left + k * (width + between), y / total, width, height / total)
            beside = columns[0][row] if columns else None
            axes = figure.add_axes(box, sharex=column[0] if column else None, sharey=beside)
            axes.tick_params(labelbottom=row == len(heights) - 1, labelleft=k == 0)
            column.append(axes)
            y -= gap
        columns.append(column)
    return figure, columns


def new_row(count: int, height: float, *, polar_first: bool = False) -> tuple[Figure, list[Axes]]:
    """Return a figure with *count* axes of one *height* [in] side by side, and its axes. The first may be a
    compass rose.
    """
    from matplotlib.figure import Figure

    top, bottom, left, gap = 0.28, 0.48, 0.13, 0.16
    total = height + top + bottom
    figure = Figure(figsize=(WIDTH, total))
    width = (0.98 - left - gap * (count - 1)) / count
    row: list[Axes] = []
    for k in range(count):
        box = (left + k * (width + gap), bottom / total, width, height / total)
        row.append(figure.add_axes(box, projection="polar" if polar_first and k == 0 else None))
    return figure, row


def legend(axes: Axes, columns: int = 5, side: Literal["left", "right"] = "left") -> None:
    """Put the legend in one line above the axes, outside the data, on the *side* where there is no title."""
    handles, _ = axes.get_legend_handles_labels()
    if handles:
        axes.legend(
            loc="lower left" if side == "left" else "lower right",
            bbox_to_anchor=(-0.01 if side == "left" else 1.01, 1.0),
            frameon=False,
            fontsize=8.0,
            ncols=columns,
            borderaxespad=0.1,
            handlelength=1.6,
            columnspacing=1.4,
        )


def to_svg(figure: Figure, name: str, description: str) -> Markup:
    """Return the figure as an inline SVG element that scales with its column.

    Identifiers begin with *name*, so that one page can hold several figures; *description* is for screen readers. The
    colours in :data:`PENS` adapt to a dark or light page.
    """
    stream = io.StringIO()
    nothing = {"Date": None, "Creator": None, "Format": None, "Type": None}
    figure.savefig(stream, format="svg", metadata=nothing, bbox_inches=_whole(figure))
    text = stream.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r'\bid="', f'id="{name}-', text)
    text = re.sub(r'href="#', f'href="#{name}-', text)
    text = re.sub(r"url\(#", f"url(#{name}-", text)
    text = re.sub(r"\n\s*", "\n", text)
    label = f'<svg role="img" aria-label="{escape(description)}" '
    head = re.compile(r'<svg [^>]*?viewBox="([^"]*)"[^>]*>', re.DOTALL)
    text = head.sub(lambda found: f'{label}viewBox="{found[1]}">', text, count=1)
    text = _COLOUR.sub(lambda found: f"{found[1]}var(--plot-{PENS[found[2]]}, {found[2]})", text)
    return Markup(text.replace("xlink:href", "href"))


def _whole(figure: Figure) -> Bbox | None:
    """Return the area of *figure* [in] with everything that is drawn beyond its edge; None if nothing is.

    A second axis on the right and a legend of two rows are.
    """
    from matplotlib.transforms import Bbox

    sheet, drawn = figure.bbox_inches, figure.get_tightbbox()
    whole = Bbox.union([sheet, drawn])
    over = max(abs(a - b) for a, b in zip(whole.extents, sheet.extents, strict=True))
    return whole if over > _OVER else None


_OVER = 0.02
"""Length beyond the edge of a figure that is only the width of a line [in]. Project choice."""

_COLOUR = re.compile(rf"((?:fill|stroke): ?)({'|'.join(PENS)})\b")
