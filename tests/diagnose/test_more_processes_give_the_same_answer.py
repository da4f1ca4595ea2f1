"""Work shared among processes: the same results in the same order, and the same diagnosis."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import numpy as np
import pytest

from gcs_autotune.diagnose import diagnose, workers
from gcs_autotune.diagnose.workers import in_parallel
from gcs_autotune.trial import Channel, Trial


def run_with_dead_zone(seed: int) -> Trial:
    rng = np.random.default_rng(seed)
    t = 0.1 * np.arange(300)
    N = np.repeat(rng.uniform(-0.6, 0.6, 10), 30)
    acting = np.sign(N) * np.maximum(np.abs(N) - 0.12, 0.0)
    r = np.zeros(300)
    for k in range(299):
        r[k + 1] = 0.8 * acting[k] + np.exp(-0.1) * (r[k] - 0.8 * acting[k])
    seen = r + rng.normal(0.0, 0.004, 300)
    return Trial(f"run{seed}", {"N": Channel("N", "N m", t, N), "r": Channel("r", "rad/s", t, seen)})


def test_results_come_in_order_and_progress_to_its_end() -> None:
    said: list[tuple[int, int]] = []
    assert in_parallel(lambda i: i * i, 7, 2, lambda done, total: said.append((done, total))) == [
        i * i for i in range(7)
    ]
    assert said == [(i, 7) for i in range(1, 8)]


def test_processes_end_although_whoever_asked_for_them_catches_signals() -> None:
    before = signal.signal(signal.SIGTERM, lambda number, frame: None)
    try:
        assert in_parallel(abs, 3, 2) == [0, 1, 2]
    finally:
        signal.signal(signal.SIGTERM, before)


def test_a_process_told_to_end_before_it_forgot_its_parents_handlers_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told, lived, begin = tmp_path / "told", tmp_path / "lived", workers._begin

    def begin_as_one_is_told_to_end() -> None:
        try:
            told.touch(exist_ok=False)
        except FileExistsError:
            begin()
            return
        os.kill(os.getpid(), signal.SIGTERM)
        begin()
        lived.touch()

    monkeypatch.setattr(workers, "_begin", begin_as_one_is_told_to_end)
    before = signal.signal(signal.SIGTERM, lambda number, frame: None)
    try:
        assert in_parallel(abs, 3, 2) == [0, 1, 2]
    finally:
        signal.signal(signal.SIGTERM, before)
    assert told.exists() and not lived.exists()


def test_a_search_that_is_stopped_amid_long_answers_ends() -> None:
    """Answers longer than a pipe holds are under way when the parent has had enough."""

    def enough(done: int, total: int) -> None:
        raise KeyboardInterrupt

    for _ in range(5):
        with pytest.raises(KeyboardInterrupt):
            in_parallel(lambda i: bytes(1_000_000), 8, 4, enough)


def test_what_a_task_raises_is_raised() -> None:
    with pytest.raises(ZeroDivisionError):
        in_parallel(lambda i: 1 // (i - 3), 6, 2)


@pytest.mark.slow
def test_a_diagnosis_does_not_depend_on_the_number_of_processes() -> None:
    runs = [run_with_dead_zone(seed) for seed in (1, 2)]
    effects = ("dead-zone", "input-bias", "saturation", "quadratic-actuator")
    one, two = (diagnose(runs, effects=effects, jobs=jobs) for jobs in (1, 2))
    assert [c.effect for c in one.causes] == [c.effect for c in two.causes]
    assert [c.effect.slug for c in one.causes] == ["dead-zone"]
    assert one.ranking == two.ranking
