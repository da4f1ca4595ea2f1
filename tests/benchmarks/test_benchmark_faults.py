"""A small part of the fuzzing and of the faulted tunes, with seeds that stay."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks import studies
from benchmarks.faulted_tunes import main, report
from benchmarks.faults import KINDS, STATION_KINDS, Case, Fault, draw_case, draw_station_case, run_case
from benchmarks.faults.case import FLEET
from benchmarks.faults.station import Order, misattributed, undone_orders
from benchmarks.fuzzed_messages import fuzz_files, fuzz_messages
from gcs_autotune.study import open_study


@pytest.mark.parametrize("seed", [11, 12])
def test_invalid_messages_raise_no_error_and_write_nothing(seed: int) -> None:
    assert fuzz_messages(4000, seed) == []


def test_damaged_files_are_read_or_rejected_with_a_reason() -> None:
    assert fuzz_files(40, 13) == []


def test_cases_are_drawn_by_seed_and_every_kind_of_fault_is_among_them() -> None:
    cases = [draw_case(5, i) for i in range(200)]
    assert cases == [draw_case(5, i) for i in range(200)]
    assert {f.kind for case in cases for f in case.faults} == set(KINDS)


def test_a_fault_survives_serialisation() -> None:
    fault = Fault("loss", 3.0, size=0.2, sent="PARAM_SET", count=2)
    assert Fault.from_dict(fault.to_dict()) == fault


@pytest.mark.slow
@pytest.mark.parametrize(("moment", "found_as"), [(2.069, 19), (20.0, 2)])
def test_the_original_mode_after_an_early_reboot_is_the_boot_mode(moment: float, found_as: int, tmp_path: Path) -> None:
    """An ROV in ALT_HOLD boots in MANUAL; a later connection restores MANUAL."""
    rov = next(s for s in FLEET if s.vehicle == "videoray" and s.axis == "heading")
    outcome = run_case(
        Case.of(rov, Fault("reboot", moment, size=3.5), Fault("unplugged", 26.4), found_mode=2), tmp_path
    )
    assert outcome.failures == []
    opened = json.loads((tmp_path / "run" / "journal.jsonl").read_text(encoding="utf-8").splitlines()[0])
    assert opened["mode"] == {19: "MANUAL", 2: "ALT_HOLD"}[found_as]


def test_the_table_counts_failures() -> None:
    case = draw_case(5, 0).to_dict()
    shared = {"case": case, "ending": "kept", "writes": 4, "proved": True, "restored_at_once": False}
    text = report([{**shared, "failures": ["left armed"]}, {**shared, "failures": []}])
    assert text.splitlines()[-2].split()[1:] == ["2", "2", "2", "0", "1", "1"]


# --- another station ---------------------------------------------------------------------------


def test_the_station_cases_contain_every_action_of_another_station() -> None:
    cases = [draw_station_case(5, i) for i in range(100)]
    assert {f.kind for case in cases for f in case.faults} == {*STATION_KINDS, "reboot", "silence"}


@pytest.mark.parametrize(
    ("index", "ending", "words"),
    [
        pytest.param(83, "NotAsFound", "not by this tool", marks=pytest.mark.slow),
        pytest.param(114, "NotAsFound", "not by this tool", marks=pytest.mark.slow),
        (91, "GuardTripped", "its radio failsafe does this"),
        (96, "TelemetryFault", "the autopilot has restarted"),
        pytest.param(37, "LinkLost", "Lost contact with", marks=pytest.mark.slow),
        pytest.param(68, "kept", "", marks=pytest.mark.slow),
    ],
)
def test_no_order_is_overruled_and_no_cause_is_wrong(index: int, ending: str, words: str) -> None:
    """83, 114: a mode ordered within 5 s of our own order of the same; 96: a restart while arming.

    37: a mode ordered in a silence in which a failsafe disarmed it; 68: disarmed before it was armed.
    """
    outcome = run_case(draw_station_case(1, index))
    assert outcome.failures == []
    assert outcome.ending == ending
    assert words in outcome.message


@pytest.mark.slow
def test_station_cases_are_run_and_counted_from_the_command_line(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(studies, "OUT", tmp_path)
    choice = ["--station", "--first", "114", "--cases", "1", "--seed", "1", "--jobs", "1"]
    assert main(choice) == 0
    assert "orders of another station: 1, ties 0" in capsys.readouterr().out
    (folder,) = tmp_path.iterdir()
    assert json.loads(open_study(folder)["outcome"][0])["orders"] == 1


@pytest.mark.parametrize(
    ("own", "broken", "ties"),
    [
        (Order(10.5, "mode", 15.0, seen=1), 1, 0),
        (Order(10.2, "mode", 15.0, seen=1), 0, 1),
        (Order(9.9, "mode", 15.0, seen=15), 0, 0),
        (Order(10.5, "mode", 15.0, seen=4), 0, 0),
        (Order(10.5, "armed", 0.0, seen=1), 1, 0),
        (Order(10.5, "write", 0.2, "ATC_STR_RAT_P", seen=1), 0, 0),
    ],
)
def test_a_later_own_order_undoes_an_active_order_of_another_station(own: Order, broken: int, ties: int) -> None:
    found, counted = undone_orders([Order(10.0, "mode", 1.0)], [own], [4])
    assert (len(found), counted) == (broken, ties)


def test_a_reported_cause_that_did_not_occur_is_misattributed() -> None:
    text = "this computer paused for 0.6 s without sending overrides"
    assert "this computer paused" in misattributed(text, ["station-mode"])
    assert misattributed(text, ["stall"]) == ""
    assert misattributed("it stopped", ["station-mode"]) == "reports none of station-mode"
