"""The same tune over real transports: two processes, UDP, TCP and a pair of pseudo-terminals.

The simulator runs free at three times real time, so these are the only tests that take wall time. A stall of a loaded
machine counts threefold there. So their processes take precedence over other tests where the system allows it, the
pilot-input failsafe (three seconds) has ten times as long, and a turn has time to finish.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

SPEEDUP = "3"
INERTIA, LINEAR, QUADRATIC = 80 / 400, 300 / 400, 10 / 400
TURNING = 0.5
"""Turn rate [rad/s] at which damping is compared: where a stalled machine leaves outputs at 40 Hz, these runs hardly
distinguish linear from quadratic."""


@pytest.fixture(autouse=True)
def precedence() -> Iterator[None]:
    """These processes before those of other tests, which children inherit: only an administrator may do this."""
    usual = os.getpriority(os.PRIO_PROCESS, 0)
    with contextlib.suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, -15)
    try:
        yield
    finally:
        os.setpriority(os.PRIO_PROCESS, 0, usual)


def free_port(kind) -> int:
    with socket.socket(socket.AF_INET, kind) as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


@contextlib.contextmanager
def udp() -> Iterator[tuple[str, str]]:
    port = free_port(socket.SOCK_DGRAM)
    yield f"udp:127.0.0.1:{port}", f"udpout:127.0.0.1:{port}"


@contextlib.contextmanager
def tcp() -> Iterator[tuple[str, str]]:
    port = free_port(socket.SOCK_STREAM)
    yield f"tcp:127.0.0.1:{port}", f"tcp:127.0.0.1:{port}"


@contextlib.contextmanager
def serial() -> Iterator[tuple[str, str]]:
    """Two pseudo-terminals with a null-modem cable between their masters.

    The cable holds what the other side has not yet taken. Without this, a program that is not scheduled for a quarter
    of a second would lose messages: at threefold speed, a pseudo-terminal has no space for more.
    """
    (one, vehicle), (other, ground) = os.openpty(), os.openpty()
    done, wake = os.pipe()
    for end in (one, other):
        os.set_blocking(end, False)

    def cable():
        ends, held = {one: other, other: one}, {one: b"", other: b""}
        while True:
            readable, writable, _ = select.select([one, other, done], [end for end in ends if held[end]], [])
            if done in readable:
                return
            for end in writable:
                held[end] = held[end][os.write(end, held[end][:512]) :]
            for end in readable:
                held[ends[end]] += os.read(end, 4096)

    thread = threading.Thread(target=cable, daemon=True)
    thread.start()
    try:
        yield f"serial:{os.ttyname(vehicle)}", f"{os.ttyname(ground)},57600"
    finally:
        os.write(wake, b"x")
        thread.join(5.0)
        for fd in (one, other, vehicle, ground, done, wake):
            os.close(fd)


@contextlib.contextmanager
def vehicle_process(listen: str) -> Iterator[None]:
    command = [sys.executable, "-m", "gcs_autotune", "sitl", "falcon", "--listen", listen, "--speedup", SPEEDUP]
    command += ["--param", "FS_PILOT_TIMEOUT=30", "--param", "SCHED_LOOP_RATE=100"]  # 400 Hz are four times the work
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert "FALCON" in process.stderr.readline().upper()
        try:
            yield
        finally:
            process.terminate()
            assert process.wait(10.0) in (0, -15)


OURS = [sys.executable, "-m", "gcs_autotune"]
BRIEF = [sys.executable, str(Path(__file__).parents[1] / "brief_program.py")]
"""The same with designs of few evaluations: the whole is flown over one wire."""


@pytest.mark.parametrize(("wire", "program"), [(udp, OURS), (serial, BRIEF)], ids=["udp", "serial"])
def test_a_tune_works_over_a_real_link(tmp_path, wire, program):
    run = tmp_path / "run"
    with wire() as (listen, connect), vehicle_process(listen):
        tune = [*program, "tune", "heading", "--connect", connect, "--yes"]
        done = subprocess.run(
            [*tune, "--out", str(run), "--step-duration", "8", "--max-heading-excursion", "170"],
            capture_output=True,
            text=True,
            timeout=250,
            check=False,
        )
    assert done.returncode == 0, done.stderr
    summary = json.loads((run / "summary.json").read_text())
    assert summary["ending"] == "kept"
    fit = json.loads((run / "fit.json").read_text())["parameters"]
    alpha, beta, damping = fit["alpha_r"], fit["beta_r"], fit["beta_r"]["value"] + TURNING * fit["beta_rr"]["value"]
    assert alpha["value"] == pytest.approx(INERTIA, abs=4.0 * alpha["std"] + 0.01 * INERTIA)
    assert alpha["value"] == pytest.approx(INERTIA, rel=0.1)
    truth = LINEAR + TURNING * QUADRATIC
    assert damping == pytest.approx(truth, abs=4.0 * beta["std"] + 0.01 * truth)
    assert damping == pytest.approx(truth, rel=0.1)
    assert (run / "report.html").exists()


def run_cli(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [*OURS, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


def test_restore_writes_the_old_gains_after_a_kill_during_the_proof(tmp_path):
    """Over TCP, which a tune that is killed breaks: identification, design, writing and a proof begun come before."""
    run = tmp_path / "run"
    with tcp() as (listen, connect), vehicle_process(listen):
        tune = [*BRIEF, "tune", "heading", "--connect", connect, "--yes"]
        with subprocess.Popen(
            [*tune, "--out", str(run), "--step-duration", "8"], stderr=subprocess.PIPE, text=True
        ) as process:
            assert process.stderr is not None
            for line in process.stderr:
                if line.strip() == "step with new gains":  # announced before, in a list of all stages
                    process.kill()
                    break
        changed = run_cli("params", "save", str(tmp_path / "changed.param"), "--connect", connect)
        restored = run_cli("restore", str(run), "--connect", connect, "--yes")
        again = run_cli("restore", str(run), "--connect", connect, "--yes")
        after = run_cli("params", "save", str(tmp_path / "after.param"), "--connect", connect)
    assert (changed.returncode, restored.returncode, after.returncode) == (0, 0, 0), restored.stderr
    before = (run / "parameters_before.param").read_text().splitlines()
    left = (tmp_path / "changed.param").read_text().splitlines()
    assert any(line not in left for line in before), "the cut came before anything was written"
    assert set(before) <= set((tmp_path / "after.param").read_text().splitlines())
    assert "verified by reading back" in restored.stdout
    assert "nothing to restore" in again.stdout.lower()
