"""The autopilot's parameters: names, stored types, values, and how a written value is stored."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

__all__ = ["Definition", "ParameterStore", "ReadOnlyParameter", "parse_table", "stored"]

_FLOAT = 9
_TYPES: Mapping[str, int] = {"i8": 2, "i16": 4, "i32": 6, "f32": _FLOAT}
"""Stored type -> MAV_PARAM_TYPE."""
_RANGES: Mapping[int, tuple[float, float]] = {2: (-128, 127), 4: (-32768, 32767), 6: (-2147483648, 2147483647)}
_NUDGE = 0.01
"""Added by ArduPilot before it truncates a float to an integer: 2.99 is stored as 3, 2.7 as 2."""


class ReadOnlyParameter(ValueError):
    """Raised by an attempt to write a parameter that only the firmware may change."""


@dataclass(frozen=True, slots=True)
class Definition:
    """A parameter's name, MAV_PARAM_TYPE and default, and whether a ground station may write it."""

    name: str
    kind: int
    default: float
    read_only: bool = False


def parse_table(text: str) -> tuple[Definition, ...]:
    """Return the definitions in *text*, one ``NAME TYPE DEFAULT [ro]`` per line; ``#`` starts a comment."""
    rows = (line.partition("#")[0].split() for line in text.splitlines())
    return tuple(Definition(row[0], _TYPES[row[1]], float(row[2]), row[3:] == ["ro"]) for row in rows if row)


def _as_float32(value: float) -> float:
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


def stored(kind: int, value: float) -> float:
    """Return *value* as stored in a parameter of the MAV_PARAM_TYPE *kind*: rounded and limited to it."""
    if kind == _FLOAT:
        limit = 3.4028234e38
        return _as_float32(max(-limit, min(limit, value)))
    low, high = _RANGES[kind]
    return float(int(max(low, min(high, value + math.copysign(_NUDGE, value)))))


class ParameterStore:
    """The parameters: name -> value, in a fixed order (by name, as in ArduPilot).

    ``version`` counts changes, so that users of derived values know when to update them. ``values`` is the plain
    dictionary, for loops that read dozens of parameters every tick.
    """

    def __init__(self, definitions: Iterable[Definition]) -> None:
        ordered = sorted(definitions, key=lambda d: d.name)
        self._definitions = {d.name: d for d in ordered}
        self._index = {d.name: k for k, d in enumerate(ordered)}
        self._names = tuple(self._definitions)
        self.values: dict[str, float] = {d.name: stored(d.kind, d.default) for d in ordered}
        self.version = 0

    def __len__(self) -> int:
        return len(self._names)

    def __contains__(self, name: str) -> bool:
        return name in self.values

    def __getitem__(self, name: str) -> float:
        return self.values[name]

    def name_at(self, index: int) -> str | None:
        """Return the parameter name at *index* of the list, or None beyond its end."""
        return self._names[index] if 0 <= index < len(self._names) else None

    def index_of(self, name: str) -> int:
        """Return the index of *name* in the parameter list."""
        return self._index[name]

    def kind_of(self, name: str) -> int:
        """Return the MAV_PARAM_TYPE of *name*."""
        return self._definitions[name].kind

    def write(self, name: str, value: float) -> bool:
        """Write a value from a ground station. Return whether it was accepted; NaN and infinity are not.

        Raises
        ------
        KeyError
            No such parameter.
        ReadOnlyParameter
            Only the firmware may change it.
        """
        definition = self._definitions[name]
        if definition.read_only:
            raise ReadOnlyParameter(name)
        if not math.isfinite(value):
            return False
        self.preset(name, value)
        return True

    def preset(self, name: str, value: float) -> None:
        """Set a value internally: vehicle defaults, or values read at boot. Raises ``KeyError`` if the name is
        unknown.
        """
        self.values[name] = stored(self._definitions[name].kind, value)
        self.version += 1

    def preset_exact(self, name: str, value: float) -> None:
        """Set a value without rounding it to the parameter's type. It is for values rounded in another unit before."""
        if name not in self.values:
            raise KeyError(name)
        self.values[name] = value
        self.version += 1

    def default_of(self, name: str) -> float:
        """Return the firmware's default of *name*."""
        definition = self._definitions[name]
        return stored(definition.kind, definition.default)

    def is_read_only(self, name: str) -> bool:
        """Whether only the firmware may change *name*."""
        return self._definitions[name].read_only
