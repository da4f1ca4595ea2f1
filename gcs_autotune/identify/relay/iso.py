"""IS-O: identification by self-oscillation, from one limit cycle (Miskovic2010, Table 6.3).

The relay is represented by its describing function. The relay's input is ``x = x_0 + X_m sin(omega t)`` and its output
is ``C`` or ``-C``. It switches at ``+/- x_a``. To the first harmonic the output is ``Y_0 + (P_N + j Q_N) (x - x_0)``,
(5.10)-(5.14). Integrators and delays rotate the phase of the output.

Both drag structures are calculated from the same
reading. Three corrections are applied: bias (5.13), known delay (6.31), and actual switching value (6.5). The result is
approximate, because only the first harmonic is balanced. Output error (:mod:`gcs_autotune.identify.problems.solution`)
uses the result as start values. Two limit cycles decide between the structures, (7.1)-(7.2). The structure whose drag
coefficient differs less between them describes the craft better. The difference of ``alpha`` is the same for both
structures and serves as a margin.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from typing import Literal

from gcs_autotune.identify.result import Decision, IsoEstimate, LimitCycle
from gcs_autotune.registry import lookup

__all__ = [
    "MARGINS",
    "constant_force",
    "decide",
    "estimate",
    "from_delay",
    "from_integrators",
    "is_valid",
    "quadratic_drag",
    "relay",
    "relay_bias",
    "two_experiment_decision",
]


def is_valid(X_m: float, x_a: float, x_0: float = 0.0) -> bool:
    """Return whether an oscillation satisfies Miskovic2010, eq. (7.12), the condition for the describing function.

    X_m, x_a, x_0 : amplitude, switching value and bias of the oscillation, all in one unit.
    """
    return X_m > 0.0 and x_a + abs(x_0) < X_m


def relay(C: float, X_m: float, x_a: float, x_0: float = 0.0) -> tuple[float, float]:
    """Return ``(P_N, Q_N)`` of a relay with hysteresis, Miskovic2010, eq. (5.13), (5.14) = (6.45), (6.46).

    ``C`` is in units of the input. ``X_m``, ``x_a`` and ``x_0`` are in the same unit of the output. If condition (7.12)
    is violated, a square root would be imaginary and is replaced by 0. :func:`is_valid` checks this condition.
    """
    upper = math.sqrt(max(0.0, 1.0 - ((x_a - x_0) / X_m) ** 2))
    lower = math.sqrt(max(0.0, 1.0 - ((x_a + x_0) / X_m) ** 2))
    return 2.0 * C / (math.pi * X_m) * (upper + lower), -4.0 * C * x_a / (math.pi * X_m**2)


def relay_bias(C: float, X_m: float, x_a: float, x_0: float = 0.0) -> float:
    """Return the relay's mean output ``Y_0`` for a biased input, Miskovic2010, eq. (5.11).

    It requires |x_a| + |x_0| <= X_m.
    """
    return C / math.pi * (math.asin((x_a + x_0) / X_m) - math.asin((x_a - x_0) / X_m))


def from_integrators(P: float, Q: float, omega: float, k: int) -> tuple[float, float]:
    """Return the describing function ``(P, Q)`` after moving *k* integrators from the process to the relay.

    Source: Miskovic2010, eq. (6.25). omega : frequency [rad/s].
    """
    for _ in range(k):
        P, Q = Q / omega, -P / omega
    return P, Q


def from_delay(P: float, Q: float, omega: float, delay: float) -> tuple[float, float]:
    """Return the describing function ``(P, Q)`` after moving a known *delay* [s] from the process to the relay.

    Source: Miskovic2010, eq. (6.31). omega : frequency [rad/s].
    """
    cosine, sine = math.cos(omega * delay), math.sin(omega * delay)
    return P * cosine + Q * sine, Q * cosine - P * sine


def quadratic_drag(nu_0: float, amplitude: float) -> tuple[float, float]:
    """Return the mean and the gain of ``|nu| nu`` for ``nu = nu_0 + amplitude sin(omega t)``, amplitude > 0.

    Miskovic2010 (6.41)-(6.43) contains the gain for ``nu_0 = 0``, which is ``8/(3 pi) amplitude``. Here the Fourier
    integrals are solved for any *nu_0*, because surge may oscillate around a speed (6.48). If ``|nu_0|`` exceeds the
    amplitude, the velocity never changes sign and the gain is ``2 |nu_0|``.
    """
    if abs(nu_0) >= amplitude:
        return math.copysign(nu_0**2 + 0.5 * amplitude**2, nu_0), 2.0 * abs(nu_0)
    s = nu_0 / amplitude
    theta, c = math.asin(s), math.sqrt(1.0 - s * s)
    mean = amplitude**2 / math.pi * ((2.0 * s * s + 1.0) * theta + 3.0 * s * c)
    return mean, 4.0 * amplitude / math.pi * (s * theta + c - c**3 / 3.0)


def estimate(cycle: LimitCycle, delay: float = 0.0) -> IsoEstimate:
    """Return the inertia, both drags and the constant force that follow from *cycle*.

    The equations are those of Miskovic2010, Table 6.3, with two corrections. The printed (6.43) lacks a power of omega,
    because the velocity's amplitude is ``omega * X_m``. Here ``delta`` is on the same side of the equation as the
    input, so it is *minus* the input's mean (6.47). A negative ``C`` (an input that acts in the opposite direction)
    leads to negative parameters.

    Parameters
    ----------
    delay : total delay [s] in the loop between input and measured output.
    """
    P, Q = relay(cycle.C, cycle.X_m, cycle.x_a_star, cycle.x_0)
    P, Q = from_delay(P, Q, cycle.omega, delay)
    beta = -Q / cycle.omega
    return IsoEstimate(
        cycle=cycle,
        alpha=P / cycle.omega**2,
        beta=beta,
        beta_quadratic=beta / quadratic_drag(cycle.nu_0, cycle.omega * cycle.X_m)[1],
        delta=constant_force(cycle, beta, 0.0),
        delay=delay,
    )


def constant_force(cycle: LimitCycle, beta: float, beta_quadratic: float) -> float:
    """Return the constant force that balances drag and input on average over *cycle* [input unit].

    The force is on the side of the input in the equation of motion. Source: Miskovic2010, eq. (6.47). If the mean
    velocity is zero, the force is minus the input's mean, whatever the drag.
    """
    lost, _ = quadratic_drag(cycle.nu_0, cycle.omega * cycle.X_m)
    given = cycle.offset + cycle.C * (cycle.T_H - cycle.T_L) / (cycle.T_H + cycle.T_L)
    return beta * cycle.nu_0 + beta_quadratic * lost - given


MARGINS: Mapping[str, Callable[[float], float]] = {
    "none": lambda sigma_alpha: 0.0,
    "sigma": lambda sigma_alpha: sigma_alpha,
    "sigma+5": lambda sigma_alpha: sigma_alpha + 5.0,
    "sigma+10": lambda sigma_alpha: sigma_alpha + 10.0,
}
"""Name of a criterion -> function that returns the margin lambda [%] for sigma_alpha [%].

The criteria are 1 to 4 of Miskovic2010, 7.1.
"""


def decide(one: IsoEstimate, other: IsoEstimate, margin: str = "sigma") -> Decision:
    """Return the decision between linear damping (``linear``) and quadratic damping (``nonlinear``) from two
    experiments.

    margin : name of a criterion in :data:`MARGINS`.

    Raises
    ------
    UnknownName
        *margin* is not in :data:`MARGINS`.
    """
    sigma_alpha = _spread(one.alpha, other.alpha)
    sigma_beta = _spread(one.beta, other.beta)
    sigma_quadratic = _spread(one.beta_quadratic, other.beta_quadratic)
    width = lookup(MARGINS, margin, "decision margin")(sigma_alpha)
    difference = sigma_beta - sigma_quadratic
    verdict: Literal["linear", "nonlinear", "undecided"] = "undecided"
    if difference > width:
        verdict = "nonlinear"
    elif difference < -width:
        verdict = "linear"
    return Decision(sigma_alpha, sigma_beta, sigma_quadratic, width, verdict)


def two_experiment_decision(estimates: Sequence[IsoEstimate]) -> Decision | None:
    """Return the decision from the two most different limit cycles, or None if there are fewer than two cycles."""
    pair = _most_different_pair(tuple(estimates))
    return None if pair is None else decide(*pair)


def _most_different_pair(estimates: tuple[IsoEstimate, ...]) -> tuple[IsoEstimate, IsoEstimate] | None:
    """Return the two valid estimates whose velocity amplitudes differ most, or None.

    The experiments should be as different as possible (Miskovic2010, 7.3). If the amplitudes differ by less than 10 %,
    both structures predict nearly the same drag and the result is undecided. The spread between the structures is then
    below 5 %. That is the repeatability in Miskovic2010, Table 7.9.
    """
    usable = [e for e in estimates if e.cycle.valid]
    pairs = sorted(combinations(usable, 2), key=lambda pair: _spread(_speed(pair[0]), _speed(pair[1])))
    if not pairs or _spread(_speed(pairs[-1][0]), _speed(pairs[-1][1])) < 5.0:
        return None
    return pairs[-1]


def _speed(estimate: IsoEstimate) -> float:
    return estimate.cycle.X_m * estimate.cycle.omega


def _spread(one: float, other: float) -> float:
    """Return the relative deviation [%] of two values from their mean, Miskovic2010, eq. (7.1)."""
    total = one + other
    return 100.0 * abs((one - other) / total) if total else 100.0
