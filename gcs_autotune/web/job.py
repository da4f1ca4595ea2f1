"""One command in a separate process, controlled by its ``--remote`` lines.

The process has its own session, so Ctrl-C at this terminal does not reach it; a line on its standard input stops it. If
its standard input ends, for example because this server ends, the run stops, restores everything and exits.
"""

from __future__ import annotations

import asyncio
import json
import os
import re
import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from msgspec import Struct

from gcs_autotune.errors import EXIT_CODES, AutotuneError
from gcs_autotune.web.live import Live
from gcs_autotune_files import Refused, conform, read

__all__ = ["JOB", "CommandLine", "Job", "how_it_ended", "how_the_undo_ended", "is_settled", "page_of", "read_json"]

_LONGEST_LINE = 1 << 22
_STDERR = 8000
"""Number of characters of the process's standard error that are kept. Project choice."""
_RESTORED, _STOPPED = 8, 130
_MEANINGS: Mapping[int, str] = {
    0: "done",
    _RESTORED: "tuned, but the new gains were not better in every respect, and the old ones were restored",
    **{code: meaning for _, code, meaning in EXIT_CODES},
}

_NEVER_ARMED = "The run ended before arming. Nothing was moved or written."
_UNDONE: Mapping[int, str] = {_STOPPED: "stopped or declined, so not everything was restored"}
_RESULT = re.compile(r"^\S+: \S+ -> |verified by reading back")
"""Sentences of a restore that state what was written."""
JOB = "job.json"
"""File of a guided run with its steps."""
_ENDINGS: Mapping[str, str] = {
    "restored": "the new gains were not better in every respect, and the old ones are restored",
    "open": "not flown",
    "skipped": "not flown",
    "rejected": "not flown",
}
"""Ending of a step of a job -> what it means for its gains, where the ending itself does not state it."""


@dataclass(frozen=True, slots=True)
class CommandLine:
    """How our command line is started; ``words`` come before the arguments."""

    words: tuple[str, ...] = (sys.executable, "-P", "-m", "gcs_autotune")

    @property
    def environment(self) -> dict[str, str]:
        """Environment variables with which the process finds the same packages."""
        here = os.pathsep.join(str(Path(entry).absolute()) for entry in sys.path)
        return {**os.environ, "PYTHONPATH": here}


class Job:
    """One run of our command line with *arguments*, which writes its files to *directory*."""

    def __init__(
        self, program: CommandLine, arguments: Sequence[str], directory: Path, live: Live, *, is_undo: bool = False
    ) -> None:
        self._program = program
        self._arguments = list(arguments)
        self._directory = directory
        self._live = live
        self._is_undo = is_undo
        self._process: asyncio.subprocess.Process | None = None
        self._answered: set[int] = set()
        self._errors = ""
        self._stopping = False

    async def run(self) -> None:
        """Start the process, read its lines, and report its end."""
        self._process = await asyncio.create_subprocess_exec(
            *self._program.words,
            *self._arguments,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            env=self._program.environment,
            start_new_session=True,
            limit=_LONGEST_LINE,
        )
        if self._stopping:
            self._send({"stop": True})
        await asyncio.gather(self._listen(self._process), self._overhear(self._process))
        code = await self._process.wait()
        left = self._live.get("left")
        if self._is_undo:
            end = how_the_undo_ended(code, self._errors, self._live.said)
        else:
            end = await asyncio.to_thread(how_it_ended, code, self._errors, self._directory, left)
        self._live.put("question", None)
        self._live.put("end", end)

    async def _listen(self, process: asyncio.subprocess.Process) -> None:
        assert process.stdout is not None
        while True:
            try:
                line = await process.stdout.readline()
            except ValueError:  # longer than any line of ours: what it holds is lost, the run goes on
                continue
            if not line:
                return
            self._live.take(line)

    async def _overhear(self, process: asyncio.subprocess.Process) -> None:
        assert process.stderr is not None
        while piece := await process.stderr.read(4096):
            self._errors = (self._errors + piece.decode(errors="replace"))[-_STDERR:]

    def stop(self) -> None:
        """Request a stop of the run with clean-up, without waiting for it. Repeated calls have no effect."""
        self._stopping = True
        self._live.put("stopping", True)
        self._send({"stop": True})

    def answer(self, number: int, *, yes: bool) -> bool:
        """Answer question *number*. Return whether this was the first answer, which counts."""
        question = self._live.get("question")
        if question is None or question["id"] != number or number in self._answered:
            return False
        self._answered.add(number)
        self._live.say(f"answered {'yes' if yes else 'no'}: {question['text']}")
        self._live.put("question", None)
        self._send({"answer": {"id": number, "yes": yes}})
        return True

    def _send(self, line: dict[str, Any]) -> None:
        process = self._process
        if process is not None and process.stdin is not None and not process.stdin.is_closing():
            process.stdin.write(json.dumps(line).encode() + b"\n")


def how_it_ended(code: int, errors: str, directory: Path, left: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return the page's summary of a finished run, from its exit code, last message and files.

    Keys: ``code``; ``meaning``; ``reason`` as text; ``flown`` comparison of the steps before and after, as text;
    ``report`` its page, if any; ``fine`` whether no action is needed; ``put_back`` sentences.
    """
    summary = read_json(directory / "summary.json")
    reason = _last_error(errors) or str(summary.get("reason", "")) or (errors.strip().splitlines() or [""])[-1]
    flown = left is not None or any(_journals(directory))
    fine, craft = _as_to_craft(left, directory) if flown else (True, _NEVER_ARMED)
    return {
        "code": code,
        "meaning": _meaning(code, is_job=(directory / JOB).is_file(), flown=flown),
        "reason": reason,
        "flown": [str(line) for line in _listed(summary.get("verdict_reasons"))],
        "fine": fine,
        "report": page_of(directory),
        "put_back": [craft, *(_as_to_parameters(directory) if flown else ())],
    }


def how_the_undo_ended(code: int, errors: str, said: Sequence[str]) -> dict[str, Any]:
    """Return the page's summary of a finished undo, as :func:`how_it_ended`; *said* are its sentences.

    ``undone``: whether nothing is left to undo.
    """
    return {
        "code": code,
        "meaning": "the old parameters are restored" if code == 0 else _UNDONE.get(code, "not everything was restored"),
        "reason": _last_error(errors),
        "flown": [],
        "fine": code == 0,
        "report": "",
        "undone": code == 0,
        "put_back": [text for text in said if _RESULT.search(text) and not text.startswith("answered ")],
    }


def _last_error(errors: str) -> str:
    marked = [line for line in errors.splitlines() if line.startswith("gcs-autotune: ")]
    return marked[-1].removeprefix("gcs-autotune: ") if marked else ""


def _meaning(code: int, *, is_job: bool, flown: bool) -> str:
    if is_job and code == _RESTORED:
        return "done, and some loops have their old gains"
    if code == _STOPPED and not flown:
        return "stopped by the operator before arming"
    return _MEANINGS.get(code, f"the run ended with code {code}")


def _listed(thing: Any) -> list[Any]:
    return thing if isinstance(thing, list) else []


def _as_to_craft(left: Mapping[str, Any] | None, directory: Path) -> tuple[bool, str]:
    if left is None and is_settled(directory):
        return True, "The vehicle is restored, as the journal of the run records."
    run = shlex.quote(str(directory))
    if left is None:
        return False, (
            "The state of the craft is unknown. Take over by hand, then run "
            f"`gcs-autotune restore {run}` in a terminal."
        )
    state = f"mode {left['mode']}, {'armed' if left['armed'] else 'disarmed'}"
    if left["differs"]:
        what = "; ".join(f"{name}: {why}" for name, why in left["differs"].items())
        return False, (
            f"NOT RESTORED ({what}). Take over by hand, then run `gcs-autotune restore {run}` in a terminal."
        )
    return True, f"Actuators neutral, confirmed at the outputs; {state}, as before the run."


def _journals(directory: Path) -> Iterator[Path]:
    """Yield the journals of a run and of the steps of a job: each is opened before the vehicle is armed."""
    return (path for where in ("", "*/") for path in directory.glob(f"{where}journal.jsonl"))


def is_settled(directory: Path) -> bool:
    """Return whether the run in *directory*, with all steps of a job, has restored its vehicle or never armed it."""
    from gcs_autotune.link import Journal  # slow to import, and only needed here

    try:
        return all(Journal.read(path).is_settled for path in _journals(directory))
    except (AutotuneError, OSError, ValueError, KeyError, TypeError):
        return False


def _as_to_parameters(directory: Path) -> list[str]:
    steps = read_json(directory / JOB).get("steps")
    if isinstance(steps, list):
        return [_as_to_step(conform(step, _Step)) for step in steps]
    before, after = (_numbers_in(directory / f"parameters_{when}.json") for when in ("before", "after"))
    if not before:
        return []
    if not after:
        return ["The run did not record the parameters at its end."]
    changed = [f"{name} {before[name]:g} -> {after[name]:g}" for name in before if after.get(name) != before[name]]
    if changed:
        return [
            f"Parameters read back: {', '.join(changed)}; the other {len(before) - len(changed)} are as before the run."
        ]
    return [f"Parameters read back: all {len(before)} as before the run."]


class _Step(Struct, frozen=True):
    """Content of a step of a job that the page needs."""

    name: str
    ending: str
    reason: str = ""
    gains: dict[str, tuple[float, float]] | None = None


def _as_to_step(step: _Step) -> str:
    """Return a sentence on the parameters of one step of a job."""
    if step.ending != "kept":
        return f"{step.name}: {_ENDINGS.get(step.ending, step.ending)}{f' ({step.reason})' if step.reason else ''}."
    gains = (f"{name} {old:g} -> {new:g}" for name, (old, new) in (step.gains or {}).items())
    return f"{step.name}: the new gains are better and stay: {', '.join(gains)}."


def _numbers_in(path: Path) -> dict[str, float]:
    return {name: value for name, value in read_json(path).items() if isinstance(value, (int, float))}


def page_of(directory: Path) -> str:
    """Return the page that a run wrote: its report, else its preview; empty if there is none."""
    return next((name for name in ("report.html", "preview.html") if (directory / name).is_file()), "")


def read_json(path: Path) -> dict[str, Any]:
    """Return the object in a JSON file; empty if the file is missing or unreadable."""
    try:
        data = read(path)
    except Refused:
        return {}
    return data if isinstance(data, dict) else {}
