"""The oracle of the rivals' contest, on a craft of arithmetic, and the contest as a study."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from benchmarks.rivals import contest
from benchmarks.rivals.contest import Entry
from benchmarks.rivals.fleet import FLEET
from benchmarks.rivals.global_search import true_hull
from benchmarks.rivals.oracle import search
from benchmarks.rivals.rules import Cycle, ziegler_nichols
from benchmarks.studies import FOLDER
from gcs_autotune.design import StepMetrics
from gcs_autotune.study import open_study
from tests.study.toys import ran

RANGES = {"P": (0.0, 2.0), "A": (1.0, 10.0)}


def fly(gains: Mapping[str, float]) -> StepMetrics:
    """Least error at P = 1, A = 4; the larger P the more overshoot."""
    error = 1.0 + math.log(max(gains["P"], 1e-3)) ** 2 + math.log(gains["A"] / 4.0) ** 2
    return StepMetrics(error, 0.3 * gains["P"], 1.0, 1.0, 0.0, 0.0, 0.0)


def test_the_oracle_finds_the_least_error_and_the_limited_one_keeps_its_limit():
    starts = [{"P": 0.3, "A": 1.0}, {"P": 2.0, "A": 9.0}]
    (held, free), flown = search(fly, RANGES, starts, 120, (0.15, math.inf))
    assert flown <= 120 + 6
    assert free.itae == pytest.approx(1.0, abs=0.01)
    assert held.overshoot == pytest.approx(0.15, abs=0.01)
    assert held.gains["A"] == pytest.approx(4.0, rel=0.15)


def test_no_start_beats_the_oracle():
    best = {"P": 1.0, "A": 4.0}
    (answer,), _ = search(fly, RANGES, [{"P": 0.1, "A": 2.0}, best], 4, (math.inf,))
    assert answer.gains == pytest.approx(best)


def test_the_depth_cascade_is_set_to_the_ziegler_nichols_pid() -> None:
    cycle = Cycle(output=0.3, amplitude=0.2, hysteresis=0.1, omega=2.0)
    gains = ziegler_nichols("sub-depth", cycle, 0.0, {"PSC_VELZ_P": 8.0})
    a, b, p, i = gains["PSC_POSZ_P"], 8.0, 0.2 * gains["PSC_ACCZ_P"], 0.2 * gains["PSC_ACCZ_I"]
    ku, tu = cycle.ultimate
    proportional, integral, derivative = b * (p * a + i), i * a * b, p * b + i
    assert proportional == pytest.approx(0.6 * ku)
    assert integral == pytest.approx(proportional / (tu / 2.0))
    assert derivative == pytest.approx(proportional * tu / 8.0)


def test_the_simulated_thruster_is_as_strong_as_the_true_one():
    hull, thruster = true_hull(FLEET["bluerov2"])
    assert hull.alpha == pytest.approx(0.592 / 22.97)
    assert thruster.dead_zone == 0.0625
    assert thruster.static(np.array([0.6]))[0] == pytest.approx(0.70, abs=0.12)


def step(itae: float) -> StepMetrics:
    return StepMetrics(itae, 0.1, 1.0, 1.0, 0.0, 0.0, 0.0, span=5.0)


ENTRIES = [
    Entry(name, {"ATC_STR_RAT_P": itae}, 10.0, step(itae))
    for name, itae in (("defaults", 3.0), ("ours", 1.05), ("oracle, held", 1.2), ("oracle", 1.0))
]


def test_a_contest_is_saved_as_a_row_with_every_entry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(contest, "_firmware_of", lambda vessel: nullcontext())
    monkeypatch.setattr(contest, "all_entries", lambda firmware, vessel, job, budget: ENTRIES)
    (tmp_path / "study.toml").write_text((FOLDER / "rivals.toml").read_text())
    ran(tmp_path / "study.toml", tmp_path / "out")
    rows = open_study(tmp_path / "out").to_dict("records")
    assert len(rows) == sum(len(vessel.jobs) for vessel in FLEET.values())
    assert all(contest.entries_of(row["entries"]) == ENTRIES for row in rows)
    assert {row["over_best"] for row in rows} == {1.05}
    assert all(row["goal"] for row in rows)


def test_the_goal_is_missed_if_far_from_the_oracle_or_worse_than_the_defaults() -> None:
    def goal(ours: float, defaults: float, ending: str = "kept") -> bool:
        found = {"defaults": defaults, "ours": ours, "oracle": 1.0}
        return contest.has_goal([Entry(name, {}, 0.0, step(itae), ending) for name, itae in found.items()])

    assert goal(1.05, 3.0)
    assert goal(2.0, 3.0)
    assert not goal(2.0, 1.5)
    assert not goal(2.0, 3.0, "aborted: a sensor")
