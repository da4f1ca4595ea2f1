"""The kernel against an independent integrator and finite differences."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gcs_autotune.models import SingleDof, explicit_parameters, simulate, simulate_explicit, simulation
from gcs_autotune.models.simulation import COLUMNS

T_IN = np.array([0.0, 0.4, 0.93, 0.93, 1.5, 2.0, 9.0])
TAU = np.array([1.0, -1.0, 0.2, 0.4, -0.7, 1.2, 5.0])
T_OUT = np.array([0.0, 0.09, 0.35, 0.4, 0.41, 0.88, 1.03, 1.03, 1.2, 1.7, 2.05, 2.3])
CASES = {
    "affine": (2.0, 0.8, 1.5, 0.1, 0.137, 0.2, -0.5),
    "linear": (2.0, 0.8, 0.0, 0.1, 0.0, 0.2, -0.5),
    "quadratic": (2.0, 0.0, 1.5, -0.3, 0.05, 0.0, 2.0),
    "stiff": (15.0, 10.0, 1.0, 0.1, 0.2, 0.0, 0.0),
    "reversed": (-3.0, 0.5, 0.4, 0.1, 0.1, 0.0, 0.3),
    "unstable": (1.0, -0.3, 0.2, 0.0, 0.1, 0.0, 0.1),
}


def integrated(p: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """The same motion from scipy, restarted at every input jump and output stamp."""
    b, a, c, d, delay, eta, nu = p
    state, out = [eta, nu], [[eta, nu]]
    for since, stamp in pairwise(T_OUT):
        edges = [since, *(t for t in T_IN[1:] + delay if since < t < stamp), stamp]
        for start, end in pairwise(edges):
            tau = TAU[max(int(np.searchsorted(T_IN + delay, start + 1e-12, side="right")) - 1, 0)]
            if end > start:
                state = solve_ivp(
                    lambda _, s, tau=tau: [s[1], b * tau - a * s[1] - c * abs(s[1]) * s[1] + d],
                    (start, end),
                    state,
                    method="DOP853",
                    rtol=1e-12,
                    atol=1e-13,
                    max_step=0.03,
                ).y[:, -1]
        out.append(list(state))
    return np.array(out)[:, 0], np.array(out)[:, 1]


@pytest.mark.parametrize("case", CASES)
def test_motion_agrees_with_an_independent_integrator_to_nine_digits(case: str) -> None:
    motion = simulate_explicit(CASES[case], T_IN, TAU, T_OUT)
    eta, nu = integrated(CASES[case])
    assert motion.finite
    assert np.max(np.abs(motion.eta - eta)) < 2e-9 * np.max(np.abs(eta))
    assert np.max(np.abs(motion.nu - nu)) < 2e-9 * np.max(np.abs(nu))


@pytest.mark.parametrize("case", [case for case in CASES if case != "stiff"])
def test_sensitivities_to_every_parameter_agree_with_finite_differences(case: str) -> None:
    assert COLUMNS == ("b", "a", "c", "d", "delay", "eta_0", "nu_0")
    p, h = np.array(CASES[case]), 1e-6
    p[4] += 0.013  # at a stamp that is a jump as well the two sides of a difference see different inputs
    motion = simulate_explicit(p, T_IN, TAU, T_OUT)
    for column in range(7):
        moved = h * np.eye(7)[column]
        high, low = (simulate_explicit(q, T_IN, TAU, T_OUT) for q in (p + moved, p - moved))
        for found, up, down in ((motion.eta_by, high.eta, low.eta), (motion.nu_by, high.nu, low.nu)):
            expected = (up - down) / (2.0 * h)
            scale = 1.0 + float(np.max(np.abs(expected)))
            assert found[:, column] == pytest.approx(expected, rel=1e-6, abs=1e-6 * scale), COLUMNS[column]


@pytest.mark.parametrize("delay", [0.0, 0.5])
@pytest.mark.parametrize("first", [-3.0, 0.3])
def test_the_active_input_is_the_last_that_has_arrived(delay: float, first: float) -> None:
    """A craft without drag, whose speed shows the impulse; one that arrives at the first stamp acts from it on."""
    t_in, tau = np.array([first, 0.5, 1.0, 1.5]), np.array([1.0, 10.0, 100.0, 1000.0])
    stamps = np.array([1.0, 1.25, 1.5])
    arrived = 0 if delay else 1
    motion = simulate_explicit((2.0, 0.0, 0.0, 0.0, delay, 3.0, 0.5), t_in, tau, stamps)
    held = [tau[arrived + 1]] * 2
    assert motion.nu == pytest.approx([0.5, 0.5 + 0.5 * held[0], 0.5 + 0.5 * sum(held)])
    assert motion.eta[0] == 3.0
    assert motion.eta[1] == pytest.approx(3.0 + 0.25 * 0.5 + 0.5 * 2.0 * held[0] * 0.25**2)


def test_a_series_is_evaluated_and_integrated_to_its_last_coefficient() -> None:
    value, area = (getattr(f, "py_func", f) for f in (simulation._value, simulation._area))
    series = np.random.default_rng(3).uniform(0.5, 1.0, 13)
    for degree in (12, 3):
        whole = np.polynomial.Polynomial(series[: degree + 1])
        for h in (0.0, 0.4, 1.3):
            assert value(series, h, degree) == pytest.approx(whole(h), rel=1e-13)
            assert area(series, h, degree) == pytest.approx(whole.integ()(h), rel=1e-13)


@pytest.mark.parametrize("reach", [0.2, 0.19999, 0.1, 0.03, 0.004, 1e-4])
def test_short_steps_of_few_terms_are_as_accurate_as_long_ones(reach: float) -> None:
    """With a constant force and linear drag, stamps *reach* of the time constant apart."""
    a, b, start = 2.0, 1.5, -0.4
    stamps = np.arange(40) * reach / a
    motion = simulate_explicit((b, a, 0.0, 0.3, 0.0, 0.0, start), np.zeros(1), np.ones(1), stamps)
    end = (b + 0.3) / a
    assert motion.nu == pytest.approx(end + (start - end) * np.exp(-a * stamps), abs=2e-11)
    assert motion.nu_by[:, 6] == pytest.approx(np.exp(-a * stamps), abs=2e-11)
    assert motion.eta == pytest.approx(end * stamps - (start - end) * np.expm1(-a * stamps) / a, abs=2e-11)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("force", [0.0, 0.4])
def test_a_craft_that_comes_to_rest_matches_the_closed_forms(side: float, force: float) -> None:
    """Square drag alone: tan and tanh; without a force it never quite stops."""
    c, start = 1.6, 0.7
    motion = simulate_explicit(
        (1.0, 0.0, c, -side * force, 0.0, 0.0, side * start), np.zeros(1), np.zeros(1), np.array([0.0, 0.2, 0.9, 2.5])
    )
    if force == 0.0:
        expected = [start / (1.0 + c * start * t) for t in (0.0, 0.2, 0.9, 2.5)]
        assert motion.eta == pytest.approx([side * np.log1p(c * start * t) / c for t in (0.0, 0.2, 0.9, 2.5)])
    else:
        top, pace = np.sqrt(force / c), np.sqrt(force * c)
        turn = np.arctan(start / top) / pace
        expected = [
            top * np.tan(pace * (turn - t)) if t < turn else -top * np.tanh(pace * (t - turn))
            for t in (0.0, 0.2, 0.9, 2.5)
        ]
        assert 0.2 < turn < 2.5
    assert motion.nu == pytest.approx([side * v for v in expected], abs=1e-11)


def test_the_steady_velocity_of_the_model_is_reached() -> None:
    model = SingleDof("yaw", "N m", 0.5, 0.3, 0.2, delta=0.05)
    motion = simulate(model, np.array([0.0]), np.array([0.7]), np.linspace(0.0, 40.0, 3))
    assert motion.nu[-1] == pytest.approx(model.steady_velocity(0.7), rel=1e-12)


def test_a_runaway_is_reported_and_not_returned_as_numbers() -> None:
    motion = simulate_explicit((1.0, 0.1, -2.0, 0.0, 0.0, 0.0, 1.0), T_IN, TAU, T_OUT)
    assert not motion.finite
    for array in (motion.eta, motion.nu, motion.eta_by, motion.nu_by):
        assert np.all(np.isnan(array))


@pytest.mark.parametrize(("nu", "is_finite"), [(0.999e9, True), (-0.999e9, True), (1.001e9, False), (-1.001e9, False)])
def test_a_simulation_is_abandoned_at_the_runaway_velocity(nu: float, is_finite: bool) -> None:
    stamps = np.array([0.0, 0.1])
    assert simulate_explicit((1.0, 0.0, 0.0, 0.0, 0.0, 0.0, nu), T_IN, TAU, stamps).finite is is_finite


@pytest.mark.parametrize("drag", [(1.0, 1.0, 0.0), (-1.0, 1.0, 0.0), (1.0, 0.0, 1.0), (-1.0, 0.0, 1.0)])
@pytest.mark.parametrize(("share", "is_finite"), [(0.9995, True), (1.0005, False)])
def test_a_stamp_allows_500_steps_of_a_fifth_of_the_time_constant(
    drag: tuple[float, float, float], share: float, is_finite: bool
) -> None:
    """Of a craft at a steady speed of one: linear drag is its rate; square drag twice, and as much for the force."""
    speed, a, c = drag
    force = a * speed + c * abs(speed) * speed
    span = share * 2 * 500 * 0.2 / (abs(a) + 4.0 * c)
    p = (force, a, c, 0.0, 0.0, 0.0, speed)
    assert simulate_explicit(p, np.zeros(1), np.ones(1), np.array([0.0, span])).finite is is_finite


def test_inputs_before_the_first_stamp_do_not_affect_the_delay_sensitivity() -> None:
    for t_in in (np.array([-1.0, -0.5]), np.array([-1.0, -0.4])):
        motion = simulate_explicit(
            (2.0, 0.3, 0.2, 0.0, 0.4, 0.0, 0.5), t_in, np.array([5.0, 1.0]), np.array([0.0, 0.3])
        )
        assert not motion.nu_by[:, 4].any() and not motion.eta_by[:, 4].any()


def test_the_explicit_parameters_are_per_inertia() -> None:
    model = SingleDof("yaw", "N m", 0.5, 0.3, 0.2, 0.05, 0.12)
    assert explicit_parameters(model) == pytest.approx((2.0, 0.6, 0.4, 0.1, 0.12))
    stamps = np.array([0.0, 0.3, 0.9])
    found = simulate(model, T_IN, TAU, stamps, eta_0=0.4, nu_0=-0.2)
    same = simulate_explicit((2.0, 0.6, 0.4, 0.1, 0.12, 0.4, -0.2), T_IN, TAU, stamps)
    assert np.array_equal(found.eta, same.eta) and np.array_equal(found.nu, same.nu)
    assert simulate(model, T_IN, TAU, stamps).eta[0] == simulate(model, T_IN, TAU, stamps).nu[0] == 0.0
    whole = simulate_explicit((2, 0, 0, 0, 0, 0, 1), np.array([0]), np.array([0]), np.array([0, 1]))
    assert whole.eta == pytest.approx([0.0, 1.0]), "whole numbers are numbers, too"


def test_sampling_the_output_more_densely_does_not_change_the_motion() -> None:
    dense = np.unique(np.concatenate([T_OUT, np.linspace(0.0, T_OUT[-1], 200)]))
    coarse = simulate_explicit(CASES["affine"], T_IN, TAU, T_OUT)
    fine = simulate_explicit(CASES["affine"], T_IN, TAU, dense)
    assert fine.eta[np.searchsorted(dense, T_OUT)] == pytest.approx(coarse.eta, abs=1e-11)
