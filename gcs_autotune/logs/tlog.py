"""Telemetry logs of ground stations to tapes: one vehicle of them, by its own clock."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from gcs_autotune.errors import BadFile, UsageError
from gcs_autotune.firmware import firmware_for
from gcs_autotune.link import TlogRecord, read_tlog
from gcs_autotune.link.wire import Message
from gcs_autotune.logs.stretches import runs_of
from gcs_autotune.logs.tape import Note, Tape
from gcs_autotune.trial import Trial

__all__ = ["load_tlog"]

ARMED = 128
"""MAV_MODE_FLAG_SAFETY_ARMED."""
NO_AUTOPILOT = 8
"""MAV_AUTOPILOT_INVALID: a heartbeat of something that steers nothing (ground station, camera, companion)."""
REBOOT = 5.0
"""Chosen [s]: a boot clock that falls back by more belongs to a new boot; by less, to a late message."""
WRAP_US = 2**32 * 1e-6
WRAP_MS = 2**32 * 1e-3


def load_tlog(path: Path, system: int | None = None) -> list[Trial]:
    """Return the runs in the telemetry log at *path*.

    Parameters
    ----------
    system : the vehicle's system id, where the log heard several; the one heard most when None.

    Raises
    ------
    BadFile
        Unreadable, or not a telemetry log.
    UsageError
        No vehicle of that *system* in it.
    NotInformative
        No stretch of it is armed, driven and moves.
    """
    log = read_tlog(path)
    records = list(log)
    if not records:
        raise BadFile(f"{path} holds no MAVLink message: it is no telemetry log, or damaged from end to end")
    vehicles = _vehicles(records)
    if not vehicles:
        raise BadFile(f"{path} holds {len(records)} messages but no autopilot's HEARTBEAT: no vehicle was heard")
    chosen = _chosen(path, vehicles, system)
    notes: list[Note] = []
    others = sorted({s for s, _ in vehicles} - {chosen[0]})
    if others and system is None:
        notes.append(
            (
                "several-vehicles",
                f"the log heard vehicles {', '.join(map(str, [chosen[0], *others]))}; only {chosen[0]} was read",
                "name another with --system-id",
            )
        )
    if log.damaged:
        notes.append(
            (
                "damaged-log",
                f"{log.damaged} stretches of the log ({log.damaged_bytes} bytes) were damaged and left out",
                "record nearer to the radio, or use the log on board (.bin)",
            )
        )
    meta = {
        "source": path.name,
        "messages": log.frames,
        "damaged": log.damaged,
        "damaged_bytes": log.damaged_bytes,
        "truncated": log.truncated,
        "system": chosen[0],
    }
    return runs_of(_Scribe(path.stem, chosen).write(records), meta, notes)


def _vehicles(records: list[TlogRecord]) -> Counter[tuple[int, int]]:
    """Return (system, component) of every autopilot and how often its HEARTBEAT was heard."""
    return Counter(
        (r.frame.system, r.frame.component)
        for r in records
        if r.frame.name == "HEARTBEAT"
        and r.frame.message.autopilot != NO_AUTOPILOT
        and firmware_for(r.frame.message.autopilot, r.frame.message.type) is not None
    ) or Counter(
        (r.frame.system, r.frame.component)
        for r in records
        if r.frame.name == "HEARTBEAT" and r.frame.message.autopilot != NO_AUTOPILOT
    )


def _chosen(path: Path, vehicles: Counter[tuple[int, int]], system: int | None) -> tuple[int, int]:
    if system is None:
        return vehicles.most_common(1)[0][0]
    mine = [who for who, _ in vehicles.most_common() if who[0] == system]
    if not mine:
        heard = ", ".join(str(s) for s, _ in vehicles)
        raise UsageError(f"{path} heard no vehicle of system id {system}; it heard {heard}")
    return mine[0]


@dataclass
class _Scribe:
    """Writes one vehicle's messages onto tapes, a new one after each boot."""

    name: str
    vehicle: tuple[int, int]
    _tapes: list[Tape] = field(default_factory=list)
    _boot: float = math.nan
    _heard: float = math.nan
    _now: float = -math.inf

    def write(self, records: list[TlogRecord]) -> list[Tape]:
        """Return the tapes; times are the vehicle's own where its messages carry them, else mapped onto these."""
        own = any(r.frame.name in _BOOT_MS and self._is_ours(r) for r in records)
        clock = "vehicle (time_boot_ms)" if own else "ground station"
        self._tapes = [Tape(self.name, clock)]
        parameters: dict[str, float] = {}
        for record in records:
            m, name = record.frame.message, record.frame.name
            if self._is_ours(record):
                t = self._stamp(record, own)
                if name == "PARAM_VALUE":
                    parameters[_text(m.param_id)] = float(m.param_value)
                elif name == "HEARTBEAT":
                    self._heartbeat(t, m)
                elif name == "STATUSTEXT":
                    self._tape.texts.append((t, _text(m.text)))
                elif name in _SIGNALS and math.isfinite(t):
                    self._tape.take(t, _SIGNALS[name](m))
            elif name == "MANUAL_CONTROL" and m.target in (0, self.vehicle[0]) and math.isfinite(self._boot):
                self._tape.take(self._mapped(record), _sticks(m))
        for tape in self._tapes:
            tape.parameters = dict(parameters)
        return [t for t in self._tapes if t.span != (0.0, 0.0)] or self._tapes[:1]

    @property
    def _tape(self) -> Tape:
        return self._tapes[-1]

    def _is_ours(self, record: TlogRecord) -> bool:
        return (record.frame.system, record.frame.component) == self.vehicle

    def _mapped(self, record: TlogRecord) -> float:
        """Return the vehicle's time at the ground's stamp, from the last message that carried both."""
        self._now = max(self._now, self._boot + max(0.0, record.time - self._heard))
        return self._now

    def _stamp(self, record: TlogRecord, own: bool) -> float:
        if not own:
            self._boot = self._heard = record.time
            return record.time
        m, name = record.frame.message, record.frame.name
        if name in _BOOT_MS:
            t = _nearest(m.time_boot_ms * 1e-3, self._boot, WRAP_MS)
            if t < self._boot - REBOOT:
                self._now = t
                self._tapes.append(Tape(self.name, self._tape.clock, self._tape.vehicle, self._tape.firmware))
            if not t < self._boot or t < self._boot - REBOOT:
                self._boot, self._heard = t, record.time
            return t
        if name == "SERVO_OUTPUT_RAW" and math.isfinite(self._boot) and m.time_usec:
            return _nearest((m.time_usec % 2**32) * 1e-6, self._boot, WRAP_US)
        return self._mapped(record) if math.isfinite(self._boot) else -math.inf

    def _heartbeat(self, t: float, m: Message) -> None:
        tape = self._tape
        tape.firmware = firmware_for(m.autopilot, m.type)
        what = tape.firmware.name if tape.firmware else f"an autopilot of type {m.type}"
        tape.vehicle = f"{what} (system {self.vehicle[0]})"
        armed = bool(m.base_mode & ARMED)
        if not tape.arming or tape.arming[-1][1] != armed:
            tape.arming.append((t, armed))
        if not tape.modes or tape.modes[-1][1] != m.custom_mode:
            tape.modes.append((t, int(m.custom_mode)))


def _nearest(t: float, now: float, period: float) -> float:
    """Add the turns of a counter that bring it nearest to *now*; a restart near zero after less than a turn stays."""
    if math.isnan(now):
        return t
    turned = t + period * round((now - t) / period)
    return turned if abs(turned - now) < min(0.25 * period, 3600.0) else t


_BOOT_MS = {
    "ATTITUDE",
    "LOCAL_POSITION_NED",
    "GLOBAL_POSITION_INT",
    "SCALED_PRESSURE2",
    "SCALED_PRESSURE",
    "SYSTEM_TIME",
    "RC_CHANNELS",
}
"""Messages whose ``time_boot_ms`` is the autopilot's own."""


def _attitude(m: Message) -> dict[str, float]:
    names = {"phi": m.roll, "theta": m.pitch, "psi": m.yaw, "p": m.rollspeed, "q": m.pitchspeed, "r": m.yawspeed}
    return {f"attitude.{n}": v for n, v in names.items()}


def _local(m: Message) -> dict[str, float]:
    names = {"x": m.x, "y": m.y, "z": m.z, "vn": m.vx, "ve": m.vy, "w": m.vz}
    return {f"local.{n}": v for n, v in names.items()}


def _global(m: Message) -> dict[str, float]:
    found = {"global.z": -m.relative_alt * 1e-3, "global.w": m.vz * 1e-2}
    if m.lat != 0 or m.lon != 0:
        found |= {"global.lat": m.lat * 1e-7, "global.lon": m.lon * 1e-7}
        found |= {"global.vn": m.vx * 1e-2, "global.ve": m.vy * 1e-2}
    return found


def _servos(m: Message) -> dict[str, float]:
    if m.port != 0:
        return {}
    return {f"servo.{n}": float(getattr(m, f"servo{n}_raw")) for n in range(1, 17)}


def _rc(m: Message) -> dict[str, float]:
    values = {n: float(getattr(m, f"chan{n}_raw")) for n in range(1, 9)}
    return {f"rc.{n}": v for n, v in values.items() if 0.0 < v < 65535.0}


def _sticks(m: Message) -> dict[str, float]:
    """ArduSub's sticks: z runs from 0 to 1000 with 500 in the middle, up positive."""
    return {
        "stick.X": m.x * 1e-3,
        "stick.Y": m.y * 1e-3,
        "stick.Z": -(m.z - 500) / 500.0,
        "stick.N": m.r * 1e-3,
    }


def _text(value: str | bytes) -> str:
    text = value.decode("ascii", "replace") if isinstance(value, bytes) else str(value)
    return text.rstrip("\x00")


_SIGNALS: Mapping[str, Callable[[Message], dict[str, float]]] = {
    "ATTITUDE": _attitude,
    "LOCAL_POSITION_NED": _local,
    "GLOBAL_POSITION_INT": _global,
    "SERVO_OUTPUT_RAW": _servos,
    "RC_CHANNELS": _rc,
    "VFR_HUD": lambda m: {"hud.U": m.groundspeed},
    "AHRS2": lambda m: {"ahrs2.z": -m.altitude},
    "SCALED_PRESSURE2": lambda m: {"pressure.z": (m.press_abs - 1013.25) * 100.0 / (1000.0 * 9.80665)},
}
"""Message -> sources on the tape. Degrees, centimetres and hectopascals end here."""
