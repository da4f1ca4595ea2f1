"""A BlueROV2 behind a 50 Hz loop: no gains keep the specified margins, and some that are safe to fly are far better.

Numbers: a fit of the simulated one, thrusters with a dead band and a curve.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from gcs_autotune.control import reference_model
from gcs_autotune.design import (
    LAWS,
    Actuator,
    Proposal,
    Reduction,
    Scenario,
    Spec,
    Verdict,
    combine,
    design,
    is_better,
    step_metrics,
)
from gcs_autotune.design import proposal as door
from gcs_autotune.design.matching import DesignProblem
from gcs_autotune.design.plant import sample_region
from gcs_autotune.design.prediction import _measure, _there_and_back, predict_as_flown, predict_error, ruler_of
from gcs_autotune.design.selection import MIN_GAIN_MARGIN, MIN_PHASE_MARGIN, GainCandidate, judge

from .crafts import DEFAULTS, DEG, SUB_HEADING, SUB_HEADING_DEFAULTS, heave, uncertain, yaw

HULL = yaw(0.0267, 0.0325, 0.0506, delta=0.0024)
THRUSTERS = Actuator(dead_zone=0.055, square=0.356, reference=0.3)
SPREAD = np.diag([2e-4, 3e-3, 2e-3, 1e-4, 1e-3]) ** 2
SLOW = {**SUB_HEADING_DEFAULTS, "SCHED_LOOP_RATE": 50.0}
STEP = Spec(step=30.0 * DEG, step_duration=30.0, noise_std=0.25 * DEG)


def propose() -> Proposal:
    return design(HULL, SPREAD, SUB_HEADING, SLOW, STEP, Reduction(HULL, "N", SPREAD, THRUSTERS))


@pytest.mark.slow
def test_safe_gains_are_not_replaced_by_worse_ones() -> None:
    found = propose()
    low, old, new = found.worst_margins, found.before.metrics, found.after.metrics
    assert found.changes
    assert low.gain >= MIN_GAIN_MARGIN and low.phase >= MIN_PHASE_MARGIN
    assert is_better(old, new).better
    assert new.itae < 0.6 * old.itae


@pytest.mark.slow
def test_matched_gains_are_kept_if_refinement_is_worse(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[GainCandidate] = []

    def worsen(problem: DesignProblem, chosen: GainCandidate, span: float, *_: object) -> GainCandidate:
        seen.append(chosen)
        metrics = replace(chosen.prediction.metrics, itae=50.0)
        return replace(chosen, prediction=replace(chosen.prediction, metrics=metrics))

    monkeypatch.setattr(door, "refine", worsen)
    monkeypatch.setattr(door, "is_better", lambda old, new, free, *_, **__: Verdict(((new.itae < old.itae, "ITAE"),)))
    found = propose()
    assert seen and found.after.metrics.itae < 50.0


@pytest.mark.slow
def test_no_better_gains_are_reported_only_after_a_search_over_all_ranges(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither the tried bandwidths nor the descents find anything: the scattered starts do."""

    def present(problem: DesignProblem) -> GainCandidate:
        return judge(problem, reference_model("bessel", 2.0), dict(problem.settings), 30.0)

    monkeypatch.setattr(door, "choose", present)
    monkeypatch.setattr(door, "refine", lambda problem, chosen, span, *_: chosen)
    falcon = yaw(0.2, 0.75, 0.025)
    found = design(falcon, uncertain(falcon), SUB_HEADING, SUB_HEADING_DEFAULTS, STEP)
    assert found.changes
    assert is_better(found.before.metrics, found.after.metrics).better
    low = found.worst_margins
    assert low.gain >= MIN_GAIN_MARGIN and low.phase >= MIN_PHASE_MARGIN


@pytest.mark.parametrize("name", ["sub-heading", "rover-heading", "sub-depth"])
def test_an_output_held_for_a_loop_period_acts_half_a_period_late(name: str) -> None:
    """The same delay in all, of a loop of 50 Hz and of one so quick that holding is nothing."""
    craft = heave(0.3, 0.5, 0.5) if name == "sub-depth" else yaw(0.2, 0.75, 0.02)
    gains = {**DEFAULTS[name], "INS_GYRO_FILTER": 0.0, "ATC_RATE_FF_ENAB": 0.0}
    for delay in (0.01, 0.03, 0.055):
        slow, quick = (
            LAWS[name].simulate(craft, {**gains, "SCHED_LOOP_RATE": rate}, Scenario(0.2, 4.0), 1.0, delay)
            for rate in (50.0, 1000.0)
        )
        apart = np.interp(slow.t, quick.t, quick.position) - slow.position
        assert np.max(np.abs(apart)) < 0.02 * 0.2


def test_a_step_back_begins_with_the_integral_of_the_step() -> None:
    law, craft = LAWS["sub-heading"], yaw(0.2, 0.75, 0.025, delta=0.05)
    gains = {**SUB_HEADING_DEFAULTS, "ATC_RAT_YAW_I": 0.01}
    flight = law.simulate(craft, gains, Scenario(0.5, 20.0, lead=2.0, back_at=10.0), None, 0.0)
    there = law.simulate(craft, gains, Scenario(0.5, 20.0, lead=2.0), None, 0.0)
    turn = int(np.searchsorted(flight.t, 10.0 - 1e-9))
    assert np.array_equal(flight.position[:turn], there.position[:turn])
    settled = law.simulate(craft, gains, Scenario(-0.5, 10.0), None, 0.0)
    back = flight.position[turn:] - 0.5
    assert back[0] == pytest.approx(there.position[turn] - 0.5)
    assert np.max(np.abs(back - settled.position[: len(back)])) > 0.02


def test_a_prediction_matches_the_measured_step_with_its_noise_and_rate() -> None:
    noise, draw = 1.0 * DEG, np.random.default_rng(5)
    spec = replace(STEP, noise_std=noise, noise_bandwidth=5.0)
    law, region = LAWS["sub-heading"], sample_region(HULL, SPREAD)
    problem = DesignProblem(law, (), region, SUB_HEADING_DEFAULTS, spec, 30.0 * DEG, 0.004, actuator=THRUSTERS)
    gains = {**SUB_HEADING_DEFAULTS, "ATC_RAT_YAW_I": 0.03}

    def read() -> float:
        legs = []
        for leg in _there_and_back(problem, problem.model, gains, 30.0 * DEG, 30.0):
            t, true = np.arange(-0.1, 30.05, 0.1), np.interp(np.arange(-0.1, 30.05, 0.1), leg.t, leg.position)
            psi = np.where(t < 0.0, 0.0, true + draw.normal(0.0, noise, len(t)))
            legs.append(step_metrics(t, np.where(t < 0.0, 0.0, leg.size), psi, 0.0 * t, noise_std=noise))
        return combine(legs).itae

    flown = float(np.mean([read() for _ in range(30)]))
    assert predict_error(problem, gains, 30.0 * DEG, 30.0).itae == pytest.approx(flown, rel=0.06)
    unlike = replace(problem, spec=replace(spec, noise_bandwidth=25.0))
    assert predict_error(unlike, gains, 30.0 * DEG, 30.0).itae != pytest.approx(flown, rel=0.06)


def test_a_step_back_is_predicted_from_the_end_of_its_own_step() -> None:
    """By then the integral has not worked off a constant moment, which the step back then begins with."""
    craft = yaw(0.2, 0.75, 0.025, delta=0.05)
    spec = replace(STEP, settled_band=3.0 * DEG, settled_time=1.0, hold=1.0)
    law, region, gains = LAWS["sub-heading"], sample_region(craft, SPREAD), {**SLOW, "ATC_RAT_YAW_I": 0.02}
    problem = DesignProblem(law, (), region, SLOW, spec, 30.0 * DEG, 0.004)
    read = predict_as_flown(problem, (gains, gains), 30.0)
    there, back = read.windows
    assert there < 10.0

    def error_back(turn: float) -> float:
        whole = Scenario(30.0 * DEG, 1.0 + turn + back, lead=1.0, back_at=1.0 + turn)
        flight = law.simulate(craft, gains, whole, None, 0.004)
        late = flight.t >= 1.0 + turn - 1e-9
        t, psi = flight.t[late] - flight.t[late][0], flight.position[late]
        t, psi = np.concatenate([[-0.1], t]), np.concatenate([[30.0 * DEG], psi])
        target = np.where(t < 0.0, 30.0 * DEG, 0.0)
        return step_metrics(t, target, psi, 0.0 * t, noise_std=spec.noise_std, noise_time=0.1).itae

    there_alone = _there_and_back(problem, craft, gains, 30.0 * DEG, there)[0]
    alone = combine([_measure(there_alone, ruler_of(spec))]).itae
    assert read.one.itae == read.other.itae
    assert 2.0 * read.one.itae - alone == pytest.approx(error_back(there), rel=0.03)
    assert error_back(30.0) != pytest.approx(error_back(there), rel=0.15)


def test_noise_on_the_output_removes_an_error_inside_a_dead_band() -> None:
    law, loaded = LAWS["sub-heading"], yaw(0.0522, 0.0286, 0.0781, delta=0.0016)
    gains = {**SUB_HEADING_DEFAULTS, "ATC_RAT_YAW_P": 0.5, "ATC_RAT_YAW_I": 0.05, "ATC_ANG_YAW_P": 5.64}
    region = sample_region(loaded, SPREAD)
    problem = DesignProblem(law, (), region, gains, replace(STEP, hold=10.0), 30.0 * DEG, 0.004, actuator=THRUSTERS)
    calm = replace(problem, spec=replace(problem.spec, jitter_std=0.0))
    noisy, still = (predict_error(p, gains, 30.0 * DEG, 8.0).itae for p in (problem, calm))
    assert noisy < 0.9 * still
    straight = replace(problem, actuator=Actuator())
    assert predict_error(straight, gains, 30.0 * DEG, 8.0) == predict_error(
        replace(straight, spec=calm.spec), gains, 30.0 * DEG, 8.0
    )


def test_the_slope_at_half_output_excludes_dead_zone_and_backlash() -> None:
    bent = Actuator(square=0.4, reference=0.8)
    assert bent.slopes()[-1] == pytest.approx(0.6 + 2.0 * 0.4 * 0.5 / 0.8)
    for actuator in (replace(bent, dead_zone=0.1), replace(bent, backlash=0.2)):
        u = np.array([0.5, 0.5 + 1e-6])
        assert actuator.slopes()[-1] == pytest.approx(0.6 + 2.0 * 0.4 * 0.4 / 0.8)
        assert actuator.slopes()[-1] == pytest.approx(float(np.diff(actuator.static(u))[0]) / 1e-6, rel=1e-3)
    assert math.isclose(replace(bent, dead_zone=0.6).slopes()[-1], 0.6)


def test_a_prediction_uses_the_hold_time_of_the_flight() -> None:
    """The error that the integral has removed by then does not count."""

    def step(hold: float) -> float:
        spec = replace(STEP, hold=hold)
        law, region = LAWS["sub-heading"], sample_region(HULL, SPREAD)
        problem = DesignProblem(law, (), region, SUB_HEADING_DEFAULTS, spec, 30.0 * DEG, 0.004, actuator=THRUSTERS)
        return predict_error(problem, {**SUB_HEADING_DEFAULTS, "ATC_RAT_YAW_I": 0.03}, spec.step, 30.0).itae

    short, long, settled = step(3.0), step(12.0), step(60.0)
    assert short > 1.3 * long > 1.3 * settled
