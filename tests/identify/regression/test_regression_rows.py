"""The rows vanish at the true parameters of an exact motion, for planar and spatial forms."""

from __future__ import annotations

import numpy as np
import pytest
from regression_plants import TRUTH, coupled, s_manoeuvre, velocity_run, videoray

from gcs_autotune.errors import MissingChannel, UsageError
from gcs_autotune.identify import fit
from gcs_autotune.identify.regression import drives_of, motion_of
from gcs_autotune.identify.signals import prepare_form
from gcs_autotune.models import Form, force_columns, inertia_columns
from gcs_autotune.trial import Channel, Trial


def test_the_equations_hold_on_exact_velocities_and_accelerations():
    t, S, tau = s_manoeuvre(2.0, 0.06)
    form = coupled()
    nu, nu_dot = np.zeros((len(t), 6)), np.zeros((len(t), 6))
    nu[:, [0, 1, 5]] = S[:, 3:]
    nu_dot[:, [0, 1, 5]] = [videoray(s, held)[3:] for s, held in zip(S, tau, strict=True)]
    drives = np.hstack([tau, np.ones((len(t), 3))])
    E = force_columns(form, nu, np.zeros((len(t), 6)), drives) + inertia_columns(form, nu_dot)
    theta = np.array([TRUTH[n] for n in form.free] + [1.0])
    assert np.abs(E @ theta).max() < 1e-12


def test_coriolis_forces_of_a_full_inertia_do_no_work():
    rng = np.random.default_rng(0)
    form = Form(
        "spatial", "", ("surge", "sway", "heave", "roll", "pitch", "yaw"),
        ("X_udot", "Y_vdot", "Z_wdot", "K_pdot", "M_qdot", "N_rdot", "Y_rdot", "X_qdot", "I_xz"), {}, {},
    )  # fmt: skip
    nu = rng.normal(size=(50, 6))
    E = force_columns(form, nu, np.zeros((50, 6)), np.zeros((50, 0)))
    assert len(form.free) == 9
    for p in range(len(form.free)):
        assert np.abs(np.sum(E[:, :, p] * nu, axis=1)).max() < 1e-12
        assert np.abs(E[:, :, p]).max() > 0.0


def test_velocities_from_camera_positions_are_those_of_the_body():
    t, S, tau = s_manoeuvre(2.0, 0.06)
    names = {"x": S[:, 0], "y": S[:, 1], "psi": S[:, 2], "X": tau[:, 0], "N": tau[:, 1]}
    trial = Trial("clean", {n: Channel(n, "rad" if n == "psi" else "m", t, v) for n, v in names.items()})
    (record,) = prepare_form(trial, coupled())
    motion = motion_of(record, coupled())
    for j, column in ((0, 3), (1, 4), (5, 5)):
        assert np.std(motion.nu[5:-5, j] - S[5:-5, column]) < 0.02 * np.std(S[:, column])


def test_turning_rates_of_a_rolling_craft_follow_from_its_angles():
    t = np.arange(0.0, 20.0, 0.05)
    phi, theta, psi = 0.3 * np.sin(t), 0.2 * np.cos(0.7 * t), 0.5 * t
    rates = np.array([0.3 * np.cos(t), -0.14 * np.sin(0.7 * t), np.full_like(t, 0.5)])
    p = rates[0] - np.sin(theta) * rates[2]
    q = np.cos(phi) * rates[1] + np.sin(phi) * np.cos(theta) * rates[2]
    r = -np.sin(phi) * rates[1] + np.cos(phi) * np.cos(theta) * rates[2]
    form = Form(
        "turning", "", ("roll", "pitch", "yaw"), ("K_pdot", "M_qdot", "N_rdot", "K_p", "M_q", "N_r"), {},
        {"N": (("N", 1.0),)},
    )  # fmt: skip
    angles = {"phi": phi, "theta": theta, "psi": psi}
    channels = {n: Channel(n, "rad", t, v) for n, v in angles.items()}
    channels["N"] = Channel("N", "N m", t, np.sign(np.sin(t)))
    (record,) = prepare_form(Trial("roll", channels), form)
    motion = motion_of(record, form)
    found = np.column_stack([np.interp(t, motion.t, motion.nu[:, j]) for j in (3, 4, 5)])
    assert np.abs(found - np.column_stack([p, q, r]))[10:-10].max() < 2e-3


def test_inputs_keep_their_impulse_and_their_delay():
    form = coupled().fixing({"delay": 0.33})
    (record,) = prepare_form(velocity_run(0, 2.0, 0.06, 0.0), form)
    t = np.arange(1.0, 35.0, 0.1)
    drives = drives_of(record, form, t, 0.1)
    edge = np.flatnonzero(np.abs(np.diff(drives[:, 1])) > 0.0)
    exact = 0.06 * ((4.33 - 1.95) - (5.95 - 4.33))
    assert 0.1 * np.sum(drives[10:50, 1]) == pytest.approx(exact, abs=1e-9)
    assert len(edge) > 5


def test_a_lag_is_the_exact_first_order_response():
    t_in = np.array([0.0, 1.0, 2.5])
    form = coupled().fixing({"lag": 0.4})
    trial = velocity_run(0, 2.0, 0.06, 0.0, duration=10.0)
    channels = {**trial.channels, "N": Channel("N", "N m", t_in, np.array([0.0, 1.0, 0.0]))}
    (record,) = prepare_form(Trial("lag", channels), form)
    t = np.arange(0.1, 5.0, 0.05)
    found = drives_of(record, form, t, 0.05)[:, 1]
    rise = 1.0 - np.exp(-(t - 1.0) / 0.4)
    exact = np.where(t < 1.0, 0.0, np.where(t < 2.5, rise, (1.0 - np.exp(-1.5 / 0.4)) * np.exp(-(t - 2.5) / 0.4)))
    assert np.abs(found - exact).max() < 0.03


def test_a_nonlinear_parameter_is_rejected():
    with pytest.raises(UsageError, match="delay"):
        fit(velocity_run(0, 2.0, 0.06, 0.0), coupled("delay"), "least-squares")


def test_an_equation_without_scale_is_rejected():
    form = Form(
        "sway alone", "", ("surge", "sway", "yaw"),
        ("X_udot", "N_rdot", "Y_vdot", "X_u", "N_r", "Y_v", "Y_ur"), {},
        {"X": (("X", 1.0),), "N": (("N", 1.0),)}, coriolis=False,
    )  # fmt: skip
    with pytest.raises(UsageError, match=r"sway.*ratios"):
        fit(velocity_run(0, 2.0, 0.06, 0.001), form, "least-squares")


def test_a_velocity_that_was_not_measured_is_reported():
    run = velocity_run(0, 2.0, 0.06, 0.0)
    blind = Trial("no v", {n: c for n, c in run.channels.items() if n != "v"})
    with pytest.raises(MissingChannel, match="velocity v"):
        fit(blind, coupled(), "least-squares")
