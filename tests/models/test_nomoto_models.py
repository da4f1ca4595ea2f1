"""Nomoto's models and the transfer function they are written as."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_autotune.models import Nomoto1, Nomoto2, SingleDof, TransferFunction


def test_a_first_order_nomoto_model_equals_a_single_dof_model() -> None:
    craft = SingleDof("yaw", "N m", alpha=0.36, beta=0.12, delay=0.1)
    nomoto = Nomoto1.from_single_dof(craft)
    assert (nomoto.K, nomoto.T, nomoto.delay) == pytest.approx((1.0 / 0.12, 3.0, 0.1))
    fast = Nomoto1.from_single_dof(SingleDof("yaw", "N m", 0.36, 0.12, 0.3), amplitude=1.0)
    assert fast.K == pytest.approx(1.0 / (0.12 + 8.0 / (3.0 * math.pi) * 0.3))
    assert Nomoto1.from_single_dof(SingleDof("yaw", "N m", 0.36, 0.0)).K == math.inf


def test_the_second_order_approaches_the_first_at_low_frequency() -> None:
    second = Nomoto2(0.5, 6.0, 0.8, 2.0, 0.05)
    first = second.first_order()
    assert first.T == pytest.approx(4.8)
    omega = 0.01
    assert second.response(omega) == pytest.approx(complex(first.response(omega)) * np.exp(-0.05j * omega), rel=1e-3)
    s = 1j * 1.7
    by_hand = 0.5 * (1 + 2.0 * s) * np.exp(-0.05 * s) / ((1 + 6.0 * s) * (1 + 0.8 * s))
    assert complex(second.response(1.7)) == pytest.approx(by_hand)


def test_models_survive_serialisation() -> None:
    for model in (Nomoto1(0.5, 2.0, 0.1), Nomoto2(0.5, 6.0, 0.8, 2.0, 0.05)):
        assert type(model).from_dict(model.to_dict()) == model
    process = TransferFunction((3.0, 1.0), (1.0, 0.9, 0.2), 1, 0.1)
    assert TransferFunction.from_dict(process.to_dict()) == process


def test_the_control_library_gives_the_same_process() -> None:
    process = TransferFunction((3.0, 1.0), (1.0, 0.9, 0.2), 1, 0.1)
    system = process.to_control(pade=6)
    omega = 1.3
    assert complex(system(1j * omega)) == pytest.approx(complex(process.response(omega)), rel=1e-6)
    assert sorted(process.to_control().poles().real) == pytest.approx(sorted(process.poles().real), abs=1e-9)
    assert process.zeros() == pytest.approx([-3.0])
