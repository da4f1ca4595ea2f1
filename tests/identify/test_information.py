"""The information in a record about its parameters, with the noise levels also unknown."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest

from gcs_autotune.identify.axis.form import ExplicitForm
from gcs_autotune.identify.problems.free_numbers import DIAGNOSTIC, WEAK, StampPrior
from gcs_autotune.identify.problems.likelihood import Limits, Residual, information_of
from gcs_autotune.identify.problems.noise import Gaussian, NoiseModel, Rounded
from gcs_autotune.identify.problems.problem import Problem
from gcs_autotune.identify.signals.segment import Segment, Signal
from gcs_autotune.sname import DOFS

N, P = 60, 3


def residual(name: str, seed: int) -> Residual:
    rng = np.random.default_rng(seed)
    t = 0.1 * np.arange(N)
    error = 0.3 + 0.2 * rng.normal(size=N)
    return Residual(0, name, t, error, np.zeros(N), error, rng.normal(size=(N, 7)), 1.0)


def whole(residuals: list[Residual], columns: list[np.ndarray], laws: dict[str, NoiseModel]) -> np.ndarray:
    """The information of the parameters and of every noise level together, sample by sample."""
    names = list(laws)
    total = np.zeros((P + len(names), P + len(names)))
    for own, J in zip(residuals, columns, strict=True):
        level = P + names.index(own.signal)
        for row, (truth, both, sigma) in zip(J, laws[own.signal].information(own.judged), strict=True):
            total[:P, :P] += truth * np.outer(row, row)
            total[:P, level] += both * row
            total[level, :P] += both * row
            total[level, level] += sigma
    return total


FORM, LIMITS = ExplicitForm.of(DOFS["yaw"]), Limits({}, {})


def segment(dating: float) -> Segment:
    t = 0.1 * np.arange(N)
    signals = {"psi": Signal("psi", t, np.sin(t), 0.0)}
    return Segment("run", "run", t, np.ones((N, 1)), ("N",), ("N m",), signals, dating=dating)


LAWS = cast(dict[str, NoiseModel], {"psi": Rounded(0.3, 1.0, 5.0), "r": Rounded(0.5, 1.0, 5.0)})


def test_unknown_noise_levels_reduce_the_information_of_the_parameters() -> None:
    residuals = [residual("psi", 1), residual("r", 2), residual("psi", 3)]
    columns = [r.jacobian[:, :P] for r in residuals]
    found = information_of(residuals, columns, LAWS)
    together = whole(residuals, columns, LAWS)
    assert np.linalg.inv(found) == pytest.approx(np.linalg.inv(together)[:P, :P])
    lost = np.linalg.eigvalsh(together[:P, :P] - found)
    assert lost.max() > 1e-3, "these residuals are not centred in their cells, so something is lost"
    assert lost.min() > -1e-9


def test_an_unknown_gaussian_noise_level_does_not_reduce_the_information() -> None:
    own = residual("r", 4)
    J = own.jacobian[:, :P]
    assert information_of([own], [J], {"r": Gaussian(0.5)}) == pytest.approx(J.T @ J / 0.25)


def test_a_signal_without_residuals_adds_no_information() -> None:
    own = residual("r", 4)
    J = own.jacobian[:, :P]
    laws: dict[str, NoiseModel] = {"r": Gaussian(0.5), "psi": Gaussian(0.1)}
    assert information_of([own], [J], laws) == pytest.approx(J.T @ J / 0.25)


@pytest.mark.parametrize(("stamps", "std"), [(WEAK, 0.04), (DIAGNOSTIC, 0.02)])
def test_the_time_shift_is_limited_by_the_stamps_of_the_worst_run(stamps: StampPrior, std: float) -> None:
    """Twice as much if no delay is searched for, with almost no weight; once in a diagnosis."""
    runs = [segment(dating) for dating in (0.02, 0.004)]
    assert Problem(FORM, runs, None, LIMITS, ("b", "a"), stamps=stamps).shift_std == pytest.approx(std)


def test_exact_stamps_or_a_fitted_delay_leave_no_time_shift() -> None:
    assert Problem(FORM, [segment(0.0)], None, LIMITS, ("b", "a")).shift_std == 0.0
    assert Problem(FORM, [segment(0.01)], None, LIMITS, ("b", "a")).shift_std > 0.0
    assert Problem(FORM, [segment(0.01)], None, LIMITS, ("b", "a", "delay")).shift_std == 0.0
