"""CyberShip II as a water of its own for benchmarks and tests: an integrator that shares nothing with the package.

Coefficients: Skjetne, Smogeli and Fossen 2004, "A nonlinear ship manoeuvering model: identification and adaptive
control with experiments for a model ship", Modeling, Identification and Control 25(1), tables 1, 2 and 4, of which
those of the form of ZhaoUSV, (1)-(7), are used: three inertias, five linear and five quadratic drags; ``Y_rdot`` and
``N_vdot`` are zero, which is why ZhaoUSV has no percentages for them. Two equal thrusters 0.4 m apart (our choice).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.models import Form
from gcs_autotune.trial import Channel, Trial

__all__ = ["FORM", "KNOWN", "TRUTH", "sail"]

Array = NDArray[np.float64]

KNOWN = {"m": 23.8, "I_z": 1.76, "x_G": 0.046}
TRUTH = {
    "X_udot": -2.0,
    "Y_vdot": -10.0,
    "Y_rdot": 0.0,
    "N_vdot": 0.0,
    "N_rdot": -1.0,
    "X_u": -0.72253,
    "Y_v": -0.88965,
    "Y_r": -7.25,
    "N_v": 0.0313,
    "N_r": -1.9,
    "X_uu": -1.32742,
    "Y_vv": -36.47287,
    "Y_rr": -3.45,
    "N_vv": 3.95645,
    "N_rr": -0.75,
}
BEAM = 0.4
"""Distance of the thrusters [m]."""

FORM = Form(
    name="cybership-2",
    title="CyberShip II with twin thrusters, ZhaoUSV (1)-(7)",
    dofs=("surge", "sway", "yaw"),
    free=tuple(TRUTH),
    known=KNOWN,
    inputs={"T_1": (("X", 1.0), ("N", BEAM / 2.0)), "T_2": (("X", 1.0), ("N", -BEAM / 2.0))},
)

_ZIGZAG = ((2.5, 0.5), (0.5, 2.5), (2.0, 2.0), (-1.0, 1.0), (1.5, -1.0), (3.0, 1.0), (0.0, 2.0), (2.5, -0.5))


def thrust(motion: str, t: float, duration: float) -> tuple[float, float]:
    """Return port and starboard thrust [N]: a circle entered from rest and left by coasting, or a rich zig-zag."""
    if motion == "circle":
        return (2.0, 1.0) if 2.0 <= t < 0.7 * duration else (0.0, 0.0)
    return _ZIGZAG[int(t / 8.0) % len(_ZIGZAG)]


def _rate(z: Array, T: tuple[float, float]) -> Array:
    psi, u, v, r = z[2], z[3], z[4], z[5]
    k = TRUTH
    m11, m22 = KNOWN["m"] - k["X_udot"], KNOWN["m"] - k["Y_vdot"]
    m23, m33 = KNOWN["m"] * KNOWN["x_G"], KNOWN["I_z"] - k["N_rdot"]
    X = T[0] + T[1] + (k["X_u"] + k["X_uu"] * abs(u)) * u + (m22 * v + m23 * r) * r
    Y = (k["Y_v"] + k["Y_vv"] * abs(v)) * v + (k["Y_r"] + k["Y_rr"] * abs(r)) * r - m11 * u * r
    N = BEAM / 2.0 * (T[0] - T[1]) + (k["N_v"] + k["N_vv"] * abs(v)) * v + (k["N_r"] + k["N_rr"] * abs(r)) * r
    N -= (m22 * v + m23 * r) * u - m11 * u * v
    det = m22 * m33 - m23 * m23
    c, s = np.cos(psi), np.sin(psi)
    return np.array([u * c - v * s, u * s + v * c, r, X / m11, (m33 * Y - m23 * N) / det, (m22 * N - m23 * Y) / det])


def sail(
    motion: str,
    seed: int,
    *,
    noise: float,
    duration: float = 120.0,
    dt: float = 0.1,
    gust: float = 0.0,
    acceleration_noise: float = 0.0,
    signals: tuple[str, ...] = ("u", "v", "r"),
) -> Trial:
    """Return a run sampled every *dt* seconds.

    noise : standard deviation of velocities and angles [m/s, rad/s, rad], ten times that of positions [m]. gust :
    standard deviation a velocity gains from disturbances in 1 s. Accelerations are channels ``du dv dr``.
    """
    rng = np.random.default_rng(seed)
    n, h = round(duration / dt), dt / 4.0
    z, rows, inputs = np.zeros(6), [], []
    for i in range(n):
        T = thrust(motion, i * dt, duration)
        rows.append(np.concatenate([z, _rate(z, T)[3:]]))
        inputs.append(T)
        for _ in range(4):
            k1 = _rate(z, T)
            k2 = _rate(z + h / 2.0 * k1, T)
            k3 = _rate(z + h / 2.0 * k2, T)
            k4 = _rate(z + h * k3, T)
            z = z + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
            if gust:
                z[3:] += gust * np.sqrt(h) * rng.standard_normal(3)
    t, Z, U = np.arange(n) * dt, np.array(rows), np.array(inputs)
    channels = {f"T_{i + 1}": Channel(f"T_{i + 1}", "N", t, U[:, i]) for i in range(2)}
    size = {"x": 10.0 * noise, "y": 10.0 * noise, "du": acceleration_noise, "dv": acceleration_noise}
    size["dr"] = acceleration_noise
    for i, name in enumerate(("x", "y", "psi", "u", "v", "r", "du", "dv", "dr")):
        noisy = Z[:, i] + size.get(name, noise) * rng.standard_normal(n)
        if name in signals or name.startswith("d"):
            channels[name] = Channel(name, "SI", t, noisy)
    return Trial(f"{motion} {seed}", channels)
