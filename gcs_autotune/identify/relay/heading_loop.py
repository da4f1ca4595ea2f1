"""The closed heading loop from two relay experiments, and its simplification (Miskovic2010, 6.6.4 and Algorithm 8.7).

The relay stands outside the autopilot and commands the heading: ``psi_ref = psi_ref* +/- C``. What is identified is
``psi/psi_ref = (b_1 s + 1)/(a_3 s^3 + a_2 s^2 + a_1 s + 1)``, Miskovic2010 (6.49): every autopilot of Miskovic2010,
Table 8.1 but
the classical PID is of that form on a steering equation of first order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gcs_autotune.errors import MissingChannel, NotInformative
from gcs_autotune.identify.relay.cycle_reading import find_cycles
from gcs_autotune.identify.relay.matrix_iso import identify_process
from gcs_autotune.identify.result import LimitCycle
from gcs_autotune.models.transfer_function import TransferFunction
from gcs_autotune.trial import Trial

__all__ = ["heading_loop", "loop_cycles", "loop_trial", "simplify"]

REFERENCE = "psi_ref"
"""Channel of the commanded heading [rad]."""


def heading_loop(cycle_1: LimitCycle, cycle_2: LimitCycle, *further: LimitCycle) -> TransferFunction:
    """Return the closed heading loop of two (or more) limit cycles, Miskovic2010, eq. (6.52); the gain at rest is 1.

    Raises
    ------
    NotInformative
        Cycles too alike.
    """
    return identify_process((cycle_1, cycle_2, *further), n=3, m=1, gain=1.0)


def loop_trial(trial: Trial) -> Trial:
    """Return *trial* with the commanded heading as the input of yaw, for everything that takes a yaw run.

    Raises
    ------
    MissingChannel
        Without ``psi_ref``.
    """
    if REFERENCE not in trial or "psi" not in trial:
        raise MissingChannel(
            f"run '{trial.name}' has no closed heading loop in it: {REFERENCE}[rad] (what the relay commands) and "
            f"psi[rad] are needed, it has {', '.join(trial.channels)}"
        )
    reference = trial[REFERENCE]
    continuous = replace(reference, name="N", values=np.unwrap(reference.values))
    return replace(trial, channels={"psi": trial["psi"], "N": continuous}, meta={**trial.meta, "dof": "yaw"})


def loop_cycles(trials: Trial | Sequence[Trial]) -> tuple[LimitCycle, ...]:
    """Return the limit cycles of relays that command the heading; ``C`` in rad.

    Raises
    ------
    MissingChannel, BadFile, NotInformative
        As :func:`loop_trial` and :func:`gcs_autotune.identify.find_cycles`.
    """
    runs = (trials,) if isinstance(trials, Trial) else tuple(trials)
    return tuple(cycle for run in runs for cycle in find_cycles(loop_trial(run), "yaw"))


def simplify(loop: TransferFunction) -> TransferFunction:
    """Return the loop with two poles and one zero, Miskovic2010, Algorithm 8.7 and (8.51).

    The real pole *p* is taken out and its lag ``-1/p`` taken off the zero's lead. Of three real poles, where the
    Algorithm's cube roots turn complex, the fastest goes: that changes the response least.

    Raises
    ------
    NotInformative
        When the pole to go is unstable, so that what is left would not stand for the loop.
    """
    a_3, b_1 = loop.denominator[3], loop.numerator[1]
    poles = loop.poles()
    real = poles[np.abs(poles.imag) <= 1e-7 * np.abs(poles)].real
    p = float(real.min())
    if p >= 0.0 or a_3 == 0.0:
        raise NotInformative(
            f"the identified heading loop has its real pole at {p:.3g} rad/s: it is unstable or of lower order; "
            "repeat the two relay experiments with clearly different C or x_a and without saturating the rudder"
        )
    omega_n_squared = -1.0 / (p * a_3)
    # s^3 + (a_2/a_3) s^2 + ... = (s - p)(s^2 + 2 zeta omega_n s + omega_n^2)
    damping = loop.denominator[2] / a_3 + p
    return TransferFunction((1.0, b_1 + 1.0 / p), (1.0, damping / omega_n_squared, 1.0 / omega_n_squared))
