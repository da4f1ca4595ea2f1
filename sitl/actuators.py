"""From servo pulses to forces: a rudder behind a propeller, or a frame of thrusters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from sitl.body import Body, Loads

__all__ = ["FRAMES", "Actuators", "RudderBoat", "ThrusterFrame", "YawSchedule"]

_NEUTRAL_PWM = 1500


class Actuators(Protocol):
    """Turns the pulses on the servo rail into loads on the hull."""

    def drive(self, pwm: Sequence[int], body: Body, loads: Loads) -> None:
        """Fill *loads* from the pulses [us]; a pulse of 0 means no signal, hence no force."""
        ...


def _fraction(pwm: int, span: float) -> float:
    return 0.0 if pwm == 0 else max(-1.0, min(1.0, (pwm - _NEUTRAL_PWM) / span))


@dataclass(frozen=True, slots=True)
class YawSchedule:
    """Yaw inertia and drag over the squared propeller voltage: rows (n2 [V^2], alpha, beta), n2 rising.

    The moment is the rudder angle itself [rad], as in the thesis (2.38): alpha and beta carry the rest. Below
    the first row they grow as 1/n2, which is the same as a rudder whose moment fades with n2.
    """

    rows: Sequence[tuple[float, float, float]]

    def at(self, n2: float) -> tuple[float, float, float]:
        """Return (alpha, beta, share of the rudder's moment) at *n2* [V^2]; linear between the rows."""
        low = self.rows[0]
        if n2 <= low[0]:
            return low[1], low[2], n2 / low[0]
        for high in self.rows[1:]:
            if n2 <= high[0]:
                part = (n2 - low[0]) / (high[0] - low[0])
                return low[1] + part * (high[1] - low[1]), low[2] + part * (high[2] - low[2]), 1.0
            low = high
        return low[1], low[2], 1.0


@dataclass(frozen=True, slots=True)
class RudderBoat:
    """A rudder in the race of a propeller. Thrust goes with n|n|; going astern the rudder acts the other way."""

    schedule: YawSchedule
    full_rudder: float
    full_n: float
    full_thrust: float
    yaw_bias: float
    rudder_channel: int
    throttle_channel: int

    def drive(self, pwm: Sequence[int], body: Body, loads: Loads) -> None:
        """Fill *loads*, and set the hull's yaw inertia and drag for this propeller speed."""
        rudder = _fraction(pwm[self.rudder_channel - 1], 500.0) * self.full_rudder
        throttle = _fraction(pwm[self.throttle_channel - 1], 500.0)
        n = self.full_n * throttle
        body.yaw.alpha, body.yaw.beta, share = self.schedule.at(n * n)
        loads.X = self.full_thrust * throttle * abs(throttle)
        loads.Z = 0.0
        loads.N = (rudder if throttle >= 0.0 else -rudder) * share + self.yaw_bias


@dataclass(frozen=True, slots=True)
class ThrusterFrame:
    """Fixed thrusters, force proportional to command; the authorities are what all of them do together."""

    motors: Sequence[tuple[float, float, float]]
    full_N: float
    full_X: float
    full_Z: float
    bias_N: float
    bias_Z: float

    def drive(self, pwm: Sequence[int], body: Body, loads: Loads) -> None:
        """Fill *loads* from the motors' pulses."""
        N = X = Z = 0.0
        for pulse, (yaw, ahead, down) in zip(pwm, self.motors, strict=False):
            output = _fraction(pulse, 400.0)
            N += yaw * output
            X += ahead * output
            Z += down * output
        loads.N = self.full_N * N + self.bias_N
        loads.X = self.full_X * X
        loads.Z = self.full_Z * Z + self.bias_Z


FRAMES: Mapping[str, Sequence[tuple[float, float, float]]] = {
    "simple-rov-3": ((-0.5, 0.5, 0.0), (0.5, 0.5, 0.0), (0.0, 0.0, 1.0)),
    "vectored": (
        (0.25, -0.25, 0.0),
        (-0.25, -0.25, 0.0),
        (-0.25, 0.25, 0.0),
        (0.25, 0.25, 0.0),
        (0.0, 0.0, 0.5),
        (0.0, 0.0, 0.5),
    ),
}
"""Where the thrusters really sit: each motor's share of full (N, X, Z down). Sway is not modelled."""
