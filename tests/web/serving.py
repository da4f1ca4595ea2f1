"""The server in a process of its own, for browsers: ``python -m tests.web.serving RUNS [scripted] [HOST]``."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gcs_autotune.web import CommandLine, ServeSettings, serve

ROOT = Path(__file__).parents[2]
SCRIPT = Path(__file__).with_name("scripted_run.py")
BRIEF = ROOT / "tests" / "brief_program.py"


@contextmanager
def served(runs: Path, *, scripted: bool, host: str = "127.0.0.1", ends_by_kill: bool = False) -> Iterator[str]:
    """Yield the link of a server that keeps its runs in *runs*; *scripted*: with a scripted run instead of a flight.

    A server that *ends_by_kill* cannot send its pages the end of a run.

    Flights use designs of few evaluations; ``tests/closed_loop/test_real_links.py`` flies our own command line.
    """
    words = [sys.executable, "-m", "tests.web.serving", str(runs), "scripted" if scripted else "real", host]
    with subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        try:
            yield server.stdout.readline().split()[1]
        finally:
            (server.kill if ends_by_kill else server.terminate)()
            server.wait(60.0)


def say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    program = CommandLine((sys.executable, str(SCRIPT if sys.argv[2] == "scripted" else BRIEF)))
    serve(ServeSettings(sys.argv[3], 0, Path(sys.argv[1])), say, program)
