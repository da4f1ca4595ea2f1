"""Cases that run commands of the program on a simulated vehicle, and the command line of `study`."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from gcs_autotune.cli import main, make_parser
from gcs_autotune.errors import BadFile, UsageError
from gcs_autotune.study import check_plan, load_plan, open_study
from gcs_autotune.study import jobs as jobs_module
from gcs_autotune.study.command_server import CommandServer
from gcs_autotune.study.jobs import JOBS, Killed, commands_of, results_of
from tests.study.test_run import Stopping, rows
from tests.study.toys import ran

ROOT = Path(__file__).parents[2]
FLIGHT = """
title = "surge steps"
do = "identify"
[fixed]
vehicle.like = "videoray"
fly.manoeuvre = "steps"
fly.duration = 4
fly.force = "X"
identify.dof = "surge"
identify.no-check = true
[vary]
vehicle.surge.alpha.times = [1.0, 1.5]
"""


KILLED = """
import os, runpy
runpy.run_module = lambda *args, **kwargs: os.kill(os.getpid(), 9)
"""
"""What a command runs as: it kills itself."""


def parse(line: list[str]) -> None:
    make_parser(only=line[0]).parse_args(line)


def plan_of(tmp_path: Path, text: str):
    (tmp_path / "study.toml").write_text(text)
    return load_plan(tmp_path / "study.toml")


def test_a_case_of_two_commands_is_flown_and_then_identified(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, FLIGHT)
    fly, identify = commands_of(plan.do, plan[1].given, tmp_path, tmp_path)
    assert fly[:3] == ["fly", "steps", "--connect"]
    assert fly[3] == f"sitl:{tmp_path}/vehicle.toml"
    assert "--force=X" in fly
    assert identify[:2] == ["identify", str(tmp_path / "run")]
    assert "--no-check" in identify


def test_an_experiment_has_the_relay_of_its_case(tmp_path: Path) -> None:
    text = """
title = "relays of a boat"
do = "experiment"
[fixed]
vehicle.like = "charlie"
experiment.axis = "heading"
experiment.throttle = 0.75
[vary]
experiment.relay-output = [0.5, 0.9]
experiment.relay-hysteresis = [5, 10]
"""
    plan = plan_of(tmp_path, text)
    check_plan(plan, parse)
    (line,) = commands_of(plan.do, plan[3].given, tmp_path, tmp_path)
    assert line[:4] == ["experiment", "heading", "--connect", "sitl:charlie"]
    assert {"--throttle=0.75", "--relay-output=0.9", "--relay-hysteresis=10"} <= set(line)
    with pytest.raises(BadFile, match=r"vary\.experiment\.relay-output: 5: .*relay-output"):
        check_plan(plan_of(tmp_path, text.replace("0.9]", "5]")), parse)


@pytest.mark.parametrize(
    ("own", "wrong", "why"),
    [
        ("dof =", "duf =", r"fixed\.identify\.duf: .*--duf"),
        ("fly.duration =", "fly.durations =", r"fixed\.fly\.durations: .*--durations"),
        ("= 4", "= -4", r".*--duration: -4 is out of range"),
    ],
)
def test_unknown_options_are_rejected_before_any_flight(own: str, wrong: str, why: str, tmp_path: Path) -> None:
    with pytest.raises(BadFile, match=rf"study\.toml: {why}"):
        check_plan(plan_of(tmp_path, FLIGHT.replace(own, wrong)), parse)


def starting(*accepted: str) -> Callable[[str], None]:
    """Start only the *accepted* links, as the simulator does."""

    def start(link: str) -> None:
        if link not in accepted:
            raise UsageError(f"cannot start {link}")

    return start


PLAIN = """
title = "steps"
do = "fly"
fixed.vehicle.like = "videoray"
fixed.fly.manoeuvre = "steps"
vary.fly.duration = [4, 5]
"""


def test_an_effect_rejected_by_the_simulator_is_reported(tmp_path: Path) -> None:
    text = PLAIN + "vary.effect = ['none', 'dead-zone.width=0.1', 'dead-zne.width=0.1']\n"
    links = ("sitl:videoray", "sitl:videoray?effect=dead-zone.width=0.1")
    with pytest.raises(BadFile, match=r"study\.toml: vary\.effect: dead-zne\.width=0\.1: cannot start"):
        check_plan(plan_of(tmp_path, text), parse, starting(*links))


def test_a_fixed_number_rejected_by_the_simulator_is_reported(tmp_path: Path) -> None:
    text = PLAIN + "fixed.effect.dead-zone.widht = 0.1\n"
    with pytest.raises(BadFile, match=r"study\.toml: fixed\.effect\.dead-zone\.widht: 0\.1: cannot start"):
        check_plan(plan_of(tmp_path, text), parse, starting("sitl:videoray"))
    with pytest.raises(BadFile, match=r"study\.toml: fixed\.vehicle\.like: videoray: cannot start"):
        check_plan(plan_of(tmp_path, PLAIN), parse, starting())


def test_options_set_by_the_study_are_rejected(tmp_path: Path) -> None:
    with pytest.raises(BadFile, match=r"fly\.seed: a study sets this option itself"):
        check_plan(plan_of(tmp_path, FLIGHT.replace("fly.duration", "fly.seed")), parse)


def test_a_varied_value_outside_its_limits_is_reported(tmp_path: Path) -> None:
    text = FLIGHT.replace("fly.duration = 4\n", "") + "fly.duration = [4, -1]\n"
    with pytest.raises(BadFile, match=r"study\.toml: vary\.fly\.duration: -1: "):
        check_plan(plan_of(tmp_path, text), parse)


def test_the_manoeuvre_is_required(tmp_path: Path) -> None:
    with pytest.raises(BadFile, match=r"fly\.manoeuvre is missing"):
        check_plan(plan_of(tmp_path, FLIGHT.replace('fly.manoeuvre = "steps"\n', "")), parse)


def test_a_command_ended_by_a_signal_is_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "sitecustomize.py").write_text(KILLED)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    plan = plan_of(tmp_path, FLIGHT)
    with CommandServer() as commands:
        monkeypatch.setattr(jobs_module, "COMMANDS", commands)
        with pytest.raises(Killed, match="fly was ended by signal 9"):
            results_of(plan.do, plan[0].given, tmp_path, tmp_path)
        ran(tmp_path / "study.toml", tmp_path / "out")
    table = open_study(tmp_path / "out")
    assert table["status"].tolist() == ["given up"] * 2
    assert table["tries"].tolist() == [3, 3]
    assert table["reason"][0] == "fly was ended by signal 9, 3 times"


def test_a_failing_command_is_a_row_with_its_message(tmp_path: Path) -> None:
    ran_file = tmp_path / "study.toml"
    ran_file.write_text(FLIGHT.replace('"videoray"', '"videora"').replace("[vary]\n", "").replace("[1.0, 1.5]", "1.0"))
    ran(ran_file, tmp_path / "out")
    (reason,) = open_study(tmp_path / "out")["reason"]
    assert "vehicle.like: the file of 'videora' cannot be read" in reason


@pytest.mark.slow
def test_flown_cases_are_identified_and_give_the_same_rows_again(tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text(FLIGHT)
    ran(tmp_path / "study.toml", tmp_path / "one")
    with pytest.raises(KeyboardInterrupt):
        ran(tmp_path / "study.toml", tmp_path / "two", lambda started: Stopping(1))
    assert rows(tmp_path / "one")[:1] == rows(tmp_path / "two")
    table = open_study(tmp_path / "one")
    assert set(table["status"]) == {"done"}, table["reason"].tolist()
    alpha = next(name for name in table.columns if re.search(r"alpha_u.value$|alpha_u.0$", name))
    assert table[alpha][1] / table[alpha][0] == pytest.approx(1.5, rel=0.05)


def blocks(language: str) -> list[str]:
    text = (ROOT / "docs" / "study.md").read_text()
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


def test_the_example_of_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    function, reading = blocks("python")[:2]
    (tmp_path / "damping.py").write_text(function)
    (tmp_path / "damping.toml").write_text(next(b for b in blocks("toml") if "damping:overshoot" in b))
    ran(tmp_path / "damping.toml", tmp_path / "damping")
    monkeypatch.chdir(tmp_path)
    scope: dict[str, object] = {}
    exec(reading, scope)
    table = scope["table"]
    assert len(table) == 9  # type: ignore[arg-type]
    assert table["small"].tolist() == [z > 0.5912 for z in table["argument.zeta"]]  # type: ignore[index]


def test_the_first_study_of_the_page_is_accepted(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, next(b for b in blocks("toml") if "relay-output" in b and "title" in b))
    check_plan(plan, parse)
    assert len(plan) == 24


def test_a_missing_dask_is_reported_with_the_extra_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    plan_of(tmp_path, 'title = "t"\ndo = "builtins:dict"\n')
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main(["study", "run", str(tmp_path / "study.toml")]) == 2
    assert "pip install 'gcs-autotune[study]'" in capsys.readouterr().err


def test_every_job_is_available() -> None:
    assert set(JOBS) == {"tune", "experiment", "fly", "identify", "diagnose"}
    with pytest.raises(UsageError):
        list(commands_of("tune", {"seed": 1}, Path(), Path()))
