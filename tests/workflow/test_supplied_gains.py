"""A dry run leaves its proposal and the command that proves it; gains of a file are proved like our own."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from gcs_autotune.cli import main
from gcs_autotune.errors import BadFile, UsageError
from gcs_autotune.manoeuvres import StepSettings
from gcs_autotune.mavlink import load_params
from gcs_autotune.trial import Channel, Trial, save_trial
from gcs_autotune.workflow import load_gains
from gcs_autotune.workflow.supplied_gains import step_of

from .sitl_harness import SLOW_LOOP, Answers, SitlHarness

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def proposed(tmp_path_factory):
    """A dry run: its harness and its story."""
    harness = SitlHarness(tmp_path_factory.mktemp("dry"), "automarine", **SLOW_LOOP)
    command = "gcs-autotune tune heading --gains"
    return harness, harness.tune(dry_run=True, step=np.radians(25.0), proving=command)


def test_a_dry_run_writes_its_proposal_for_every_ground_station(proposed):
    harness, story = proposed
    assert story.ending == "dry-run"
    for name in ("proposed.param", "proposed.params"):
        assert load_params(harness.directory / name) == pytest.approx(dict(story.proposal.new), rel=1e-6)
    plain = (harness.directory / "proposed.param").read_text()
    assert all(re.fullmatch(r"#.*|[A-Z0-9_]+,[-0-9.e]+", line) for line in plain.splitlines())
    rows = (harness.directory / "proposed.params").read_text().splitlines()
    assert "# Vehicle-Id Component-Id Name Value Type" in rows
    cells = [row.split("\t") for row in rows if not row.startswith("#")]
    assert [(c[0], c[1], c[2], c[4]) for c in cells] == [("1", "1", name, "9") for name in story.proposal.new]


def test_the_page_contains_the_command_that_tests_the_proposal(proposed):
    harness, _ = proposed
    page = (harness.directory / "report.html").read_text()
    assert f"gcs-autotune tune heading --gains {harness.directory}/proposed.param" in page


def test_the_gains_of_a_dry_run_are_tested_by_its_own_step_and_kept(proposed, tmp_path):
    dry, dry_story = proposed
    harness = SitlHarness(tmp_path, "automarine", **SLOW_LOOP)
    operator = Answers(True, True)
    story = harness.tune(operator, gains=load_gains(dry.directory, "heading"), simulated=False)
    assert story.ending == "kept", story.reason
    assert "test them by the same manoeuvre" in operator.questions[1]
    assert {n: harness.vehicle.parameters.values[n] for n in dry_story.proposal.new} == pytest.approx(
        dict(dry_story.proposal.new), rel=1e-6
    )
    flown = [json.loads(p.read_text())["meta"] for p in sorted((harness.directory / "trials").glob("*step*.json"))]
    assert [meta["size"] for meta in flown] == pytest.approx([np.radians(25.0)] * 2)
    assert not list((harness.directory / "trials").glob("*relay*"))
    assert story.metrics_after.itae < story.metrics_before.itae
    assert json.loads((harness.directory / "summary.json").read_text())["gains"].keys() == dry_story.proposal.new.keys()


def test_worse_gains_of_a_file_are_removed_again(tmp_path):
    file = tmp_path / "mine.param"
    file.write_text("ATC_RAT_YAW_P,0.05\n")
    harness = SitlHarness(tmp_path, "automarine", **SLOW_LOOP)
    story = harness.tune(gains=load_gains(file, "heading"))
    assert story.ending == "restored", story.reason
    harness.assert_as_found()


@pytest.mark.parametrize(
    ("line", "why"),
    [("ATC_STR_RAT_P,50", "documented range"), ("CRUISE_SPEED,3", "not a gain of the heading loop")],
)
def test_a_file_with_unsuitable_parameters_is_refused_before_anything_moves(line, why, tmp_path):
    file = tmp_path / "mine.param"
    file.write_text(f"ATC_STR_RAT_I,0.1\n{line}\n")
    harness = SitlHarness(tmp_path)
    with pytest.raises(UsageError, match=why):
        harness.tune(gains=load_gains(file, "heading"))
    assert not list((harness.directory / "trials").iterdir())
    harness.assert_as_found()


def flown_step(folder: Path, signal: str) -> Path:
    """A run directory with a proposal and a step of *signal*."""
    (folder / "trials").mkdir(parents=True)
    (folder / "proposed.param").write_text("ATC_SPEED_P,0.5\n")
    t = np.arange(0.0, 5.0, 0.1)
    meta = {"purpose": "proof", "manoeuvre": "step", "signal": signal, "size": 0.4, "duration": 12.0, "base": 0.8}
    run = Trial("step-before", {"u": Channel("u", "m/s", t, 0.0 * t)}, meta={**meta, "steady_band": 0.2})
    save_trial(run, folder / "trials" / "07-step-before.csv")
    save_trial(replace(run, meta={**meta, "size": 9.0}), folder / "trials" / "09-step-after.csv")
    return folder


def test_a_speed_step_starts_from_the_speed_found_in_the_run(tmp_path):
    given = load_gains(flown_step(tmp_path / "run", "u"), "speed")
    requested = StepSettings("u", 99.0, 99.0, speed=1.2)
    assert step_of(given, requested) == StepSettings("u", 0.4, 12.0, base=0.8, steady_band=0.2, speed=1.2)


def test_gains_without_their_step_or_of_another_axis_are_refused(tmp_path):
    run = flown_step(tmp_path / "run", "u")
    with pytest.raises(UsageError, match="axis flown in that run"):
        load_gains(run, "heading")
    loose = tmp_path / "loose.param"
    loose.write_text("ATC_SPEED_P,0.5\n")
    with pytest.raises(UsageError, match="dry run"):
        load_gains(loose, "speed")
    with pytest.raises(BadFile, match=r"no proposed\.param"):
        load_gains(tmp_path, "heading")


def test_the_command_repeats_the_users_options_of_link_step_and_safety(capsys, tmp_path, monkeypatch):
    requested = {}
    job = SimpleNamespace(run=lambda settings, *_: requested.update(s=settings) or 1 / 0)
    monkeypatch.setattr("gcs_autotune.workflow.job_of", lambda name: job)
    words = ["--connect", "udpin:127.0.0.1:0", "--max-distance", "40", "--step", "20", "--system-id", "7"]
    with pytest.raises(ZeroDivisionError):
        main(["tune", "heading", "--dry-run", "--yes", "--function", "butterworth", "--relays", "2", *words])
    command_words = requested["s"].proving.split()
    assert command_words[:3] == ["gcs-autotune", "tune", "heading"]
    assert command_words[-1] == "--gains"
    dry_story = {command_words[i]: command_words[i + 1] for i in range(3, len(command_words) - 1, 2)}
    assert {k: float(v) if v.replace(".", "").isdigit() else v for k, v in dry_story.items()} == {
        "--connect": "udpin:127.0.0.1:0",
        "--max-distance": 40.0,
        "--step": 20.0,
        "--system-id": 7.0,
    }
