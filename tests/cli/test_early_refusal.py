"""A typo is rejected before heavy imports, and leaves no run directory."""

from __future__ import annotations

import argparse
import re
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from gcs_autotune.cli import identify_cmd, main, make_parser
from gcs_autotune.cli.console import ConsoleOperator
from gcs_autotune.errors import CannotOpenLink, UsageError
from gcs_autotune.identify import METHODS
from gcs_autotune.link import Transport
from gcs_autotune.methods import METHOD_PLACES
from gcs_autotune.models import FORMS
from gcs_autotune.observer import SilentObserver
from gcs_autotune.sname import DOFS
from gcs_autotune.workflow import Connection, TuneSettings, Unattended, experiment, tune

WRONG = (
    ("--connect", "/dev/ttyNOSUCH,57600"),
    ("--connect", "udpin:127.0.0.1:99999"),
    ("--connect", "udpin:127.0.0.1:TAKEN"),
    ("--connect", "udbin:127.0.0.1:14550"),
    ("--connect", "nonsense"),
    ("--connect", "sitl:charly"),
    ("--backend", "pymavlnk"),
    ("--model", "nowhere.json"),
    ("--model", "broken.json"),
    ("--model", "bessel"),
    ("--function", "besel"),
    ("--signing-key", "nowhere.key"),
    ("--relay-output", "5"),
)
PROGRAM = """
import sys
from gcs_autotune.cli import main
for line in sys.argv[1:]:
    code = main(line.split())
    print(code, sorted(m for m in ("numba", "scipy", "gcs_autotune.workflow", "matplotlib") if m in sys.modules))
"""


def test_a_typo_is_rejected_before_heavy_imports_and_leaves_nothing(tmp_path):
    (tmp_path / "broken.json").write_text("{")
    (tmp_path / "run" / "trials").mkdir(parents=True)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = str(taken.getsockname()[1])
        lines = [f"tune heading {o} {v.replace('TAKEN', port)}" for o, v in WRONG]
        lines += [f"experiment heading {o} {v.replace('TAKEN', port)}" for o, v in WRONG[:7]]
        lines += [f"identify runs.csv {o}" for o in ("--dof yow", "--method ukv", "--compare ukv")]
        lines += ["tune heading --gains nowhere.param", "tune heading --resume nowhere"]
        lines += ["identify nowhere.csv", "identify broken.json --validate nowhere.csv"]
        lines += ["diagnose nowhere.csv", "diagnose broken.json --simulation nowhere.csv", "figures nowhere.csv"]
        lines += ["logs show nowhere.bin", "restore nowhere", "export nowhere.json --to csv"]
        lines += [f"{verb} --out run" for verb in ("tune heading", "experiment yaw", "fly zig-zag", "recheck heading")]
        lines += ["fly zig-zg", "fly zig-zag --heading nan", "fly --form yaw zig-zag"]
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM, *lines],
            cwd=tmp_path,
            env={"PYTHONPATH": str(Path(__file__).parents[2]), "PATH": ""},
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
    assert done.returncode == 0, done.stderr
    output = done.stdout.splitlines()
    assert len(output) == len(lines)
    assert {line.split()[0] for line in output} <= {"2", "3", "6"}
    assert {line.partition(" ")[2] for line in output} == {"[]"}
    assert {p.name for p in tmp_path.iterdir()} == {"broken.json", "run"}


def test_the_motions_checked_by_identify_are_those_of_the_tables():
    assert set(identify_cmd.MOTIONS) == {*DOFS, *FORMS}


def test_every_method_of_the_command_line_is_at_its_place_in_the_table():
    assert [METHODS[name].name for name in METHOD_PLACES] == list(METHODS)


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("identify a.csv --dof yow", "Did you mean yaw?"),
        ("identify a.csv --method instrumental", "Did you mean instrumental-variables?"),
        ("tune headin", "Did you mean heading?"),
        ("tun heading", "Did you mean tune"),
        ("tune heading --max-distanse 5", "Did you mean --max-distance"),
        ("tune heading --max-distanse=5", "Did you mean --max-distance"),
        ("figures a.csv --lenght 5", "Did you mean --length"),
    ],
)
def test_an_unknown_name_is_rejected_with_the_nearest_spelling(typed, meant, capsys):
    assert main(typed.split()) == 2
    assert meant in capsys.readouterr().err


@pytest.mark.parametrize(
    ("typed", "why"),
    [
        ("tune line --settling-time 5", "does not use --settling-time. Remove"),
        ("tune line --speed 1.2", "does not use --speed. Remove"),
        ("tune line --throttle 0.5 --relays 2", "`tune line` does not use --relays and --throttle"),
        ("tune line --function butterworth", "does not use --function"),
        ("tune line --beyond-ranges", "does not use --beyond-ranges"),
        ("tune heading --untuned", "`tune heading` does not use --untuned"),
        ("tune heading --leg-length 30", "`tune heading` does not use --leg-length"),
    ],
)
def test_an_option_that_the_loop_does_not_use_is_rejected(typed, why, capsys):
    assert main(typed.split()) == 2
    assert why in " ".join(capsys.readouterr().err.split())


class Broken(Connection):
    """A connection that cannot be had."""

    __slots__ = ()

    def open(self) -> Transport:
        raise CannotOpenLink("no")


@pytest.mark.parametrize("fly", ["tune", "experiment"])
def test_a_link_that_cannot_be_opened_leaves_no_run_directory(fly, tmp_path):
    settings = TuneSettings(Broken("sitl:x"), tmp_path / "runs" / "one", axis="heading")
    with pytest.raises(CannotOpenLink):
        if fly == "tune":
            tune(settings, Unattended(), SilentObserver(), "")
        else:
            experiment(settings, Unattended(), SilentObserver())
    assert list(tmp_path.iterdir()) == []


def test_an_impossible_run_directory_is_rejected_before_the_link_is_opened(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="not a directory"):
        tune(
            TuneSettings(Broken("sitl:x"), tmp_path / "file" / "run", axis="heading"),
            Unattended(),
            SilentObserver(),
            "",
        )


def options_of(*path: str) -> set[str]:
    parser: argparse.ArgumentParser = make_parser()
    for name in path:
        parser = next(a for a in parser._actions if isinstance(a, argparse._SubParsersAction)).choices[name]
    return {flag for action in parser._actions for flag in action.option_strings}


@pytest.mark.parametrize("command", ["tune", "experiment", "restore", "params restore"])
def test_without_a_terminal_a_command_names_only_its_own_options(command, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
    monkeypatch.setattr("sys.stdin", None)
    asked: list[ConsoleOperator] = []
    made = ConsoleOperator.__init__

    def note(self: ConsoleOperator, **given: object) -> None:
        made(self, **given)
        asked.append(self)
        raise UsageError("far enough")

    monkeypatch.setattr(ConsoleOperator, "__init__", note)
    (tmp_path / "a.param").write_text("ATC_STR_RAT_P,0.2\n")
    words = command.split()
    rest = {"tune": ["heading"], "experiment": ["heading"], "restore": [], "params restore": ["a.param"]}[command]
    if command == "restore":
        (tmp_path / "run").mkdir()
        (tmp_path / "run" / "journal.jsonl").write_text('{"event": "opened", "link": "sitl:charlie"}\n')
        rest = ["run"]
    assert main([*words, *rest, "--connect", "sitl:charlie"]) == 2
    with pytest.raises(UsageError, match="--yes") as caught:
        asked[0].ask("go?", lambda: None)
    named = set(re.findall(r"--[a-z][a-z-]*", str(caught.value)))
    assert named
    assert named <= options_of(*words)
    assert ("--dry-run" in named) == (command == "tune")
