"""What the laws are made of: parameters read with the firmware's defaults, and a compiled loop flown on a craft.

A new law is a kernel (:mod:`.kernel` has its pieces), a table of what it reads, the vectors its kernel takes, and its
algebra: where matching may start, its transfer functions, its notes. :class:`.AboutRest` or :class:`.AboutSpeed` adds
the rest.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.design.actuator import Actuator
from gcs_autotune.design.laws.kernel import gyro_coefficients
from gcs_autotune.design.laws.law import Motion, Settings, setting
from gcs_autotune.models import SingleDof

__all__ = ["FlownLaw"]

Array = NDArray[np.float64]


class FlownLaw(ABC):
    """One loop.

    Attributes
    ----------
    kernel : the compiled loop (a ``staticmethod``). It takes gains, limits, the gyro's filter if there is one, the
        craft, the actuator, for velocities the start, and fills position (n,) and output (n,).
    vector : the gains in the order the kernel takes them.
    filters : parameters with the filters of target, error and slope, last in its limits.
    gyro : parameter with the gyro filter's cut-off [Hz]; empty when the velocity does not come from the gyro.
    """

    kernel: ClassVar[Callable[..., Any]]
    vector: Sequence[str]
    filters: Sequence[str]
    gyro: str = ""
    defaults: Settings
    free_overshoot = 0.0
    measured: Sequence[str] = ()
    late: Sequence[str] = ()

    def _get(self, settings: Settings, name: str) -> float:
        return setting(settings, self.defaults, name)

    def loop_period(self, settings: Settings) -> float:
        """Return the loop period [s]."""
        return 1.0 / self._get(settings, "SCHED_LOOP_RATE")

    def matching_speed(self, settings: Settings, speed: float | None) -> float | None:
        """Return *speed*: no term of the loop waits for another."""
        return speed

    def slopes(
        self, actuator: Actuator, model: SingleDof, step: float, settings: Settings, speed: float | None
    ) -> tuple[float, ...]:
        """Return the actuator's gains around which small motions live."""
        return actuator.slopes()

    @abstractmethod
    def limits(self, settings: Settings, speed: float | None, dt: float) -> Sequence[float]:
        """Return what the kernel takes as limits before the filters; *dt* is the loop period [s]."""

    def fly(self, settings: Settings, speed: float | None, duration: float, *vectors: Array) -> Motion:
        """Run the kernel for *duration* [s]; *vectors* are craft, actuator and, for velocities, the start."""
        dt = self.loop_period(settings)
        count = round(duration / dt) + 1
        position, output = np.empty(count), np.empty(count)
        gains = np.array([settings.get(name, 0.0) for name in self.vector])
        cutoffs = (self._get(settings, name) for name in self.filters)
        limits = np.array([*self.limits(settings, speed, dt), *cutoffs])
        sensor = [gyro_coefficients(self._get(settings, self.gyro), 1.0 / dt)] if self.gyro else []
        type(self).kernel(gains, limits, *sensor, *vectors, position, output)
        return Motion(dt * np.arange(count, dtype=np.float64), position, output)
