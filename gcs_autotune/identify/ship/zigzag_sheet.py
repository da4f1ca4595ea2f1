"""The sheet of a zig-zag: overshoot angles, times, initial turning, K and T."""

from __future__ import annotations

import math

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.axis.record import prepare
from gcs_autotune.identify.ship.by_zigzag import solve_zigzag
from gcs_autotune.identify.ship.imo import (
    FIRST_OVERSHOOT_20,
    INITIAL_TURNING,
    Figure,
    first_overshoot_limit,
    judged,
    second_overshoot_limit,
)
from gcs_autotune.identify.ship.log import ShipLog
from gcs_autotune.identify.ship.nomoto import nomoto_of
from gcs_autotune.identify.ship.readings import Reading
from gcs_autotune.identify.ship.sheet import Particulars, Sheet, helm_text, in_lengths, known
from gcs_autotune.identify.ship.zigzag import ZigZag, read_zigzag
from gcs_autotune.identify.ship.zigzag_integrals import rows_of
from gcs_autotune.trial import Trial

__all__ = ["zigzag_sheet"]

NAN = math.nan


def zigzag_sheet(run: Trial, log: ShipLog, ship: Particulars) -> Sheet:
    """Return the figures of a zig-zag, with Nomoto's indices from the same run."""
    z = read_zigzag(log)
    helm, heading = z.helm, z.heading.value
    nominal = _nominal(z)
    seconds = ship.seconds(z.approach)
    first_limit = first_overshoot_limit(seconds) if nominal == "10/10" else NAN
    first_limit = FIRST_OVERSHOOT_20 if nominal == "20/20" else first_limit
    second_limit = second_overshoot_limit(seconds) if nominal == "10/10" else NAN
    unit = "rad" if log.steering.unit == "rad" else log.steering.unit
    overs = [
        judged("first-overshoot", "first overshoot angle", z.overshoots[0], first_limit, "5.3.3"),
        *(
            [judged("second-overshoot", "second overshoot angle", z.overshoots[1], second_limit, "5.3.3")]
            if len(z.overshoots) > 1
            else []
        ),
        *(judged(f"overshoot-{i}", f"overshoot angle {i}", o) for i, o in enumerate(z.overshoots[2:], start=3)),
    ]
    turning = nominal == "10/10"
    figures = known(
        judged("helm", "helm", Reading(helm, NAN, unit)),
        judged("heading", "change of heading at the executes", z.heading),
        *overs,
        judged("initial-turning-time", "initial turning time", z.initial_turning_time),
        judged("time-to-check", "time to check yaw", z.times_to_check[0]),
        judged("reach", "reach (back on the first heading)", z.reach),
        judged("period", "period", z.period),
        judged("initial-turning", "distance to the second execute", Reading(z.distance, NAN, "m")),
        judged(
            "initial-turning-lengths",
            "distance to the second execute",
            in_lengths(Reading(z.distance, NAN, "m"), ship),
            INITIAL_TURNING if turning else None,
            "5.3.2",
        ),
        judged("approach", "approach speed", Reading(z.approach, NAN, "m/s")),
        *_nomoto_figures(run, ship, z),
    )
    label = f"{nominal} " if nominal else f"{helm_text(helm, unit)}/{math.degrees(heading):.0f} "
    side = "" if not z.from_approach else f", first to {'starboard' if z.sense * z.executes[0].level > 0 else 'port'}"
    return Sheet(log.name, "zig-zag", f"{label}zig-zag{side}", figures, "", z.doubts)


def _nominal(z: ZigZag) -> str:
    """Return "10/10" or "20/20" when helm and heading are those to a tenth and a sixth, else an empty string."""
    for angle in (10.0, 20.0):
        near = math.radians(angle)
        if abs(z.helm - near) < 0.1 * near and abs(z.heading.value - near) < near / 6.0 and z.input == "delta":
            return f"{angle:.0f}/{angle:.0f}"
    return ""


def _nomoto_figures(run: Trial, ship: Particulars, z: ZigZag) -> tuple[Figure, ...]:
    every = [rows for record in prepare(run, "yaw") if (rows := rows_of(record)) is not None]
    if not every:
        return ()
    try:
        theta, covariance, _, _ = solve_zigzag(every, "linear")
    except NotInformative:
        return ()
    speed = z.approach if z.approach > 0.0 else ship.speed
    made = nomoto_of(theta, covariance, ship.length, speed)
    return (
        judged("K", "Nomoto K", made.K.scaled(z.sense, "1/s")),
        judged("T", "Nomoto T", made.T),
        judged("K-prime", "Nomoto K' = K L/U", made.K_prime.scaled(z.sense, "1")),
        judged("T-prime", "Nomoto T' = T U/L", made.T_prime),
    )
