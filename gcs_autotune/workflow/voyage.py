"""What the legs of one tune have in common: the vehicle, the axis, the wish, and who is told of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import ParamSpec, TypeVar

from gcs_autotune.design.laws import Law
from gcs_autotune.firmware import Axis
from gcs_autotune.link import MavlinkCraft
from gcs_autotune.manoeuvres import Flown, Manoeuvre, Outcome
from gcs_autotune.workflow.desk import Desk
from gcs_autotune.workflow.given import Given
from gcs_autotune.workflow.helm import Helm
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.record import RunDirectory
from gcs_autotune.workflow.resuming import Earlier
from gcs_autotune.workflow.settings import TuneSettings
from gcs_autotune.workflow.tale import Tale
from gcs_autotune.workflow.waiting import agreed, beside, think

__all__ = ["Voyage"]

T = TypeVar("T")
P = ParamSpec("P")


@dataclass(frozen=True, slots=True, eq=False)
class Voyage:
    """One tune aboard one vehicle.

    ``axis`` has the vehicle's own parameter names; ``present`` are its values under the canonical ones. ``given`` is
    the model to design from, None to identify aboard. ``throttle`` [fraction] and ``speed`` [m/s] are what is tuned at.
    ``desk`` is where it is computed; ``earlier`` what was flown before.
    """

    settings: TuneSettings
    operator: Operator
    tale: Tale
    record: RunDirectory
    craft: MavlinkCraft
    helm: Helm
    desk: Desk
    earlier: Earlier
    axis: Axis
    law: Law
    given: Given | None
    present: Mapping[str, float]
    throttle: float
    speed: float

    def fly(self, manoeuvre: Manoeuvre, stage: str) -> Flown:
        """Say which *stage* it is and fly it, unless an earlier run has; ``NotAchieved`` if it comes to no good end."""
        flown = self.earlier.take(manoeuvre.name)
        if flown is not None:
            beside(self.craft, partial(self.record.keep, flown))
            self.tale.flown(flown)
            self.tale.say(f"{stage}: not flown, {flown.name} of the earlier run is used")
            return Flown(flown, Outcome("completed", flown.reason))
        self.tale.say(stage)
        return self.helm.achieve(manoeuvre, stage)

    def come_about(self, before: str) -> None:
        """Bring a boat back before the trial *before*; not before one that an earlier run has flown."""
        if not self.earlier.has(before):
            self.helm.come_about(self.throttle)

    def think(self, work: Callable[P, T], *args: P.args, **named: P.kwargs) -> T:
        """Return ``work(*args, **named)``, done at the desk while the craft is kept company."""
        return think(self.craft, self.desk, self.helm.bear, work, *args, **named)

    def agrees(self, question: str) -> bool:
        """Whether the operator agrees; of a simulated vehicle nobody is asked."""
        return agreed(self.craft, self.operator, self.tale, question)
