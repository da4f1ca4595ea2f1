"""Convert a plotted figure to an interactive chart of the page: values under the pointer, zoom, curves to hide.

The chart is made from the same matplotlib figure as the SVG. ``chart.js`` plots it with uPlot and hides the SVG, which
stays for paper and for a browser without scripts.
"""

from __future__ import annotations

import base64
import hashlib
import json
import math
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gcs_autotune.report.toolkit.canvas import PENS

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.text import Text

__all__ = ["chart_script", "script_digest", "to_chart"]

STEPS = 4000
"""Numbers are rounded to this fraction of an axis, finer than a pixel. Project choice."""

_UPLOT = Path(__file__).parents[2] / "web" / "static"
"""uPlot is stored once, with the page of ``serve``."""

_NUMBER = re.compile(r"-?[0-9.]+")

_HIDDEN = ("None", "none", " ", "")


@cache
def chart_script() -> str:
    """Return the script of a page with charts: uPlot with its licence, and ``chart.js``. It contains no address."""
    uplot, licence, ours = (
        path.read_text(encoding="utf-8").strip()
        for path in (_UPLOT / "uPlot.iife.min.js", _UPLOT / "uPlot-LICENSE.txt", Path(__file__).with_name("chart.js"))
    )
    return f"\n/*! uPlot\n{licence}\n*/\n{re.sub(r'^/[*]!.*?[*]/', '', uplot).strip()}\n{ours}\n"


def script_digest() -> str:
    """Return the source expression of a content security policy that permits :func:`chart_script` only."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(chart_script().encode()).digest()).decode()}'"


def to_chart(figure: Figure) -> str:
    """Return *figure* as JSON for ``chart.js``. *figure* must have been saved before, so that its limits are final.

    It is empty for a figure with a polar axes or with numbers written into it, which is shown as SVG only.
    """
    panels: dict[tuple[float, ...], dict[str, Any]] = {}
    columns = sorted({round(axes.get_position().x0, 2) for axes in figure.axes})
    for axes in figure.axes:
        if axes.name != "rectilinear" or axes.images or _has_other_parts(axes):
            return ""
        place = tuple(round(v, 3) for v in axes.get_position(original=True).bounds)
        if place in panels:  # a second vertical axis
            panels[place]["y2"] = _scale(axes.yaxis, axes.get_ylim())
            panels[place]["parts"] += [{**part, "s": 1} for part in _parts(axes)]
            continue
        panels[place] = {
            "column": columns.index(round(axes.get_position().x0, 2)),
            "high": round(96.0 * axes.get_position(original=True).height * figure.get_figheight()),
            "title": axes.get_title("left") or axes.get_title(),
            "equal": axes.get_aspect() != "auto",
            "x": _scale(axes.xaxis, axes.get_xlim()),
            "y": _scale(axes.yaxis, axes.get_ylim()),
            "parts": _parts(axes),
        }
    for place, panel in panels.items():  # a row has its label at the left
        beside = [p for other, p in panels.items() if other[1] == place[1] and p["y"]["name"]]
        panel["y"]["name"] = panel["y"]["name"] or (beside[0]["y"]["name"] if beside else "")
    return json.dumps(list(panels.values()), separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def _has_other_parts(axes: Axes) -> bool:
    """Return whether *axes* contain texts or rectangles that a chart does not show."""
    written = any(_is_relative(text) != (False, False) for text in axes.texts)
    return written or any(all(p.get_transform().contains_branch_seperately(axes.transData)) for p in axes.patches)


def _is_relative(text: Text) -> tuple[bool, bool]:
    assert text.axes is not None
    x, y = text.get_transform().contains_branch_seperately(text.axes.transData)
    is_annotation = getattr(text, "xycoords", "") == "data"
    return (not x and not is_annotation, not y and not is_annotation)


def _scale(axis: Axis, limits: tuple[float, float]) -> dict[str, Any]:
    """Return name, limits, and fixed ticks of an axis. ``off``: shown numbers are smaller by this amount."""
    scale: dict[str, Any] = {"name": axis.get_label_text(), "lim": [float(f"{v:.6g}") for v in limits]}
    if axis.get_scale() == "log":
        scale["log"] = 1
    places = [float(v) for v in axis.get_majorticklocs()]
    tick_labels = [label.get_text().replace("\N{MINUS SIGN}", "-") for label in axis.get_majorticklabels()]
    if any(words and not _NUMBER.fullmatch(words) for words in tick_labels) and "log" not in scale:
        scale["ticks"] = list(zip(places, tick_labels, strict=False))
        return scale
    offsets = [v - float(words) for v, words in zip(places, tick_labels, strict=False) if _NUMBER.fullmatch(words)]
    if offsets and abs(offsets[0]) > 1.0:  # a heading that continues beyond 360 degrees
        scale["off"] = round(offsets[0], 6)
    return scale


def _parts(axes: Axes) -> list[dict[str, Any]]:
    """Return everything plotted on *axes*, the lowest first."""
    labels = _labels(axes)
    parts: list[tuple[float, dict[str, Any]]] = []
    grid = [abs(high - low) / STEPS for low, high in (axes.get_xlim(), axes.get_ylim())]
    logs = [axis.get_scale() == "log" for axis in (axes.xaxis, axes.yaxis)]

    def rounded(values: Any, k: int) -> list[float | None]:
        return _rounded(np.ma.filled(np.ma.asarray(values, dtype=float), np.nan), 0.0 if logs[k] else grid[k])

    for line in axes.lines:
        parts.append((line.get_zorder(), {**_line(line, axes, rounded), **_pen(line.get_color(), line, labels)}))
    for collection in axes.collections:
        is_lines = hasattr(collection, "get_segments")
        colours: Any = collection.get_edgecolor() if is_lines else collection.get_facecolor()
        paths = [np.asarray(path.vertices) for path in collection.get_paths()]
        paths = [path for path in paths if len(path)]
        if not len(colours) or not paths:
            continue
        x, y = np.vstack([np.vstack([path, [math.nan, math.nan]]) for path in paths])[:-1].T
        part = {"x": rounded(x, 0), "y": rounded(y, 1)}
        width: Any = collection.get_linewidth()
        look = {"w": float(width[0]), "d": "-"} if is_lines else {"fill": 1}
        parts.append((collection.get_zorder(), {**part, **look, **_pen(colours[0], collection, labels)}))
    for patch in axes.patches:
        (x0, y0), (x1, y1) = patch.get_path().transformed(patch.get_patch_transform()).get_extents().get_points()
        in_x, _ = patch.get_transform().contains_branch_seperately(axes.transData)
        span = {"v": rounded([x0, x1], 0)} if in_x else {"h": rounded([y0, y1], 1)}
        parts.append((patch.get_zorder(), {**span, "fill": 1, **_pen(patch.get_facecolor(), patch, labels)}))
    for text in axes.texts:
        x, y = getattr(text, "xy", text.get_position())
        words = {
            "t": text.get_text(),
            "x": rounded([x], 0),
            "y": rounded([y], 1),
            "up": int(text.get_verticalalignment() == "bottom"),
        }
        parts.append((text.get_zorder(), {**words, **_pen(text.get_color(), text, labels)}))
    return [part for _, part in sorted(parts, key=lambda pair: pair[0])]


def _rounded(values: np.ndarray[Any, np.dtype[np.float64]], step: float) -> list[float | None]:
    """Return *values* rounded to *step*, or to five digits if it is zero; None for what is not finite."""
    digits = max(0, math.ceil(-math.log10(step))) if step > 0.0 else -1
    kept = (round(float(v), digits) if digits >= 0 else float(f"{v:.5g}") for v in values)
    return [(int(v) if v.is_integer() else v) if math.isfinite(v) else None for v in kept]


def _line(line: Line2D, axes: Axes, rounded: Any) -> dict[str, Any]:
    x, y = (np.asarray(values) for values in line.get_data())
    in_x, in_y = line.get_transform().contains_branch_seperately(axes.transData)
    part: dict[str, Any] = {"w": float(line.get_linewidth())}
    if in_x and in_y:
        part |= {"x": rounded(x, 0), "y": rounded(y, 1)}
    elif in_x:
        part["v"] = rounded(x[:1], 0)
    else:
        part["h"] = rounded(y[:1], 1)
    style = line.get_linestyle()
    part["d"] = "" if style in _HIDDEN else style
    if line.get_drawstyle() == "steps-post":
        part["step"] = 1
    marker = line.get_marker()
    if marker not in _HIDDEN:
        part["m"] = float(line.get_markersize()) * (0.5 if marker == "." else 1.0)
        if _colour(line.get_markerfacecolor()) in ("paper", "none"):
            part["hollow"] = _colour(line.get_markeredgecolor())
    return part


def _labels(axes: Axes) -> dict[int, str]:
    """Return the label of each artist in the legend, by its identity. An error bar has several artists."""
    labels = {}
    for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
        for artist in _artists(handle):
            labels[id(artist)] = label
    return labels


def _artists(handle: Any) -> Iterator[Artist]:
    if isinstance(handle, tuple):
        for each in handle:
            yield from _artists(each)
    elif handle is not None:
        yield handle


def _pen(colour: Any, artist: Artist, labels: dict[int, str]) -> dict[str, Any]:
    """Return colour, opacity and label of an *artist*."""
    from matplotlib.colors import to_rgba

    told: dict[str, Any] = {"c": _colour(colour)}
    alpha = artist.get_alpha()
    alpha = to_rgba(colour)[3] if alpha is None else float(alpha)
    if alpha < 1.0:
        told["a"] = round(alpha, 2)
    if id(artist) in labels:
        told["n"] = labels[id(artist)]
    return told


def _colour(colour: Any) -> str:
    """Return the page's name of a colour, or the colour itself."""
    from matplotlib.colors import to_hex

    if isinstance(colour, str) and colour == "none":
        return "none"
    shade = to_hex(colour)
    return PENS.get(shade, shade)
