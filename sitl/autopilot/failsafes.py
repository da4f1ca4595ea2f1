"""Actions of the firmwares on the loss of the sticks and of the ground station.

Rover's two failsafes share one trigger, as in the firmware. So a lost ground station is announced as "Radio Failsafe".
The radio check runs more often and is the first to detect the time-out, whatever its cause.
"""

from __future__ import annotations

from sitl.autopilot.autopilot import CRITICAL, INFO, WARNING, Autopilot
from sitl.autopilot.parameters import ParameterStore

__all__ = ["RoverFailsafe", "SubFailsafe", "act_on_failsafe"]

_RADIO, _GCS = 1, 2
_GCS_PERIOD_MS = 100
_ACTIVE_IN_HOLD = 1
_HOLD_MODE = 4
_ACTION_NONE, _ACTION_TERMINATE = 0, 5
_ACTION_RTL, _ACTION_SMART_RTL = 1, 3
_RTL_MODE = 11
_CONTINUE_MISSION = 2
"""FS_THR_ENABLE and FS_GCS_ENABLE: act, but not while the mission is flown."""


def act_on_failsafe(owner: Autopilot, action: int) -> None:
    """Carry out FS_ACTION or BATT_FS_LOW_ACT: 0 nothing, 1 and 3 RTL, 5 disarm, others HOLD; HOLD where RTL cannot be.

    SmartRTL is not simulated: 3 falls back to RTL and 4 to HOLD, as in the firmware without a recorded path.
    """
    if action == _ACTION_TERMINATE:
        owner.disarm()
    elif action in (_ACTION_RTL, _ACTION_SMART_RTL) and owner.set_mode(_RTL_MODE):
        return
    elif action != _ACTION_NONE:
        owner.set_mode(_HOLD_MODE)


class RoverFailsafe:
    """``events``: present faults; ``triggered``: those acted on."""

    def __init__(self, parameters: ParameterStore, owner: Autopilot) -> None:
        self._values = parameters.values
        self._owner = owner
        self._last_valid_ms = 0
        self._since_ms = 0
        self.events = 0
        self.triggered = 0

    @property
    def radio_lost(self) -> bool:
        """Whether the radio failsafe has detected missing stick input or a throttle pulse below FS_THR_VALUE."""
        return bool(self.events & _RADIO)

    def update(self, throttle_pwm: int, fresh: bool) -> None:
        """Check for both faults. Call it once per stick update. *fresh*: valid sticks have arrived since the last
        check.
        """
        owner, values = self._owner, self._values
        if fresh:
            self._last_valid_ms = owner.ms
        if values["FS_THR_ENABLE"]:
            silent = owner.ms - self._last_valid_ms > values["RC_FS_TIMEOUT"] * 1000.0
            self._note(_RADIO, "Radio", silent or throttle_pwm < values["FS_THR_VALUE"])
        if values["FS_GCS_ENABLE"] and owner.last_gcs_ms and owner.ms % _GCS_PERIOD_MS == 0:
            self._note(_GCS, "GCS", owner.ms - owner.last_gcs_ms >= values["FS_GCS_TIMEOUT"] * 1000.0)

    def _note(self, event: int, name: str, present: bool) -> None:
        owner, before = self._owner, self.events
        self.events = before | event if present else before & ~event
        if not before and self.events:
            self._since_ms = owner.ms
        if self.triggered and not self.events:
            owner.say(INFO, f"{name} Failsafe Cleared")
        self.triggered &= self.events
        overdue = owner.ms - self._since_ms > self._values["FS_TIMEOUT"] * 1000.0
        if self.events and not self.triggered and overdue and self._may_act():
            self._act(name)

    def _may_act(self) -> bool:
        mode = self._owner.mode.number
        in_hold = bool(int(self._values["FS_OPTIONS"]) & _ACTIVE_IN_HOLD)
        return mode != _RTL_MODE and (mode != _HOLD_MODE or in_hold)

    def _act(self, name: str) -> None:
        owner = self._owner
        self.triggered = self.events
        owner.say(WARNING, f"{name} Failsafe")
        owner.rc.clear_overrides()
        enabled = self._values["FS_THR_ENABLE" if name == "Radio" else "FS_GCS_ENABLE"]
        if owner.mode.in_mission and enabled == _CONTINUE_MISSION:
            owner.say(WARNING, "Failsafe - Continuing Auto Mode")
        else:
            act_on_failsafe(owner, int(self._values["FS_ACTION"]))


_SUB_PERIOD_MS = 300
"""Period of the firmware's checks [ms]: about three per second, so a time-out of 3 s acts between 3.0 and 3.3 s."""
_NEUTRAL_PWM = 1500
_WARN, _DISARM, _HOLD_DEPTH = 1, 2, 3
_ALT_HOLD = 2


class SubFailsafe:
    """The failsafes of a Sub. Each acts once per loss. FS_PILOT_INPUT 2 disarms; FS_GCS_ENABLE 2 disarms, 3 and 4 hold
    the depth.

    (Action 4, surfacing, is not simulated; the depth is held instead.)
    """

    def __init__(self, parameters: ParameterStore, owner: Autopilot) -> None:
        self._values = parameters.values
        self._owner = owner
        self.last_pilot_ms = 0
        self.pilot_lost = False
        self.gcs_lost = False

    def update(self) -> None:
        """Check for a lost pilot or ground station, every 300 ms."""
        if self._owner.ms % _SUB_PERIOD_MS == 0:
            self._check_pilot()
            self._check_gcs()

    def _check_pilot(self) -> None:
        owner, values = self._owner, self._values
        action = int(values["FS_PILOT_INPUT"])
        if not action or owner.rc.has_receiver:
            self.pilot_lost = False
            return
        lost = owner.ms - self.last_pilot_ms >= values["FS_PILOT_TIMEOUT"] * 1000.0
        if lost and not self.pilot_lost:
            owner.say(CRITICAL, "Lost manual control")
            for channel in range(1, 7):
                owner.rc.override(channel, _NEUTRAL_PWM, owner.ms)
            if action == _DISARM:
                owner.disarm()
        self.pilot_lost = lost

    def _check_gcs(self) -> None:
        owner, values = self._owner, self._values
        action = int(values["FS_GCS_ENABLE"])
        if not action or not owner.last_gcs_ms:
            self.gcs_lost = False
            return
        lost = owner.ms - owner.last_gcs_ms >= values["FS_GCS_TIMEOUT"] * 1000.0
        if lost and not self.gcs_lost:
            owner.say(CRITICAL, "MYGCS: heartbeat lost")
            if action == _DISARM:
                owner.disarm()
            elif action > _WARN and owner.armed:
                owner.set_mode(_ALT_HOLD)
        self.gcs_lost = lost
