"""The rules of `--resume`, on run directories made by hand: nothing is flown."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from gcs_autotune.errors import BadFile, PreconditionFailed, UsageError, WrongVehicle
from gcs_autotune.link import MavlinkCraft
from gcs_autotune.mavlink import VehicleIdentity
from gcs_autotune.trial import Channel, Trial, save_trial
from gcs_autotune.workflow import CommonSettings, Connection, TuneSettings
from gcs_autotune.workflow.resuming import USED_AGAIN, Earlier, note_setting_out, way_on

BOARD = VehicleIdentity(system=1, component=1, autopilot=3, vehicle_type=11, version="4.6.3", uid="ab12")
OWN = {"ATC_STR_RAT_P": 0.2, "CRUISE_SPEED": 1.5}


class Kept:
    """Writes the files of a run, as its run directory does."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "trials").mkdir(parents=True)

    def save_json(self, name: str, content: Mapping[str, object]) -> None:
        (self.folder / name).write_text(json.dumps(content))


def craft(vehicle: VehicleIdentity = BOARD) -> MavlinkCraft:
    session = SimpleNamespace(vehicle=vehicle)
    return cast(MavlinkCraft, SimpleNamespace(session=session, parameters=SimpleNamespace(session=session)))


def settings(folder: Path, **changes: Any) -> TuneSettings:
    requested = TuneSettings(
        Connection("sitl:charlie"), folder / "again", axis="heading", step=0.5, resume=folder / "run"
    )
    return replace(requested, **changes)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run that ended early: a step and a relay flown to their end, another relay cut off."""
    kept = Kept(tmp_path / "run")
    note_setting_out(cast(Any, kept), settings(tmp_path), craft(), OWN)
    for number, (name, ending) in enumerate(
        [("sign-check", "completed"), ("step-before", "completed"), ("relay-1", "completed"), ("relay-2", "aborted")], 1
    ):
        channel = Channel("psi", "rad", np.array([0.0, 0.1]), np.array([0.0, 0.1]))
        trial = Trial(name, {"psi": channel}, ending=ending)
        save_trial(trial, kept.folder / "trials" / f"{number:02d}-{name}.csv")
    return kept.folder


def test_a_completed_record_is_returned_once(run: Path, tmp_path: Path) -> None:
    earlier = Earlier(settings(tmp_path))
    assert earlier.names == ["step-before", "relay-1"]
    assert earlier.has("relay-1")
    assert not earlier.has("relay-2")
    trial = earlier.take("relay-1")
    assert trial is not None and trial.ending == "completed"
    assert earlier.take("relay-1") is None
    assert earlier.take("sign-check") is None


def test_without_an_earlier_run_there_are_no_records(tmp_path: Path) -> None:
    earlier = Earlier(settings(tmp_path, resume=None))
    assert earlier.names == []
    earlier.verify_same_vehicle(craft(), {})


def test_changed_settings_are_refused_by_name_unless_they_may_differ(run: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"step 0.5 then, 0.25 now"):
        Earlier(settings(tmp_path, step=0.25))
    with pytest.raises(UsageError, match="axis heading then, yaw now"):
        Earlier(settings(tmp_path, axis="yaw", step=None))
    assert Earlier(settings(tmp_path, step=0.25), alike=False).names == ["step-before", "relay-1"]


def test_a_flight_recorded_with_the_settings_of_a_tune_can_be_resumed(run: Path, tmp_path: Path) -> None:
    """Earlier versions recorded a flight as a tune of the heading."""
    note = run / "setting_out.json"
    reported = json.loads(note.read_text())
    note.write_text(json.dumps({**reported, "settings": {**reported["settings"], "step": None, "throttle": 0.4}}))
    flight = CommonSettings(Connection("sitl:charlie"), tmp_path / "again", throttle=0.4, resume=run)
    assert Earlier(flight, ("relay-1",)).names == ["relay-1"]
    with pytest.raises(UsageError, match=r"throttle 0\.4 then, 0\.5 now"):
        Earlier(replace(flight, throttle=0.5), ("relay-1",))


def test_a_folder_without_a_run_is_refused(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    with pytest.raises(UsageError, match="cannot be resumed"):
        Earlier(settings(tmp_path))


@pytest.mark.parametrize(
    "text", ["", "[]", '{"settings": 3}', '{"parameters": {"A": "x"}}', '{"parameters": {"A": NaN}}']
)
def test_a_damaged_note_is_refused(run: Path, tmp_path: Path, text: str) -> None:
    (run / "setting_out.json").write_text(text)
    with pytest.raises(BadFile, match="setting_out"):
        Earlier(settings(tmp_path))


def test_a_run_with_open_debts_must_be_restored_first(run: Path, tmp_path: Path) -> None:
    events = [
        {"event": "opened", "vehicle": {}, "link": "", "mode": "", "armed": False, "fingerprint": {}},
        {"event": "lent", "name": "A", "value": 1.0},
        {"event": "writing", "name": "A", "value": 2.0},
    ]
    (run / "journal.jsonl").write_text("".join(json.dumps(e) + "\n" for e in events))
    with pytest.raises(PreconditionFailed, match="gcs-autotune restore"):
        Earlier(settings(tmp_path))


def test_the_same_board_with_the_same_parameters_can_be_resumed(run: Path, tmp_path: Path) -> None:
    Earlier(settings(tmp_path)).verify_same_vehicle(craft(), dict(OWN))


@pytest.mark.parametrize(
    ("here", "words"),
    [
        (replace(BOARD, uid="cd34"), "its board is ab12 there, cd34 here"),
        (replace(BOARD, version="4.5.7"), "its firmware was 4.6.3 then and is 4.5.7 now"),
        (replace(BOARD, vehicle_type=10), "vehicle_type 11 there, 10 here"),
    ],
)
def test_another_vehicle_or_firmware_is_not_resumed(
    run: Path, tmp_path: Path, here: VehicleIdentity, words: str
) -> None:
    with pytest.raises(WrongVehicle, match=words):
        Earlier(settings(tmp_path)).verify_same_vehicle(craft(here), OWN)


@pytest.mark.parametrize(
    ("own", "words"),
    [
        ({**OWN, "CRUISE_SPEED": 2.0}, "CRUISE_SPEED 1.5 then, 2.0 now"),
        ({"ATC_STR_RAT_P": 0.2}, "CRUISE_SPEED 1.5 then, absent now"),
        ({**OWN, "ATC_STR_RAT_D": 0.0}, "ATC_STR_RAT_D absent then, 0.0 now"),
    ],
)
def test_a_changed_missing_or_new_parameter_is_reported(
    run: Path, tmp_path: Path, own: dict[str, float], words: str
) -> None:
    with pytest.raises(PreconditionFailed, match=rf"parameters have changed .*\({words}\)"):
        Earlier(settings(tmp_path)).verify_same_vehicle(craft(), own)


def test_a_float32_read_back_is_the_same(run: Path, tmp_path: Path) -> None:
    Earlier(settings(tmp_path)).verify_same_vehicle(craft(), {**OWN, "ATC_STR_RAT_P": float(np.float32(0.2))})


def test_the_resume_advice_lists_reusable_records_and_is_empty_without_any(tmp_path: Path) -> None:
    requested = settings(tmp_path)
    reported = way_on(requested, ["sign-check", "relay-1", "step-before"], RuntimeError())
    assert "can be used again: step-before, relay-1. " in reported
    assert f"--resume {requested.directory}" in reported
    assert way_on(requested, ["sign-check"], RuntimeError()) == ""
    assert set(USED_AGAIN) >= {"step-before", "relay-1"}
