"""Predict the limit cycle of a relay on a known model from the first harmonic (Goldfarb; Miskovic2010, eq. (5.35)).

The cycle is the intersection of the Nyquist plot ``G(j omega)`` with ``-1/N(X_m)``. It is the inverse of :mod:`.iso`,
with the same describing functions: hysteresis and bias of the relay (5.11)-(5.14), delay (6.31), quadratic drag (6.43).
The neglected harmonics cause an error of a few percent. It grows to 15 % for a craft whose time constant is shorter
than its delay, and for a constant force above half of the relay's output.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.relay.iso import quadratic_drag, relay, relay_bias
from gcs_autotune.models import SingleDof
from gcs_autotune.notebook import Displayed

__all__ = ["PredictedCycle", "predict_cycle"]

MOST = 1e4
"""Largest amplitude that is looked for, in units of the hysteresis or of the amplitude without drag."""
SLOWEST, FASTEST = 1e-6, 1e9
"""Range of the frequency [rad/s]."""


@dataclass(frozen=True, slots=True)
class PredictedCycle(Displayed):
    """The limit cycle of a relay: amplitude ``X_m`` and mean ``x_0`` [rad or m], frequency ``omega`` [rad/s].

    ``C`` [input] and ``x_a`` [rad or m]: output and hysteresis of the relay. ``drag``: equivalent constant drag.
    """

    C: float
    x_a: float
    X_m: float
    x_0: float
    omega: float
    drag: float

    @property
    def period(self) -> float:
        """Period [s]."""
        return math.tau / self.omega

    def inverse(self, amplitudes: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return ``-1/N`` at *amplitudes* (n,), which are larger than ``x_a + |x_0|``."""
        return np.array([-1.0 / complex(*relay(self.C, float(X), self.x_a, self.x_0)) for X in amplitudes])

    def process(self, model: SingleDof, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return ``G(j omega)`` of *model* from input to position at *omega* (n,), with the equivalent drag."""
        s = (1j * omega).astype(np.complex128)
        value: NDArray[np.complex128] = np.exp(-model.delay * s) / (s * (model.alpha * s + self.drag))
        return value


def predict_cycle(model: SingleDof, C: float, x_a: float, *, sample_time: float = 0.0) -> PredictedCycle:
    """Return the limit cycle of a relay of output *C* [input] and hysteresis *x_a* [rad or m] on *model*.

    sample_time : period [s] of the loop that switches the relay. It switches half a period late on average.

    Raises
    ------
    NotInformative
        The relay causes no limit cycle; the message states why.
    """
    if not (C > 0.0 and x_a >= 0.0):
        raise NotInformative(f"a relay needs an output above 0 and a hysteresis of 0 or more, not {C:g} and {x_a:g}")
    if abs(model.delta) >= C:
        raise NotInformative(
            f"the constant force of the model, {abs(model.delta):.3g}, is not smaller than the relay output {C:.3g}. "
            "The craft would drift away. Use a larger output"
        )
    delay = model.delay + 0.5 * sample_time

    def excess(X_m: float) -> float:
        """Return the phase [rad] that the process lacks to oscillate with *X_m*; it grows with *X_m*."""
        P, Q = relay(C, X_m, x_a, _mean(model.delta, C, X_m, x_a))
        omega = _frequency(model, X_m, math.hypot(P, Q))
        own = math.atan2(_drag(model, X_m, omega), model.alpha * omega)
        return own + math.atan2(Q, P) - omega * delay

    least = _least(model.delta, C, x_a) * (1.0 + 1e-9)
    unit = max(x_a, C * max(delay, 1e-3) ** 2 / model.alpha)
    least = max(least, 1e-6 * unit)
    if excess(least) >= 0.0:
        raise NotInformative("a relay without hysteresis causes no limit cycle on a model without delay. Set one")
    most = least
    while excess(most) < 0.0:
        most *= 2.0
        if most > MOST * unit:
            raise NotInformative("the model has no drag that would limit the oscillation of a relay")
    X_m = float(brentq(excess, max(0.5 * most, least), most, rtol=1e-10))
    x_0 = _mean(model.delta, C, X_m, x_a)
    omega = _frequency(model, X_m, math.hypot(*relay(C, X_m, x_a, x_0)))
    return PredictedCycle(C, x_a, X_m, math.copysign(x_0, model.delta), omega, _drag(model, X_m, omega))


def _drag(model: SingleDof, X_m: float, omega: float) -> float:
    """Return the constant drag with the same first harmonic, Miskovic2010, eq. (6.43)."""
    return model.beta + model.beta_quadratic * quadratic_drag(0.0, X_m * omega)[1]


def _frequency(model: SingleDof, X_m: float, gain: float) -> float:
    """Return the frequency [rad/s] at which the process has the gain ``1/gain``."""

    def beyond(logarithm: float) -> float:
        omega = math.exp(logarithm)
        return math.log(omega * math.hypot(model.alpha * omega, _drag(model, X_m, omega)) / gain)

    return math.exp(float(brentq(beyond, math.log(SLOWEST), math.log(FASTEST), rtol=1e-13)))


def _least(delta: float, C: float, x_a: float) -> float:
    """Return the amplitude above which the relay can balance the constant force *delta*."""
    # at |x_0| = X_m - x_a the relay's mean is C/pi (pi/2 - asin(2 x_a/X_m - 1)), its largest
    return 2.0 * x_a / (1.0 + math.sin(0.5 * math.pi - math.pi * abs(delta) / C))


def _mean(delta: float, C: float, X_m: float, x_a: float) -> float:
    """Return the size of the mean ``x_0`` at which the relay balances *delta* on average, eq. (5.11)."""
    if delta == 0.0:
        return 0.0
    highest = X_m - x_a
    if relay_bias(C, X_m, x_a, highest) <= abs(delta):
        return highest
    return float(brentq(lambda x_0: relay_bias(C, X_m, x_a, x_0) - abs(delta), 0.0, highest))
