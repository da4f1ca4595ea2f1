"""The craft that a manoeuvre is previewed on: from a model file, from the vehicle's own figures, else assumed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

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
_ROV_RATE, _ROV_LAG = 1.9, 0.25
"""Chosen: yaw rate [rad/s] at full output of an ROV, and its time constant [s], likewise: in the middle of the
published ones (Falcon 1.3, VideoRay 1.6, BlueROV2 3.9; Miskovic2010, tables 7.1, 7.9; Benzon2022, table A1). None of
ArduSub's parameters tells it: they limit what its loops ask for, not what its thrusters give."""
TIED = 1e9
"""Inertia and drag of what does not move."""
_FULL_SPEED: Mapping[str, float] = {"X": 1.0, "Y": 1.0, "Z": 1.5}
"""Chosen [m/s]: speed at full output along each force of a craft that nobody knows. Up and down quicker than ROVs of up
to 100 kg go (0.6 to 1.3): what is foreseen as too small ends at a limit."""
_SIDEWAYS = 0.3
"""Chosen [s]: in which such a craft gains its speed to the side, up and down (0.1 to 0.6): they are short of mass for
their thrusters there."""
_WEIGHT = 0.03
"""Chosen [of full]: weight left in the water of an ROV that nobody knows, or buoyancy (0.02 to 0.03)."""
_WAYS: Mapping[str, str] = {"X": "ahead", "Y": "to the side", "Z": "up or down"}


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
    settings: FlySettings,
    firmware: Firmware | None,
    present: Mapping[str, float],
    throttle: float,
    speed: float,
    *,
    sinks: bool = True,
) -> PaperCraft:
    """Return the craft on paper: from the model given, from its own figures, else an assumed one of its size.

    Its cruise tells how far it goes straight ahead. Its feed-forward gain tells its turning only so so: the rate loop
    works with far less than the rudder that a turn takes, and tunes keep it within ArduRover's range. So it is assumed.

    One whose heave is driven and assumed *sinks* by itself, or comes up.
    """
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
    full_speed = {**_FULL_SPEED, "X": ahead}
    others = {"X": _by_the_square("surge", ahead), **{f: _lively(DOF_OF[f], full_speed[f]) for f in "YZ"}}
    drives = settings.kind.drives
    along = [f for f in _WAYS if drives == {f}]
    if along:
        (force,) = along
        cruise = force == "X" and speed and throttle
        words = (
            f"its cruise of {speed:g} m/s at {throttle:.0%} throttle"
            if cruise
            else f"an assumed {full_speed[force]:g} m/s {_WAYS[force]} at full output (a --model file tells better)"
        )
    if "Z" in drives:
        others["Z"] = replace(others["Z"], delta=_WEIGHT if sinks else -_WEIGHT)
    known: set[str] = set()
    if settings.model is not None:
        for dof in settings.model.model.base.form.dofs:
            force = DOFS[dof].force
            if force in settings.kind.drives or force == "N":
                motion = motion_of(settings.model, dof, settings.full_scale)
                yaw, others = (motion, others) if force == "N" else (yaw, {**others, force: motion})
                known.add(force)
        words = f"model '{settings.model.name}'"
    elif along == ["X"] and settings.knows_its_cruise(present):
        known.add("X")  # a straight run that takes more room than there is need not be tried
    missing = sorted(DOF_OF[f] for f in settings.kind.drives - known)
    if known and missing:
        words += f" with an assumed {' and '.join(missing)}"
    return PaperCraft(yaw, speed, words, assumed=bool(missing) or not known, others=others)


def _by_the_square(dof: str, full_speed: float) -> SingleDof:
    """Return a craft that reaches *full_speed* [m/s] at full output, with drag by the square and a usual lag."""
    drag = full_speed**-2
    return SingleDof(dof, "1", 2.0 * drag * full_speed * SPEED_TIME, 0.0, drag)


def _lively(dof: str, full_speed: float) -> SingleDof:
    """Return a craft that reaches *full_speed* [m/s] at full output soon, half of its drag by the square."""
    linear, square = 0.5 / full_speed, 0.5 / full_speed**2
    return SingleDof(dof, "1", (linear + 2.0 * square * full_speed) * _SIDEWAYS, linear, square)
