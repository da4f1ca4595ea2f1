"""`tune actuators`: parameters from the measured thrust, proved ahead and astern, restored if not better."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs_autotune.cli import main
from gcs_autotune.errors import AutotuneError, BadFile, NotInformative, OperatorStopped, ParameterMissing, WrongVehicle
from gcs_autotune.link import Journal, Parameters
from gcs_autotune.thrusters import PullTest
from gcs_autotune.workflow import Unattended, experiment, restore_run, tune_actuators
from sitl.effects import parse_effect

from .sitl_harness import WHEN, Answers, Ear, Later, Moored, SitlHarness, StopsAt

LEVELS = np.array([-1.0, -0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75, 1.0])


def boat(tmp_path: Path, name: str = "blueboat", *effects: str, **options: Any) -> SitlHarness:
    return SitlHarness(tmp_path, name, effects=[parse_effect(text) for text in effects], **options)


def actuators(harness: SitlHarness, operator: Any = None, **changes: Any) -> Any:
    return tune_actuators(harness.settings("speed", **changes), operator or Unattended(), Ear(harness.said), WHEN)


def written(harness: SitlHarness) -> dict[str, float]:
    return {n: v for n, v in harness.vehicle.parameters.values.items() if v != harness.parameters[n]}


def pulls(force: Any, command: Any = LEVELS, unit: str = "1") -> PullTest:
    return PullTest("pulls", np.asarray(command, dtype=float), np.asarray(force, dtype=float), unit)


@pytest.mark.slow
def test_a_dead_zone_and_weak_astern_thrust_are_corrected_and_proved(tmp_path: Path) -> None:
    harness = boat(tmp_path, "blueboat", "dead-zone@X.width=0.1")
    story = actuators(harness)
    assert story.ending == "kept"
    assert story.thrust_after.departure < 0.2 * story.thrust_before.departure
    new = written(harness)
    assert new["MOT_THR_MIN"] == pytest.approx(10.0, abs=2.0)
    assert new["MOT_THST_ASYM"] == pytest.approx(2.0, rel=0.1)
    assert new["CRUISE_THROTTLE"] == pytest.approx(33.0, abs=3.0)
    assert set(new) == {"MOT_THR_MIN", "MOT_THST_ASYM", "CRUISE_THROTTLE"}
    assert not harness.vehicle.autopilot.armed
    assert Journal.read(harness.directory / "journal.jsonl").is_settled
    summary = json.loads((harness.directory / "summary.json").read_text())
    assert summary["thrust"]["after"]["departure"] == pytest.approx(story.thrust_after.departure)
    page = (harness.directory / "report.html").read_text()
    assert "Thrust at each command" in page and "Thrust (measured): departs from the command by" in page
    announced = " ".join(harness.said)
    assert announced.index("will write some of MOT_THR_MIN") < announced.index("State before the run")


@pytest.mark.slow
def test_a_tuned_vehicle_is_left_unchanged_by_another_tune(tmp_path: Path) -> None:
    parameters = {"MOT_THR_MIN": 10.0, "MOT_THST_ASYM": 2.0, "CRUISE_THROTTLE": 33.0}
    harness = boat(tmp_path, "blueboat", "dead-zone@X.width=0.1", parameters=parameters)
    story = actuators(harness)
    assert story.ending == "unchanged"
    assert "no parameter makes it clearly more proportional" in story.reason
    harness.assert_as_found()


def test_a_dry_run_writes_nothing(tmp_path: Path) -> None:
    harness = boat(tmp_path)
    story = actuators(harness, dry_run=True)
    assert story.ending == "dry-run"
    assert {c.parameter: c.new for c in story.changes}["MOT_THST_ASYM"] == pytest.approx(2.0, rel=0.1)
    harness.assert_as_found()


@pytest.mark.slow
def test_parameters_that_are_not_better_are_restored(tmp_path: Path) -> None:
    harness = boat(tmp_path)
    story = actuators(harness, pull_test=pulls(LEVELS * np.abs(LEVELS)))  # of another thruster
    assert story.ending == "restored"
    assert story.thrust_after.departure > story.thrust_before.departure
    harness.assert_as_found()


@pytest.mark.slow
def test_a_pull_test_gives_the_parameters(tmp_path: Path) -> None:
    harness = boat(tmp_path)
    force = np.where(LEVELS > 0.0, 55.2, 27.6) * LEVELS
    story = actuators(harness, pull_test=pulls(force))
    assert story.ending == "kept"
    assert written(harness) == {"MOT_THST_ASYM": pytest.approx(2.0, rel=0.01)}


@pytest.mark.slow
def test_a_declined_change_is_not_written(tmp_path: Path) -> None:
    harness = boat(tmp_path)
    operator = Answers(True, False)
    story = actuators(harness, operator, simulated=False)
    assert story.ending == "declined"
    assert "MOT_THST_ASYM 1 -> " in operator.questions[1]
    harness.assert_as_found()


@pytest.mark.slow
def test_a_stop_during_the_proof_restores_everything(tmp_path: Path) -> None:
    harness = boat(tmp_path)

    class Stops(StopsAt):
        def stop_requested(self) -> bool:
            return any("new gains written" in text for text in harness.said) and super().stop_requested()

    with pytest.raises(OperatorStopped):
        actuators(harness, Stops(100))
    harness.assert_restored()


@pytest.mark.slow
def test_an_interrupted_run_is_restored(tmp_path: Path) -> None:
    def meddling(t: float, message: Any) -> Iterable[Any]:
        if any("new gains written" in text for text in harness.said):
            harness.peer.deaf = True
            return ()
        return (message,)

    harness = SitlHarness(tmp_path, "blueboat", meddling)
    with pytest.raises(AutotuneError):
        actuators(harness, patience=0.0)
    assert written(harness)
    assert not Journal.read(harness.directory / "journal.jsonl").is_settled
    restore_run(Moored(peer=Later(harness.server)), harness.directory, Unattended(), Ear(harness.said))
    assert not written(harness)
    assert Journal.read(harness.directory / "journal.jsonl").is_settled


@pytest.mark.slow
def test_a_rudder_offset_on_both_courses_is_trimmed(tmp_path: Path) -> None:
    harness = boat(tmp_path, "charlie", "input-bias@yaw.bias=0.1")
    story = actuators(harness, dry_run=True)
    trim = {c.parameter: c.new for c in story.changes}["SERVO1_TRIM"]
    assert trim == pytest.approx(1500.0 - 500.0 * (0.1 + 0.015), abs=15.0)


def test_an_rov_is_refused(tmp_path: Path) -> None:
    with pytest.raises(WrongVehicle, match="no parameter corrects"):
        actuators(SitlHarness(tmp_path, "bluerov2"))


def test_a_firmware_without_the_parameters_is_refused(tmp_path: Path) -> None:
    harness = boat(tmp_path)
    with pytest.MonkeyPatch.context() as patch:
        real = Parameters.read_existing
        patch.setattr(
            Parameters,
            "read_existing",
            lambda self, names, **how: {n: v for n, v in real(self, names, **how).items() if n != "MOT_THST_EXPO"},
        )
        with pytest.raises(ParameterMissing, match="no parameter MOT_THST_EXPO"):
            actuators(harness)
    harness.assert_untouched()


@pytest.mark.parametrize(
    ("bad", "error", "words"),
    [
        (lambda: pulls([*range(-4, 3), 1, 0]), NotInformative, "not monotonous: from command 0.5 to 0.75"),
        (lambda: pulls([1.0], [0.5]), NotInformative, "only 1 different commands"),
        (lambda: pulls(LEVELS, 1000.0 * LEVELS, "rad/s"), BadFile, r"in \[rad/s\].*command\[1\]"),
        (lambda: pulls(LEVELS, 100.0 * LEVELS), BadFile, "above full output"),
    ],
)
def test_an_unusable_pull_test_is_refused_before_anything_moves(
    bad: Any, error: type[Exception], words: str, tmp_path: Path
) -> None:
    harness = boat(tmp_path)
    with pytest.raises(error, match=words):
        actuators(harness, pull_test=bad())
    assert not harness.found
    harness.assert_untouched()


def test_a_pull_test_in_pulses_gives_trim_and_end_points(tmp_path: Path) -> None:
    harness = boat(tmp_path)
    pwm = np.arange(900.0, 2101.0, 50.0)
    reach = np.clip(pwm - 1520.0, -400.0, 400.0)  # an ESC with its own middle, from 1120 to 1920
    story = actuators(harness, pull_test=pulls(0.1 * np.sign(reach) * np.maximum(np.abs(reach) - 20.0, 0.0), pwm, "us"))
    new = {c.parameter: c.new for c in story.changes}
    assert new["SERVO1_TRIM"] == new["SERVO3_TRIM"] == pytest.approx(1520.0, abs=3.0)
    assert new["SERVO1_MAX"] == pytest.approx(1920.0, abs=50.0)
    assert story.ending == "restored", "the thrusters of this boat have another middle"
    harness.assert_as_found()


@pytest.mark.slow
def test_an_experiment_uses_the_thrust_curve_of_a_pull_test(tmp_path: Path) -> None:
    harness = boat(tmp_path)
    curve = np.sign(LEVELS) * (0.7 * np.abs(LEVELS) + 0.3 * LEVELS**2)
    fit = experiment(harness.settings("speed", pull_test=pulls(10.0 * curve)), Unattended(), Ear(harness.said), WHEN)
    assert fit.extra["thrust_curve"]["square"] == pytest.approx(0.3, abs=0.02)


def test_an_experiment_with_an_rov_accepts_no_pull_test(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "bluerov2")
    with pytest.raises(WrongVehicle, match="--pull-test is for the throttle of a boat"):
        experiment(harness.settings("surge", pull_test=pulls(LEVELS)), Unattended(), Ear(harness.said), WHEN)


@pytest.mark.parametrize(
    ("axis", "table", "words"),
    [
        ("actuators", "command[1],force[V]\n0,0\n", r"force\[V\]|\[V\]"),
        ("actuators", "command[1],force[N]\n0.5,3\n", "only 1 different commands"),
        ("heading", "command[1],force[N]\n0.5,3\n", "`tune heading` does not use --pull-test"),
    ],
)
def test_the_command_line_refuses_a_bad_table(
    axis: str, table: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "pulls.csv").write_text(table)
    line = ["tune", axis, "--connect", "sitl:blueboat", "--quiet", "--pull-test", str(tmp_path / "pulls.csv")]
    assert main([*line, "--out", str(tmp_path / "run")]) != 0
    assert re.search(words, capsys.readouterr().err)
