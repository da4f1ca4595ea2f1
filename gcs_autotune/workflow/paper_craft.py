"""The craft that a manoeuvre is previewed on: from a model file, from the vehicle's own figures, else assumed."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from gcs_autotune.design import in_fractions, reduce
from gcs_autotune.errors import UsageError
from gcs_autotune.firmware import Firmware
from gcs_autotune.identify import ModelFile
from gcs_autotune.manoeuvres import DOF_OF, SPEED_TIME, PaperCraft
from gcs_autotune.models import SingleDof
from gcs_autotune.sname import DOFS
from gcs_autotune.workflow.flight_plan import FlySettings

__all__ = ["motion_of", "paper_craft"]

_UNTUNED = 0.2
"""ATC_STR_RAT_FF as ArduRover sets it: that of no craft in particular."""
_RADIUS, _LAG = 4.0, 1.5
"""Chosen: turning radius [m] at full rudder and time constant [s] of boats of 1 to 3 m, where nothing is known."""
_ROV_RATE, _ROV_LAG = 0.8, 1.0
"""Chosen: yaw rate [rad/s] at full output of an ROV, and its time constant [s], likewise."""
TIED = 1e9
"""Inertia and drag of what does not move."""
_FULL_SPEED: Mapping[str, float] = {"X": 1.0, "Y": 0.5, "Z": 0.5}
"""Chosen [m/s]: speed at full output along each force, likewise."""


def motion_of(file: ModelFile, dof: str, full_scale: float | None) -> SingleDof:
    """Return one degree of freedom of a model file with its input as a fraction of full output.

    Raises
    ------
    UsageError
        It has none, or its input is an angle or a force and nobody says what full output is.
    """
    reduction = reduce(file.model, dof, file.inputs, names=file.names, covariance=file.covariance)
    unit = reduction.model.input_unit
    if unit != "1" and full_scale is None:
        raise UsageError(f"the model's input is in {unit}: say with --full-scale how many {unit} full output gives")
    return in_fractions(reduction.model, np.zeros((5, 5)), full_scale)[0]


def paper_craft(
    settings: FlySettings, firmware: Firmware | None, present: Mapping[str, float], throttle: float, speed: float
) -> PaperCraft:
    """Return the craft on paper: from the model given, from its feed-forward gain, else an assumed one of its size."""
    if settings.kind.tied:
        return PaperCraft(SingleDof("yaw", "1", TIED, TIED), 0.0, "a craft that is tied up")
    under_way = firmware is not None and firmware.needs_way
    gain = present.get("ATC_STR_RAT_FF", 0.0)
    if under_way and gain > 0.0 and abs(gain - _UNTUNED) > 1e-6:
        yaw, words = SingleDof("yaw", "1", gain * _LAG, gain), f"its ATC_STR_RAT_FF {gain:g}"
    else:
        rate, lag = (max(speed, 0.1) / _RADIUS, _LAG) if under_way else (_ROV_RATE, _ROV_LAG)
        yaw = SingleDof("yaw", "1", lag / rate, 1.0 / rate)
        words = f"an assumed turn rate of {math.degrees(rate):.0f} deg/s at full steering (a --model file tells better)"
    ahead = speed / math.sqrt(throttle) if speed and throttle else _FULL_SPEED["X"]
    others = {f: _lag_of(DOF_OF[f], full) for f, full in {**_FULL_SPEED, "X": ahead}.items()}
    known: set[str] = set()
    if settings.model is not None:
        for dof in settings.model.model.base.form.dofs:
            force = DOFS[dof].force
            if force in settings.kind.drives or force == "N":
                motion = motion_of(settings.model, dof, settings.full_scale)
                yaw, others = (motion, others) if force == "N" else (yaw, {**others, force: motion})
                known.add(force)
        words = f"model '{settings.model.name}'"
    missing = sorted(DOF_OF[f] for f in settings.kind.drives - known)
    if known and missing:
        words += f" with an assumed {' and '.join(missing)}"
    return PaperCraft(yaw, speed, words, assumed=bool(missing) or not known, others=others)


def _lag_of(dof: str, full_speed: float) -> SingleDof:
    """Return a craft that reaches *full_speed* [m/s] at full output, with drag by the square and a usual lag."""
    drag = full_speed**-2
    return SingleDof(dof, "1", 2.0 * drag * full_speed * SPEED_TIME, 0.0, drag)
