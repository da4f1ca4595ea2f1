"""A pull test of one thruster as the thrust curve of a vehicle's throttle outputs, with the servo limits it shows."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.design import Change, fit_motor_law
from gcs_autotune.errors import BadFile, NotInformative
from gcs_autotune.firmware import Output, ServoMap
from gcs_autotune.thrusters import PullTest, fit_thruster

__all__ = ["PulledMap", "curve_of", "pulled_map"]

Array = NDArray[np.float64]

FALLS = 0.05
"""Largest fall of the force between two rising commands [fraction of the strongest pull]. Project choice: noise."""
SATURATED, ROWS = 0.02, 2
"""Rise of the force [fraction of the strongest pull] below which an output is saturated, and the least number of pulls
beyond the saturated output. Project choice."""
LEAST_SHIFT, STDS = 5.0, 3.0
"""Smallest shift of a servo's trim [us], and the standard errors that it needs. Project choice."""
MOST_OUTPUT = 1.02
"""Largest command of a pull test in fractions of full output."""


@dataclass(frozen=True, slots=True, eq=False)
class PulledMap:
    """Thrust ``forces`` [N] with standard errors ``stds`` at ``outputs`` [fraction], all (n,), and servo ``changes``.

    The outputs are those with the changed servo limits.
    """

    outputs: Array
    forces: Array
    stds: Array
    changes: tuple[Change, ...] = ()


def pulled_map(pulls: PullTest, servos: ServoMap, present: Mapping[str, float]) -> PulledMap:
    """Return *pulls* of one thruster at the outputs of the vehicle's throttle.

    Commands are normalised outputs (``command[1]``) or pulses (``pwm[us]``). Pulses also show the trim and the ends of
    the servo output.

    Raises
    ------
    BadFile
        The command has another unit. NotInformative: the force does not rise with the command, or too few pulls.
    """
    if pulls.unit not in ("1", "us"):
        raise BadFile(
            f"pull test '{pulls.name}': the command is in [{pulls.unit}]. Give the output as command[1] (-1 to 1), "
            "command[%] or pwm[us]"
        )
    if pulls.unit == "1" and np.max(np.abs(pulls.command)) > MOST_OUTPUT:
        raise BadFile(
            f"pull test '{pulls.name}': a command of {np.max(np.abs(pulls.command)):g} is above full output. Use "
            "command[%] for percent, or pwm[us] for pulses"
        )
    command, force = _rising(pulls)
    found = fit_thruster(pulls)
    noise = np.full(len(command), found.noise)
    if pulls.unit == "1":
        used = np.abs(command) > 0.0
        return PulledMap(command[used], force[used], noise[used])
    outputs = [output for output, factor in servos.driving("X") if factor]
    shown = outputs[0]
    edges = (found.parameters["x_f"], found.parameters["x_b"])
    middle, std = found.map.neutral, 0.5 * math.hypot(*(edge.std for edge in edges))
    low, high = _ends(command, force)
    new = replace(
        shown,
        trim=float(round(middle)) if abs(middle - shown.trim) > max(STDS * std, LEAST_SHIFT) else shown.trim,
        low=max(low, shown.low),
        high=min(high, shown.high),
    )
    fractions = np.array([replace(new, sign=1.0).fraction(pulse) for pulse in command])
    used = (np.abs(fractions) > 0.0) & (np.abs(fractions) <= 1.0 + 1e-9)
    changes = tuple(c for output in outputs for c in _changes(output, new, present))
    return PulledMap(shown.sign * fractions[used], shown.sign * force[used], noise[used], changes)


def curve_of(pulls: PullTest, servos: ServoMap) -> tuple[float, float]:
    """Return the quadratic part of the thrust curve of *pulls*, and its standard error; errors as for
    :func:`pulled_map`.
    """
    pulled = pulled_map(pulls, servos, {})
    found = fit_motor_law(pulled.outputs, pulled.forces, pulled.stds, skid=False)
    return found.closest.expo, found.expo_std


def _rising(pulls: PullTest) -> tuple[Array, Array]:
    """Return each command and its mean force, by rising command.

    Raises
    ------
    NotInformative
        The force falls where the command rises.
    """
    command, place = np.unique(pulls.command, return_inverse=True)
    force = np.bincount(place, pulls.force) / np.bincount(place)
    fall = -np.diff(force)
    worst = int(np.argmax(fall))
    if fall[worst] > FALLS * float(np.max(np.abs(force))):
        raise NotInformative(
            f"pull test '{pulls.name}' is not monotonous: from command {command[worst]:g} to {command[worst + 1]:g} "
            f"the force falls from {force[worst]:.3g} to {force[worst + 1]:.3g} N. Measure these again, and check the "
            "sign"
        )
    return command, force


def _ends(command: Array, force: Array) -> tuple[float, float]:
    """Return the lowest and the highest command that still change the force; infinite where the test shows no end."""
    most = SATURATED * float(np.max(np.abs(force)))
    ahead = int(np.argmax(force >= force[-1] - most))
    astern = len(force) - 1 - int(np.argmax((force <= force[0] + most)[::-1]))
    high = float(command[ahead]) if len(command) - 1 - ahead >= ROWS else math.inf
    return float(command[astern]) if astern >= ROWS else -math.inf, high


def _changes(output: Output, new: Output, present: Mapping[str, float]) -> Iterator[Change]:
    rows = (
        ("MIN", output.low, new.low, "below it the thrust does not grow"),
        ("TRIM", output.trim, new.trim, "middle of the dead zone"),
        ("MAX", output.high, new.high, "above it the thrust does not grow"),
    )
    for end, old, wanted, why in rows:
        name = f"SERVO{output.channel}_{end}"
        if name in present and wanted != old:
            yield Change(name, old, wanted, 800.0, 2200.0, f"{why} in the pull test")
