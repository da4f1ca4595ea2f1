"""The module for MAVProxy: in MAVProxy itself, over its link, with the simulated ROV as a process of its own."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import queue
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from gcs_autotune import mavproxy
from gcs_autotune.errors import LinkLost

HAS_MAVPROXY = importlib.util.find_spec("MAVProxy") is not None
needs_mavproxy = pytest.mark.skipif(not HAS_MAVPROXY, reason="MAVProxy is not installed (pip install '.[mavproxy]')")
ROOT = Path(__file__).parents[2]


class Prompt:
    """MAVProxy in a process, its standard input and its output."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self.lines: list[str] = []
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line)

    def type(self, line: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(f"{line}\n")
        self._process.stdin.flush()

    def wait_for(self, words: str, seconds: float = 100.0) -> str:
        end = time.monotonic() + seconds
        while not self.lines or words not in self.lines[-1]:
            try:
                self.lines.append(self._lines.get(timeout=max(end - time.monotonic(), 0.0)))
            except queue.Empty:
                pytest.fail(f"'{words}' was not printed within {seconds} s: {''.join(self.lines)}")
            if "ERROR in command" in self.lines[-1]:
                pytest.fail("".join(self.lines))
        return self.lines.pop()


@contextlib.contextmanager
def mavproxy_on_a_simulated_rov(folder: Path) -> Iterator[Prompt]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    vehicle = [sys.executable, "-m", "gcs_autotune", "sitl", "falcon", "--listen", f"tcp:127.0.0.1:{port}"]
    vehicle += ["--speedup", "5", "--param", "FS_PILOT_TIMEOUT=30", "--param", "SCHED_LOOP_RATE=100"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "HOME": str(folder), "PYTHONUNBUFFERED": "1"}
    station = [sys.executable, "-m", "MAVProxy.mavproxy", f"--master=tcp:127.0.0.1:{port}", "--no-state"]
    station += ["--default-modules=param,arm,mode"]
    pipe = subprocess.PIPE
    with subprocess.Popen(vehicle, stderr=pipe, text=True, cwd=folder, env=environment) as boat:
        assert boat.stderr is not None
        boat.stderr.readline()
        with subprocess.Popen(
            station, stdin=pipe, stdout=pipe, stderr=subprocess.STDOUT, text=True, cwd=folder, env=environment
        ) as process:
            try:
                prompt = Prompt(process)
                prompt.type("module load gcs_autotune.mavproxy")
                prompt.wait_for("Loaded module gcs_autotune.mavproxy")
                yield prompt
            finally:
                assert process.stdin is not None
                with contextlib.suppress(BrokenPipeError):
                    process.stdin.close()  # the end of input ends MAVProxy
                try:
                    process.wait(70.0)
                finally:
                    process.kill()
                    boat.terminate()


@needs_mavproxy
@pytest.mark.slow
def test_autotune_heading_in_mavproxy_asks_flies_writes_and_proves(tmp_path):
    """Gains from a file: both steps, both questions and the writing, without the oscillations before."""
    (tmp_path / "gains.param").write_text("ATC_RAT_YAW_P,0.25\n")
    with mavproxy_on_a_simulated_rov(tmp_path) as prompt:
        prompt.type("autotune heading --gains gains.param --step-duration 8 --out run")
        prompt.wait_for("Answer with: autotune yes")
        prompt.type("autotune heading")
        assert "tune heading is running; open question:" in prompt.wait_for("Use autotune stop to end it")
        prompt.type("autotune yes")
        prompt.wait_for("Answer with: autotune yes")
        prompt.type("autotune yes")
        assert "done" in prompt.wait_for("autotune: tune heading: ")
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["ending"] in ("kept", "restored"), "".join(prompt.lines)
    flown = {path.stem[3:] for path in (tmp_path / "run" / "trials").glob("*.csv")}
    assert {"step-before", "step-after"} <= flown
    assert json.loads((tmp_path / "run" / "journal.jsonl").read_text().splitlines()[0])["link"].startswith("tcp:127")
    held = dict(line.split(",") for line in (tmp_path / "run" / "parameters_after.param").read_text().splitlines())
    assert (float(held["ATC_RAT_YAW_P"]) == pytest.approx(0.25)) is (summary["ending"] == "kept")


@needs_mavproxy
@pytest.mark.slow
def test_autotune_stop_restores_the_vehicle(tmp_path):
    with mavproxy_on_a_simulated_rov(tmp_path) as prompt:
        prompt.type("autotune stop")
        prompt.wait_for("nothing is running")
        prompt.type("autotune heading --yes --step-duration 8 --out run")
        prompt.wait_for(": completed")
        prompt.type("autotune stop")
        prompt.wait_for("Stopping: setting the actuators to neutral")
        prompt.wait_for("autotune: tune heading: ")
        prompt.type("autotune restore run")
        prompt.wait_for("Nothing to restore")
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["ending"] == "aborted"


@needs_mavproxy
@pytest.mark.slow
def test_closing_mavproxy_during_a_run_cleans_up_first(tmp_path):
    with mavproxy_on_a_simulated_rov(tmp_path) as prompt:
        prompt.type("autotune heading --yes --step-duration 8 --out run")
        prompt.wait_for(": completed")
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["ending"] == "aborted"
    last = (tmp_path / "run" / "journal.jsonl").read_text().splitlines()[-1]
    assert json.loads(last)["event"] == "closed"


def test_the_link_returns_bytes_in_order_without_extra_waiting():
    sent: list[bytes] = []
    link = mavproxy.MavproxyLink("mavproxy:here", sent.append)
    link.take(b"ab")
    link.take(b"c")
    assert link.read(0.0) == b"abc"
    assert link.read(0.0) == b""
    link.write(b"out")
    assert sent == [b"out"]
    link.close()
    with pytest.raises(LinkLost, match="has been closed"):
        link.write(b"more")


def test_a_broken_mavproxy_link_is_reported_as_lost():
    def broken(data: bytes) -> None:
        raise OSError("no such device")

    with pytest.raises(LinkLost, match="no such device"):
        mavproxy.MavproxyLink("mavproxy:here", broken).write(b"x")


def a_module(signs: bool = False, override: int = 0):
    """The module in a fake MAVProxy."""
    master = SimpleNamespace(
        address="com9", write=len, mav=SimpleNamespace(signing=SimpleNamespace(sign_outgoing=signs))
    )
    state = SimpleNamespace(
        command_map={},
        completions={},
        multi_instance={},
        instance_count={},
        public_modules={},
        master=lambda: master,
        module={"rc": SimpleNamespace(override=[override, 0])}.get,
        settings=SimpleNamespace(streamrate=4, streamrate2=4),
    )
    return mavproxy.init(state), state


@needs_mavproxy
@pytest.mark.parametrize(
    ("typed", "words", "with_what"),
    [
        ("", "usage: autotune AXIS", {}),
        ("yes", "no question is waiting for an answer", {}),
        ("stop", "nothing is running", {}),
        ("status", "nothing is running", {}),
        ("headding", "invalid choice: 'headding'", {}),
        ("heading --connect sitl:charlie", "MAVProxy provides link and console", {}),
        ("heading", "MAVProxy signs this link", {"signs": True}),
        ("heading", "`rc all 0` first", {"override": 1500}),
    ],
)
def test_an_impossible_command_prints_one_sentence_and_sends_nothing(capsys, typed, words, with_what):
    module, state = a_module(**with_what)
    state.command_map["autotune"][0](typed.split())
    assert words in capsys.readouterr().out
    assert not module.is_busy
    module.unload()
    assert state.command_map == {}
