"""What drives a craft besides its commands, and how well it is seen."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.kalman.waves import rough

__all__ = ["ProcessNoise"]

Array = NDArray[np.float64]

NO_FORCE = 1e-9
"""Size [m/s^2, rad/s^2] up to which a drifting force counts as none: it is held there, and its memory means nothing."""


@dataclass(frozen=True, slots=True)
class ProcessNoise:
    """What drives a craft besides its commands, and how well it is seen.

    ``size`` standard deviation of the force per inertia [m/s^2, rad/s^2] (:data:`NO_FORCE` for none), ``memory`` [s]
    its time constant, ``sensor`` the noise of the measured position [m, rad]; ``freedom`` degrees of freedom of the
    innovations' law, inf when normal.
    ``wave_swing`` [as sensor], ``wave_force`` [as size]: standard deviations of what waves add to the position seen and
    to the force, ``wave_frequency`` [rad/s] and ``wave_damping`` ratio: of their band (:mod:`.waves`); 0 for none.
    ``smoothing`` [s]: the position was smoothed forwards and backwards with this time constant, 0 when it was not.
    What a linear craft then shows is what smoothed commands would have done. ``day_force`` [as size] and ``day_thrust``
    [share]: standard deviations between runs of each one's constant force and of its thrust; 0 where runs are alike.
    """

    size: float
    memory: float
    sensor: float
    freedom: float = math.inf
    smoothing: float = 0.0
    day_force: float = 0.0
    day_thrust: float = 0.0
    wave_swing: float = 0.0
    wave_force: float = 0.0
    wave_frequency: float = 1.0
    wave_damping: float = 0.1

    @property
    def differs(self) -> bool:
        """Whether every run has a constant force, or a thrust, of its own."""
        return self.day_force > 0.0 or self.day_thrust > 0.0

    @property
    def waves(self) -> Array:
        """Swing, force, frequency and damping ratio (4,) of the waves."""
        return np.array([self.wave_swing, self.wave_force, self.wave_frequency, self.wave_damping])

    @property
    def wavy(self) -> bool:
        """Whether there are waves."""
        return bool(rough(self.waves))

    @property
    def still(self) -> ProcessNoise:
        """The same sensor without any force that drifts, differs between runs or goes with waves."""
        return replace(self, size=NO_FORCE, day_force=0.0, day_thrust=0.0, wave_swing=0.0, wave_force=0.0)

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of what is fitted, each by its logarithm."""
        smoothing = ("smoothing",) if self.smoothing > 0.0 else ()
        waves = ("wave_swing", "wave_force", "wave_frequency", "wave_damping") if self.wavy else ()
        force = ("size", "memory") if self.size > NO_FORCE else ()
        return (*force, "sensor", *smoothing, *waves)
