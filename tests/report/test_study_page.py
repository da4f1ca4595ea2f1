"""The page of an identification."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from page_reader import Page

from gcs_autotune.identify import fit, validate
from gcs_autotune.report import MethodOutcome, RunRow, Study, plot, study_document, to_html
from gcs_autotune.report.study.tables import meaning_of
from gcs_autotune.report.toolkit.terminal import render_text
from gcs_autotune.trial import Channel, Trial


def trial() -> Trial:
    rng = np.random.default_rng(4)
    t = np.arange(0.0, 40.0, 0.1)
    tau = np.repeat(rng.uniform(-1.0, 1.0, 20), 20)
    r = np.zeros(len(t))
    for k in range(len(t) - 1):
        r[k + 1] = tau[k] + (r[k] - tau[k]) * np.exp(-0.05)
    noisy = r + rng.normal(0.0, 0.02, len(t))
    return Trial("run <1>", {"r": Channel("r", "rad/s", t, noisy), "N": Channel("N", "N m", t, tau)})


@pytest.fixture(scope="module")
def study() -> Study:
    run = trial()
    found = fit(run, "linear")
    outcomes = (
        MethodOutcome("output-error", found, 0.2, validate(found.model, run)),
        MethodOutcome("iso", None, 0.0, None, "no relay here"),
    )
    row = RunRow(run.name, "run.csv", run.duration, 400, ("r", "N"), "identification")
    return Study("Identification of yaw", "2026-11-21T10:00:00", (row,), outcomes, how_unseen="Predicted.")


@pytest.fixture(scope="module")
def page(study: Study) -> str:
    return to_html(study_document(study))


def test_the_page_is_reproducible_and_loads_no_external_resources(study: Study, page: str) -> None:
    assert page == to_html(study_document(study))
    assert not re.search(r"(?:src|href)=[\"']?(?:https?:)?//", page)
    assert Page(page).runs_only_ours


def test_the_page_is_well_formed_and_names_are_escaped(page: str) -> None:
    open_tags: list[str] = []

    class Reader(HTMLParser):
        def handle_starttag(self, tag: str, attrs: object) -> None:
            if tag not in ("meta", "br", "path", "use", "rect", "link"):
                open_tags.append(tag)

        def handle_endtag(self, tag: str) -> None:
            if tag in open_tags:
                while open_tags.pop() != tag:
                    pass

    Reader().feed(page)
    assert open_tags == []
    assert "run &lt;1&gt;" in page


def test_page_and_terminal_show_value_check_and_refusal(study: Study, page: str) -> None:
    for text in (page, render_text(study_document(study))):
        assert "alpha_r" in text
        assert "no relay here" in text
        assert "The residual is the misfit to the data used for the fit" in " ".join(text.split())
        assert "held-out" in text


def test_derivatives_are_explained_in_words() -> None:
    assert meaning_of("X_u") == "surge force by surge"
    assert meaning_of("N_rr") == "yaw moment by yaw rate squared"
    assert meaning_of("Y_rdot") == "added mass: sway force by yaw acceleration"
    assert meaning_of("N_rdot", alone=False) == "inertia with added mass: yaw moment by yaw acceleration"
    assert meaning_of("Z_0") == "constant heave force"
    assert meaning_of("k_thrust") == ""


def test_a_fit_plots_itself_in_a_notebook(study: Study) -> None:
    figure = plot(study.fit)
    assert len(figure.axes) == 2 * len(study.fit.traces)
    assert any("model" in (line.get_label() or "") for line in figure.axes[0].lines)


def test_the_page_plots_the_input_under_every_fit_and_the_track(study: Study, page: str) -> None:
    run = trial()
    t = run["r"].t
    gone = {"x": Channel("x", "m", t, 0.5 * t), "y": Channel("y", "m", t, 0.1 * t)}
    full = to_html(study_document(replace(study, trials=(replace(run, channels={**run.channels, **gone}),))))
    assert sum(figure.count("N [N m]") for figure in re.findall(r"<svg.*?</svg>", full, re.DOTALL)) == 2
    assert "east [m]; circle: start, square: end" in full
    assert "N [N m]" not in page
    assert "circle: start" not in page
    assert "95 % interval [% of value]" in page
