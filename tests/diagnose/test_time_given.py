"""A diagnosis with little time ends with what it has, and says what it did not look at."""

from __future__ import annotations

import time
from types import SimpleNamespace

import numpy as np
import pytest
from runs_in_the_tank import towed

from gcs_autotune.diagnose import Diagnosis, diagnose, process_noise, state

SOME = ("quadratic-drag", "dead-zone", "input-bias")


def diagnosed(monkeypatch: pytest.MonkeyPatch, last: str, *, jobs: int = 1) -> Diagnosis:
    """Diagnose a tow with a dead zone, by a clock that leaps to the end as soon as the stage *last* begins."""
    passed = [0.0]

    def watch(stage: str, done: int, total: int) -> None:
        if stage.startswith(last):
            passed[0] = 1e6

    monkeypatch.setattr(state, "time", SimpleNamespace(monotonic=lambda: time.monotonic() + passed[0]))
    runs = towed(("dead-zone", "N", {"width": 0.2}))
    return diagnose(runs, effects=SOME, jobs=jobs, max_seconds=1e5, progress=watch)


@pytest.mark.parametrize("jobs", [1, 2])
def test_time_that_is_over_at_once_leaves_the_base_and_says_where_it_ended(
    monkeypatch: pytest.MonkeyPatch, jobs: int
) -> None:
    found = diagnosed(monkeypatch, "cause 1: fitting", jobs=jobs)
    assert found.causes == ()
    assert found.verdict == "unexplained"
    doubt = next(d for d in found.doubts if d.slug == "out-of-time")
    assert "cause 1: fitting, 0 of " in doubt.cause
    assert "not begun: look under process noise" in doubt.cause
    assert "--max-seconds" in doubt.cure


def test_a_cause_found_before_time_was_over_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    found = diagnosed(monkeypatch, "cause 2")
    assert [c.effect.slug for c in found.causes] == ["dead-zone"]
    assert any("cause 2" in d.cause for d in found.doubts if d.slug == "out-of-time")


def test_time_enough_is_not_mentioned(monkeypatch: pytest.MonkeyPatch) -> None:
    found = diagnosed(monkeypatch, "never")
    assert [c.effect.slug for c in found.causes] == ["dead-zone"]
    assert "out-of-time" not in {d.slug for d in found.doubts}


@pytest.mark.parametrize(
    ("unseen", "holds"),
    [
        ([2.0, 1.5], True),
        ([1.0, 1.5], False),
        ([9.0, -1.0], False),
        ([5.0, 4.0, -0.5], True),
        ([5.0, 1.0, -0.5], False),
        ([20.0, 1.0, -0.5], False),
        ([20.0, 9.0, -0.5, -0.5], False),
        ([0.5, 0.4, 0.3], False),
        ([1.5, 1.4, 1.3], True),
    ],
)
def test_a_name_holds_where_every_part_left_out_gains_or_all_but_one_well_more(
    unseen: list[float], holds: bool
) -> None:
    attested = process_noise.Attested(None, None, 20.0, np.array(unseen), 5.0, 1)  # type: ignore[arg-type]
    assert attested.holds is holds
