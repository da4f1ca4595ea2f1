"""The information in a record about its parameters, with the noise levels unknown beside them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from gcs_autotune.identify.axis.likelihood import Gaussian, Law, Rounded
from gcs_autotune.identify.axis.objective import information_of, timing_of
from gcs_autotune.identify.axis.residuals import Residual
from gcs_autotune.identify.segment import Segment, Signal

N, P = 60, 3


def residual(name: str, seed: int) -> Residual:
    rng = np.random.default_rng(seed)
    t = 0.1 * np.arange(N)
    error = 0.3 + 0.2 * rng.normal(size=N)
    return Residual(0, Signal(name, t, error, 1.0), error, rng.normal(size=(N, 7)))


def whole(residuals: list[Residual], columns: list[np.ndarray], laws: dict[str, Law]) -> np.ndarray:
    """The information of the parameters and of every noise level together, sample by sample."""
    names = list(laws)
    total = np.zeros((P + len(names), P + len(names)))
    for own, J in zip(residuals, columns, strict=True):
        level = P + names.index(own.signal.name)
        for row, (truth, both, sigma) in zip(J, laws[own.signal.name].information(own.error), strict=True):
            total[:P, :P] += truth * np.outer(row, row)
            total[:P, level] += both * row
            total[level, :P] += both * row
            total[level, level] += sigma
    return total


LAWS = cast(dict[str, Law], {"psi": Rounded(0.3, 1.0, 5.0), "r": Rounded(0.5, 1.0, 5.0)})


def test_noise_levels_that_are_unknown_take_away_what_they_share_with_the_parameters() -> None:
    residuals = [residual("psi", 1), residual("r", 2), residual("psi", 3)]
    columns = [r.jacobian[:, :P] for r in residuals]
    found = information_of(residuals, columns, LAWS)
    together = whole(residuals, columns, LAWS)
    assert np.linalg.inv(found) == pytest.approx(np.linalg.inv(together)[:P, :P])
    lost = np.linalg.eigvalsh(together[:P, :P] - found)
    assert lost.max() > 1e-3, "these residuals are not centred in their cells, so something is lost"
    assert lost.min() > -1e-9


def test_a_noise_level_of_gaussian_noise_takes_nothing() -> None:
    own = residual("r", 4)
    J = own.jacobian[:, :P]
    assert information_of([own], [J], {"r": Gaussian(0.5)}) == pytest.approx(J.T @ J / 0.25)


def test_a_signal_that_no_residual_has_says_nothing() -> None:
    own = residual("r", 4)
    J = own.jacobian[:, :P]
    laws: dict[str, Law] = {"r": Gaussian(0.5), "psi": Gaussian(0.1)}
    assert information_of([own], [J], laws) == pytest.approx(J.T @ J / 0.25)


@pytest.mark.parametrize(("datings", "std"), [((0.0, 0.004), 0.008), ((0.02, 0.004), 0.04)])
def test_a_time_shift_may_be_twice_what_the_stamps_of_the_worst_run_allow(
    datings: tuple[float, float], std: float
) -> None:
    found = timing_of([cast(Segment, SimpleNamespace(dating=d)) for d in datings], 0.1)
    assert found is not None
    assert (found.mean, found.std) == (0.1, pytest.approx(std))


def test_exact_stamps_leave_no_time_shift() -> None:
    assert timing_of([cast(Segment, SimpleNamespace(dating=0.0))], 0.1) is None
