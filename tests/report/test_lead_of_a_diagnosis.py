"""The first sentence of a diagnosis, in plain words for the owner, and its hints."""

from __future__ import annotations

import math
from dataclasses import replace
from string import Formatter

import pytest
from diagnosis_stories import STORIES, WHEN, cause, dead_zone, page_of, unexplained
from page_reader import Page

from gcs_autotune.diagnose import ErrorReduction, Hint, Number, Numbers, Value
from gcs_autotune.effects import EFFECTS
from gcs_autotune.report import diagnosis_document, hint_notes, hint_title, lead_sentence
from gcs_autotune.report.diagnosis.cause_wording import cause_title, evidence_notes
from gcs_autotune.report.diagnosis.lead import FILLED, plain_sentence
from gcs_autotune.report.toolkit.terminal import render_text

HINT = Hint(
    cause="input-bias",
    place="yaw",
    meaning=EFFECTS["input-bias"].meaning,
    parameters={"bias": Value(1.1, "N m", 0.3)},
    gained=5.96,
    unseen=(0.6, 2.6, 2.5),
    held_out="each of 3 runs held out in turn",
    chance=0.04,
    lacks="weak",
    alike=(),
    seconds=480.0,
    needed=800.0,
    separated_by=EFFECTS["input-bias"].separated_by,
)


def ahead(before: float, after: float, low: float, high: float) -> ErrorReduction:
    return ErrorReduction(
        "error 5 s ahead", "psi", "rad", before, after, after / before, (low, high), "each run in turn"
    )


def with_gain(gain):
    """The issue's boat: turning gets harder with speed."""
    reported = cause("speed-damping", "yaw", 0.8, N_ur=(-3.7, "N m s^2/(m rad)", 0.3))
    return replace(
        dead_zone(), causes=(replace(reported, gain=gain),), gain=gain, gains=() if gain is None else (gain,)
    )


def shown(told) -> str:
    return " ".join(render_text(diagnosis_document(told)).split())


@pytest.mark.parametrize("slug", EFFECTS)
def test_every_effect_has_a_sentence_for_the_owner_of_the_boat(slug: str) -> None:
    entry = EFFECTS[slug]
    assert entry.plain.endswith(".") and "  " not in entry.plain
    assert {name for _, name, _, _ in Formatter().parse(entry.plain) if name} <= FILLED
    places = {"actuator": "N", "hydrodynamics": "yaw", "environment": "yaw", "sensor": "psi", "data errors": "psi"}
    reported = plain_sentence(dead_zone(), replace(HINT, cause=slug, place=places[entry.family]))
    assert reported[0].isupper() and "{" not in reported and len(reported.split()) <= 25


def test_the_lead_states_the_difference_and_the_prediction_error_with_and_without_it() -> None:
    reported = with_gain(ahead(math.radians(35.2), math.radians(8.1), 0.18, 0.3))
    assert lead_sentence(reported) == (
        "Your craft's turning resistance grows with speed; a plain simulation's does not. "
        "With this cause in the simulation, the predicted heading 5 s ahead is wrong by 8.1 degrees instead of 35."
    )


def test_a_negligible_difference_is_called_slight() -> None:
    reported = with_gain(ahead(0.1421, 0.1419, 0.98, 1.01))
    assert lead_sentence(reported).endswith("is wrong by 8.13 degrees instead of 8.14. The difference is slight.")
    assert reported.causes[0].is_slight and reported.to_dict()["found"][0]["slight"]
    assert "light: " in cause_title(reported, reported.causes[0])
    assert any("hardly changes the prediction" in note.text for note in evidence_notes(reported, reported.causes[0]))


def test_a_large_but_uncertain_difference_is_not_called_slight() -> None:
    reported = with_gain(ahead(0.0522, 0.0229, 0.44, 1.33))
    assert lead_sentence(reported).endswith("is wrong by 1.3 degrees instead of 3. This improvement is not certain.")
    assert not reported.causes[0].is_slight and "light: " not in cause_title(reported, reported.causes[0])
    (note,) = (n.text for n in evidence_notes(reported, reported.causes[0]) if n.label == "Effect in practice")
    assert note.startswith("It is not certain that this cause improves the prediction.")


@pytest.mark.parametrize(("high", "felt"), [(0.94, True), (0.96, False)])
def test_an_improvement_is_noticeable_if_its_interval_ends_below_95_percent(high: float, felt: bool) -> None:
    assert ahead(1.0, 0.8, 0.7, high).is_felt is felt
    assert ahead(1.0, 0.8, math.nan, math.nan).is_felt


def test_the_lead_reports_that_no_improvement_was_measured() -> None:
    assert lead_sentence(with_gain(None)).endswith("The improvement on runs not used for the fit was not measured.")
    worse = with_gain(ahead(0.1, 0.11, 0.9, 1.2))
    assert lead_sentence(worse).endswith("the predicted heading 5 s ahead is no better on runs not used for the fit.")


def test_a_wrong_parameter_of_a_supplied_model_comes_first() -> None:
    row = Number("alpha", "1", "inertia", 18.0, 0.0, 16.4, 0.1, (16.2, 16.6), True)
    numbers = Numbers("model", (row,), (ahead(0.2, 0.1, 0.4, 0.6),))
    reported = replace(dead_zone(), verdict="wrong-numbers", numbers=numbers)
    assert lead_sentence(reported).startswith("One number of your simulation is wrong: inertia. After the correction, ")


@pytest.mark.parametrize("name", STORIES)
@pytest.mark.usefixtures("words_only")
def test_terminal_and_page_begin_with_the_lead(name: str) -> None:
    reported = STORIES[name]()
    lead = lead_sentence(reported)
    assert len(lead) > 20
    assert shown(reported).split("Columns that contradict")[-1].find(" ".join(lead.split())) < 400
    page = Page(page_of(reported, "boat", WHEN)).text
    assert lead[:40] in page
    assert page.index(lead[:40]) < page.index("Basis of this result")


def test_the_lead_calls_a_hypothesis_a_possible_cause() -> None:
    assert not lead_sentence(dead_zone()).startswith("A possible cause")
    assert lead_sentence(replace(dead_zone(), verdict="partly-explained")).startswith("A possible cause: ")


def test_the_first_figure_comes_before_the_verdict() -> None:
    page = page_of(dead_zone(), "boat", WHEN)
    assert page.index('class="lead') < page.index("<svg") < page.index('class="verdict')


@pytest.mark.usefixtures("words_only")
def test_a_hint_is_shown_with_its_evidence_and_the_deciding_test_in_all_outputs() -> None:
    reported = replace(unexplained(), hints=(HINT,))
    words = {note.label: note.text for note in hint_notes(reported, HINT)}
    assert words["What it would mean"].startswith("A constant push acts on your craft in turning")
    assert "by 6. Held-out data: +5.7 (each of 3 runs held out in turn: +0.6, +2.6, +2.5)" in words["Evidence"]
    assert "1 of 25 such searches" in words["Evidence"] and "The improvement is too small" in words["Evidence"]
    assert words["How to confirm or reject it"].startswith(
        "Fly the same manoeuvres for 13 min 20 s in total instead of 8 min 00 s"
    )
    page = Page(page_of(reported, "boat", WHEN)).text
    for text in words.values():
        assert text in shown(reported)
        assert text[:60] in page.replace("\u00a0", " ")
    assert reported.to_dict()["hints"][0]["needed"] == 800.0
    assert "A constant push acts on your craft in turning" in lead_sentence(reported)


def test_a_hint_is_titled_with_all_of_its_group() -> None:
    alone, group = hint_title(replace(HINT, alike=())), hint_title(replace(HINT, alike=("dead-zone", "backlash")))
    assert alone.endswith(f"({HINT.place})")
    assert group == f"{alone} or dead zone or backlash"
