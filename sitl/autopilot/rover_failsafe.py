"""Rover's radio and ground-station failsafes: one trigger shared by both, as in the firmware.

The shared trigger is why a lost ground station is announced as "Radio Failsafe": the radio check runs more often
and is the first to find the time-out over, whatever started it.
"""

from __future__ import annotations

from typing import Protocol

from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.rc_input import RcInput

__all__ = ["RoverFailsafe"]

_RADIO, _GCS = 1, 2
_GCS_PERIOD_MS = 100
_WARNING, _INFO = 4, 6
_ACTIVE_IN_HOLD = 1
_HOLD_MODE = 4
_ACTION_NONE, _ACTION_TERMINATE = 0, 5


class _Owner(Protocol):
    ms: int
    last_gcs_ms: int
    rc: RcInput

    @property
    def mode_number(self) -> int: ...

    def say(self, severity: int, text: str) -> None: ...

    def set_mode(self, number: int) -> bool: ...

    def disarm(self) -> bool: ...


class RoverFailsafe:
    """``events``: what is wrong now; ``triggered``: what has been acted on. FS_ACTION 5 disarms, others HOLD."""

    def __init__(self, parameters: ParameterStore, owner: _Owner) -> None:
        self._values = parameters.values
        self._owner = owner
        self._last_valid_ms = 0
        self._since_ms = 0
        self.events = 0
        self.triggered = 0

    @property
    def radio_lost(self) -> bool:
        """Whether no usable stick comes in just now."""
        return bool(self.events & _RADIO)

    def update(self, throttle_pwm: int, fresh: bool) -> None:
        """Look once per loop; *fresh*: valid sticks have come in since the last look."""
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
            owner.say(_INFO, f"{name} Failsafe Cleared")
        self.triggered &= self.events
        overdue = owner.ms - self._since_ms > self._values["FS_TIMEOUT"] * 1000.0
        if self.events and not self.triggered and overdue and self._may_act():
            self._act(name)

    def _may_act(self) -> bool:
        return self._owner.mode_number != _HOLD_MODE or bool(int(self._values["FS_OPTIONS"]) & _ACTIVE_IN_HOLD)

    def _act(self, name: str) -> None:
        owner, action = self._owner, int(self._values["FS_ACTION"])
        self.triggered = self.events
        owner.say(_WARNING, f"{name} Failsafe")
        owner.rc.clear_overrides()
        if action == _ACTION_TERMINATE:
            owner.disarm()
        elif action != _ACTION_NONE:
            owner.set_mode(_HOLD_MODE)
