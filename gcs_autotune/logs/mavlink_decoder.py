"""Convert MAVLink messages of a ground station's log to samples of one vehicle, by its own clock, in one pass over the
log.

A vehicle reports its time in two ways: ``time_boot_ms`` and, in SERVO_OUTPUT_RAW and GPS_RAW_INT, ``time_usec`` since
the same boot, which wraps after 71 minutes. Both are converted to one axis. A message without a timestamp gets a time
from its arrival, counted from the last message with a timestamp.

One table contains the sources of each message, in SI; degrees, centimetres and hectopascals are converted here.
SIMSTATE and SIM_STATE are not in it, because real craft do not measure them.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

from gcs_autotune.errors import BadFile, UsageError
from gcs_autotune.firmware import firmware_for
from gcs_autotune.logs.sample_store import Census, Heard, Note, SampleStore

__all__ = ["BOOT_MS", "BOOT_US", "SIGNALS", "TRUTH", "DecodedLog", "decode_messages", "sticks"]

Message: TypeAlias = Any

BOOT_MS = frozenset(
    {
        "ATTITUDE",
        "LOCAL_POSITION_NED",
        "GLOBAL_POSITION_INT",
        "SCALED_PRESSURE2",
        "SCALED_PRESSURE",
        "SYSTEM_TIME",
        "RC_CHANNELS",
    }
)
"""Names of the messages whose ``time_boot_ms`` is the autopilot's own time."""
BOOT_US = frozenset({"SERVO_OUTPUT_RAW", "GPS_RAW_INT", "RAW_IMU"})
"""Names of the messages whose ``time_usec`` ArduPilot also counts from its boot (in SERVO_OUTPUT_RAW only 32
bits of it).
"""
TRUTH = frozenset({"SIMSTATE", "SIM_STATE", "SIM", "SIM2"})
"""Names of the messages with a simulator's true state. They are listed but never used."""

NO_PULSE = 0.0
"""Value of outputs 9 to 16 [us] in a message of MAVLink 1, which does not contain these outputs."""
FIX_3D = 3
UNKNOWN = 65535
MILLI_G = 9.80665e-3
"""Unit of acceleration [m/s^2] in ArduPilot's RAW_IMU. Turn rates are in mrad/s, the magnetic field in mgauss."""


def _attitude(m: Message) -> dict[str, float]:
    return {
        "attitude.phi": m.roll,
        "attitude.theta": m.pitch,
        "attitude.psi": m.yaw,
        "attitude.p": m.rollspeed,
        "attitude.q": m.pitchspeed,
        "attitude.r": m.yawspeed,
    }


def _ahrs2(m: Message) -> dict[str, float]:
    return {"ahrs2.phi": m.roll, "ahrs2.theta": m.pitch, "ahrs2.psi": m.yaw, "ahrs2.z": -m.altitude}


def _local(m: Message) -> dict[str, float]:
    return {"local.x": m.x, "local.y": m.y, "local.z": m.z, "local.vn": m.vx, "local.ve": m.vy, "local.w": m.vz}


def _global(m: Message) -> dict[str, float]:
    found = {"global.z": -m.relative_alt * 1e-3, "global.w": m.vz * 1e-2}
    if m.lat != 0 or m.lon != 0:
        found |= {"global.lat": m.lat * 1e-7, "global.lon": m.lon * 1e-7}
        found |= {"global.vn": m.vx * 1e-2, "global.ve": m.vy * 1e-2}
    return found


def _gps(m: Message) -> dict[str, float]:
    if m.fix_type < FIX_3D or UNKNOWN in (m.vel, m.cog):
        return {}
    speed, course = m.vel * 1e-2, math.radians(m.cog * 1e-2)
    return {
        "gps.lat": m.lat * 1e-7,
        "gps.lon": m.lon * 1e-7,
        "gps.U": speed,
        "gps.vn": speed * math.cos(course),
        "gps.ve": speed * math.sin(course),
    }


def _servos(m: Message) -> dict[str, float]:
    if m.port != 0:
        return {}
    found = {f"servo.{n}": float(getattr(m, f"servo{n}_raw")) for n in range(1, 9)}
    return found | {f"servo.{n}": float(getattr(m, f"servo{n}_raw", NO_PULSE)) for n in range(9, 17)}


def _imu(m: Message) -> dict[str, float]:
    found = {"imu.p": m.xgyro * 1e-3, "imu.q": m.ygyro * 1e-3, "imu.r": m.zgyro * 1e-3}
    found |= {"imu.ax": m.xacc * MILLI_G, "imu.ay": m.yacc * MILLI_G, "imu.az": m.zacc * MILLI_G}
    if (m.xmag, m.ymag, m.zmag) != (0, 0, 0):
        found |= {"compass.mx": float(m.xmag), "compass.my": float(m.ymag), "compass.mz": float(m.zmag)}
    return found


def _rc(m: Message) -> dict[str, float]:
    values = {n: float(getattr(m, f"chan{n}_raw")) for n in range(1, 9)}
    return {f"rc.{n}": v for n, v in values.items() if 0.0 < v < UNKNOWN}


def sticks(m: Message) -> dict[str, float]:
    """Return ArduSub's stick positions (-1 to 1) in a MANUAL_CONTROL message, as sources of the store. z runs from 0 to
    1000 with 500 in the middle, positive up.
    """
    return {
        "stick.X": m.x * 1e-3,
        "stick.Y": m.y * 1e-3,
        "stick.Z": -(m.z - 500) / 500.0,
        "stick.N": m.r * 1e-3,
    }


def _esc(first: int, rpm: Iterable[float]) -> dict[str, float]:
    """Return the speeds [1/s] of ESCs whose numbers begin with *first*."""
    return {f"esc.{first + k}": value / 60.0 for k, value in enumerate(rpm)}


SIGNALS: Mapping[str, Callable[[Message], dict[str, float]]] = {
    "ATTITUDE": _attitude,
    "LOCAL_POSITION_NED": _local,
    "GLOBAL_POSITION_INT": _global,
    "GPS_RAW_INT": _gps,
    "SERVO_OUTPUT_RAW": _servos,
    "RAW_IMU": _imu,
    "RC_CHANNELS": _rc,
    "VFR_HUD": lambda m: {"hud.U": m.groundspeed},
    "AHRS2": _ahrs2,
    "ESC_TELEMETRY_1_TO_4": lambda m: _esc(1, m.rpm),
    "ESC_TELEMETRY_5_TO_8": lambda m: _esc(5, m.rpm),
    "RPM": lambda m: {"rpm.1": m.rpm1 / 60.0, "rpm.2": m.rpm2 / 60.0},
    "SCALED_PRESSURE2": lambda m: {"pressure.z": (m.press_abs - 1013.25) * 100.0 / (1000.0 * 9.80665)},
}
"""Message -> function that returns its sources in the store."""

Vehicle = tuple[int, int]
"""MAVLink system and component id of a vehicle."""

ARMED = 128
"""Value of MAV_MODE_FLAG_SAFETY_ARMED."""
NO_AUTOPILOT = 8
"""Value of MAV_AUTOPILOT_INVALID, in the heartbeat of a ground station, camera or companion computer."""
REBOOT = 5.0
"""Step back of the boot clock [s] above which a new boot is assumed.

A smaller step is a late message. Project choice.
"""
ARMING_TEXTS = {"throttle armed": True, "throttle disarmed": False, "arming motors": True, "disarming motors": False}
"""Status texts of ArduRover and ArduSub -> armed state."""
WRAP_US = 2**32 * 1e-6
WRAP_MS = 2**32 * 1e-3


@dataclass(frozen=True, slots=True)
class DecodedLog:
    """The decoded messages of one vehicle. ``misfits`` counts messages with unexpected fields."""

    vehicle: Vehicle
    stores: list[SampleStore]
    census: Census
    notes: list[Note]
    messages: int
    misfits: int


def decode_messages(path: Path, heard: Iterable[Heard], system: int | None) -> DecodedLog:
    """Write the vehicle's messages into sample stores.

    Parameters
    ----------
    system : the vehicle's system id, if the log contains several; None: the one with most messages.

    Raises
    ------
    BadFile
        The log contains no message, or none of a vehicle.
    UsageError
        The log contains no vehicle of that *system*.
    """
    scribes: dict[Vehicle, _Decoder] = {}
    known: Counter[Vehicle] = Counter()
    others: Counter[Vehicle] = Counter()
    messages = misfits = 0
    for h in heard:
        messages += 1
        who = (h.system, h.component)
        decoder = scribes.get(who)
        if decoder is None:
            decoder = scribes[who] = _Decoder(path.stem, who)
        try:
            decoder.hear(h)
            if h.name == "HEARTBEAT" and h.message.autopilot != NO_AUTOPILOT:
                is_known = firmware_for(h.message.autopilot, h.message.type) is not None
                (known if is_known else others)[who] += 1
            elif h.name == "MANUAL_CONTROL":
                flown = (d for d in scribes.values() if h.message.target in (0, d.vehicle[0]))
                for other in flown:
                    if other is not decoder:
                        other.read_sticks(h)
        except (AttributeError, TypeError, ValueError, OverflowError):
            misfits += 1  # a damaged line of a CSV file; a frame with a checksum has its fields
    if not messages:
        raise BadFile(f"{path} contains no MAVLink message. It is not a telemetry log, or it is damaged")
    vehicles = known or others
    if not vehicles:
        raise BadFile(
            f"{path} contains {messages} messages but no autopilot's HEARTBEAT. Record again while the vehicle is "
            f"connected"
        )
    chosen = _chosen(path, vehicles, system)
    notes: list[Note] = []
    also = sorted({s for s, _ in vehicles} - {chosen[0]})
    if also and system is None:
        notes.append(
            (
                "several-vehicles",
                f"the log contains vehicles {', '.join(map(str, [chosen[0], *also]))}. Only vehicle {chosen[0]} was "
                "read",
                "select another vehicle with --system-id",
            )
        )
    decoder = scribes[chosen]
    stores = decoder.stores()
    return DecodedLog(chosen, stores, decoder.census, notes, messages, misfits)


def _chosen(path: Path, vehicles: Counter[Vehicle], system: int | None) -> Vehicle:
    if system is None:
        return vehicles.most_common(1)[0][0]
    mine = [who for who, _ in vehicles.most_common() if who[0] == system]
    if not mine:
        heard = ", ".join(str(s) for s, _ in vehicles)
        raise UsageError(f"{path} contains no vehicle with system id {system}. It contains {heard}")
    return mine[0]


@dataclass
class _Decoder:
    """Writes one sender's messages into sample stores, a new one after each boot.

    Until the first boot stamp, everything is also written with the ground station's clock, in case there is no boot
    stamp.
    """

    name: str
    vehicle: Vehicle
    census: Census = field(default_factory=Census)
    _heard_at: Census = field(default_factory=Census)
    _parameters: dict[str, float] = field(default_factory=dict)
    _stores: list[SampleStore] = field(default_factory=list)
    _ground: SampleStore | None = None
    _boot: float = math.nan
    _heard: float = math.nan
    _now: float = -math.inf
    _before: float = 0.0

    def __post_init__(self) -> None:
        self._stores = [SampleStore(self.name, "vehicle (time_boot_ms)")]
        self._ground = SampleStore(self.name, "ground station")

    def hear(self, h: Heard) -> None:
        """Process one message of the vehicle."""
        t = self._stamp(h)
        self.census.count(h.name, t + self._before)
        if h.name == "PARAM_VALUE":
            self._parameters[_text(h.message.param_id)] = float(h.message.param_value)
            return
        if self._ground is not None:
            self._heard_at.count(h.name, h.time)
            self._write(self._ground, h.time, h)
        if math.isfinite(t) or h.name in ("HEARTBEAT", "STATUSTEXT"):
            self._write(self._stores[-1], t, h)

    def read_sticks(self, h: Heard) -> None:
        """Process the stick commands that a ground station sent to the vehicle."""
        if math.isfinite(self._boot):
            self._stores[-1].take(self._mapped(h.time), sticks(h.message))
            self._stores[-1].dated_by_arrival.add("stick")
        elif self._ground is not None:
            self._ground.take(h.time, sticks(h.message))

    def stores(self) -> list[SampleStore]:
        """Return the stores written, one per boot. Times are the vehicle's own if it reported any, else the ground
        station's.
        """
        found = self._stores
        if self._ground is not None:
            found, self.census = [self._ground], self._heard_at
        for store in found:
            store.parameters = dict(self._parameters)
        return [t for t in found if t.span != (0.0, 0.0)] or found[:1]

    def _write(self, store: SampleStore, t: float, h: Heard) -> None:
        if h.name == "HEARTBEAT":
            _beat(store, t, h.message, self.vehicle[0])
        elif h.name == "STATUSTEXT":
            _take_status_text(store, t, _text(h.message.text))
        elif h.name in SIGNALS:
            values = SIGNALS[h.name](h.message)
            store.take(t, values)
            if h.name not in BOOT_MS and h.name not in BOOT_US:
                store.dated_by_arrival.update(source.partition(".")[0] for source in values)

    def _stamp(self, h: Heard) -> float:
        if h.name in BOOT_MS:
            return self._booted(h)
        if math.isnan(self._boot):
            return -math.inf
        if h.name in BOOT_US and h.message.time_usec:
            t = _nearest((h.message.time_usec % 2**32) * 1e-6, self._boot, WRAP_US)
            if h.name == "SERVO_OUTPUT_RAW" or abs(t - self._boot) < REBOOT:
                return t
        return self._mapped(h.time)

    def _booted(self, h: Heard) -> float:
        t = _nearest(h.message.time_boot_ms * 1e-3, self._boot, WRAP_MS)
        self._ground = None
        if t < self._boot - REBOOT:
            old = self._stores[-1]
            self._before += old.span[1]
            self._now = t
            self._stores.append(SampleStore(self.name, old.clock, old.vehicle, old.firmware))
            self._boot, self._heard = t, h.time
        elif not t < self._boot:
            self._boot, self._heard = t, h.time
        return t

    def _mapped(self, ground: float) -> float:
        """Return the vehicle's time at the ground station's stamp, from the last message with both."""
        self._now = max(self._now, self._boot + max(0.0, ground - self._heard))
        return self._now


def _beat(store: SampleStore, t: float, m: Any, system: int) -> None:
    store.firmware = firmware_for(m.autopilot, m.type)
    what = store.firmware.name if store.firmware else f"an autopilot of type {m.type}"
    store.vehicle = f"{what} (system {system})"
    armed = bool(m.base_mode & ARMED)
    if not store.arming or store.arming[-1][1] != armed:
        store.arming.append((t, armed))
    if not store.modes or store.modes[-1][1] != m.custom_mode:
        store.modes.append((t, int(m.custom_mode)))


def _take_status_text(store: SampleStore, t: float, text: str) -> None:
    """Process a status text. It reports arming up to a second before the next HEARTBEAT."""
    store.texts.append((t, text))
    armed = ARMING_TEXTS.get(text.lower())
    if armed is not None and math.isfinite(t) and store.arming and store.arming[-1][1] != armed:
        store.arming.append((t, armed))


def _nearest(t: float, now: float, period: float) -> float:
    """Add the wraps of a counter that bring it nearest to *now*. A restart near zero before the first wrap is kept."""
    if math.isnan(now):
        return t
    turned = t + period * round((now - t) / period)
    return turned if abs(turned - now) < min(0.25 * period, 3600.0) else t


def _text(value: str | bytes) -> str:
    text = value.decode("ascii", "replace") if isinstance(value, bytes) else str(value)
    return text.rstrip("\x00")
