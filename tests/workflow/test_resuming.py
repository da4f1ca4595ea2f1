"""`tune --resume RUN`: what was flown to its end is used, of the same vehicle with the same parameters alone."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs_autotune.errors import (
    GuardTripped,
    LinkLost,
    OperatorStopped,
    PreconditionFailed,
    UsageError,
)
from gcs_autotune.trial import load_trial
from gcs_autotune.workflow import tune
from gcs_autotune.workflow.resuming import same_options

from .sitl_harness import WHEN, Ear, Later, Moored, SitlHarness
from .test_silence import Enough

pytestmark = pytest.mark.slow

CHANGED = "ATC_STR_RAT_FF"


@pytest.fixture(scope="module")
def ended_early(tmp_path_factory: pytest.TempPathFactory) -> SitlHarness:
    """A heading tune that was stopped after its first self-oscillation."""
    harness = SitlHarness(tmp_path_factory.mktemp("ended_early"))
    with pytest.raises(OperatorStopped):
        harness.tune(Enough(harness, "relay-1: completed"))
    return harness


class Again:
    """The same vehicle, tuned with an earlier run resumed, until *words* are announced."""

    def __init__(self, harness: SitlHarness, tmp_path: Path, words: str = "identifying", **changes: Any) -> None:
        self.said: list[str] = []
        self.operator = Enough(self, words)  # type: ignore[arg-type]
        self.directory = tmp_path / "again"
        connection = Moored(peer=Later(harness.server))
        expected = {"resume": harness.directory, **changes}
        self.settings = replace(harness.settings(), connection=connection, directory=self.directory, **expected)

    def tune(self) -> None:
        tune(self.settings, self.operator, Ear(self.said), WHEN)


def test_the_resume_command_is_shown_with_the_reusable_records(ended_early: SitlHarness) -> None:
    reported = [text for text in ended_early.said if "--resume" in text]
    assert reported == [
        "these records of the run can be used again: step-before, relay-1. To continue from there, use the same "
        f"options: gcs-autotune tune heading --connect memory --resume {ended_early.directory}"
    ]


def test_the_report_shows_the_resume_command_without_unfolding(ended_early: SitlHarness) -> None:
    page = (ended_early.directory / "report.html").read_text()
    assert page.index('class="verdict') < page.index('<a href="#resume">') < page.index("<details")
    assert page.index('id="resume"') < page.index("--resume") < page.index("<details")


def test_the_summary_contains_the_resume_command_for_lists_of_runs(ended_early: SitlHarness) -> None:
    resume = json.loads((ended_early.directory / "summary.json").read_text())["resume"]
    (sentence,) = [text for text in ended_early.said if "--resume" in text]
    assert sentence.lower() == f"{resume['text']} {resume['command']}".lower()


def test_reusable_records_are_used_and_only_the_rest_is_flown(ended_early: SitlHarness, tmp_path: Path) -> None:
    again = Again(ended_early, tmp_path)
    with pytest.raises(OperatorStopped):
        again.tune()
    assert f"using from {ended_early.directory}: step-before, relay-1. Vehicle and parameters are unchanged" in (
        again.said
    )
    (announced,) = [text for text in again.said if text.startswith("will take about")]
    stages = announced.partition(". If")[0]
    assert "turn rate with present gains 38 s, step with new gains" in stages
    assert "step with present gains" not in announced and "first self-oscillation" not in announced
    assert "step with present gains: not flown. Using step-before from the earlier run" in again.said
    assert "first self-oscillation: not flown. Using relay-1 from the earlier run" in again.said
    assert any(text.startswith("sign-check: completed") for text in again.said)  # for safety, always
    names = {path.stem.partition("-")[2] for path in (again.directory / "trials").glob("*.csv")}
    assert {"sign-check", "step-before", "relay-1"} <= names
    old, new = (load_trial(next(d.glob("trials/*-relay-1.csv"))) for d in (ended_early.directory, again.directory))
    assert old.channels.keys() == new.channels.keys()
    for name, channel in old.channels.items():
        assert np.array_equal(channel.values, new[name].values, equal_nan=True), name


def test_a_vehicle_with_a_changed_parameter_is_not_resumed(ended_early: SitlHarness, tmp_path: Path) -> None:
    values, old = ended_early.vehicle.parameters.values, ended_early.vehicle.parameters.values[CHANGED]
    values[CHANGED] = old + 0.125
    again = Again(ended_early, tmp_path)
    try:
        with pytest.raises(PreconditionFailed, match=rf"{CHANGED} [\d.]+ then, [\d.]+ now\), so its experiments"):
            again.tune()
    finally:
        values[CHANGED] = old
    assert not any(text.startswith("State before the run: mode") for text in again.said)


@pytest.mark.parametrize(
    ("changes", "words"),
    [({"step": 0.25}, "step unset then, 0.25 now"), ({"axis": "yaw"}, "axis heading then, yaw now")],
)
def test_other_settings_are_refused_before_the_link_is_opened(
    ended_early: SitlHarness, tmp_path: Path, changes: dict[str, Any], words: str
) -> None:
    again = Again(ended_early, tmp_path, **changes)
    with pytest.raises(UsageError, match=words):
        again.tune()
    assert again.said == [] and not again.directory.exists()


def test_after_a_tripped_limit_the_advice_is_to_change_that_limit() -> None:
    assert same_options(GuardTripped("", guard="time")).startswith("change --max-time")
    assert same_options(GuardTripped("", guard="pause")) == same_options(LinkLost("")) == "use the same options"
