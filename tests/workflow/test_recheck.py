"""Is the old tune still good? Verdicts, the last tune found, the step after the relays, and what people are shown."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs_autotune.axes import AXES
from gcs_autotune.design import StepMetrics
from gcs_autotune.errors import PreconditionFailed
from gcs_autotune.identify import Doubt
from gcs_autotune.identify.open_loop import Reading
from gcs_autotune.manoeuvres import Envelope
from gcs_autotune.observer import SilentObserver
from gcs_autotune.report import recheck_document
from gcs_autotune.report.toolkit.document import Figure as PageFigure
from gcs_autotune.report.toolkit.terminal import render_text
from gcs_autotune.seatrials import Figure, Sheet
from gcs_autotune.trial import Channel, Mark, Trial
from gcs_autotune.workflow import FlightPlan, FlySettings, Unattended, recheck
from gcs_autotune.workflow.recheck import LastTune, LoopNumbers, Recheck, last_tune, verdict_of

from .conftest import with_pictures
from .sitl_harness import WHEN, Ear, SitlHarness


def sheet(zeta: tuple[float, float], over: tuple[float, float], *doubts: Doubt, settling: float = 4.0) -> Sheet:
    figures = {
        "damping": Reading(*zeta),
        "overshoot": Reading(*over),
        "rise": Reading(0.5 * settling, math.nan, "s"),
        "settling": Reading(settling, math.nan, "s"),
    }
    return Sheet("run", "set-point-relay", "loop", tuple(Figure(n, n, r) for n, r in figures.items()), "", doubts)


def judged(of: Sheet | None, tune: LoopNumbers | None = None, **more: Any) -> Any:
    check = Recheck(AXES["heading"], Path("runs"), SilentObserver())
    check.sheet = of
    check.tune = None if tune is None else LastTune(Path("runs/a"), WHEN, tune, {})
    for name, value in more.items():
        setattr(check, name, value)
    return verdict_of("heading", check)


LIMITED = Doubt("saturated", "at its limit", "smaller")
GOOD, TUNED = sheet((0.7, 0.05), (0.05, 0.02)), LoopNumbers(0.04, 1.8, 3.5)


@pytest.mark.parametrize(
    ("of", "tune", "kind", "tone"),
    [
        (GOOD, TUNED, "good", "good"),
        (GOOD, None, "good", "good"),
        (sheet((0.45, 0.05), (0.19, 0.02)), TUNED, "degraded", "bad"),
        (sheet((0.7, 0.05), (0.05, 0.02), settling=9.0), TUNED, "degraded", "bad"),
        (sheet((0.2, 0.05), (0.5, 0.1)), None, "poorly damped", "bad"),
        (sheet((0.6, 0.05), (0.22, 0.05)), None, "undecided", "neutral"),
        (sheet((0.7, 0.4), (0.05, 0.02)), None, "not identifiable", "neutral"),
        (sheet((0.7, 0.05), (0.05, 0.02), LIMITED), TUNED, "not identifiable", "neutral"),
        (None, TUNED, "not identifiable", "neutral"),
    ],
)  # fmt: skip
def test_each_loop_has_its_verdict_and_colour(of: Sheet | None, tune: LoopNumbers | None, kind: str, tone: str) -> None:
    found = judged(of, tune)
    assert (found.kind, found.tone) == (kind, tone)
    assert found.text.endswith(".")
    assert math.isnan(found.now.rise) == (kind == "not identifiable"), "no number of a loop that is not known"


def test_a_well_damped_loop_with_a_large_overshoot_is_not_called_poorly_damped() -> None:
    assert judged(sheet((0.6, 0.05), (0.3, 0.02))).text.startswith("Large overshoot: ")
    assert judged(sheet((0.2, 0.05), (0.5, 0.1))).text.startswith("Poorly damped: ")


def test_the_terminal_shows_the_numbers_with_those_of_the_tune_and_no_coefficients() -> None:
    shown = render_text(recheck_document(judged(GOOD, TUNED, changed=("ATC_STR_RAT_P",))))
    assert "tune of" in shown and "step overshoot" in shown and "5 ± 2" in shown
    assert "Gains changed since the tune: ATC_STR_RAT_P" in shown
    assert "a_1" not in shown and "b_1" not in shown


def stepped(overshoot: float, itae: float, settling: float = 3.5) -> StepMetrics:
    return StepMetrics(itae, overshoot, 1.8, settling, 0.0, 0.1, span=12.0)


@pytest.mark.parametrize(
    ("now", "then", "kind", "text"),
    [
        (stepped(0.05, 2.1), stepped(0.04, 2.0), "good", "not clearly worse than after its tune"),
        (stepped(0.05, 3.1), stepped(0.04, 2.0), "degraded", "tracking error of a step is 1.6 times that after"),
        (stepped(0.16, 2.1), stepped(0.04, 2.0), "degraded", "overshoots by 16 % (after the tune: 4 %)"),
        (stepped(0.25, 2.1), stepped(0.24, 2.0), "poorly damped", "Large overshoot"),
        (stepped(0.05, 2.0, math.nan), stepped(0.04, 2.0), "good", "not clearly worse"),
        (stepped(0.05, 2.0), None, "good", "no earlier step of a tune"),
        (stepped(0.05, 2.0, math.nan), None, "undecided", "does not settle to within 5 % in 12 s"),
    ],
)  # fmt: skip
def test_a_flown_step_is_compared_with_that_of_the_tune(
    now: StepMetrics, then: StepMetrics | None, kind: str, text: str
) -> None:
    found = judged(None, TUNED, step=now, step_then=then)
    assert found.kind == kind and text in found.text
    assert found.now.itae == now.itae and "did not determine the damping" in found.notes[0]


def test_the_damping_that_relays_show_stands_beside_the_figures_of_a_step() -> None:
    found = judged(GOOD, TUNED, step=stepped(0.05, 2.1), step_then=stepped(0.04, 2.0))
    assert found.now.damping == 0.7 and found.now.overshoot == 0.05 and not found.notes
    assert "ITAE per unit step" in render_text(recheck_document(found))
    late = judged(GOOD, TUNED, step=stepped(0.05, 2.0, math.nan), step_then=stepped(0.04, 2.0))
    assert "not in 12 s" in render_text(recheck_document(late))


def test_the_plot_of_a_speed_shows_the_speed_itself() -> None:
    t = np.arange(0.0, 20.0, 0.1)
    speed = np.where(t < 10.0, 1.0, 1.5)
    marks = (Mark(5.0, "target", {"value": 1.0}), Mark(10.0, "target", {"value": 1.5}))
    run = Trial("step", {"u": Channel("u", "m/s", t, speed)}, marks=marks)
    page = recheck_document(replace(judged(GOOD, TUNED), axis="speed"), "", "", run)
    (figure,) = (part for section in page.sections for part in section.parts if isinstance(part, PageFigure))
    flown = figure.draw().axes[0].lines[0].get_ydata()
    assert (min(flown), max(flown)) == (1.0, 1.5)


def noted(folder: Path, name: str, when: str, board: str, **summary: Any) -> None:
    run = folder / name
    run.mkdir()
    after = {"overshoot": 0.1, "rise": 1.0, "settling": None}
    reported = {"axis": "heading", "kept": True, "when": when, "metrics": {"after": after}, **summary}
    (run / "summary.json").write_text(json.dumps(reported))
    (run / "setting_out.json").write_text(json.dumps({"vehicle": {"uid": board}, "fingerprint": {}}))
    (run / "parameters_after.json").write_text(json.dumps({"P": 0.3}))


def test_the_last_tune_is_the_newest_kept_one_of_this_vehicle(
    tmp_path: Path,
) -> None:
    noted(tmp_path, "a", "2026-01-01", "mine")
    noted(tmp_path, "b", "2026-02-01", "mine")
    noted(tmp_path, "c", "2026-03-01", "other")
    noted(tmp_path, "d", "2026-04-01", "mine", kept=False)
    noted(tmp_path, "e", "2026-05-01", "mine", axis="depth")
    (tmp_path / "f").mkdir()
    (tmp_path / "f" / "summary.json").write_text("[")
    found = last_tune(tmp_path, "heading", lambda about: about["vehicle"]["uid"] == "mine")
    assert found is not None and found.directory.name == "b"
    assert found.numbers.overshoot == 0.1 and math.isnan(found.numbers.settling)
    assert found.changed({"P": 0.3}) == () and found.changed({"P": 0.4}) == ("P",)
    assert last_tune(tmp_path / "none", "heading", lambda about: True) is None


def test_a_simulated_vehicle_is_rechecked_with_the_command_that_sets_the_tuned_gains(tmp_path: Path) -> None:
    check = Recheck(AXES["heading"], tmp_path, Ear([]))
    check.tune = LastTune(tmp_path, "", LoopNumbers(), {"ATC_STR_RAT_P": 0.7, "ATC_STR_RAT_I": 0.1})
    assert check.again_with_its_gains("sitl:charlie") == ""
    check.changed = ("ATC_STR_RAT_P",)
    assert check.again_with_its_gains("/dev/ttyUSB0") == ""
    told = check.again_with_its_gains("sitl:charlie?seed=3")
    assert told == ("gcs-autotune recheck heading --connect 'sitl:charlie?seed=3&param=ATC_STR_RAT_P=0.7'")


def checked(harness: SitlHarness, runs: Path, axis: str = "heading", **common: Any) -> Any:
    kind = AXES[axis]
    settings = FlySettings("set-point-relay", harness.common(**common), {}, force=kind.names.force)
    return recheck(FlightPlan.of(settings), kind, Unattended(), Ear(harness.said), WHEN, runs)


@pytest.mark.slow
def test_a_loop_in_a_limit_cycle_is_reported_in_red_with_its_amplitude(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path)
    with with_pictures():
        found = checked(harness, tmp_path)
    assert (found.kind, found.tone) == ("oscillates", "bad")
    assert math.degrees(found.now.oscillation) > 20.0
    page = (harness.directory / "report.html").read_text(encoding="utf-8")
    assert '<div class="verdict bad">' in page and page.count("<figure") == 1
    summary = json.loads((harness.directory / "summary.json").read_text())
    assert summary["ending"] == "oscillates"
    found = json.loads((harness.directory / "parameters_before.json").read_text())
    assert found["ATC_STR_RAT_P"] == pytest.approx(summary["gains"]["ATC_STR_RAT_P"][0])
    assert any(
        "is reduced to --hysteresis" in text and "steering would be at its limit" in text for text in harness.said
    )
    assert not harness.vehicle.autopilot.armed
    harness.assert_neutral()


@pytest.mark.slow
def test_a_step_is_flown_if_the_relays_decide_nothing(tmp_path: Path) -> None:
    """The thrusters of this ROV are at their limit for much of each relay on its depth."""
    harness = SitlHarness(tmp_path, "bluerov2")
    found = checked(harness, tmp_path, axis="depth")
    assert (found.kind, found.tone) == ("good", "good"), found.text
    assert "a step of 1 m and back, if these relays give no clear verdict" in " ".join(harness.said)
    assert "figures are those of a flown step" in found.notes[0] and math.isfinite(found.now.itae)
    names = {path.stem.partition("-")[2] for path in (harness.directory / "trials").glob("*.csv")}
    assert {"set-point-relay", "step"} <= names
    harness.assert_neutral()


@pytest.mark.slow
def test_a_limit_that_a_recheck_cannot_keep_is_refused_before_arming(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path)
    with pytest.raises(PreconditionFailed, match=r"needs \d+ m, but the limit --max-distance is 30 m"):
        checked(harness, tmp_path, envelope=Envelope(distance=30.0))
    assert harness.found == ""
