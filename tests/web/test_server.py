"""The server as a process: its port, its link, and its end, with and without a run."""

from __future__ import annotations

import http.client
import json
import os
import signal
import socket
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

from gcs_autotune.cli import main
from gcs_autotune.errors import CannotOpenLink
from gcs_autotune.web import ServeSettings, serve
from gcs_autotune.web.server import told

from .scripted_run import OLD
from .serving import ROOT

HEADERS = {"X-Autotune-Token": "none", "Content-Type": "application/json"}
posix = pytest.mark.skipif(os.name != "posix", reason="signals as POSIX has them")


class Serving:
    """A server with a scripted run, or without one (then ``run`` is the folder of runs)."""

    def __init__(self, runs: Path, *, begins: bool = True) -> None:
        words = [sys.executable, "-m", "tests.web.serving", str(runs), "scripted", "127.0.0.1"]
        self.process = subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        assert self.process.stdout is not None
        self.port = int(self.process.stdout.readline().split("/")[2].rpartition(":")[2])
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60.0)
        if not begins:
            self.run = runs
            connection.request("GET", "/events")
            connection.getresponse().readline()
            self.viewer = connection  # a page that looks until the server is gone
            return
        started = {"job": "tune", "axis": "heading", "connect": "udpin:127.0.0.1:14550"}
        connection.request("POST", "/start", json.dumps(started), HEADERS)
        self.run = runs / json.loads(connection.getresponse().read())["name"]
        connection.request("GET", "/events")
        events = connection.getresponse()
        while b'"question":{' not in events.readline():
            pass
        connection.close()

    def ended(self) -> str:
        output, _ = self.process.communicate(timeout=60.0)
        return output


@posix
def test_ctrl_c_stops_the_run_waits_for_it_and_reports_it(tmp_path: Path) -> None:
    serving = Serving(tmp_path)
    serving.process.send_signal(signal.SIGINT)
    output = serving.ended()
    assert "Stopping: setting the actuators to neutral" in output and "unless this is done already" in output
    assert output.rstrip().endswith("page closed")
    assert json.loads((serving.run / "parameters_after.json").read_text()) == OLD
    assert serving.process.returncode == 0


@posix
@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_without_a_run_closes_the_page_at_once(tmp_path: Path, sign: signal.Signals) -> None:
    serving = Serving(tmp_path, begins=False)
    serving.process.send_signal(sign)
    with closing(serving.viewer):
        assert serving.ended() == "page closed\n"
    assert serving.process.returncode == 0
    assert list(tmp_path.iterdir()) == []


@posix
def test_a_run_stops_if_its_server_is_killed(tmp_path: Path) -> None:
    import fcntl  # POSIX alone has it

    serving = Serving(tmp_path)
    assert not (serving.run / "parameters_after.json").exists()
    serving.process.kill()
    serving.ended()
    with (serving.run / "parameters_before.json").open("rb") as held:
        fcntl.flock(held, fcntl.LOCK_EX)  # waits for the run, which is no child of this process
    assert json.loads((serving.run / "parameters_after.json").read_text()) == OLD


def test_a_port_in_use_is_reported_with_advice(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(CannotOpenLink, match="another --port"):
            serve(ServeSettings("127.0.0.1", port, tmp_path), lambda text: None)
        assert main(["serve", "--port", str(port), "--runs", str(tmp_path)]) == 3
    assert "Stop the other server" in capsys.readouterr().err


def test_a_missing_extra_is_reported_in_one_sentence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in [name for name in sys.modules if name.startswith(("gcs_autotune.web", "starlette", "segno"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "starlette", None)
    monkeypatch.setitem(sys.modules, "segno", None)
    assert main(["serve"]) == 2
    assert "pip install 'gcs-autotune[web]'" in capsys.readouterr().err


def test_the_token_link_and_qr_code_are_shown_only_for_external_addresses() -> None:
    alone = told("127.0.0.1", 8090, "")
    assert len(alone) == 1
    assert "#" not in alone[0]
    link, code, words = told("192.168.2.2", 8090, "secret-token")
    assert link == "page: http://192.168.2.2:8090/#secret-token"
    assert len(set(code) - set(" ▀▄█\n")) == 0
    assert len(code.splitlines()) > 10
    assert "not encrypted" in words
    assert "[fe80::1]" in told("fe80::1", 8090, "t")[0]
