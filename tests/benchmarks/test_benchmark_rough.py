"""Disturbances of the rough cases: waves, a lagging heading, a helm, and run-to-run differences."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.blind.case import draw_case
from benchmarks.blind.craft import draw_craft
from benchmarks.blind.manoeuvres import driving
from benchmarks.blind.noise_search import marked, report
from benchmarks.blind.process_noise import CALM, HIDDEN, Helm, Lag, RunToRun, Waves
from benchmarks.blind.rough_water import CIRCUMSTANCES, EXCUSED, FAMILIES, PAIR, _run_to_run
from sitl.effects import HiddenEffect
from sitl.open_loop import Hull, open_loop

Array = NDArray[np.float64]
INTERVAL, SAMPLES = 0.1, 4000
HULL = Hull(("yaw",), {"yaw": 1.0}, {"yaw": 1.0})


def flown(command: Array, *effects: HiddenEffect, seed: int = 1) -> dict[str, Array]:
    """Return the file of a craft with a time constant of 1 s and a gain of 1 rad/s per N m."""
    return open_loop(
        HULL, {"N": command}, duration=INTERVAL * len(command), interval=INTERVAL, measured=("psi", "r"),
        effects=effects, seed=seed,
    )  # fmt: skip


def test_a_rough_case_is_the_same_every_time_and_keeps_its_circumstances() -> None:
    one, again, other = (draw_case("rough", 5, i, "dead-zone") for i in (0, 0, 1))
    assert one.truth == again.truth != other.truth
    assert one.circumstances == again.circumstances
    for run, same in zip(one.runs, again.runs, strict=True):
        assert all(np.array_equal(c.values, same[n].values) for n, c in run.channels.items())


@pytest.mark.slow
def test_every_circumstance_occurs_and_some_cases_have_none() -> None:
    seen = [draw_case("rough", 6, i, CALM).circumstances for i in range(40)]
    assert () in seen
    assert {c for some in seen for c in some} == set(CIRCUMSTANCES)


def test_a_pair_contains_two_families() -> None:
    for index in range(6):
        one, two = draw_case("rough", 7, index, PAIR).slugs
        assert not any({one, two} <= set(family) for family in FAMILIES)
    assert sorted(s for family in FAMILIES for s in family) == sorted(HIDDEN)


def test_trims_are_zero_on_average_over_the_runs() -> None:
    differences = _run_to_run(np.random.default_rng(3), draw_craft("yaw", np.random.default_rng(3)), 3)
    assert [d.in_runs for d in differences] == [(0,), (1,), (2,)]
    moments = [d.values["moment"] for d in differences]
    assert sum(moments) == pytest.approx(0.0, abs=1e-9 * max(moments)) and max(moments) > 0.0


def test_waves_push_and_turn_the_bow_at_their_frequency() -> None:
    calm = np.zeros(SAMPLES)
    pushed = flown(calm, Waves("N", moment=1.0, heading=0.0, frequency=2.0, damping=0.1))["r"]
    moved = flown(calm, Waves("N", moment=0.0, heading=0.1, frequency=2.0, damping=0.1))["psi"]
    omega = 2.0 * np.pi * np.fft.rfftfreq(SAMPLES, INTERVAL)
    for signal in (pushed, moved):
        power = np.abs(np.fft.rfft(signal)) ** 2
        middle = omega[np.searchsorted(np.cumsum(power), 0.5 * power.sum())]
        assert float(middle) == pytest.approx(2.0, abs=0.2)
        assert power[omega < 0.5].sum() < 0.05 * power.sum()
    assert float(moved.std()) == pytest.approx(0.1, rel=0.2)
    assert float(pushed.std()) == pytest.approx(1.0 / np.hypot(1.0, 2.0), rel=0.2)


def test_a_lag_delays_or_filters_the_heading_and_not_the_command() -> None:
    steps = np.where(np.arange(SAMPLES) // 50 % 2 == 0, 1.0, -1.0)
    plain = flown(steps)
    late = flown(steps, Lag("N", delay=0.5, time_constant=0.0))
    slow = flown(steps, Lag("N", delay=0.0, time_constant=0.5))
    assert np.array_equal(late["N"], plain["N"])
    # The hull was under the first command before the record began: as far ahead as it turned, all along.
    apart = late["psi"][105:] - plain["psi"][100:-5]
    assert np.ptp(apart) == pytest.approx(0.0, abs=0.02)
    settled = slice(40, 50)  # of the first step the turn rate is steady there, and so is what it is behind
    assert plain["psi"][settled] - slow["psi"][settled] == pytest.approx(0.5 * plain["r"][settled], rel=0.15)


def test_run_to_run_differences_are_a_moment_and_a_thrust() -> None:
    rate = flown(np.full(SAMPLES, 0.5), RunToRun("N", moment=0.1, thrust=1.1))["r"]
    assert rate[-1] == pytest.approx(0.5 * 1.1 + 0.1)


def test_a_human_helm_keeps_the_course_at_times_and_its_commands_are_recorded() -> None:
    plan = np.full(SAMPLES, 0.3)
    file = flown(plan, Helm("N", gain=2.0, rate=1.0, every=0.3, spell=20.0, most=0.8))
    by_plan = file["N"] == 0.3
    assert 0.2 < by_plan.mean() < 0.8
    assert np.abs(file["N"]).max() <= 0.8
    again = flown(file["N"])
    assert np.abs(again["psi"] - file["psi"]).max() < 0.02 * np.ptp(file["psi"])


def test_a_human_helm_steers_gently_with_ramps_and_pauses() -> None:
    t = INTERVAL * np.arange(SAMPLES)
    for seed in range(5):
        u = driving(np.random.default_rng(seed), t, 2.0)
        assert np.abs(u).max() <= 1.0
        assert float(np.sqrt(np.mean(u**2))) < 0.6
        assert np.any(u == 0.0) and len(np.unique(u)) > 50


ROW: dict[str, Any] = {
    "truth": ["dead-zone"],
    "named": ["dead-zone"],
    "groups": [],
    "circumstances": [],
    "improvement": 20.0,
}


def marks(**changed: object) -> set[str]:
    """Return the marks of a row."""
    return {name for name, is_set in marked({**ROW, **changed}).items() if is_set}


def test_a_cause_explained_by_a_lagging_heading_is_neither_wrong_nor_right() -> None:
    assert marks() == {"right"}
    assert marks(named=["backlash"]) == {"wrong"}
    assert marks(named=["backlash"], groups=[["backlash", "dead-zone"]]) == {"right"}
    assert marks(named=["dead-zone", "backlash"]) == {"right", "beside"}
    for name in EXCUSED:
        assert marks(named=[name]) == {"wrong"}
        assert marks(named=[name], circumstances=["lag"]) == {"excused"}
        assert marks(named=[name], truth=[], circumstances=["lag"]) == {"excused"}
        assert marks(named=[name], truth=[name], circumstances=["lag"]) == {"right"}
    assert marks(named=["tether-pull"], truth=[]) == {"wrong"}


def test_of_two_effects_one_is_counted_and_any_other_cause_is_wrong() -> None:
    two = ["dead-zone", "input-delay"]
    assert marks(truth=two, named=two[::-1]) == {"right"}
    assert marks(truth=two, named=two[:1]) == {"one"}
    assert marks(truth=two, named=[*two, "backlash"]) == {"wrong"}
    assert marks(truth=two, named=[]) == set()


def test_rates_are_reported_by_circumstances() -> None:
    row = {**ROW, "noise_share": 0.2, "circumstances": ["waves"]}
    lines = list(report([{**row, **marked(row)}]))
    assert any(line.startswith("waves") and "1 of 1" in line for line in lines)
