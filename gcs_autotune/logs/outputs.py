"""What drove the craft: servo outputs back to force fractions, or, failing that, the pilot's sticks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import AutotuneError
from gcs_autotune.firmware import Firmware, Output, ServoMap, read_servo_map
from gcs_autotune.logs.tape import Note, RecordedParameters, Tape
from gcs_autotune.trial import Channel

__all__ = ["drive_channels"]

Array = NDArray[np.float64]

LONGEST_GAP = 0.5
"""Chosen [s]: after a longer silence of the outputs their change is dated by its own message."""

STICKS = 400.0
"""Half the range of an RC channel [us] when the log does not tell its limits."""


def drive_channels(tape: Tape) -> tuple[dict[str, Channel], str, list[Note]]:
    """Return the force channels (unit 1) and PWM channels of a tape, where they come from, and what to doubt.

    A change of output is dated midway between the last message without it and the first with it, as the recorder
    of live runs does.
    """
    every = [Channel(f"servo{n}", "pwm", *tape.series(f"servo.{n}")) for n in tape.numbered("servo")]
    pwm = {c.name: c for c in every if np.any(c.values)}
    if tape.firmware is None:
        note = ("no-inputs", "the log does not tell what autopilot it is of", "identify from a CSV with force columns")
        return pwm, "", [note]
    try:
        servos = read_servo_map(RecordedParameters(tape.parameters), tape.firmware)
        forces = _from_servos(tape, servos)
        if forces:
            return {**pwm, **forces}, "servo outputs", []
        why = "it holds no servo outputs"
    except AutotuneError as error:
        why = str(error)
    for source, found in (("the pilot's sticks", _from_sticks(tape)), ("RC input", _from_rc(tape, tape.firmware))):
        if found:
            note = (
                "input-is-command",
                f"the inputs are {source}, not what the actuators did ({why})",
                "log SERVO_OUTPUT_RAW and the parameters (load all of them once while the ground station records), or "
                "give a parameter file with --parameters",
            )
            return {**pwm, **found}, source, [note]
    cure = "log SERVO_OUTPUT_RAW and the vehicle's parameters, or give a parameter file with --parameters"
    note = ("no-inputs", f"no input could be read ({why})", cure)
    return pwm, "", [note]


def _from_servos(tape: Tape, servos: ServoMap) -> dict[str, Channel]:
    numbers = [output.channel for output in servos.outputs]
    if not all(f"servo.{n}" in tape for n in numbers):
        return {}
    columns = [tape.series(f"servo.{n}") for n in numbers]
    t = columns[0][0]
    if any(len(stamps) != len(t) for stamps, _ in columns):
        return {}
    shares = np.array([_shares(o, values) for o, (_, values) in zip(servos.outputs, columns, strict=True)])
    forces = np.array(servos.weights) @ shares + 0.0
    return {name: Channel(name, "1", *_dated(t, row)) for name, row in zip(servos.names, forces, strict=True)}


def _shares(output: Output, pwm: Array) -> Array:
    """Return the fraction of full output of each pulse."""
    distinct, which = np.unique(pwm, return_inverse=True)
    return np.array([output.fraction(float(v)) for v in distinct])[which]


def _dated(t: Array, values: Array) -> tuple[Array, Array]:
    gap = np.diff(t, prepend=t[:1])
    changed = np.concatenate([[False], np.diff(values) != 0.0])
    return t - np.where(changed & (gap < LONGEST_GAP), 0.5 * gap, 0.0), values


def _from_sticks(tape: Tape) -> dict[str, Channel]:
    found = {}
    for name in "XYZN":
        t, values = tape.series(f"stick.{name}")
        if len(t):
            found[name] = Channel(name, "1", t, values)
    return found


def _from_rc(tape: Tape, firmware: Firmware) -> dict[str, Channel]:
    found = {}
    for name, n in firmware.channels.items():
        t, pwm = tape.series(f"rc.{n}")
        usable = (pwm > 500.0) & (pwm < 2500.0)
        if not np.any(usable):
            continue
        trim = tape.parameters.get(f"RC{n}_TRIM", 1500.0)
        low = tape.parameters.get(f"RC{n}_MIN", trim - STICKS)
        high = tape.parameters.get(f"RC{n}_MAX", trim + STICKS)
        if low == trim < high:  # ArduSub's throttle before 4.7
            trim = 0.5 * (low + high)
        if not low < trim < high:
            trim, low, high = 1500.0, 1500.0 - STICKS, 1500.0 + STICKS
        span = np.where(pwm >= trim, high - trim, trim - low)
        sign = firmware.channel_signs[name] * (-1.0 if tape.parameters.get(f"RC{n}_REVERSED") else 1.0)
        found[name] = Channel(name, "1", t[usable], (sign * (pwm - trim) / span)[usable])
    return found
