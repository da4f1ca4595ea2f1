"""Every kind of report on a phone in light and dark mode, and in print."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import diagnosis_stories
import numpy as np
import pytest
import report_stories

from gcs_autotune.api import example_run, fit, save_model
from gcs_autotune.cli import main
from gcs_autotune.trial import Channel, Trial, save_trial
from tests.study.test_report import FUNCTIONS, GRID
from tests.study.toys import ran, study_file

pytestmark = [pytest.mark.browser, pytest.mark.slow]

PAPER = {"width": 688, "height": 1017}
"""A4 less its margins [CSS px]."""
KINDS = ("tune", "identification", "study", "flight", "diagnosis", "compare", "figures", "design")
WIDER = """() => [...document.querySelectorAll(".scroll, .paper, pre")]
  .filter((node) => node.scrollWidth > node.clientWidth + 1).map((node) => node.textContent.trim().slice(0, 60))"""
STACKED = """() => [...document.querySelectorAll("table")].filter((table) => table.rows[0].cells.length <= 4)
  .filter((table) => getComputedStyle(table).display !== "table").map((table) => table.textContent.slice(0, 60))"""
BROKEN = r"""() => [...document.querySelectorAll("td")].flatMap((cell) => {
  const walker = document.createTreeWalker(cell, NodeFilter.SHOW_TEXT), broken = [];
  while (walker.nextNode()) for (const piece of walker.currentNode.data.matchAll(/[-\d.,]*\d(\u00a0[^ \u00a0]+)?/g)) {
    const range = document.createRange();
    range.setStart(walker.currentNode, piece.index);
    range.setEnd(walker.currentNode, piece.index + piece[0].length);
    if (range.getClientRects().length > 1) broken.push(cell.textContent);
  }
  return broken;
})"""
"""Cells in which a line ends inside a number or between a number and its unit."""
FIGURES = """() => [...document.querySelectorAll("figure")].map((node) => {
  const box = node.getBoundingClientRect(), svg = node.querySelector("svg"), shown = svg.getBoundingClientRect();
  const drawn = svg.viewBox.baseVal, scale = Math.min(shown.width / drawn.width, shown.height / drawn.height);
  const beside = node.parentElement.querySelectorAll(":scope > figure").length;
  return { top: box.top, high: box.height, letters: 8.8 * scale, beside };
})"""


BESIDE = """() => {
  const [figure, table] = ["figure", ".scroll"].map((what) => document.querySelector(`#step > ${what}`))
    .map((node) => node.getBoundingClientRect());
  return [table.left >= figure.right && table.top < figure.top + 40, figure.bottom <= table.top];
}"""
"""Whether the first table of the step is beside its figure, and whether it is below it."""


def zig_zag() -> Trial:
    """Return a 20/20 zig-zag of a ship with 4 r' + r = 0.25 delta, sampled at 10 Hz."""
    psi = r = delta = 0.0
    rows = []
    for k in range(1200):
        if k >= 100 and (delta == 0.0 or abs(psi) >= 20.0):
            delta = 20.0 if psi < 20.0 else -20.0
        rows.append((0.1 * k, math.radians(psi), math.radians(delta)))
        r += 0.1 * (0.25 * delta - r) / 4.0
        psi += 0.1 * r
    t, heading, helm = np.array(rows).T
    return Trial("zig-zag", {n: Channel(n, "rad", t, v) for n, v in (("psi", heading), ("delta", helm))})


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("reports")
    read, written = {"ATC_STR_RAT_FF": 0.03005, "MOT_VEC_ANGLEMAX": 30.0}, {"ATC_STR_RAT_FF": 0.86242}
    reported = replace(report_stories.kept(), parameters_before=read, parameters_after={**read, **written})
    (folder / "tune.html").write_text(report_stories.page_of(reported))
    reported = diagnosis_stories.dead_zone()
    (folder / "diagnosis.html").write_text(diagnosis_stories.page_of(reported, "Lake", diagnosis_stories.WHEN, "out"))
    run = example_run()
    save_model(fit(run, "linear", dof="yaw"), folder / "model.json")
    run.to_pandas().to_csv(folder / "run.csv")
    (page, model) = (str(folder / name) for name in ("identification.html", "model.json"))
    assert main(["identify", str(folder / "run.csv"), "--dof=yaw", f"--page={page}", "--quiet"]) == 0
    ran(study_file(folder, "work", GRID, FUNCTIONS), folder / "cases")
    assert main(["study", "report", str(folder / "cases")]) == 0
    (folder / "cases" / "report.html").rename(folder / "study.html")
    preview = ["fly", "zig-zag", "--preview", f"--model={model}", "--throttle=0.5", "--speed=1", f"--out={folder}"]
    assert main([*preview, "--quiet"]) == 0
    (folder / "preview.html").rename(folder / "flight.html")
    run.to_pandas().to_csv(folder / "later.csv")
    save_trial(zig_zag(), folder / "zig-zag.csv")
    files = {name: str(folder / f"{name}.csv") for name in ("run", "later", "zig-zag")}
    others = {
        "compare": (files["run"], files["later"]),
        "figures": (files["zig-zag"],),
        "design": (model, "--for=heading", "--speed=1"),
    }
    for verb, what in others.items():
        assert main([verb, *what, f"--page={folder / verb}.html"]) == 0
    return {kind: folder / f"{kind}.html" for kind in KINDS}


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("kind", KINDS)
def test_every_report_is_readable_on_a_phone(
    browser: Any, barriers: Any, reports: dict[str, Path], kind: str, scheme: str
) -> None:
    page = browser.new_page(viewport={"width": 390, "height": 800}, color_scheme=scheme)
    page.goto(reports[kind].as_uri())
    page.evaluate("document.querySelectorAll('details').forEach((each) => { each.open = true; })")
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert page.evaluate(WIDER) == []
    assert page.evaluate(STACKED) == []
    assert page.evaluate(BROKEN) == []
    assert barriers(page) == []
    ink, paper = page.evaluate(
        "() => ['ink', 'paper'].map((n) => getComputedStyle(document.documentElement).getPropertyValue(`--plot-${n}`))"
    )
    assert (ink < paper) == (scheme == "light")  # dark pens on light paper, or the other way round
    page.close()


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "compare"])  # of two logs: tables only
def test_printed_figures_are_small_and_readable(browser: Any, reports: dict[str, Path], kind: str) -> None:
    page = browser.new_page(viewport=PAPER, color_scheme="dark")
    page.emulate_media(media="print")
    page.goto(reports[kind].as_uri())
    page.evaluate("document.querySelectorAll('details').forEach((each) => { each.open = true; })")
    figures = page.evaluate(FIGURES)  # kept whole: what is higher leaves pages half empty
    assert figures
    assert [f for f in figures if f["high"] > 0.4 * PAPER["height"]] == []
    assert [f for f in figures if f["letters"] < 6.0] == []  # CSS px, 4.5 points
    pairs = [(a, b) for a, b in zip(figures[::2], figures[1::2], strict=False) if a["beside"] == b["beside"] == 2]
    assert [p for p in pairs if p[0]["top"] != p[1]["top"]] == []
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    page.close()


def test_a_wide_screen_shows_the_figure_of_a_tune_beside_its_tables(browser: Any, reports: dict[str, Path]) -> None:
    for width, expected in ((1280, [True, False]), (390, [False, True])):
        page = browser.new_page(viewport={"width": width, "height": 800})
        page.goto(reports["tune"].as_uri())
        assert page.evaluate(BESIDE) == expected
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        page.close()
