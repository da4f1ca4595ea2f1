"""The failsafes for a lost ground station, with the waiting time and the action of each.

Sources: ArduPilot 4.5 to 4.7, ``Rover/failsafe.cpp``, ``Rover/radio.cpp``, ``ArduSub/failsafe.cpp``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

__all__ = ["DISARMS", "Failsafe", "SetFailsafe"]

DISARMS = "disarmed"
"""Outcome of a failsafe that disarms the vehicle instead of changing its mode."""


@dataclass(frozen=True, slots=True)
class SetFailsafe:
    """One failsafe with the settings of a vehicle's parameters.

    ``needs``: silence of the station before it acts [s, vehicle time]; ``outcomes``: modes it may end in, or
    ``DISARMS``; ``says``: content of its STATUSTEXT, in lower case. ``by_overrides``: whether only overrides prevent
    it. With an RC receiver it does not depend on this program.
    """

    name: str
    needs: float
    outcomes: Sequence[str]
    says: str
    by_overrides: bool


@dataclass(frozen=True, slots=True)
class Failsafe:
    """One failsafe of a firmware.

    ``action`` is the parameter that selects the outcome. ``outcomes`` maps its values; a missing value means no action.
    ``enable`` is the parameter that is 0 if the failsafe is off. ``waits`` are the parameters whose sum is its waiting
    time [s]. Each parameter is paired with the value for a firmware without it.
    """

    name: str
    enable: tuple[str, float]
    waits: Sequence[tuple[str, float]]
    action: tuple[str, float]
    outcomes: Mapping[int, Sequence[str]]
    says: str
    by_overrides: bool = False

    @property
    def parameters(self) -> tuple[str, ...]:
        """The parameters to read."""
        return (self.enable[0], self.action[0], *(name for name, _ in self.waits))

    def set_by(self, values: Mapping[str, float]) -> SetFailsafe | None:
        """Return the failsafe as set by parameter *values*; None if it takes no action."""
        outcomes = self.outcomes.get(int(values.get(*self.action)), ())
        if not values.get(*self.enable) or not outcomes:
            return None
        needs = sum(values.get(*wait) for wait in self.waits)
        return SetFailsafe(self.name, needs, outcomes, self.says, self.by_overrides)
