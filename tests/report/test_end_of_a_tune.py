"""The end of the terminal report of a tune; shared reasons appear once."""

from __future__ import annotations

from dataclasses import replace

import pytest
import report_stories as stories

from gcs_autotune.design import Change, PositionMetrics
from gcs_autotune.report import Document, to_html, tune_document
from gcs_autotune.report.toolkit.document import Section, cautions
from gcs_autotune.report.toolkit.terminal import render_text
from gcs_autotune.report.toolkit.wording import with_signs
from gcs_autotune.report.tune.figures import step_figure
from gcs_autotune.report.tune.tables import gains_table
from gcs_autotune.report.tune.wording import position_words, undo_sentence, verdict_of

REPORT_AND_PROMPT = 3
"""Lines below the verdict: a blank one, the path of the report and the prompt."""
CHOSEN = "chosen for the smallest predicted tracking error of the step"


def change(name: str, reason: str) -> Change:
    return Change(name, 0.2, 0.4, 0.0, 2.0, reason)


def test_the_verdict_and_the_undo_command_below_it_end_the_terminal():
    text = render_text(tune_document(stories.kept()))
    verdict = text.index("The new heading gains are better in a measured step and are kept.")
    for earlier in ("lower is better", "ATC_", "doubt"):
        assert text.index(earlier) < verdict
    assert text.count("are better in a measured step") == text.count("params restore") == 1
    assert text.splitlines()[-1].startswith("  gcs-autotune params restore ")


def test_a_screen_of_24_lines_shows_gains_verdict_and_undo_at_any_number_of_doubts():
    document = tune_document(stories.kept())
    doubtful = replace(document, doubts=cautions(["the residuals are correlated"] * 30))
    screen = render_text(doubtful).splitlines()[-(24 - REPORT_AND_PROMPT) :]
    for needed in ("gcs-autotune params restore ", "are better in a measured step", " -> "):
        assert any(needed in line for line in screen), needed


def test_a_screen_of_24_lines_shows_the_end_of_a_heading_tune_with_all_its_sentences():
    kept = stories.kept()
    turning = replace(kept.metrics_before, itae=22.7), replace(kept.metrics_after, itae=15.6)
    lines = render_text(tune_document(replace(kept, beside=turning))).splitlines()
    screen = lines[-(24 - REPORT_AND_PROMPT) :]
    assert any(line.startswith("╭") for line in screen) and "params restore" in screen[-1]


def test_margins_below_those_of_the_style_are_stated_with_the_verdict():
    kept, unmet = stories.kept(), ("gain margin 2.37 is less than 2.50", "phase margin 32 deg is less than 45 deg")
    assert "The style requires" not in render_text(tune_document(kept))
    short = replace(kept, proposal=replace(kept.proposal, unmet=unmet))
    end = " ".join(render_text(tune_document(short)).replace("│", " ").split())
    assert "The style requires more: gain margin 2.37 is less than 2.50; phase margin 32° is less than 45°." in end


def test_a_badly_predicted_step_makes_the_margins_doubtful():
    kept = stories.kept()
    assert "doubtful" not in " ".join(verdict_of(kept).sentences)
    missed = replace(kept, metrics_after=replace(kept.metrics_after, itae=5.0 * kept.proposal.after.metrics.itae))
    assert "These margins are doubtful: the model predicted a tracking error of" in " ".join(
        verdict_of(missed).sentences
    )


@pytest.mark.parametrize(
    ("link", "named"),
    [
        ("sitl:charlie?seed=3", "of charlie:"),
        ("sitl:./my/boat.toml", "of boat:"),
        ("udpin:0.0.0.0:14550", "of ArduRover:"),
    ],
)
def test_the_title_names_the_simulated_vehicle_otherwise_the_firmware(link: str, named: str):
    kept = stories.kept()
    document = tune_document(replace(kept, vehicle={**kept.vehicle, "firmware": "ArduRover", "link": link}))
    assert named in document.title


def test_a_position_that_is_held_worse_than_before_is_stated_with_the_verdict():
    before = PositionMetrics(7.4, 0.07, 4.4, 0.018, 0.084, 0.15, 0.25)
    better, worse = replace(before, push=0.04, hold=0.017), replace(before, push=0.04, hold=0.026)
    assert "while holding" not in position_words(before, better)
    words = position_words(before, worse)
    assert words.endswith("(before: 0.084 m); distance while holding 0.026 m rms (before: 0.018 m).")


@pytest.mark.usefixtures("words_only")
def test_the_verdict_of_the_page_links_to_the_undo_command():
    page = to_html(tune_document(stories.kept()))
    assert page.index('class="verdict') < page.index('<a href="#undo">How to undo</a>') < page.index('id="undo"')
    assert '<a href="#undo">' not in page[page.index('id="undo"') :]


def test_a_vehicle_with_its_original_gains_has_nothing_to_undo():
    back = replace(stories.kept(), ending="restored", kept=False, parameters_after=stories.PARAMETERS)
    assert "nothing to undo" in undo_sentence(back)
    assert "nothing to undo" not in undo_sentence(stories.kept())


def test_a_step_that_ended_early_is_captioned_without_a_step_back():
    whole = stories.aborted()
    brief = replace(whole, step_before=stories.step_trial().between(100.0, 120.0))
    captions = [next(step_figure(story)).caption for story in (whole, brief)]
    assert ["step back (second)" in caption for caption in captions] == [True, False]


def test_degrees_and_percent_have_one_notation_and_commands_stay_as_they_are():
    assert with_signs("30 deg at 5 deg/s, 6% (50%)") == "30° at 5°/s, 6 % (50 %)"
    for command in ("`fly --until 'N_r 5%'`", "'N_r 5%'", '"30 deg, 5%"', "gcs-autotune fly --until 5%"):
        assert with_signs(command) == command


def test_captions_of_figures_have_the_notation_of_the_report():
    relay = replace(stories.relay_trial(), reason="the uncertainty changes the ITAE by only 2%")
    assert "End: the uncertainty changes the ITAE by only 2 %." in to_html(
        tune_document(replace(stories.aborted(), relays=(relay,)))
    )


def test_unchanged_gains_are_reported_with_their_measured_step():
    unchanged = replace(stories.kept(), ending="unchanged", metrics_after=None, reason="nothing better was found")
    text = " ".join(verdict_of(unchanged).sentences)
    assert "Step response with these gains (measured): overshoot " in text
    assert "predicted" not in text


def test_the_common_reason_of_all_gains_is_stated_once_under_the_table():
    table = gains_table(
        [
            change("ATC_STR_RAT_FF", f"steering per wanted turn rate: {CHOSEN}"),
            change("ATC_STR_RAT_P", f"steering per turn-rate error: {CHOSEN}, limited to the documented maximum"),
            change("ATC_STR_RAT_I", f"steering per accumulated turn-rate error: {CHOSEN}"),
            change("ATC_STR_ANG_P", f"wanted turn rate per heading error: {CHOSEN}"),
        ]
    )
    assert table.note == f"All are {CHOSEN}."
    assert [row[-1] for row in table.rows] == [
        "steering per wanted turn rate",
        "steering per turn-rate error",
        "steering per accumulated turn-rate error",
        "wanted turn rate per heading error",
    ]
    shown = render_text(Document("", (Section("gains", "Gains", (table,)),)))
    assert " ".join(shown.split()).count("smallest predicted tracking error") == 1
    assert max(map(len, shown.splitlines())) <= 80


def test_a_gain_with_a_reason_of_its_own_keeps_it():
    own = "cruise speed: measured on the water, the speed that this throttle keeps"
    table = gains_table([change("A", f"a: {CHOSEN}"), change("B", f"b: {CHOSEN}"), change("CRUISE_SPEED", own)])
    assert [row[-1] for row in table.rows] == ["a", "b", own]
    assert table.note == f"The others are {CHOSEN}."


def test_a_single_gain_keeps_its_whole_reason():
    table = gains_table([change("A", f"a: {CHOSEN}")])
    assert table.heads[-1] == "why"
    assert table.rows[0][-1] == f"a: {CHOSEN}"
    assert table.note == ""


@pytest.mark.slow
@pytest.mark.usefixtures("words_only")
def test_the_page_also_states_the_common_reason_once():
    story = stories.kept()
    same = tuple(replace(c, reason=f"what it does: {CHOSEN}") for c in story.proposal.changes)
    page = stories.page_of(replace(story, proposal=replace(story.proposal, changes=same)))
    assert page.count(f"All are {CHOSEN}.") == 1
