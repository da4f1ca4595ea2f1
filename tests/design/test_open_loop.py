"""Margins against python-control, and the linear loops against the simulated ones."""

from __future__ import annotations

import math

import control
import numpy as np
import pytest

from gcs_autotune.control import reference_model
from gcs_autotune.design import LAWS, OpenLoop, Scenario
from gcs_autotune.design.margins import NO_CROSSING, Plant, margins_of, margins_of_each, worst
from gcs_autotune.design.open_loop import (
    Rational,
    constant,
    first_order,
    integral_over_proportional,
    integrator,
    open_loop,
    pade,
    pid_path,
    second_order,
    slow,
)
from gcs_autotune.design.proposal import problem_of
from gcs_autotune.design.refinement import sobol

from .crafts import CRAFTS, present, uncertain


def rational(num: list[float], den: list[float]) -> Rational:
    return Rational(np.array(num), np.array(den))


@pytest.mark.parametrize(
    ("num", "den", "delay"),
    [
        ([2.0], [1.0, 1.0, 0.0], 0.1),
        ([1.0, 0.3], [3.1, 1.0, 0.0, 0.0], 0.0),
        ([4.0], [1.0, 3.0, 3.0, 1.0], 0.05),
    ],
)
def test_margins_agree_with_python_control(num: list[float], den: list[float], delay: float) -> None:
    ours = margins_of(OpenLoop(rational(num, den), delay))
    loop = OpenLoop(rational(num, den), delay).to_control(order=8)
    gain, phase, _, _, crossover, _ = control.stability_margins(loop)
    assert ours.stable
    assert ours.phase == pytest.approx(math.radians(phase), rel=2e-3)
    assert ours.delay == pytest.approx(math.radians(phase) / crossover, rel=5e-3)
    if math.isfinite(gain):
        assert ours.gain == pytest.approx(gain, rel=5e-3)
    else:
        assert ours.gain == NO_CROSSING


def test_an_unstable_loop_has_no_margins() -> None:
    found = margins_of(OpenLoop(rational([20.0], [1.0, 3.0, 3.0, 1.0]), 0.0))
    assert (found.stable, found.gain, found.phase, found.delay) == (False, 0.0, 0.0, 0.0)


def test_a_loop_that_needs_its_gain_has_a_margin_downwards() -> None:
    loop = OpenLoop(rational([4.0, 4.0], [1.0, 0.0, 1.0, 0.0]) * integrator(), 0.0)
    triple = OpenLoop(rational([8.0, 8.0, 2.0], [1.0, 0.0, 0.0, 0.0]), 0.0)
    edge = next(k for k in np.linspace(1.0, 0.01, 400) if np.max(np.roots([1.0, 8 * k, 8 * k, 2 * k]).real) > 0.0)
    assert not margins_of(loop).stable
    assert margins_of(triple).gain == pytest.approx(1.0 / edge, rel=0.05)


def test_margins_of_many_loops_at_once_match_those_of_each_alone() -> None:
    controller = rational([0.4, 0.2], [0.1, 1.0, 0.0])
    plants = [Plant(g, a, d, late) for g in (0.3, 3.0, 300.0) for a in (0.5, 2.0) for d, late in ((0.7, 0.2), (0, 0))]
    each = margins_of_each(controller, plants)
    alone = [margins_of(open_loop(constant(p.gain) * controller, p.alpha, p.drag, p.delay)) for p in plants]
    assert {m.stable for m in each} == {True, False}
    assert margins_of_each(controller, []) == []
    for found, wanted in zip(each, alone, strict=True):
        assert found.stable == wanted.stable
        assert (found.gain, found.phase, found.delay) == pytest.approx((wanted.gain, wanted.phase, wanted.delay))


def test_margins_computed_together_match_each_loop_over_all_gain_ranges() -> None:
    wanted, stable = reference_model("bessel", 1.0), set()
    for model, axis, spec in CRAFTS.values():
        problem = problem_of(model, uncertain(model), axis, present(axis), spec)
        for x in sobol(len(problem.gains), 3):
            settings = problem.with_gains(x)
            (found,) = problem.margins(settings, wanted, [model])
            alone = worst([margins_of(loop) for loop in problem.loops(settings, wanted)])
            assert found.stable == alone.stable
            assert (found.gain, found.phase, found.delay) == pytest.approx((alone.gain, alone.phase, alone.delay))
            stable.add(found.stable)
    assert stable == {True, False}


def test_adding_loops_that_share_an_integrator_does_not_double_it() -> None:
    both = (constant(2.0) + integrator(3.0)) + (integrator(1.0) + integrator() * integrator())
    assert len(both.den) == 3
    s = np.array([0.3 + 1.1j])
    assert both.at(s) == pytest.approx(2.0 + 4.0 / s + 1.0 / s**2)


def test_filters_are_3_db_down_at_their_cutoff() -> None:
    s = np.array([2j * math.pi * 4.0])
    assert abs(first_order(4.0).at(s)[0]) == pytest.approx(math.sqrt(0.5))
    assert abs(second_order(4.0).at(s)[0]) == pytest.approx(math.sqrt(0.5))
    assert first_order(0.0).at(s)[0] == second_order(0.0).at(s)[0] == 1.0


@pytest.mark.parametrize("name", ["charlie trimmed off", "boat 2 s", "falcon yaw", "falcon heave", "bluerov heave"])
def test_the_linear_loop_predicts_the_small_steps_of_the_simulated_one(name: str) -> None:
    """With steps too small for any limiter, closing the linear loop must give the simulated motion.

    The step enters through the position path: ``eta = plant * path/(1 + L) * step``.
    """
    model, axis, spec = CRAFTS[name]
    law = LAWS[axis.law]
    settings = {**present(axis), "ATC_RATE_FF_ENAB": 0.0, "ATC_SLEW_YAW": 1e7}
    if law.name == "rover-heading":
        settings.update({"ATC_STR_RAT_P": 1.0, "ATC_STR_RAT_I": 0.05, "ATC_STR_ACC_MAX": 0.0})
    delay, step, speed = 0.06, 1e-4, spec.speed
    level = type(model)(model.dof, "1", model.alpha, model.beta, 0.0, 0.0, model.delay)
    motion = law.simulate(level, settings, Scenario(step, 15.0), speed, delay)
    controller = law.controller(settings, speed)
    loop = open_loop(controller, level.alpha, level.beta, level.delay + delay)
    path = law.position_path(settings, speed) * Rational(np.array([1.0]), np.array([level.alpha, level.beta, 0.0]))
    forward = OpenLoop(path, loop.delay).to_control()
    closed = forward / (1 + loop.to_control())
    t = np.linspace(0.0, 15.0, 751)
    expected = control.step_response(control.minreal(closed, tol=1e-6, verbose=False), t).outputs
    simulated = np.interp(t, motion.t, motion.position) / step
    assert simulated == pytest.approx(expected, abs=0.02)


S = 1j * np.geomspace(0.01, 50.0, 40).astype(np.complex128)


@pytest.mark.parametrize(
    ("loop", "expected"),
    [
        (constant(3.0), lambda s: 3.0 + 0.0 * s),
        (integrator(2.0), lambda s: 2.0 / s),
        (integrator(), lambda s: 1.0 / s),
        (first_order(0.5), lambda s: 1.0 / (1.0 + s / math.pi)),
        (first_order(0.0), lambda s: 1.0 + 0.0 * s),
        (slow(0.7), lambda s: 1.0 / (1.0 + 0.7 * s)),
        (slow(0.0), lambda s: 1.0 + 0.0 * s),
        (second_order(0.5), lambda s: 1.0 / (1.0 + math.sqrt(2.0) * s / math.pi + (s / math.pi) ** 2)),
        (second_order(0.0), lambda s: 1.0 + 0.0 * s),
        (pid_path(2.0, 0.5, 0.3, error_cutoff=1.0, slope_cutoff=4.0), None),
        (constant(2.0) * integrator(3.0) + integrator(1.0), lambda s: 7.0 / s),
        (integrator(2.0) * integrator() + integrator(3.0), lambda s: 2.0 / s**2 + 3.0 / s),
        (integrator(3.0) + integrator(2.0) * integrator(), lambda s: 2.0 / s**2 + 3.0 / s),
        (slow(0.5) + slow(0.2), lambda s: 1.0 / (1.0 + 0.5 * s) + 1.0 / (1.0 + 0.2 * s)),
    ],
)
def test_every_part_of_a_loop_has_its_transfer_function(loop: Rational, expected) -> None:
    if expected is None:
        expected = lambda s: (2.0 + 0.5 / s + 0.3 * s / (1.0 + s / (math.tau * 4.0))) / (1.0 + s / math.tau)  # noqa: E731
    assert loop.at(S) == pytest.approx(expected(S), rel=1e-9)


def test_a_loop_is_the_product_of_plant_controller_and_delay() -> None:
    loop = open_loop(pid_path(2.0, error_cutoff=0.0), 1.5, 0.4, 0.3)
    omega = S.imag
    assert loop.response(omega) == pytest.approx(2.0 / (1.5 * S + 0.4) * np.exp(-0.3 * S))
    top, bottom = pade(0.3)
    low = S[:20]
    assert np.polyval(top, low) / np.polyval(bottom, low) == pytest.approx(np.exp(-0.3 * low), abs=1e-6)
    assert [p.tolist() for p in pade(0.0)] == [[1.0], [1.0]]
    prompt = OpenLoop(rational([2.0], [1.0, 1.0]), 0.0)
    assert prompt.closed_loop_poles() == pytest.approx([-3.0])
    assert len(OpenLoop(rational([2.0], [1.0, 1.0]), 0.1).closed_loop_poles(3)) == 4


def test_an_outer_gain_around_a_proportional_and_an_integral_part_has_one_slow_rate() -> None:
    assert integral_over_proportional(2.0, 0.5, 0.3) == pytest.approx(2.0 * 0.3 / (2.0 * 0.5 + 0.3))
    assert integral_over_proportional(0.0, 0.5, 0.0) == 0.0
