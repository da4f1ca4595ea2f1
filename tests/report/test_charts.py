"""The interactive charts: the same curves as the SVG, as data for the page's script."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs_autotune.report.toolkit.canvas import AFTER, BEFORE, legend, new_axes, pens, to_svg
from gcs_autotune.report.toolkit.chart import chart_script, to_chart
from gcs_autotune.report.toolkit.document import Document, Figure, Section
from gcs_autotune.report.toolkit.page import to_html


def draw():
    figure, (top, bottom) = new_axes((1.0, 0.5))
    t = np.linspace(0.0, 10.0, 50)
    top.fill_between(t, t - 1.0, t + 1.0, color=AFTER, alpha=0.3, label="band")
    top.plot(t, t**2, color=AFTER, label="</script><b>")
    top.axhline(40.0, color=BEFORE, ls="--", label="limit")
    top.invert_yaxis()
    bottom.step(t, np.where(t < 5.0, -1.0, np.nan), where="post", color=BEFORE)
    bottom.set_xlabel("time [s]")
    legend(top)
    return figure


def chart_of(figure: Any) -> list[dict[str, Any]]:
    with pens("f"):
        to_svg(figure, "f", "a figure")
        reported = to_chart(figure)
    return json.loads(reported) if reported else []


def test_a_chart_contains_every_curve_of_the_figure_with_values_colour_and_label():
    top, bottom = chart_of(draw())
    band, curve, limit = top["parts"]
    assert (band["fill"], band["a"], band["n"]) == (1, 0.3, "band")
    assert (curve["c"], curve["n"], curve["d"]) == ("after", "</script><b>", "-")
    assert np.allclose(curve["y"], np.square(curve["x"]), atol=0.1)
    assert (limit["h"], limit["d"], limit["n"]) == ([40], "--", "limit")
    assert top["y"]["lim"][0] > top["y"]["lim"][1]
    assert (bottom["x"]["name"], bottom["x"]["lim"]) == ("time [s]", top["x"]["lim"])
    assert bottom["parts"][0]["step"] == 1
    assert bottom["parts"][0]["y"][-1] is None


def test_text_ticks_are_kept_and_a_figure_with_text_annotations_is_not_a_chart():
    figure, (axes,) = new_axes((1.0,))
    axes.plot([1.0, 2.0], [0.0, 1.0], "o", color=AFTER)
    axes.set_yticks([0, 1], ["heading", "turn rate"])
    (panel,) = chart_of(figure)
    assert panel["y"]["ticks"] == [[0, "heading"], [1, "turn rate"]]
    axes.text(1.01, 0.0, "3 %", transform=axes.get_yaxis_transform())
    assert chart_of(figure) == []


def test_a_heading_beyond_north_is_shown_as_on_a_compass():
    figure, (axes,) = new_axes((1.0,))
    axes.plot([0.0, 1.0], [350.0, 380.0])
    axes.yaxis.set_major_formatter(lambda degrees, _: f"{degrees - 360.0:g}")
    assert chart_of(figure)[0]["y"]["off"] == 360.0


def page_with(*figures: Figure) -> str:
    return to_html(Document("A page", (Section("one", "One", figures),)))


def test_the_script_is_included_once_and_only_in_pages_with_charts():
    page = page_with(Figure("f", "one", draw), Figure("g", "two", draw))
    assert page.count(chart_script()) == 1
    assert page.count("</script>") == 1
    assert page.count("data-chart=") == 2
    assert "Leon Sorokin" in page  # whose uPlot it is
    assert "http" not in chart_script()
    assert "<script" not in page_with(Figure("f", "none", lambda: None))


def test_a_caption_has_the_same_notation_as_the_text():
    page = page_with(Figure("f", "30 deg, off by 6%.", draw))
    assert "<figcaption>30°, off by 6\u00a0%.</figcaption>" in page
    assert "6%" not in page


@pytest.mark.browser
def test_a_curve_is_read_hidden_and_zoomed_on_screen_and_printed_as_svg(browser: Any, tmp_path: Path) -> None:
    plain = Figure("f", "a figure", draw)
    (tmp_path / "page.html").write_text(page_with(plain, replace(plain, name="g")))
    page = browser.new_page(viewport={"width": 390, "height": 800})
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto((tmp_path / "page.html").as_uri())
    over = page.locator(".u-over").first
    over.hover(position={"x": 150, "y": 20})
    read = page.locator(".read").first
    assert re.search(r"time [45]\.\d", read.text_content())
    assert "</script><b>" in read.text_content()
    button = page.get_by_role("button", name="</script><b>").first
    button.click()
    assert button.get_attribute("aria-pressed") == "false"
    over.hover(position={"x": 150, "y": 21})
    assert "</script><b>" not in read.text_content()
    box = over.bounding_box()
    page.mouse.move(box["x"] + 100, box["y"] + 20)
    page.mouse.down()
    page.mouse.move(box["x"] + 200, box["y"] + 20, steps=4)
    page.mouse.up()
    over.hover(position={"x": 2, "y": 20})
    zoomed = float(read.text_content().split()[1].replace("\N{MINUS SIGN}", "-"))
    assert zoomed > 2.0
    assert page.locator("svg:visible").count() == 0
    page.emulate_media(media="print")
    assert page.locator("figure svg:visible").count() == 2
    assert page.locator("canvas:visible").count() == 0
    assert errors == []
    page.close()
