"""The likelihood against its own differences and against sums written out, for one degree of freedom and its limits."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from gcs_autotune.effects import DataSummary, EffectInstance, EffectResidual
from gcs_autotune.identify.axis.form import ExplicitForm
from gcs_autotune.identify.problems.free_numbers import WEAK
from gcs_autotune.identify.problems.likelihood import (
    LAGGED,
    REMEMBERED,
    Limits,
    Objective,
    Residual,
    first_input,
    judged_by,
    sums_of,
)
from gcs_autotune.identify.problems.noise import Gaussian, NoiseModel
from gcs_autotune.identify.problems.problem import Problem
from gcs_autotune.identify.signals.segment import Segment, Signal
from gcs_autotune.models import simulate_explicit
from gcs_autotune.sname import DOFS

FORM = ExplicitForm.of(DOFS["yaw"])
TRUE = np.array([2.0, 0.8, 0.5, 0.1, 0.0])
FREE = ("b", "a", "c", "d")
NOISE: dict[str, NoiseModel] = {"psi": Gaussian(0.02), "r": Gaussian(0.05)}
FLOORS = {"psi": 1e-3, "r": 2e-3}
DATING = 0.01


def segment(seed: int, dating: float = DATING, name: str = "run") -> Segment:
    """A run of 8 s of square waves with noise: headings at 10 Hz, turn rates at 5 Hz."""
    rng = np.random.default_rng(seed)
    t_in = np.arange(0.0, 8.0, 0.93)
    N = 0.5 * (-1.0) ** np.arange(len(t_in))
    t = 0.1 * np.arange(80)
    motion = simulate_explicit((*TRUE, 0.1, -0.2), t_in, N, t)
    psi = Signal("psi", t, motion.eta + rng.normal(0.0, 0.02, 80), 0.0)
    r = Signal("r", t[::2], motion.nu[::2] + rng.normal(0.0, 0.05, 40), 0.0)
    slack = np.full(len(t_in), dating)
    return Segment(
        name, name, t_in, N[:, None], ("N",), ("N m",), {"psi": psi, "r": r}, dating=dating, slack=slack, loop=0.02
    )


def objective(dating: float = DATING, fixed_states: bool = False) -> Objective:
    segments = [segment(1, dating, "one"), segment(2, dating, "two")]
    problem = Problem(FORM, segments, None, Limits({"a": 0.0}, {"c": 9.0}), FREE)
    initial = [np.array([0.12, -0.25]), np.array([0.08, -0.15])]
    return Objective(problem, TRUE * 1.1, initial, shift=0.002, fixed_states=fixed_states)


def test_unpacking_reverses_packing_and_keeps_fixed_parameters() -> None:
    own = objective()
    x = own.pack()
    assert x == pytest.approx([2.2, 0.88, 0.55, 0.11, 0.12, -0.25, 0.08, -0.15, 0.002])
    theta, effects, initial, shift = own.unpack(x + np.arange(9.0))
    assert theta == pytest.approx([2.2, 1.88, 2.55, 3.11, 0.0])
    assert effects == ()
    assert [v.tolist() for v in initial] == [pytest.approx([4.12, 4.75]), pytest.approx([6.08, 6.85])]
    assert shift == pytest.approx(8.002)
    assert own.theta == pytest.approx(TRUE * 1.1), "nothing is changed in place"


def test_limits_apply_to_parameters_and_stamps_and_states_are_free() -> None:
    low, high = objective().limits()
    inf = np.inf
    reach = WEAK.reach * DATING
    assert low == pytest.approx([-inf, 0.0, -inf, -inf, -inf, -inf, -inf, -inf, -reach])
    assert high == pytest.approx([inf, inf, 9.0, inf, inf, inf, inf, inf, reach])
    assert objective(0.0).limits()[1][-1] == inf


def test_exact_stamps_have_no_shift_and_fixed_states_are_not_fitted() -> None:
    assert (objective(0.0).size, objective(0.0, fixed_states=True).size, objective().size) == (8, 4, 9)
    assert objective(0.0).unpack(objective(0.0).pack())[3] == 0.0
    assert objective(0.0).known()[1].tolist() == [0.0] * 8


def test_the_prior_states_that_stamps_are_nearly_right() -> None:
    prior, weight = objective().known()
    assert prior.tolist() == [0.0] * 9
    assert weight == pytest.approx([0.0] * 8 + [(WEAK.std * DATING) ** -2])


@pytest.mark.parametrize("concentrated", [False, True])
def test_the_gradient_is_half_the_derivative_of_the_cost_in_every_direction(concentrated: bool) -> None:
    def local(x: np.ndarray):
        found = own.concentrated(x, FLOORS) if concentrated else own.at(x, NOISE)
        assert found is not None
        return found

    own = objective()
    x = own.pack()
    here = local(x)
    for i in range(own.size):
        h = np.zeros(own.size)
        h[i] = 1e-6
        rise = (local(x + h).cost - local(x - h).cost) / 2e-6
        assert here.gradient[i] == pytest.approx(0.5 * rise, rel=2e-4, abs=2e-4 * np.abs(here.gradient).max())
    assert here.curvature == pytest.approx(here.curvature.T)
    assert np.linalg.eigvalsh(here.curvature).min() > 0.0


def test_cost_and_curvature_are_the_sums_over_all_samples() -> None:
    own = objective()
    x = own.pack()
    here, found = own.at(x, NOISE), own.residuals(x)
    assert here is not None
    assert found is not None
    cost = sum(float(r.judged @ r.judged) / cast(Gaussian, NOISE[r.signal]).sigma ** 2 for r in found)
    fee = x[-1] ** 2 / (WEAK.std * DATING) ** 2
    assert here.cost == pytest.approx(cost + fee)
    table = np.vstack([own.wide(r) / NOISE[r.signal].sigma for r in found])
    whole = table.T @ table
    whole[-1, -1] += (WEAK.std * DATING) ** -2
    assert here.curvature == pytest.approx(whole)


def test_the_concentrated_cost_uses_the_best_noise_levels_above_their_floors() -> None:
    own = objective()
    x = own.pack()
    here, found = own.concentrated(x, FLOORS), own.residuals(x)
    assert here is not None
    assert found is not None
    sums, counts = sums_of(found)
    assert counts == {"psi": 160, "r": 80}
    cost = x[-1] ** 2 / (WEAK.std * DATING) ** 2
    for name, n in counts.items():
        squares = sum(float(np.sum(r.judged**2)) for r in found if r.signal == name)
        assert sums[name] == pytest.approx(squares)
        cost += n * np.log((squares / n + FLOORS[name] ** 2) / FLOORS[name] ** 2)
    assert here.cost == pytest.approx(cost)


def test_fully_explained_samples_do_not_count() -> None:
    own = objective()
    x = own.pack()
    whole = own.residuals(x)
    assert whole is not None
    spoilt = replace(whole[0], judged=np.where(np.arange(80) < 30, np.nan, whole[0].judged))
    own._recent[x.tobytes()] = (spoilt, *whole[1:])
    here, level = own.at(x, NOISE), own.concentrated(x, FLOORS)
    assert here is not None
    assert level is not None
    kept = sum(float(np.nansum(r.judged**2)) / NOISE[r.signal].sigma ** 2 for r in (spoilt, *whole[1:]))
    assert here.cost == pytest.approx(kept + x[-1] ** 2 / (WEAK.std * DATING) ** 2)
    assert own.wide(spoilt).shape == (50, 9)
    assert sums_of([spoilt])[1] == {"psi": 50}


def test_a_few_recent_evaluations_are_cached(monkeypatch: pytest.MonkeyPatch) -> None:
    own = objective()
    requested: list[bool] = []
    known = Objective.predicted

    def counting(self: Objective, x: np.ndarray, *, sensitivities: bool):
        requested.append(sensitivities)
        return known(self, x, sensitivities=sensitivities)

    monkeypatch.setattr(Objective, "predicted", counting)
    x = own.pack()
    places = [x + 1e-3 * k for k in range(REMEMBERED + 1)]
    for place in (*places, places[-1], places[1]):
        own.residuals(place)
    assert requested == [True] * (REMEMBERED + 1)
    own.residuals(places[0])
    assert len(requested) == REMEMBERED + 2, "the first has been forgotten for the last"


def test_a_diverging_simulation_has_no_cost() -> None:
    own = objective()
    x = own.pack()
    x[2] = -1e6
    assert own.at(x, NOISE) is None
    assert own.concentrated(x, FLOORS) is None


def test_combined_limits_are_the_narrower_and_the_first_if_they_contradict() -> None:
    mine, other = Limits({"a": 0.0, "b": 1.0}, {"a": 5.0}), Limits({"a": 1.0, "b": 7.0}, {"a": 9.0, "b": 8.0, "c": 2.0})
    both = mine.within(other)
    assert both.low == {"a": 1.0, "b": 7.0, "c": -np.inf}
    assert both.high == {"a": 5.0, "b": 8.0, "c": 2.0}
    apart = Limits({"a": 6.0}, {"a": 7.0}).within(Limits({"a": 1.0}, {"a": 6.0}))
    assert (apart.low, apart.high) == ({"a": 6.0}, {"a": 7.0})
    low, high = both.of(("c", "a", "z"))
    assert low.tolist() == [-np.inf, 1.0, -np.inf]
    assert high.tolist() == [2.0, 5.0, np.inf]


def test_the_first_input_is_the_active_one_when_the_segment_begins() -> None:
    own = segment(1)
    late = replace(own, signals={"psi": own.signals["psi"].since(1.0)})
    assert first_input(own).tolist() == [0.5]
    assert first_input(late).tolist() == [-0.5]
    early = replace(own, t_in=own.t_in + 3.0)
    assert first_input(early).tolist() == [0.5]


def test_the_level_for_disturbances_is_the_learnt_then_the_known_then_one() -> None:
    data_summary = DataSummary(
        FORM, {"N": "N m"}, {"psi": "rad", "r": "rad/s"}, {"N": 0.5}, {"psi": 1.0, "r": 0.5}, {"psi": 0.03},
        frozenset({"psi", "r", "N"}), 0.1, 1.0, 8.0,
    )  # fmt: skip
    own = Objective(Problem(FORM, [segment(1)], data_summary, Limits({}, {}), FREE), TRUE, [np.zeros(2)])
    own.levels = {"r": 0.2}
    assert [own._level(n) for n in ("psi", "r", "u")] == [0.03, 0.2, 1.0]
    assert objective()._level("psi") == 1.0


def test_only_disturbances_change_a_residual() -> None:
    error = np.array([0.1, -0.2, 0.3])
    left = EffectResidual("run", "psi", np.arange(3.0), error, error, 0.1)
    columns = np.eye(3)
    judged, same, fee = judged_by([EffectInstance("gyro-bias", "r", {"bias": 0.1})], left, columns)
    assert judged is error
    assert same is columns
    assert fee == 0.0


def test_the_known_samples_of_a_residual_are_the_finite_ones() -> None:
    values = np.array([0.0, np.nan, 1.0])
    own = Residual(0, "psi", np.arange(3.0), values, values, values)
    assert own.known.tolist() == [True, False, True]


def test_every_lagged_input_starts_near_the_active_input_and_other_states_anywhere() -> None:
    own = objective()
    own.simulators = [  # type: ignore[assignment]
        SimpleNamespace(free_states=names) for names in (("psi", "lagged N"), ("lagged N", "r"))
    ]
    prior, weight = own.known()
    width = (LAGGED * 1.0) ** -2  # the input goes from -0.5 to 0.5
    assert prior.tolist() == [0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5, 0.0, 0.0]
    assert weight == pytest.approx([0.0] * 5 + [width, width, 0.0, (WEAK.std * DATING) ** -2])
