"""Two models compared by their behaviour: steady state and time constant, Miskovic2010, (7.4)-(7.11)."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_autotune.errors import UsageError
from gcs_autotune.experiments import compare_dof, compare_models
from gcs_autotune.identify import fit, model_file_of
from gcs_autotune.models import SingleDof, explicit_parameters, simulate_explicit
from gcs_autotune.trial import Channel, Trial


def yaw(alpha: float, beta: float, quadratic: float = 0.0) -> SingleDof:
    return SingleDof("yaw", "N m", alpha, beta, quadratic, delta=0.3, delay=0.2)


def test_differences_with_linear_drag_match_the_thesis() -> None:
    one, other, most = yaw(2.0, 4.0), yaw(3.0, 5.0), 10.0
    result = compare_dof((one, other), most, 1.0, quantum=0.6, interval=0.05)
    assert result.steady_apart == pytest.approx(abs(most * (1.0 / 4.0 - 1.0 / 5.0)))
    assert result.rise == pytest.approx((2.0 / 4.0, 3.0 / 5.0))
    assert result.samples == pytest.approx(2.0)
    assert result.same_steady and result.share == pytest.approx(0.632, abs=1e-3)
    assert not compare_dof((one, other), most, 1.0, quantum=0.4).same_steady


def test_differences_with_quadratic_drag_match_the_thesis_with_its_factor_corrected() -> None:
    result = compare_dof((yaw(2.0, 0.0, 4.0), yaw(3.0, 0.0, 5.0)), 9.0, 0.25, interval=0.1)
    assert result.steady_apart == pytest.approx(math.sqrt(9.0) * abs(1.0 / math.sqrt(4.0) - 1.0 / math.sqrt(5.0)))
    mended = abs(2.0 / math.sqrt(4.0) - 3.0 / math.sqrt(5.0)) / math.sqrt(0.25)
    assert result.rise_apart == pytest.approx(mended)
    assert result.share == pytest.approx(0.762, abs=1e-3)


@pytest.mark.parametrize(("beta", "quadratic"), [(1.5, 0.0), (0.0, 2.0), (0.7, 1.3), (-0.2, 1.0)])
def test_the_rise_time_matches_a_simulated_step(beta: float, quadratic: float) -> None:
    model, tau = SingleDof("yaw", "N m", 2.0, beta, quadratic), 3.0
    t = np.linspace(0.0, 20.0, 4001)
    nu = simulate_explicit((*explicit_parameters(model), 0.0, 0.0), np.zeros(1), np.full(1, tau), t).nu
    for share in (0.3, 0.632, 0.9):
        assert model.rise_time(tau, share) == pytest.approx(
            np.interp(share * model.steady_velocity(tau), nu, t), abs=1e-3
        )


def test_rise_times_with_different_drag_use_the_same_fraction() -> None:
    result = compare_dof((yaw(2.0, 4.0), yaw(2.0, 0.0, 4.0)), 4.0, 4.0)
    assert result.rise[0] == pytest.approx(0.5)
    assert result.rise[1] == pytest.approx(math.atanh(1.0 - math.exp(-1.0)) * 0.5)


def test_models_of_different_units_are_rejected() -> None:
    with pytest.raises(UsageError, match="no common unit"):
        compare_dof((yaw(1.0, 1.0), SingleDof("yaw", "1", 1.0, 1.0)), 1.0, 1.0)
    with pytest.raises(UsageError, match="above 0"):
        compare_dof((yaw(1.0, 1.0), yaw(1.0, 1.0)), 1.0, 0.0)


def oscillation(step: float) -> Trial:
    """Return an oscillation with a compass in steps [rad], recorded at 10 Hz; the truth: 2 r_dot + 1.5 r = N."""
    t = 0.1 * np.arange(400)
    N = np.where(t % 16.0 < 8.0, 1.0, -1.0) * np.where(t < 20.0, 1.0, 0.4)
    truth = SingleDof("yaw", "N m", 2.0, 1.5)
    psi = simulate_explicit((*explicit_parameters(truth), 0.0, 0.0), t, N, t).eta
    columns = {"N": ("N m", N), "psi": ("rad", np.round(psi / step) * step)}
    return Trial("oscillation", {n: Channel(n, unit, t, v) for n, (unit, v) in columns.items()})


def test_models_of_two_methods_are_compared_with_the_inputs_of_the_runs() -> None:
    run = oscillation(math.radians(2.0))
    files = [model_file_of(fit(run, "linear", method, dof="yaw")) for method in ("output-error", "least-squares")]
    (result,) = compare_models(files[0].model, files[1].model, (files[0].inputs, files[1].inputs), [run])
    assert (result.dof, result.largest, result.smallest) == ("yaw", 1.0, 0.4)
    assert result.interval == pytest.approx(0.1)
    assert result.quantum == pytest.approx(math.radians(20.0))  # a step of 2 degrees in a tenth of a second
    assert result.steady[0] == pytest.approx(1.0 / 1.5, rel=0.02)
    assert result.same_steady


def test_models_without_a_common_axis_are_rejected() -> None:
    run = oscillation(0.01)
    file = model_file_of(fit(run, "linear", dof="yaw"))
    other = Trial("none", {n: c for n, c in run.channels.items() if n != "N"})
    with pytest.raises(UsageError, match="is in both"):
        compare_models(file.model, file.model, (file.inputs, file.inputs), [other])
