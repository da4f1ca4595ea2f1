from __future__ import annotations

import json
import math
import re

import numpy as np
import pytest

from gcs_autotune.errors import OperatorStopped, UsageError, WrongVehicle
from gcs_autotune.link import Journal
from gcs_autotune.manoeuvres import Envelope, common_windows
from gcs_autotune.mavlink import load_params, read_tlog
from gcs_autotune.trial import load_trial
from sitl.effects import parse_effect

from .conftest import taken_plainly
from .sitl_harness import QUICK, SLOW_LOOP, Answers, SitlHarness


@pytest.fixture(scope="module")
def tuned(tmp_path_factory):
    harness = SitlHarness(tmp_path_factory.mktemp("tuned"), "charlie")
    return harness, harness.tune()


@pytest.mark.slow
def test_proven_better_gains_are_on_the_vehicle(tuned):
    harness, story = tuned
    assert story.ending == "kept"
    assert story.metrics_after.itae < 0.95 * story.metrics_before.itae
    steps = [load_trial(path) for path in sorted(harness.directory.glob("trials/*-step-*.csv"))]
    assert story.proposal.windows == common_windows(steps[0], steps[-1]), "prediction and proof are read alike"
    for name, value in story.proposal.new.items():
        assert harness.vehicle.parameters.values[name] == pytest.approx(value, rel=1e-6)


@pytest.mark.slow
def test_turn_rates_are_proved_with_headings_and_both_are_in_the_report(tuned):
    harness, story = tuned
    stages = [t for t in harness.said if t.startswith(("step with", "turn rate with"))]
    assert stages == [f"{what} with {gains} gains" for gains, what in PROOFS]
    before, after = story.beside
    assert after.itae < before.itae
    assert any(reason.startswith("turn rates: tracking error") for reason in story.verdict_reasons)
    assert any("These gains were tested in both modes" in text for text in harness.said)
    summary = json.loads((harness.directory / "summary.json").read_text(encoding="utf-8"))
    assert summary["turn_rates"]["after"]["itae"] == pytest.approx(after.itae)
    page = (harness.directory / "report.html").read_text(encoding="utf-8")
    assert "turn rate, lower is better" in page
    assert "Turn-rate step with the same gains (measured)" in page


PROOFS = (("present", "step"), ("present", "turn rate"), ("new", "step"), ("new", "turn rate"))
"""Gains, and what is flown with them, in their order."""


@pytest.mark.slow
def test_one_relay_ends_once_the_gains_are_determined_without_a_settling_doubt(tuned):
    harness, story = tuned
    assert [trial.name for trial in story.relays] == ["relay-1"]
    assert story.relays[0].reason.startswith("the model is accurate enough for the design")
    assert any("relay-1: completed, the model is accurate enough for the design" in text for text in harness.said)
    assert not {d.slug for d in story.fit.doubts} & {"unsettled", "few-periods"}


@pytest.mark.slow
def test_only_the_proposed_gains_have_changed(tuned):
    harness, story = tuned
    now = dict(harness.vehicle.parameters.values)
    changed = {name for name, value in harness.parameters.items() if now[name] != value}
    assert changed == set(story.proposal.new)


@pytest.mark.slow
def test_the_vehicle_is_left_neutral_disarmed_and_in_its_mode(tuned):
    harness, _ = tuned
    harness.assert_neutral()
    assert not harness.vehicle.autopilot.armed
    assert harness.mode == harness.found == "HOLD"


@pytest.mark.slow
def test_gains_stay_inside_their_documented_ranges(tuned):
    _, story = tuned
    assert story.proposal.changes
    assert all(c.low <= c.new <= c.high for c in story.proposal.changes)


@pytest.mark.slow
def test_the_identified_model_agrees_with_the_hidden_one(tuned):
    _, story = tuned
    assert story.fit.structure == "linear"
    # The autopilot drives the step at a throttle of its own, which rudders feel: a per cent.
    assert story.fit.model.alpha == pytest.approx(16.36, rel=0.02)
    assert story.fit.model.beta == pytest.approx(4.912, rel=0.02)


@pytest.mark.slow
def test_everything_is_announced_before_it_is_done(tuned):
    harness, _ = tuned
    will = [i for i, text in enumerate(harness.said) if text.startswith("will ")]
    done = harness.said.index("step with present gains")
    assert max(will) < done
    announced = " ".join(harness.said[i] for i in will)
    for word in ("arm", "modes", "move", "ATC_STR_RAT_FF"):
        assert word in announced


@pytest.mark.slow
def test_the_run_directory_contains_the_complete_record(tuned):
    harness, story = tuned
    names = {p.name for p in (harness.directory / "trials").glob("*.csv")}
    assert {"01-sign-check.csv", "02-step-before.csv", "03-relay-1.csv", "04-turn-rate-before.csv"} <= names
    assert [n for n in ("step-after", "turn-rate-after") if any(n in name for name in names)]
    assert not any("relay-2" in name for name in names)
    trial = load_trial(harness.directory / "trials" / "03-relay-1.csv")
    assert trial["psi"].unit == "rad" and trial["N"].unit == "1"
    assert any(m.kind == "switch" for m in trial.marks)
    before = load_params(harness.directory / "parameters_before.param")
    assert before["ATC_STR_RAT_P"] == pytest.approx(0.2)
    after = json.loads((harness.directory / "parameters_after.json").read_text())
    assert after["ATC_STR_RAT_P"] == pytest.approx(story.proposal.new["ATC_STR_RAT_P"])
    assert sum(1 for _ in read_tlog(harness.directory / "telemetry.tlog")) > 10_000


@pytest.mark.slow
def test_a_boat_stays_within_the_announced_space(tuned):
    harness, _ = tuned
    (need,) = (text for text in harness.said if "m from the start" in text)
    trials = [load_trial(path) for path in sorted((harness.directory / "trials").glob("*.csv"))]
    x0, y0 = trials[0]["x"].values[0], trials[0]["y"].values[0]
    far = max(float(np.hypot(t["x"].values - x0, t["y"].values - y0).max()) for t in trials)
    assert 100.0 < far < float(need.split(" up to ")[1].split(" m")[0])


def announced_and_flown(harness):
    """Return the announced time and the time flown [s]."""
    messages = " ".join(harness.said)
    minutes, seconds = re.search(r"take about (?:(\d+) min)? ?(?:(\d+) s)? of the vehicle's time", messages).groups()
    flown = sum(int(seconds) for seconds in re.findall(r"\((\d+) s recorded\)", messages))
    return 60.0 * float(minutes or 0) + float(seconds or 0), float(flown)


@pytest.mark.slow
@pytest.mark.usefixtures("plainly")
def test_the_announced_time_is_within_30_percent_of_the_actual_time(tuned, tmp_path):
    large, _ = tuned
    small = SitlHarness(tmp_path, QUICK)
    small.tune(axis="speed")
    for harness in (large, small):
        announced_time, flown = announced_and_flown(harness)
        assert 0.7 * flown <= announced_time <= 1.3 * flown, (announced_time, flown)
    assert flown < 90.0


@pytest.mark.slow
def test_the_journal_is_settled_in_the_end(tuned):
    harness, _ = tuned
    state = Journal.read(harness.directory / "journal.jsonl")
    assert state.closed
    assert state.debts == {}


def with_supplied_sizes(folder):
    harness = SitlHarness(folder, "automarine", **SLOW_LOOP)
    sizes = {"relay_output": 0.4, "relay_hysteresis": math.radians(15.0), "step": math.radians(20.0)}
    with pytest.MonkeyPatch.context() as patched:
        taken_plainly(patched)
        return harness, harness.tune(dry_run=True, step_duration=15.0, **sizes)


@pytest.fixture(scope="module")
def sized(tmp_path_factory):
    return with_supplied_sizes(tmp_path_factory.mktemp("sized"))


@pytest.mark.slow
def test_the_same_seed_gives_a_bit_identical_record(sized, tmp_path):
    runs = []
    for harness, _ in (sized, with_supplied_sizes(tmp_path)):
        files = sorted((harness.directory / "trials").glob("*.csv"))
        runs.append([f.read_bytes() for f in files] + [(harness.directory / "telemetry.tlog").read_bytes()])
    assert runs[0] == runs[1]


@pytest.mark.slow
@pytest.mark.usefixtures("plainly")
def test_a_dry_run_flies_and_designs_but_writes_nothing(tmp_path):
    harness = SitlHarness(tmp_path, QUICK)
    story = harness.tune(dry_run=True)
    assert story.ending == "dry-run"
    assert story.proposal.changes
    harness.assert_as_found()


@pytest.mark.slow
@pytest.mark.usefixtures("plainly")
def test_gains_that_do_not_prove_better_are_restored(tmp_path, monkeypatch):
    monkeypatch.setattr("gcs_autotune.design.verdict.ITAE_RATIO", 1e-6)
    monkeypatch.setattr("gcs_autotune.design.verdict.NO_WORSE", 0.0)
    harness = SitlHarness(tmp_path, "charlie")
    story = harness.tune()
    assert story.ending == "restored"
    assert "at least 100% lower" in " ".join(story.verdict_reasons)
    harness.assert_as_found()


@pytest.mark.slow
@pytest.mark.usefixtures("plainly")
def test_the_operator_is_asked_before_anything_moves_and_before_anything_is_written(tmp_path):
    harness = SitlHarness(tmp_path, QUICK)
    operator = Answers(True, True)
    story = harness.tune(operator, simulated=False)
    assert operator.questions[0] == "Go ahead?"
    assert "ATC_STR_RAT_P 0.2 ->" in operator.questions[1]
    assert story.ending == "kept"


def test_no_to_the_first_question_arms_nothing(tmp_path):
    harness = SitlHarness(tmp_path, QUICK)
    with pytest.raises(OperatorStopped, match="Nothing was armed, moved or written"):
        harness.tune(Answers(False), simulated=False)
    harness.assert_as_found()
    assert not any(harness.directory.glob("trials/*.csv"))


@pytest.mark.slow
@pytest.mark.usefixtures("plainly")
def test_no_to_the_second_question_writes_nothing(tmp_path):
    harness = SitlHarness(tmp_path, QUICK)
    story = harness.tune(Answers(True, False), simulated=False)
    assert story.ending == "declined"
    harness.assert_as_found()


@pytest.mark.slow
@pytest.mark.usefixtures("plainly")
def test_an_rov_tolerates_a_slow_operator(tmp_path):
    # ArduSub disarms three seconds after the last pilot input; each question takes four.
    harness = SitlHarness(tmp_path, "automarine", **SLOW_LOOP)
    story = harness.tune(Answers(True, True), simulated=False)
    assert story.ending in ("kept", "restored")


def test_a_boat_has_no_depth_loop(tmp_path):
    harness = SitlHarness(tmp_path, QUICK)
    with pytest.raises(WrongVehicle, match="no depth loop"):
        harness.tune(axis="depth")
    harness.assert_untouched()
    assert not harness.directory.exists()


@pytest.mark.slow
@pytest.mark.usefixtures("plainly")
def test_present_gains_outside_their_ranges_are_accepted(tmp_path):
    harness = SitlHarness(tmp_path, QUICK, parameters={"ATC_STR_RAT_FF": 9.0})
    story = harness.tune(dry_run=True)
    assert any("ATC_STR_RAT_FF" in note for note in story.proposal.notes)
    harness.assert_as_found()


def test_a_run_directory_is_never_overwritten(tmp_path):
    harness = SitlHarness(tmp_path, QUICK)
    (harness.directory / "trials").mkdir(parents=True)
    with pytest.raises(UsageError, match="already contains a run"):
        harness.tune()


@pytest.mark.slow
def test_relay_and_step_sizes_can_be_supplied(sized):
    _, story = sized
    assert story.relays[0].meta["C"] == pytest.approx(0.4)
    assert story.relays[0].meta["x_a"] == pytest.approx(math.radians(15.0))
    assert story.step_before.meta["size"] == pytest.approx(math.radians(20.0))


@pytest.mark.slow
def test_a_boat_that_runs_out_of_space_is_tuned_from_the_partial_records(tmp_path, plainly):
    waves = parse_effect("wave-disturbance@yaw.amplitude=0.1,frequency=1.5,bandwidth=0.15")
    harness = SitlHarness(tmp_path, "blueboat", effects=[waves])
    story = harness.tune(stop_rule="settled", envelope=Envelope(distance=60.0), dry_run=True)
    assert story.ending == "dry-run"
    messages = " ".join(harness.said)
    assert re.search(
        r"step-before: stopped, out of space \d+ s into the step and 4 s into the step back: 4\d m", messages
    )
    assert re.search(r"relay-2: stopped, out of space, not settled after \d+ reversals: 4\d m", messages)
    assert story.proposal.changes
