"""Writes logs for these tests: a simulated craft, in MAVLink messages or in dataflash text."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

ALPHA, BETA, DELTA = 0.36, 0.2, 0.02
BOOT = 100.0
"""Seconds on the vehicle's clock when a log begins."""
EPOCH = 1.6e9

BOAT = {"SERVO1_FUNCTION": 26, "SERVO3_FUNCTION": 70, **{
    f"SERVO{n}_{k}": v for n in (1, 3) for k, v in (("MIN", 1100), ("TRIM", 1500), ("MAX", 1900), ("REVERSED", 0))
}}  # fmt: skip
SKID = {**BOAT, "SERVO1_FUNCTION": 73, "SERVO3_FUNCTION": 74}


def swing(seconds: float, dt: float = 0.05, C: float = 0.4, seed: int = 0) -> dict[str, np.ndarray]:
    """Return t, psi, r, N of a relay on ``ALPHA r' + BETA r = N + DELTA``, exact between samples, noisy heading."""
    t = np.arange(0.0, seconds, dt)
    psi = r = 0.0
    high, rows = True, []
    decay = math.exp(-dt * BETA / ALPHA)
    for _ in t:
        high = psi < -0.15 or (high and psi < 0.15)
        N = C if high else -C
        rows.append((psi, r, N))
        steady = (N + DELTA) / BETA
        psi += steady * dt + (r - steady) * (1.0 - decay) * ALPHA / BETA
        r = steady + (r - steady) * decay
    noise = np.random.default_rng(seed).normal(0.0, 0.003, len(t))
    psi, r, N = np.array(rows).T
    return {"t": t, "psi": psi + noise, "r": r, "N": N}


@dataclass
class Tlog:
    """A telemetry log in the making: ``heard`` puts a message in at *t* seconds after the start."""

    frames: list[tuple[float, bytes]] = field(default_factory=list)
    _mouths: dict[tuple[int, int], Any] = field(default_factory=dict)

    def heard(self, t: float, message: Any, system: int = 1, component: int = 1) -> None:
        mouth = self._mouths.setdefault((system, component), mavlink.MAVLink(None, system, component))
        self.frames.append((t, bytes(message.pack(mouth))))
        mouth.seq = (mouth.seq + 1) % 256

    def write(self, path: Path, spoil: Callable[[list[bytes]], Iterable[bytes]] = lambda pieces: pieces) -> Path:
        ordered = sorted(self.frames, key=lambda f: f[0])
        pieces = [struct.pack(">Q", round((EPOCH + t) * 1e6)) + frame for t, frame in ordered]
        path.write_bytes(b"".join(spoil(pieces)))
        return path


def heartbeat(*, armed: bool, mode: int = 0, kind: int = 11, autopilot: int = 3) -> Any:
    return mavlink.MAVLink_heartbeat_message(kind, autopilot, 128 if armed else 0, mode, 4, 3)


def attitude(t: float, psi: float, r: float) -> Any:
    wrapped = math.atan2(math.sin(psi), math.cos(psi))
    return mavlink.MAVLink_attitude_message(round((BOOT + t) * 1e3), 0.01, 0.02, wrapped, 0.0, 0.0, r)


def servos(t: float, *pwms: int) -> Any:
    values = [*pwms, *[0] * (8 - len(pwms))]
    return mavlink.MAVLink_servo_output_raw_message(round((BOOT + t) * 1e6) % 2**32, 0, *values)


def parameters(log: Tlog, values: Mapping[str, float], t: float = 0.0, system: int = 1) -> None:
    for i, (name, value) in enumerate(values.items()):
        message = mavlink.MAVLink_param_value_message(name.encode(), float(value), 9, len(values), i)
        log.heard(t, message, system)


def sail(log: Tlog, motion: Mapping[str, np.ndarray], *, start: float = 0.0, system: int = 1, outputs: bool = True,
         pwms: Callable[[float], tuple[int, ...]] = lambda N: (1500 + round(400 * N), 0, 1600)) -> None:  # fmt: skip
    """Tell *motion* from *start* on: attitude and outputs at every sample."""
    for t, psi, r, N in zip(motion["t"] + start, motion["psi"], motion["r"], motion["N"], strict=True):
        log.heard(t, attitude(t, psi, r), system)
        if outputs:
            log.heard(t, servos(t, *pwms(N)), system)


def beats(log: Tlog, start: float, end: float, *, system: int = 1, **what: Any) -> None:
    for t in np.arange(start, end, 1.0):
        log.heard(float(t), heartbeat(**what), system)
