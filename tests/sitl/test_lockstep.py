"""Decision record 1 from the side of the vehicle, over a real pipe."""

from __future__ import annotations

import io
import math
import os
import signal
import struct
import subprocess
import sys
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

import sitl
from sitl.lockstep import serve_lockstep

HEAD = struct.Struct("<dI")
ROOT = Path(__file__).resolve().parents[2]


def _script(name: str, seconds: float = 12.0) -> bytes:
    """Return the requests of a session: streams, arming, then swinging sticks."""
    mav = mavlink.MAVLink(None, 255, 190)
    boat = name == "charlie"
    requests = bytearray()
    for k in range(round(seconds * 10)):
        side = 1650 if k // 15 % 2 else 1350
        sticks = [side, 65535, 1800, 65535] if boat else [65535, 65535, 1500, side]
        if k < 45:
            sticks = [1500] * 4
        reported = mavlink.MAVLink_rc_channels_override_message(1, 1, *sticks, *[65535] * 4).pack(mav)
        if k % 10 == 0:
            reported += mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(mav)
        if k == 42:
            for number, parameters in ((511, (30, 1e5)), (176, (1, 0 if boat else 19)), (400, (1,))):
                seven = [*parameters, *[0.0] * (7 - len(parameters))]
                reported += mavlink.MAVLink_command_long_message(1, 1, number, 0, *seven).pack(mav)
        requests += HEAD.pack(round(0.1 * (k + 1), 9), len(reported)) + reported
    return bytes(requests)


def _run_process(name: str, requests: bytes, *options: str) -> bytes:
    command = [sys.executable, "-m", "sitl", name, "--lockstep", *options]
    done = subprocess.run(command, input=requests, capture_output=True, cwd=ROOT, timeout=60, check=True)
    assert done.stderr == b""
    return done.stdout


def _replies(stream: bytes) -> list[tuple[float, bytes]]:
    replies, place = [], 0
    while place < len(stream):
        reached, count = HEAD.unpack_from(stream, place)
        replies.append((reached, stream[place + HEAD.size : place + HEAD.size + count]))
        place += HEAD.size + count
    return replies


@pytest.mark.slow
@pytest.mark.parametrize("name", ["charlie", "videoray"])
def test_same_seed_and_same_requests_give_the_same_replies_to_the_last_bit(name):
    requests = _script(name)
    first = _run_process(name, requests, "--seed", "7")
    assert _run_process(name, requests, "--seed", "7") == first
    assert _run_process(name, requests, "--seed", "8") != first
    server, replies = sitl.open_vehicle(name, seed=7), io.BytesIO()
    serve_lockstep(server, io.BytesIO(requests), replies)
    assert replies.getvalue() == first
    assert server.vehicle.autopilot.armed
    assert abs(server.vehicle.state.r) > 0.01


def test_every_reply_contains_the_time_reached():
    replies = _replies(_run_process("charlie", _script("charlie", 2.0)))
    assert [reached for reached, _ in replies] == [pytest.approx(0.1 * (k + 1)) for k in range(20)]


def test_a_grant_of_zero_time_gets_an_empty_reply():
    assert _replies(_run_process("charlie", HEAD.pack(0.0, 0))) == [(0.0, b"")]


@pytest.mark.parametrize("grant", [-1.0, math.nan, math.inf])
def test_a_grant_that_is_not_in_the_future_has_no_effect(grant):
    requests = HEAD.pack(0.5, 0) + HEAD.pack(grant, 0)
    assert _replies(_run_process("charlie", requests))[1] == (0.5, b"")


@pytest.mark.parametrize("ending", [b"", b"\0\0\0", HEAD.pack(1.0, 50) + b"short"])
def test_the_end_of_input_ends_the_process(ending):
    assert len(_replies(_run_process("charlie", HEAD.pack(0.1, 0) + ending))) == 1


def test_an_interrupt_is_ignored_and_a_termination_is_obeyed():
    command = [sys.executable, "-m", "sitl", "charlie", "--lockstep"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT) as process:
        assert process.stdin and process.stdout
        for sign in (None, signal.SIGINT):
            if sign is not None:
                os.kill(process.pid, sign)
            process.stdin.write(HEAD.pack(0.1, 0))
            process.stdin.flush()
            _, count = HEAD.unpack(process.stdout.read(HEAD.size))
            process.stdout.read(count)
        process.terminate()
        assert process.wait(10) == 0


def test_the_result_does_not_depend_on_the_size_of_grants():
    coarse, fine = sitl.open_vehicle("falcon", seed=3), sitl.open_vehicle("falcon", seed=3)
    whole = coarse.advance_to(3.0)
    pieces = b"".join(fine.advance_to(0.013 * k) for k in range(1, 230)) + fine.advance_to(3.0)
    assert pieces == whole
