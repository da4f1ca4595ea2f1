"""IS-O: identification by use of self-oscillations, from one limit cycle (Miskovic2010, Table 6.3).

Both drag structures come from the same reading. All corrections are applied: bias (5.13), known delay
(6.31), real switching value (6.5). The answer is approximate, because only the first harmonic is balanced;
:mod:`gcs_autotune.identify.axis.output_error` starts from it.
"""

from __future__ import annotations

from gcs_autotune.identify.relay.describing_function import from_delay, quadratic_drag, relay
from gcs_autotune.identify.result import IsoEstimate, LimitCycle

__all__ = ["constant_force", "estimate"]


def estimate(cycle: LimitCycle, delay: float = 0.0) -> IsoEstimate:
    """Return inertia, both drags and the constant force of *cycle*.

    Miskovic2010, Table 6.3, with two mends: printed (6.43) lacks a power of omega (the velocity's amplitude is
    ``omega * X_m``), and ``delta`` here stands on the side of the input, so it is *minus* the input's mean
    (6.47). A negative ``C`` (an input that turns the other way) gives negative parameters.

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
    """Return what balances drag and input in the mean over *cycle*, on the side of the input; Miskovic2010, eq. (6.47).

    With no mean velocity it is minus the input's mean, whatever the drag.
    """
    lost, _ = quadratic_drag(cycle.nu_0, cycle.omega * cycle.X_m)
    given = cycle.offset + cycle.C * (cycle.T_H - cycle.T_L) / (cycle.T_H + cycle.T_L)
    return beta * cycle.nu_0 + beta_quadratic * lost - given
