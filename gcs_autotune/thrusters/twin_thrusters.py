"""Two equal thrusters side by side: convert surge force and yaw moment to commands and back (ZhaoUSV, (6)-(7))."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gcs_autotune.errors import UsageError
from gcs_autotune.thrusters.thruster_map import ThrusterMap
from gcs_autotune.trial import Channel, Trial

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

    def forces_of(self, run: Trial) -> Trial:
        """Return *run* with the force of each thruster in place of its normalised outputs ``X`` and ``N``.

        The outputs of port and starboard are ``X + N`` and ``X - N``. New channels: ``X_port``, ``X_starboard`` [N] and
        their moments ``N_port``, ``N_starboard`` [N m]; and for a constant force of each, ``one_port``,
        ``one_starboard`` (1) and its arm ``arm_port``, ``arm_starboard`` [m].

        Raises
        ------
        UsageError
            The run has no normalised outputs, or the maps are not over the normalised output.
        """
        outputs = [run.channels.get(name) for name in ("X", "N")]
        if any(c is None or c.unit != "1" for c in outputs):
            raise UsageError(f"run '{run.name}' does not contain X[1] and N[1], the outputs of a flown run")
        units = {self.port.unit, self.starboard.unit}
        if units != {"1"}:
            raise UsageError(
                f"the thruster map is over {', '.join(sorted(units - {'1'}))}. Repeat `thrusters` with the column "
                "command[1], the normalised output (-1 to 1)"
            )
        t = np.unique(np.concatenate([c.t for c in outputs if c is not None]))
        X, N = (c.values[np.maximum(np.searchsorted(c.t, t, side="right") - 1, 0)] for c in outputs if c is not None)
        found = {n: c for n, c in run.channels.items() if n not in ("X", "N")}
        for side, own, output, arm in (
            ("port", self.port, X + N, 0.5 * self.B),
            ("starboard", self.starboard, X - N, -0.5 * self.B),
        ):
            force, one = own.force(output), np.ones(len(t))
            for name, unit, values in (
                (f"X_{side}", "N", force),
                (f"N_{side}", "N m", arm * force),
                (f"one_{side}", "1", one),
                (f"arm_{side}", "m", arm * one),
            ):
                found[name] = Channel(name, unit, t, values)
        return replace(run, channels=found)
