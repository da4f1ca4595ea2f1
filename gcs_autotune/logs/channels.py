"""Convert samples to motion channels and inputs: choose the sources, and convert from the globe to a map and to the
body frame.

Inputs are servo outputs converted back to normalised forces, or if missing, the pilot's sticks. ArduPilot low-passes
the gyro (``INS_GYRO_FILTER``, a second-order Butterworth filter) before ATTITUDE.yawspeed, RATE and IMU use it;
attitude is integrated from unfiltered samples. At ArduRover's 4 Hz the rate lags by about 50 ms, which matters for a
heading loop with a period of a second. Therefore each channel records its filter.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import AutotuneError, OutputsUnassigned, PreconditionFailed, UsageError
from gcs_autotune.firmware import LEVELLING, Firmware, Output, Outputs, ServoMap, read_servo_map, with_outputs
from gcs_autotune.frames import flat, to_body
from gcs_autotune.logs.sample_store import UNKNOWN, Note, RecordedParameters, SampleStore
from gcs_autotune.logs.shafts import Shafts, shafts_of
from gcs_autotune.sname import SIGNALS
from gcs_autotune.trial import Channel

__all__ = ["SERVOS", "SHAFTS", "drive_channels", "filters_of", "motion_channels", "servo_map_of"]

Array = NDArray[np.float64]

ENOUGH = 20
"""Smallest number of samples for which a source is used in preference to a later one. Project choice."""

ATTITUDES = ("attitude", "ahrs2", "aboard")
"""Sources of ``phi theta psi`` in order of preference: the estimate that the autopilot uses, its second estimate, and
the rows of a script of ours, which are left if the autopilot logs nothing else.
"""
NAVIGATION = "navigation"
"""Source of a navigation solution, which replaces all others. It contains standard deviations and correlation times."""
POSITIONS = ("local", "ekf", "aboard", "global", "gps")
"""Sources of ``x y`` and of velocity over ground in order of preference.

They are never mixed, because their origins differ.
"""
DEPTHS = ("global", "local", "ekf", "aboard", "control", "ahrs2", "pressure", "baro")
"""Sources of ``z`` in order of preference."""
RATES = ("attitude", "rate", "imu", "aboard", "steering")
"""Sources of ``p q r`` in order of preference. Sources with their own time stamps precede those without."""
STILL = 0.01
"""Smallest change of depth per second (rms) [m] that determines the sign of a vertical speed. Project choice."""
SPEEDS = ("hud", "gps")
"""Sources of ``U`` if there is no velocity over ground."""


@dataclass(frozen=True, slots=True)
class _Pick:
    """The sources chosen, for the run's metadata."""

    channels: dict[str, Channel]
    sources: dict[str, str]


def motion_channels(store: SampleStore) -> tuple[dict[str, Channel], dict[str, str]]:
    """Return (channel -> motion channel of a whole store, channel -> its source).

    ``psi`` stays wrapped as recorded; ``u v`` are velocity over ground turned by the heading at their own time stamps.
    """
    pick = _Pick({}, {})
    if f"{NAVIGATION}.psi" in store:
        for name in SIGNALS:
            own = SIGNALS[name].unit
            common = itertools.takewhile(
                lambda c: f"{NAVIGATION}.{c}" in store, (f"common{i}_{name}" for i in itertools.count(1))
            )
            for channel in (name, f"std_{name}", f"memory_{name}", *common):
                unit = "s" if channel.startswith("memory_") else own
                if f"{NAVIGATION}.{channel}" in store:
                    t, values = store.series(f"{NAVIGATION}.{channel}")
                    pick.channels[channel] = Channel(channel, unit, t, values)
                    pick.sources[channel] = NAVIGATION
        return pick.channels, pick.sources
    for source in ATTITUDES:
        if _has(store, f"{source}.psi"):
            for name in ("phi", "theta", "psi"):
                if f"{source}.{name}" in store:
                    _put(pick, name, source, *store.series(f"{source}.{name}"))
            break
    rates = [s for s in RATES if _has(store, f"{s}.r")]
    for source in sorted(rates, key=lambda s: s in store.dated_by_arrival)[:1]:
        for name in "pqr":
            _put(pick, name, source, *store.series(f"{source}.{name}"))
    _position(pick, store)
    _depth(pick, store)
    return pick.channels, pick.sources


def _position(pick: _Pick, store: SampleStore) -> None:
    for source in POSITIONS:
        if _has(store, f"{source}.x"):
            t, x = store.series(f"{source}.x")
            y = store.series(f"{source}.y")[1]
        elif _has(store, f"{source}.lat"):
            t, lat = store.series(f"{source}.lat")
            lon = store.series(f"{source}.lon")[1]
            x, y = flat(lat, lon, (float(lat[0]), float(lon[0])))
        else:
            continue
        if np.ptp(x) == 0.0 and np.ptp(y) == 0.0:
            continue
        _put(pick, "x", source, t, x)
        _put(pick, "y", source, t, y)
        _velocity(pick, store, source)
        break
    if "U" not in pick.channels:
        for source in SPEEDS:
            if _has(store, f"{source}.U"):
                _put(pick, "U", source, *store.series(f"{source}.U"))
                break


def _velocity(pick: _Pick, store: SampleStore, source: str) -> None:
    if not _has(store, f"{source}.vn"):
        return
    t, north = store.series(f"{source}.vn")
    east = store.series(f"{source}.ve")[1]
    _put(pick, "U", source, t, np.hypot(north, east))
    psi = pick.channels.get("psi")
    if psi is None or len(psi) < 2:
        return
    inside = (t >= psi.t[0] - 1.0) & (t <= psi.t[-1] + 1.0)
    heading = np.interp(t[inside], psi.t, np.unwrap(psi.values))
    u, v = to_body(north[inside], east[inside], heading)
    _put(pick, "u", source, t[inside], u)
    _put(pick, "v", source, t[inside], v)


def _depth(pick: _Pick, store: SampleStore) -> None:
    there = [s for s in DEPTHS if _has(store, f"{s}.z")]
    moving = [s for s in there if np.ptp(store.series(f"{s}.z")[1]) > 0.0]
    for source in (moving or there)[:1]:
        _put(pick, "z", source, *store.series(f"{source}.z"))
        if _has(store, f"{source}.w"):
            t, w = store.series(f"{source}.w")
            if source == "global" and _is_upwards(t, w, *store.series(f"{source}.z")):
                _put(pick, "w", f"{source}, converted to depth", t, -w)
            else:
                _put(pick, "w", source, t, w)


def _is_upwards(t: Array, w: Array, tz: Array, z: Array) -> bool:
    """Return whether a vertical speed counts upwards, from the changes of depth over every second.

    MAVLink defines ``GLOBAL_POSITION_INT.vz`` as positive down. ArduSub sent it positive up until February 2018, and
    its version 3.5.4 still in 2019.
    """
    sunk = np.concatenate([[0.0], np.cumsum(0.5 * (w[1:] + w[:-1]) * np.diff(t))])
    ends = np.arange(max(t[0], tz[0]), min(t[-1], tz[-1]), 1.0)
    integrated, measured = np.diff(np.interp(ends, t, sunk)), np.diff(np.interp(ends, tz, z))
    power = float(integrated @ integrated)
    if float(measured @ measured) <= len(measured) * STILL**2 or power == 0.0:
        return False
    return float(integrated @ measured) < -0.5 * math.sqrt(power * float(measured @ measured))


def _has(store: SampleStore, source: str) -> bool:
    return source in store and len(store.series(source)[0]) >= ENOUGH


def _put(pick: _Pick, name: str, source: str, t: Array, values: Array) -> None:
    if len(t):
        pick.channels[name] = Channel(name, SIGNALS[name][0], t, values)
        pick.sources[name] = source


NO_OUTPUTS = (
    "the log contains no servo outputs",
    "record SERVO_OUTPUT_RAW (onboard: RCOU). For the parameters, load all of them once while the ground "
    "station records, or use a parameter file with --parameters",
)
"""Cause and remedy for a log that lacks a required output."""
_OTHER = "neither ArduRover nor ArduSub, so the functions of its outputs are unknown"
LONGEST_GAP = 0.5
"""Silence of the outputs [s] after which the time of a change is that of its own message. Project choice."""

SERVOS, SHAFTS = "servo outputs", "shaft speeds"
"""Sources of inputs whose changes are dated midway."""
STICKS = 400.0
"""Half the range of an RC channel [us], assumed if the log does not contain its limits."""


def drive_channels(store: SampleStore) -> tuple[dict[str, Channel], str, list[Note]]:
    """Return the force channels (unit 1) and PWM channels of a store by name, their sources, and the doubts about them.

    The time of an output change is midway between the last message before the change and the first message after it, as
    in the recorder of live runs. With ``by_speed`` of the store the forces are those of the shafts' measured speeds.

    Raises
    ------
    UsageError
        The speeds are required and the log does not contain them.
    """
    every = [Channel(f"servo{n}", "pwm", *store.series(f"servo.{n}")) for n in store.numbered("servo")]
    pwm = {c.name: c for c in every if np.any(c.values)}
    try:
        servos, outputs = servo_map_of(store)
        forces, shafts = _from_servos(store, servos)
        doubts = [*_assumed(outputs), *(shafts.doubts(by_speed=store.by_speed) if shafts else [])]
        if forces and store.by_speed:
            measured = _from_shafts(shafts, servos)
            return {**pwm, **{name: measured[name] for name in forces if name in measured}}, SHAFTS, doubts
        if forces:
            return {**pwm, **forces}, SERVOS, doubts
        why, cure = NO_OUTPUTS
    except UsageError:
        raise
    except AutotuneError as error:
        has_outputs = store.firmware is None or store.numbered("servo")
        why, cure = (str(error), _cure(store)) if has_outputs else NO_OUTPUTS
    sources = [
        ("outputs of a script", _named(store, "aboard")),
        ("the pilot's sticks", _named(store, "stick")),
        ("the controllers' set-points", _named(store, "setpoint")),
    ]
    if store.firmware is not None:
        sources.append(("RC input", _from_rc(store, store.firmware)))
    for source, found in sources:
        if found:
            note = ("input-is-command", f"the inputs are {source}, not the actuator outputs ({why})", cure)
            return {**pwm, **found}, source, [note]
    return pwm, "", [("no-inputs", f"no input could be read: {why}", cure)]


def servo_map_of(store: SampleStore) -> tuple[ServoMap, Outputs]:
    """Return (output wiring of the vehicle in a log, parameters of the log under the names used for the wiring).

    Raises
    ------
    PreconditionFailed
        The log lacks information; the message states what is missing.
    """
    if store.firmware is None:
        other = "the log does not identify its autopilot"
        raise PreconditionFailed(other if store.vehicle == UNKNOWN else f"the log is of {store.vehicle}: {_OTHER}")
    if not store.parameters:
        raise PreconditionFailed("the log contains no parameters, so the functions of its outputs are unknown")
    outputs = with_outputs(store.parameters, store.firmware, store.vehicle)
    try:
        return read_servo_map(RecordedParameters(outputs.values), store.firmware), outputs
    except OutputsUnassigned as error:
        if error.received == error.of:
            raise
        raise PreconditionFailed(
            f"the log contains {len(store.parameters)} parameters, but only {error.received} of {error.of} "
            "SERVOn_FUNCTION, so the functions of its outputs are unknown"
        ) from error
    except PreconditionFailed as error:
        raise PreconditionFailed(outputs.names.worded(str(error))) from error


def _cure(store: SampleStore) -> str:
    """Return the advice for a log whose outputs cannot be interpreted."""
    if store.firmware is None:
        return "identify from a CSV with force columns"
    return "supply the vehicle's parameters with --parameters FILE (NAME,VALUE lines, as ground stations save them)"


def _assumed(outputs: Outputs) -> list[Note]:
    if not outputs.assumed:
        return []
    taken = ", ".join(f"{name} {value:g}" for name, value in outputs.assumed.items())
    return [
        (
            "assumed-limits",
            f"the log does not contain all SERVOn limits. Firmware defaults are used ({taken})",
            "supply the vehicle's parameters with --parameters FILE",
        )
    ]


def _from_servos(store: SampleStore, servos: ServoMap) -> tuple[dict[str, Channel], Shafts | None]:
    numbers = [output.channel for output in servos.outputs]
    if not all(f"servo.{n}" in store for n in numbers):
        return {}, None
    columns = [store.series(f"servo.{n}") for n in numbers]
    t = columns[0][0]
    if any(len(stamps) != len(t) for stamps, _ in columns):
        return {}, None
    shares = np.array([_shares(o, values) for o, (_, values) in zip(servos.outputs, columns, strict=True)])
    shafts = shafts_of(store, servos.outputs, t, shares) if servos.is_all_thrusters else None
    return _mixed(servos, t, shares), shafts


def _from_shafts(shafts: Shafts | None, servos: ServoMap) -> dict[str, Channel]:
    if shafts is None:
        raise UsageError(
            "--input speed: the log does not contain the speed of each thruster. Record ESC_TELEMETRY or "
            "RPM (onboard: ESC), or leave the option out"
        )
    return _mixed(servos, shafts.t, shafts.shares)


def _mixed(servos: ServoMap, t: Array, shares: Array) -> dict[str, Channel]:
    forces = np.array(servos.weights) @ shares + 0.0
    return {
        name: Channel(name, "1", *_dated(t, row))
        for name, row in zip(servos.names, forces, strict=True)
        if name not in LEVELLING or np.round(row, 9).any()
    }


def _shares(output: Output, pwm: Array) -> Array:
    """Return the fraction of full output for each pulse."""
    distinct, which = np.unique(pwm, return_inverse=True)
    return np.array([output.fraction(float(v)) for v in distinct])[which]


def _dated(t: Array, values: Array) -> tuple[Array, Array]:
    gap = np.diff(t, prepend=t[:1])
    changed = np.concatenate([[False], np.diff(values) != 0.0])
    return t - np.where(changed & (gap < LONGEST_GAP), 0.5 * gap, 0.0), values


def _named(store: SampleStore, source: str) -> dict[str, Channel]:
    """Return the normalised forces of a source."""
    channels = {}
    for name in "XYZKMN":
        t, values = store.series(f"{source}.{name}")
        if len(t):
            channels[name] = Channel(name, "1", t, values)
    return channels


def _from_rc(store: SampleStore, firmware: Firmware) -> dict[str, Channel]:
    channels = {}
    try:
        parameters = with_outputs(store.parameters, firmware, store.vehicle).values
    except PreconditionFailed:
        parameters = store.parameters
    for name, n in firmware.channels.items():
        t, pwm = store.series(f"rc.{n}")
        usable = (pwm > 500.0) & (pwm < 2500.0)
        if not np.any(usable):
            continue
        trim = parameters.get(f"RC{n}_TRIM", 1500.0)
        low = parameters.get(f"RC{n}_MIN", trim - STICKS)
        high = parameters.get(f"RC{n}_MAX", trim + STICKS)
        if low == trim < high:  # ArduSub's throttle before 4.7
            trim = 0.5 * (low + high)
        if not low < trim < high:
            trim, low, high = 1500.0, 1500.0 - STICKS, 1500.0 + STICKS
        span = np.where(pwm >= trim, high - trim, trim - low)
        sign = firmware.channel_signs[name] * (-1.0 if parameters.get(f"RC{n}_REVERSED") else 1.0)
        channels[name] = Channel(name, "1", t[usable], (sign * (pwm - trim) / span)[usable])
    return channels


PARAMETER = "INS_GYRO_FILTER"
FILTERED = ("p", "q", "r")


def filters_of(parameters: Mapping[str, float], sources: Mapping[str, str]) -> dict[str, dict[str, Any]]:
    """Return channel -> ``parameter cutoff_hz order delay_s bias_removed`` for each rate in *sources*, if known.

    ``delay_s`` [s] is the delay of slow signals, sqrt(2) / (2 pi cutoff); ``bias_removed``: whether the estimator's
    gyro bias has been subtracted.
    """
    cutoff = parameters.get(PARAMETER, 0.0)
    if cutoff <= 0.0:
        return {}
    delay = math.sqrt(2.0) / (2.0 * math.pi * cutoff)
    row = {"parameter": PARAMETER, "cutoff_hz": cutoff, "order": 2, "delay_s": round(delay, 6)}
    return {name: {**row, "bias_removed": sources[name] != "imu"} for name in FILTERED if name in sources}
