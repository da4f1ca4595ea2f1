"""The battery: voltage drop under load, and remaining charge."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

__all__ = ["FULL_CURRENT", "IDLE_CURRENT", "Battery"]

IDLE_CURRENT = 0.4
FULL_CURRENT = 6.0
_RESISTANCE = 0.02
"""Battery constants of a small 12 V craft: current at rest [A], current per fully driven output [A], internal
resistance [ohm]. Project choice."""


class Battery:
    """A battery with a voltage drop under load. Open-circuit voltage and capacity are the autopilot's SIM_BATT_VOLTAGE
    and BATT_CAPACITY. *values*: ``resistance`` [ohm] of the vehicle file, if it has a battery.
    """

    def __init__(self, values: Mapping[str, float] | None = None) -> None:
        self._resistance = (values or {}).get("resistance", _RESISTANCE)
        self.current = IDLE_CURRENT
        self.consumed_mah = 0.0

    def drain(self, pwm: Sequence[int], dt: float, current: float | None = None) -> None:
        """Discharge the battery for *dt* [s] under servo pulses *pwm* [us], or under *current* [A] if it is known."""
        load = 0.0
        for pulse in pwm:
            if pulse:
                load += min(500, abs(pulse - 1500))
        self.current = IDLE_CURRENT + FULL_CURRENT * load / 500.0 if current is None else current
        self.consumed_mah += self.current * dt / 3.6

    def voltage(self, open_circuit: float) -> float:
        """Return the terminal voltage [V]."""
        return open_circuit - self._resistance * self.current

    def remaining_percent(self, capacity_mah: float) -> int:
        """Return the remaining charge [%], or -1 if the capacity is unknown."""
        if capacity_mah <= 0.0:
            return -1
        return max(0, min(100, int(100.0 - 100.0 * self.consumed_mah / capacity_mah)))
