"""Convert servo pulses to forces: a rudder behind a propeller, two thrusters, or a frame of thrusters."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sitl.plants import Parameters, Plant, RigidBody, Wrench, static_thrust

__all__ = [
    "FRAMES",
    "Actuators",
    "Motor",
    "MotorDrive",
    "RudderBoat",
    "ThrustCurve",
    "ThrusterFrame",
    "ThrusterSet",
    "TwinThrusterBoat",
    "YawSchedule",
]

Array = NDArray[np.float64]

_NEUTRAL_PWM = 1500
_RUDDER_SPAN, _MOTOR_SPAN = 500.0, 400.0
_LONGEST_PULSE = 65535


class MotorDrive(NamedTuple):
    """The motors of a set of actuators: servo channel of each, from 1; pulse of full output from neutral [us]; and
    exponent of the power law that approximates the thrust over the output.
    """

    channels: tuple[int, ...]
    span: float
    exponent: float


class Actuators(ABC):
    """Converts servo pulses to a wrench on the hull, via the normalised output of each axis."""

    __slots__ = ()

    @property
    @abstractmethod
    def full(self) -> Mapping[str, float]:
        """Degree of freedom -> force [N] or moment [N m] at full output. It contains only the degrees that these
        actuators drive.
        """

    @property
    @abstractmethod
    def motor_drive(self) -> MotorDrive:
        """The motors that weaken if they are hot or the battery is under load."""

    @abstractmethod
    def read(self, pwm: Sequence[float]) -> dict[str, float]:
        """Return the normalised outputs (-1 to 1) that the pulses *pwm* [us] command, by SNAME force: ``N``, ``X`` and,
        if driven, ``Z``, ``Y``, ``M``.

        A pulse of 0 us means no signal and counts as zero output.
        """

    @abstractmethod
    def write(self, pwm: Sequence[int], shares: Mapping[str, float]) -> list[int]:
        """Return *pwm* [us] with those pulses changed that set each axis to its normalised output in *shares* (-1 to
        1).

        Pulse limits are ignored.
        """

    @abstractmethod
    def apply(self, shares: Mapping[str, float], parameters: Parameters, wrench: Wrench) -> None:
        """Write the forces [N] and moments [N m] of the normalised outputs *shares* (-1 to 1) into *wrench*."""

    def attach(self, plant: Plant) -> None:  # noqa: B027
        """Connect the actuators to the body that they drive. Only those whose forces follow its motion need it."""

    def drive(self, pwm: Sequence[float], parameters: Parameters, wrench: Wrench) -> None:
        """Write the forces [N] and moments [N m] of the servo pulses *pwm* [us] into *wrench*."""
        self.apply(self.read(pwm), parameters, wrench)


def _fraction(pwm: float, span: float) -> float:
    return 0.0 if pwm == 0 else max(-1.0, min(1.0, (pwm - _NEUTRAL_PWM) / span))


def _pulse(share: float, span: float) -> int:
    return max(0, min(_LONGEST_PULSE, round(_NEUTRAL_PWM + span * share)))


@dataclass(frozen=True, slots=True)
class YawSchedule:
    """Yaw inertia and drag over the squared propeller voltage: rows (n2 [V^2], alpha, beta), n2 rising.

    The moment is the rudder angle itself [rad], as in Miskovic2010 (2.38); alpha and beta contain all other factors.
    Below the first row they increase as 1/n2, which is equivalent to a rudder moment that decreases with n2.
    """

    rows: Sequence[tuple[float, float, float]]

    def at(self, n2: float) -> tuple[float, float, float]:
        """Return (alpha, beta, rudder moment as a fraction of the angle) at *n2* [V^2], interpolated linearly between
        the rows.
        """
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
class RudderBoat(Actuators):
    """A rudder in the wash of a propeller. Thrust is proportional to n|n|. Astern the rudder acts in the opposite
    direction.

    ``side_force`` [N/rad]: sideways force of the rudder on the stern at full thrust, away from the side it is put to
    (Miskovic2010, (2.37)).
    """

    schedule: YawSchedule
    full_rudder: float
    full_n: float
    full_thrust: float
    yaw_bias: float
    rudder_channel: int
    throttle_channel: int
    side_force: float = 0.0

    @property
    def full(self) -> Mapping[str, float]:
        """Degree of freedom -> input at full output: rudder angle [rad] for yaw, thrust [N] for surge."""
        return {"yaw": self.full_rudder, "surge": self.full_thrust}

    @property
    def motor_drive(self) -> MotorDrive:
        """The motor of the propeller, with thrust proportional to n|n|."""
        return MotorDrive((self.throttle_channel,), _RUDDER_SPAN, 2.0)

    def read(self, pwm: Sequence[float]) -> dict[str, float]:
        """Return the rudder (``N``) and throttle (``X``) commands of the pulses *pwm* [us] as normalised outputs (-1 to
        1).
        """
        return {
            "N": _fraction(pwm[self.rudder_channel - 1], _RUDDER_SPAN),
            "X": _fraction(pwm[self.throttle_channel - 1], _RUDDER_SPAN),
        }

    def write(self, pwm: Sequence[int], shares: Mapping[str, float]) -> list[int]:
        """Return *pwm* [us] with the two pulses that set rudder and throttle to *shares* (-1 to 1)."""
        pulses = list(pwm)
        pulses[self.rudder_channel - 1] = _pulse(shares["N"], _RUDDER_SPAN)
        pulses[self.throttle_channel - 1] = _pulse(shares["X"], _RUDDER_SPAN)
        return pulses

    def apply(self, shares: Mapping[str, float], parameters: Parameters, wrench: Wrench) -> None:
        """Write the forces into *wrench*, and the hull's yaw inertia and drag at this propeller speed into
        *parameters*.
        """
        rudder, throttle = shares["N"] * self.full_rudder, shares["X"]
        n = self.full_n * throttle
        parameters["yaw.alpha"], parameters["yaw.beta"], share = self.schedule.at(n * n)
        wrench.X = self.full_thrust * throttle * abs(throttle)
        wrench.Y = -self.side_force * rudder * throttle * abs(throttle)
        wrench.Z = 0.0
        wrench.N = (rudder if throttle >= 0.0 else -rudder) * share + self.yaw_bias


@dataclass(frozen=True, slots=True)
class TwinThrusterBoat(Actuators):
    """Two thrusters side by side, each weaker astern by ``astern``. They steer by their difference.

    ``full_thrust`` [N]: of one thruster, ahead. ``arm`` [m]: distance of each from the centre line.
    """

    full_thrust: float
    astern: float
    arm: float
    yaw_bias: float
    left_channel: int
    right_channel: int

    @property
    def full(self) -> Mapping[str, float]:
        """Degree of freedom -> moment [N m] with full opposite thrusts for yaw, force [N] with both full ahead for
        surge.
        """
        return {"yaw": self.arm * (1.0 + self.astern) * self.full_thrust, "surge": 2.0 * self.full_thrust}

    @property
    def motor_drive(self) -> MotorDrive:
        """Both motors, with thrust proportional to the command."""
        return MotorDrive((self.left_channel, self.right_channel), _RUDDER_SPAN, 1.0)

    def read(self, pwm: Sequence[float]) -> dict[str, float]:
        """Return half the difference (``N``, to starboard) and half the sum (``X``) of the two thrusters' normalised
        commands.
        """
        left = _fraction(pwm[self.left_channel - 1], _RUDDER_SPAN)
        right = _fraction(pwm[self.right_channel - 1], _RUDDER_SPAN)
        return {"N": 0.5 * (left - right), "X": 0.5 * (left + right)}

    def write(self, pwm: Sequence[int], shares: Mapping[str, float]) -> list[int]:
        """Return *pwm* [us] with the two thrusters' pulses that set steering and throttle to *shares* (-1 to 1)."""
        pulses = list(pwm)
        pulses[self.left_channel - 1] = _pulse(shares["X"] + shares["N"], _RUDDER_SPAN)
        pulses[self.right_channel - 1] = _pulse(shares["X"] - shares["N"], _RUDDER_SPAN)
        return pulses

    def apply(self, shares: Mapping[str, float], parameters: Parameters, wrench: Wrench) -> None:
        """Write the surge force [N] and yaw moment [N m] of the two thrusters into *wrench*."""
        left, right = self._force(shares["X"] + shares["N"]), self._force(shares["X"] - shares["N"])
        wrench.X = left + right
        wrench.Z = 0.0
        wrench.N = self.arm * (left - right) + self.yaw_bias

    def _force(self, command: float) -> float:
        return self.full_thrust * command * (1.0 if command >= 0.0 else self.astern)


@dataclass(frozen=True, slots=True)
class ThrustCurve:
    """Thrust as a function of the command: an odd polynomial (coefficients of u, u^3, u^5 ...), 0 within ``dead``.

    The curve is scaled so that a command of 1 produces a force of 1.
    """

    odd: Sequence[float] = (1.0,)
    dead: float = 0.0

    @property
    def exponent(self) -> float:
        """Exponent of the power law through the forces at half and at full command: 1 for a line, 2 for a parabola."""
        half = max(0.5, self.dead + 0.5 * (1.0 - self.dead))
        return max(0.5, math.log(max(self(half), 1e-3)) / math.log(half))

    def __call__(self, u: float) -> float:
        """Return the normalised force of a normalised command *u*."""
        if abs(u) <= self.dead:
            return 0.0
        value, square = 0.0, u * u
        for coefficient in reversed(self.odd):
            value = value * square + coefficient
        return u * value / sum(self.odd)


class Motor(NamedTuple):
    """Force or moment of one thruster at full output, as a fraction of each axis' authority; ``Z`` down, ``M``
    bow up, ``K`` to starboard.
    """

    N: float = 0.0
    X: float = 0.0
    Z: float = 0.0
    Y: float = 0.0
    M: float = 0.0
    K: float = 0.0


@dataclass(frozen=True, slots=True)
class ThrusterFrame(Actuators):
    """A frame of thrusters in fixed directions.

    ``full_N`` ... ``full_M`` are authorities [N, N m]: the combined force of all thrusters that the autopilot drives
    for an axis. ``full_Y`` is 0 on frames that do not sway, ``full_M`` on craft that do not pitch.

    The ``curve`` of one thruster is applied to each axis, because all thrusters that drive an axis have the same
    command.
    """

    motors: Sequence[Motor]
    full_N: float
    full_X: float
    full_Z: float
    bias_N: float
    bias_Z: float
    curve: ThrustCurve | None = None
    full_Y: float = 0.0
    full_M: float = 0.0

    @property
    def full(self) -> Mapping[str, float]:
        """Degree of freedom -> force [N] or moment [N m] at full output. Pitch is omitted, because it is not
        commanded.
        """
        sway = {"sway": self.full_Y} if self.full_Y else {}
        return {"yaw": self.full_N, "surge": self.full_X, "heave": self.full_Z, **sway}

    @property
    def motor_drive(self) -> MotorDrive:
        """All motors of the frame."""
        exponent = 1.0 if self.curve is None else self.curve.exponent
        return MotorDrive(tuple(range(1, len(self.motors) + 1)), _MOTOR_SPAN, exponent)

    def read(self, pwm: Sequence[float]) -> dict[str, float]:
        """Return the normalised outputs (-1 to 1) of all motors together: ``N``, ``X``, ``Z`` and, if driven, ``Y``,
        ``M``.
        """
        N = X = Z = Y = M = 0.0
        for pulse, (yaw, ahead, down, side, pitching, _) in zip(pwm, self.motors, strict=False):
            if pulse == _NEUTRAL_PWM:
                continue
            output = _fraction(pulse, _MOTOR_SPAN)
            N += yaw * output
            X += ahead * output
            Z += down * output
            Y += side * output
            M += pitching * output
        shares = {"N": N, "X": X, "Z": Z}
        if self.full_Y:
            shares["Y"] = Y
        if self.full_M:
            shares["M"] = M
        return shares

    def write(self, pwm: Sequence[int], shares: Mapping[str, float]) -> list[int]:
        """Return *pwm* [us] with the motor outputs changed so that each axis has its output in *shares* (-1 to 1).

        The change is the smallest one that does so.
        """
        outputs, now = [_fraction(pulse, _MOTOR_SPAN) for pulse in pwm], self.read(pwm)
        patterns = np.array([[getattr(motor, name) for motor in self.motors] for name in now])
        change = _mixer(patterns) @ [shares[name] - now[name] for name in now]
        count = len(self.motors)
        outputs[:count] = [output + more for output, more in zip(outputs, change.tolist(), strict=False)]
        return [*(_pulse(output, _MOTOR_SPAN) for output in outputs[:count]), *pwm[count:]]

    def apply(self, shares: Mapping[str, float], parameters: Parameters, wrench: Wrench) -> None:
        """Write the forces [N, N m] of *shares* into *wrench*: proportional to the outputs, or along the thrust
        curve.
        """
        N, X, Z, Y, M = (shares.get(name, 0.0) for name in "NXZYM")
        if self.curve is not None:
            N, X, Z, Y, M = (self.curve(share) for share in (N, X, Z, Y, M))
        wrench.N = self.full_N * N + self.bias_N
        wrench.X = self.full_X * X
        wrench.Y = self.full_Y * Y
        wrench.Z = self.full_Z * Z + self.bias_Z
        wrench.M = self.full_M * M


def _mixer(patterns: Array) -> Array:
    """Return the matrix (p, a) from the outputs of a axes to the smallest commands of p thrusters that give them.

    patterns : (a, p), contribution of each thruster to each axis.
    """
    mixer: Array = patterns.T @ np.linalg.inv(patterns @ patterns.T)
    return mixer


class ThrusterSet(Actuators):
    """Thrusters, each with its place, direction, law of thrust and motor, and rudders behind them.

    The forces are computed with the motion of the body, by its kernel; this class only sets the commands.

    Parameters
    ----------
    motors : contribution of each thruster to each axis, as the autopilot mixes them.
    channels : servo channel of each thruster, from 1. span : pulse of full output from neutral [us].
    propellers : rows of the kernel (p, PROPELLER).
    biases : constant force by SNAME name [N, N m].
    curve : thrust over the command, at rest.
    rudder : channel, angle at full output [rad] and number of the rudders.
    """

    def __init__(
        self,
        motors: Sequence[Motor],
        channels: Sequence[int],
        span: float,
        propellers: Array,
        biases: Mapping[str, float],
        *,
        curve: ThrustCurve | None = None,
        rudder: tuple[int, float, int] | None = None,
    ) -> None:
        if len(motors) != len(propellers):
            raise ValueError(f"thrusters: the lists have {len(propellers)} entries, but the frame has {len(motors)}")
        self._channels, self._span, self._curve, self._rudder = channels, span, curve, rudder
        self._known: dict[float, float] = {}
        self._biases = tuple(biases.get(name, 0.0) for name in "XYZKMN")
        used = [name for name in Motor._fields if any(getattr(motor, name) for motor in motors)]
        self._patterns = {name: np.array([getattr(motor, name) for motor in motors]) for name in used}
        self._inverse = _mixer(np.array(list(self._patterns.values())))
        self._commands = np.zeros(len(motors) + (rudder[2] if rudder else 0))
        self._full = {dof: self._authority(name, propellers) for name, dof in _DRIVEN.items() if name in used}
        if rudder:
            self._full["yaw"] = rudder[1]

    def _authority(self, name: str, propellers: Array) -> float:
        """Return the force or moment [N, N m] of all thrusters at rest, at full output of the axis *name*."""
        total = 0.0
        for row, command in zip(propellers, self._mixed({name: 1.0}).tolist(), strict=True):
            force = static_thrust(row, self._shaped(command))[0] * row[3:6]
            total += {"X": force[0], "Y": force[1], "Z": force[2]}.get(name, row[0] * force[1] - row[1] * force[0])
        return float(total)

    def _mixed(self, shares: Mapping[str, float]) -> Array:
        """Return the smallest commands (p,) that give each axis its output in *shares*."""
        mixed: Array = self._inverse @ [shares.get(name, 0.0) for name in self._patterns]
        return mixed

    def _shaped(self, command: float) -> float:
        """Return the shaft's command. With a curve the thrust follows it, as thrust is proportional to n|n|."""
        command = max(-1.0, min(1.0, command))
        if self._curve is None:
            return command
        thrust = self._curve(command)
        return math.copysign(math.sqrt(abs(thrust)), thrust)

    @property
    def full(self) -> Mapping[str, float]:
        """Degree of freedom -> force [N] or moment [N m] at full output, at rest in the water; rudder angle [rad]."""
        return self._full

    def attach(self, plant: Plant) -> None:
        """Write the commands of this set into *plant* from now on."""
        if not isinstance(plant, RigidBody) or len(plant.commands) != len(self._commands):
            raise ValueError("these thrusters need the body of their own vehicle file")
        self._commands = plant.commands

    def _outputs(self, pwm: Sequence[float]) -> list[float]:
        return [_fraction(pwm[channel - 1], self._span) for channel in self._channels]

    @property
    def motor_drive(self) -> MotorDrive:
        """All motors; without a curve, thrust is proportional to n|n|."""
        exponent = 2.0 if self._curve is None else self._curve.exponent
        return MotorDrive(tuple(self._channels), self._span, exponent)

    def read(self, pwm: Sequence[float]) -> dict[str, float]:
        """Return the normalised outputs (-1 to 1) of all thrusters together, and ``N`` of the rudders."""
        outputs = np.array(self._outputs(pwm))
        shares = {name: float(pattern @ outputs) for name, pattern in self._patterns.items()}
        if self._rudder:
            shares["N"] = _fraction(pwm[self._rudder[0] - 1], _RUDDER_SPAN)
        return shares

    def write(self, pwm: Sequence[int], shares: Mapping[str, float]) -> list[int]:
        """Return *pwm* [us] with the pulses changed so that each axis has its output in *shares* (-1 to 1)."""
        now, pulses = self.read(pwm), list(pwm)
        change = self._mixed({name: shares[name] - now[name] for name in self._patterns})
        for channel, output, more in zip(self._channels, self._outputs(pwm), change.tolist(), strict=True):
            pulses[channel - 1] = _pulse(output + more, self._span)
        if self._rudder:
            pulses[self._rudder[0] - 1] = _pulse(shares["N"], _RUDDER_SPAN)
        return pulses

    def apply(self, shares: Mapping[str, float], parameters: Parameters, wrench: Wrench) -> None:
        """Command the thrusters so that each axis has its output in *shares*; *wrench* gets the constant forces."""
        shaped = [self._shaped(output) for output in self._mixed(shares).tolist()]
        self._command(shaped, shares.get("N", 0.0), wrench)

    def drive(self, pwm: Sequence[float], parameters: Parameters, wrench: Wrench) -> None:
        """Command each thruster by its own pulse [us]; *wrench* gets the constant forces."""
        known = self._known
        try:
            shaped = [known[pwm[channel - 1]] for channel in self._channels]
        except KeyError:
            if len(known) > _MOST_KNOWN:
                known.clear()
            shaped = [self._shaped(output) for output in self._outputs(pwm)]
            known.update((pwm[channel - 1], each) for channel, each in zip(self._channels, shaped, strict=True))
        self._command(shaped, _fraction(pwm[self._rudder[0] - 1], _RUDDER_SPAN) if self._rudder else 0.0, wrench)

    def _command(self, shaped: list[float], turned: float, wrench: Wrench) -> None:
        if self._rudder:
            shaped += [turned * self._rudder[1]] * self._rudder[2]
        self._commands[:] = shaped
        wrench.X, wrench.Y, wrench.Z, wrench.K, wrench.M, wrench.N = self._biases


_MOST_KNOWN = 10_000
"""Pulses whose commands are kept. Pulses are whole microseconds, so that they recur. Project choice."""
_DRIVEN = {"X": "surge", "Y": "sway", "Z": "heave", "N": "yaw"}
"""Force -> degree of freedom that effects and models may drive."""
PAIR = (Motor(N=0.5, X=0.5), Motor(N=-0.5, X=0.5))
"""Two thrusters that steer a boat by their difference: left, right."""

_PAIR = (Motor(N=-0.5, X=0.5), Motor(N=0.5, X=0.5))
_PLANE = (
    Motor(N=0.25, X=-0.25, Y=0.25),
    Motor(N=-0.25, X=-0.25, Y=-0.25),
    Motor(N=-0.25, X=0.25, Y=0.25),
    Motor(N=0.25, X=0.25, Y=-0.25),
)
_ASIDE = Motor(Y=1.0)


def _lift(roll: int, pitch: int) -> Motor:
    """Return one of four thrusters that push up, on the side and end where it rolls and pitches in that direction."""
    return Motor(Z=-0.25, K=0.25 * roll, M=0.25 * pitch)


FRAMES: Mapping[str, Sequence[Motor]] = {
    "simple-rov-3": (*_PAIR, Motor(Z=1.0)),
    "vectored": (*_PLANE, Motor(Z=0.5, K=0.5), Motor(Z=0.5, K=-0.5)),
    "vectored-6dof": (*_PLANE, *(Motor(Z=0.25, M=0.25 * m, K=0.25 * k) for m in (-1, 1) for k in (1, -1))),
    "vectored-6dof-90": (
        *(_lift(1, 1), Motor(N=0.5, X=0.5), _lift(1, -1), Motor(Y=0.5, N=0.5), Motor(Y=0.5, N=-0.5)),
        *(_lift(-1, 1), Motor(N=-0.5, X=0.5), _lift(-1, -1)),
    ),
    "bluerov1": (
        *(*_PAIR, Motor(Z=-1.0 / 1.9, K=-1.0, M=1.0 / 1.9), Motor(Z=-1.0 / 1.9, K=1.0, M=1.0 / 1.9)),
        *(Motor(Z=-1.0 / 1.9, M=-0.9 / 1.9), _ASIDE),
    ),
    "simple-rov-5": (*_PAIR, Motor(Z=0.5, K=0.5), Motor(Z=0.5, K=-0.5), _ASIDE),
    "ies-rov": (*_PAIR, Motor(Z=1.0), _ASIDE),
    "rov-4-fore-aft": (*_PAIR, Motor(Z=0.5, M=-0.5), Motor(Z=0.5, M=0.5)),
}
"""Frame -> contribution of each thruster to each axis, from the thrusters' actual positions.

Miskovic2010, table 2.2, lists these frames as (a) simple-rov-3, (b) simple-rov-5, (c) vectored, (d) vectored-6dof-90,
(e) rov-4-fore-aft, (f) a rudder that pushes sideways. On (d) ArduSub turns with the two thrusters that drive ahead. So
full N is the moment of these two, and a difference between the two lateral thrusters turns the craft. ArduSub does not
support (e). It is driven as SimpleROV-4: its two vertical thrusters get the same command, and a difference between them
pitches the craft. ArduSub drives the front two of BlueROV1's three vertical thrusters with 0.45 of the command of the
rear one. So full Z is 1.9 thrusters, and the rear one has 0.9 of the arm of each front one, because upward thrust alone
does not pitch the craft.
"""
