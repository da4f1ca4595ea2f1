"""A small scripted vehicle for the link tests: no physics to speak of, every rule of the protocol on a switch.

It is a ``Peer``: bytes in by ``receive``, time by ``advance_to``. A test replaces the parts that should misbehave:
``on[NAME]`` is called instead of the built-in answer, ``mute`` silences, ``edit`` changes what is sent,
``asked_for`` decides which message numbers are sent on a single request.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

BOAT, ROV = 11, 12
TICK = 0.02

RC = {"MIN": 1000, "TRIM": 1500, "MAX": 2000, "DZ": 30, "REVERSED": 0}
SUB_RC = {"MIN": 1100, "TRIM": 1500, "MAX": 1900, "DZ": 40, "REVERSED": 0}
SERVO = {"FUNCTION": 0, "MIN": 1000, "TRIM": 1500, "MAX": 2000, "REVERSED": 0}


def boat_parameters() -> dict[str, float]:
    parameters: dict[str, float] = {
        "MAV_GCS_SYSID": 255,
        "RC_OVERRIDE_TIME": 3,
        "WP_SPEED": 2.0,
        "ATC_STR_RAT_P": 0.2,
    }
    parameters |= {"ATC_STR_RAT_I": 0.1, "ATC_STR_RAT_FF": 0.75, "CRUISE_THROTTLE": 30}
    parameters |= {"RCMAP_ROLL": 1, "RCMAP_THROTTLE": 3, "RC_OPTIONS": 32, "SCHED_LOOP_RATE": 50, "INS_GYRO_FILTER": 0}
    parameters |= {"FS_THR_ENABLE": 1, "RC_FS_TIMEOUT": 0.5, "FS_TIMEOUT": 1.5, "FS_ACTION": 2}
    parameters |= {"FS_GCS_ENABLE": 0, "FS_GCS_TIMEOUT": 5}
    for n in range(1, 9):
        parameters |= {f"RC{n}_{key}": value for key, value in RC.items()}
        parameters |= {f"SERVO{n}_{key}": value for key, value in SERVO.items()}
    return parameters | {"SERVO1_FUNCTION": 26, "SERVO3_FUNCTION": 70}


def rov_parameters() -> dict[str, float]:
    parameters: dict[str, float] = {"SYSID_MYGCS": 255, "RC_OVERRIDE_TIME": 3, "FRAME_CONFIG": 4, "PSC_POSZ_P": 3}
    maps = {"PITCH": 1, "ROLL": 2, "THROTTLE": 3, "YAW": 4, "FORWARD": 5, "LATERAL": 6}
    parameters |= {f"RCMAP_{name}": channel for name, channel in maps.items()}
    parameters |= {"FS_PILOT_INPUT": 2, "FS_PILOT_TIMEOUT": 3, "FS_GCS_ENABLE": 2, "FS_GCS_TIMEOUT": 5}
    parameters |= {"RC_OPTIONS": 0, "SCHED_LOOP_RATE": 400, "INS_GYRO_FILTER": 0}
    for n in range(1, 9):
        parameters |= {f"RC{n}_{key}": value for key, value in SUB_RC.items()}
        parameters[f"SERVO{n}_FUNCTION"] = 32 + n
        parameters[f"MOT_{n}_DIRECTION"] = 1
    return parameters


class ScriptedVehicle:
    def __init__(self, kind: int = BOAT, *, system: int = 1, component: int = 1) -> None:
        self.kind = kind
        self.mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self.mav.robust_parsing = True
        self.parameters = boat_parameters() if kind == BOAT else rov_parameters()
        self.whole_numbers = {"CRUISE_THROTTLE"}
        self.read_only: set[str] = set()
        self.intervals: dict[int, float] = {}
        self.fastest = 40.0
        self.mode = 0 if kind == BOAT else 19
        self.armed = False
        self.arming_refusals: list[str] = []
        self.needs_overrides_to_arm = False
        self.refused_modes: dict[int, str] = {}
        self.mute: set[str] = set()
        self.on: dict[str, Callable[[Any], None]] = {}
        self.edit: Callable[[Any], Any] = lambda message: message
        self.asked_for: Callable[[int], bool] = lambda number: True
        self.heard: list[Any] = []
        self.alive = True
        self.overrides: dict[int, tuple[int, float]] = {}
        self.receiver: dict[int, int] | None = dict.fromkeys(range(1, 9), 1500)
        self.rc = [1500] * 19
        self.servos = [1500] * 8
        self.psi, self.r, self.z = 3.0, 0.0, 0.0
        self.turn_rate, self.lag = 0.5, 0.0
        self.boot_offset = 0.0
        self.tick = 0
        self._out = bytearray()
        self._due: dict[str, float] = {}

    # --- Peer -----------------------------------------------------------------------------------------

    def receive(self, data: bytes) -> None:
        if not self.alive:
            return
        for message in self.mav.parse_buffer(data) or []:
            self.heard.append(message)
            name = message.get_type()
            handler = self.on.get(name, getattr(self, f"_on_{name.lower()}", None))
            if handler:
                handler(message)

    def advance_to(self, t: float) -> bytes:
        while (self.tick + 1) * TICK <= t + 1e-9:
            self.tick += 1
            if self.alive:
                self._step()
        out, self._out = bytes(self._out), bytearray()
        return out

    # --- helpers for tests ----------------------------------------------------------------------------

    @property
    def time(self) -> float:
        return self.tick * TICK

    def say(self, text: str, severity: int = 4) -> None:
        self.send(mavlink.MAVLink_statustext_message(severity, text.encode()))

    def send(self, message: Any) -> None:
        if message.get_type() in self.mute or not self.alive:
            return
        edited = self.edit(message)
        if edited is not None:
            self._out += edited.pack(self.mav)
            self.mav.seq = (self.mav.seq + 1) % 256

    def send_as(self, system: int, component: int, message: Any) -> None:
        self._out += message.pack(mavlink.MAVLink(None, srcSystem=system, srcComponent=component))

    def count(self, name: str) -> int:
        return sum(m.get_type() == name for m in self.heard)

    def last(self, name: str) -> Any:
        return next(m for m in reversed(self.heard) if m.get_type() == name)

    def send_parameter(self, name: str, index: int = 65535) -> None:
        value = float(self.parameters[name])
        self.send(mavlink.MAVLink_param_value_message(name.encode(), value, 9, len(self.parameters), index))

    # --- motion and telemetry -------------------------------------------------------------------------

    def _step(self) -> None:
        yaw = (self.servos[0] - 1500) / 500 if self.kind == BOAT else (self.servos[1] - self.servos[0]) / 800
        self._turn(self.turn_rate * yaw)
        self._actuate()
        if self._is_due("HEARTBEAT", 1.0):
            self.heartbeat()
        for name, make in self._makers().items():
            interval = self.intervals.get(getattr(mavlink, f"MAVLINK_MSG_ID_{name}"))
            if interval and self._is_due(name, interval):
                self.send(make())

    def _makers(self) -> dict[str, Callable[[], Any]]:
        ms = round((self.time + self.boot_offset) * 1000)
        return {
            "ATTITUDE": lambda: mavlink.MAVLink_attitude_message(
                ms, 1e-3 * math.sin(self.time), 0.0, math.remainder(self.psi, math.tau), 0.0, 0.0, self.r
            ),
            "SERVO_OUTPUT_RAW": lambda: mavlink.MAVLink_servo_output_raw_message(ms * 1000 % 2**32, 0, *self.servos),
            "GLOBAL_POSITION_INT": lambda: mavlink.MAVLink_global_position_int_message(
                ms, 0, 0, 0, round(-self.z * 1000), 0, 0, 0, 0
            ),
            "RC_CHANNELS": lambda: mavlink.MAVLink_rc_channels_message(ms, len(self.receiver or ()), *self.rc[1:], 255),
            "VFR_HUD": lambda: mavlink.MAVLink_vfr_hud_message(0.0, 1.25, 0, 0, 0.0, 0.0),
            "SYS_STATUS": lambda: mavlink.MAVLink_sys_status_message(
                0, 0x10000000, 0x10000000, 0, 12600, 0, 87, 0, 0, 0, 0, 0, 0
            ),
        }

    def heartbeat(self) -> None:
        base = 1 | (128 if self.armed else 0)
        self.send(mavlink.MAVLink_heartbeat_message(self.kind, 3, base, self.mode, 4, 3))

    def _is_due(self, name: str, interval: float) -> bool:
        if self.time + 1e-9 < self._due.get(name, 0.0):
            return False
        self._due[name] = (math.floor(self.time / interval + 1e-6) + 1) * interval
        return True

    def _turn(self, steady: float) -> None:
        """First order with time constant ``lag`` [s], exactly; none is none."""
        left = math.exp(-TICK / self.lag) if self.lag else 0.0
        self.psi += steady * TICK + (self.r - steady) * self.lag * (1.0 - left)
        self.r = steady + (self.r - steady) * left

    def _actuate(self) -> None:
        expiry = self.parameters["RC_OVERRIDE_TIME"]
        fresh = {n: pwm for n, (pwm, at) in self.overrides.items() if self.time - at < expiry}
        for n in range(1, 19):
            self.rc[n] = fresh.get(n, (self.receiver or {}).get(n, self.rc[n]))
        if not self.armed:
            fresh = {}
        if self.kind == BOAT:
            for channel in (1, 3):
                stick = fresh.get(channel, 1500) - 1500
                free = max(abs(stick) - 30, 0) / 470
                self.servos[channel - 1] = round(1500 + math.copysign(500 * free, stick))
        else:
            x, n, up = (fresh.get(c, 1500) - 1500 for c in (5, 4, 3))
            self.servos[:3] = [1500 + x - n, 1500 + x + n, 1500 - up]

    # --- protocol -------------------------------------------------------------------------------------

    def _on_rc_channels_override(self, m: Any) -> None:
        if m.get_srcSystem() != self.parameters.get("MAV_GCS_SYSID", self.parameters.get("SYSID_MYGCS", 255)):
            return
        for n in range(1, 9):
            pwm = getattr(m, f"chan{n}_raw")
            if pwm == 0:
                self.overrides.pop(n, None)
            elif pwm != 65535:
                self.overrides[n] = (pwm, self.time)

    def _on_timesync(self, m: Any) -> None:
        if not m.tc1:
            self.send(mavlink.MAVLink_timesync_message(round(self.time * 1e9), m.ts1))

    def _on_param_request_read(self, m: Any) -> None:
        names = list(self.parameters)
        if m.param_index >= 0:
            self.send_parameter(names[m.param_index], m.param_index)
        elif m.param_id in self.parameters:
            self.send_parameter(m.param_id)

    def _on_param_request_list(self, m: Any) -> None:
        for index, name in enumerate(self.parameters):
            self.send_parameter(name, index)

    def _on_param_set(self, m: Any) -> None:
        if m.param_id not in self.parameters:
            return
        if m.param_id in self.read_only:
            self.say(f"Param write denied ({m.param_id})")
        else:
            value = m.param_value
            self.parameters[m.param_id] = int(value) if m.param_id in self.whole_numbers else value
        self.send_parameter(m.param_id)

    def _on_command_long(self, m: Any) -> None:
        accepted, denied, unsupported, failed = 0, 2, 3, 4
        match m.command:
            case mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
                too_fast = 0 < m.param2 < 1e6 / self.fastest
                if not too_fast:
                    self.intervals[int(m.param1)] = m.param2 * 1e-6
                self.acknowledge(m, denied if too_fast else accepted)
            case mavlink.MAV_CMD_GET_MESSAGE_INTERVAL:
                interval = self.intervals.get(int(m.param1), 0.25)
                self.acknowledge(m, accepted)
                self.send(mavlink.MAVLink_message_interval_message(int(m.param1), round(interval * 1e6)))
            case mavlink.MAV_CMD_REQUEST_MESSAGE:
                self.acknowledge(m, accepted)
                self._send_once(int(m.param1))
            case mavlink.MAV_CMD_DO_SET_MODE:
                number = int(m.param2)
                if number in self.refused_modes:
                    self.acknowledge(m, failed)
                    self.say(self.refused_modes[number])
                else:
                    self.mode = number
                    self.acknowledge(m, accepted)
            case mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
                self._arm(m)
            case _:
                self.acknowledge(m, unsupported)

    def _send_once(self, number: int) -> None:
        if not self.asked_for(number):
            return
        version = 4 << 24 | 7 << 16 | 0 << 8
        if number == mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION:
            self.send(
                mavlink.MAVLink_autopilot_version_message(0, version, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 0)
            )
        if number == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            self.heartbeat()
        if number == mavlink.MAVLINK_MSG_ID_SYSTEM_TIME:
            ms = round((self.time + self.boot_offset) * 1000)
            self.send(mavlink.MAVLink_system_time_message(0, max(ms, 0)))
        for name, make in self._makers().items():
            if number == getattr(mavlink, f"MAVLINK_MSG_ID_{name}"):
                self.send(make())

    def _arm(self, m: Any) -> None:
        reasons = list(self.arming_refusals)
        if self.needs_overrides_to_arm and not self.overrides:
            reasons.append("PreArm: Radio failsafe on")
        if m.param1 == 1 and reasons:
            self.acknowledge(m, 4)
            for reason in reasons:
                self.say(reason, 2)
        else:
            self.armed = m.param1 == 1
            self.acknowledge(m, 0)

    def acknowledge(self, m: Any, result: int) -> None:
        self.send(mavlink.MAVLink_command_ack_message(m.command, result, 0, 0, m.get_srcSystem(), 0))
