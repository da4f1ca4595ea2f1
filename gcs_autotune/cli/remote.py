"""Interface for a program in place of the operator: JSON lines on standard output and input (docs/serve.md).

Each line is an object with one key. Out: ``samples``, ``now``, ``say``, ``words``, ``intentions``, ``vitals``,
``room``, ``cost``, ``proposal``, ``track``, ``steps``, ``left``, ``question``, ``dropped``; in SI and radians, null
if unknown. In: ``stop`` and ``answer``. Without standard input the craft could not be stopped, so the end of standard
input counts as a STOP.

The flight loop never waits for the listener. Ticks and sentences go into ring buffers that drop the oldest; a
separate thread writes them out.
"""

from __future__ import annotations

import gc
import json
import math
import os
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from itertools import groupby
from typing import TYPE_CHECKING, Any, BinaryIO, Self

from gcs_autotune.cli.command import watching
from gcs_autotune.cli.console import ConsoleOperator
from gcs_autotune.observer import (
    Fact,
    Intentions,
    LeftAs,
    Observer,
    PredictedCost,
    PredictedTrack,
    Progress,
    ProposedGains,
    Room,
    StepList,
    Vitals,
    Words,
)
from gcs_autotune_files import parse

if TYPE_CHECKING:
    import argparse

__all__ = ["COLUMNS", "RemoteObserver", "RemoteOperator", "attending"]

COLUMNS = ("t", "value", "target", "output", "rate", "x", "y", "psi")
"""Fields of a row of ``samples``."""
EVERY = 0.1
"""Time between two writes [s, wall clock]; the eye follows about ten updates a second. Project choice."""
MOST_TICKS, MOST_FACTS = 1000, 500
"""Largest number of control ticks and of other entries kept for a slow listener. Older entries are dropped and counted.
Project choice.
"""
_GRACE = 2.0
"""Longest wait for a slow listener at the end [s]. Project choice."""
_KEYS: Mapping[type, str] = {
    Intentions: "intentions",
    Vitals: "vitals",
    Room: "room",
    Words: "words",
    ProposedGains: "proposal",
    PredictedCost: "cost",
    PredictedTrack: "track",
    StepList: "steps",
    LeftAs: "left",
}


class RemoteObserver:
    """Writes reports to *stream* as JSON lines, ten times a second, from a separate thread."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self._ticks: deque[Progress] = deque(maxlen=MOST_TICKS)
        self._facts: deque[tuple[str, Any]] = deque(maxlen=MOST_FACTS)
        self._queued = self._sent = 0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="remote", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._ended.set()
        self._thread.join(_GRACE)

    def update(self, progress: Progress) -> None:
        """Queue the progress at a control tick for the next line."""
        self._ticks.append(progress)
        self._queued += 1

    def say(self, text: str) -> None:
        """Queue a sentence for the next line."""
        self.put("say", text)

    def note(self, fact: Fact) -> None:
        """Queue a note for the next line."""
        self.put(_KEYS[type(fact)], fact)

    def put(self, key: str, value: object) -> None:
        """Queue any entry for the next line."""
        self._facts.append((key, value))
        self._queued += 1

    def _run(self) -> None:
        last = False
        while not last:
            last = self._ended.wait(EVERY)
            try:
                self._stream.write(b"".join(_line(key, value) for key, value in self._taken()))
                self._stream.flush()
            except (OSError, ValueError):  # the reader is gone; the operator learns it from the end of standard input
                return

    def _taken(self) -> Iterator[tuple[str, object]]:
        ticks = [self._ticks.popleft() for _ in range(len(self._ticks))]
        facts = [self._facts.popleft() for _ in range(len(self._facts))]
        for key, value in facts:
            yield key, value if isinstance(value, (str, dict)) else asdict(value)
        for (stage, manoeuvre, signal), some in groupby(ticks, lambda p: (p.stage, p.manoeuvre, p.signal)):
            rows = [[getattr(p, name) for name in COLUMNS] for p in some]
            yield "samples", {"stage": stage, "manoeuvre": manoeuvre, "signal": signal, "rows": rows}
        if ticks:
            yield "now", asdict(ticks[-1])
        self._sent += len(ticks) + len(facts)
        if self._queued > self._sent + len(self._ticks) + len(self._facts):
            yield "dropped", {"count": self._queued - self._sent - len(self._ticks) - len(self._facts)}


def _line(key: str, value: object) -> bytes:
    return json.dumps({key: _plain(value)}, separators=(",", ":"), allow_nan=False).encode() + b"\n"


def _plain(thing: Any) -> Any:
    """Return *thing* in JSON types, with numbers rounded to six digits."""
    if isinstance(thing, float):
        return float(f"{thing:.6g}") if math.isfinite(thing) else None
    if isinstance(thing, Mapping):
        return {str(key): _plain(value) for key, value in thing.items()}
    if isinstance(thing, Sequence) and not isinstance(thing, str):
        return [_plain(each) for each in thing]
    return thing


class RemoteOperator(ConsoleOperator):
    """Asks through *observer*. A thread reads answers and STOP as lines from the file descriptor *source*.

    A signal also counts as a stop request. *yes* is the answer to every question.
    """

    def __init__(self, observer: RemoteObserver, source: int, *, yes: bool = False) -> None:
        super().__init__(yes=yes, bell=False)
        self._observer = observer
        self._source = source
        self._asked = 0
        self._answers: dict[int, bool] = {}
        threading.Thread(target=self._listen, name="stop", daemon=True).start()

    def ask(self, question: str, while_waiting: Callable[[], object]) -> bool:
        """Ask a yes/no question, wait for the answer, and return it. A STOP that comes first is a no, unless
        *while_waiting* raises an error for it.
        """
        if self._yes:
            return True
        self._asked += 1
        asked = self._asked
        self._observer.put("question", {"id": asked, "text": question})
        while asked not in self._answers:
            stopped = self._stop
            while_waiting()  # in a flight this raises an error, if the STOP came before it
            if stopped:  # nothing is flown, so nothing else heeds it
                return False
        return self._answers[asked]

    def _listen(self) -> None:
        rest = b""
        while piece := _read(self._source):
            *lines, rest = (rest + piece).split(b"\n")
            for line in lines:
                self._take(line)
        self._stop = True  # the parent process is gone and cannot order it

    def _take(self, line: bytes) -> None:
        try:
            order = parse(line)
            if order.get("stop"):
                self._stop = True
            if "answer" in order:
                self._answers.setdefault(int(order["answer"]["id"]), order["answer"]["yes"] is True)
        except (ValueError, KeyError, TypeError, AttributeError):
            self._observer.say("Ignored a line on standard input that is not a stop or an answer (docs/serve.md).")


def _read(source: int) -> bytes:
    try:
        return os.read(source, 65536)
    except OSError:
        return b""


@contextmanager
def attending(args: argparse.Namespace, otherwise: str = "") -> Iterator[tuple[ConsoleOperator, Observer]]:
    """Yield operator and observer: those of the terminal, or with ``--remote`` those of a program.

    Objects loaded so far are frozen for the garbage collector. Scanning them all takes about 60 ms, too long for
    the loop that holds the sticks.
    """
    gc.freeze()
    try:
        yield from _attending(args, otherwise)
    finally:
        gc.unfreeze()


def _attending(args: argparse.Namespace, otherwise: str) -> Iterator[tuple[ConsoleOperator, Observer]]:
    import sys

    if args.remote:
        with RemoteObserver(sys.stdout.buffer) as remote:
            operator: ConsoleOperator = RemoteOperator(remote, sys.stdin.fileno(), yes=args.yes)
            with operator.listening():
                yield operator, remote
        return
    operator = ConsoleOperator(yes=args.yes, otherwise=otherwise, bell=not args.quiet)
    with operator.listening(), watching(args) as observer:
        yield operator, observer
