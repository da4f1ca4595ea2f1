"""Noise levels found in turn with the fit: what is left, shared out, never below a coarse sensor's own rounding."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_autotune.identify.problems import Local, Residual
from gcs_autotune.identify.problems.noise import Gaussian, NoiseModel
from gcs_autotune.identify.problems.reweighting import MAD, Effort, alternate, errors_of, likeliest, rounding_error


def residual(name: str, errors: np.ndarray, step: float = 0.0, measured: np.ndarray | None = None) -> Residual:
    t = np.arange(float(len(errors)))
    return Residual(0, name, t, errors if measured is None else measured, np.zeros(len(errors)), errors, step=step)


def test_the_rounding_error_is_that_of_the_coarsest_run() -> None:
    runs = [residual("psi", np.zeros(3), step) for step in (0.1, 0.5, 0.2)] + [residual("r", np.zeros(3), 9.0)]
    assert rounding_error(runs, "psi") == pytest.approx(0.5 / math.sqrt(12.0))
    assert rounding_error(runs[:1], "psi") == pytest.approx(0.1 / math.sqrt(12.0))
    assert rounding_error(runs, "u") == 0.0


def test_errors_are_the_finite_residuals_of_one_signal() -> None:
    runs = [
        residual("psi", np.array([1.0, np.nan, 2.0])),
        residual("r", np.array([7.0])),
        residual("psi", np.array([3.0])),
    ]
    assert errors_of(runs, "psi").tolist() == [1.0, 2.0, 3.0]


def test_noise_levels_divide_the_residuals_by_the_remaining_degrees_of_freedom() -> None:
    rng = np.random.default_rng(1)
    psi, r = rng.normal(0.0, 2.0, 90), rng.normal(0.0, 0.3, 30)
    laws: dict[str, NoiseModel] = {"psi": Gaussian(1.0), "r": Gaussian(1.0)}
    found = likeliest([residual("psi", psi), residual("r", r)], laws, spent=12.0)
    assert found["psi"].sigma == pytest.approx(math.sqrt(psi @ psi / (90 * 0.9)))
    assert found["r"].sigma == pytest.approx(math.sqrt(r @ r / (30 * 0.9)))


def test_a_robust_noise_level_uses_the_median_and_ignores_outliers() -> None:
    errors = np.append(np.linspace(-1.0, 1.0, 101), [500.0, -900.0])
    found = likeliest([residual("psi", errors)], {"psi": Gaussian(1.0, robust=True)})
    assert found["psi"].sigma == pytest.approx(MAD * float(np.median(np.abs(errors))))
    assert found["psi"].robust


def test_noise_levels_are_at_least_the_rounding_error_or_a_tiny_fraction_of_the_range() -> None:
    laws: dict[str, NoiseModel] = {"psi": Gaussian(1.0)}
    assert likeliest([residual("psi", np.full(50, 1e-9), 0.3)], laws)["psi"].sigma == pytest.approx(
        0.3 / math.sqrt(12.0)
    )
    swinging = residual("psi", np.zeros(50), measured=np.linspace(0.0, 40.0, 50))
    assert likeliest([swinging], laws)["psi"].sigma == pytest.approx(40e-12)
    few = likeliest([residual("psi", np.array([3.0, 4.0]))], laws, spent=2.0)
    assert few["psi"].sigma == pytest.approx(5.0), "at least one degree of freedom is left"


class Lines:
    """Two signals of one slope: the straight line that weighs them by their noise."""

    def __init__(self) -> None:
        rng = np.random.default_rng(4)
        self.t = np.linspace(0.0, 1.0, 60)
        self.y = {"psi": 2.0 * self.t + rng.normal(0.0, 0.05, 60), "r": 2.2 * self.t + rng.normal(0.0, 0.5, 60)}
        self.calls = 0

    def at(self, x: np.ndarray, noise) -> Local:
        self.calls += 1
        cost, gradient, curvature = 0.0, np.zeros(1), np.zeros((1, 1))
        for name, y in self.y.items():
            e, w = y - x[0] * self.t, noise[name].sigma ** -2
            cost += w * float(e @ e)
            gradient -= w * (self.t @ e)
            curvature += w * (self.t @ self.t)
        return Local(cost, gradient, curvature)

    def residuals(self, x: np.ndarray) -> list[Residual]:
        return [residual(n, y - x[0] * self.t, measured=y) for n, y in self.y.items()]


@pytest.mark.parametrize("effort", [None, Effort(3), Effort(3, exact=False)])
def test_parameters_and_noise_levels_converge_together(effort: Effort | None) -> None:
    own = Lines()
    laws: dict[str, NoiseModel] = {"psi": Gaussian(1.0), "r": Gaussian(1.0)}
    found = alternate(own, np.array([9.0]), laws, np.array([-99.0]), np.array([99.0]), 8, effort)
    assert found is not None
    minimum, noise = found
    weights = {n: noise[n].sigma ** -2 for n in noise}
    best = sum(w * (own.t @ own.y[n]) for n, w in weights.items()) / sum(w * (own.t @ own.t) for w in weights.values())
    assert minimum.x[0] == pytest.approx(best, abs=2e-4)
    assert noise["psi"].sigma == pytest.approx(0.05, rel=0.25)
    assert noise["r"].sigma == pytest.approx(0.5, rel=0.25)


def test_one_round_uses_the_supplied_weights() -> None:
    own = Lines()
    found = alternate(
        own, np.array([0.0]), {"psi": Gaussian(1.0), "r": Gaussian(1.0)}, -np.ones(1) * 9, np.ones(1) * 9, 1
    )
    assert found is not None
    alike = sum(own.t @ y for y in own.y.values()) / (2.0 * (own.t @ own.t))
    assert found[0].x[0] == pytest.approx(alike)


def test_poor_starts_are_abandoned_early_and_starts_without_a_value_at_once() -> None:
    own = Lines()
    laws: dict[str, NoiseModel] = {"psi": Gaussian(1e-3), "r": Gaussian(1e-3)}
    limits = np.array([8.0]), np.array([9.0])
    alternate(own, np.array([8.5]), laws, *limits, 8, Effort(5, exact=False, astray=10.0))
    early, own.calls = own.calls, 0
    alternate(own, np.array([8.5]), laws, *limits, 8, Effort(5, exact=False))
    assert early <= own.calls

    class Nowhere(Lines):
        def at(self, x: np.ndarray, noise) -> None:  # type: ignore[override]
            return None

    assert alternate(Nowhere(), np.array([0.0]), laws, *limits, 8) is None
