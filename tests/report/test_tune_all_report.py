"""The report of ``tune all`` as it is read on a terminal of 80 characters."""

import math
from dataclasses import replace

import pytest

from gcs_autotune.report.toolkit.page import to_html
from gcs_autotune.report.toolkit.terminal import render_text
from gcs_autotune.report.tune.all_loops import JobStep, JobStory, job_document

KEPT = JobStep(
    "heading",
    "04-heading",
    "kept",
    gains={"ATC_STR_RAT_FF": (0.2, 1.93)},
    before={"itae": 193.0, "overshoot": 1.27, "settling": None},
    after={"itae": 16.3, "overshoot": 0.19, "settling": 14.0},
)
LINE = JobStep("line", "06-line", "kept", gains={"WP_RADIUS": (2.0, 7.3)}, before={"rms": 6.9}, after={"rms": 3.5})
OPEN = JobStep("recheck heading", "10-recheck-heading", "not identifiable")


def text(*, simulated: bool) -> str:
    steps = (KEPT, LINE, OPEN)
    return render_text(job_document(JobStory("2026-11-20T20:12:00", "boat", simulated, "tcp:1.2.3.4:5760", "j", steps)))


@pytest.mark.parametrize("simulated", [True, False])
def test_the_undo_of_a_simulated_vehicle_names_no_link(simulated: bool) -> None:
    (undo,) = (line for line in text(simulated=simulated).splitlines() if "params restore" in line)
    assert ("--connect tcp:1.2.3.4:5760" in undo) is not simulated


def test_no_gain_name_is_truncated_and_every_error_has_its_unit() -> None:
    shown = " ".join(text(simulated=True).split())
    assert "ATC_STR_RAT_FF 0.2 -> 1.93" in shown and "…" not in shown
    assert "193 -> 16.3 s²" in shown and "6.90 -> 3.50 m" in shown


def test_every_measured_number_of_a_column_has_the_same_digits() -> None:
    small = replace(KEPT, name="depth", before={"itae": 1.2, "overshoot": 0.1}, after={"itae": 0.953, "overshoot": 0.1})
    document = job_document(JobStory("", "boat", True, "sitl:blueboat", "j", (KEPT, small, LINE)))
    shown = " ".join(render_text(document).split())
    for error in ("193 -> 16.3 s²", "1.20 -> 0.953 s²", "6.90 -> 3.50 m"):
        assert error in shown


def test_an_unsettled_step_is_reported_in_words() -> None:
    document = job_document(JobStory("", "boat", True, "sitl:blueboat", "j", (KEPT,)))
    assert "not settled \u2192\u00a014.0\u00a0s" in to_html(document)


def test_a_missing_settling_time_has_the_reason_of_the_tune() -> None:
    noisy = {"itae": 193.0, "settling": math.nan, "hidden_by_noise": True}
    short = {"itae": 16.3, "settling": math.nan, "hidden_by_noise": False, "span": 20.0}
    document = job_document(JobStory("", "boat", True, "", "j", (replace(KEPT, before=noisy, after=short),)))
    assert "hidden by noise \u2192 not in 20.0 s" in to_html(document).replace("\u00a0", " ")


def test_a_change_below_one_percent_is_not_shown_as_no_change() -> None:
    alike = replace(KEPT, before={"itae": 16.3}, after={"itae": 16.25})
    shown = " ".join(render_text(job_document(JobStory("", "boat", True, "", "j", (alike,)))).replace("│", " ").split())
    assert "tracking error less than 1 % lower (measured)" in shown


def test_gains_of_an_aborted_step_are_not_shown_as_changed() -> None:
    aborted = replace(KEPT, ending="aborted", after=None)
    shown = render_text(job_document(JobStory("", "boat", True, "sitl:blueboat", "j", (aborted,), stopped="stopped")))
    assert "aborted" in shown and "ATC_STR_RAT_FF" not in shown


@pytest.mark.parametrize(
    ("link", "resumed"),
    [
        ("tcp:1.2.3.4:5760", "--connect tcp:1.2.3.4:5760 --resume"),
        ("sitl:blueboat", "--connect 'sitl:blueboat?param=ATC_STR_RAT_FF=1.93' --resume"),
        ("sitl:blueboat?seed=2", "--connect 'sitl:blueboat?seed=2&param=ATC_STR_RAT_FF=1.93' --resume"),
    ],
)
def test_a_simulated_vehicle_is_resumed_with_the_gains_it_had(link: str, resumed: str) -> None:
    story = JobStory("2026-11-20T20:12:00", "boat", True, link, "j", (KEPT, JobStep("line")), stopped="stopped")
    assert resumed in story.resume
