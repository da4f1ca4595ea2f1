"""Convert parameters from before SERVOn_FUNCTION to the names used by the servo map.

Up to ArduRover 3.1 an output used the limits of the RC channel with its number (``RCn_MIN``, ``RCn_REV``). Which output
steers was fixed in the firmware. :func:`with_outputs` adds the SERVOn parameters that mean the same.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from gcs_autotune.firmware.aliases import FIXED_OUTPUTS
from gcs_autotune.firmware.names import Names
from gcs_autotune.firmware.profile import Firmware, FixedOutputs
from gcs_autotune.firmware.values import checked

__all__ = ["Outputs", "with_outputs"]

_VERSION = re.compile(r"\bv?(\d{1,2})\.(\d{1,3})", re.IGNORECASE)
_NUMBERS = range(1, 17)


@dataclass(frozen=True, slots=True)
class Outputs:
    """Result of :func:`with_outputs` for the parameters of a vehicle.

    Attributes
    ----------
    values : parameters under canonical names.
    names : canonical name -> name on this vehicle, for messages.
    assumed : parameters (own name) of the outputs in use that were missing, with the default taken.
    """

    values: Mapping[str, float]
    names: Names = field(default_factory=Names)
    assumed: Mapping[str, float] = field(default_factory=dict)


def with_outputs(values: Mapping[str, float], firmware: Firmware, banner: str = "") -> Outputs:
    """Return *values* with the equivalent SERVOn parameters, for firmware versions without these.

    banner : the firmware's version text, e.g. ``APM:Rover v3.1``; used if no parameter shows the version.

    Raises
    ------
    PreconditionFailed
        RCMAP_* has an implausible value.
    """
    old = firmware.fixed_outputs
    if old is None or not _is_old(values, old, banner):
        return Outputs(values)
    channels = {
        force: int(checked(place, values[place])) if (place := firmware.rc_map[force]) in values else n
        for force, n in firmware.channels.items()
    }
    wired = old.skid if values.get(old.skid_parameter) else {f: n for n, f in firmware.servo_functions.items()}
    functions = {channels[force]: float(number) for force, number in wired.items()}
    spelled, found, assumed = {}, dict(values), {}
    for n in _NUMBERS:
        for template, (alias, default) in FIXED_OUTPUTS.items():
            name, own = template.format(n=n), alias.name.format(n=n)
            if own in values or n in functions:
                spelled[name] = replace(alias, name=own)
                found[name] = alias.to_canonical(values.get(own, default))
                if own not in values and not name.endswith("_FUNCTION"):
                    assumed[own] = default
        if f"RC{n}_REV" in values:
            found[f"RC{n}_REVERSED"] = found[f"SERVO{n}_REVERSED"]
    found.update({f"SERVO{n}_FUNCTION": number for n, number in functions.items()})
    return Outputs(found, Names(spelled), assumed)


def _is_old(values: Mapping[str, float], old: FixedOutputs, banner: str) -> bool:
    if not values or any(name.startswith("SERVO") for name in values):
        return False
    version = _VERSION.search(banner)
    is_early = version is not None and (int(version[1]), int(version[2])) <= old.last
    return is_early or any(re.fullmatch(old.marks, name) for name in values)
