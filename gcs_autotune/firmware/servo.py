"""Convert servo outputs (PWM, as measured) to force fractions, the input of every identification.

Rover routes outputs by ``SERVOn_FUNCTION``. Sub mixes its motors by frame; there the forces are the least-squares
inverse of the mixing.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np

from gcs_autotune.errors import OutputsUnassigned, PreconditionFailed
from gcs_autotune.firmware.profile import Firmware

__all__ = ["LEVELLING", "Output", "ParameterSource", "ServoMap", "read_servo_map"]

_OUTPUTS = 8
"""Number of outputs read: the first eight, which SERVO_OUTPUT_RAW contains in every version."""
_MOTOR1 = 33
"""SERVOn_FUNCTION of motor 1; motors 2 to 8 follow."""
LEVELLING = ("K", "M")
"""Moments that level a craft. A record contains them only if an output drives them at some time."""
_FORCES = ("X", "Y", "Z", "N", *LEVELLING)
ROUNDING = 1e-9
"""Force [fraction of full] below which the sum of several outputs is a rounding error."""
_MOTORS = range(_MOTOR1, _MOTOR1 + _OUTPUTS)


class ParameterSource(Protocol):
    """Source of parameters: a vehicle that answers, or the parameters recorded in a log."""

    def read(self, name: str) -> float:
        """Return the value of the parameter *name*. Raises ``ParameterMissing`` if there is none."""
        ...

    def read_all(self, names: Iterable[str]) -> dict[str, float]:
        """Return name -> value of all *names*. Raises ``ParameterMissing`` if one is missing."""
        ...

    def read_existing(self, names: Iterable[str]) -> dict[str, float]:
        """Return name -> value of those *names* that exist."""
        ...


@dataclass(frozen=True, slots=True)
class Output:
    """One servo output: ``channel`` (1-based) and how its PWM [us] maps to -1..1."""

    channel: int
    trim: float
    low: float
    high: float
    sign: float = 1.0

    def fraction(self, pwm: float) -> float:
        """Return the fraction of full output (-1 to 1) of a pulse *pwm* [us]. 0 us means no pulse, and so no output."""
        if pwm == 0:
            return 0.0
        span = self.high - self.trim if pwm >= self.trim else self.trim - self.low
        return self.sign * (pwm - self.trim) / span


@dataclass(frozen=True, slots=True)
class ServoMap:
    """Converts servo pulses to forces: ``forces = weights @ fractions``.

    ``weights`` has a row per name in ``names`` and a column per entry of ``outputs``; ``factors``, of the same shape,
    is the fraction of each force in the command of each output. ``skid``: whether the craft steers by the difference of
    two thrusters, not by a steering output.
    """

    outputs: tuple[Output, ...]
    names: tuple[str, ...]
    weights: tuple[tuple[float, ...], ...]
    factors: tuple[tuple[float, ...], ...]
    skid: bool = False

    @classmethod
    def of_mixing(cls, outputs: Sequence[Output], factors: Sequence[Mapping[str, float]]) -> Self:
        """Return the least-squares inverse of outputs that are mixed by *factors*.

        *factors* has one mapping force name -> factor per output. A levelling moment that the outputs cannot drive
        independently of the other forces is left out: a single upright thruster drives Z.
        """
        names: tuple[str, ...] = ()
        for name in (n for n in _FORCES if any(f.get(n, 0.0) for f in factors)):
            more = np.array([[f.get(n, 0.0) for n in (*names, name)] for f in factors])
            if name not in LEVELLING or np.linalg.matrix_rank(more) == more.shape[1]:
                names = (*names, name)
        mixing = np.array([[f.get(n, 0.0) for n in names] for f in factors])
        inverse = np.linalg.pinv(mixing)
        rows = tuple(tuple(round(float(w), 12) for w in row) for row in inverse)
        return cls(tuple(outputs), names, rows, tuple(tuple(float(f.get(n, 0.0)) for f in factors) for n in names))

    @property
    def is_all_thrusters(self) -> bool:
        """Whether every output drives a thruster. An output that only turns the craft is a rudder."""
        return not any(
            [n for n, row in zip(self.names, self.factors, strict=True) if row[k]] == ["N"]
            for k in range(len(self.outputs))
        )

    def driving(self, force: str) -> tuple[tuple[Output, float], ...]:
        """Return the outputs that produce *force*, each with its fraction of full output at full force."""
        if force not in self.names:
            return ()
        pairs = zip(self.outputs, self.factors[self.names.index(force)], strict=True)
        return tuple((output, factor) for output, factor in pairs if factor)

    def forces(self, pwms: Sequence[float]) -> dict[str, float]:
        """Return force name -> fraction of full output.

        pwms : PWM [us] of outputs 1, 2, 3...
        """
        fractions = [output.fraction(pwms[output.channel - 1]) for output in self.outputs]
        sums = (sum(w * f for w, f in zip(row, fractions, strict=True)) + 0.0 for row in self.weights)
        return {
            name: 0.0 if name in LEVELLING and abs(force) < ROUNDING else force
            for name, force in zip(self.names, sums, strict=True)
        }


def read_servo_map(parameters: ParameterSource, firmware: Firmware) -> ServoMap:
    """Return the relation between outputs and forces, read from the parameters.

    Two side thrusters (``Firmware.skid_functions``) have priority over a steering output, as in the firmware.

    Raises
    ------
    PreconditionFailed
        The frame is unknown, or an output that must be measured has no function (``OutputsUnassigned``).
    """
    functions = parameters.read_existing(f"SERVO{n}_FUNCTION" for n in range(1, _OUTPUTS + 1))
    by_function = {int(value): int(name[5:-9]) for name, value in reversed(functions.items())}
    if firmware.frame_parameter:
        return _by_frame(parameters, firmware, functions, by_function)
    if firmware.skid_functions and all(number in by_function for number in firmware.skid_functions):
        return replace(_wired(parameters, firmware.skid_functions, by_function), skid=True)
    return _by_function(parameters, firmware, by_function, received=len(functions))


def _by_function(
    parameters: ParameterSource, firmware: Firmware, by_function: Mapping[int, int], *, received: int
) -> ServoMap:
    missing = [f"{force} ({number})" for number, force in firmware.servo_functions.items() if number not in by_function]
    if missing:
        mixed = [n for n in _MOTORS if n in by_function]
        if mixed:
            raise PreconditionFailed(
                f"outputs of this vehicle are assigned to motors ({', '.join(map(str, mixed))}), as on an omni frame, "
                f"and none to {', '.join(missing)}. Only a rudder, a vectored thruster, or two thrusters side by side "
                "(73 and 74) can be tuned. If the vehicle is built like this, set SERVOn_FUNCTION"
            )
        raise OutputsUnassigned(
            f"no output of this vehicle is assigned to {', '.join(missing)}. Set SERVOn_FUNCTION. "
            "A boat that steers by two thrusters uses the functions 73 and 74.",
            received=received,
            of=_OUTPUTS,
        )
    return _wired(parameters, {n: {force: 1.0} for n, force in firmware.servo_functions.items()}, by_function)


def _wired(
    parameters: ParameterSource, factors: Mapping[int, Mapping[str, float]], by_function: Mapping[int, int]
) -> ServoMap:
    channels = [by_function[number] for number in factors]
    outputs = _read_outputs(parameters, channels)
    return ServoMap.of_mixing([outputs[channel] for channel in channels], list(factors.values()))


def _read_outputs(parameters: ParameterSource, channels: Iterable[int]) -> dict[int, Output]:
    wanted = list(channels)
    fields = ("MIN", "TRIM", "MAX", "REVERSED")
    values = parameters.read_all(f"SERVO{n}_{field}" for n in wanted for field in fields)
    outputs = {}
    for n in wanted:
        low, trim, high, is_reversed = (values[f"SERVO{n}_{field}"] for field in fields)
        if not low < trim < high:
            raise PreconditionFailed(
                f"SERVO{n}_MIN {low:g}, TRIM {trim:g}, MAX {high:g} are not in ascending order. Correct these "
                "parameters before tuning"
            )
        outputs[n] = Output(n, trim, low, high, -1.0 if is_reversed else 1.0)
    return outputs


def _by_frame(
    parameters: ParameterSource, firmware: Firmware, functions: Mapping[str, float], by_function: Mapping[int, int]
) -> ServoMap:
    frame = int(parameters.read(firmware.frame_parameter))
    factors = firmware.mixing.get(frame)
    if factors is None:
        known = ", ".join(map(str, firmware.mixing))
        raise PreconditionFailed(f"{firmware.frame_parameter} {frame} is not supported (supported: {known})")
    motors = range(1, len(factors) + 1)
    for m in motors:
        taken = int(functions.get(f"SERVO{m}_FUNCTION", 0.0))
        if _MOTOR1 + m - 1 not in by_function and taken and taken not in _MOTORS:
            raise PreconditionFailed(
                f"motor {m} of {firmware.frame_parameter} {frame} has no output: SERVO{m}_FUNCTION is {taken}. Set "
                f"SERVO{m}_FUNCTION to {_MOTOR1 + m - 1}, or {firmware.frame_parameter} to the vehicle's frame"
            )
    # A motor without a function keeps its own output, unless that drives another motor. Then it is not connected.
    channels = {m: by_function.get(_MOTOR1 + m - 1, m) for m in motors}
    channels = {m: n for m, n in channels.items() if n != m or _is_own(functions, m)}
    directions = parameters.read_existing(f"MOT_{m}_DIRECTION" for m in channels)
    centre, span = firmware.neutral_pwm, firmware.motor_span
    outputs = [
        Output(
            n,
            centre,
            centre - span,
            centre + span,
            -1.0 if directions.get(f"MOT_{m}_DIRECTION", 1.0) < 0 else 1.0,
        )
        for m, n in channels.items()
    ]
    return ServoMap.of_mixing(outputs, [factors[m - 1] for m in channels])


def _is_own(functions: Mapping[str, float], motor: int) -> bool:
    """Return whether the output of the same number drives *motor*, or has no function."""
    return int(functions.get(f"SERVO{motor}_FUNCTION", 0.0)) in (0, _MOTOR1 + motor - 1)
