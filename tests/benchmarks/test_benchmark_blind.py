"""The blind suite: its random cases and its scoring, without the diagnosis."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks import studies
from benchmarks.blind import __main__ as blind
from benchmarks.blind.__main__ import main, tasks
from benchmarks.blind.case import LEAST_RATIO, TRACK, draw_case
from benchmarks.blind.craft import FASTEST, KINDS, SLOWEST, draw_craft
from benchmarks.blind.foreign import FOREIGN
from benchmarks.blind.manoeuvres import MANOEUVRES, can_turn_fully, draw_commands
from benchmarks.blind.plain_model import errors_of, misfit, whitened
from benchmarks.blind.recipes import ENVIRONMENT, NOT_DRAWN, RECIPES
from benchmarks.blind.referee import Outcome
from benchmarks.blind.scoring import bounds, recovered, report
from gcs_autotune.effects import EFFECTS
from sitl.effects import EFFECTS as SIMULATED
from sitl.open_loop import Hull, open_loop

RIGHT = Outcome("single", 1, 0, "dead-zone", ["dead-zone"], ["N"], "yaw", 1.0, 2.0, 0.01, "effect-found", ["dead-zone"])


@pytest.mark.parametrize(
    ("place", "causes", "found_at", "right"),
    [
        ("surge", ["input-bias", "wave-disturbance"], ["surge", "surge"], True),
        ("surge", ["wave-disturbance", "input-bias"], ["surge", "surge"], True),
        ("surge", ["input-bias", "wave-disturbance"], ["yaw", "surge"], False),
        ("surge", ["input-bias"], ["surge"], False),
        ("surge", ["input-bias", "wave-disturbance", "tether-pull"], ["surge", "surge", "surge"], False),
        ("yaw", ["input-bias", "wave-disturbance"], ["yaw", "yaw"], False),
    ],
)
def test_the_mean_drift_of_waves_may_be_reported_with_them(
    place: str, causes: list[str], found_at: list[str], right: bool
) -> None:
    sea = Outcome("environment", 1, 0, "sea", ["wave-disturbance"], [place], place, 1.0, 2.0, 0.01, "effect-found")
    assert replace(sea, causes=causes, found_at=found_at).right is right


def test_every_effect_of_the_catalogue_and_of_the_simulator_has_a_recipe_or_a_reason() -> None:
    assert len({*RECIPES, *ENVIRONMENT, *NOT_DRAWN}) == len(RECIPES) + len(ENVIRONMENT) + len(NOT_DRAWN)
    assert {*RECIPES, *ENVIRONMENT, *NOT_DRAWN} - {"sea"} == set(EFFECTS) == set(SIMULATED)


def test_foreign_effects_are_not_in_the_catalogue() -> None:
    assert len(FOREIGN) >= 6
    assert not set(FOREIGN) & (set(EFFECTS) | set(SIMULATED))


@pytest.mark.parametrize("kind", KINDS)
def test_craft_have_time_constants_from_a_tenth_of_a_second_to_twenty_seconds(kind: str) -> None:
    rng = np.random.default_rng(3)
    for _ in range(30):
        craft = draw_craft(kind, rng)
        assert craft.dofs
        assert all(FASTEST <= craft.time_constant(dof) * 1.0001 <= SLOWEST * 1.001 for dof in craft.dofs)
        for name in MANOEUVRES:
            commands = draw_commands(rng, craft, name, turns=False)
            assert all(np.abs(u).max() <= craft.full[c] for c, u in commands.items())


def test_commands_with_full_turns_turn_the_craft_through_a_full_circle() -> None:
    rng, turned = np.random.default_rng(5), []
    while len(turned) < 20:
        craft = draw_craft("yaw", rng)
        if not can_turn_fully(craft):
            continue
        commands = draw_commands(rng, craft, "steps", turns=True)
        hull = Hull(craft.dofs, craft.inertia, craft.linear)
        file = open_loop(hull, commands, duration=craft.duration, interval=craft.interval, measured=("psi",))
        turned.append(np.ptp(file["psi"]) / (2.0 * np.pi))
    assert np.mean(np.array(turned) > 1.0) > 0.9


def test_a_case_is_the_same_every_time_and_another_for_another_index() -> None:
    one, again, other = (draw_case("single", 7, i, "dead-zone") for i in (0, 0, 1))
    assert one.truth == again.truth != other.truth
    for run, same in zip(one.runs, again.runs, strict=True):
        assert all(np.array_equal(c.values, same[n].values) for n, c in run.channels.items())


@pytest.mark.parametrize("slug", ["quadratic-drag", "time-offset", "gyro-bias"])
def test_a_case_counts_when_the_error_of_the_plain_model_exceeds_the_noise_by_a_quarter(slug: str) -> None:
    case = draw_case("single", 11, 0, slug)
    assert case.ratio >= LEAST_RATIO
    assert case.slugs == (slug,)


@pytest.mark.parametrize("index", range(4))
def test_a_limit_is_reached_in_the_supplied_runs_and_not_only_in_the_held_out_one(index: int) -> None:
    case = draw_case("correct-model-and-effect", 74, index, "saturation")
    place, numbers = case.truth["saturation"]
    assert max(np.abs(run[place].values).max() for run in case.runs) > numbers["limit"]


@pytest.mark.parametrize("slug", TRACK)
def test_a_track_case_has_only_positions_and_heading(slug: str) -> None:
    case = draw_case("track", 3, 0, slug)
    assert {n for n in case.runs[0].channels if n in ("u", "v", "r", "x", "y", "psi")} == {"x", "y", "psi"}
    assert case.slugs == (slug,) and case.ratio >= LEAST_RATIO


def test_for_a_track_a_doubt_is_right_and_no_report_or_a_wrong_cause_is_not() -> None:
    lost = replace(RIGHT, kind="track", truth=["sensor-position"], causes=[], verdict="unexplained")
    assert lost.right and not lost.strictly_right
    assert not replace(lost, verdict="no-effect").right
    assert replace(lost, verdict="no-effect", doubts=["not-looked-at"]).right
    assert not replace(lost, verdict="effect-found", causes=["steady-current"]).right


def test_the_plain_model_explains_a_plain_hull_down_to_the_noise() -> None:
    rng = np.random.default_rng(2)
    craft = replace(draw_craft("yaw", rng), samples=500)
    hull = Hull(craft.dofs, craft.inertia, craft.linear)
    noise = {n: 0.01 * s for n, s in craft.scale.items()}
    files = [
        open_loop(
            hull,
            draw_commands(rng, craft, "steps", turns=False),
            duration=craft.duration,
            interval=craft.interval,
            measured=("psi", "r"),
            noise=noise,
            seed=k,
        )
        for k in range(3)
    ]
    assert misfit(errors_of(craft, files[:2], files[2:], noise)) == pytest.approx(1.0, abs=0.06)


def test_whitening_removes_nothing_from_white_noise_and_almost_all_of_a_sinusoid() -> None:
    t = np.arange(600.0)
    assert whitened([np.random.default_rng(1).standard_normal(600)]) < 1.05
    assert whitened([np.sin(0.3 * t)], noise=0.1) > 4.0


def test_a_group_counts_as_its_members_but_not_strictly() -> None:
    late = replace(RIGHT, causes=["backlash"], groups=[["backlash", "dead-zone"]])
    assert RIGHT.strictly_right and not late.strictly_right and late.right
    assert not replace(RIGHT, causes=["backlash"]).right


def test_both_of_two_effects_must_be_reported_and_foreign_ones_not_with_confidence() -> None:
    two = replace(RIGHT, kind="double", truth=["dead-zone", "wind-moment"], causes=["wind-moment", "dead-zone"])
    assert two.strictly_right
    assert not replace(two, causes=["dead-zone", "backlash"]).right
    foreign = replace(RIGHT, kind="foreign", truth=["sloshing"], verdict="partly-explained")
    assert foreign.strictly_right and not replace(foreign, verdict="effect-found").right
    assert not replace(RIGHT, kind="clean", verdict="unexplained").right


def test_parameters_without_an_error_are_unknown_and_chosen_ones_must_be_equal() -> None:
    assert recovered(1.0, 1.2, 0.1) and not recovered(1.0, 1.4, 0.1)
    assert recovered(57.2958, 57.2958, 0.0) and not recovered(0.05, 0.06, 0.0)
    assert recovered(1.0, 1.0, float("nan")) is None


def test_bounds_are_those_of_clopper_and_pearson() -> None:
    assert bounds(0, 10) == pytest.approx((0.0, 0.3085), abs=1e-4)
    assert bounds(97, 100) == pytest.approx((0.9148, 0.9938), abs=1e-4)


def test_the_report_shows_what_is_mistaken_for_what() -> None:
    wrong = replace(RIGHT, index=1, causes=["backlash"], pulls={"dead-zone.width": [1.0, 1.1, 0.1]})
    text = report([RIGHT, wrong, replace(RIGHT, kind="clean", slug="", truth=[], verdict="no-effect", causes=[])])
    assert "50.0 %  (1/2; 1 to 99)" in text
    assert "backlash 1" in text
    assert "1/1" in text.split("dead-zone.width")[1]


def test_outcomes_survive_serialisation() -> None:
    assert Outcome.from_json(RIGHT.to_json()).to_json() == RIGHT.to_json()


def test_a_case_is_saved_as_a_row_and_not_repeated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run: list[tuple[object, ...]] = []

    def run_case(*task: object) -> Outcome:
        run.append(task)
        return replace(RIGHT, index=task[2], doubts=["a doubt " * 50])

    monkeypatch.setattr(studies, "OUT", tmp_path)
    monkeypatch.setattr(blind, "run_case", run_case)
    line = ["--kind", "single", "--cases", "2", "--only", "dead-zone", "--jobs", "1", "--quiet"]
    assert main(line) == 0
    assert main(line) == 0
    assert run == [("single", 1, index, "dead-zone", math.inf, None) for index in (0, 1)]
    assert "100.0 %  (2/2" in capsys.readouterr().out
    assert main([*line, "--cases", "1"]) == 0
    assert "100.0 %  (1/1" in capsys.readouterr().out
    assert len(run) == 2


def test_effects_come_in_turn() -> None:
    drawn = tasks("single", 2 * len(RECIPES), 1, ())
    assert [t[3] for t in drawn[: len(RECIPES)]] == list(RECIPES)
    assert drawn[len(RECIPES)][2] == 1
    assert len(tasks("all", 100, 1, ())) == 100


def test_wrong_numbers_count_when_exactly_they_are_reported_and_nothing_else() -> None:
    wrong = replace(
        RIGHT, kind="wrong-numbers", slug="", truth=[], causes=[], verdict="wrong-numbers", wrong_numbers=["N_r"]
    )
    assert replace(wrong, reported_numbers=["N_r"]).right
    assert not wrong.right and not replace(wrong, reported_numbers=["N_r", "N_rdot"]).right
    assert not replace(wrong, reported_numbers=["N_r"], verdict="partly-explained").right
    beside = replace(RIGHT, kind="wrong-numbers-and-effect", wrong_numbers=["N_r"], reported_numbers=["N_r"])
    assert beside.right and not replace(beside, causes=[]).right and not replace(beside, reported_numbers=[]).right
    correct = replace(wrong, kind="correct-model", wrong_numbers=[], verdict="no-effect")
    assert correct.right and not replace(correct, reported_numbers=["N_r"], verdict="wrong-numbers").right
    theirs = replace(wrong, kind="simulation", reported_numbers=["gain of yaw", "time constant of yaw"])
    assert theirs.right and not replace(theirs, reported_numbers=["gain of yaw"]).right


@pytest.mark.parametrize("kind", ["wrong-numbers", "simulation"])
def test_a_wrong_number_counts_over_the_noise(kind: str) -> None:
    case = draw_case(kind, 11, 0)
    assert 1 <= len(case.wrong) <= 2 and case.ratio >= LEAST_RATIO
    assert all(abs(np.log(by)) >= np.log(1.1) for by in case.wrong.values())
    assert len(case.simulations) == (len(case.runs) if kind == "simulation" else 0)
