"""Sub's flight modes: STABILIZE, ALT_HOLD, GUIDED, MANUAL."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from sitl.autopilot.mode import Mode

if TYPE_CHECKING:
    from sitl.autopilot.sub import Sub

__all__ = ["make_sub_modes"]

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
