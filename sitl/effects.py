"""The seam for hidden effects: what may stand between the autopilot and the ideal sea. None is built in.

An effect overrides only what it alters. Effects run in the order given; an empty list costs nothing.
"""

from __future__ import annotations

from sitl.body import Body, Loads
from sitl.sensors import Reading

__all__ = ["Effect"]


class Effect:
    """One hidden effect. Each method gets the vehicle's time *t* [s] and alters its other argument in place."""

    def alter_command(self, t: float, pwm: list[int]) -> None:
        """Change the servo pulses [us] on their way to the actuators."""

    def alter_force(self, t: float, loads: Loads) -> None:
        """Change what the actuators do to the hull."""

    def alter_parameters(self, t: float, body: Body) -> None:
        """Set inertia, drag or state of the hull; called every tick, so what is scaled here scales again."""

    def alter_measurement(self, t: float, reading: Reading) -> None:
        """Change what the sensors report."""
