"""Work in several processes: the same results in the same order, limits that hold, the same diagnosis."""

from __future__ import annotations

import multiprocessing
import operator
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from gcs_autotune import executor as executor_module
from gcs_autotune.clock import Budget, OutOfWork, current_effort, limited_to, spend
from gcs_autotune.diagnose import diagnose
from gcs_autotune.executor import Executor, KeptProcess, ProcessExecutor, SerialExecutor, executor_for
from gcs_autotune.trial import Channel, Trial

METHODS = [m for m in ("fork", "spawn") if m in multiprocessing.get_all_start_methods()]
EVERY = [SerialExecutor(), *(ProcessExecutor(3, method) for method in METHODS)]
NAMES = ["serial", *METHODS]


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


@pytest.mark.parametrize("executor", EVERY, ids=NAMES)
def test_results_are_in_order_and_progress_reaches_its_end(executor: Executor) -> None:
    seen: list[tuple[int, int]] = []
    squares = executor.map(partial(operator.pow, 2), range(7), lambda done, total: seen.append((done, total)))
    assert list(squares) == [2**i for i in range(7)]
    assert seen == [(i, 7) for i in range(1, 8)]


@pytest.mark.parametrize("executor", EVERY, ids=NAMES)
def test_an_error_of_a_task_is_raised(executor: Executor) -> None:
    with pytest.raises(ZeroDivisionError):
        list(executor.map(partial(operator.floordiv, 1), [3, 2, 1, 0]))


@pytest.mark.parametrize("executor", EVERY, ids=NAMES)
def test_work_is_counted_in_all_processes_and_ends_at_the_same_task(executor: Executor) -> None:
    budget, finished = Budget(work=25.0), 0
    with limited_to(budget), pytest.raises(OutOfWork):
        for _ in executor.map(spend, [10.0] * 5):
            finished += 1
    assert (finished, budget.done) == (2, 30.0)


def limits_seen(task: int) -> float:
    effort = current_effort()
    return float("nan") if effort is None else effort.work - effort.done


@pytest.mark.parametrize("method", [m if m == "fork" else pytest.param(m, marks=pytest.mark.slow) for m in METHODS])
def test_a_limit_reaches_a_process_for_every_start_method(method: str) -> None:
    with limited_to(Budget(work=123.0)):
        assert list(ProcessExecutor(2, method).map(limits_seen, [0, 1])) == [123.0, 123.0]


def test_a_result_that_cannot_be_sent_is_an_error() -> None:
    with pytest.raises(RuntimeError, match="cannot be sent"):
        list(ProcessExecutor(2).map(__import__, ["os", "sys"]))


def test_one_job_runs_serially_and_two_need_processes() -> None:
    assert isinstance(executor_for(1), SerialExecutor)
    assert isinstance(executor_for(2), ProcessExecutor)


@pytest.mark.skipif(os.name != "posix", reason="kills by signal")
def test_the_tasks_of_a_process_that_is_killed_are_done_by_the_others(tmp_path: Path) -> None:
    reported = tmp_path / "told"
    assert list(ProcessExecutor(3).map(partial(die_once, reported), range(6))) == list(range(6))
    assert reported.exists()


def die_once(told: Path, task: int) -> int:
    try:
        told.touch(exist_ok=False)
    except FileExistsError:
        return task
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError


def test_processes_end_even_if_the_caller_catches_signals() -> None:
    before = signal.signal(signal.SIGTERM, lambda number, frame: None)
    try:
        assert list(ProcessExecutor(2).map(abs, range(3))) == [0, 1, 2]
    finally:
        signal.signal(signal.SIGTERM, before)


@pytest.mark.skipif(sys.platform != "linux", reason="forks")
def test_a_process_terminated_before_it_resets_signal_handlers_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reported, lived, begin = tmp_path / "told", tmp_path / "lived", executor_module._begin

    def begin_as_one_is_told_to_end() -> None:
        try:
            reported.touch(exist_ok=False)
        except FileExistsError:
            begin()
            return
        os.kill(os.getpid(), signal.SIGTERM)
        begin()
        lived.touch()

    monkeypatch.setattr(executor_module, "_begin", begin_as_one_is_told_to_end)
    before = signal.signal(signal.SIGTERM, lambda number, frame: None)
    try:
        assert list(ProcessExecutor(2).map(abs, range(3))) == [0, 1, 2]
    finally:
        signal.signal(signal.SIGTERM, before)
    assert reported.exists() and not lived.exists()


def test_a_search_stopped_during_large_results_ends() -> None:
    """Results larger than a pipe buffer are in transit when the parent stops."""

    def enough(done: int, total: int) -> None:
        raise KeyboardInterrupt

    for _ in range(5):
        with pytest.raises(KeyboardInterrupt):
            list(ProcessExecutor(4).map(bytes, [1_000_000] * 8, enough))


@pytest.fixture(scope="module")
def kept() -> Iterator[KeptProcess]:
    process = KeptProcess()
    yield process
    process.close()


def test_a_kept_process_runs_the_tasks_of_several_calls(kept: KeptProcess) -> None:
    first, second = (list(kept.map(partial(operator.pow, base), range(3))) for base in (2, 3))
    assert (first, second) == ([1, 2, 4], [1, 3, 9])
    if os.name == "posix":
        assert list(kept.map(os.getpgid, [0])) == [kept.pid]  # Ctrl-C at the terminal is not for it
    with pytest.raises(ZeroDivisionError):
        list(kept.map(partial(operator.floordiv, 1), [1, 0]))


def test_the_limits_of_a_call_hold_in_a_kept_process(kept: KeptProcess) -> None:
    budget, finished = Budget(work=25.0), 0
    with limited_to(budget), pytest.raises(OutOfWork):
        for _ in kept.map(spend, [10.0] * 5):
            finished += 1
    assert (finished, budget.done) == (2, 30.0)


SCRIPT = """
import sys
print("script", flush=True)
from gcs_autotune.executor import KeptProcess
process = KeptProcess()
assert list(process.map(abs, [-1])) == [1]
list(process.map(print, ["from the process"]))
process.close()
"""


def test_a_kept_process_neither_reruns_the_script_nor_uses_its_output(tmp_path: Path) -> None:
    """A script may open a link, and its output may be read by a program."""
    (tmp_path / "script.py").write_text(SCRIPT)
    done = subprocess.run([sys.executable, tmp_path / "script.py"], capture_output=True, text=True, check=True)
    assert done.stdout == "script\n"
    assert done.stderr == "from the process\n"


class PicklingExecutor:
    """Does one task after the other, as if each went to another machine and its result came back from there."""

    def __init__(self) -> None:
        self.done = 0

    def map(self, function, tasks, progress=None):  # type: ignore[no-untyped-def]
        for task in tasks:
            self.done += 1
            far_away, sent = pickle.loads(pickle.dumps((function, task)))
            yield pickle.loads(pickle.dumps(far_away(sent)))


@pytest.mark.slow
def test_a_diagnosis_does_not_depend_on_number_or_location_of_processes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    runs = [run_with_dead_zone(seed) for seed in (1, 2)]
    effects = ("dead-zone", "input-bias", "saturation", "quadratic-actuator")
    one, two = (diagnose(runs, effects=effects, jobs=jobs) for jobs in (1, 2))
    far = PicklingExecutor()
    monkeypatch.setattr("gcs_autotune.diagnose.api.executor_for", lambda jobs: far)
    three = diagnose(runs, effects=effects)
    assert [[c.effect for c in found.causes] for found in (two, three)] == [[c.effect for c in one.causes]] * 2
    assert [c.effect.slug for c in one.causes] == ["dead-zone"]
    assert repr(one.ranking) == repr(two.ranking) == repr(three.ranking)  # by text, in which NaN equals NaN
    assert far.done > 20
