"""Coupled own plants for these tests: the equations written out by hand, SciPy's integrator to fine tolerance.

Shares nothing with the code under test. Surge, sway and yaw as ZhaoUSV (1)-(2): ``M nu_dot + C(nu) nu + D(nu) nu =
tau`` with ``m_11``, ``m_22``, ``m_23 = m_32``, ``m_33`` and all signs of the drag damping.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from scipy.integrate import solve_ivp

Array = np.ndarray
Rates = Callable[[Array, Array], Array]

BOAT = {
    "X_udot": -25.0, "Y_vdot": -34.0, "N_rdot": -2.8, "Y_rdot": -1.1,
    "X_u": -1.5, "X_uu": -4.0, "Y_v": -8.0, "Y_vv": -30.0, "Y_r": -0.4, "N_v": 0.6, "N_r": -1.9, "N_rr": -1.5,
    "X_0": 0.2, "N_0": 0.05,
}  # fmt: skip
"""A small boat, 14 parameters: forces in N, moments in N m."""


def horizontal(p: Mapping[str, float]) -> Rates:
    """Return the rates of (x, y, psi, u, v, r) under the inputs (X, N)."""
    g = {**dict.fromkeys(("X_0", "Y_0", "N_0", "Y_r", "N_v", "Y_rdot"), 0.0), **p}
    m_11, m_22, m_23, m_33 = -g["X_udot"], -g["Y_vdot"], -g["Y_rdot"], -g["N_rdot"]
    det = m_22 * m_33 - m_23 * m_23

    def rates(s: Array, tau: Array) -> Array:
        _, _, psi, u, v, r = s
        X = tau[0] + g["X_0"] + (g["X_u"] + g["X_uu"] * abs(u)) * u + (m_22 * v + m_23 * r) * r
        Y = g.get("Y_0", 0.0) + (g["Y_v"] + g["Y_vv"] * abs(v)) * v + g["Y_r"] * r - m_11 * u * r
        N = tau[1] + g["N_0"] + g["N_v"] * v + (g["N_r"] + g["N_rr"] * abs(r)) * r
        N += -(m_22 * v + m_23 * r) * u + m_11 * u * v
        v_dot, r_dot = (m_33 * Y - m_23 * N) / det, (m_22 * N - m_23 * Y) / det
        c, n = np.cos(psi), np.sin(psi)
        return np.array([u * c - v * n, u * n + v * c, r, X / m_11, v_dot, r_dot])

    return rates


def sail(rates: Rates, s_0: Array, t: Array, t_in: Array, tau: Array, *, delay: float = 0.0) -> Array:
    """Return the states (len(t), n); the inputs ``tau`` (j, m) hold from their stamps plus *delay* on."""
    out, s, now, row = [], np.asarray(s_0, dtype=float), float(t[0]), 0
    jumps = t_in[1:] + delay
    for stop in t:
        while now < stop:
            while row < len(jumps) and jumps[row] <= now + 1e-12:
                row += 1
            until = min(float(stop), float(jumps[row]) if row < len(jumps) else np.inf)
            held = tau[row]
            s = solve_ivp(lambda _, x, h=held: rates(x, h), (now, until), s, rtol=1e-9, atol=1e-11).y[:, -1]
            now = until
        out.append(s)
    return np.array(out)


def levels(rng: np.random.Generator, t: Array, hold: float, low: float, high: float) -> Array:
    """Return random levels, each held for *hold* seconds."""
    values = rng.uniform(low, high, int(t[-1] / hold) + 2)
    return values[(t / hold).astype(int)]
