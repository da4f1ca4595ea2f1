"""Send a million random messages and arbitrary bytes to all receivers of a vehicle's messages.

Run: ``python3 -m benchmarks.fuzzed_messages [--messages 1000000] [--seed 1] [--files 2000]``.

A craft is opened on a simulated vehicle as for a tune (session, parameters, telemetry with a recording, rates,
commands). Its input is then replaced by messages of every type with random payloads and valid checksums, under the
vehicle's own ids and others', numbers at and beyond the limits of their types, frames with flipped bits, cut off or
run together, and noise. Damaged files (telemetry logs, parameter files, journals) are read too.

The only exceptions must be those of the package. Every pump must return. Only heartbeats, time requests and
``PARAM_REQUEST_READ`` may be sent.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import random
import struct
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from benchmarks.results import Figure, headline
from gcs_autotune.errors import AutotuneError
from gcs_autotune.link import Journal, MavlinkCraft, MemoryLink, Session, open_craft
from gcs_autotune.mavlink import load_params, read_tlog, split_frames
from sitl import Server, open_vehicle

__all__ = ["FuzzedVehicle", "aboard", "fuzz_files", "fuzz_messages"]

HARMLESS = ("HEARTBEAT", "TIMESYNC", "PARAM_REQUEST_READ", "MAV_CMD_SET_MESSAGE_INTERVAL")
"""Messages that the tool may send: requests, heartbeats, and renewed requests of a slow stream."""
PLOTTED_SIGNALS = ("ATC_STR_RAT_P", "ATC_STR_RAT_I", "ATC_STR_RAT_FF")
_HEARD = (
    *("HEARTBEAT", "PARAM_VALUE", "PARAM_ERROR", "ATTITUDE", "SERVO_OUTPUT_RAW", "LOCAL_POSITION_NED", "STATUSTEXT"),
    *("GLOBAL_POSITION_INT", "VFR_HUD", "SCALED_PRESSURE2", "SYS_STATUS", "COMMAND_ACK", "MESSAGE_INTERVAL"),
    *("AUTOPILOT_VERSION", "TIMESYNC", "RC_CHANNELS"),
)
_BATCH = 50
_ODD_FLOATS = (0.0, -0.0, 1.0, math.nan, math.inf, -math.inf, 3.4e38, -3.4e38, 1e-45, 1e9)
_ODD_BYTES = (b"\x00", b"\xff", b"\x7f", b"\x80", b"\x01")


class FuzzedVehicle:
    """A simulated vehicle, which sends random data once :attr:`draw` is set. It counts the received messages."""

    def __init__(self, server: Server) -> None:
        self.server = server
        self.draw: random.Random | None = None
        self.messages = 0
        self.sent: Counter[str] = Counter()
        self._ear = mavlink.MAVLink(None)
        self._names = [name for name in _HEARD if hasattr(mavlink, f"MAVLINK_MSG_ID_{name}")]
        self._types = list(mavlink.mavlink_map.values())
        self._heard = [mavlink.mavlink_map[getattr(mavlink, f"MAVLINK_MSG_ID_{name}")] for name in self._names]

    def receive(self, data: bytes) -> None:
        """Count the messages, and obey them before the random data."""
        if self.draw is None:
            self.server.receive(data)
            return
        for frame in split_frames(data):
            self.sent[_name_of(self._ear.decode(bytearray(frame)))] += 1

    def advance_to(self, t: float) -> bytes:
        """Return the data of the vehicle up to *t*."""
        if self.draw is None:
            return self.server.advance_to(t)
        return b"".join(self._piece(self.draw) for _ in range(_BATCH))

    def _piece(self, draw: random.Random) -> bytes:
        self.messages += 1
        kind = draw.random()
        if kind < 0.04:
            return draw.randbytes(draw.randint(1, 300))
        if kind < 0.06:
            return bytes(draw.choice((0xFD, 0xFE, draw.randrange(256))) for _ in range(draw.randint(1, 40)))
        frame = self._frame(draw)
        if kind < 0.12:
            frame[draw.randrange(len(frame))] ^= 1 << draw.randrange(8)
        elif kind < 0.15:
            del frame[draw.randrange(1, len(frame)) :]
        elif kind < 0.17:
            at = draw.randrange(len(frame))
            frame[at:at] = draw.randbytes(draw.randint(1, 20))
        return bytes(frame)

    def _frame(self, draw: random.Random) -> bytearray:
        """Return a frame with a correct checksum and a random payload."""
        cls = draw.choice(self._heard) if draw.random() < 0.8 else draw.choice(self._types)
        size = cls.unpacker.size
        payload = bytearray(self._payload(draw, size))
        if cls.msgname == "PARAM_VALUE" and draw.random() < 0.7:
            payload[8:24] = draw.choice(PLOTTED_SIGNALS).encode().ljust(16, b"\0")
        if draw.random() < 0.1:
            del payload[draw.randrange(1, size + 1) :]
        own = draw.random() < 0.8
        system, component = (1, 1) if own else (draw.randrange(256), draw.randrange(256))
        if draw.random() < 0.8 or cls.id > 255:
            head = struct.pack("<BBBBBB", len(payload), 0, 0, draw.randrange(256), system, component)
            body = head + cls.id.to_bytes(3, "little") + payload
            start = b"\xfd"
        else:
            body = struct.pack("<BBBBB", len(payload), draw.randrange(256), system, component, cls.id) + payload
            start = b"\xfe"
        crc = mavlink.x25crc(body)
        crc.accumulate(struct.pack("B", cls.crc_extra))
        return bytearray(start + body + struct.pack("<H", crc.crc))

    @staticmethod
    def _payload(draw: random.Random, size: int) -> bytes:
        kind = draw.random()
        if kind < 0.4:
            return draw.randbytes(size)
        if kind < 0.5:
            return draw.choice(_ODD_BYTES) * size
        numbers = b"".join(struct.pack("<f", draw.choice(_ODD_FLOATS)) for _ in range(size // 4 + 1))
        return numbers[:size] if kind < 0.8 else (draw.randbytes(size // 2) + numbers)[:size]


def _name_of(message: Any) -> str:
    """Return the type of a message, with the number of a command."""
    if message.get_type() not in ("COMMAND_LONG", "COMMAND_INT"):
        return str(message.get_type())
    return str(mavlink.enums["MAV_CMD"][message.command].name)


def aboard(vehicle: FuzzedVehicle) -> MavlinkCraft:
    """Return a craft that was opened before the random data, with all receivers."""
    session = Session(MemoryLink(vehicle))
    craft = open_craft(session)
    craft.parameters.watch(craft.parameters.read_all(PLOTTED_SIGNALS))
    craft.start_recording("fuzzed")
    return craft


def fuzz_messages(count: int, seed: int, *, report: Callable[[str], None] = lambda text: None) -> list[str]:
    """Send *count* messages; return descriptions of all wrong reactions."""
    wrong: list[str] = []
    vehicle = FuzzedVehicle(open_vehicle("charlie", seed=1))
    vehicle.server.advance_to(5.0)
    craft = aboard(_Later(vehicle))  # type: ignore[arg-type]
    vehicle.draw = random.Random(seed)
    reported = 0
    while vehicle.messages < count and len(wrong) < 20:
        try:
            craft.session.pump()
            if vehicle.draw.random() < 0.1:
                craft.observe()
        except AutotuneError:
            pass
        except Exception as error:  # noqa: BLE001 - whatever comes is what is looked for
            wrong.append(f"after {vehicle.messages} messages: {type(error).__name__}: {error}")
        if vehicle.messages - reported >= 50_000:
            reported = vehicle.messages
            report(f"{reported} messages, {len(wrong)} wrong; sent by us: {dict(vehicle.sent)}")
    with contextlib.suppress(AutotuneError):
        craft.stop_recording("stopped")
    wrong += [f"we sent {n} {name}" for name, n in vehicle.sent.items() if name not in HARMLESS]
    report(f"{vehicle.messages} messages; sent by us: {dict(vehicle.sent)}")
    return wrong


class _Later:
    """The vehicle as a peer of a link whose clock starts at zero."""

    def __init__(self, vehicle: FuzzedVehicle) -> None:
        self._vehicle, self._offset = vehicle, vehicle.server.now

    def receive(self, data: bytes) -> None:
        self._vehicle.receive(data)

    def advance_to(self, t: float) -> bytes:
        return self._vehicle.advance_to(self._offset + t)


def _good_files() -> dict[str, bytes]:
    """Return a good file of each kind."""
    server = open_vehicle("charlie", seed=1)
    frames = split_frames(server.advance_to(8.0))
    tlog = b"".join(struct.pack(">Q", 10**15 + i) + frame for i, frame in enumerate(frames))
    params = "".join(f"{n},{v:.9g}\n" for n, v in server.vehicle.parameters.values.items()).encode()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "journal.jsonl"
        journal = Journal(path, mode="HOLD", armed=False, link="memory")
        for name in PLOTTED_SIGNALS:
            journal.record("lent", name=name, value=0.2)
            journal.record("writing", name=name, value=0.3)
            journal.record("written", name=name, value=0.3)
        journal.leave()
        return {"telemetry.tlog": tlog, "old.param": params, "journal.jsonl": path.read_bytes()}


def _damaged(data: bytes, draw: random.Random) -> bytes:
    mutated = bytearray(data)
    for _ in range(draw.randint(1, 8)):
        at, kind = draw.randrange(len(mutated) + 1), draw.randrange(5)
        if kind == 0:
            del mutated[at:]
        elif kind == 1:
            mutated[at:at] = draw.randbytes(draw.randint(1, 40))
        elif kind == 2:
            del mutated[at : at + draw.randint(1, 200)]
        elif kind == 3:
            mutated[at : at + 30] = bytes(30)
        elif mutated and at < len(mutated):
            mutated[at] ^= 1 << draw.randrange(8)
    return bytes(mutated) if draw.random() < 0.97 else draw.randbytes(draw.randint(0, 500))


def fuzz_files(count: int, seed: int) -> list[str]:
    """Damage *count* files of each kind and read them; return descriptions of all wrong reactions."""
    readers: dict[str, Callable[[Path], Any]] = {
        "telemetry.tlog": lambda path: sum(1 for _ in read_tlog(path)),
        "old.param": load_params,
        "journal.jsonl": Journal.read,
    }
    draw, wrong = random.Random(seed), []
    with tempfile.TemporaryDirectory() as folder:
        for name, data in _good_files().items():
            path = Path(folder) / name
            for k in range(count):
                path.write_bytes(_damaged(data, draw))
                try:
                    readers[name](path)
                except AutotuneError:
                    continue
                except Exception as error:  # noqa: BLE001 - whatever comes is what is looked for
                    wrong.append(f"{name} {k}: {type(error).__name__}: {error}")
    return wrong


def main(arguments: Sequence[str] | None = None) -> int:
    """Send and read everything, print the result, and return 1 after a wrong reaction."""
    parser = argparse.ArgumentParser(prog="python3 -m benchmarks.fuzzed_messages", description=__doc__)
    parser.add_argument("--messages", type=int, default=1_000_000, help="number of messages (1000000)")
    parser.add_argument("--files", type=int, default=2000, help="damaged files of each kind (2000)")
    parser.add_argument("--seed", type=int, default=1, help="seed of all random numbers (1)")
    options = parser.parse_args(arguments)
    begun = time.perf_counter()
    wrong = fuzz_messages(options.messages, options.seed, report=lambda text: print(text, flush=True))
    of_messages = len(wrong)
    wrong += fuzz_files(options.files, options.seed)
    print(f"{options.files} damaged files of each kind; {time.perf_counter() - begun:.0f} s; {len(wrong)} wrong")
    for text in wrong:
        print(text)
    figures = [
        Figure(f"wrong reactions to {options.messages} messages", of_messages, most=0.0),
        Figure(f"wrong reactions to {options.files} damaged files of each kind", len(wrong) - of_messages, most=0.0),
    ]
    headline("fuzzed_messages", "random messages, noise and damaged files", figures)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
