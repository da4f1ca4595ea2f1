"""What differs from day to day: found between runs, told run by run, and taken neither for a cause nor against one."""

from __future__ import annotations

import pytest
from test_process_noise import SOME, nobody, weathered

from gcs_autotune.diagnose import diagnose
from gcs_autotune.diagnose.process_noise import NoiseSearch, search_with_process_noise
from gcs_autotune.diagnose.run_to_run import differing, doubt_of_days
from gcs_autotune.identify.kalman import RunOffset
from gcs_autotune.identify.problems import fit_base, plain_form
from gcs_autotune.identify.signals import prepare_as_recorded
from gcs_autotune.trial import Trial

DAYS = ((0.0, 0.09), (0.0, -0.07), (0.0, 0.05), (0.0, -0.08))
"""Thrust of four days whose standard deviation is 8 %."""

APART = {
    30: ((0.046, -0.085), (0.022, 0.035), (-0.001, 0.135), (0.04, 0.039)),
    31: ((0.079, -0.025), (0.002, 0.036), (0.042, 0.15), (-0.071, -0.038)),
}
"""Seed -> days drawn with deviations of 0.1 N m and 8 %: without them in the model a dead zone was named of either
craft, and true drag of none."""


def searched(runs: list[Trial]) -> NoiseSearch:
    """Return what the search under process noise says of these runs."""
    form = plain_form(runs)
    problem, base = fit_base(form, prepare_as_recorded(runs, form)[0])
    found = search_with_process_noise(problem, base, SOME, (), nobody)
    assert found is not None
    return found


@pytest.mark.parametrize("seed", [30, pytest.param(31, marks=pytest.mark.slow)])
def test_days_of_eight_per_cent_of_thrust_give_no_name(seed: int) -> None:
    found = searched(weathered(seed, size=0.05, count=4, days=APART[seed]))
    assert found.accepted == ()
    assert found.fit.noise.day_thrust == 0.05


@pytest.mark.slow
@pytest.mark.parametrize("seed", APART)
def test_days_of_eight_per_cent_of_thrust_refute_no_true_cause(seed: int) -> None:
    found = searched(weathered(seed, square=0.3, size=0.05, count=4, days=APART[seed]))
    assert [a.effect.slug for a in found.accepted] == ["quadratic-drag"]
    assert found.accepted[0].effect["coefficient"] == pytest.approx(0.3, rel=0.25)


@pytest.mark.slow
def test_a_bias_of_all_runs_is_named_and_no_difference_between_them() -> None:
    found = searched(weathered(6, size=0.05, count=4, days=[(0.2, 0.0)] * 4))
    assert "input-bias" in [a.effect.slug for a in found.accepted]
    assert found.accepted[0].effect["bias"] == pytest.approx(0.2, abs=0.05)


@pytest.mark.slow
def test_a_moment_of_each_days_own_passes_for_no_bias() -> None:
    found = searched(weathered(7, size=0.05, count=4, days=[(0.25, 0.0), (-0.2, 0.0), (0.1, 0.0), (-0.15, 0.0)]))
    assert found.accepted == ()


@pytest.mark.parametrize("count", [1, 2])
def test_fewer_than_three_runs_change_nothing(count: int) -> None:
    runs = weathered(4, size=0.05, count=count, days=DAYS[:count])
    found = searched(runs)
    assert not found.plain.noise.differs
    assert differing(found.problem, found.plain) is found.plain


def test_runs_that_are_alike_stay_so() -> None:
    found = searched(weathered(8, size=0.1, count=3))
    assert found.plain.noise.day_thrust == 0.0
    assert found.plain.noise.day_force < 0.3 * found.plain.noise.size


@pytest.mark.slow
def test_the_report_tells_what_each_run_had_of_its_own() -> None:
    found = diagnose(weathered(4, size=0.05, count=4, days=DAYS), effects=SOME)
    assert found.missing is not None
    for day, (_, thrust) in zip(found.missing.days, DAYS, strict=True):
        assert abs(day.thrust - thrust) < 0.04
    (told,) = [d.cause for d in found.doubts if d.slug == "day-to-day"]
    assert "% more" in told and "% less" in told
    assert len(found.to_dict()["missing"]["days"]) == 4


def test_a_day_is_told_in_one_plain_sentence() -> None:
    days = (RunOffset("run1", 0.02, 0.05, 0.01, 0.02), RunOffset("run234", 0.3, 0.09, -0.07, 0.02))
    (doubt,) = doubt_of_days("yaw", "N m", days)
    assert doubt.cause == (
        "the runs differ in yaw by more than their commands explain (run234: 7 % less thrust and 0.3 N m to starboard)"
    )
    assert doubt_of_days("surge", "1", days[:1]) == []
