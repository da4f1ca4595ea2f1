"""Horizontal own plants for the tests of limits: equations by hand, Runge-Kutta of fixed step, any helmsman.

Shares nothing with the code under test. ``m_11 u' = X + X_0 + (X_u + X_uu|u|) u + m_22 v r`` and so on; SNAME signs,
so ``X_u < 0`` damps and ``m_11 = -X_udot``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from gcs_autotune.trial import Channel, Trial

BOAT = {
    "X_udot": -25.0, "Y_vdot": -27.0, "N_rdot": -2.8,
    "X_u": -3.5, "X_uu": -4.0, "Y_v": -30.0, "Y_r": -1.4, "N_v": 3.0, "N_r": -4.0, "N_rr": -1.5,
}  # fmt: skip
"""A small boat that keeps its course: forces in N, moments in N m."""

NOISE = {"x": 0.05, "y": 0.05, "psi": 0.005, "u": 0.02, "v": 0.02, "r": 0.005}
UNITS = {"x": "m", "y": "m", "psi": "rad", "u": "m/s", "v": "m/s", "r": "rad/s"}

Helm = Callable[[float, np.ndarray], tuple[float, float]]
"""(t, state x y psi u v r) -> (X, N), held for a sample."""


def rates(p: Mapping[str, float], s: np.ndarray, X: float, N: float) -> np.ndarray:
    _, _, psi, u, v, r = s
    m_11, m_22, m_33 = -p["X_udot"], -p["Y_vdot"], -p["N_rdot"]
    surge = X + p.get("X_0", 0.0) + (p["X_u"] + p["X_uu"] * abs(u)) * u + m_22 * v * r
    sway = (p["Y_v"] + p.get("Y_vv", 0.0) * abs(v)) * v + p["Y_r"] * r - m_11 * u * r
    yaw = N + p.get("N_0", 0.0) + p["N_v"] * v + (p["N_r"] + p["N_rr"] * abs(r)) * r - (m_22 - m_11) * u * v
    c, n = np.cos(psi), np.sin(psi)
    return np.array([u * c - v * n, u * n + v * c, r, surge / m_11, sway / m_22, yaw / m_33])


def sail(p: Mapping[str, float], helm: Helm, seconds: float, *, dt: float = 0.1, h: float = 0.02) -> tuple:
    """Return t (k,), states (k, 6) and inputs (k, 2) from rest."""
    s, out, pushed, every = np.zeros(6), [], [], round(dt / h)
    t = np.arange(round(seconds / dt)) * dt
    for now in t:
        X, N = helm(float(now), s)
        out.append(s)
        pushed.append((X, N))
        for _ in range(every):
            a = rates(p, s, X, N)
            b = rates(p, s + 0.5 * h * a, X, N)
            c = rates(p, s + 0.5 * h * b, X, N)
            d = rates(p, s + h * c, X, N)
            s = s + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
    return t, np.array(out), np.array(pushed)


def recorded(
    helm: Helm,
    seconds: float,
    seed: int,
    *,
    boat: Mapping[str, float] = BOAT,
    name: str = "run",
    signals: tuple[str, ...] = ("psi", "u", "v", "r"),
    scale: float = 1.0,
    after: float = 0.0,
) -> Trial:
    """Return a noisy run; ``after`` cuts its first seconds off, ``scale`` multiplies the noise."""
    t, S, tau = sail(boat, helm, seconds)
    keep = t >= after
    rng = np.random.default_rng(seed)
    channels = {}
    for i, n in enumerate(UNITS):
        noisy = S[:, i] + rng.normal(0.0, scale * NOISE[n], len(t))
        if n in signals:
            channels[n] = Channel(n, UNITS[n], t[keep], noisy[keep])
    channels["X"] = Channel("X", "N", t[keep], tau[keep, 0])
    channels["N"] = Channel("N", "N m", t[keep], tau[keep, 1])
    return Trial(name, channels)


def circle(X: float = 25.0, N: float = 4.0, wobble: float = 0.0) -> Helm:
    """Steady thrust and steering; *wobble* a small slow change of both so that the inputs are not constant."""

    def helm(t: float, s: np.ndarray) -> tuple[float, float]:
        share = 1.0 + wobble * (1.0 if int(t / 10.0) % 2 else -1.0)
        return X * share, N * share

    return helm


class Zigzag:
    """Kempf manoeuvre at constant thrust."""

    def __init__(self, X: float = 25.0, N: float = 5.0, angle: float = 20.0, approach: float = 8.0) -> None:
        self.X, self.N, self.angle, self.approach, self.sign = X, N, np.radians(angle), approach, 1.0

    def __call__(self, t: float, s: np.ndarray) -> tuple[float, float]:
        if t < self.approach:
            return self.X, 0.0
        if self.sign * s[2] > self.angle:
            self.sign = -self.sign
        return self.X, self.sign * self.N


class Steps:
    """Random levels of both inputs."""

    def __init__(self, seed: int, hold: float = 4.0) -> None:
        rng = np.random.default_rng(seed)
        self.X, self.N, self.hold = rng.uniform(5.0, 40.0, 200), rng.uniform(-6.0, 6.0, 200), hold

    def __call__(self, t: float, s: np.ndarray) -> tuple[float, float]:
        i = int(t / self.hold)
        return float(self.X[i]), float(self.N[i])
