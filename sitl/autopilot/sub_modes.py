"""Sub's flight modes (STABILIZE, ALT_HOLD, GUIDED, MANUAL), and its pilot-input and ground-station failsafes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Protocol

from sitl.autopilot.mode import Mode
from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.rc_input import RcInput

if TYPE_CHECKING:
    from sitl.autopilot.sub import Sub

__all__ = ["SubFailsafe", "make_sub_modes"]

_PERIOD_MS = 300
"""The firmware looks about three times a second: a time-out of 3 s acts between 3.0 and 3.3 s."""
_NEUTRAL_PWM = 1500
_CRITICAL = 2
_WARN, _DISARM, _HOLD_DEPTH = 1, 2, 3
_ALT_HOLD = 2


class _Owner(Protocol):
    ms: int
    last_gcs_ms: int
    rc: RcInput
    armed: bool

    def say(self, severity: int, text: str) -> None: ...

    def set_mode(self, number: int) -> bool: ...

    def disarm(self) -> bool: ...


class SubFailsafe:
    """Acts once per loss. FS_PILOT_INPUT 2 disarms; FS_GCS_ENABLE 2 disarms, 3 and 4 hold the depth.

    (Action 4, surfacing, is not simulated; the depth is held instead.)
    """

    def __init__(self, parameters: ParameterStore, owner: _Owner) -> None:
        self._values = parameters.values
        self._owner = owner
        self.last_pilot_ms = 0
        self.pilot_lost = False
        self.gcs_lost = False

    def update(self) -> None:
        """Look, three times a second."""
        if self._owner.ms % _PERIOD_MS == 0:
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
            owner.say(_CRITICAL, "Lost manual control")
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
            owner.say(_CRITICAL, "MYGCS: heartbeat lost")
            if action == _DISARM:
                owner.disarm()
            elif action > _WARN and owner.armed:
                owner.set_mode(_ALT_HOLD)
        self.gcs_lost = lost


_MANUAL_INPUT, _STABILIZE, _GUIDED = 64, 16, 8


class _SubMode(Mode):
    def __init__(self, sub: Sub) -> None:
        self.sub = sub

    def enter(self) -> None:
        """Hold heading and depth where they are."""
        self.sub.reset_loops()


class SubManualMode(_SubMode):
    """Sticks straight to the motors."""

    number, name, flags = 19, "MANUAL", _MANUAL_INPUT

    def run(self) -> None:
        """Pass the sticks on."""
        self.sub.pass_yaw_stick()
        self.sub.pass_throttle_stick()
        self.sub.pass_horizontal_sticks()


class StabilizeMode(_SubMode):
    """Heading is held, throttle is the stick's."""

    number, name, flags = 0, "STABILIZE", _MANUAL_INPUT | _STABILIZE

    def run(self) -> None:
        """Run the yaw loop."""
        self.sub.steer()
        self.sub.pass_throttle_stick()
        self.sub.pass_horizontal_sticks()


class AltHoldMode(_SubMode):
    """Heading and depth are held."""

    number, name, flags = 2, "ALT_HOLD", _MANUAL_INPUT | _STABILIZE

    def run(self) -> None:
        """Run the yaw and depth loops."""
        self.sub.steer()
        self.sub.hold_depth()
        self.sub.pass_horizontal_sticks()


class SubGuidedMode(_SubMode):
    """Heading and depth follow targets from the ground; no horizontal thrust (position is not simulated)."""

    number, name, flags = 4, "GUIDED", _STABILIZE | _GUIDED
    needs_position = True

    def run(self) -> None:
        """Run the yaw and depth loops; yaw and throttle sticks still count, the horizontal ones do not."""
        self.sub.steer()
        self.sub.hold_depth()
        self.sub.motors.forward = self.sub.motors.lateral = 0.0


def make_sub_modes(sub: Sub) -> Mapping[int, Mode]:
    """Return Sub's modes by number."""
    modes: tuple[Mode, ...] = (SubManualMode(sub), StabilizeMode(sub), AltHoldMode(sub), SubGuidedMode(sub))
    return {mode.number: mode for mode in modes}
