"""Plans of several runs: read with the nearest spellings, flown in order, gone on with, their model proved unseen."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from gcs_autotune.errors import BadFile, OperatorStopped, PreconditionFailed, UsageError, WrongVehicle
from gcs_autotune.trial import load_trial
from gcs_autotune.workflow import PLAN_FILE, FlightPlan, Unattended, fly_plan, load_flight_plan

from .sitl_harness import SLOW_LOOP, WHEN, Answers, Ear, Later, Moored, SitlHarness
from .test_fly import Stops

ZIG_ZAG = '[[run]]\nmanoeuvre = "zig-zag"\nheading = 10\nexecutes = 3\n'


@pytest.fixture(scope="module", autouse=True)
def without_pictures() -> None:
    """Plot the figures here: the page is checked."""


def plan(harness: SitlHarness, text: str) -> FlightPlan:
    path = harness.directory.parent / "plan.toml"
    path.write_text(text)
    return load_flight_plan(path, harness.common(), None, None)


def test_levels_sides_and_repeats_are_runs_with_unique_names_in_a_fixed_order(tmp_path: Path) -> None:
    text = (
        'title = "two"\n[defaults]\nfull-rudder = 30\nheading = 20\nexecutes = 3\n'
        '[[run]]\nmanoeuvre = "zig-zag"\nrudder = [10, 20]\nsides = "both"\n'
        '[[run]]\nmanoeuvre = "stopping"\nastern = 0.5\nrepeat = 2\nhold-out = true\n'
    )
    read = plan(SitlHarness(tmp_path), text)
    assert read.names == (
        "zig-zag-rudder10", "zig-zag-rudder10-port", "zig-zag-rudder20", "zig-zag-rudder20-port",
        "stopping-astern0.5-1", "stopping-astern0.5-2",
    )  # fmt: skip
    first = read.runs[1]
    assert first.side == -1
    assert first.options["rudder"] == pytest.approx(math.radians(10.0))
    assert first.options["full-rudder"] == pytest.approx(math.radians(30.0))
    assert [run.held_out for run in read.runs] == [False] * 4 + [True] * 2
    assert plan(SitlHarness(tmp_path), text.replace('"both"', '["port", "starboard"]')).names[:2] == (
        "zig-zag-rudder10-port",
        "zig-zag-rudder10",
    )
    shuffled = [plan(SitlHarness(tmp_path), 'order = "shuffled"\n' + text).names for _ in range(2)]
    assert shuffled[0] == shuffled[1] != read.names
    assert sorted(shuffled[0]) == sorted(read.names)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[[run]]\nmanoeuvre = 'zigzag'\n", "run 1: unknown manoeuvre 'zigzag'. Did you mean zig-zag?"),
        ("[[run]]\nmanoeuvre = 'zig-zag'\nheadin = 3\n", "zig-zag: unknown key 'headin'. Did you mean heading?"),
        ("[[run]]\nmanoeuvre = 'spiral'\nheading = 3\n", "spiral: unknown key 'heading'"),
        ("[[run]]\nmanoeuvre = 'zig-zag'\nheading = 100\n", "run 1: heading: 100 is out of range"),
        (
            "[[run]]\nmanoeuvre = 'zig-zag'\nheading = 'ten'\n",
            "heading must be a number or a list of numbers, not 'ten'",
        ),
        ("[[run]]\nmanoeuvre = 'zig-zag'\nrudder = 10\n", "Add --full-rudder"),
        ("[[run]]\nmanoeuvre = 'zig-zag'\nsides = 'left'\n", "unknown side 'left'"),
        ("[[run]]\nmanoeuvre = 'zig-zag'\nsides = ['port', 1]\n", "unknown side '1'"),
        ("[[run]]\nmanoeuvre = 'step'\n", "step is not flown by itself, but by tune AXIS"),
        ("[[run]]\nheading = 3\n", "no manoeuvre given"),
        ("[conditions]\nclam = true\n" + ZIG_ZAG, "[conditions]: unknown key 'clam'. Did you mean calm?"),
        ("[conditions]\ncalm = 1\n" + ZIG_ZAG, "calm must be true or false"),
        ("[conditions]\nmin-depth = -1\n" + ZIG_ZAG, "min-depth: -1 is out of range"),
        ("[defaults]\nexecute = 3\n" + ZIG_ZAG, "[defaults]: unknown key 'execute'. Did you mean executes"),
        ("oder = 'listed'\n" + ZIG_ZAG, "the plan: unknown key 'oder'. Did you mean order?"),
        ("order = 'random'\n" + ZIG_ZAG, "unknown order 'random'"),
        ("title = 'empty'\n", "This plan contains 0"),
        ("[[run]\n", "cannot be read as a plan"),
        (ZIG_ZAG + "repeat = 101\n", "repeat must be a whole number from 1 to 100"),
        (ZIG_ZAG + "repeat = true\n", "repeat must be a whole number from 1 to 100"),
        (ZIG_ZAG.replace("10", "true"), "heading must be a number or a list of numbers"),
        (ZIG_ZAG.replace("10", '"10"'), "heading must be a number or a list of numbers"),
        (ZIG_ZAG.replace("10", "[10, 20]") + "throttle = 0.5\nrepeat = 51\n", "make 102 runs"),
        (
            ZIG_ZAG.replace("10", str([10 + k / 1000 for k in range(2000)]))
            + "throttle = "
            + str([0.2 + k / 10000 for k in range(2000)]),
            "run 1: its lists, sides and repeats make 4e+06 runs",
        ),
    ],
)
def test_a_plan_error_is_reported_with_its_name_and_place(text: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(BadFile) as caught:
        plan(SitlHarness(tmp_path), text)
    assert words in str(caught.value)
    assert "plan.toml" in str(caught.value)


def fly(harness: SitlHarness, read: FlightPlan, operator: Any = None, **changes: Any) -> Any:
    observer = operator or Ear(harness.said)
    return fly_plan(read, replace(harness.common(), **changes), operator or Unattended(), observer, WHEN)


THREE = ZIG_ZAG + ZIG_ZAG.replace("10", "15") + '[[run]]\nmanoeuvre = "doublets"\nduration = 12\nsteering = 0.4\n'


@pytest.mark.slow
def test_a_stopped_plan_is_resumed_and_its_model_is_tested_on_held_out_data(
    tmp_path: Path,
) -> None:
    harness = SitlHarness(tmp_path, "blueboat")
    three = plan(harness, THREE)
    with pytest.raises(OperatorStopped):
        fly(harness, three, Stops(harness.said, "N +40 %"))
    harness.assert_neutral()
    assert not harness.vehicle.autopilot.armed
    assert harness.mode == harness.found
    (way_on,) = [text for text in harness.said if "--resume" in text]
    assert way_on.startswith("2 of 3 runs of the plan are flown. To fly the rest")
    resume = json.loads((harness.directory / "summary.json").read_text())["resume"]
    assert way_on == f"{resume['text']} {resume['command']}"
    assert any(text.startswith("coming back: returned to ") for text in harness.said)

    announced: list[str] = []
    again = harness.directory.parent / "again"
    common = replace(
        harness.common(), connection=Moored(peer=Later(harness.server)), directory=again, resume=harness.directory
    )
    result = fly_plan(
        load_flight_plan(harness.directory / PLAN_FILE, common, None, None), common, Unattended(), Ear(announced), WHEN
    )
    assert "1 run (2 already flown): doublets" in " ".join(announced)
    flown = [load_trial(path) for path in sorted((again / "trials").glob("*.csv"))]
    assert [t.name for t in flown if t.purpose == "identification"] == [*three.names]
    (model,) = result.models
    assert model.held_out == ("doublets-duration12-steering0.4",)
    assert model.unseen.fit_percent > 85.0
    assert {s.run for s in result.sheets} == set(three.names[:2])
    page = (again / "report.html").read_text()
    for words in ("Held-out prediction", "Runs", "end", three.names[0], "Track"):
        assert words in page
    assert json.loads((again / "model.json").read_text())

    other = replace(common, directory=again.with_name("third"), throttle=0.3)
    with pytest.raises(UsageError, match="other settings"):
        fly_plan(three, other, Unattended(), Ear([]), WHEN)
    twin = SitlHarness(tmp_path / "twin", "charlie")
    with pytest.raises((WrongVehicle, PreconditionFailed), match=r"another vehicle|other parameters"):
        fly(twin, three, resume=harness.directory)
    assert not twin.vehicle.autopilot.armed


@pytest.mark.slow
def test_a_completed_plan_is_evaluated_again_without_asking_or_moving(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "bluerov2", **SLOW_LOOP)
    text = "".join(
        f"[[run]]\nmanoeuvre = 'doublets'\nforce = '{force}'\nduration = 8\nsteering = 0.3\n" for force in "ZN"
    )
    fly(harness, plan(harness, text))
    checks = "will move: in heave and yaw a small pulse in each direction to check the response, then 2 runs: doublets"
    assert any(announced.startswith(checks) for announced in harness.said)
    announced: list[str] = []
    common = replace(
        harness.common(),
        connection=Moored(peer=Later(harness.server), simulated=False),
        directory=tmp_path / "again",
        resume=harness.directory,
    )
    nobody = Answers()
    result = fly_plan(
        load_flight_plan(harness.directory / PLAN_FILE, common, None, None), common, nobody, Ear(announced), WHEN
    )
    assert nobody.questions == []
    assert "every run is complete. Nothing is armed or moved; figures and models are computed again" in announced
    assert not any(text.startswith("State before the run: mode") for text in announced)
    assert {model.fit.dof for model in result.models} == {"heave", "yaw"}


@pytest.mark.slow
def test_the_conditions_are_met_before_each_run(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "bluerov2", **SLOW_LOOP)
    text = "[conditions]\ncalm = true\nmin-depth = 3.0\n[[run]]\nmanoeuvre = 'doublets'\nduration = 6\nsteering = 0.3\n"
    result = fly(harness, plan(harness, text))
    assert result.trial["z"].values.min() > 2.8
    kinds = [load_trial(p).meta["manoeuvre"] for p in sorted((harness.directory / "trials").glob("*.csv"))]
    assert kinds == ["sign-check", "dive", "calm-check", "doublets"]
    boat = SitlHarness(tmp_path / "boat")
    with pytest.raises(WrongVehicle, match="this vehicle floats"):
        fly(boat, plan(SitlHarness(tmp_path), "[conditions]\nmin-depth = 1\n" + ZIG_ZAG))
