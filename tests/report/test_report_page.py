"""The page: self-contained, well-formed, safe to open, reproducible, and consistent with the run."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
import report_stories as stories
from page_reader import Page

from gcs_autotune.report.toolkit import canvas
from gcs_autotune.report.toolkit.document import Document, Section, Table
from gcs_autotune.report.toolkit.page import to_html
from gcs_autotune.trial import Channel, Mark, Trial

HOSTILE = "<script>alert('$x^2$')</script>\"&"


@pytest.fixture(scope="module")
def pages():
    return {name: stories.page_of(make()) for name, make in stories.STORIES.items()}


@pytest.mark.slow
@pytest.mark.parametrize("name", stories.STORIES)
def test_every_page_is_well_formed_with_unique_identifiers(name, pages):
    page = Page(pages[name])
    assert page.open == []
    assert len(page.ids) == len(set(page.ids))


@pytest.mark.parametrize("name", stories.STORIES)
def test_no_page_loads_external_resources(name, pages):
    page = Page(pages[name])
    beside = set(stories.STORIES[name]().files)
    assert {r[1:] for r in page.references if r not in beside} <= set(page.ids)
    assert all(r.startswith("#") for r in page.references if r not in beside)
    assert not re.search(r"url\((?!#)|@import|https?://", pages[name])
    assert not {"link", "iframe", "img", "object"} & set(page.tags)
    assert page.runs_only_ours


@pytest.mark.parametrize("name", stories.STORIES)
def test_every_page_is_small(name, pages):
    assert len(pages[name].encode()) < 2_000_000
    charts = sum(map(len, re.findall(r'data-chart="[^"]*"', pages[name])))
    assert charts < 0.3 * len(pages[name])


def test_the_same_story_gives_the_same_bytes(pages):
    assert stories.page_of(stories.kept()) == pages["kept"]


def test_plots_use_the_colours_of_the_page_and_are_dark_on_a_dark_page(pages):
    figures = re.findall(r"<svg.*?</svg>", pages["kept"], flags=re.DOTALL)
    assert len(figures) == 7
    style = pages["kept"][: pages["kept"].index("</style>")]
    light, dark = style.split("@media screen and (prefers-color-scheme: dark)", 1)
    dark = dark[: dark.index("}\n}")]
    for figure in figures:
        bare = re.sub(r"var\(--plot-[a-z]+, #[0-9a-f]{6}\)", "", figure)
        assert not [c for c in canvas.PENS if re.search(rf"(fill|stroke): ?{c}", bare)]
        assert "var(--plot-ink" in figure
    for name in canvas.PENS.values():
        shades = [re.search(rf"--plot-{name}: (#[0-9a-f]+);", part) for part in (light, dark)]
        assert shades[0][1] != shades[1][1], name


def test_no_plot_has_its_own_background(pages):
    figures = re.findall(r"<svg.*?</svg>", pages["kept"], flags=re.DOTALL)
    assert len(figures) > 2
    for figure in figures:
        patch = re.search(r'<g id="[^"]*patch_1">\s*<path[^>]*>', figure)[0]
        assert "fill: none" in patch


def test_a_table_wider_than_a_phone_is_stacked_with_the_head_at_each_cell(pages):
    tables = re.findall(r"<table class=.*?</table>", pages["kept"], flags=re.DOTALL)
    gains = next(t for t in tables if "ATC_RAT_YAW_P" in t and ">why<" in t)
    measured = next(t for t in tables if ">lower is better<" in t)
    assert 'class="wide' in gains
    assert 'data-head="why"' in gains
    assert 'class="wide' not in measured


@pytest.mark.parametrize(("name", "is_stacked"), [("A" * 12, False), ("A" * 40, True), ("AAAA_" * 8, False)])
def test_a_table_of_four_columns_is_stacked_only_if_its_longest_pieces_do_not_fit(name: str, is_stacked: bool) -> None:
    row = (name, "1.0000 ± 0.0006", "0.5002 N m ± 0.0005 N m", "slower, in s²/rad²")
    table = Table(("parameter", "before", "after", "remark"), "lrrl", (row,))
    page = to_html(Document("A page", (Section("a", "A", (table,)),)))
    assert ('class="wide' in page) == is_stacked
    assert ("<wbr>" in page) == ("_" in name)
    assert "s²/rad²" in page
    assert "0.5002\u00a0N\u00a0m ±\u00a00.0005\u00a0N\u00a0m" in page


def test_in_print_only_small_elements_avoid_page_breaks(pages):
    paper = re.search(r"@media print \{(.*?)\n\}", pages["kept"], flags=re.DOTALL)[1]
    kept_whole = re.search(r"([^{}]*)\{ break-inside: avoid; \}", paper)[1]
    assert "figure" in kept_whole
    assert "section" not in kept_whole


def test_a_clip_or_marker_used_in_a_figure_is_defined_in_the_same_figure(pages):
    figures = re.findall(r"<svg.*?</svg>", pages["kept"], flags=re.DOTALL)
    assert len(figures) > 2
    for figure in figures:
        used = set(re.findall(r"url\(#([^)]+)\)", figure)) | set(re.findall(r'href="#([^"]+)"', figure))
        assert used <= set(re.findall(r'id="([^"]+)"', figure))


def test_a_finished_tune_shows_every_figure_with_axes_in_degrees(pages):
    page = Page(pages["kept"])
    assert page.tags.count("svg") == 7
    for label in (
        "change of heading [°]",
        "rate [°/s]",
        "residual [°]",
        "N [% of full output]",
        "time since the step [s]",
    ):
        assert label in page.text


def test_every_figure_has_a_description_for_those_who_cannot_see_it(pages):
    assert len(re.findall(r'<svg role="img" aria-label="[^"]{20,}" viewBox=', pages["kept"])) == 7


def test_the_verdict_comes_before_everything_else(pages):
    text = Page(pages["kept"]).text
    places = [
        text.index(w) for w in ("better in a measured step", "parameter old new", "Step before", "command restores")
    ]
    assert places == sorted(places)


def test_other_sections_are_folded_below_a_table_of_contents(pages):
    page = pages["kept"]
    shown, _, folded = page.partition("<nav")
    assert "<details" not in shown
    slugs = re.findall(r'<a href="#([a-z-]+)"', folded)
    assert len(slugs) > 4
    assert [slug for slug in slugs if f'<div id="{slug}">' not in folded] == []
    assert folded.count('<details class="more">') == len(slugs)


def test_a_finished_tune_reports_changes_and_undo_command(pages):
    text = Page(pages["kept"]).text
    assert "tracking error 68 % lower; overshoot 6 % (before: 41 %)" in text
    assert "Changed on the vehicle, verified by reading back: ATC_RAT_YAW_P" in text
    assert "gcs-autotune params restore runs/2026-11-20T20-12-00-heading" in text
    assert "0.1795 ± 0.0011" in text
    assert "6 parameters read, 4 changed" in text


def test_bad_results_are_shown_prominently(pages):
    text = Page(pages["restored"]).text
    assert "tracking error 14 % HIGHER" in text
    assert "never settled" in text
    assert "not everywhere in the model's 95 % region" in text
    assert text.index("Doubts") < text.index("Step before and after")


def test_an_aborted_tune_reports_the_reason_and_leaves_out_unknown_results(pages):
    text = Page(pages["aborted"]).text
    assert "Heading excursion 131° is beyond the limit" in text
    assert "No parameter was written." in text
    assert "not read" in text
    for absent in ("Stability", "Model and measurement", "Relay experiments", "Doubts"):
        assert absent not in text


@pytest.mark.usefixtures("words_only")
def test_an_abort_after_the_push_does_not_claim_that_the_old_gains_are_back():
    story = replace(stories.kept(), ending="aborted", reason="link lost", kept=None, parameters_after={})
    text = Page(stories.page_of(story)).text
    assert "were not read back at the end" in text
    assert "No parameter was written" not in text


@pytest.mark.usefixtures("words_only")
def test_gains_proved_better_before_a_late_abort_are_reported_as_changed():
    story = replace(stories.kept(), ending="aborted", reason="the mode could not be restored")
    text = Page(stories.page_of(story)).text
    assert "The heading tune was aborted." in text
    assert "Changed on the vehicle, verified by reading back: ATC_RAT_YAW_P" in text


@pytest.mark.usefixtures("words_only")
def test_parameters_that_were_not_restored_are_listed():
    story = replace(stories.restored(), parameters_after={**stories.PARAMETERS, "ATC_ANG_YAW_P": 1.82})
    assert "NOT RESTORED: ATC_ANG_YAW_P" in Page(stories.page_of(story)).text


@pytest.mark.usefixtures("words_only")
def test_parameters_changed_by_the_vehicle_are_reported_as_such():
    story = replace(stories.restored(), parameters_after={**stories.PARAMETERS, "ATC_SLEW_YAW": 99.0})
    text = Page(stories.page_of(story)).text
    assert "NOT RESTORED" not in text
    assert "Not this tool but the vehicle or another station changed ATC_SLEW_YAW." in text


@pytest.mark.usefixtures("words_only")
def test_kept_gains_unstable_within_the_uncertainty_are_not_green():
    story = replace(stories.kept(), proposal=stories.proposal(worst_stable=False))
    assert 'class="verdict bad"' in stories.page_of(story)


def test_hostile_names_are_shown_as_text():
    story = stories.kept()
    hostile = replace(
        story,
        title=HOSTILE,
        when=HOSTILE,
        axis=HOSTILE,
        vehicle={**story.vehicle, "name": HOSTILE, HOSTILE: HOSTILE},
        announced=(HOSTILE,),
        rates={HOSTILE: (1.0, 1.0)},
        relays=tuple(replace(r, name=HOSTILE) for r in story.relays),
        events=((1.0, HOSTILE),),
        reason=HOSTILE,
        ending="aborted",
        doubts=(HOSTILE,),
        files=(HOSTILE,),
        directory=HOSTILE,
        verdict_reasons=(HOSTILE,),
        parameters_before={HOSTILE: 1.0},
        parameters_after={HOSTILE: 2.0},
    )
    text = stories.page_of(hostile)
    page = Page(text)
    assert page.runs_only_ours
    assert page.open == []
    assert "alert('$x^2$')" in page.text


def _trial(psi: np.ndarray, **more: object) -> Trial:
    t = np.arange(len(psi)) * 0.1
    return Trial("relay-1", {"psi": Channel("psi", "rad", t, psi)}, **more)


@pytest.mark.parametrize(
    "trial",
    [
        Trial("nothing", {}),
        _trial(np.empty(0)),
        _trial(np.full(50, math.nan)),
        _trial(np.array([1.0])),
        _trial(np.linspace(0.0, 1.0, 50)),
        _trial(np.linspace(0.0, 1.0, 50), marks=(Mark(1.0, "target", {"value": 1.0, "phase": "step"}),)),
        _trial(np.linspace(0.0, 1.0, 50), marks=(Mark(99.0, "target", {"value": 1.0, "phase": "step"}),)),
        _trial(np.linspace(0.0, 1.0, 50), marks=(Mark(2.0, "switch", {"x": math.nan}),), meta={"reference": math.nan}),
    ],
    ids=["no channel", "no sample", "all nan", "one sample", "no mark", "no hold", "late mark", "no input"],
)
def test_a_damaged_record_does_not_break_the_report(trial):
    story = replace(stories.aborted(), step_before=trial, step_after=trial, relays=(trial, trial), metrics_before=None)
    assert Page(stories.page_of(story)).open == []


def test_a_depth_tune_is_plotted_in_metres():
    trial = stories.step_trial()
    channels = {
        "z": replace(trial["psi"], name="z", unit="m"),
        "w": replace(trial["r"], name="w", unit="m/s"),
        "Z": replace(trial["N"], name="Z"),
    }
    story = replace(stories.aborted(), axis="depth", step_before=replace(trial, channels=channels))
    assert "change of depth [m]" in Page(stories.page_of(story)).text
