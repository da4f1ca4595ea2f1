"""The bell of a real command at a real terminal: at a prompt, at the end, never with --quiet."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

from gcs_autotune.cli.console import BELL_VARIABLE

DRIFTING = "sitl:charlie?effect=steady-current.V_x=2.0"
ROOM = ("fly", "zig-zag", "--connect", DRIFTING, "--max-distance", "150", "--max-speed", "6")


def at_a_terminal(folder: Path, *words: str, answer: str = "", **environment: str) -> tuple[int, str]:
    """Return the exit status of a command whose input and errors are a terminal, and what that showed."""
    ours, theirs = pty.openpty()
    environ = (
        {k: v for k, v in os.environ.items() if k != BELL_VARIABLE} | environment | {"PYTHONPATH": str(Path.cwd())}
    )
    command = [sys.executable, "-m", "gcs_autotune", *words]
    with subprocess.Popen(
        command, stdin=theirs, stderr=theirs, stdout=subprocess.DEVNULL, cwd=folder, env=environ
    ) as process:
        os.close(theirs)
        shown = b""
        while True:
            try:
                more = os.read(ours, 4096)
            except OSError:  # a terminal that is already closed
                break
            shown += more
            if b"[y/N]" in more:
                os.write(ours, f"{answer}\n".encode())
        os.close(ours)
    return process.returncode, shown.decode(errors="replace")


@pytest.mark.slow
@pytest.mark.parametrize(("options", "bells"), [((), 2), (("--quiet",), 0)])
def test_a_prompt_and_a_refusal_ring_the_bell_except_with_quiet(
    tmp_path: Path, options: tuple[str, ...], bells: int
) -> None:
    (tmp_path / "wanted.param").write_text("ATC_STR_RAT_P,0.3\n")
    restore = ("params", "restore", "wanted.param", "--connect", "sitl:charlie", *options)
    status, shown = at_a_terminal(tmp_path, *restore, answer="n")
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
    tmp_path: Path, options: tuple[str, ...], environment: dict[str, str], bells: int
) -> None:
    status, shown = at_a_terminal(tmp_path, *ROOM, *options, **environment)
    assert status != 0
    assert "'distance from start' tripped" in shown
    assert shown.count("\a") == bells
    assert ("step 1 of 2" in shown) is ("--quiet" not in options)


@pytest.mark.slow
def test_a_successful_flight_rings_once_at_its_end(tmp_path: Path) -> None:
    status, shown = at_a_terminal(tmp_path, "fly", "zig-zag", "--connect", "sitl:charlie")
    assert status == 0
    assert shown.endswith("\a")
    assert shown.count("\a") == 1
