"""The data format of the external-physics interface: servo pulses in, one line of JSON out.

Measured on ArduPilot master of 2025 (``libraries/SITL/SIM_JSON``): its reader requires ``"key":[..]`` without white
space, and a line feed at both ends.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

__all__ = ["BadPacket", "Servos", "State", "read_servos", "write_state"]

_MAGIC_16, _MAGIC_32 = 18458, 29569
_PACKETS = {_MAGIC_16: struct.Struct("<HHI16H"), _MAGIC_32: struct.Struct("<HHI32H")}
"""Packet formats: magic number, SIM_RATE_HZ, frame count, pulses [us].

There are 16 pulses, or 32 with SERVO_32_ENABLE.
"""
_OUTPUTS = 16


class BadPacket(ValueError):
    """Raised for a datagram that is not a servo packet; the message states why."""


@dataclass(frozen=True, slots=True)
class Servos:
    """One request: frame ``rate`` [Hz], number ``count`` of this frame since ArduPilot started, and servo pulses
    ``pwm`` [us].
    """

    rate: int
    count: int
    pwm: tuple[int, ...]


@dataclass(slots=True)
class State:
    """One answer: the state of the hull as reported to ArduPilot. SI and radians; north, east, down from home; body
    axes ahead, starboard, down.

    ``t`` [s] never decreases; ``force`` (3,) [m/s^2] is the specific force measured by an accelerometer; ``gyro`` (3,)
    [rad/s]; ``attitude`` (3,) roll, pitch, yaw; ``position`` (3,) [m]; ``velocity`` (3,) [m/s]; the battery's
    ``voltage`` [V] and ``current`` [A], which older firmware ignores; ``distances`` [m], one per rangefinder.
    """

    t: float = 0.0
    gyro: tuple[float, float, float] = (0.0, 0.0, 0.0)
    force: tuple[float, float, float] = (0.0, 0.0, 0.0)
    attitude: tuple[float, float, float] = (0.0, 0.0, 0.0)
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    voltage: float = 0.0
    current: float = 0.0
    distances: tuple[float, ...] = ()


def read_servos(datagram: bytes) -> Servos:
    """Return the request in *datagram*, with at most the first 16 pulses.

    Raises
    ------
    BadPacket
        The magic number or the length is wrong.
    """
    if len(datagram) < 2:
        raise BadPacket(f"{len(datagram)} bytes are too few for a servo packet")
    (magic,) = struct.unpack_from("<H", datagram)
    form = _PACKETS.get(magic)
    if form is None:
        raise BadPacket(
            f"magic number {magic} is neither {_MAGIC_16} nor {_MAGIC_32}, so the packet is not from ArduPilot's "
            "JSON interface"
        )
    if len(datagram) != form.size:
        raise BadPacket(f"{len(datagram)} bytes with magic number {magic}, but that packet must have {form.size} bytes")
    _, rate, count, *pwm = form.unpack(datagram)
    return Servos(rate, count, tuple(pwm[:_OUTPUTS]))


_FORM = (
    '\n{"timestamp":%.9f,"imu":{"gyro":[%.9f,%.9f,%.9f],"accel_body":[%.7f,%.7f,%.7f]},'
    '"position":[%.7f,%.7f,%.7f],"attitude":[%.9f,%.9f,%.9f],"velocity":[%.7f,%.7f,%.7f],'
    '"battery":{"voltage":%.3f,"current":%.3f}%s}\n'
)


def write_state(state: State) -> bytes:
    """Return the datagram for *state*: a line of JSON."""
    motion = (*state.gyro, *state.force, *state.position, *state.attitude, *state.velocity)
    ranges = "".join(f',"rng_{number}":{distance:.4f}' for number, distance in enumerate(state.distances, start=1))
    return (_FORM % (state.t, *motion, state.voltage, state.current, ranges)).encode("ascii")
