"""What is to be fitted: floors and limits, and a fit of a known motion with and without an effect."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_autotune.effects import DataSummary, EffectInstance
from gcs_autotune.identify.axis.form import ExplicitForm
from gcs_autotune.identify.problems.free_numbers import DIAGNOSTIC, WEAK
from gcs_autotune.identify.problems.likelihood import Limits
from gcs_autotune.identify.problems.problem import FLOOR, STRIDE, TURN, Problem
from gcs_autotune.identify.signals.segment import Segment, Signal
from gcs_autotune.models import simulate_explicit
from gcs_autotune.sname import DOFS

FORM = ExplicitForm.of(DOFS["yaw"])
TRUE = np.array([2.0, 0.8, 0.0, 0.1, 0.0])
FREE = ("b", "a", "d")
SPREAD = {"psi": 5.0, "r": 0.4, "x": 80.0, "u": 0.3, "v": 0.4, "z": 9.0}
SUMMARY = DataSummary(
    FORM, {"N": "N m"}, dict.fromkeys(SPREAD, "1"), {"N": 0.5}, SPREAD, dict.fromkeys(SPREAD, 0.01),
    frozenset(SPREAD), 0.1, 1.2, 10.0,
)  # fmt: skip


def segment(seed: int, noise: float = 1e-3, dating: float = 0.0) -> Segment:
    rng = np.random.default_rng(seed)
    t_in, t = np.arange(0.0, 10.0, 0.93), 0.1 * np.arange(100)
    N = 0.5 * (-1.0) ** np.arange(len(t_in))
    motion = simulate_explicit((*TRUE, 0.1, -0.2), t_in, N, t)
    signals = {
        "psi": Signal("psi", t, motion.eta + rng.normal(0.0, noise, 100), 0.0),
        "r": Signal("r", t, motion.nu + rng.normal(0.0, 2.0 * noise, 100), 0.0),
    }
    return Segment(f"run{seed}", f"run{seed}", t_in, N[:, None], ("N",), ("N m",), signals, dating=dating)


def problem(dating: float = 0.0, data_summary: DataSummary | None = SUMMARY) -> Problem:
    segments = [segment(1, dating=dating), segment(2, dating=0.5 * dating)]
    return Problem(FORM, segments, data_summary, Limits({}, {}), FREE)


def test_noise_floors_are_fractions_of_the_relevant_spread() -> None:
    floors = problem().floors
    assert floors["r"] == pytest.approx(FLOOR * 0.4)
    assert floors["psi"] == pytest.approx(FLOOR * TURN), "a heading that goes round counts up to two radians"
    assert floors["x"] == pytest.approx(FLOOR * STRIDE * 0.1 * 0.5), "and a position up to some samples' way"
    assert floors["z"] == pytest.approx(FLOOR * 9.0), "where its velocity is not measured it counts whole"
    assert problem(data_summary=None).floors == {}


def test_the_stamp_uncertainty_is_that_of_the_worst_run_and_depends_on_the_purpose() -> None:
    assert problem(0.02).shift_std == pytest.approx(DIAGNOSTIC.std * 0.02)
    assert problem(0.02, None).shift_std == pytest.approx(WEAK.std * 0.02)
    own = problem(0.02)
    assert own.on([segment(3, dating=0.004)]).shift_std == pytest.approx(DIAGNOSTIC.std * 0.004)
    assert own.on(own.segments, free=("b", "delay")).shift_std == 0.0
    assert own.on(own.segments).free == FREE
    held = own.holding(("b",), [("gyro-bias", "r", "bias")])
    assert (held.free, held.held, held.stamps) == (("b",), {("gyro-bias", "r", "bias")}, own.stamps)


def test_bounds_list_the_parameters_and_then_the_effects_in_order() -> None:
    own = Problem(FORM, [segment(1)], SUMMARY, Limits({"a": 0.0}, {"b": 9.0}), FREE)
    limit = EffectInstance("saturation", "N", {"limit": 0.3})
    low, high = own.edges([limit], [(0, "limit")])
    assert low[:3].tolist() == [-np.inf, 0.0, -np.inf]
    assert high[:3].tolist() == [9.0, np.inf, np.inf]
    assert 0.0 <= low[3] < 0.3 < high[3] < np.inf
    assert len(own.edges([limit], [])[0]) == 3


def test_a_motion_is_fitted_with_its_noise_levels() -> None:
    own = problem()
    fitted = own.fit(TRUE * 1.2, [], [np.zeros(2), np.zeros(2)])
    assert fitted is not None
    assert fitted.converged
    assert fitted.theta == pytest.approx(TRUE, abs=0.01)
    assert fitted.levels["psi"] == pytest.approx(np.hypot(1e-3, own.floors["psi"]), rel=0.15)
    assert fitted.levels["r"] == pytest.approx(np.hypot(2e-3, own.floors["r"]), rel=0.15)
    assert fitted.samples == 400
    assert fitted.jacobian.shape == (400, 3 + 4)
    assert [x.tolist() for x in fitted.initial] == [pytest.approx([0.1, -0.2], abs=5e-3)] * 2
    cost = sum(200 * np.log(fitted.levels[n] ** 2 / own.floors[n] ** 2) for n in ("psi", "r"))
    assert fitted.cost == pytest.approx(cost)
    far = own.fit(TRUE * 1.2, [], [np.zeros(2), np.zeros(2)], trials=1)
    assert far is not None
    assert not far.converged
    assert far.cost > fitted.cost
    assert own.fit(np.array([2.0, 0.8, -1e9, 0.1, 0.0]), [], [np.array([0.0, 5.0])] * 2) is None


def test_a_supplied_model_is_judged_with_only_its_initial_states_fitted() -> None:
    own = problem(0.01)
    judged = own.states(TRUE * 1.3, [], [np.zeros(2), np.zeros(2)])
    assert judged is not None
    assert judged.theta == pytest.approx(TRUE * 1.3)
    assert judged.free == ()
    assert abs(judged.initial[0][0]) > 1e-3
    right = own.states(TRUE, [], [np.zeros(2), np.zeros(2)], shift=0.002)
    assert right is not None
    assert right.cost < judged.cost
    assert right.shift_std == pytest.approx(DIAGNOSTIC.std * 0.01)


def test_a_fit_is_moved_in_the_order_of_its_jacobian_and_stays_within_limits() -> None:
    own = Problem(FORM, [segment(1)], SUMMARY, Limits({}, {"b": 2.05}), FREE)
    fitted = own.fit(TRUE, [], [np.zeros(2)])
    assert fitted is not None
    theta, _, initial = own.moved(fitted, np.array([0.5, 0.1, -0.2, 0.3, 0.4]))
    by = np.array([2.05 - fitted.theta[0], 0.1, 0.0, -0.2, 0.0])
    assert theta == pytest.approx(fitted.theta + by)
    assert initial[0] == pytest.approx(fitted.initial[0] + [0.3, 0.4])


def test_a_parameter_of_an_effect_is_labelled_with_its_place() -> None:
    assert EffectInstance("dead-zone", "N", {"width": 0.1}).label_of("width") == "dead-zone@N.width"


def test_the_information_of_a_fit_includes_the_prior_of_the_stamps() -> None:
    own = problem(0.01)
    fitted = own.fit(TRUE, [], [np.zeros(2), np.zeros(2)])
    assert fitted is not None
    assert fitted.parameters == 3
    assert fitted.shared == pytest.approx(fitted.theta[[0, 1, 3]])
    assert len(fitted.residual) == 400
    shares = [1.0 - (own.floors[n] / fitted.levels[n]) ** 2 for n in ("psi", "r")]
    assert float(np.mean(fitted.residual**2)) == pytest.approx(np.mean(shares)), "the floor's part is not a residual"
    plain = fitted.jacobian.T @ fitted.jacobian
    plain[-1, -1] += 4.0 / fitted.shift_std**2
    assert fitted.information(4.0) == pytest.approx(plain)
    assert fitted.covariance(4.0) == pytest.approx(4.0 * np.linalg.inv(plain), rel=1e-6)
    assert fitted.model.base.values["b"] == pytest.approx(fitted.theta[0])
