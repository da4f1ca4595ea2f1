"""Two equal thrusters side by side: convert surge force and yaw moment to commands and back (ZhaoUSV, (6)-(7))."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcs_autotune.thrusters.thruster_map import ThrusterMap

__all__ = ["TwinCommand", "TwinThrusters"]


@dataclass(frozen=True, slots=True)
class TwinCommand:
    """Commands of both thrusters, with the resulting surge force [N] and yaw moment [N m]."""

    port: float
    starboard: float
    X: float
    N: float
    saturated: bool


@dataclass(frozen=True, slots=True)
class TwinThrusters:
    """``X = T_1 + T_2``, ``N = B (T_1 - T_2)/2``; 1 is port, so that more port thrust turns to starboard (N > 0).

    ZhaoUSV prints (7) as ``T_2 + T_2``. ``B`` [m] is the distance between the thrusters.
    """

    port: ThrusterMap
    starboard: ThrusterMap
    B: float

    def forces(self, port: float, starboard: float) -> tuple[float, float]:
        """Return surge force [N] and yaw moment [N m] of two commands."""
        T_1, T_2 = float(self.port.force(port)), float(self.starboard.force(starboard))
        return T_1 + T_2, 0.5 * self.B * (T_1 - T_2)

    def commands(self, X: float, N: float) -> TwinCommand:
        """Return the commands for *X* [N] and *N* [N m].

        Outside the range, the moment has priority, because a craft that steers can still be saved. The moment is kept
        as far as the thrusters permit, and then the nearest possible force to *X* is used.
        """
        (a, b), (c, d) = self.port.limits, self.starboard.limits
        half = N / self.B
        half = float(np.clip(half, 0.5 * (a - d), 0.5 * (b - c)))
        total = float(np.clip(X, max(2.0 * (a - half), 2.0 * (c + half)), min(2.0 * (b - half), 2.0 * (d + half))))
        T_1, T_2 = 0.5 * total + half, 0.5 * total - half
        port, starboard = float(self.port.inverse(T_1)), float(self.starboard.inverse(T_2))
        got = self.forces(port, starboard)
        saturated = abs(total - X) > 1e-9 * max(1.0, abs(X)) or abs(half * self.B - N) > 1e-9 * max(1.0, abs(N))
        return TwinCommand(port, starboard, *got, saturated=saturated)
