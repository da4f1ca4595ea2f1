"""The laws of roll and pitch are those of the heading, with the moment that rights the craft in the simulation."""

from __future__ import annotations

import math
from dataclasses import replace

import control
import numpy as np
import pytest

from gcs_autotune.control import reference_model
from gcs_autotune.design import LAWS, Actuator, Reduction, Spec
from gcs_autotune.design.laws import Scenario
from gcs_autotune.design.margins import Plant, margins_of, margins_of_each
from gcs_autotune.design.notes import limit_by_loop_rate
from gcs_autotune.design.open_loop import OpenLoop, Rational, constant, open_loop
from gcs_autotune.design.proposal import problem_of
from gcs_autotune.design.selection import judge
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.models import SingleDof

GAINS = {"P": 0.2, "I": 0.1, "D": 0.0}
CRAFT = SingleDof("roll", "1", 0.05, 0.02, 0.05, delay=0.03)
STEP = Scenario(math.radians(20.0), 4.0)


def of(letters: str) -> dict[str, float]:
    own = {f"ATC_RAT_{letters}_{n}": v for n, v in GAINS.items()}
    filters = {f"ATC_RAT_{letters}_{n}": 20.0 for n in ("FLTT", "FLTD")} | {f"ATC_RAT_{letters}_IMAX": 0.4}
    one = {"RLL": "R", "PIT": "P", "YAW": "Y"}[letters]
    limits = {f"ATC_ACCEL_{one}_MAX": 110000.0, f"ATC_RATE_{one}_MAX": 0.0}
    slew = {"ATC_SLEW_YAW": 1e8} if letters == "YAW" else {}
    return {**own, **filters, **limits, **slew, f"ATC_ANG_{letters}_P": 5.0}


@pytest.mark.parametrize(("law", "letters"), [("sub-roll", "RLL"), ("sub-pitch", "PIT")])
def test_a_tilt_loop_with_the_same_gains_equals_the_heading_loop(law: str, letters: str) -> None:
    mine = LAWS[law].simulate(CRAFT, of(letters), STEP, None, 0.0)
    heading = LAWS["sub-heading"].simulate(CRAFT, of("YAW"), STEP, None, 0.0)
    assert np.array_equal(mine.position, heading.position)
    s = np.array([0.3j, 4.0j, 30.0j])
    assert LAWS[law].controller(of(letters), None).at(s) == pytest.approx(
        LAWS["sub-heading"].controller(of("YAW"), None).at(s)
    )
    assert set(LAWS[law].tuned) < {gain.parameter for gain in FIRMWARE["ardusub"].axes[law[4:]].gains}


def test_the_output_holds_a_restoring_moment_at_the_end_of_the_step() -> None:
    righted = replace(CRAFT, restoring=0.2)
    motion = LAWS["sub-roll"].simulate(righted, of("RLL"), replace(STEP, duration=20.0), None, 0.0)
    assert motion.position[-1] == pytest.approx(STEP.step, rel=0.01)
    assert motion.output[-1] == pytest.approx(0.2 * STEP.step, rel=0.02)


@pytest.mark.parametrize("integral", [0.0, 0.1])
def test_the_margins_include_the_restoring_moment(integral: float) -> None:
    law, righted = LAWS["sub-roll"], replace(CRAFT, restoring=1.0)
    controller = law.controller(of("RLL") | {"ATC_RAT_RLL_I": integral}, None)
    plant = Plant(1.0, righted.alpha, righted.beta, 0.05, righted.restoring)
    loop = open_loop(controller, *plant[1:])
    s = 1j * np.geomspace(0.3, 30.0, 9).astype(np.complex128)
    by_hand = controller.at(s) * s / (righted.alpha * s**2 + righted.beta * s + righted.restoring)
    assert loop.rational.at(s) == pytest.approx(by_hand)
    (found,), alone = margins_of_each(controller, [plant]), margins_of(loop)
    assert found.stable and alone.stable
    assert (found.gain, found.phase, found.delay) == pytest.approx((alone.gain, alone.phase, alone.delay))
    (without,) = margins_of_each(controller, [plant._replace(restoring=0.0)])
    assert abs(found.phase - without.phase) > math.radians(2.0)
    late = [plant._replace(delay=d, gain=g) for d in (0.05, 1.0) for g in (1.0, 40.0)]
    poles = [open_loop(constant(p.gain) * controller, *p[1:]).closed_loop_poles() for p in late]
    assert [m.stable for m in margins_of_each(controller, late)] == [bool(np.all(p.real < 0.0)) for p in poles]
    assert {m.stable for m in margins_of_each(controller, late)} == {True, False}


def test_the_linear_loop_with_a_restoring_moment_predicts_small_steps_of_the_simulated_one() -> None:
    law, delay, step = LAWS["sub-roll"], 0.03, 1e-4
    level = SingleDof("roll", "1", 0.05, 0.02, delay=0.03, restoring=0.5)
    settings = of("RLL") | {"ATC_RATE_FF_ENAB": 0.0}
    motion = law.simulate(level, settings, Scenario(step, 8.0), None, delay)
    loop = open_loop(law.controller(settings, None), level.alpha, level.beta, level.delay + delay, level.restoring)
    plant = Rational((1.0,), (level.alpha, level.beta, level.restoring))
    forward = OpenLoop(law.position_path(settings, None) * plant, loop.delay).to_control()
    t = np.linspace(0.0, 8.0, 161)
    closed = control.minreal(forward / (1 + loop.to_control()), tol=1e-6, verbose=False)
    assert np.interp(t, motion.t, motion.position) / step == pytest.approx(
        control.step_response(closed, t).outputs, abs=0.03
    )


def test_a_note_reports_a_slow_loop_rate_that_lowers_the_margins() -> None:
    """A fit of the simulated BlueROV2 in roll, and the gains designed for it at 100 Hz."""
    craft = SingleDof("roll", "1", 0.02365, 0.0, 0.0627, restoring=0.0719)
    thrusters = Actuator(square=0.8, reference=0.3)
    axis = FIRMWARE["ardusub"].axes["roll"]
    gains = {"ATC_RAT_RLL_P": 0.1435, "ATC_RAT_RLL_I": 0.058, "ATC_RAT_RLL_D": 0.0036, "ATC_ANG_RLL_P": 3.0}
    limits = []
    for rate in (100.0, 400.0):
        present = {**LAWS["sub-roll"].defaults, **gains, "SCHED_LOOP_RATE": rate}
        reduction = Reduction(craft, "K", np.zeros((5, 5)), thrusters)
        problem = problem_of(craft, np.zeros((5, 5)), axis, present, Spec(), reduction)
        judged = judge(problem, reference_model("bessel", 4.8), present, 6.0)
        assert judged.objections
        limits.append(limit_by_loop_rate(problem, judged))
    assert limits[0].startswith("SCHED_LOOP_RATE is 100 Hz, and its delay lowers the margins. At the default of 400 Hz")
    assert not limits[1]
