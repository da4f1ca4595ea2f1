"""The nominal plant for previewing a manoeuvre, from a model file, the vehicle's own figures or assumptions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from gcs_autotune.craft import SteeredBy
from gcs_autotune.design import in_fractions, reduce
from gcs_autotune.errors import UsageError
from gcs_autotune.firmware import Firmware
from gcs_autotune.identify import ModelFile
from gcs_autotune.manoeuvres import DOF_OF, SPEED_TIME, NominalPlant
from gcs_autotune.models import SingleDof
from gcs_autotune.sname import DOFS
from gcs_autotune.workflow.flight_plan import FlySettings

__all__ = ["AssumedCraft", "assumed_crafts", "assumed_plant", "motion_of", "nominal_plant"]

_UNTUNED = 0.2
"""ArduRover's default of ATC_STR_RAT_FF. It does not describe any particular craft."""


@dataclass(frozen=True, slots=True)
class AssumedCraft:
    """An assumed craft, described by its turning and its speed.

    ``radius``: a boat's turning radius at full steering [m].
    ``rate``: an ROV's yaw rate at full output [rad/s].
    ``lag``: time constant of turning [s].
    ``ahead``: speed at full thrust [m/s] of a craft without a cruise speed.
    ``gains``: time constant of surge [s].
    ``sinks``: whether an ROV without vertical thrust sinks; else it rises.
    """

    radius: float = 4.0
    rate: float = 1.9
    lag: float = 1.5
    ahead: float = 1.0
    gains: float = SPEED_TIME
    sinks: bool = True


USUAL: Mapping[str, AssumedCraft] = {
    "rudder": AssumedCraft(),
    "thrusters": AssumedCraft(lag=0.7, gains=1.6),
    "rov": AssumedCraft(lag=0.25, gains=1.0),
}
"""Assumed craft for a vehicle without figures of its own: the middle of boats of 1 to 3 m and of published ROVs.
Project choice.

Yaw rates of ROVs: AutoMarine 0.9, Falcon 1.3, VideoRay 1.6, BlueROV2 3.9 rad/s (Miskovic2010, tables 7.1, 7.9 to 7.11;
Benzon2022, table A1). ArduSub's parameters limit the commands of its loops. They do not show the thrust of its
thrusters.
"""
_KIN: Mapping[str, tuple[AssumedCraft, ...]] = {
    "rudder": (AssumedCraft(radius=6.7, lag=3.7), AssumedCraft(radius=3.0, lag=1.0)),
    "thrusters": (AssumedCraft(radius=4.0, lag=1.0, gains=2.0), AssumedCraft(radius=2.5, lag=0.5, gains=1.4)),
    "rov": (
        AssumedCraft(rate=0.9, lag=0.4, ahead=0.7, gains=1.5),
        AssumedCraft(rate=4.0, lag=0.15, ahead=1.8, gains=0.5),
        AssumedCraft(rate=1.6, lag=0.3, ahead=1.8, gains=1.3),
    ),
}
"""Slow and quick craft of each kind, and a fast and heavy ROV, which coasts furthest.

A boat that steers by two thrusters turns in less space than one with a rudder. Project choice.
"""
TIED = 1e9
"""Inertia and drag of a craft that is tied up, large enough to prevent motion."""
_FULL_SPEED: Mapping[str, float] = {"Y": 1.0, "Z": 1.5}
"""Speed [m/s] of an unknown craft at full sideways and full vertical output.

The vertical one is above that of ROVs of up to 100 kg (0.6 to 1.3). Too small a value would predict too little travel,
and the run would end at a limit. Project choice.
"""
_SIDEWAYS = 0.3
"""Time constant [s] of an unknown craft sideways and vertically; known craft have 0.1 to 0.6. Project choice."""
_BY_SQUARE = 0.7
"""Fraction of quadratic drag in an ROV's yaw drag at full output.

It lies between Falcon (none) and VideoRay and AutoMarine (all of it; Miskovic2010, 7.2 to 7.4). Such a craft turns
slowly at small outputs and takes long to come to rest. Project choice.
"""
_WEIGHT = 0.03
"""Weight in water or buoyancy of an unknown ROV [fraction of full output]; known ROVs have 0.02 to 0.03. Project
choice."""
_WAYS: Mapping[str, str] = {"X": "ahead", "Y": "to the side", "Z": "up or down"}
_TILTING: Mapping[str, tuple[float, float, float]] = {"K": (5.0, 0.08, 0.06), "M": (4.5, 0.1, 0.1)}
"""Moment -> rate at full output [rad/s], time constant [s] and restoring moment per angle [fraction of full/rad] of an
unknown ROV: about those of a BlueROV2 Heavy (Benzon2022, table A1). Project choice."""


def motion_of(file: ModelFile, dof: str, full_scale: float | None) -> SingleDof:
    """Return one degree of freedom of a model file with its input as a fraction of full output.

    Raises
    ------
    UsageError
        The model does not contain this degree of freedom, or its input is an angle or a force of unknown value at full
        output.
    """
    reduction = reduce(file.model, dof, file.inputs, names=file.names, covariance=file.covariance)
    unit = reduction.model.input_unit
    if unit != "1" and full_scale is None:
        raise UsageError(f"the model's input is in {unit}. Use --full-scale with its value in {unit} at full output")
    return in_fractions(reduction.model, np.zeros((5, 5)), full_scale)[0]


def nominal_plant(
    settings: FlySettings,
    firmware: Firmware | None,
    present: Mapping[str, float],
    throttle: float,
    speed: float,
    like: AssumedCraft | None = None,
) -> NominalPlant:
    """Return the nominal plant: from the model of *settings*, else from the vehicle's own figures, else an assumed
    one.

    The vehicle's cruise speed shows how far it goes straight ahead. Its feed-forward gain is only a rough measure of
    its turning: the rate loop uses far less rudder than a turn, and tunes keep the gain within ArduRover's range. So
    the turning is assumed.

    *like*: the assumed craft; None: :data:`USUAL`.
    """
    if settings.kind.tied:
        return NominalPlant(SingleDof("yaw", "1", TIED, TIED), 0.0, "a craft that is tied up")
    assumed = assumed_plant(firmware, present, throttle, speed, like)
    yaw, words, others = assumed.yaw, assumed.source, dict(assumed.others)
    drives = settings.kind.drives
    if settings.kind.axis:
        words = f"an assumed, well damped {settings.kind.axis} loop"
    if tilting := drives & _TILTING.keys():
        dofs = " and ".join(sorted(DOF_OF[f] for f in tilting))
        words = f"an assumed {dofs}; a --model file is more accurate"
    along = [f for f in _WAYS if drives == {f}]
    if along:
        (force,) = along
        cruise = force == "X" and speed and throttle
        words = (
            f"its cruise speed of {speed:g} m/s at {throttle:.0%} throttle"
            if cruise
            else f"an assumed {others[force].steady_velocity(1.0):.2g} m/s {_WAYS[force]} at full output; "
            "a --model file is more accurate"
        )
    if "Z" in drives:
        sinks = like is None or like.sinks
        others["Z"] = replace(others["Z"], delta=_WEIGHT if sinks else -_WEIGHT)
    known: set[str] = set()
    if settings.models:
        for file, dof in ((m, dof) for m in reversed(settings.models) for dof in m.model.base.form.dofs):
            force = DOFS[dof].force
            if force in settings.kind.drives or force == "N" or settings.kind.layered:
                motion = motion_of(file, dof, settings.full_scale)
                yaw, others = (motion, others) if force == "N" else (yaw, {**others, force: motion})
                known.add(force)
        if settings.kind.layered and firmware is not None and firmware.needs_way and settings.knows_its_cruise(present):
            known.add("X")  # its cruise is enough for the thrust ahead
        words = f"model '{settings.models[0].name}'"
    elif along == ["X"] and settings.knows_its_cruise(present):
        known.add("X")  # a straight run that takes more room than there is need not be tried
    missing = sorted(DOF_OF[f] for f in settings.kind.drives - known)
    if known and missing:
        words += f" with an assumed {' and '.join(missing)}"
    assumed_still = bool(missing) or not known
    return replace(assumed, yaw=yaw, source=words, assumed=assumed_still, others=others)


def assumed_plant(
    firmware: Firmware | None,
    present: Mapping[str, float],
    throttle: float,
    speed: float,
    like: AssumedCraft | None = None,
) -> NominalPlant:
    """Return an assumed plant that uses the vehicle's own figures where available; *like*: the assumed craft; None:
    :data:`USUAL`.
    """
    under_way = firmware is not None and firmware.needs_way
    like = like or USUAL["rudder" if under_way else "rov"]
    gain = present.get("ATC_STR_RAT_FF", 0.0)
    if under_way and gain > 0.0 and abs(gain - _UNTUNED) > 1e-6:
        yaw, words = SingleDof("yaw", "1", gain * like.lag, gain), f"its ATC_STR_RAT_FF {gain:g}"
    else:
        rate, lag = max(speed, 0.1) / like.radius if under_way else like.rate, like.lag
        yaw = SingleDof("yaw", "1", lag / rate, 1.0 / rate) if under_way else _lively("yaw", rate, lag, _BY_SQUARE)
        words = (
            f"an assumed turn rate of {math.degrees(rate):.0f} deg/s at full steering; a --model file is more accurate"
        )
    ahead = speed / math.sqrt(throttle) if speed and throttle else like.ahead
    others = {"X": _by_the_square("surge", ahead), **{f: _lively(DOF_OF[f], _FULL_SPEED[f], _SIDEWAYS) for f in "YZ"}}
    for force, (rate, lag, restoring) in _TILTING.items():
        others[force] = replace(_lively(DOF_OF[force], rate, lag), restoring=restoring)
    if like.gains != SPEED_TIME:
        others["X"] = _lively("surge", ahead, like.gains)
    return NominalPlant(yaw, speed, words, assumed=True, others=others, speed_gain=present.get("ATC_SPEED_P", 0.0))


def assumed_crafts(steered_by: SteeredBy) -> tuple[AssumedCraft, ...]:
    """Return the craft to assume for a vehicle without figures, the usual one first."""
    known = (USUAL[steered_by], *_KIN[steered_by])
    return known if steered_by != "rov" else (*known, *(replace(like, sinks=False) for like in known))


def _by_the_square(dof: str, full_speed: float) -> SingleDof:
    """Return a motion that reaches *full_speed* [m/s] at full output, with quadratic drag and the usual lag."""
    drag = full_speed**-2
    return SingleDof(dof, "1", 2.0 * drag * full_speed * SPEED_TIME, 0.0, drag)


def _lively(dof: str, full_speed: float, lag: float, share: float = 0.5) -> SingleDof:
    """Return a motion that reaches *full_speed* [m/s, rad/s] at full output with the time constant *lag* [s].

    share : fraction of quadratic drag in the drag at full speed.
    """
    linear, square = (1.0 - share) / full_speed, share / full_speed**2
    return SingleDof(dof, "1", (linear + 2.0 * square * full_speed) * lag, linear, square)
