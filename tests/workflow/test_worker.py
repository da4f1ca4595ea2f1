"""What is computed while a vehicle waits is computed in a process of its own: no pause, no orphan, no lost error."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import time
from contextlib import nullcontext
from functools import partial
from importlib import import_module
from threading import Event
from types import SimpleNamespace
from typing import Any

import pytest

from gcs_autotune.clock import WallClock
from gcs_autotune.errors import AutotuneError, LinkLost, OperatorStopped, UnknownName
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.registry import lookup
from gcs_autotune.workflow import context
from gcs_autotune.workflow.background import beside, run_in_background
from gcs_autotune.workflow.worker import Worker

from .sitl_harness import QUICK, SitlHarness


class Company:
    """A craft on a link in real time, that counts how often it is looked at."""

    def __init__(self, look: Any = lambda: time.sleep(0.001)) -> None:
        self.clock, self.firmware, self.mode = WallClock(), FIRMWARE["ardurover"], "MANUAL"
        self.session = SimpleNamespace(pump=self.glance, operator=SimpleNamespace(shielded=nullcontext))
        self.look, self.looked, self.sent = look, 0, 0
        self.modes: list[str] = []

    def send(self, command: object) -> None:
        self.sent += 1

    def set_mode(self, mode: str) -> None:
        self.mode = mode
        self.modes.append(mode)

    def observe(self) -> None:
        self.looked += 1
        self.look()

    def glance(self, timeout: float) -> None:
        self.observe()


def never(error: AutotuneError) -> bool:
    """No trouble is over by itself."""
    return False


@pytest.fixture(scope="module")
def worker() -> Any:
    with Worker() as worker:
        yield worker


@pytest.mark.slow
def test_work_runs_in_another_process_while_the_craft_is_serviced(worker: Worker) -> None:
    craft: Any = Company()
    assert run_in_background(craft, worker, never, os.getpid) != os.getpid()
    assert craft.sent == 1 and craft.looked > 0


def test_an_error_crosses_with_its_type_message_and_attributes(worker: Worker) -> None:
    craft: Any = Company()
    with pytest.raises(UnknownName, match="'rover-headin'") as caught:
        run_in_background(craft, worker, never, lookup, {"rover-heading": 1}, "rover-headin", "control law")
    assert caught.value.nearest == ("rover-heading",)
    assert "in lookup" in caught.value.__notes__[0]
    with pytest.raises(ZeroDivisionError, match="by zero"):
        run_in_background(craft, worker, never, divmod, 1, 0)


def test_an_object_that_cannot_be_pickled_is_an_error_and_the_worker_continues(worker: Worker) -> None:
    craft: Any = Company()
    with pytest.raises((AttributeError, pickle.PicklingError)):
        run_in_background(craft, worker, never, lambda: 1)
    with pytest.raises(RuntimeError, match="a module, cannot be sent"):
        run_in_background(craft, worker, never, __import__, "os")
    assert run_in_background(craft, worker, never, divmod, 7, 2) == (3, 1)


@pytest.mark.slow
def test_a_process_that_dies_is_reported_and_replaced(worker: Worker) -> None:
    craft: Any = Company()
    with pytest.raises(AutotuneError, match=r"computing process ended unexpectedly \(code 3"):
        run_in_background(craft, worker, never, os._exit, 3)
    assert run_in_background(craft, worker, never, divmod, 7, 2) == (3, 1)


def test_a_temporary_silence_does_not_lose_the_work(worker: Worker) -> None:
    troubles = [LinkLost("silent for 3.0 s")]

    def look() -> None:
        time.sleep(0.001)  # as the next tick of a vehicle is waited for, while another process computes
        if troubles:
            raise troubles.pop()

    craft: Any = Company(look)
    assert run_in_background(craft, worker, lambda error: isinstance(error, LinkLost), divmod, 7, 2) == (3, 1)
    assert troubles == [] and craft.sent == 2  # company is kept anew
    troubles.append(LinkLost("silent again"))
    with pytest.raises(LinkLost, match="again"):
        run_in_background(craft, worker, never, time.sleep, 0.01)


def test_an_rov_is_put_into_depth_hold_once_and_again_after_a_silence(worker: Worker) -> None:
    troubles: list[LinkLost] = []

    def look() -> None:
        time.sleep(0.001)
        if troubles:
            raise troubles.pop()

    craft: Any = Company(look)
    craft.firmware = FIRMWARE["ardusub"]
    for _ in range(3):
        run_in_background(craft, worker, never, divmod, 7, 2)
    assert craft.modes == ["ALT_HOLD"] and craft.sent == 3
    troubles.append(LinkLost("silent for 3.0 s"))
    run_in_background(craft, worker, lambda error: True, divmod, 7, 2)
    assert craft.modes == ["ALT_HOLD"] * 2


def test_a_stop_during_a_computation_leaves_no_process_behind() -> None:
    def stop() -> None:
        raise OperatorStopped("Ctrl-C")

    craft: Any = Company(stop)
    with Worker() as worker:
        process: Any = worker._process
        with pytest.raises(OperatorStopped):
            run_in_background(craft, worker, never, time.sleep, 1000.0)
    assert not process.is_alive


PARENT = """
import sys, time
from functools import partial
from gcs_autotune.workflow.worker import Worker
worker = Worker()
worker.begin(partial(time.sleep, 1000.0))
print(worker._process.pid, flush=True)
time.sleep(1000.0)
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="kills by signal")
def test_a_killed_program_takes_its_worker_process_along() -> None:
    """Standard error is open in both: it ends when the last of them does."""
    parent = subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert parent.stdout is not None and parent.stderr is not None
    with parent.stdout, parent.stderr:
        assert int(parent.stdout.readline()) != parent.pid
        parent.kill()
        assert parent.stderr.read() == ""
        parent.wait(10.0)


def test_files_are_written_while_the_link_is_served() -> None:
    served = Event()
    craft: Any = Company(served.set)
    assert beside(craft, partial(served.wait, 30.0)) is True


def test_files_are_completed_although_the_link_is_lost() -> None:
    begun = Event()

    def lost() -> None:
        begun.set()
        raise LinkLost("silent")

    craft: Any = Company(lost)
    assert beside(craft, partial(begun.wait, 30.0)) is True
    with pytest.raises(ZeroDivisionError):
        beside(craft, partial(divmod, 1, 0))


@pytest.mark.slow
def test_every_computation_of_a_tune_runs_in_another_process_and_can_be_pickled(
    tmp_path: Any, monkeypatch: Any
) -> None:
    crossed: list[str] = []
    across: list[bool] = []
    held_up: list[str] = []

    def there_and_back(craft: Any, worker: Worker, bear: Any, work: Any, *args: Any, **named: Any) -> Any:
        crossed.append(work.__name__)
        across.append(True)
        try:
            return pickle.loads(pickle.dumps(pickle.loads(pickle.dumps(partial(work, *args, **named)))()))
        finally:
            across.pop()

    def read(*args: Any) -> Any:
        if not across:
            held_up.append("a step is read by the loop that holds the sticks: loading its kernel takes 0.3 s")
        return measured(*args)

    step_metrics = import_module("gcs_autotune.design.step_metrics")
    measured = step_metrics._measured
    monkeypatch.setattr(context, "run_in_background", there_and_back)
    monkeypatch.setattr(step_metrics, "_measured", read)
    story = SitlHarness(tmp_path, QUICK).tune(stop_rule="settled")  # the other rule asks its worker by itself
    assert story.ending == "kept"
    assert {"fit_axis", "design", "read"} <= set(crossed)
    assert held_up == []
