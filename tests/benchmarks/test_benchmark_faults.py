"""A small part of the fuzzing and of the faulted tunes, with seeds that stay."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.faulted_tunes import report
from benchmarks.faults import KINDS, Case, Fault, draw_case, play
from benchmarks.faults.case import FLEET
from benchmarks.fuzzed_messages import fuzz_files, fuzz_messages


@pytest.mark.parametrize("seed", [11, 12])
def test_messages_that_no_autopilot_sent_raise_nothing_and_write_nothing(seed: int) -> None:
    assert fuzz_messages(4000, seed) == []


def test_damaged_files_are_read_or_refused_in_words() -> None:
    assert fuzz_files(40, 13) == []


def test_cases_are_drawn_by_seed_and_every_kind_of_fault_is_among_them() -> None:
    cases = [draw_case(5, i) for i in range(200)]
    assert cases == [draw_case(5, i) for i in range(200)]
    assert {f.kind for case in cases for f in case.faults} == set(KINDS)


def test_a_fault_survives_the_way_to_a_file() -> None:
    fault = Fault("loss", 3.0, size=0.2, sent="PARAM_SET", count=2)
    assert Fault.from_dict(fault.to_dict()) == fault


@pytest.mark.parametrize(("moment", "found_as"), [(2.069, 19), (20.0, 2)])
def test_a_vehicle_that_reboots_before_it_was_looked_at_is_found_as_it_boots_and_later_as_it_was(
    moment: float, found_as: int, tmp_path: Path
) -> None:
    """An ROV in ALT_HOLD boots in MANUAL; whoever comes aboard after that leaves it in MANUAL."""
    rov = next(s for s in FLEET if s.vehicle == "videoray" and s.axis == "heading")
    outcome = play(Case.of(rov, Fault("reboot", moment, size=3.5), Fault("unplugged", 26.4), found_mode=2), tmp_path)
    assert outcome.failures == []
    opened = json.loads((tmp_path / "run" / "journal.jsonl").read_text(encoding="utf-8").splitlines()[0])
    assert opened["mode"] == {19: "MANUAL", 2: "ALT_HOLD"}[found_as]


def test_the_table_counts_what_failed() -> None:
    case = draw_case(5, 0).to_dict()
    shared = {"case": case, "ending": "kept", "writes": 4, "proved": True, "as_found_at_once": False}
    text = report([{**shared, "failures": ["left armed"]}, {**shared, "failures": []}])
    assert text.splitlines()[-2].split()[1:] == ["2", "2", "2", "0", "1", "1"]
