"""The bell of a command at a real terminal: at a prompt, at the end, never with --quiet."""

from __future__ import annotations

import os
import pty
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from gcs_autotune.cli import main
from gcs_autotune.cli.console import BELL_VARIABLE

DRIFTING = "sitl:charlie?effect=steady-current.V_x=2.0"
ROOM = ("fly", "zig-zag", "--connect", DRIFTING, "--max-distance", "150", "--max-speed", "6")


def answered(terminal: int, answer: str) -> bytes:
    """Return all that a terminal shows until its other end is closed; answer its prompts."""
    shown = b""
    while True:
        try:
            more = os.read(terminal, 4096)
        except OSError:  # a terminal that is already closed
            return shown
        if not more:
            return shown
        shown += more
        if b"[y/N]" in more:
            os.write(terminal, f"{answer}\n".encode())


def at_a_terminal(monkeypatch: pytest.MonkeyPatch, *words: str, answer: str = "") -> tuple[int, str]:
    """Return the exit status of a command whose input and errors are a terminal, and what that showed."""
    ours, theirs = pty.openpty()
    with ThreadPoolExecutor(1) as reader, monkeypatch.context() as patch:
        reading = reader.submit(answered, ours, answer)
        with os.fdopen(theirs, closefd=False) as keyboard, os.fdopen(theirs, "w") as screen:
            patch.setattr(sys, "stdin", keyboard)
            patch.setattr(sys, "stderr", screen)
            status = main(words)
        shown = reading.result(60).decode(errors="replace")
    os.close(ours)
    return status, shown


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the runs of a command in a temporary folder, and let nothing silence the bell."""
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))  # of the simulator, also when not installed
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv(BELL_VARIABLE, raising=False)


@pytest.mark.slow
@pytest.mark.parametrize(("options", "bells"), [((), 2), (("--quiet",), 0)])
def test_a_prompt_and_a_refusal_ring_the_bell_except_with_quiet(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...], bells: int
) -> None:
    (tmp_path / "wanted.param").write_text("ATC_STR_RAT_P,0.3\n")
    restore = ("params", "restore", "wanted.param", "--connect", "sitl:charlie", *options)
    status, shown = at_a_terminal(monkeypatch, *restore, answer="n")
    assert status != 0
    assert "Write ATC_STR_RAT_P 0.2 -> 0.3? [y/N]" in shown
    assert shown.count("\a") == bells
    assert "the answer was no" in shown.split("\a")[-1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "environment", "bells"),
    [((), {}, 1), (("--quiet",), {}, 0), ((), {BELL_VARIABLE: "off"}, 0)],
    ids=["", "quiet", "variable"],
)
def test_a_flight_that_ends_at_a_limit_rings_the_bell(
    monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...], environment: dict[str, str], bells: int
) -> None:
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    status, shown = at_a_terminal(monkeypatch, *ROOM, *options)
    assert status != 0
    assert "'distance from start' tripped" in shown
    assert shown.count("\a") == bells
    assert ("step 1 of 2" in shown) is ("--quiet" not in options)


@pytest.mark.slow
def test_a_successful_flight_rings_once_at_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    status, shown = at_a_terminal(monkeypatch, "fly", "zig-zag", "--connect", "sitl:charlie")
    assert status == 0
    assert shown.endswith("\a")
    assert shown.count("\a") == 1
