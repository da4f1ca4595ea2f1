from __future__ import annotations

import control
import numpy as np
import pytest

from gcs_autotune.control import REFERENCE_MODELS, omega_for_settling, reference_model, settling_time, wanted_step
from gcs_autotune.errors import UnknownName, UsageError


def test_bessel_at_0_45_has_the_published_coefficients() -> None:
    f = reference_model("bessel", 0.45)
    assert (f.a3, f.a2, f.a1) == pytest.approx((10.97, 12.01, 5.48), abs=0.01)


def test_the_butterworth_model_matches_the_textbook() -> None:
    f = reference_model("butterworth", 1.0)
    assert (f.a1, f.a2, f.a3) == pytest.approx((2.0, 2.0, 1.0))


@pytest.mark.parametrize("kind", REFERENCE_MODELS)
def test_the_reference_step_matches_the_transfer_function(kind: str) -> None:
    f = reference_model(kind, 0.7)
    t = np.linspace(0.0, 15.0, 301)
    ours = wanted_step(f, t)
    theirs = control.step_response(control.tf([1.0], [f.a3, f.a2, f.a1, 1.0]), t)
    assert ours.position == pytest.approx(theirs.outputs, abs=1e-4)
    assert ours.velocity == pytest.approx(np.gradient(ours.position, t), abs=5e-3)
    assert ours.acceleration[20:] == pytest.approx(np.gradient(ours.velocity, t)[20:], abs=5e-3)


@pytest.mark.parametrize("kind", REFERENCE_MODELS)
def test_the_reference_step_has_the_requested_settling_time(kind: str) -> None:
    omega = omega_for_settling(kind, 12.0)
    assert settling_time(kind, omega) == pytest.approx(12.0)
    t = np.linspace(0.0, 30.0, 6001)
    outside = np.abs(wanted_step(reference_model(kind, omega), t).position - 1.0) > 0.05
    assert t[outside][-1] == pytest.approx(12.0, abs=0.15)


@pytest.mark.parametrize("omega", [0.0, -1.0, float("nan"), float("inf")])
def test_an_invalid_bandwidth_is_rejected(omega: float) -> None:
    with pytest.raises(UsageError, match="positive"):
        reference_model("bessel", omega)
    with pytest.raises(UsageError, match="positive"):
        omega_for_settling("bessel", omega)


def test_a_misspelt_family_is_rejected_with_the_nearest_name() -> None:
    with pytest.raises(UnknownName, match="bessel"):
        reference_model("besel", 1.0)
