"""A program as the operator: what it receives, what it may send, and that a run never waits for it."""

from __future__ import annotations

import gc
import io
import json
import os
import threading
from argparse import Namespace
from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

import pytest

from gcs_autotune.cli.remote import MOST_TICKS, RemoteObserver, RemoteOperator, attending
from gcs_autotune.errors import OperatorStopped
from gcs_autotune.observer import LeftAs, ListedStep, Progress, ProposedGains, Room, StepList, Vitals, Words


def lines(stream: io.BytesIO) -> list[tuple[str, Any]]:
    return [next(iter(json.loads(line).items())) for line in stream.getvalue().splitlines()]


def tick(k: int, signal: str = "psi") -> Progress:
    return Progress("stage", "relay", float(k), signal, value=0.1 * k)


class Stuck(io.BytesIO):
    """A listener who does not read until he is let."""

    def __init__(self) -> None:
        super().__init__()
        self.let = threading.Event()
        self.reached = threading.Event()

    def write(self, data: Any, /) -> int:
        self.reached.set()
        assert self.let.wait(60.0)
        return super().write(data)


def test_progress_messages_and_facts_are_lines_of_json() -> None:
    stream = io.BytesIO()
    with RemoteObserver(stream) as observer:
        for k in range(3):
            observer.update(tick(k))
        observer.update(tick(3, "z"))
        observer.say("hello")
        for fact in (
            Vitals("HOLD", False),
            Words(4, "text"),
            Room(0.0, 0.0, 300.0),
            ProposedGains(()),
            StepList((ListedStep("heading", "flying"),)),
            LeftAs("HOLD", False, {}),
        ):
            observer.note(fact)
    reported = lines(stream)
    assert {key for key, _ in reported} == {
        "samples",
        "now",
        "say",
        "vitals",
        "words",
        "room",
        "proposal",
        "steps",
        "left",
    }
    samples = [value for key, value in reported if key == "samples"]
    assert [len(each["rows"]) for each in samples] == [3, 1]
    assert dict(reported)["vitals"]["battery_voltage"] is None  # JSON knows no NaN
    assert dict(reported)["now"]["t"] == 3.0
    assert dict(reported)["steps"] == {"steps": [{"name": "heading", "state": "flying", "reason": "", "seconds": None}]}


def test_a_flight_does_not_wait_for_a_listener_that_does_not_read() -> None:
    stream = Stuck()
    with RemoteObserver(stream) as observer:
        observer.say("first")
        assert stream.reached.wait(60.0)
        for k in range(5 * MOST_TICKS):
            observer.update(tick(k))
        stream.let.set()
    reported = lines(stream)
    rows = [row for key, value in reported if key == "samples" for row in value["rows"]]
    assert len(rows) == MOST_TICKS
    assert rows[-1][0] == 5 * MOST_TICKS - 1  # the newest are kept
    assert dict(reported)["dropped"] == {"count": 4 * MOST_TICKS}


def operated(source: int) -> tuple[RemoteOperator, io.BytesIO, RemoteObserver]:
    stream = io.BytesIO()
    observer = RemoteObserver(stream)
    return RemoteOperator(observer, source), stream, observer


def until(condition: Callable[[], bool]) -> None:
    patience = threading.Event()
    for _ in range(1000):
        if condition():
            return
        patience.wait(0.01)
    raise AssertionError("it did not come about")


def test_a_stop_is_received_after_malformed_input() -> None:
    reading, writing = os.pipe()
    operator, _, _ = operated(reading)
    assert not operator.stop_requested()
    os.write(writing, b'no json\n[]\n{"answer": 3}\n{"st')
    os.write(writing, b'op": true}\n')
    until(operator.stop_requested)
    os.close(writing)


def test_the_end_of_standard_input_is_a_stop() -> None:
    reading, writing = os.pipe()
    operator, _, _ = operated(reading)
    os.close(writing)
    until(operator.stop_requested)
    assert operator.stop_requested()


def test_an_answer_belongs_to_its_question_and_the_first_one_counts() -> None:
    reading, writing = os.pipe()
    operator, stream, observer = operated(reading)
    os.write(writing, b'{"answer": {"id": 1, "yes": true}}\n{"answer": {"id": 1, "yes": false}}\n')
    os.write(writing, b'{"answer": {"id": 2, "yes": "true"}}\n')
    with observer:
        assert operator.ask("Go ahead?", lambda: None)
        assert not operator.ask("Write it?", lambda: None)  # only true is yes
    questions = [value for key, value in lines(stream) if key == "question"]
    assert questions == [{"id": 1, "text": "Go ahead?"}, {"id": 2, "text": "Write it?"}]
    os.close(writing)


@pytest.mark.parametrize("ends", [None, OperatorStopped()])
def test_garbage_collection_skips_loaded_objects_while_a_vehicle_is_attended(
    ends: OperatorStopped | None,
) -> None:
    args = Namespace(remote=False, yes=True, quiet=True, verbose=False)
    assert gc.get_freeze_count() == 0
    with nullcontext() if ends is None else pytest.raises(OperatorStopped), attending(args):
        assert gc.get_freeze_count() > 10_000
        if ends is not None:
            raise ends
    assert gc.get_freeze_count() == 0
