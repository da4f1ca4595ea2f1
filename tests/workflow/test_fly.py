"""A zig-zag flown over MAVLink: figures, model, preview; the vehicle is restored after every ending."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.zig_zag_accuracy import truth
from gcs_autotune.errors import NotAchieved, OperatorStopped, PreconditionFailed, UsageError, WrongVehicle
from gcs_autotune.identify import ModelFile, fit_axis, load_model
from gcs_autotune.logs import load_runs
from gcs_autotune.manoeuvres import Envelope
from gcs_autotune.seatrials import ship_figures
from gcs_autotune.workflow import FlySettings, Unattended, fly

from .sitl_harness import SLOW_LOOP, WHEN, Answers, Ear, SitlHarness

DEG = math.pi / 180.0
PAIR = {"heading": 20.0 * DEG, "rudder": 20.0 * DEG, "full-rudder": 30.0 * DEG}
SHARE = {"heading": 20.0 * DEG, "steering": 0.6}


class Stops(Ear):
    """Observes, and stops as soon as a phase is under way."""

    def __init__(self, announced: list[str], phase: str) -> None:
        super().__init__(announced)
        self.phase, self.wants = phase, False

    def update(self, progress: Any) -> None:
        self.wants = self.wants or progress.manoeuvre == self.phase

    def stop_requested(self) -> bool:
        return self.wants

    def ask(self, question: str, while_waiting: Any) -> bool:
        return True


def flown(harness: SitlHarness, options: dict[str, float] = PAIR, name: str = "zig-zag", **more: Any) -> Any:
    common = {k: more.pop(k) for k in ("throttle", "envelope", "simulated") if k in more}
    observer, operator = more.pop("observer", None), more.pop("operator", None)
    only_preview = more.pop("only_preview", False)
    settings = FlySettings(name, harness.common(**common), options, **more)
    ear = observer or Ear(harness.said)
    return fly(settings, operator or Unattended(), ear, WHEN, only_preview=only_preview)


def calm(harness: SitlHarness) -> SitlHarness:
    """Take all noise off the sensors."""
    sensors = harness.vehicle._sensors
    sensors._draws = tuple(lambda: 0.0 for _ in sensors._draws)
    return harness


def figures(run: Any) -> dict[str, float]:
    (sheet,) = ship_figures(run)
    return {f.slug: f.reading.value for f in sheet.figures}


@pytest.fixture(scope="module", autouse=True)
def without_pictures() -> None:
    """Plot the figures here: the page is checked."""


@pytest.fixture(scope="module")
def charlie(tmp_path_factory: pytest.TempPathFactory) -> tuple[SitlHarness, Any]:
    harness = SitlHarness(tmp_path_factory.mktemp("charlie"))
    return harness, flown(harness)


@pytest.mark.slow
def test_nomotos_gain_of_a_flown_zig_zag_agrees_with_the_vehicles_equations(
    charlie: tuple[SitlHarness, Any],
) -> None:
    (sheet,) = charlie[1].sheets
    per_output, T = truth("charlie", 20.0 / 30.0)
    assert sheet["K"].reading.value == pytest.approx(per_output / (30.0 * DEG), rel=0.03)
    assert sheet["T"].reading.value == pytest.approx(T, rel=0.05)


@pytest.mark.slow
def test_figures_read_from_the_run_directory_agree_with_a_run_without_noise(
    charlie: tuple[SitlHarness, Any], tmp_path: Path
) -> None:
    harness, _ = charlie
    (run,) = load_runs(harness.directory)
    assert run.purpose == "identification"
    read = figures(run)
    quiet = calm(SitlHarness(tmp_path))
    true = flown(quiet).trial
    psi, at = true["psi"], [m.t for m in true.marks if m.kind == "execute"]
    side = 1.0
    for k, name in ((1, "first-overshoot"), (2, "second-overshoot")):
        after = psi.between(at[k], at[k + 1]).values
        overshoot = float((side * after).max()) - side * float(np.interp(at[k], psi.t, psi.values))
        assert read[name] == pytest.approx(overshoot, abs=1.0 * DEG)
        side = -side
    assert read["helm"] == pytest.approx(20.0 * DEG, rel=0.02)
    assert read["heading"] == pytest.approx(20.0 * DEG, abs=1.5 * DEG)


@pytest.mark.slow
def test_identify_recovers_the_hidden_model_from_the_run_directory(
    charlie: tuple[SitlHarness, Any],
) -> None:
    harness, result = charlie
    fit = fit_axis(load_runs(harness.directory), dof="yaw")
    n2 = (0.8 * 8.0) ** 2
    alpha, beta = (np.interp(n2, [36.0, 49.0], pair) for pair in ([8.2, 9.155], [2.465, 2.745]))
    assert 1.0 / fit.model.beta == pytest.approx(math.radians(30.0) / beta, rel=0.03)
    assert fit.model.alpha / fit.model.beta == pytest.approx(alpha / beta, rel=0.03)
    assert load_model(harness.directory / "model.json").model is not None
    assert result.fit.model.beta == pytest.approx(fit.model.beta, rel=0.01)


def test_everything_is_announced_and_the_vehicle_is_restored(charlie: tuple[SitlHarness, Any]) -> None:
    harness, result = charlie
    announced = " ".join(harness.said)
    for words in (
        "m from the start",
        "Go ahead?",
        "of a battery that lasts an hour",
        "sign check ",
        "write no parameter",
    ):
        assert words in announced
    assert announced.index("will move") < announced.index("Go ahead?") < announced.index("State before the run: mode")
    harness.assert_restored()
    page = (harness.directory / "report.html").read_text()
    assert "20/20 zig-zag" in page
    assert json.loads((harness.directory / "summary.json").read_text()) == {
        "title": "fly zig-zag",
        "when": WHEN,
        "ending": "completed",
        "reason": "",
    }
    assert "predicted" in page
    assert result.remarks == []


def test_authority_is_suggested_only_if_it_has_a_figure(charlie: tuple[SitlHarness, Any], tmp_path: Path) -> None:
    """The turns of a boat with two thrusters need a model of its speed, too."""
    blueboat = SitlHarness(tmp_path, "blueboat")
    flown(blueboat, SHARE)
    pages = [(harness.directory / "report.html").read_text() for harness in (charlie[0], blueboat)]
    assert [page.count("gcs-autotune authority") > 0 for page in pages] == [True, False]
    assert all("gcs-autotune diagnose" in page for page in pages)


def test_an_rov_flies_a_zig_zag_with_its_yaw_moment_and_holds_its_depth(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "bluerov2", **SLOW_LOOP)
    result = flown(harness, SHARE, side=-1)
    first = next(m for m in result.trial.marks if m.kind == "execute")
    assert first.detail["N"] == -0.6
    assert figures(result.trial)["first-overshoot"] > 0.0
    assert np.ptp(result.trial["z"].values) < 0.5
    assert not harness.vehicle.autopilot.armed


@pytest.mark.parametrize("phase", ["pulse", "execute 2"])
def test_a_stop_in_any_phase_restores_the_vehicle_and_keeps_the_record(phase: str, tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path)
    observer = Stops(harness.said, phase)
    with pytest.raises(OperatorStopped):
        flown(harness, observer=observer, operator=observer)
    harness.assert_restored()
    assert list((harness.directory / "trials").glob("*.csv"))
    summary = json.loads((harness.directory / "summary.json").read_text())
    assert (summary["title"], summary["ending"]) == ("fly zig-zag", "aborted")
    assert summary["reason"]


@pytest.mark.slow
def test_a_heading_that_is_never_reached_is_reported_with_a_cure(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path)
    with pytest.raises(NotAchieved, match=r"deg required\. Use a smaller --heading"):
        flown(harness, {"heading": 90.0 * DEG, "steering": 0.02})
    harness.assert_neutral()
    assert not harness.vehicle.autopilot.armed


def test_a_model_preview_that_leaves_the_envelope_is_refused_before_arming(
    charlie: tuple[SitlHarness, Any], tmp_path: Path
) -> None:
    model: ModelFile = load_model(charlie[0].directory / "model.json")
    harness = SitlHarness(tmp_path)
    with pytest.raises(PreconditionFailed, match="distance from start"):
        flown(harness, model=model, envelope=Envelope(distance=15.0))
    assert harness.found == ""
    assert not harness.vehicle.autopilot.armed


def test_a_model_preview_predicts_the_flown_run(charlie: tuple[SitlHarness, Any], tmp_path: Path) -> None:
    flown_once, result = charlie
    model = load_model(flown_once.directory / "model.json")
    harness = SitlHarness(tmp_path)
    seen = flown(harness, model=model, only_preview=True)
    assert any("would use about " in text for text in harness.said)
    assert seen.preview.trouble == ""
    assert seen.preview.seconds == pytest.approx(result.trial.duration, rel=0.15)  # it had way on already
    assert seen.preview.turned == pytest.approx(float(np.ptp(result.trial["psi"].values)), rel=0.1)
    assert "Track" in seen.page.read_text()


def test_a_no_arms_nothing_and_unsuitable_options_are_refused(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path)
    with pytest.raises(OperatorStopped, match="Nothing was armed"):
        flown(harness, simulated=False, operator=Answers(False))
    assert not harness.vehicle.autopilot.armed
    with pytest.raises(UsageError, match="tune AXIS"):
        FlySettings("step", harness.common())
    with pytest.raises(UsageError, match="has no option --duration"):
        FlySettings("zig-zag", harness.common(), {"duration": 5.0})
    with pytest.raises(UsageError, match="--full-rudder"):
        FlySettings("zig-zag", harness.common(), {"rudder": 0.3})
    (tmp_path / "twin").mkdir()
    with pytest.raises(UsageError, match="has no rudder"):
        flown(SitlHarness(tmp_path / "twin", "blueboat"), PAIR)
    (tmp_path / "boat").mkdir()
    with pytest.raises(WrongVehicle, match="needs Z, which"):
        flown(SitlHarness(tmp_path / "boat"), {}, "steps", force="Z")
