"""The compiled filter against a textbook one written here with dense matrices, and its score against differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from gcs_autotune.identify.kalman.filter_bank import FilterBank, Levels, Prior
from gcs_autotune.identify.signals import prepare_form
from gcs_autotune.models import Form
from gcs_autotune.trial import Channel, Trial

INERTIA, DRAG = 2.0, 0.8
FORM = Form("yaw", "yaw", ("yaw",), ("N_rdot", "N_r"), {}, {"N": (("N", 1.0),)}, coriolis=False)
THETA = np.array([-INERTIA, -DRAG])
R, Q = np.array([0.02**2, 0.01**2]), 0.05**2
FIRST, SPREAD = np.array([0.1, -0.05]), np.array([0.2, 0.1])


def record(seed: int = 0):
    """Heading and rate at stamps of their own, uneven, the input jumping between them."""
    rng = np.random.default_rng(seed)
    t_r, t_psi = np.cumsum(rng.uniform(0.03, 0.2, 80)), np.cumsum(rng.uniform(0.1, 0.8, 20))
    t_N, h = np.arange(0.0, 12.0, 1.3), 1e-3
    N, motion = rng.uniform(-1.0, 1.0, len(t_N)), [(0.05, -0.02)]
    for k in range(round(t_psi[-1] / h) + 10):
        psi, r = motion[-1]
        push = N[int(k * h / 1.3)]
        gust = np.sqrt(Q * h) * rng.standard_normal()
        motion.append((psi + h * r, r + h * (push - DRAG * r) / INERTIA + gust))
    psi, r = np.array(motion).T
    grid = h * np.arange(len(psi))
    run = Trial(
        "own",
        {
            "N": Channel("N", "N m", t_N, N),
            "r": Channel("r", "rad/s", t_r, np.interp(t_r, grid, r) + 0.02 * rng.standard_normal(80)),
            "psi": Channel("psi", "rad", t_psi, np.interp(t_psi, grid, psi) + 0.01 * rng.standard_normal(20)),
        },
    )
    return prepare_form(run, FORM)[0]


def textbook(rec, inertia: float = INERTIA, drag: float = DRAG, q: float = Q):
    """Return log likelihood, filtered and smoothed means by dense discretisation (Van Loan) and Rauch-Tung-Striebel."""
    A = np.array([[0.0, 1.0], [0.0, -drag / inertia]])
    stamps = rec.stamps
    x, P, total = FIRST.copy(), np.diag(SPREAD**2), 0.0
    ahead, filtered = [], []
    for i, t in enumerate(stamps):
        F = np.eye(2)
        if i:
            at = stamps[i - 1]
            while at < t:
                later = rec.t_in[rec.t_in > at + 1e-12]
                to = min(t, later[0]) if len(later) else t
                N = rec.inputs[max(np.searchsorted(rec.t_in, at, side="right") - 1, 0), 0]
                big = np.zeros((3, 3))
                big[:2, :2], big[1, 2] = A, N / inertia
                E = expm(big * (to - at))
                x, F, at = E[:2, :2] @ x + E[:2, 2], E[:2, :2] @ F, to
            van = np.zeros((4, 4))
            van[:2, :2], van[1, 3], van[2:, 2:] = -A, q, A.T
            G = expm(van * (t - stamps[i - 1]))
            P = F @ P @ F.T + G[2:, 2:].T @ G[:2, 2:]
        ahead.append((x.copy(), P.copy(), F))
        for name, H, r in (("r", np.array([0.0, 1.0]), R[0]), ("psi", np.array([1.0, 0.0]), R[1])):
            signal = rec.signals[name]
            for y in signal.values[signal.t == t]:
                S = H @ P @ H + r
                e = y - H @ x
                K = P @ H / S
                x, P = x + K * e, P - np.outer(K, H @ P)
                total -= 0.5 * (e * e / S + np.log(2.0 * np.pi * S))
        filtered.append((x.copy(), P.copy()))
    smoothed = [filtered[-1][0]]
    for i in range(len(stamps) - 2, -1, -1):
        x_1, P_1, F = ahead[i + 1]
        G = filtered[i][1] @ F.T @ np.linalg.inv(P_1)
        smoothed.insert(0, filtered[i][0] + G @ (smoothed[0] - x_1))
    return total, np.array([f[0] for f in filtered]), np.array(smoothed)


def ours(rec, theta=THETA, r=R, q: float = Q, *, full: bool = True):
    bank = FilterBank(FORM, [rec], ())
    order = [("r", "psi").index(s) for s in bank.signals]
    levels = Levels(r[order], np.array([0.0, q]), np.zeros(0))
    prior = Prior(FIRST[None, :], SPREAD[None, :], np.zeros(0), np.zeros((0, 0)))
    return bank, levels, bank.run(theta, prior, levels, full=full)


def test_likelihood_filter_and_smoother_match_the_textbook():
    rec = record()
    bank, levels, result = ours(rec)
    total, filtered, smoothed = textbook(rec)
    path = bank.smooth(result, levels).trajectories[0]
    at = np.isin(bank.tracks[0].stamps, rec.stamps)
    assert result.log_likelihood == pytest.approx(total, abs=2e-3)
    assert result.histories[0].mean[at] == pytest.approx(filtered, abs=2e-5)
    assert path[at] == pytest.approx(smoothed, abs=2e-5)


def test_the_score_of_every_noise_level_is_the_derivative_of_the_likelihood():
    rec = record(1)
    bank, levels, result = ours(rec)
    seen = bank.smooth(result, levels)
    h = 1e-4
    for j, name in enumerate(bank.signals):
        i = ("r", "psi").index(name)
        up, down = (ours(rec, r=R * (1.0 + s * h * (np.arange(2) == i)))[2].log_likelihood for s in (1.0, -1.0))
        expected = (up - down) / (2.0 * h)
        assert 0.5 * levels.noise[j] * (seen.by_noise[0, j] - seen.by_noise[1, j]) == pytest.approx(expected, rel=1e-4)
    up, down = (ours(rec, q=Q * (1.0 + s * h))[2].log_likelihood for s in (1.0, -1.0))
    expected = (up - down) / (2.0 * h)
    assert 0.5 * Q * (seen.by_drive[0, 1] - seen.by_drive[1, 1]) == pytest.approx(expected, rel=1e-4)


def test_an_augmented_pass_about_a_fixed_path_is_linear_least_squares():
    """With the path held, the parameters after the pass are the Gauss-Newton step of the dense problem."""
    rec = record(2)
    bank = FilterBank(FORM, [rec], FORM.free)
    order = [("r", "psi").index(s) for s in bank.signals]
    levels = Levels(R[order], np.zeros(2), np.zeros(2))
    wide = np.diag([50.0**2, 50.0**2])
    prior = Prior(FIRST[None, :], SPREAD[None, :], THETA, wide)
    plain, calm, run = ours(rec, q=0.0)
    path = plain.smooth(run, calm).trajectories
    result = bank.run(THETA, prior, levels, about=path, full=True)

    def residuals(z: np.ndarray) -> np.ndarray:
        inertia, drag = -z[2], -z[3]
        x, at, out = z[:2].copy(), rec.stamps[0], []
        for t in rec.stamps:
            while at < t:
                later = rec.t_in[rec.t_in > at + 1e-12]
                to = min(t, later[0]) if len(later) else t
                N = rec.inputs[max(np.searchsorted(rec.t_in, at, side="right") - 1, 0), 0]
                x = solve_ivp(
                    lambda _, y, N=N: [y[1], (N - drag * y[1]) / inertia], (at, to), x, rtol=1e-9, atol=1e-11
                ).y[:, -1]
                at = to
            for name, place, r in (("r", 1, R[0]), ("psi", 0, R[1])):
                signal = rec.signals[name]
                out += [(y - x[place]) / np.sqrt(r) for y in signal.values[signal.t == t]]
        return np.concatenate([out, (z[:2] - FIRST) / SPREAD, (z[2:] - THETA) / 50.0])

    z = np.concatenate([path[0][0], THETA])
    base = residuals(z)
    J = np.column_stack([(residuals(z + 1e-5 * e) - residuals(z - 1e-5 * e)) / 2e-5 for e in np.eye(4)])
    step = -np.linalg.lstsq(J, base, rcond=None)[0]
    assert result.parameters - THETA == pytest.approx(step[2:], rel=2e-3)
    assert np.sqrt(np.diag(result.covariance)) == pytest.approx(np.sqrt(np.diag(np.linalg.inv(J.T @ J)))[2:], rel=2e-3)
