"""IS-O for any linear process with n poles and m zeros, from several limit cycles: thesis (6.16)-(6.19).

``G(s) = sum b_i s^i / sum a_i s^i * exp(-s T_d) / s^k`` with ``a_0 = 1``. Each experiment balances one complex
equation, ``sum a_i (j omega)^i + (P* + j Q*) sum b_i (j omega)^i = 0``; its real and imaginary parts are two rows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.relay.describing_function import from_delay, from_integrators, relay
from gcs_autotune.identify.result import LimitCycle

__all__ = ["TransferFunction", "experiments_needed", "identify_transfer_function"]


@dataclass(frozen=True, slots=True)
class TransferFunction:
    """``numerator`` b_0..b_m, ``denominator`` a_0..a_n (rising powers, a_0 = 1), *integrators*, *delay* [s]."""

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]
    integrators: int
    delay: float


def experiments_needed(n: int, m: int) -> int:
    """Return how many limit cycles determine *n* poles and *m* zeros, thesis (6.11)."""
    return math.ceil((n + m + 1) / 2)


def identify_transfer_function(
    cycles: Sequence[LimitCycle], n: int, m: int, integrators: int = 0, delay: float = 0.0
) -> TransferFunction:
    """Identify the coefficients by least squares over all *cycles*.

    Columns are scaled before the pseudo-inverse (6.19), because powers of omega differ by orders of magnitude.

    Raises
    ------
    NotInformative
        Too few cycles, or cycles too alike for the order asked for.
    """
    needed = experiments_needed(n, m)
    if len(cycles) < needed:
        raise NotInformative(
            f"{n} poles and {m} zeros need {needed} limit cycles, {len(cycles)} given: "
            "fly further relay experiments with other C or x_a, or ask for a lower order"
        )
    rows = [_balance(cycle, n, m, integrators, delay) for cycle in cycles]
    table = np.concatenate([[row.real, row.imag] for row in rows])
    wanted = np.tile([-1.0, 0.0], len(cycles))
    scale = np.maximum(np.linalg.norm(table, axis=0), np.finfo(float).tiny)
    solution, _, rank, _ = np.linalg.lstsq(table / scale, wanted, rcond=1e-10)
    if rank < n + m + 1:
        raise NotInformative(
            f"the {len(cycles)} limit cycles are too alike to determine {n} poles and {m} zeros: "
            "use relays of clearly different C or x_a, or ask for a lower order"
        )
    theta = solution / scale
    a, b = (float(v) for v in theta[:n]), (float(v) for v in theta[n:])
    return TransferFunction(tuple(b), (1.0, *a), integrators, delay)


def _balance(cycle: LimitCycle, n: int, m: int, integrators: int, delay: float) -> NDArray[np.complex128]:
    """Return the row of ``a_1..a_n, b_0..b_m``, thesis (6.17)-(6.18) in complex form."""
    P, Q = relay(cycle.C, cycle.X_m, cycle.x_a_star, cycle.x_0)
    P, Q = from_delay(*from_integrators(P, Q, cycle.omega, integrators), cycle.omega, delay)
    s = 1j * cycle.omega
    poles = [s**i for i in range(1, n + 1)]
    zeros = [complex(P, Q) * s**i for i in range(m + 1)]
    return np.array(poles + zeros, dtype=np.complex128)
