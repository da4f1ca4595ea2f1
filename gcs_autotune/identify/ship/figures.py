"""What manoeuvre is this, and its figures as IMO and ITTC name them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from gcs_autotune.errors import MissingChannel, NotInformative, UsageError
from gcs_autotune.identify.axis.record import prepare
from gcs_autotune.identify.result import Doubt
from gcs_autotune.identify.ship.by_zigzag import solve_zigzag
from gcs_autotune.identify.ship.imo import (
    ADVANCE,
    FIRST_OVERSHOOT_20,
    INITIAL_TURNING,
    TACTICAL_DIAMETER,
    Figure,
    first_overshoot_limit,
    judged,
    second_overshoot_limit,
)
from gcs_autotune.identify.ship.log import ShipLog, ship_log
from gcs_autotune.identify.ship.nomoto import nomoto_of
from gcs_autotune.identify.ship.pull_out import read_pull_out
from gcs_autotune.identify.ship.readings import Reading
from gcs_autotune.identify.ship.spiral import Spiral, read_reverse_spiral, read_spiral
from gcs_autotune.identify.ship.turning_circle import read_turning_circle
from gcs_autotune.identify.ship.zigzag import ZigZag, read_zigzag
from gcs_autotune.identify.ship.zigzag_integrals import rows_of
from gcs_autotune.registry import lookup
from gcs_autotune.trial import Trial

__all__ = ["MANOEUVRES", "Particulars", "Sheet", "ship_figures"]

NAN = math.nan


@dataclass(frozen=True, slots=True)
class Particulars:
    """The ship: ``length`` between perpendiculars [m], trial ``speed`` [m/s] when no run tells it, model ``scale``.

    ``scale``: lengths of the ship over those of the model; times grow with its square root (Froude).
    """

    length: float = NAN
    speed: float = NAN
    scale: float = 1.0

    def seconds(self, approach: float) -> float:
        """Return full-scale L/V [s], with the approach speed of the run or else the trial speed."""
        speed = approach if approach > 0.0 else self.speed
        return self.length / speed * math.sqrt(self.scale)

    def __post_init__(self) -> None:
        """Refuse what no ship has."""
        if self.length <= 0.0 or self.speed <= 0.0 or not self.scale > 0.0:
            raise UsageError("length, speed and scale of a ship are positive")


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """The figures of one manoeuvre in one run; ``verdict`` what the manoeuvre was flown to tell, or ``""``."""

    run: str
    manoeuvre: str
    title: str
    figures: tuple[Figure, ...]
    verdict: str
    doubts: tuple[Doubt, ...]

    def to_dict(self) -> dict[str, object]:
        """Return plain data."""
        return {
            "run": self.run,
            "manoeuvre": self.manoeuvre,
            "title": self.title,
            "figures": [f.to_dict() for f in self.figures],
            "verdict": self.verdict,
            "doubts": [{"slug": d.slug, "cause": d.cause, "cure": d.cure} for d in self.doubts],
        }

    def __getitem__(self, slug: str) -> Figure:
        """Return a figure by its slug."""
        return {f.slug: f for f in self.figures}[slug]


def ship_figures(run: Trial, ship: Particulars | None = None, manoeuvre: str | None = None) -> tuple[Sheet, ...]:
    """Return the figures of every manoeuvre found in a run.

    Parameters
    ----------
    run : with psi and delta (or N); r, x, y, u, v, U are used when there.
    ship : for figures in ship lengths and the criteria that depend on L/V.
    manoeuvre : one of :data:`MANOEUVRES`; None recognises it (a reverse spiral only when asked for, or when the run's
        meta data say so).

    Raises
    ------
    NotInformative
        No manoeuvre that is known; the message says what each one misses.
    MissingChannel, BadFile
        As :func:`gcs_autotune.identify.ship.log.ship_log`.
    UnknownName
        No such manoeuvre.
    """
    log, particulars = ship_log(run), ship or Particulars()
    told = run.meta.get("manoeuvre")
    asked = manoeuvre or (told if isinstance(told, str) and told in MANOEUVRES else None)
    if asked is not None:
        return (lookup(MANOEUVRES, asked, "ship manoeuvre")(run, log, particulars),)
    found: list[Sheet] = []
    missing: list[str] = []
    for name in ("zig-zag", "spiral", "turning-circle", "pull-out"):
        if found and name in ("spiral", "turning-circle"):
            continue
        try:
            found.append(MANOEUVRES[name](run, log, particulars))
        except (NotInformative, MissingChannel) as error:
            missing.append(str(error))
    if not found:
        raise NotInformative("; ".join(dict.fromkeys(missing)))
    return tuple(found)


def _lengths(reading: Reading, ship: Particulars) -> Reading:
    return reading.scaled(1.0 / ship.length, "L")


def _known(*figures: Figure) -> tuple[Figure, ...]:
    """Return the figures whose value is known."""
    return tuple(f for f in figures if math.isfinite(f.reading.value))


def _zigzag_sheet(run: Trial, log: ShipLog, ship: Particulars) -> Sheet:
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
    figures = _known(
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
            _lengths(Reading(z.distance, NAN, "m"), ship),
            INITIAL_TURNING if turning else None,
            "5.3.2",
        ),
        judged("approach", "approach speed", Reading(z.approach, NAN, "m/s")),
        *_nomoto_figures(run, ship, z),
    )
    label = f"{nominal} " if nominal else f"{_angle(helm, unit)}/{math.degrees(heading):.0f} "
    side = "" if not z.from_approach else f", first to {'starboard' if z.sense * z.executes[0].level > 0 else 'port'}"
    return Sheet(log.name, "zig-zag", f"{label}zig-zag{side}", figures, "", z.doubts)


def _angle(helm: float, unit: str) -> str:
    return f"{math.degrees(helm):.0f}" if unit == "rad" else f"{helm:.3g}"


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


def _turning_sheet(run: Trial, log: ShipLog, ship: Particulars) -> Sheet:
    c = read_turning_circle(log)
    unit = log.steering.unit
    figures = _known(
        judged("helm", "helm", Reading(abs(c.rudder), NAN, unit)),
        judged("turned", "change of heading in all", Reading(c.turned, NAN, "rad")),
        judged("advance", "advance", c.advance),
        judged("advance-lengths", "advance", _lengths(c.advance, ship), ADVANCE, "5.3.1"),
        judged("transfer", "transfer", c.transfer),
        judged("transfer-lengths", "transfer", _lengths(c.transfer, ship)),
        judged("tactical-diameter", "tactical diameter", c.tactical_diameter),
        judged(
            "tactical-diameter-lengths",
            "tactical diameter",
            _lengths(c.tactical_diameter, ship),
            TACTICAL_DIAMETER,
            "5.3.1",
        ),
        judged("time-90", "time to 90 degrees", c.time_90),
        judged("time-180", "time to 180 degrees", c.time_180),
        judged("steady-diameter", "steady turning diameter", c.steady_diameter),
        judged("approach", "approach speed", c.approach),
        judged("steady-speed", "speed in the steady turn", c.steady),
        judged("speed-loss", "part of the speed lost", c.speed_loss),
        judged("drift", "drift angle, bow inside", c.drift),
        judged("rate", "yaw rate in the steady turn", c.rate),
        *(
            (judged("current", "current taken out", Reading(c.current.speed, c.current.std, "m/s")),)
            if math.isfinite(c.current.std)
            else ()
        ),
    )
    side = "starboard" if c.starboard else "port"
    return Sheet(log.name, "turning-circle", f"turning circle to {side}", figures, "", c.doubts)


def _spiral_sheet(run: Trial, log: ShipLog, ship: Particulars) -> Sheet:
    return _sheet_of(read_spiral(run, log), log)


def _reverse_spiral_sheet(run: Trial, log: ShipLog, ship: Particulars) -> Sheet:
    return _sheet_of(read_reverse_spiral(log), log)


_STABILITY: Mapping[str, str] = {
    "stable": "directionally stable: with the helm amidships it stops turning",
    "unstable": "directionally unstable: with the helm amidships it keeps turning",
    "undecided": "directional stability cannot be told from this run",
}


_WAYS: Mapping[float, str] = {0.0: "", 1.0: ", raised", -1.0: ", lowered"}


def _sheet_of(s: Spiral, log: ShipLog) -> Sheet:
    figures = _known(
        judged("residual-rate", "yaw rate left with the helm amidships", s.residual_rate),
        judged("loop-width", "width of the loop", s.width),
        judged("slope", "yaw rate per helm, amidships", Reading(s.slope, NAN, "1/s")),
        *(
            judged(
                f"point-{i}",
                f"at helm {_angle(p.helm.value, log.steering.unit)}{_WAYS[p.way]}",
                p.rate,
            )
            for i, p in enumerate(s.points, start=1)
        ),
    )
    kind = "spiral" if s.kind == "direct" else "reverse-spiral"
    return Sheet(log.name, kind, f"{s.kind} spiral", figures, _STABILITY[s.verdict], s.doubts)


def _pull_out_sheet(run: Trial, log: ShipLog, ship: Particulars) -> Sheet:
    p = read_pull_out(run, log)
    figures = _known(
        judged("turning", "yaw rate of the turns", p.turning),
        judged("after-starboard", "rate left after turning to starboard", p.after_starboard),
        judged("after-port", "rate left after turning to port", p.after_port),
        judged("residual-rate", "half their difference", p.residual),
        judged("offset", "their mean (trim, wind)", p.offset),
    )
    return Sheet(log.name, "pull-out", "pull-out", figures, _STABILITY[p.verdict], p.doubts)


MANOEUVRES: Mapping[str, Callable[[Trial, ShipLog, Particulars], Sheet]] = {
    "zig-zag": _zigzag_sheet,
    "turning-circle": _turning_sheet,
    "spiral": _spiral_sheet,
    "reverse-spiral": _reverse_spiral_sheet,
    "pull-out": _pull_out_sheet,
}
"""Name -> reader."""
