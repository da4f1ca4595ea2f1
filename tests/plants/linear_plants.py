"""Linear processes of any order under a relay, stepped exactly: shares nothing with the code under test."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import expm

from gcs_autotune.trial import Channel, Trial


def relay_run(
    numerator: Sequence[float],
    denominator: Sequence[float],
    C: float,
    x_a: float,
    duration: float,
    *,
    dt: float = 0.005,
    every: int = 1,
    delay: float = 0.0,
    integrators: int = 0,
    bias: float = 0.0,
    noise: float = 0.0,
    channels: tuple[str, str] = ("N", "psi"),
) -> Trial:
    """A relay of output C around b(s)/(a(s) s^k) exp(-s delay), rising powers; sampled every so many steps of dt."""
    a = np.concatenate([np.zeros(integrators), denominator])
    n = len(a) - 1
    A = np.zeros((n + 1, n + 1))
    A[: n - 1, 1:n] = np.eye(n - 1)
    A[n - 1, :n], A[n - 1, n] = -a[:-1] / a[-1], 1.0
    step = expm(A * dt)
    c = np.zeros(n)
    c[: len(numerator)] = np.asarray(numerator) / a[-1]
    x, high, u = np.zeros(n), True, C
    pipe = [0.0] * round(delay / dt)
    rows = []
    rng = np.random.default_rng(0)
    for k in range(round(duration / dt)):
        if k % every == 0:
            y = float(c @ x) + noise * rng.normal()
            high = True if -y > x_a else False if -y < -x_a else high
            u = C if high else -C
            rows.append((k * dt, y, u))
        pipe.append(u + bias)
        x = step[:n, :n] @ x + step[:n, n] * pipe.pop(0)
    t, y_, u_ = np.array(rows).T
    given, seen = channels
    meta = {"manoeuvre": "relay", "dof": "yaw", "x_a": x_a}
    return Trial("r", {seen: Channel(seen, "rad", t, y_), given: Channel(given, "N m", t, u_)}, meta=meta)
