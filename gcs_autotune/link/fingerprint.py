"""Knowing a vehicle again. Best by the unique id of its board; else by parameters that hardly two vehicles share.

Those are what a calibration left behind and which sensors were found: no tuning changes them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gcs_autotune.link.identity import VehicleIdentity
from gcs_autotune.link.parameters import Parameters, same_float32

__all__ = ["FINGERPRINT", "difference", "fingerprint_of"]

FINGERPRINT = (
    "INS_ACCOFFS_X",
    "INS_ACCOFFS_Y",
    "INS_ACC_ID",
    "COMPASS_DEV_ID",
    "BARO1_DEVID",
    "FRAME_CLASS",
    "FRAME_CONFIG",
    "CRUISE_SPEED",
    "RC1_TRIM",
    "RC3_TRIM",
    "SERVO1_TRIM",
    "SERVO1_FUNCTION",
    "SERVO3_FUNCTION",
    "BATT_CAPACITY",
)
"""Chosen: accelerometer calibration and device ids, which are a board's own; then what an owner sets once."""

_SAME_KIND = ("system", "autopilot", "vehicle_type")


def fingerprint_of(parameters: Parameters) -> dict[str, float]:
    """Return the parameters to know this vehicle again by; none when its board has told a unique id."""
    vehicle = parameters.session.vehicle
    return {} if vehicle is not None and vehicle.uid else parameters.read_existing(FINGERPRINT, as_is=True)


def difference(
    known: Mapping[str, Any], fingerprint: Mapping[str, float], found: VehicleIdentity, parameters: Parameters
) -> str:
    """Return in words why the vehicle on this link is not the *known* one; empty when it is, as far as can be told.

    known : identity as in a journal. fingerprint : its parameters, as from :func:`fingerprint_of`.
    """
    here = found.to_dict()
    kinds = [
        f"{key} {known[key]} there, {here[key]} here" for key in _SAME_KIND if known.get(key) not in (None, here[key])
    ]
    if kinds:
        return "; ".join(kinds)
    if known.get("uid"):
        same = known["uid"] == found.uid
        return "" if same else f"its board is {known['uid']} there, {found.uid or 'untold'} here"
    held = parameters.read_existing(fingerprint, as_is=True)
    strange = [
        f"{n} {v:g} there, {held[n]:g} here"
        for n, v in fingerprint.items()
        if n in held and not same_float32(held[n], v)
    ]
    gone = [n for n in fingerprint if n not in held]
    return "; ".join(strange + [f"{n} is not here" for n in gone])
