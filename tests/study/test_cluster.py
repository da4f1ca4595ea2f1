"""A study on Dask: killed processes, unsuitable workers, a lost scheduler."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from gcs_autotune.errors import CannotOpenLink, LinkLost, UsageError
from gcs_autotune.executor import DaskExecutor, Executor
from gcs_autotune.study import Started, cluster_of, given_up, load_plan, open_study, run_study, unsuited
from tests.study.test_run import ROWS, TEN, rows
from tests.study.toys import ran, study_file, tried

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with cluster_of(2) as client:
            yield client


def on(client: Any, **options: Any) -> Any:
    def executor(started: Started) -> Executor:
        usual = {"lost": partial(given_up, started), "unsuited": partial(unsuited, started)}
        return DaskExecutor(client, in_order=False, **{**usual, **options})

    return executor


def test_two_workers_give_the_rows_of_one_process(client: Any, tmp_path: Path) -> None:
    path = study_file(tmp_path, "odd_fails", TEN)
    ran(path, tmp_path / "serial")
    ran(path, tmp_path / "dask", on(client))
    assert rows(tmp_path / "dask") == rows(tmp_path / "serial")


def _first_to_ask(started: Started) -> str:
    from distributed import get_worker

    own, asked = get_worker().address, started.home / "asked.txt"
    with suppress(FileExistsError), asked.open("x") as file:
        file.write(own)
    return "wrong version 1, but the study needs 2" if asked.read_text() == own else ""


def test_an_unsuitable_worker_is_reported_and_the_others_run_its_cases(client: Any, tmp_path: Path) -> None:
    reported: list[str] = []

    def executor(started: Started) -> Executor:
        return on(client, unsuited=partial(_first_to_ask, started), reports=reported.append)(started)

    client.wait_for_workers(2)  # before the tests that kill workers: Dask may not start one again that dies at once
    ran(study_file(tmp_path, "add", TEN), tmp_path / "out", executor)
    assert len(open_study(tmp_path / "out")) == 10
    assert len(reported) == 1
    assert "is not used: wrong version 1, but the study needs 2" in reported[0]


def test_a_case_that_kills_its_worker_is_abandoned_after_three_tries(client: Any, tmp_path: Path) -> None:
    ran(study_file(tmp_path, "kills_at_three", TEN), tmp_path / "out", on(client))
    table = open_study(tmp_path / "out")
    assert table["status"].tolist() == ["done"] * 3 + ["given up"] + ["done"] * 6
    assert table["reason"][3] == "its worker was killed 3 times"
    assert tried(tmp_path).count("3") == 3


def test_short_cases_are_run_in_groups_and_each_once(client: Any, tmp_path: Path) -> None:
    path = study_file(tmp_path, "counted", "vary.argument.x = { from = 1, to = 300, steps = 300 }")
    submitted: list[int] = []

    class Counting(DaskExecutor):
        def _submitted(self, order: Any, group: tuple[Any, ...], ended: Any) -> Any:
            submitted.append(len(group))
            return super()._submitted(order, group, ended)

    ran(path, tmp_path / "out", lambda started: Counting(client, in_order=False))
    assert len(tried(tmp_path)) == len(open_study(tmp_path / "out")) == 300
    assert len(submitted) < 100


def test_only_the_case_that_kills_its_worker_is_abandoned(client: Any, tmp_path: Path) -> None:
    path = study_file(tmp_path, "kills_at_three", f"vary.argument.x = {[*range(103, 2, -1)]}")
    ran(path, tmp_path / "out", on(client))
    table = open_study(tmp_path / "out")
    assert table["status"].tolist() == ["done"] * 100 + ["given up"]
    assert tried(tmp_path).count("3") == 3


def _square(x: int) -> int:
    return x * x


def test_results_are_in_the_order_of_the_tasks(client: Any) -> None:
    reported: list[tuple[int, int]] = []
    found = list(DaskExecutor(client).map(_square, range(20), lambda done, total: reported.append((done, total))))
    assert found == [x * x for x in range(20)]
    assert reported == [(k, 20) for k in range(1, 21)]


def _wrong(started: Started) -> str:
    return "version 1, but the study needs version 2"


def test_a_study_without_a_suitable_worker_ends_and_names_both_versions(client: Any, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="every worker is refused: version 1, but the study needs version 2"):
        ran(study_file(tmp_path, "add", TEN), tmp_path / "out", lambda s: on(client, unsuited=partial(_wrong, s))(s))


def test_a_scheduler_that_does_not_respond_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gcs_autotune.study.cluster._PATIENCE", 0.5)
    with pytest.raises(CannotOpenLink, match="no Dask scheduler answers at nowhere"), cluster_of(1, "nowhere:1"):
        pass


def test_a_lost_connection_to_a_scheduler_is_reported_without_log_lines_of_dask(client: Any, tmp_path: Path) -> None:
    log = logging.getLogger("distributed.client")
    log.setLevel(logging.WARNING)  # as Dask sets it when it is imported
    address = client.scheduler_info()["address"]
    with cluster_of(1, address) as other:
        assert not log.isEnabledFor(logging.ERROR)
        other.close()
        with pytest.raises(LinkLost, match=f"the scheduler {address} has gone away"):
            ran(study_file(tmp_path, "add", TEN), tmp_path / "out", on(other))


def test_workers_that_end_late_on_a_busy_machine_are_not_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    from distributed import LocalCluster

    close = LocalCluster.close

    def late(self: Any, *given: Any, **named: Any) -> None:
        close(self, *given, **named)
        raise TimeoutError

    with cluster_of(1) as client:
        answer = client.submit(int, "7").result()
        monkeypatch.setattr(LocalCluster, "close", late)
    assert answer == 7


def test_a_lost_scheduler_ends_the_study_without_loss_of_rows(tmp_path: Path) -> None:
    path = study_file(tmp_path, "add", TEN)
    with cluster_of(1) as client:

        class Leaving(DaskExecutor):
            def map(self, function: Any, tasks: Any, progress: Any = None) -> Iterator[Any]:
                for k, row in enumerate(super().map(function, tasks, progress)):
                    yield row
                    if k == 3:
                        client.cluster.close()

        with pytest.raises(LinkLost, match="Repeat the command"):
            run_study(load_plan(path), tmp_path / "out", lambda started: Leaving(client, in_order=False))
    stored = open_study(tmp_path / "out", arrow=True).select(ROWS).to_pylist()
    assert len(stored) >= 4
    ran(path, tmp_path / "out")
    assert len(open_study(tmp_path / "out")) == 10
