"""The failsafes for a lost ground station: the time each waits, and its action.

Sources: ArduPilot 4.5 to 4.7, ``Rover/failsafe.cpp``, ``Rover/radio.cpp``, ``ArduSub/failsafe.cpp``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

__all__ = ["DISARMS", "Failsafe", "SetFailsafe"]

DISARMS = "disarmed"
"""An outcome that is no mode."""


@dataclass(frozen=True, slots=True)
class SetFailsafe:
    """One failsafe as a vehicle's parameters set it.

    ``needs``: silence of the station before it acts [s, vehicle time]; ``outcomes``: modes it may end in, or
    ``DISARMS``; ``says``: content of its STATUSTEXT, in lower case. ``by_overrides``: only overrides prevent it; with
    an RC receiver it does not depend on this tool.
    """

    name: str
    needs: float
    outcomes: Sequence[str]
    says: str
    by_overrides: bool


@dataclass(frozen=True, slots=True)
class Failsafe:
    """One failsafe of a firmware.

    ``action`` is the parameter that chooses the outcome, ``outcomes`` its values; one that is missing there does
    nothing. ``enable`` is the parameter that is 0 where it is off, ``waits`` are the parameters whose sum is the time
    it waits [s]. Each parameter goes with the value of a firmware that does not have it.
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
        """The names to read."""
        return (self.enable[0], self.action[0], *(name for name, _ in self.waits))

    def set_by(self, values: Mapping[str, float]) -> SetFailsafe | None:
        """Return it as parameter *values* set it; None where it does nothing."""
        outcomes = self.outcomes.get(int(values.get(*self.action)), ())
        if not values.get(*self.enable) or not outcomes:
            return None
        needs = sum(values.get(*wait) for wait in self.waits)
        return SetFailsafe(self.name, needs, outcomes, self.says, self.by_overrides)
