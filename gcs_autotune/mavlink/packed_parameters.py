"""ArduPilot's packed parameter file (``@PARAM/param.pck``): all parameters in one small file, with the firmware's
defaults.

It starts with six bytes of header: magic number, parameters in this file, parameters in total. For each parameter
follow its type and flags, the length in common with the previous name, the length of the rest, that rest, the value
and, if flagged, the default. Zero bytes pad blocks.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass

from gcs_autotune.errors import BadFile

__all__ = ["PackedParameters", "unpack_parameters"]

MAGIC, MAGIC_DEFAULTS = 0x671B, 0x671C
_HEAD = struct.Struct("<HHH")
_TYPES: Mapping[int, tuple[str, int]] = {1: ("<b", 2), 2: ("<h", 4), 3: ("<i", 6), 4: ("<f", 9)}
"""Type number in AP_Param -> packing of its value, and the MAV_PARAM_TYPE."""
_HAS_DEFAULT = 1
_NAME = 16


@dataclass(frozen=True, slots=True)
class PackedParameters:
    """Values by name, their MAV_PARAM_TYPE, and the firmware's defaults (empty if the file has none)."""

    values: Mapping[str, float]
    types: Mapping[str, int]
    defaults: Mapping[str, float]

    @property
    def changed(self) -> tuple[str, ...]:
        """Names of parameters whose value differs from the firmware's default."""
        return tuple(n for n, value in self.values.items() if n in self.defaults and self.defaults[n] != value)


def unpack_parameters(data: bytes) -> PackedParameters:
    """Decode the file.

    Raises
    ------
    BadFile
        It has another format, is truncated, or has another number of parameters than declared.
    """
    try:
        return _unpacked(data)
    except (struct.error, IndexError, UnicodeDecodeError) as error:
        raise BadFile(
            f"the packed parameter file of the vehicle is truncated or damaged: {error}. Try again"
        ) from error


def _unpacked(data: bytes) -> PackedParameters:
    magic, here, whole = _HEAD.unpack_from(data)
    if magic not in (MAGIC, MAGIC_DEFAULTS):
        raise BadFile(f"the file is not a packed parameter file: it starts with {magic:#x}, not {MAGIC:#x}")
    at, before = _HEAD.size, b""
    values: dict[str, float] = {}
    types: dict[str, int] = {}
    defaults: dict[str, float] = {}
    while at < len(data):
        if data[at] == 0:
            at += 1
            continue
        kind, flags = data[at] & 0x0F, data[at] >> 4
        shared, rest = data[at + 1] & 0x0F, (data[at + 1] >> 4) + 1
        if kind not in _TYPES or shared > len(before) or shared + rest > _NAME:
            raise BadFile(f"the packed parameter file of the vehicle is damaged at byte {at}. Try again")
        before = before[:shared] + data[at + 2 : at + 2 + rest]
        name = before.decode("ascii")
        at += 2 + rest
        code, types[name] = _TYPES[kind]
        values[name] = float(struct.unpack_from(code, data, at)[0])
        at += struct.calcsize(code)
        if magic == MAGIC_DEFAULTS:
            defaults[name] = values[name]
            if flags & _HAS_DEFAULT:
                defaults[name] = float(struct.unpack_from(code, data, at)[0])
                at += struct.calcsize(code)
    if not len(values) == here == whole or not all(map(math.isfinite, values.values())):
        raise BadFile(
            f"the packed parameter file of the vehicle contains {len(values)} of {whole} parameters, or one is not a "
            "number"
        )
    return PackedParameters(values, types, defaults)
