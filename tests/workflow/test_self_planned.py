"""A trial that plans itself: after each run the model, then the run that best approaches the required precision."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from gcs_autotune.cli import main
from gcs_autotune.errors import OperatorStopped, UnknownName, UsageError
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.identify import Fit
from gcs_autotune.manoeuvres import MANOEUVRES, Envelope, Preview
from gcs_autotune.trial import Trial, load_trial
from gcs_autotune.workflow import FlightPlan, FlySettings, Unattended, first_run, fly_plan, precision_of
from gcs_autotune.workflow.excursion import Excursion
from gcs_autotune.workflow.flight_plan import FlightRun
from gcs_autotune.workflow.self_planned import LONGEST, Outlook, SelfPlanner, check_identifiable, driven, offers_for

from .sitl_harness import QUICK, SLOW_LOOP, WHEN, Ear, SitlHarness
from .test_fly import Stops


def trial(harness: SitlHarness, until: str, minutes: float = 10.0, observer: Any = None, **common: Any) -> Any:
    settings = harness.common(**common)
    requested = precision_of(until, "", 60.0 * minutes)
    first = first_run(requested, settings)
    plan = FlightPlan(first.kind.name, FlightPlan.of(first).runs, until=requested)
    ear = observer or Ear(harness.said)
    return fly_plan(plan, settings, observer or Unattended(), ear, WHEN)


@pytest.mark.parametrize(
    ("text", "form", "expected"),
    [
        ("N_r 5%", "yaw", {"beta_r": 0.05}),
        ("beta_r 5 %, N_rdot=0.5%", "yaw", {"beta_r": 0.05, "alpha_r": 0.005}),
        ("N_r 5%, Y_v 10%", "horizontal", {"N_r": 0.05, "Y_v": 0.1}),
        ("Z_ww 3%", "heave", {"beta_ww": 0.03}),
    ],
)
def test_the_smallest_form_with_all_requested_parameters_is_chosen(
    text: str, form: str, expected: dict[str, float]
) -> None:
    requested = precision_of(text, "", 600.0)
    assert (requested.form, dict(requested.wanted)) == (form, pytest.approx(expected))


@pytest.mark.parametrize(
    ("text", "form", "error", "words"),
    [
        ("N_r", "", UsageError, "is not NAME PERCENT"),
        ("N_r 0%", "", UsageError, "above 0"),
        ("N_r 200%", "", UsageError, "at most 100"),
        ("N_rr_ 5%", "", UnknownName, "Did you mean N_rr"),
        ("N_r 5%, Z_w 5%", "horizontal", UnknownName, "unknown parameter of 'horizontal' 'Z_w'"),
        ("N_r 5%", "horizonal", UnknownName, "Did you mean horizontal"),
    ],
)
def test_a_precision_that_no_form_can_reach_is_refused(
    text: str, form: str, error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words):
        precision_of(text, form, 600.0)


def test_every_candidate_is_a_manoeuvre_that_the_craft_can_fly(tmp_path: Path) -> None:
    settings = SitlHarness(tmp_path, QUICK).common()
    requested = precision_of("N_r 5%, Y_v 10%", "", 600.0)
    boat = FIRMWARE["ardurover"]
    offers = offers_for(requested, first_run(requested, settings), boat, "XN", 0.5)
    assert len(offers) > 20
    assert {o.settings.kind.name for o in offers} >= {"zig-zag", "turning-circle", "s-manoeuvre", "steps"}
    assert all(o.settings.kind.drives <= set(boat.channels) and o.throttle == 0.5 for o in offers)
    assert MANOEUVRES["relay"].drives <= set(boat.channels)  # and yet it is for craft that can stay where they are
    assert all(o.settings.kind.suits(boat) for o in offers)
    assert "relay" in {
        o.settings.kind.name
        for o in offers_for(requested, first_run(requested, settings), FIRMWARE["ardusub"], "XZN", 0.0)
    }
    sizes = {o.settings.options["steering"] for o in offers if o.settings.kind.name == "zig-zag"}
    assert len(sizes) >= 3
    assert all(o.make() is not o.make() for o in offers)


def test_nothing_is_planned_for_a_force_that_the_craft_lacks(tmp_path: Path) -> None:
    settings = SitlHarness(tmp_path, "videoray").common()
    requested, rov = precision_of("N_r 5%, Y_v 10%", "", 600.0), FIRMWARE["ardusub"]
    assert "Y" in rov.channels
    for forces in ("XZN", "XYZN"):
        offers = offers_for(requested, first_run(requested, settings), rov, forces, 0.0)
        assert {force for offer in offers for force in offer.settings.kind.drives} == {*forces} - {"Z"}
        assert driven(requested, forces) == (("surge", "sway", "yaw") if "Y" in forces else ("surge", "yaw"))


def test_after_an_unstable_model_other_manoeuvres_are_flown_and_two_failures_end_the_trial(tmp_path: Path) -> None:
    settings = SitlHarness(tmp_path, QUICK).common()
    requested = precision_of("N_r 5%", "", 600.0)
    first = first_run(requested, settings)
    seen = SimpleNamespace(seconds=30.0, trouble="")
    leg = FlightRun(replace(first, name="doublets"), 0.5, 1.0, Envelope(), cast(Preview, seen), Excursion(30.0, 20.0))
    announced: list[str] = []
    planner = SelfPlanner(requested, leg, FIRMWARE["ardurover"], "XN", 0.0, announced.append)
    lost = Outlook(cast(Fit, None), {"beta_r": math.inf}, math.nan, None)
    run = cast(Trial, SimpleNamespace(duration=30.0))

    def run_of(settings: FlySettings) -> FlightRun:
        return replace(leg, settings=settings)

    chosen = [planner.next_run([run] * k, lambda *work: lost, run_of) for k in (1, 2, 3)]
    names = [None if c is None else c.settings.kind.name for c in chosen]
    assert None not in names[:2] and names[2] is None
    assert len({"doublets", *names[:2]}) == 3
    assert "is unstable" in announced[1]
    assert "brought no improvement" in planner.steps[-1].ended


@pytest.mark.slow
def test_the_first_depth_run_of_an_unknown_craft_is_short(tmp_path: Path) -> None:
    out = tmp_path / "run"
    assert main(["fly", "--until", "Z_wdot 2%", "--connect", "sitl:videoray", "--out", str(out)]) == 0
    assert load_trial(next((out / "trials").glob("*doublets.csv"))).duration < 30.0


@pytest.fixture(scope="module", autouse=True)
def without_pictures() -> None:
    """Plot the figures here: the page is checked."""


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[SitlHarness, Any]:
    harness = SitlHarness(tmp_path_factory.mktemp("self-planned"))
    return harness, trial(harness, "N_rdot 0.08%")


@pytest.mark.slow
def test_the_trial_continues_until_the_required_precision_is_reached(flown: tuple[SitlHarness, Any]) -> None:
    harness, result = flown
    relative = [dict(s.outlook.relative) for s in result.steps]
    assert len(result.steps) >= 2
    assert result.steps[-1].ended == "the required precision is reached"
    inertia = result.fit.parameters["alpha_r"]
    assert inertia.std / inertia.value <= 0.0008
    assert all(r["alpha_r"] > 0.0008 for r in relative[:-1])
    harness.assert_restored()


@pytest.mark.slow
def test_each_run_is_predicted_by_the_model_of_the_previous_runs(flown: tuple[SitlHarness, Any]) -> None:
    _, result = flown
    first, *others = [s.outlook.predicted for s in result.steps]
    assert math.isnan(first)
    assert min(others) > 90.0


@pytest.mark.slow
def test_the_page_shows_the_course_of_the_trial_and_the_usual_files_are_written(flown: tuple[SitlHarness, Any]) -> None:
    harness, result = flown
    page = (harness.directory / "report.html").read_text()
    assert "Course of the trial" in page
    assert "A trial for N_rdot = alpha_r to 0.08 %" in page
    assert any(f"2-{name}: motion and input" in page for name in ("s-manoeuvre", "steps"))
    assert "z [m]" not in page
    assert all(s.run in page for s in result.steps)
    assert (harness.directory / "model.json").exists()
    assert len(list((harness.directory / "trials").glob("*.csv"))) >= len(result.steps)
    announced = " ".join(harness.said)
    assert (
        announced.index("until N_rdot = alpha_r to 0.08 %") < announced.index("Go ahead?") < announced.index("next: ")
    )


@pytest.mark.slow
def test_the_trial_ends_when_its_total_time_is_up(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path)
    result = trial(harness, "N_r 0.001%", minutes=2.0)
    assert "takes longer than the rest of --total-time" in result.steps[-1].ended
    assert result.steps[-1].ended.startswith("not reached")
    assert sum(s.seconds for s in result.steps) < 2.0 * 60.0 + LONGEST
    harness.assert_restored()


@pytest.mark.slow
def test_the_trial_ends_when_the_model_lacks_an_effect(tmp_path: Path) -> None:
    """Hard turns slow this boat and saturate its thrusters: no single yaw equation fits all of them."""
    harness = SitlHarness(tmp_path, QUICK)
    result = trial(harness, "N_r 0.1%, N_rdot 0.05%")
    assert "The model may lack an effect" in result.steps[-1].ended
    assert result.fit.doubts
    harness.assert_restored()


@pytest.mark.slow
def test_a_stop_in_a_self_planned_run_restores_the_vehicle(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, QUICK)
    announced = harness.said

    class StopsInSecond(Stops):
        def update(self, progress: Any) -> None:
            self.wants = self.wants or any(text.startswith("next: ") for text in announced)

    observer = StopsInSecond(announced, "")
    with pytest.raises(OperatorStopped):
        trial(harness, "N_r 0.001%", observer=observer)
    harness.assert_restored()


@pytest.mark.slow
def test_an_rov_reaches_the_required_precision_in_depth(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "videoray", **SLOW_LOOP)
    result = trial(harness, "Z_wdot 2%")
    assert result.steps[-1].ended == "the required precision is reached"
    harness.assert_restored()


def test_options_apply_to_every_run_that_accepts_them_and_to_no_other(tmp_path: Path) -> None:
    settings = SitlHarness(tmp_path, QUICK).common()
    requested = precision_of("N_r 5%, Y_v 10%", "", 600.0)
    boat, first = FIRMWARE["ardurover"], first_run(requested, settings)
    reported = offers_for(requested, first, boat, "XN", 0.5, {"heading": math.radians(15.0), "steering": 0.4})
    steering = {o.settings.options["steering"] for o in reported if "steering" in o.settings.kind.options}
    headings = {o.settings.options["heading"] for o in reported if o.settings.kind.name == "zig-zag"}
    assert steering == {0.4} and headings == {math.radians(15.0)}
    assert len({o.settings.options["steering"] for o in offers_for(requested, first, boat, "XN", 0.5) if "steering" in
                o.settings.kind.options}) > 1  # fmt: skip


def test_the_first_run_is_chosen_from_the_results_of_earlier_runs(tmp_path: Path) -> None:
    requested = precision_of("N_r 5%", "", 600.0)
    first = first_run(requested, SitlHarness(tmp_path, QUICK).common())
    seen = cast(Preview, SimpleNamespace(seconds=30.0))
    leg = FlightRun(replace(first, name="doublets"), 0.5, 1.0, Envelope(), seen, Excursion(30.0, 20.0))
    planner = SelfPlanner(requested, leg, FIRMWARE["ardurover"], "XN", 0.0, lambda text: None, known=2)
    run = cast(Trial, SimpleNamespace(duration=30.0))
    known = Outlook(cast(Fit, None), {"beta_r": 0.04}, math.nan, ())
    assert planner.next_run([run, run], lambda *work: known, lambda planned: leg) is None
    (step,) = planner.steps
    assert (step.run, step.why, step.seconds) == ("2 earlier runs", "flown before", 0.0)
    assert step.ended == "the required precision is reached"


@pytest.mark.slow
def test_a_resumed_trial_ends_at_once_when_earlier_runs_reach_the_precision(
    flown: tuple[SitlHarness, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    harness, _ = flown
    again = ["fly", "--resume", str(harness.directory), "--connect", "sitl:charlie", "--yes", "--out"]
    assert main([*again, str(tmp_path / "one"), "--until", "N_rdot 0.1%"]) != 0
    reported = capsys.readouterr().err
    assert "nothing was flown: after the" in reported and "the required precision is reached" in reported
    assert not list((tmp_path / "one").glob("trials/*"))


@pytest.mark.parametrize(
    ("until", "manoeuvre", "words"),
    [
        ("K_p 5%", "doublets", "K_p = beta_p to 5 %: no actuator drives roll on this vehicle"),
        ("Z_w 5%", "zig-zag", "no actuator drives heave"),
        (
            "X_u 5%",
            "zig-zag",
            "zig-zag drives N and does not excite this parameter. Omit the manoeuvre, or use one that drives X",
        ),
    ],
)
def test_a_precision_that_this_craft_or_manoeuvre_cannot_reach_is_refused_before_anything_moves(
    until: str, manoeuvre: str, words: str
) -> None:
    force = "K" if manoeuvre == "doublets" else ""
    with pytest.raises(UsageError, match=words):
        check_identifiable(precision_of(until, "", 600.0), MANOEUVRES[manoeuvre].of(force), "XN")
    for requested in ("N_r 5%", "N_r 5%, Y_v 10%"):
        check_identifiable(precision_of(requested, "", 600.0), MANOEUVRES["zig-zag"].of(""), "XN")
