"""The disturbances that drive a craft in addition to its commands, and the noise of its sensor."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.kalman.waves import rough

__all__ = ["LEAST_DAMPING", "LONGEST_WAVE", "MOST_DAMPING", "ProcessNoise"]

Array = NDArray[np.float64]

NO_FORCE = 1e-9
"""Standard deviation [m/s^2, rad/s^2] up to which a drifting force counts as zero. Project choice.

The standard deviation is then fixed, and the time constant has no effect.
"""

LONGEST_WAVE = 20.0
"""Longest period of waves [s]. Slower motion is part of the drifting force. Project choice."""

LEAST_DAMPING, MOST_DAMPING = 0.03, 0.5
"""Limits of the damping ratio of waves.

Below the lower limit the motion is vibration of a machine. Above the upper limit it is not a narrow band. Fossen2011
fits 0.1 to 0.26 to usual sea states.
"""


@dataclass(frozen=True, slots=True)
class ProcessNoise:
    """The disturbances that drive a craft in addition to its commands, and the noise of its sensor.

    - ``size``: standard deviation of the drifting force per inertia [m/s^2, rad/s^2] (:data:`NO_FORCE` for none).
    - ``memory`` [s]: time constant of the drifting force.
    - ``sensor``: standard deviation of the noise of the measured position [m, rad].
    - ``freedom``: degrees of freedom of the innovations' distribution, inf for normal.

    ``wave_swing`` [as sensor], ``wave_force`` [as size]: standard deviations of what waves add to the measured position
    and to the force. ``wave_frequency`` [rad/s] and ``wave_damping`` ratio describe the band of the waves
    (:mod:`.waves`); 0 for none.

    ``smoothing`` [s]: time constant with which the position was smoothed forwards and backwards, 0 for none. The
    response of a linear craft then equals the response to smoothed commands.

    ``day_force`` [as size] and ``day_thrust`` [relative]: standard deviations between runs, of the constant force and
    of the thrust; 0 if the runs do not differ.
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
        """Whether the model lets runs differ in constant force or thrust."""
        return self.day_force > 0.0 or self.day_thrust > 0.0

    @property
    def waves(self) -> Array:
        """Parameters (4,) of the waves: oscillation, force, frequency and damping ratio."""
        return np.array([self.wave_swing, self.wave_force, self.wave_frequency, self.wave_damping])

    @property
    def wavy(self) -> bool:
        """Whether the model includes waves."""
        return bool(rough(self.waves))

    @property
    def is_band(self) -> bool:
        """Whether the damping ratio is inside :data:`LEAST_DAMPING` and :data:`MOST_DAMPING`, so that the waves are a
        narrow band.
        """
        return 1.01 * LEAST_DAMPING < self.wave_damping < 0.99 * MOST_DAMPING

    @property
    def still(self) -> ProcessNoise:
        """Return a copy with the same sensor noise, but without drifting force, differences between runs, and waves."""
        return replace(self, size=NO_FORCE, day_force=0.0, day_thrust=0.0, wave_swing=0.0, wave_force=0.0)

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of the fitted noise parameters. The logarithm of each is fitted."""
        smoothing = ("smoothing",) if self.smoothing > 0.0 else ()
        waves = ("wave_swing", "wave_force", "wave_frequency", "wave_damping") if self.wavy else ()
        force = ("size", "memory") if self.size > NO_FORCE else ()
        return (*force, "sensor", *smoothing, *waves)
