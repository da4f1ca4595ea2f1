"""Runs Lua scripts on a simulated vehicle: the part of ArduPilot's scripting that the script of ``aboard`` uses.

The very script runs, in Lua 5.3 as on an autopilot (lupa). What it calls is answered from the simulated autopilot. Rows
that it logs are kept as the bytes of a dataflash log.
"""

from __future__ import annotations

import struct
from typing import Any

import pytest

from sitl.vehicle import Vehicle

lupa = pytest.importorskip("lupa.lua53", reason="lupa is not installed")

__all__ = ["LuaHost"]

FOLDER = "APM/scripts/"
RESTART_MS = 1000
"""ArduPilot checks once a second whether scripts must be reloaded."""

PRELUDE = """
local function u32(v)
  return setmetatable({ v = v, toint = function(self) return math.floor(self.v) end },
    { __sub = function(a, b) return u32(a.v - b.v) end })
end
local function vector(x, y, z)
  return { x = function() return x end, y = function() return y end, z = function() return z end }
end
local function pos() if py.has_position() then return vector(py.position()) end end
millis = function() return u32(py.ms()) end
gcs = { send_text = function(_, severity, text) py.say(severity, text) end,
  last_seen = function() return u32(py.last_seen()) end }
remove = function(path) py.remove(path) end
Parameter = function(name) return { get = function() return py.parameter(name) end } end
SRV_Channels = { set_output_pwm_chan_timeout = function(_, c, pwm, ms) py.override(c, pwm, ms) end }
logger = { write = function(_, name, labels, letters, ...) py.log(name, labels, letters, ...) end }
ahrs = { get_yaw = function() return py.yaw() end, get_gyro = function() return vector(py.gyro()) end,
  get_roll = function() return py.roll() end, get_pitch = function() return py.pitch() end,
  get_relative_position_NED_origin = pos,
  get_velocity_NED = function() if py.has_position() then return vector(py.velocity()) end end }
baro = { get_altitude = function() return py.altitude() end }
arming = { is_armed = function() return py.armed() end }
vehicle = { get_mode = function() return py.mode() end }
rc = { has_valid_input = function() return py.rc_ok() end, get_pwm = function(_, c) return py.pwm(c) end }
fence = { get_breaches = function() return py.breaches() end }
battery = { num_instances = function() return 1 end, healthy = function() return true end,
  voltage = function() return py.voltage() end, capacity_remaining_pct = function() return py.charge() end }
"""


class LuaHost:
    """Scripts of one simulated vehicle. It starts as a board does, once SCR_ENABLE is set.

    Attributes
    ----------
    breaches, charge, has_position : what the simulated autopilot reports of fence, battery [%] and position.
    moved : RC channel -> PWM [us] of a stick that a pilot moves.
    log : bytes of the dataflash log. rows : (time [s], name, values) of the rows logged.
    error : text of the last Lua error. is_hung : scripts never run again. lateness [ms] : scripts run that late.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._autopilot = vehicle.autopilot
        self._run: list[tuple[int, Any]] = []
        self._load_at: int | None = None
        self.breaches, self.charge, self.has_position = 0, 90.0, True
        self.moved: dict[int, int] = {}
        self.log = bytearray()
        self.rows: list[tuple[float, str, tuple[float, ...]]] = []
        self.error = ""
        self.is_hung = False
        self.lateness = 0
        self._types: dict[str, tuple[int, str]] = {}
        vehicle.autopilot.scripts = self
        self._format("FMT", "Type,Length,Name,Format,Columns", "BBnNZ")
        self.write("MSG", "TimeUS,Message", "QZ", 0, f"{self._autopilot.firmware} V4.7.0-dev")
        for name, value in vehicle.parameters.values.items():
            self.write("PARM", "TimeUS,Name,Value", "QNf", 0, name, value)

    # --- ScriptHost ---------------------------------------------------------------------------------------

    def restart(self) -> None:
        """Reload all scripts on the card."""
        self._run.clear()
        self._load_at = self._autopilot.ms + RESTART_MS

    def tick(self) -> None:
        """Run the scripts that are due."""
        now = self._autopilot.ms
        if self._load_at is not None and now >= self._load_at:
            self._load_at = None
            for path in sorted(p for p in self._vehicle.card if p.startswith(FOLDER)):
                self.load(self._vehicle.card[path].decode())
        if self.is_hung:
            return
        for k, (due, update) in enumerate(self._run):
            if now >= due + self.lateness:
                self._step(k, update)

    def load(self, text: str) -> None:
        """Load and start one script."""
        lua = lupa.LuaRuntime(unpack_returned_tuples=True, register_eval=False)
        lua.globals().py = self._bindings(lua)
        lua.execute(PRELUDE)
        try:
            update, wait = lua.execute(text)
        except lupa.LuaError as error:
            self._fail(error)
            return
        self._run.append((self._autopilot.ms + int(wait), update))

    def _step(self, k: int, update: Any) -> None:
        try:
            update, wait = update()
        except lupa.LuaError as error:
            del self._run[k]
            self._fail(error)
            return
        self._run[k] = self._autopilot.ms + int(wait), update

    def _fail(self, error: Exception) -> None:
        self.error = str(error)
        self._autopilot.say(2, f"Lua: {error}"[:50])

    def _bindings(self, lua: Any) -> Any:
        autopilot, estimate = self._autopilot, self._autopilot.estimate
        table = {
            "ms": lambda: autopilot.ms,
            "say": autopilot.say,
            "last_seen": lambda: autopilot.last_gcs_ms,
            "remove": lambda path: self._vehicle.card.pop(path, None) and None,
            "parameter": lambda name: autopilot.parameters[name],
            "override": self._override,
            "log": self._write,
            "yaw": lambda: estimate.yaw,
            "roll": lambda: estimate.roll,
            "pitch": lambda: estimate.pitch,
            "gyro": lambda: (estimate.roll_rate, estimate.pitch_rate, estimate.yaw_rate),
            "has_position": lambda: self.has_position,
            "position": lambda: (estimate.x, estimate.y, estimate.z),
            "velocity": lambda: (estimate.vx, estimate.vy, estimate.vz),
            "altitude": lambda: -estimate.z,
            "armed": lambda: autopilot.armed,
            "mode": lambda: autopilot.mode.number,
            "rc_ok": lambda: not autopilot.failsafe,
            "pwm": lambda channel: self.moved.get(channel, autopilot.rc.pwm[channel]),
            "breaches": lambda: self.breaches,
            "voltage": lambda: autopilot.battery.voltage,
            "charge": lambda: self.charge,
        }
        return lua.table_from(table)

    def _override(self, channel: int, pwm: int, ms: int) -> None:
        self._autopilot.rail.override(channel, pwm, max(1, round(ms * 1e-3 / self._autopilot.dt)))

    # --- the log ------------------------------------------------------------------------------------------

    def _format(self, name: str, labels: str, letters: str) -> None:
        number = 128 + len(self._types)
        size = 3 + sum(_SIZE[letter] for letter in letters)
        self._types[name] = number, letters
        row = struct.pack("<BB4s16s64s", number, size, name.encode(), letters.encode(), labels.encode())
        self.log += b"\xa3\x95\x80" + row

    def write(self, name: str, labels: str, letters: str, *values: Any) -> None:
        """Write a row of the autopilot's own."""
        if name not in self._types:
            self._format(name, labels, letters)
        codes = "<" + "".join(_CODE[letter] for letter in letters)
        packed = [v.encode() if isinstance(v, str) else int(v) if _CODE[c] in "QBhi" else v
                  for c, v in zip(letters, values, strict=True)]  # fmt: skip
        self.log += b"\xa3\x95" + bytes([self._types[name][0]]) + struct.pack(codes, *packed)

    def _write(self, name: str, labels: str, letters: str, *values: Any) -> None:
        self.rows.append((self._autopilot.ms * 1e-3, name, values))
        assert len(labels) <= 58
        self.write(name, f"TimeUS,{labels}", f"Q{letters}", self._autopilot.ms * 1000, *values)


_CODE = {"Q": "Q", "B": "B", "h": "h", "i": "i", "f": "f", "n": "4s", "N": "16s", "Z": "64s"}
_SIZE = {letter: struct.calcsize(f"<{code}") for letter, code in _CODE.items()}
