"""No input may crash the simulator."""

from __future__ import annotations

import math
import random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

import sitl
from gcs_autotune.mavlink import Framer, Packer
from sitl.mavlink import dialect
from sitl.mavlink.server import HANDLERS

ODD_NUMBERS = (0.0, -0.0, 1.0, -1.0, 1e-30, 3e38, -3e38, math.nan, math.inf, -math.inf, 176.0, 65535.0)
SIZES = {
    "uint8_t": 8,
    "int8_t": 7,
    "uint16_t": 16,
    "int16_t": 15,
    "uint32_t": 32,
    "int32_t": 31,
    "uint64_t": 64,
    "int64_t": 63,
}


@given(st.lists(st.binary(max_size=300), max_size=8))
@settings(max_examples=40, deadline=None, derandomize=True)
def test_arbitrary_bytes_never_raise(pieces):
    server = sitl.open_vehicle("charlie")
    for k, piece in enumerate(pieces, start=1):
        server.receive(piece)
        server.advance_to(0.04 * k)
    assert server.advance_to(5.0)


@given(st.integers(0, 400), st.integers(0, 255))
@settings(max_examples=40, deadline=None, derandomize=True)
def test_a_damaged_message_costs_only_a_few_others(place, flip):
    mav = mavlink.MAVLink(None, 255, 190)
    good = b"".join(mavlink.MAVLink_timesync_message(0, n).pack(mav) for n in range(1, 61))
    damaged = bytearray(good)
    damaged[place % len(good)] ^= flip
    server, ear = sitl.open_vehicle("charlie"), mavlink.MAVLink(None)
    server.receive(bytes(damaged))
    replies = [m for m in ear.parse_buffer(server.advance_to(0.1)) if m.get_type() == "TIMESYNC"]
    assert len(replies) >= 30
    assert replies[-1].ts1 == 60


def _random_field(rng: random.Random, kind: str, length: int) -> Any:
    if kind == "char":
        return bytes(rng.randrange(256) for _ in range(length))
    if kind in ("float", "double"):
        values = [rng.choice((*ODD_NUMBERS, rng.gauss(0, 10))) for _ in range(max(1, length))]
    else:
        bits = SIZES[kind]
        low = 0 if kind.startswith("u") else -(2**bits)
        values = [rng.choice((0, 1, low, 2**bits - 1, rng.randint(low, 2**bits - 1))) for _ in range(max(1, length))]
    return values if length else values[0]


def _fields(cls: Any) -> list[tuple[str, str, int]]:
    types = dict(zip(cls.fieldnames, cls.fieldtypes, strict=True))
    lengths = dict(zip(cls.ordered_fieldnames, cls.array_lengths, strict=True))
    return [(name, types[name], lengths[name]) for name in cls.fieldnames]


@pytest.mark.parametrize("name", ["charlie", "falcon"])
@pytest.mark.parametrize("seed", [0, 1, 134, 137])
def test_well_formed_messages_with_odd_numbers_never_raise(name, seed):
    rng = random.Random(seed)
    server, mav = sitl.open_vehicle(name), mavlink.MAVLink(None, 255, 190)
    server.advance_to(4.0)
    for message in server.streams.available:
        server.streams.request(message, 25_000, server.now_us)
    for k in range(300):
        server.vehicle.autopilot.arm(force=True)
        kind = rng.choice(sorted(HANDLERS))
        cls = mavlink.mavlink_map[getattr(mavlink, f"MAVLINK_MSG_ID_{kind}")]
        values = {field: _random_field(rng, form, length) for field, form, length in _fields(cls)}
        for target in ("target_system", "target_component", "target"):
            if target in values:
                values[target] = 1
        if kind == "PARAM_SET" and rng.random() < 0.7:
            values["param_id"] = rng.choice(list(server.vehicle.parameters.values)).encode()
        if kind in ("COMMAND_LONG", "COMMAND_INT"):
            values["command"] = rng.choice((176, 400, 510, 511, 512, 520, 246, values["command"]))
        server.receive(cls(**values).pack(mav))
        server.advance_to(4.0 + 0.1 * (k + 1))
    body = server.vehicle.state
    assert all(map(math.isfinite, (body.psi, body.r, body.u, body.z, body.w)))
    assert set(map(type, server.vehicle.autopilot.pwm)) == {int}


def _all_of(message: Any) -> dict[str, str]:
    """Fields and header of *message* as texts, in which a NaN is a NaN and -0.0 is not 0.0."""
    fields = {name: repr(getattr(message, name)) for name in message.get_fieldnames()}
    return {
        "type": message.get_type(),
        **fields,
        **{f"header {k}": str(v) for k, v in vars(message.get_header()).items()},
    }


def test_every_message_is_packed_and_read_as_by_pymavlink():
    assert len(mavlink.mavlink_map) > 200
    rng, theirs, ours = random.Random(3), mavlink.MAVLink(None, 7, 9), Packer(7, 9)
    for cls in mavlink.mavlink_map.values():
        values = {field: _random_field(rng, form, length) for field, form, length in _fields(cls)}
        blank = {name: bytes(length) if form == "char" else [0] * length or 0 for name, form, length in _fields(cls)}
        for fields in (values, blank):
            frame = bytes(cls(**fields).pack(theirs))
            assert dialect.pack(cls(**fields), theirs) == ours.pack(cls(**fields)) == frame
            reported = _all_of(mavlink.MAVLink(None).decode(bytearray(frame)))
            (heard,) = dialect.parse(mavlink.MAVLink(None), frame)
            (read,) = Framer().feed(frame)
            assert _all_of(heard) == _all_of(read.message) == reported
            assert bytes(read.message.get_msgbuf()) == read.raw == frame
            theirs.seq = (theirs.seq + 1) % 256


def test_the_simulator_reads_a_damaged_stream_like_pymavlink():
    mav, rng, read = mavlink.MAVLink(None, 255, 190), random.Random(5), []
    for _ in range(40):
        sent = [mavlink.MAVLink_timesync_message(0, n) for n in range(6)]
        data = bytearray(b"".join(message.pack(mav, force_mavlink1=rng.random() < 0.2) for message in sent))
        for _ in range(rng.randrange(3)):
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        theirs, ours = mavlink.MAVLink(None), mavlink.MAVLink(None)
        theirs.robust_parsing = ours.robust_parsing = True
        for at in range(0, len(data), 50):
            piece = bytes(data[at : at + 50])
            reported = theirs.parse_buffer(piece) or []
            read += [_all_of(message)["type"] for message in reported]
            assert [_all_of(m) for m in dialect.parse(ours, piece)] == [_all_of(m) for m in reported]
    assert read.count("TIMESYNC") > 100
    assert read.count("BAD_DATA") > 10
