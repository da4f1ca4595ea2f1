"""Run directories: relays, with the commands of the lead-in before them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs_autotune.errors import BadFile
from gcs_autotune.logs import load_runs
from gcs_autotune.manoeuvres import (
    Dive,
    DiveSettings,
    Relay,
    RelaySettings,
    SignCheck,
    SignCheckSettings,
    Step,
    StepSettings,
    ThrottleSteps,
    ThrottleStepsSettings,
    ThrustCheck,
    ThrustCheckSettings,
    TurnAround,
    TurnAroundSettings,
)
from gcs_autotune.trial import Channel, Trial, save_trial


def trial(start: float, meta: dict[str, object]) -> Trial:
    t = np.arange(start, 20.0, 0.5)
    N = np.where(t < 10.0, 0.0, 0.3)
    channels = {"N": Channel("N", "1", t, N), "psi": Channel("psi", "rad", t, 0.1 * t)}
    return Trial("relay-1", channels, meta=meta)


def test_a_relay_includes_the_inputs_of_its_lead_in(tmp_path: Path) -> None:
    folder = tmp_path / "trials"
    folder.mkdir()
    save_trial(trial(10.0, {"manoeuvre": "relay"}), folder / "01-relay-1.csv")
    save_trial(trial(2.0, {}), folder / "01-relay-1-with-lead-in.csv")
    (run,) = load_runs(tmp_path)
    assert (run["N"].t[0], run["N"].values[0], run["psi"].t[0]) == (2.0, 0.0, 10.0)
    (folder / "01-relay-1-with-lead-in.csv").unlink()
    (run,) = load_runs(tmp_path)
    assert run["N"].t[0] == 10.0


def leave(folder: Path, *runs: tuple[str, str, str]) -> Path:
    """Leave a run directory with these runs, each (name, purpose, ending), as the sequencer does."""
    (folder / "trials").mkdir()
    for k, (name, purpose, ending) in enumerate(runs, start=1):
        meta = {"manoeuvre": "whatever it is called", "purpose": purpose, "dof": "yaw", "signal": "psi"}
        flown = replace(trial(0.0, meta), name=name, ending=ending)
        save_trial(flown, folder / "trials" / f"{k:02d}-{name}.csv")
    return folder


def test_every_manoeuvre_has_a_purpose() -> None:
    flown = [
        Relay(RelaySettings("psi", "N"), "r"),
        ThrottleSteps(ThrottleStepsSettings(0.5), "t"),
        Step(StepSettings("psi", 0.5, 30.0)),
        SignCheck(SignCheckSettings("psi", "N")),
        ThrustCheck(ThrustCheckSettings()),
        TurnAround(TurnAroundSettings(0.5)),
        Dive(DiveSettings(1.5)),
    ]
    purposes = [Trial(m.name, {}, meta=m.settings).purpose for m in flown]
    assert purposes == ["identification", "identification", "proof", "check", "check", "transit", "transit"]


def test_a_directory_is_identified_from_runs_flown_for_identification_under_any_name(tmp_path: Path) -> None:
    runs = [("check", "check", "completed"), ("steps", "identification", "completed"), ("proof", "proof", "completed")]
    (run,) = load_runs(leave(tmp_path, *runs))
    assert run.name == "steps"
    assert "notes" not in run.meta


def test_a_complete_experiment_is_preferred_to_an_aborted_one(tmp_path: Path) -> None:
    runs = load_runs(leave(tmp_path, ("a", "identification", "completed"), ("b", "identification", "aborted")))
    assert [run.name for run in runs] == ["a"]


def test_incomplete_records_and_steps_of_an_aborted_run_are_used_with_doubts(tmp_path: Path) -> None:
    runs = [("pulse", "check", "completed"), ("step", "proof", "completed"), ("swing", "identification", "aborted")]
    found = load_runs(leave(tmp_path, *runs))
    assert [run.name for run in found] == ["step", "swing"]
    assert [run.meta["notes"][0][0] for run in found] == ["makeshift-run-step", "makeshift-run-swing"]
    assert "is incomplete" in found[1].meta["notes"][0][1]


def test_the_pulses_of_a_run_that_ended_at_its_check_are_used(tmp_path: Path) -> None:
    (run,) = load_runs(leave(tmp_path, ("pulse", "check", "aborted"), ("turn", "transit", "completed")))
    assert run.name == "pulse"
    assert run.meta["dof"] == "yaw"


def test_a_directory_without_driven_runs_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(BadFile, match="no run in which an actuator is driven"):
        load_runs(leave(tmp_path, ("turn", "transit", "completed")))


def test_the_purpose_of_an_old_record_follows_from_its_manoeuvre() -> None:
    purposes = [Trial("", {}, meta={"manoeuvre": m}).purpose for m in ("relay", "throttle-steps", "step", "sign-check")]
    assert purposes == ["identification", "identification", "proof", "check"]
    assert Trial("", {}).purpose == ""
