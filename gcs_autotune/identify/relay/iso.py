"""IS-O: identification by use of self-oscillations, from one limit cycle (thesis Table 6.3).

Both drag structures come from the same reading. All corrections are applied: bias (5.13), known delay
(6.31), real switching value (6.5). The answer is approximate, because only the first harmonic is balanced;
:mod:`gcs_autotune.identify.axis.output_error` starts from it.
"""

from __future__ import annotations

import math

from gcs_autotune.identify.relay.describing_function import from_delay, relay
from gcs_autotune.identify.result import IsoEstimate, LimitCycle

__all__ = ["estimate"]


def estimate(cycle: LimitCycle, delay: float = 0.0) -> IsoEstimate:
    """Return inertia, both drags and the constant force of *cycle*.

    Thesis Table 6.3, with two mends: printed (6.43) lacks a power of omega (the velocity's amplitude is
    ``omega * X_m``), and ``delta`` here stands on the side of the input, so it is *minus* the input's mean
    (6.47). A negative ``C`` (an input that turns the other way) gives negative parameters.

    Parameters
    ----------
    delay : total delay [s] in the loop between input and measured output.
    """
    P, Q = relay(cycle.C, cycle.X_m, cycle.x_a_star, cycle.x_0)
    P, Q = from_delay(P, Q, cycle.omega, delay)
    mean = cycle.offset + cycle.C * (cycle.T_H - cycle.T_L) / (cycle.T_H + cycle.T_L)
    return IsoEstimate(
        cycle=cycle,
        alpha=P / cycle.omega**2,
        beta=-Q / cycle.omega,
        beta_quadratic=-3.0 * math.pi / 8.0 * Q / (cycle.X_m * cycle.omega**2),
        delta=-mean,
        delay=delay,
    )
