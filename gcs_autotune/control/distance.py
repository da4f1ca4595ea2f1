"""Keeping a distance to a flat wall while facing it: Miskovic2010, section 8.2.2.

Two I-PD laws (8.41)-(8.44) on the estimates of :class:`WallFilter`: the angle to the wall is held at zero, which
uncouples the distance from it. The derivative channels use the estimated yaw rate and approach speed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from gcs_autotune.control.feedback import FeedbackLaw
from gcs_autotune.control.ipd import design_ipd
from gcs_autotune.control.reference_model import ReferenceModel
from gcs_autotune.control.wall_filter import WallEstimate, WallFilter, WallReading
from gcs_autotune.models import SingleDof
from gcs_autotune.notebook import Displayed

__all__ = ["DistanceController", "DistanceLaw", "design_distance"]


@dataclass(frozen=True, slots=True)
class DistanceLaw(Displayed):
    """Laws of angle (input ``N``) and distance (input ``-X``), and the models that the filter predicts with.

    The distance falls with the speed ahead, so the sign of its law is opposite to that of the thrust. (8.42) prints
    it without this sign.
    """

    angle: FeedbackLaw
    distance: FeedbackLaw
    surge: SingleDof
    yaw: SingleDof

    def with_limits(self, X: tuple[float, float], N: tuple[float, float]) -> DistanceLaw:
        """Return it for a craft with those smallest and largest inputs."""
        return replace(
            self, angle=replace(self.angle, limits=N), distance=replace(self.distance, limits=(-X[1], -X[0]))
        )

    def started(self, X: float = 0.0, N: float = 0.0) -> DistanceController:
        """Return a controller that takes over from the inputs *X* and *N* without a jump."""
        return DistanceController(self, X, N)


def design_distance(surge: SingleDof, yaw: SingleDof, distance: ReferenceModel, angle: ReferenceModel) -> DistanceLaw:
    """Return the laws whose closed loops are the two reference models, Miskovic2010, eq. (8.43)-(8.44)."""
    approach = design_ipd(surge, distance)
    return DistanceLaw(design_ipd(yaw, angle), replace(approach, disturbance=-surge.delta), surge, yaw)


class DistanceController:
    """A distance law that runs: one call of :meth:`update` per control tick."""

    def __init__(self, law: DistanceLaw, X: float = 0.0, N: float = 0.0) -> None:
        self.law = law
        self._filter = WallFilter(law.surge, law.yaw)
        self._angle, self._distance = law.angle.started(N), law.distance.started(-X)
        self._X, self._N, self._t = X, N, math.nan
        self._seen = math.nan

    @property
    def estimate(self) -> WallEstimate:
        """What the filter estimates."""
        return self._filter.estimate

    def unseen(self, t: float) -> float:
        """Return how long the wall has not been measured [s]; infinite before the first measurement."""
        return math.inf if math.isnan(self._seen) else t - self._seen

    def hold_thrust(self) -> None:
        """Apply no thrust at this tick; the distance controller begins again, without a jump, at the next update.

        The craft must face the wall first, because the distance depends on the angle.
        """
        self._distance = self.law.distance.started(0.0)
        self._X = 0.0

    def update(self, reference: float, reading: WallReading, t: float) -> tuple[float, float]:
        """Return (X, N) that bring the craft to *reference* [m] from the wall, facing it.

        Both are the inputs taken over until the wall is seen for the first time.
        """
        dt = 0.0 if math.isnan(self._t) else t - self._t
        self._t = t
        self._filter.predict(self._X, self._N, dt)
        self._filter.correct(reading)
        if reading.sees_wall:
            self._seen = t
        if math.isnan(self._seen):
            return self._X, self._N
        now = self._filter.estimate
        self._N = self._angle.update(0.0, now.phi, now.r, t)
        self._X = -self._distance.update(reference, now.d, -now.u * math.cos(now.phi), t)
        return self._X, self._N
