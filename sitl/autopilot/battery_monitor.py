"""The battery as the autopilot watches it, and its low-voltage failsafe."""

from __future__ import annotations

from typing import Protocol

from sitl.autopilot.parameters import ParameterStore

__all__ = ["BatteryMonitor"]

_WARNING = 4


class _Owner(Protocol):
    ms: int

    def say(self, severity: int, text: str) -> None: ...

    def act_on_battery(self, action: int) -> None: ...


class BatteryMonitor:
    """Acts once when the voltage has been below BATT_LOW_VOLT for BATT_LOW_TIMER seconds."""

    def __init__(self, parameters: ParameterStore) -> None:
        self._values = parameters.values
        self._low_since_ms: int | None = None
        self.voltage = 0.0
        self.is_low = False

    def arming_fault(self) -> str | None:
        """Return why this battery forbids arming, or None."""
        if self.voltage < self._values["BATT_ARM_VOLT"]:
            return "Battery 1 below minimum arming voltage"
        return "Battery 1 low voltage failsafe" if self.is_low else None

    def update(self, owner: _Owner, voltage: float, consumed_mah: float) -> None:
        """Take in the present voltage [V] and charge used [mAh]."""
        values = self._values
        self.voltage = voltage
        if self.is_low or not 0.0 < voltage < values["BATT_LOW_VOLT"]:
            self._low_since_ms = None
            return
        if self._low_since_ms is None:
            self._low_since_ms = owner.ms
        if owner.ms - self._low_since_ms >= values["BATT_LOW_TIMER"] * 1000.0:
            self.is_low = True
            owner.say(_WARNING, f"Battery 1 is low {voltage:.2f}V used {consumed_mah:.0f} mAh")
            owner.act_on_battery(int(values["BATT_FS_LOW_ACT"]))
