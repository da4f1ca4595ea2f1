"""Writes binary logs on board for these tests: FMT messages, then rows, as the autopilot does."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

HEAD = b"\xa3\x95"
CODES = {
    "Q": "Q",
    "B": "B",
    "H": "H",
    "h": "h",
    "f": "f",
    "c": "h",
    "L": "i",
    "N": "16s",
    "Z": "64s",
    "M": "B",
    "I": "I",
}
SCALE = {"c": 100.0, "L": 1e7}

FORMATS = (
    ("PARM", "QNff", "TimeUS,Name,Value,Default"),
    ("MSG", "QBBZ", "TimeUS,ID,Seq,Message"),
    ("MODE", "QMBB", "TimeUS,Mode,ModeNum,Rsn"),
    ("ARM", "QBIBB", "TimeUS,ArmState,ArmChecks,Forced,Method"),
    ("ATT", "Qccc", "TimeUS,Roll,Pitch,Yaw"),
    ("IMU", "QBfff", "TimeUS,I,GyrX,GyrY,GyrZ"),
    ("RATE", "Qfff", "TimeUS,R,P,Y"),
    ("RCOU", "QHHH", "TimeUS,C1,C2,C3"),
    ("GPS", "QBBLLff", "TimeUS,I,Status,Lat,Lng,Spd,GCrs"),
    ("SIM", "Qf", "TimeUS,Yaw"),
)


@dataclass
class Board:
    """A log in the making."""

    pieces: list[bytes] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.format(128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
        for i, (name, letters, columns) in enumerate(FORMATS):
            self.format(130 + i, name, letters, columns)

    def format(self, number: int, name: str, letters: str, columns: str) -> None:
        length = 89 if name == "FMT" else 3 + struct.calcsize("<" + "".join(CODES[c] for c in letters))
        body = struct.pack("<BB4s16s64s", number, length, name.encode(), letters.encode(), columns.encode())
        self.pieces.append(HEAD + b"\x80" + body)

    def row(self, name: str, t: float, *values: float | str) -> None:
        number, (_, letters, _) = next((130 + i, f) for i, f in enumerate(FORMATS) if f[0] == name)
        cells = [
            v.encode() if isinstance(v, str) else v * SCALE.get(c, 1.0)
            for c, v in zip(letters[1:], values, strict=True)
        ]
        packed = [round(c) if isinstance(c, float) and code not in "fd" else c
                  for c, code in zip(cells, (CODES[x] for x in letters[1:]), strict=True)]  # fmt: skip
        layout = "<" + "".join(CODES[c] for c in letters)
        self.pieces.append(HEAD + bytes([number]) + struct.pack(layout, round(t * 1e6), *packed))

    def boat(self, servos: Sequence[int] = (1, 3), t: float = 100.0) -> None:
        """Tell the parameters of a rudder boat, and what the log is of."""
        for n, function in zip(servos, (26, 70), strict=True):
            fields = {"FUNCTION": function, "MIN": 1100, "TRIM": 1500, "MAX": 1900, "REVERSED": 0}
            for name, value in fields.items():
                self.row("PARM", t, f"SERVO{n}_{name}", float(value), 0.0)
        self.row("MSG", t, 0, 0, "ArduRover V4.6.0 (abcdef)")
        self.row("MODE", t, 0, 0, 1)

    def write(self, path: Path) -> Path:
        path.write_bytes(b"".join(self.pieces))
        return path
