"""One document, three renderings: a section is written once and appears on the page, on the terminal and in JSON."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import diagnosis_stories
import pytest
import report_stories
from page_reader import Page

import gcs_autotune
from gcs_autotune.identify.doubt import DISTRUST, NOTES
from gcs_autotune.plain_json import json_text
from gcs_autotune.report import (
    Document,
    FlightStory,
    LoopCheck,
    LoopNumbers,
    MethodOutcome,
    Study,
    diagnosis_document,
    flight_document,
    recheck_document,
    study_document,
    to_html,
    to_json,
    tune_document,
)
from gcs_autotune.report.diagnosis import document as diagnosis
from gcs_autotune.report.flight import document as flight
from gcs_autotune.report.flight import recheck
from gcs_autotune.report.study import document as study
from gcs_autotune.report.toolkit.document import IN_RESULT, Figure, Note, Remark, Section, Table, Verdict
from gcs_autotune.report.toolkit.terminal import render_text
from gcs_autotune.report.tune import document as tune
from gcs_autotune.seatrials import Reading, Sheet
from gcs_autotune.seatrials.criteria import judged

GOOD = LoopCheck("heading", "good", "The heading loop is good.", "good", (), LoopNumbers(overshoot=0.05))
FLOWN = FlightStory("zig-zag", "", (("zig-zag", report_stories.step_trial()),))
FITTED = Study("Identification", "", (), (MethodOutcome("output-error", report_stories.fit(), 0.2),))

REPORTS = {
    "diagnosis": (diagnosis, lambda: diagnosis_document(diagnosis_stories.bare())),
    "tune": (tune, lambda: tune_document(report_stories.never_started())),
    "study": (study, lambda: study_document(FITTED)),
    "flight": (flight, lambda: flight_document(FLOWN)),
    "recheck": (recheck, lambda: recheck_document(GOOD)),
}


def energy(*told):
    """The section of a reader who wants one more."""
    yield Section("energy", "Energy", (Note("It took 3 Wh."), Table(("run", "energy"), "lr", (("first", "3 Wh"),))))


@pytest.mark.parametrize("name", REPORTS)
def test_a_section_is_one_function_and_appears_on_page_terminal_and_in_json(name, monkeypatch) -> None:
    module, document = REPORTS[name]
    before = to_json(document())
    monkeypatch.setattr(module, "SECTIONS", (*module.SECTIONS, energy))
    page = Page(to_html(document())).text
    text = render_text(document())
    for words in ("Energy", "It took 3 Wh.", "first"):
        assert words in page
        assert words in text
    data = json.loads(json_text(to_json(document())))
    assert data.pop("energy") == {
        "title": "Energy",
        "parts": [{"text": "It took 3 Wh."}, {"heads": ["run", "energy"], "rows": [["first", "3 Wh"]]}],
    }
    assert data == json.loads(json_text(before))


def shown(*parts, **about) -> Document:
    return Document("A report", (Section("one", "First", parts),), **about)


def test_doubts_are_sorted_by_severity_and_only_the_most_severe_is_red() -> None:
    graves = Remark("The fit did not converge.", "distrust")
    document = shown(Note("plain"), doubts=(Remark("One wide bar.", "note"), Remark("Short."), graves))
    page = to_html(document)
    for reported in (render_text(document), Page(page).text):
        output = " ".join(reported.split())
        places = [output.index(f"{w}: ") for w in ("Do not trust", "Caution", "Note")]
        assert places == sorted(places)
    assert page.count('class="doubt distrust"') == 1
    assert page.count('class="doubt note"') == 1


def test_every_graded_doubt_exists() -> None:
    sources = "".join(path.read_text() for path in Path(gcs_autotune.__file__).parent.rglob("*.py"))
    assert not DISTRUST & NOTES
    assert [slug for slug in DISTRUST | NOTES if sources.count(f'"{slug}"') < 2] == []


def test_an_empty_section_is_left_out_everywhere() -> None:
    empty = shown(Note(""), Table(("head",), "l", ()), Section("two", "Second", (Note(""),)))
    assert "First" not in Page(to_html(empty)).text
    assert render_text(empty).strip() == ""
    assert to_json(empty) == {}


def test_a_detail_is_on_the_page_and_not_on_the_terminal() -> None:
    document = shown(Note("plain"), Note("deep", detail=True), Note("how to read it", kind="quiet"))
    assert render_text(document).split() == ["First", "plain"]
    assert "deep" in Page(to_html(document)).text and "how to read it" in Page(to_html(document)).text


def test_rows_beyond_those_shown_are_folded_on_the_page_and_left_out_on_the_terminal() -> None:
    document = shown(Table(("run",), "l", tuple((f"run {k}",) for k in range(9)), shown=2))
    page = to_html(document)
    assert page.index("run 1") < page.index("<summary>7 more</summary>") < page.index("run 2")
    assert "run 1" in render_text(document) and "run 2" not in render_text(document)
    assert len(to_json(document)["one"]["parts"][0]["rows"]) == 9


def test_page_and_terminal_show_the_angles_of_a_table_with_degree_signs() -> None:
    why = "margins 97.4 in gain, 94 deg in phase"
    document = shown(Table(("parameter", "why"), "ll", (("PSC_POSXY_P", why),)))
    for text in (Page(to_html(document)).text, render_text(document)):
        assert "94° in phase" in text
    assert why in json_text(to_json(document))


def test_an_empty_column_is_left_out_on_page_and_terminal() -> None:
    document = shown(Table(("figure", "limit"), "ll", (("period", ""), ("reach", ""))))
    for text in (to_html(document).partition("<main>")[2], render_text(document)):
        assert "reach" in text
        assert "limit" not in text


def test_a_column_that_80_characters_have_no_space_for_is_on_the_page_only() -> None:
    document = shown(Table(("name", "meaning"), "ll", (("a", "long"),), wide=("meaning",)))
    assert "meaning" not in render_text(document) and "meaning" in to_html(document)


def test_the_verdict_ends_the_terminal_with_its_lead_in_the_box() -> None:
    document = shown(Note("words"), verdict=Verdict("It works.", "good"), contradictions=("x and y disagree.",))
    boxed = render_text(document).splitlines()[-3:]
    assert boxed[0][0] + boxed[2][0] == "╭╰"
    assert boxed[1].strip("│ ") == "It works."
    assert render_text(document).index("disagree") < render_text(document).index("words")
    assert "It works. x and y disagree." in Page(to_html(document)).text
    led = render_text(replace(document, lead="Your boat is fine."))
    assert led.index("words") < led.index("╭") < led.index("Your boat is fine.") < led.index("It works.")


def test_figures_are_plotted_only_for_a_page() -> None:
    drawn = []

    def draw() -> None:
        drawn.append(1)

    document = shown(Note("words"), Figure("one", "a figure", draw))
    assert "words" in render_text(document) and to_json(document)
    assert drawn == []
    to_html(document)
    assert drawn == [1]


def test_facts_of_a_section_replace_its_text_in_json() -> None:
    one = Section("one", "First", (Note("3 Wh"),), facts={"energy": 10800.0})
    two = Section("two", "Second", (Note("words"),), facts=IN_RESULT)
    assert to_json(Document("", (one, two), facts={"schema": 1})) == {"schema": 1, "energy": 10800.0}


@pytest.mark.parametrize(
    ("reason", "sentence"), [("flown for 60 s", "Flown for 60 s."), ("5 executes", "Flown: 5 executes.")]
)
def test_the_verdict_of_a_flight_states_its_ending_once(reason: str, sentence: str) -> None:
    run = FLOWN.flown[0][1]
    story = replace(FLOWN, flown=(("run", replace(run, reason=reason)),))
    verdict = flight_document(story).verdict
    assert verdict is not None
    assert verdict.text == sentence


def test_a_flight_report_ends_with_its_figures_and_the_undo() -> None:
    first = judged("first", "first overshoot", Reading(0.1, 0.0, "rad"))
    figures = (judged("helm", "helm", Reading(0.67, 0.0, "1")), first)
    sheet = Sheet("zig-zag", "zig-zag", "67 %/20° zig-zag", figures, "", ())
    text = render_text(flight_document(replace(FLOWN, sheets=(sheet,))))
    assert " 67 " in text
    boxed = " ".join(text[text.index("╭") :].replace("│", " ").split())
    assert "67 %/20° zig-zag. First overshoot: 5.73°. No parameter was written, so there is nothing to undo." in boxed


def test_a_table_breaks_its_longest_name_only_if_it_is_too_wide() -> None:
    heads = ("parameter", "value ± std", "unit", "meaning", "remark")
    rows = (
        ("N_r", "-0.00001 ± 0.00003", "s/rad", "yaw moment by yaw acceleration", "may be zero"),
        ("quadratic-actuator@N.share", "0.6635 ± 0.0002", "s²/rad²", "quadratic fraction of the thrust", ""),
    )
    document = Document(title="t", sections=(Section("s", "S", (Table(heads, "lrlll", rows),)),))
    narrow, wide = render_text(document, 80), render_text(document, 100)
    for text in (narrow, wide):
        assert "remark" in text and "zero" in text and "acceleration" in text
    assert max(map(len, narrow.splitlines())) <= 80
    assert "quadratic-actuator@N.share" not in narrow and "quadratic-actuator@N.share" in wide
