"""Writes logs on board as ArduRover of before 2015 did: stamps in milliseconds, none on PARM and MSG."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

CODES = {
    "I": "I",
    "h": "h",
    "H": "H",
    "f": "f",
    "c": "h",
    "C": "H",
    "e": "i",
    "L": "i",
    "N": "16s",
    "Z": "64s",
    "M": "B",
    "B": "B",
}
SCALE = {"c": 100.0, "C": 100.0, "e": 100.0, "L": 1e7}
GPS = ("GPS", "BIHBcLLeeEefI".replace("E", "e"), "Status,TimeMS,Week,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs,VZ,T")
FORMATS = (
    ("PARM", "Nf", "Name,Value"),
    ("MSG", "Z", "Message"),
    ("MODE", "IMB", "TimeMS,Mode,ModeNum"),
    ("ATT", "IccC", "TimeMS,Roll,Pitch,Yaw"),
    ("IMU", "Iffffff", "TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    ("RCOU", "Ihhhhhhhh", "TimeMS,Chan1,Chan2,Chan3,Chan4,Chan5,Chan6,Chan7,Chan8"),
    GPS,
)
PARAMETERS = {
    "RC1_MIN": 1000.0, "RC1_TRIM": 1500.0, "RC1_MAX": 2000.0, "RC1_REV": 1.0,
    "RC3_MIN": 1100.0, "RC3_TRIM": 1500.0, "RC3_MAX": 1900.0, "RC3_REV": 1.0, "SKID_STEER_OUT": 0.0,
}  # fmt: skip
Row = tuple[str, tuple[float | str, ...]]


def sailed(said: str = "ArduRover v2.46 (00000000)", seconds: float = 40.0) -> list[Row]:
    """A zigzagging boat: first order in yaw, 1.2 s, half a rad/s at full rudder, every 0.1 s from 8.8 s on."""
    rows: list[Row] = [("MSG", (said,)), *(("PARM", item) for item in PARAMETERS.items()), ("MODE", (8800, 0, 0))]
    psi = r = 0.0
    for k in range(round(10 * seconds)):
        t = 8800 + 100 * k
        share = 0.4 if (k // 30) % 2 else -0.4
        rows.append(("RCOU", (t, 1500 + 500 * share, 1500, 1700, 1500, 0, 0, 0, 0)))
        rows.append(("ATT", (t, 0.0, 0.0, math.degrees(psi) % 360.0)))
        rows.append(("IMU", (t, 0.0, 0.0, r, 0.0, 0.0, -9.8)))
        if k % 2 == 0:
            fix = (3, 130040903 + t, 1769, 10, 1.5, 44.0 + 1e-6 * k, 9.0, 0.0, 0.0, 1.5, 90.0, 0.0, t)
            rows.append(("GPS", fix))
        for _ in range(10):
            r += 0.01 * (0.5 * share - r) / 1.2
            psi += 0.01 * r
    return rows


def as_text(rows: Sequence[Row], above: str = "") -> str:
    heads = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
    heads += [f"FMT, {130 + i}, 9, {name}, {letters}, {columns}" for i, (name, letters, columns) in enumerate(FORMATS)]
    return above + "\n".join([*heads, *(", ".join([kind, *map(str, cells)]) for kind, cells in rows)]) + "\n"


def as_binary(rows: Sequence[Row]) -> bytes:
    pieces = []
    numbers = {name: 130 + i for i, (name, _, _) in enumerate(FORMATS)}
    layouts = {name: "<" + "".join(CODES[c] for c in letters) for name, letters, _ in FORMATS}
    for name, letters, columns in FORMATS:
        length = 3 + struct.calcsize(layouts[name])
        body = (numbers[name], length, name.encode(), letters.encode(), columns.encode())
        pieces.append(b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", *body))
    for kind, cells in rows:
        letters = {n: le for n, le, _ in FORMATS}[kind]
        packed = [
            c.encode() if isinstance(c, str) else float(c) if code == "f" else round(c * SCALE.get(code, 1.0))
            for c, code in zip(cells, letters, strict=True)
        ]
        pieces.append(b"\xa3\x95" + bytes([numbers[kind]]) + struct.pack(layouts[kind], *packed))
    return b"".join(pieces)
