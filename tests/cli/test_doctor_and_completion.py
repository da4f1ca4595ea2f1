"""``doctor``, ``ports``, ``completion``; verbosity of the other commands; no colour if disabled."""

from __future__ import annotations

import io
import json
import os
import select
import shutil
import socket
import subprocess
import sys
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega
from rich.console import Console

from gcs_autotune.cli import COMMANDS, identify_cmd, main
from gcs_autotune.clock import ManualClock
from gcs_autotune.documents import model_file
from gcs_autotune.errors import BadFile
from gcs_autotune.link import Overheard, overhear
from gcs_autotune.observer import Progress
from gcs_autotune.report import Document, StageBar, TerminalObserver, print_document
from gcs_autotune.report.toolkit.document import Verdict
from gcs_autotune.workflow import examine


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Talking:
    """A clock of a link on which, while it is listened to, bytes come in at our own UDP port."""

    def __init__(self, port: int, datagrams: list[bytes]) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.port, self.datagrams = port, datagrams

    def __enter__(self):
        import threading

        self.stop = threading.Event()

        def talk():
            while not self.stop.wait(0.02):
                for datagram in self.datagrams:
                    self.socket.sendto(datagram, ("127.0.0.1", self.port))

        self.thread = threading.Thread(target=talk)
        self.thread.start()
        return self

    def __exit__(self, *exception):
        self.stop.set()
        self.thread.join()
        self.socket.setblocking(False)
        try:
            self.answer = self.socket.recv(100)
        except BlockingIOError:
            self.answer = b""
        self.socket.close()


def heartbeat(system: int, autopilot: int, armed: bool = False) -> bytes:
    link = ardupilotmega.MAVLink(None, srcSystem=system, srcComponent=1)
    message = ardupilotmega.MAVLink_heartbeat_message(11, autopilot, 128 if armed else 0, 0, 4, 3)
    return bytes(message.pack(link))


@pytest.mark.parametrize(
    ("datagrams", "told"),
    [
        ([heartbeat(3, 3, armed=True)], "system 3 (ArduRover), armed"),
        ([heartbeat(255, 8)], "MAVLink, but no autopilot: system ids 255"),
        ([b"hello, world"], "data that is not MAVLink. Check the address and port"),
        ([], "silent"),
    ],
)
def test_listening_on_a_port_sends_nothing(datagrams, told):
    port = free_port()
    with Talking(port, datagrams) as talking:
        heard = overhear(f"udpin:127.0.0.1:{port}", 0.3)
    assert heard.description == told
    assert talking.answer == b""


@pytest.mark.parametrize(
    ("uri", "advice"),
    [
        ("/dev/ttyUSB0,57600", "Check the baud rate"),
        ("COM3,57600", "Check the baud rate"),
        ("serial_flowcontrol:/dev/ttyACM0:57600", "Check the baud rate"),
        ("tcp:127.0.0.1:5760", "Check the address and port"),
    ],
)
def test_only_a_serial_port_has_a_baud_rate_to_check(uri, advice):
    assert Overheard(uri, bad_bytes=9).description == f"data that is not MAVLink. {advice}"


def test_a_port_in_use_is_reported():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        heard = overhear(f"udpin:127.0.0.1:{other.getsockname()[1]}", 0.3)
    assert "Address already in use" in heard.description
    assert heard.messages == 0


def test_ports_shows_how_to_connect_to_a_vehicle(capsys):
    port = free_port()
    with Talking(port, [heartbeat(3, 3)]):
        assert main(["ports", "--connect", f"udpin:127.0.0.1:{port}", "--listen", "0.3"]) == 0
    assert f"Next:\n  gcs-autotune tune heading --connect udpin:127.0.0.1:{port}\n" in capsys.readouterr().out


def test_a_suggested_command_can_be_copied_whatever_the_link_or_path(capsys, tmp_path):
    link = "sitl:charlie?effect=dead-zone.width=0.05&seed=3"
    assert main(["ports", "--connect", link, "--listen", "3"]) == 0
    assert f"  gcs-autotune tune heading --connect '{link}'\n" in capsys.readouterr().out
    run = tmp_path / "the run"
    run.mkdir()
    with pytest.raises(BadFile, match=f"identify '{run}' --save"):
        model_file(run)


def test_doctor_ends_with_a_verdict_and_the_next_command(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    link = ["--connect", f"udpin:127.0.0.1:{free_port()}", "--listen", "0.2"]
    assert main(["doctor", *link]) == 0
    last, command = capsys.readouterr().out.splitlines()[-2:]
    assert command == "  gcs-autotune tune heading"
    assert last.startswith("This computer is ready. No vehicle was found.")
    assert "network" in last and "baud" not in last
    monkeypatch.setattr(shutil, "disk_usage", lambda path: shutil._ntuple_diskusage(100, 99, 1))
    assert main(["doctor", *link]) == 1
    assert capsys.readouterr().out.splitlines()[-1] == "Not ready: correct the line marked X."


def test_doctor_checks_everything_a_tune_needs(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    port = free_port()
    code = main(["doctor", "--connect", f"udpin:127.0.0.1:{port}", "--listen", "0.2", "--json"])
    document = json.loads(capsys.readouterr().out)
    assert code == 0
    looked_at = {f["what"] for f in document["findings"]}
    assert looked_at == {"program", "packages", "settings", "clock", "timing", "disk", "cache"}
    assert document["ports"] == [
        {"port": f"udpin:127.0.0.1:{port}", "uri": f"udpin:127.0.0.1:{port}", "told": "silent", "systems": []}
    ]
    assert list(tmp_path.iterdir()) == []


def test_doctor_reports_a_wrong_clock_and_a_full_disk(monkeypatch, tmp_path):
    from gcs_autotune.workflow import doctor

    monkeypatch.setattr(doctor.time, "time", lambda: 1e9)
    monkeypatch.setattr(doctor.shutil, "disk_usage", lambda path: shutil._ntuple_diskusage(100, 99, 1))
    wrong = {f.what: f for f in examine(tmp_path, None) if f.state == "wrong"}
    assert set(wrong) == {"clock", "disk"}
    assert all(f.cure for f in wrong.values())


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_completion_script_contains_every_verb(capsys, shell, tmp_path):
    pytest.importorskip("shtab")
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert [verb for verb in COMMANDS if verb not in script] == []
    assert "max-heading-excursion" in script
    if shutil.which(shell):
        (tmp_path / "script").write_text(script)
        subprocess.run([shell, "-n", str(tmp_path / "script")], check=True)


def test_bash_completes_verbs_options_and_choices(capsys, tmp_path):
    pytest.importorskip("shtab")
    if not shutil.which("bash"):
        pytest.skip("no bash")
    main(["completion", "bash"])
    (tmp_path / "script").write_text(capsys.readouterr().out)

    def completed(*words: str) -> set[str]:
        typed = " ".join(f"'{w}'" for w in ("gcs-autotune", *words))
        asking = (
            f"source {tmp_path}/script; COMP_WORDS=({typed}); COMP_CWORD={len(words)}; COMP_LINE=x; "
            "_shtab_gcs_autotune; printf '%s\\n' \"${COMPREPLY[@]}\""
        )
        reported = subprocess.run(["bash", "-c", asking], capture_output=True, text=True, check=True)
        return set(reported.stdout.split())

    assert completed("diag") == {"diagnose"}
    assert completed("tune", "he") == {"heading"}
    assert "--max-heading-excursion" in completed("tune", "heading", "--max-h")


COMPLETED = [
    ("gcs-autotune diag", "diagnose"),
    ("gcs-autotune tune he", "heading"),
    ("gcs-autotune tune heading --max-head", "--max-heading-excursion"),
    ("gcs-autotune fly zi", "zig-zag"),
    ("gcs-autotune tune heading --stop-rule set", "settled"),
]


@pytest.mark.parametrize(("typed", "wanted"), COMPLETED)
def test_fish_completes_verbs_options_choices_and_manoeuvres(capsys, tmp_path, typed, wanted):
    if not shutil.which("fish"):
        pytest.skip("no fish")
    main(["completion", "fish"])
    (tmp_path / "script").write_text(capsys.readouterr().out)
    asking = f"source {tmp_path}/script; complete -C '{typed}'"
    home = {**os.environ, "HOME": str(tmp_path), "XDG_CONFIG_HOME": str(tmp_path), "XDG_DATA_HOME": str(tmp_path)}
    output = subprocess.run(["fish", "-c", asking], capture_output=True, text=True, check=True, env=home).stdout
    assert [line.split("\t")[0] for line in output.splitlines()] == [wanted]


def test_zsh_completes_verbs_options_choices_and_manoeuvres(capsys, tmp_path):
    """At a prompt on a terminal, with the Tab key: its functions can be tested in no other way."""
    pty = pytest.importorskip("pty")
    if not shutil.which("zsh"):
        pytest.skip("no zsh")
    main(["completion", "zsh"])
    (tmp_path / "_gcs-autotune").write_text(capsys.readouterr().out)
    ours, theirs = pty.openpty()
    home = {**os.environ, "HOME": str(tmp_path), "ZDOTDIR": str(tmp_path), "TERM": "dumb", "COLUMNS": "200"}
    with subprocess.Popen(["zsh", "-f", "-i"], stdin=theirs, stdout=theirs, stderr=theirs, env=home) as zsh:
        os.close(theirs)

        def until(wanted: str) -> bool:
            reported = b""
            while wanted.encode() not in reported:
                if not select.select([ours], [], [], 30.0)[0]:
                    raise AssertionError(f"{wanted} did not come: {reported[-500:]!r}")
                reported += os.read(ours, 65536)
            return True

        begin = f"fpath=({tmp_path} $fpath); autoload -U compinit; compinit -u -d {tmp_path}/dump; echo be''gun\n"
        os.write(ours, begin.encode())
        assert until("begun")
        for typed, wanted in COMPLETED:
            os.write(ours, f"{typed}\t".encode())
            assert until(wanted)
            os.write(ours, b"\x15")  # the line is taken back
        os.write(ours, b"\x03exit\n")
        zsh.kill()
    os.close(ours)


@pytest.mark.parametrize(
    ("quiet", "verbose", "lines"), [(True, False, 1), (False, False, 1), (False, True, 2)], ids=["quiet", "", "verbose"]
)
def test_quiet_keeps_sentences_and_drops_progress_and_verbose_keeps_its_lines(quiet, verbose, lines):
    console = Console(file=io.StringIO(), force_terminal=True, width=60, color_system=None)
    with TerminalObserver(console, ManualClock(), quiet=quiet, verbose=verbose) as observer:
        observer.update(Progress("relay", "relay 1", 0.0))
        observer.say("a sentence")
    output = console.file.getvalue()
    assert "a sentence" in output
    assert ("relay 1" in output) is not quiet
    kept = [line for line in output.replace("\r\x1b[2K", "\n").splitlines() if line.strip()]
    assert output.count("\n") == lines, kept


def test_a_verbose_calculation_prints_a_line_for_each_stage():
    console = Console(file=io.StringIO(), width=60)
    with StageBar(console, verbose=True) as bar:
        for stage in ("screening", "screening", "fitting"):
            bar(stage, 1, 2)
    assert console.file.getvalue().split() == ["screening", "fitting"]


def test_a_traceback_is_shown_only_with_verbose(capsys, tmp_path):
    (tmp_path / "bad.csv").write_text("1,2,3\n4,5,6\n")
    main(["identify", str(tmp_path / "bad.csv")])
    assert "Traceback" not in capsys.readouterr().err
    main(["identify", str(tmp_path / "bad.csv"), "--verbose"])
    output = capsys.readouterr().err
    assert "Traceback" in output
    assert output.splitlines()[-1].startswith("gcs-autotune: ")


def test_ctrl_c_in_a_calculation_prints_one_line_and_exits_with_130(capsys, tmp_path, monkeypatch):
    def cut_off(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(identify_cmd, "COMMAND", replace(identify_cmd.COMMAND, run=cut_off))
    assert main(["identify", str(tmp_path)]) == 130
    assert capsys.readouterr().err == "\ngcs-autotune: ended by Ctrl-C\n"


@pytest.mark.skipif(os.name != "posix", reason="pipes as POSIX has them")
def test_a_closed_output_pipe_ends_the_program_silently():
    with subprocess.Popen(
        [sys.executable, "-m", "gcs_autotune", "fly", "--list"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None and process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait(60.0) == 1


def test_no_color_in_the_environment_disables_colour(monkeypatch):
    def shown() -> str:
        console = Console(file=io.StringIO(), force_terminal=True, color_system="truecolor")
        for tone in ("good", "bad"):
            print_document(console, Document("", (), Verdict("proved better", tone)))
        return console.file.getvalue()

    monkeypatch.delenv("NO_COLOR", raising=False)
    assert "32m" in shown()
    monkeypatch.setenv("NO_COLOR", "1")
    assert "32m" not in shown()
    assert "31m" not in shown()
