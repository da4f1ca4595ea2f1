"""Following a straight line: geometry, and the laws that command a turn rate or a heading.

Miskovic2010, sections 2.7 and 8.3: direct control by turn rate (8.45)-(8.49), indirect control by heading
(8.50)-(8.54), monotonous approach (8.55)-(8.59). Beside them the standard of the field, line of sight with an
integral (Borhaug2008) and with an adaptive sideslip angle (Fossen2023).

``d`` is the distance to the line [m], positive to starboard of it as one looks along it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gcs_autotune.control.feedback import TRACKING_TIME, FeedbackLaw
from gcs_autotune.control.reference_model import reference_coefficients
from gcs_autotune.control.structure import STRUCTURES
from gcs_autotune.errors import NoGainsMeetSpec
from gcs_autotune.models import SingleDof, TransferFunction
from gcs_autotune.notebook import Displayed
from gcs_autotune.sname import wrap

__all__ = [
    "LINE_LAWS",
    "AdaptiveLineOfSight",
    "DirectLine",
    "IndirectLine",
    "IntegralLineOfSight",
    "Line",
    "LineGuidance",
    "LineOfHeading",
    "LineQuestion",
    "LineState",
    "design_direct",
    "design_indirect",
    "simplify",
]

APPROACH = math.radians(45.0)
"""Largest angle to the line unless another is required, Miskovic2010, fig. 8.21."""


@dataclass(frozen=True, slots=True)
class LineState:
    """Where the craft is relative to a line: ``d``, its rate, distance along it [m], heading error, turn rate [SI]."""

    d: float
    d_rate: float
    along: float
    heading: float
    r: float


@dataclass(frozen=True, slots=True)
class Line:
    """A straight line through (*x*, *y*) [m north, east] with orientation *gamma* [rad]."""

    x: float
    y: float
    gamma: float

    @classmethod
    def between(cls, start: tuple[float, float], end: tuple[float, float]) -> Line:
        """Return the line from *start* towards *end*, (north, east) [m]."""
        return cls(start[0], start[1], math.atan2(end[1] - start[1], end[0] - start[0]))

    def state(self, x: float, y: float, psi: float, r: float, velocity: tuple[float, float]) -> LineState:
        """Return the state relative to it; *velocity* over ground, (north, east) [m/s]."""
        s, c = math.sin(self.gamma), math.cos(self.gamma)
        north, east = x - self.x, y - self.y
        return LineState(
            d=-north * s + east * c,
            d_rate=-velocity[0] * s + velocity[1] * c,
            along=north * c + east * s,
            heading=wrap(psi - self.gamma),
            r=r,
        )


# --- direct: the line commands a turn rate, and a turn-rate loop the rudder --------------------------------------


@dataclass(frozen=True, slots=True)
class DirectLine(Displayed):
    """Line to turn rate, ``r_ref = -K_P sat(d) - K_D d_rate``: Miskovic2010, eq. (8.47), (8.58).

    Attributes
    ----------
    K_P, K_D : gains [rad/(s m)], [rad/m].
    d_limit : distance beyond which the approach angle stays constant, (8.57) [m].
    rate : law of the turn-rate loop (8.45); its "position" and its "velocity" are both the turn rate.
    """

    K_P: float
    K_D: float
    d_limit: float
    rate: FeedbackLaw

    def turn_rate(self, state: LineState) -> float:
        """Return the turn rate to command [rad/s]."""
        d = min(max(state.d, -self.d_limit), self.d_limit)
        return -self.K_P * d - self.K_D * state.d_rate


def design_direct(
    yaw: SingleDof,
    speed: float,
    kind: str,
    omega_0: float,
    *,
    approach: float = APPROACH,
    current: float = 0.0,
) -> DirectLine:
    """Return the line law and its turn-rate loop for the reference model *kind* of fourth order.

    Miskovic2010, eq. (8.45)-(8.49) and (8.57); (8.57) is printed with K_P/K_D upside down.

    Parameters
    ----------
    yaw : identified at that speed. speed : speed ahead ``u_r`` [m/s].
    approach : largest angle to the line [rad]. current : largest speed of the water across the line [m/s].

    Raises
    ------
    NoGainsMeetSpec
        The current is too strong for that approach angle.
    """
    a1, a2, a3, a4 = reference_coefficients(kind, omega_0, 4)
    K_P, K_D = 1.0 / (speed * a2), a1 / (speed * a2)
    rate = FeedbackLaw(
        STRUCTURES["I-P"],
        K_P=a3 / a4 * yaw.alpha - yaw.beta,
        K_I=a2 / a4 * yaw.alpha,
        drag=yaw.beta_quadratic,
        disturbance=yaw.delta,
    )
    return DirectLine(K_P, K_D, K_D / K_P * _crossing(speed, approach, current), rate)


def _crossing(speed: float, approach: float, current: float) -> float:
    """Return the slowest speed across the line [m/s] at the *approach* angle against a *current*."""
    crossing = speed * math.sin(approach) - current
    if crossing <= 0.0:
        raise NoGainsMeetSpec(
            f"a craft at {speed:.2f} m/s cannot approach a line at {math.degrees(approach):.0f} degrees against "
            f"{current:.2f} m/s of current. The current must be below {speed * math.sin(approach):.2f} m/s; go faster "
            f"or allow a steeper approach"
        )
    return crossing


# --- indirect: the line commands a heading -----------------------------------------------------------------------


class LineOfHeading(Protocol):
    """A law that commands a heading relative to the line [rad].

    Its memory is one number, which :class:`LineGuidance` keeps.
    """

    def begins(self, state: LineState) -> float:
        """Return the memory with which it takes over at *state*."""

    def heading(self, state: LineState, memory: float, dt: float) -> tuple[float, float]:
        """Return the heading relative to the line [rad], and the memory after *dt* [s]."""


@dataclass(frozen=True, slots=True)
class IndirectLine(Displayed):
    """Line to heading through an existing heading loop: Miskovic2010, eq. (8.52), limited as (8.59).

    ``approach`` [rad] is the largest angle to the line. The memory is the integral, which stops at it by (8.29).
    """

    K_psi: float
    K_r: float
    K_d: float
    K_I: float
    approach: float

    def begins(self, state: LineState) -> float:
        """Return the integral whose first command is the present heading.

        The distance then acts through the integral alone, as the reference model has it. From zero its first command
        would be a step of ``K_d d``, and Charlie overshoots a line at 8 m by 3 m instead of 0.4 m.
        """
        return (1.0 + self.K_psi) * state.heading + self.K_r * state.r + self.K_d * state.d

    def heading(self, state: LineState, memory: float, dt: float) -> tuple[float, float]:
        """Return the heading relative to the line [rad], and the integral [rad]."""
        demand = memory - self.K_psi * state.heading - self.K_r * state.r - self.K_d * state.d
        command = min(max(demand, -self.approach), self.approach)
        return command, memory - self.K_I * state.d * dt - (demand - command) * min(dt / TRACKING_TIME, 1.0)


def simplify(loop: TransferFunction) -> TransferFunction:
    """Return the loop with two poles and one zero, Miskovic2010, Algorithm 8.7 and (8.51).

    The real pole *p* is removed, and its lag ``-1/p`` is subtracted from the lead of the zero. If there are three real
    poles, the cube roots of the algorithm are complex. The fastest pole is then removed, because that changes the
    response least.

    Raises
    ------
    NoGainsMeetSpec
        The pole to remove is unstable, so the rest would not represent the loop.
    """
    a_3, b_1 = loop.denominator[3], loop.numerator[1] if len(loop.numerator) > 1 else 0.0
    poles = loop.poles()
    real = poles[np.abs(poles.imag) <= 1e-7 * np.abs(poles)].real
    p = float(real.min())
    if p >= 0.0 or a_3 == 0.0:
        raise NoGainsMeetSpec(
            f"the identified heading loop has its real pole at {p:.3g} rad/s: it is unstable or of lower order. "
            "Repeat the two relay experiments with clearly different C or x_a and without saturating the rudder"
        )
    omega_n_squared = -1.0 / (p * a_3)
    # s^3 + (a_2/a_3) s^2 + ... = (s - p)(s^2 + 2 zeta omega_n s + omega_n^2)
    damping = loop.denominator[2] / a_3 + p
    return TransferFunction((1.0, b_1 + 1.0 / p), (1.0, damping / omega_n_squared, 1.0 / omega_n_squared))


def design_indirect(
    loop: TransferFunction, speed: float, kind: str, omega_0: float, *, approach: float = APPROACH
) -> IndirectLine:
    """Return the line law for a simplified heading *loop* (two poles, one zero), Miskovic2010, eq. (8.51)-(8.54).

    The reference model has fourth order. (8.54), third row, prints ``b_1`` for the simplified loop's.

    Parameters
    ----------
    speed : speed ahead ``u_r`` [m/s]. approach : largest angle to the line [rad].
    """
    b = loop.numerator[1] if len(loop.numerator) > 1 else 0.0
    _, p1, p2 = loop.denominator
    rising = reference_coefficients(kind, omega_0, 4)
    a0 = 1.0 / rising[3]
    a1, a2, a3 = (rising[k] * a0 for k in range(3))
    matrix = np.array(
        [
            [1.0 - a3 * b, b, 0.0, 0.0],
            [-a2 * b, 1.0, b * speed, 0.0],
            [-a1 * b, 0.0, speed, b * speed],
            [-a0 * b, 0.0, 0.0, speed],
        ]
    )
    K_r, K_psi, K_d, K_I = np.linalg.solve(matrix, [a3 * p2 - p1, a2 * p2 - 1.0, a1 * p2, a0 * p2])
    return IndirectLine(float(K_psi), float(K_r), float(K_d), float(K_I), approach)


@dataclass(frozen=True, slots=True)
class IntegralLineOfSight:
    """Line of sight with an integral of the distance, which removes the error that a current leaves: Borhaug2008.

    ``lookahead`` Delta [m]; ``gain`` sigma [m/s], the weight of the integral. The memory is the integral [s].
    """

    lookahead: float
    gain: float

    def begins(self, state: LineState) -> float:
        """Return a memory of zero."""
        return 0.0

    def heading(self, state: LineState, memory: float, dt: float) -> tuple[float, float]:
        """Return the heading relative to the line [rad], and the integral [s]."""
        reach = state.d + self.gain * memory
        return -math.atan2(reach, self.lookahead), memory + dt * self.lookahead * state.d / (
            reach**2 + self.lookahead**2
        )


@dataclass(frozen=True, slots=True)
class AdaptiveLineOfSight:
    """Line of sight with an estimate of the sideslip angle: Fossen2023.

    ``lookahead`` Delta [m]; ``gain`` gamma [rad/(s m)]. The memory is the estimate [rad].
    """

    lookahead: float
    gain: float

    def begins(self, state: LineState) -> float:
        """Return a memory of zero."""
        return 0.0

    def heading(self, state: LineState, memory: float, dt: float) -> tuple[float, float]:
        """Return the heading relative to the line [rad], and the sideslip angle [rad]."""
        command = -memory - math.atan2(state.d, self.lookahead)
        return command, memory + dt * self.gain * self.lookahead / math.hypot(self.lookahead, state.d) * state.d


class LineGuidance:
    """A law of heading that runs along one line: one call of :meth:`update` per control tick."""

    def __init__(self, law: LineOfHeading, line: Line) -> None:
        self.law, self.line = law, line
        self._memory = self._t = math.nan

    def update(self, state: LineState, t: float) -> float:
        """Return the heading to command [rad, north over east] at time *t* [s]."""
        dt = 0.0 if math.isnan(self._t) else max(t - self._t, 0.0)
        if math.isnan(self._t):
            self._memory = self.law.begins(state)
        self._t = t
        relative, self._memory = self.law.heading(state, self._memory, dt)
        return self.line.gamma + relative


# --- a law for a craft: one row per kind --------------------------------------------------------------------------

SLOWER = 0.47
"""Characteristic frequency of the line loop relative to that of the heading loop: Charlie's 0.211 to 0.45 rad/s in
Miskovic2010, sections 8.1.5 and 8.3.5, for a rudder that is quiet on the line."""
LOOKAHEAD = 4.0
"""Lookahead distance in units of speed over the heading loop's frequency, so that the line loop is four times slower
than the heading loop."""
INTEGRAL_WEIGHT = 0.06
"""Gain of the integral relative to the speed. Chosen: larger ones overshoot after a long approach."""
ADAPTION = 0.025
"""Gain of the sideslip estimate in units of speed over the squared lookahead. Chosen: a tenth of critical damping."""


@dataclass(frozen=True, slots=True)
class LineQuestion:
    """What a line law is made from: the yaw model, the design of the heading loop, speed, approach angle, current.

    ``loop`` is the heading loop in closed form, ``omega_0`` its characteristic frequency [rad/s].
    """

    yaw: SingleDof
    loop: TransferFunction
    kind: str
    omega_0: float
    speed: float
    approach: float = APPROACH
    current: float = 0.0


def _direct(q: LineQuestion) -> DirectLine:
    return design_direct(q.yaw, q.speed, q.kind, SLOWER * q.omega_0, approach=q.approach, current=q.current)


def _indirect(q: LineQuestion) -> LineOfHeading:
    _crossing(q.speed, q.approach, q.current)
    loop = simplify(q.loop) if len(q.loop.denominator) == 4 else q.loop
    return design_indirect(loop, q.speed, q.kind, SLOWER * q.omega_0, approach=q.approach)


def _integral(q: LineQuestion) -> LineOfHeading:
    return IntegralLineOfSight(LOOKAHEAD * q.speed / q.omega_0, INTEGRAL_WEIGHT * q.speed)


def _adaptive(q: LineQuestion) -> LineOfHeading:
    lookahead = LOOKAHEAD * q.speed / q.omega_0
    return AdaptiveLineOfSight(lookahead, ADAPTION * q.speed / lookahead**2)


LINE_LAWS: Mapping[str, Callable[[LineQuestion], DirectLine | LineOfHeading]] = {
    "direct": _direct,
    "indirect": _indirect,
    "integral": _integral,
    "adaptive": _adaptive,
}
"""Name -> rule that makes the law for a craft; one line adds another."""
