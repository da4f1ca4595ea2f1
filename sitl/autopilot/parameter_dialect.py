"""Parameter names and units of other firmware generations, as sent over MAVLink.

Internally the autopilot uses the names of mid-2025: new names for MAV_*, old names for all others. Sources:
ArduPilot's "Parameter Name Changes" 4.6 to 4.7, and an ArduSub of December 2025, which has some of the new names.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from sitl.autopilot.parameters import ParameterStore, ReadOnlyParameter, stored

__all__ = ["GENERATIONS", "ParameterDialect", "UnknownGeneration"]

_FLOAT, _INT8, _INT16, _INT32 = 9, 2, 4, 6


class UnknownGeneration(ValueError):
    """Raised for an unknown name of a firmware generation."""


@dataclass(frozen=True, slots=True)
class _Word:
    """Name of a parameter over MAVLink, its MAV_PARAM_TYPE, and the conversions of its value to MAVLink and back."""

    name: str
    kind: int
    there: Callable[[float], float]
    back: Callable[[float], float]


def _same(name: str, kind: int = _FLOAT) -> _Word:
    return _Word(name, kind, float, float)


def _times(name: str, factor: float) -> _Word:
    return _Word(name, _FLOAT, lambda x: x * factor, lambda x: x / factor)


_MASK = 0x1FFFFE


def _checks_skipped(checks: float) -> float:
    if checks == 0.0:
        return -1.0
    return 0.0 if int(checks) & 1 else float(~int(checks) & _MASK)


def _checks_run(skipped: float) -> float:
    if skipped == -1.0:
        return 0.0
    return 1.0 if skipped == 0.0 else float(~int(skipped) & _MASK)


_OLD_IDS = {"MAV_GCS_SYSID": _same("SYSID_MYGCS", _INT16), "MAV_SYSID": _same("SYSID_THISMAV", _INT16)}

_POSITION: dict[str, _Word] = {
    "PSC_POSZ_P": _same("PSC_D_POS_P"),
    **{f"PSC_VELZ_{x}": _same(f"PSC_D_VEL_{x}") for x in ("P", "I", "D", "FF", "FLTE", "FLTD")},
    "PSC_VELZ_IMAX": _times("PSC_D_VEL_IMAX", 0.01),
    **{f"PSC_ACCZ_{x}": _times(f"PSC_D_ACC_{x}", 0.1) for x in ("P", "I", "D", "FF", "D_FF")},
    **{f"PSC_ACCZ_{x}": _same(f"PSC_D_ACC_{x}") for x in ("FLTE", "FLTD", "FLTT", "SMAX")},
    **{f"PSC_ACCZ_{x}": _times(f"PSC_D_ACC_{x}", 0.001) for x in ("IMAX", "PDMX")},
    "PSC_JERK_Z": _same("PSC_JERK_D"),
    "PSC_JERK_XY": _same("PSC_JERK_NE"),
    "PSC_POSXY_P": _same("PSC_NE_POS_P"),
    **{f"PSC_VELXY_{x}": _same(f"PSC_NE_VEL_{x}") for x in ("P", "I", "D", "FF", "FLTE", "FLTD")},
    "PSC_VELXY_IMAX": _times("PSC_NE_VEL_IMAX", 0.01),
    "ARMING_CHECK": _Word("ARMING_SKIPCHK", _INT32, _checks_skipped, _checks_run),
}

_ATTITUDE: dict[str, _Word] = {
    **{f"ATC_ACCEL_{x}_MAX": _times(f"ATC_ACC_{x}_MAX", 0.01) for x in "RPY"},
    "ATC_SLEW_YAW": _times("ATC_RATE_WPY_MAX", 0.01),
    "ANGLE_MAX": _times("ATC_ANGLE_MAX", 0.01),
    "PILOT_SPEED_UP": _times("PILOT_SPD_UP", 0.01),
    "PILOT_SPEED_DN": _times("PILOT_SPD_DN", 0.01),
    "PILOT_ACCEL_Z": _times("PILOT_ACC_Z", 0.01),
}

GENERATIONS: Mapping[str, Mapping[str, _Word]] = {
    "own": {},
    "4.5": {**_OLD_IDS, "GPS1_TYPE": _same("GPS_TYPE", _INT8)},
    "4.6": _OLD_IDS,
    "4.7-dev": _POSITION,
    "4.7": {**_POSITION, **_ATTITUDE},
}
"""Firmware generation -> {internal name: name, type and unit in that generation}, for each parameter that differs.

``PILOT_SPD_*`` are those of Copter 4.7.0.
"""

_LATER = "MAV_OPTIONS MAV_TELEM_DELAY RC_FS_TIMEOUT"
_LATER_ON = {
    "rover": f"{_LATER} ARMING_NEED_LOC ATC_STR_DEC_MAX",
    "sub": f"{_LATER} FLTMODE1 FLTMODE2 FLTMODE3 FLTMODE4 FLTMODE5 FLTMODE6 FS_THR_ENABLE FS_THR_VALUE PILOT_SPEED "
    "RC1_OPTION RC2_OPTION RC3_OPTION RC4_OPTION RC5_OPTION RC6_OPTION RC7_OPTION RC8_OPTION "
    "RCMAP_FORWARD RCMAP_LATERAL RCMAP_PITCH RCMAP_ROLL RCMAP_THROTTLE RCMAP_YAW SURFACE_MAX_THR",
}
"""Firmware -> parameters that 4.5 and 4.6 do not have yet, from the parameter list of a running 4.6.3."""

_BEFORE_THOSE = frozenset({"4.5", "4.6"})
_BUILT_IN = {"ATC_STR_DEC_MAX": 0.0, "RC_FS_TIMEOUT": 0.5, "SURFACE_MAX_THR": 1.0, "RCMAP_THROTTLE": 0.0}
"""Their fixed behaviour instead: sticks time out after 0.5 s, thrust is not limited at the surface, and the throttle
stick is relative to its trim (0: see ``Sub``)."""
_EARLIER_RC3_TRIM = 1100.0
"""ArduSub's default before 4.7 (then 1500)."""

_ANSWER_ERRORS = frozenset({"4.7-dev", "4.7"})
"""Generations that answer with PARAM_ERROR. Others do not answer (observed in December 2025)."""


class ParameterDialect:
    """The parameters as seen by a ground station: other names and units for the parameters in *store*.

    Parameters that this generation of *firmware* ("rover", "sub") does not have yet are hidden, and set to its fixed
    behaviour.

    ``answers_errors``: whether this generation answers with an error to an unknown name or an invalid value.
    """

    def __init__(self, store: ParameterStore, generation: str = "own", firmware: str = "") -> None:
        if generation not in GENERATIONS:
            raise UnknownGeneration(f"no firmware names '{generation}'. Use one of {', '.join(GENERATIONS)}")
        self._store = store
        self.answers_errors = generation in _ANSWER_ERRORS
        words = GENERATIONS[generation]
        later = set(_LATER_ON.get(firmware, "").split()) if generation in _BEFORE_THOSE else set()
        for old in later & _BUILT_IN.keys():
            store.preset(old, _BUILT_IN[old])
        if firmware == "sub" and later:
            store.preset("RC3_TRIM", _EARLIER_RC3_TRIM)
        inside = [name for i in range(len(store)) if (name := store.name_at(i)) is not None and name not in later]
        self._inside = {words[n].name if n in words else n: n for n in inside}
        self._words = {words[n].name: words[n] for n in inside if n in words}
        self._names = tuple(sorted(self._inside))
        self._index = {name: k for k, name in enumerate(self._names)}
        self._written: dict[str, tuple[float, float]] = {}
        self.on_change: Callable[[str, float], None] | None = None

    def __len__(self) -> int:
        return len(self._names)

    def __contains__(self, name: str) -> bool:
        return name in self._index

    def __getitem__(self, name: str) -> float:
        inside = self._store[self._inside[name]]
        word = self._words.get(name)
        if word is None:
            return inside
        written, meant = self._written.get(name, (math.nan, math.nan))
        return written if meant == inside else stored(word.kind, word.there(inside))

    def name_at(self, index: int) -> str | None:
        """Return the parameter name at *index* of the list, or None beyond its end."""
        return self._names[index] if 0 <= index < len(self._names) else None

    def index_of(self, name: str) -> int:
        """Return the index of *name* in the parameter list."""
        return self._index[name]

    def kind_of(self, name: str) -> int:
        """Return the MAV_PARAM_TYPE of *name*."""
        word = self._words.get(name)
        return word.kind if word is not None else self._store.kind_of(self._inside[name])

    def default_of(self, name: str) -> float:
        """Return the firmware's default of *name*, in the unit used over MAVLink."""
        inside, word = self._store.default_of(self._inside[name]), self._words.get(name)
        return inside if word is None else stored(word.kind, word.there(inside))

    def write(self, name: str, value: float) -> bool:
        """Write a value from a ground station. Return whether it was accepted; NaN and infinity are not."""
        if self._store.is_read_only(self._inside[name]):
            raise ReadOnlyParameter(name)
        if not math.isfinite(value):
            return False
        self.preset(name, value)
        if self.on_change is not None:
            self.on_change(name, self[name])
        return True

    def preset(self, name: str, value: float) -> None:
        """Set a value internally, under its name over MAVLink. Raises ``KeyError`` if the name is unknown."""
        inside, word = self._inside[name], self._words.get(name)
        if word is None:
            self._store.preset(inside, value)
            return
        kept = stored(word.kind, value)
        self._store.preset_exact(inside, word.back(kept))
        self._written[name] = kept, self._store[inside]

    def hash(self) -> int:
        """Return a 24-bit checksum of all names and values. The float of a PARAM_VALUE represents 24 bits exactly."""
        state = 0
        for name in self._names:
            state = zlib.crc32(name.encode() + struct.pack("<f", self[name]), state)
        return state & 0xFFFFFF
