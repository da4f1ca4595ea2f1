"""Identify any linear process with n poles and m zeros from several limit cycles, Miskovic2010, eq. (6.16)-(6.19).

The process is ``G(s) = sum b_i s^i / sum a_i s^i * exp(-s T_d) / s^k`` with ``a_0 = 1``. Each experiment supplies one
complex equation, ``sum a_i (j omega)^i + (P* + j Q*) sum b_i (j omega)^i = 0``. Its real and imaginary parts are two
rows. ``P + j Q`` is either the relay's describing function, which is accurate to the first harmonic
(:func:`identify_process`), or ``-1/G`` measured at any frequency (:func:`process_from_response`).

The closed heading loop is such a process (Miskovic2010, 6.6.4). The relay is outside the autopilot and commands the
heading, ``psi_ref = psi_ref* +/- C``. The result is ``psi/psi_ref = (b_1 s + 1)/(a_3 s^3 + a_2 s^2 + a_1 s + 1)``,
(6.49). On a first-order steering equation, every autopilot of Table 8.1 except the classical PID leads to this form.
Algorithm 8.7 is in ``control.line``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gcs_autotune.errors import MissingChannel, NotInformative
from gcs_autotune.identify.frequency.response import FrequencyResponse
from gcs_autotune.identify.relay.iso import from_delay, from_integrators, relay
from gcs_autotune.identify.relay.limit_cycle import find_cycles
from gcs_autotune.identify.result import LimitCycle
from gcs_autotune.models import TransferFunction
from gcs_autotune.sname import DOFS
from gcs_autotune.trial import Trial

__all__ = [
    "experiments_needed",
    "heading_loop",
    "identify_process",
    "loop_cycles",
    "loop_process",
    "loop_trial",
    "process_from_response",
]

Array = NDArray[np.float64]

ROUNDS = 12
"""Maximum number of solutions of the weighted equations. The weights settle after five to eight. Project choice."""


def experiments_needed(n: int, m: int, *, gain_known: bool = False) -> int:
    """Return the number of limit cycles needed for *n* poles and *m* zeros, Miskovic2010 (6.11).

    gain_known : whether the gain b_0 is known, which reduces the number of unknowns by one.
    """
    return math.ceil((n + m + (0 if gain_known else 1)) / 2)


def identify_process(
    cycles: Sequence[LimitCycle],
    n: int,
    m: int,
    integrators: int = 0,
    delay: float = 0.0,
    *,
    gain: float | None = None,
) -> TransferFunction:
    """Identify a linear process from limit cycles, accurate to the first harmonic.

    The bias ``x_0`` and the actual switching value ``x_a*`` of each cycle are used. Equation (6.25) includes
    *integrators*, and equation (6.31) includes *delay* [s].

    Parameters
    ----------
    n, m : numbers of poles (without integrators) and zeros, n > m unless there are integrators.
    gain : b_0 if known, such as 1 for a closed loop with integral action, Miskovic2010, eq. (6.51).

    Raises
    ------
    NotInformative
        There are too few cycles, or they are too similar for the requested order.
    """
    balance = [complex(*relay(c.C, c.X_m, c.x_a_star, c.x_0)) for c in cycles]
    return _solve([c.omega for c in cycles], balance, n, m, integrators, delay, gain, np.ones(len(cycles)))


def process_from_response(
    omega: ArrayLike,
    response: ArrayLike,
    n: int,
    m: int,
    integrators: int = 0,
    delay: float = 0.0,
    *,
    gain: float | None = None,
    std: ArrayLike | None = None,
) -> TransferFunction:
    """Identify a linear process from its measured frequency response.

    The equations are those of :func:`identify_process`. Three harmonics of one limit cycle are three points. The
    harmonics that the describing function neglects are therefore used here.

    Parameters
    ----------
    omega : (k,) frequencies [rad/s].
    response : (k,) complex response of the whole process including integrators and delay.
    std : (k,) standard deviation of *response*. Each equation is weighted by the inverse of its relative value.

    Raises
    ------
    NotInformative
        :func:`identify_process` raised the error.
    """
    value = np.asarray(response, dtype=np.complex128)
    weight = np.ones(len(value)) if std is None else np.abs(value) / np.asarray(std, dtype=np.float64)
    return _solve(list(np.asarray(omega, dtype=np.float64)), list(-1.0 / value), n, m, integrators, delay, gain, weight)


def _solve(
    omega: Sequence[float],
    balance: Sequence[complex],
    n: int,
    m: int,
    integrators: int,
    delay: float,
    gain: float | None,
    weight: Array,
) -> TransferFunction:
    """Return the process that solves (6.16) by least squares (6.19).

    If there are more equations than unknowns, the rows are weighted so that *relative* errors of the response count.
    Each row is divided by the denominator of the previous solution (Sanathanan1963).
    """
    unknown = n + m + (1 if gain is None else 0)
    needed = experiments_needed(n, m, gain_known=gain is not None)
    if len(omega) < needed:
        raise NotInformative(
            f"a model with {n} poles and {m} zeros needs {needed} limit cycles or frequencies, but {len(omega)} were "
            "supplied. Fly further relay experiments with other C (output) or x_a (switching value), or request a "
            "lower order"
        )
    rows = np.array([_row(w, v, n, m, integrators, delay) for w, v in zip(omega, balance, strict=True)])
    powers = (1j * np.asarray(omega))[:, None] ** np.arange(n + 1)
    known = -np.ones(len(rows), dtype=np.complex128)
    if gain is not None:
        known -= gain * rows[:, n]
        rows = np.delete(rows, n, axis=1)
    size = np.ones(len(rows)) if len(omega) == needed else weight
    for _ in range(1 if len(omega) == needed else ROUNDS):
        theta, rank = _least_squares(np.asarray(rows * size[:, None], dtype=np.complex128), known * size)
        if rank < unknown:
            raise NotInformative(
                f"the {len(omega)} limit cycles are too similar to determine {n} poles and {m} zeros. Use relays of "
                "clearly different C (output) or x_a (switching value), or request a lower order"
            )
        size = weight / np.maximum(np.abs(powers @ [1.0, *theta[:n]]), np.finfo(float).tiny)
    b = theta[n:] if gain is None else [gain, *theta[n:]]
    return TransferFunction(tuple(b), (1.0, *theta[:n]), integrators, delay)


def _least_squares(rows: NDArray[np.complex128], known: NDArray[np.complex128]) -> tuple[list[float], int]:
    """Return the real least-squares solution and the rank.

    Columns are scaled, because powers of omega differ by orders of magnitude.
    """
    table, wanted = np.concatenate([rows.real, rows.imag]), np.concatenate([known.real, known.imag])
    scale = np.maximum(np.linalg.norm(table, axis=0), np.finfo(float).tiny)
    solution, _, rank, _ = np.linalg.lstsq(table / scale, wanted, rcond=1e-10)
    return [float(v) for v in solution / scale], int(rank)


def _row(omega: float, balance: complex, n: int, m: int, integrators: int, delay: float) -> NDArray[np.complex128]:
    """Return the complex row for ``a_1..a_n, b_0..b_m``, Miskovic2010, eq. (6.17)-(6.18)."""
    P, Q = from_integrators(balance.real, balance.imag, omega, integrators)
    P, Q = from_delay(P, Q, omega, delay)
    s = 1j * omega
    return np.array([*(s**i for i in range(1, n + 1)), *(complex(P, Q) * s**i for i in range(m + 1))])


LOOPS: Mapping[str, tuple[str, str]] = {"psi_ref": ("psi", "yaw"), "z_ref": ("z", "heave"), "u_ref": ("u", "surge")}
"""Commanded channel -> responding channel, and the degree of freedom that represents the loop.

The command becomes the input of that degree of freedom, and the response becomes its position. For ``u_ref`` the speed
replaces the position, because the loop controls the speed.
"""


def heading_loop(cycle_1: LimitCycle, cycle_2: LimitCycle, *further: LimitCycle) -> TransferFunction:
    """Return the transfer function of the closed heading loop from two or more limit cycles, Miskovic2010, eq. (6.52).

    Its static gain is 1.

    Raises
    ------
    NotInformative
        The cycles are too similar.
    """
    return identify_process((cycle_1, cycle_2, *further), n=3, m=1, gain=1.0)


def loop_trial(trial: Trial) -> Trial:
    """Return *trial* with a closed loop written as one degree of freedom.

    The commanded value (heading, depth or speed) becomes the input, and the response becomes the position. Functions
    for one degree of freedom can then be used.

    Raises
    ------
    MissingChannel
        The run contains neither ``psi_ref`` and ``psi`` nor those channels of depth or speed.
    """
    command = next((r for r, (signal, _) in LOOPS.items() if r in trial and signal in trial), None)
    if command is None:
        raise MissingChannel(
            f"run '{trial.name}' contains no closed loop. It needs psi_ref[rad] (the relay command) and psi[rad], or "
            f"z_ref[m] and z[m], or u_ref[m/s] and u[m/s]. Its columns are {', '.join(trial.channels)}"
        )
    signal, dof = LOOPS[command]
    reference, names = trial[command], DOFS[dof]
    values = np.unwrap(reference.values) if names.angular else reference.values
    channels = {
        names.position: replace(trial[signal], name=names.position),
        names.force: replace(reference, name=names.force, values=values),
    }
    return replace(trial, channels=channels, meta={**trial.meta, "dof": dof})


def loop_cycles(trials: Trial | Sequence[Trial]) -> tuple[LimitCycle, ...]:
    """Return the limit cycles of relays that command a set-point.

    ``C`` is in the unit of the set-point, for headings in rad.

    Raises
    ------
    MissingChannel, BadFile, NotInformative
        :func:`loop_trial` or :func:`gcs_autotune.identify.relay.limit_cycle.find_cycles` raised the error.
    """
    runs = (trials,) if isinstance(trials, Trial) else tuple(trials)
    parts = [loop_trial(run) for run in runs]
    return tuple(cycle for part in parts for cycle in find_cycles(part, str(part.meta["dof"])))


def loop_process(response: FrequencyResponse, n: int, m: int, *, gain: float | None = None) -> TransferFunction:
    """Return the process from input to *position* with *n* poles and *m* zeros.

    *response* is the response from input to velocity, from harmonics. This function is the exact counterpart of
    :func:`identify_process`. It needs records and not only readings. For the closed heading loop n = 3, m = 1, gain =
    1.

    Raises
    ------
    NotInformative
        There are too few frequencies.
    """
    s = 1j * response.omega
    return process_from_response(response.omega, response.value / s, n, m, gain=gain, std=response.std / response.omega)
