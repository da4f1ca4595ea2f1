"""ArduSub's roll and pitch loops: those of the heading with parameters of their own.

Both hold an angle by the same stages: a shaped target, the square-root angle controller and the rate PID. The target
has no slew limit like ATC_SLEW_YAW. The simulation and the margins include the restoring moment of the craft.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from gcs_autotune.control import ReferenceModel
from gcs_autotune.design.laws import sub_heading as heading
from gcs_autotune.design.laws.kernel import Cascade
from gcs_autotune.design.laws.law import Settings
from gcs_autotune.design.laws.loops import PositionLoop
from gcs_autotune.design.open_loop import Rational
from gcs_autotune.models import SingleDof

__all__ = ["SubTilt"]

_NO_SLEW = 1e8
"""Value of ATC_SLEW_YAW [cdeg/s] that limits nothing."""
_FILTERS: Settings = {"IMAX": 0.444, "FLTT": 30.0, "FLTE": 0.0, "FLTD": 30.0}
"""Suffix of a parameter of the rate PID -> its default, other than that of the yaw loop."""
_SMOOTH_D = 0.0036
"""Default of ATC_RAT_RLL_D and ATC_RAT_PIT_D, which the design keeps."""


class SubTilt(PositionLoop):
    """Control laws ``sub-roll`` and ``sub-pitch`` (``Axis.law``).

    letters : of the rate PID (``RLL``) and of its limits (``R``), in the names of the parameters.
    """

    integral: str
    usual_step = math.radians(20.0)
    gyro = "INS_GYRO_FILTER"
    _heading = heading.SubHeading()

    def __init__(self, name: str, letters: tuple[str, str]) -> None:
        three, one = letters
        self.name = name
        self._yaw: Mapping[str, str] = {
            own.replace("_Y_", f"_{one}_").replace("YAW", three): own
            for own in (heading.P, heading.I, heading.D, heading.ANG, *heading.DEFAULTS)
            if own != "ATC_SLEW_YAW"
        }
        own = {yaw: name for name, yaw in self._yaw.items()}
        self.tuned: Sequence[str] = tuple(own[n] for n in (heading.P, heading.I, heading.ANG))
        self.integral = own[heading.I]
        self.fixed: Settings = {own[heading.D]: _SMOOTH_D}
        shared = {name: heading.DEFAULTS[yaw] for name, yaw in self._yaw.items() if yaw in heading.DEFAULTS}
        rates = {f"ATC_RAT_{three}_{suffix}": value for suffix, value in _FILTERS.items()}
        self.defaults: Settings = {**shared, **rates, f"ATC_RATE_{one}_MAX": 0.0}

    def _as_yaw(self, settings: Settings) -> dict[str, float]:
        """Return *settings*, with defaults for what is missing, under the names of the heading loop."""
        known = {**self.defaults, **{n: v for n, v in settings.items() if math.isfinite(v)}}
        return {yaw: known[name] for name, yaw in self._yaw.items() if name in known} | {"ATC_SLEW_YAW": _NO_SLEW}

    def velocity_limit(self, settings: Settings, speed: float | None) -> float:
        """Return ATC_RATE_R_MAX or ATC_RATE_P_MAX [rad/s], which is unlimited if it is 0."""
        return self._heading.velocity_limit(self._as_yaw(settings), speed)

    def starts(
        self, model: SingleDof, wanted: ReferenceModel, settings: Settings, speed: float | None
    ) -> list[dict[str, float]]:
        """Return the gains of :meth:`SubHeading.starts` under the names of this loop."""
        own = {yaw: name for name, yaw in self._yaw.items()}
        found = self._heading.starts(model, wanted, self._as_yaw(settings), speed)
        return [{own[yaw]: value for yaw, value in gains.items()} for gains in found]

    def cascade(self, settings: Settings, speed: float | None, dt: float) -> Cascade:
        """Return the stages of the heading loop without a slew limit."""
        return self._heading.cascade(self._as_yaw(settings), speed, dt)

    def controller(self, settings: Settings, speed: float | None) -> Rational:
        """Return the transfer function from measured rate to output, with the angle controller in its linear range."""
        return self._heading.controller(self._as_yaw(settings), speed)

    def position_path(self, settings: Settings, speed: float | None) -> Rational:
        """Return the transfer function from measured angle to output."""
        return self._heading.position_path(self._as_yaw(settings), speed)

    def integral_rate(self, settings: Settings, speed: float | None) -> float:
        """Return the rate [1/s] of the heading loop."""
        return self._heading.integral_rate(self._as_yaw(settings), speed)

    def notes(self, model: SingleDof, settings: Settings, speed: float | None) -> list[str]:
        """Return a note on the restoring moment, compared with the loop's own moment per angle."""
        p, angle = settings[self.tuned[0]], settings[self.tuned[2]]
        loop = p * angle
        if not loop > 0.0:
            return []
        return [
            f"weight and buoyancy right the craft with {abs(model.restoring) / loop:.0%} of the moment per angle of "
            "this loop. The margins and the predicted step include it"
        ]
