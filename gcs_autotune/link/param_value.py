"""What a parameter may be called and what it may hold: sixteen plain letters, a 32-bit float."""

from __future__ import annotations

import math
import struct

from gcs_autotune.errors import UsageError

__all__ = ["as_float32", "encoded", "same_float32"]

_NAME = 16


def same_float32(a: float, b: float) -> bool:
    """Whether two numbers are the same 32-bit float, give or take its last bits."""
    if a == b or (math.isnan(a) and math.isnan(b)):
        return True
    return math.isfinite(a) and math.isfinite(b) and abs(a - b) <= 4.0 * 2.0**-24 * max(abs(a), abs(b))


def encoded(name: str) -> bytes:
    """Return *name* as it goes on the wire.

    Raises
    ------
    UsageError
        No parameter can be called that.
    """
    if not (0 < len(name) <= _NAME and name.isascii()):
        raise UsageError(f"'{name}' is no parameter name: 1 to {_NAME} plain letters")
    return name.encode("ascii")


def as_float32(name: str, value: float) -> float:
    """Return *value* as the parameter called *name* would hold it.

    Raises
    ------
    UsageError
        It is not a finite number a 32-bit float can hold.
    """
    try:
        wanted = float(struct.unpack("<f", struct.pack("<f", value))[0])
    except OverflowError:
        wanted = float("inf")
    if wanted - wanted != 0.0:
        raise UsageError(f"{name} = {value} cannot be written: it is not a finite 32-bit number")
    return wanted
