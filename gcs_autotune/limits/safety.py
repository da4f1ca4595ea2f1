"""Where a flight ends: the room it has, and what it may run into."""

from __future__ import annotations

from gcs_autotune.limits.limit import CENTI, CM, CM_S, MS, RADIANS, Limit, Slip

__all__ = ["GUARDED"]

GUARDED = (
    Limit(
        "max-heading-excursion",
        "from the starting heading",
        "deg",
        5.0,
        720.0,
        "less trips over a compass, and two turns are as good as no limit",
        120.0,
        slips=(RADIANS, CENTI),
    ),
    Limit(
        "max-depth-excursion",
        "from the starting depth",
        "m",
        0.1,
        100.0,
        "less trips over the depth sensor, more guards nothing",
        3.0,
        slips=(CM,),
    ),
    Limit("max-depth", "greatest depth", "m", 0.1, 6000.0, "it is how deep the craft may go", unset="off", slips=(CM,)),
    Limit("min-depth", "least depth", "m", 0.0, 6000.0, "it is how near the surface it may come, 0: off", 0.0),
    Limit(
        "max-speed",
        "over ground",
        "m/s",
        0.1,
        40.0,
        "less trips over a receiver at rest, more guards nothing",
        unset="4, or 1.5 times cruise",
        slips=(CM_S,),
    ),
    Limit(
        "max-distance",
        "from the start",
        "m",
        1.0,
        10000.0,
        "less trips over a receiver at rest, and further no telemetry radio reaches",
        unset="300, or 100 s of cruise",
    ),
    Limit("max-roll", "roll", "deg", 1.0, 180.0, "less trips over a wave, more there is not", 45.0, slips=(RADIANS,)),
    Limit("max-pitch", "pitch", "deg", 1.0, 90.0, "less trips over a wave, more there is not", 45.0, slips=(RADIANS,)),
    Limit(
        "min-battery-voltage",
        "least battery voltage",
        "V",
        0.0,
        1000.0,
        "it is where the battery counts as empty, 0: off",
        unset="off",
        slips=(Slip(0.001, "in millivolts"),),
    ),
    Limit(
        "min-battery",
        "least charge remaining",
        "%",
        0.0,
        95.0,
        "it is in percent of a full battery, and more than nearly full none remains; 0: off",
        10.0,
    ),
    Limit(
        "total-time",
        "of the runs of a trial that plans itself",
        "min",
        1.0,
        240.0,
        "a run takes half a minute, and no battery lasts longer",
        30.0,
        slips=(Slip(1.0 / 60.0, "in seconds"),),
    ),
    Limit(
        "max-time",
        "of one manoeuvre",
        "s",
        5.0,
        7200.0,
        "less ends every manoeuvre before it tells anything, and for two hours none lasts",
        600.0,
        slips=(MS,),
    ),
)
