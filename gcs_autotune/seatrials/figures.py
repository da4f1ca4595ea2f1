"""Recognise the manoeuvre of a run and calculate its figures as defined by IMO and ITTC."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from gcs_autotune.crosscheck import contradictions
from gcs_autotune.errors import MissingChannel, NotInformative
from gcs_autotune.identify import CONTRADICTION, Doubt
from gcs_autotune.identify.open_loop import Reading, ShipLog, ship_log
from gcs_autotune.registry import lookup, same_name
from gcs_autotune.seatrials.closed_loop import closed_loop_sheet
from gcs_autotune.seatrials.criteria import (
    ADVANCE,
    TACTICAL_DIAMETER,
    Particulars,
    Shape,
    Sheet,
    helm_text,
    in_lengths,
    judged,
    known,
    per_helm,
    per_helm_words,
)
from gcs_autotune.seatrials.free_decay import free_decay_sheet
from gcs_autotune.seatrials.layered import layered_sheet
from gcs_autotune.seatrials.spiral import Spiral, read_pull_out, read_reverse_spiral, read_spiral
from gcs_autotune.seatrials.stopping import stopping_sheet
from gcs_autotune.seatrials.turning_circle import TurningCircle, read_turning_circle
from gcs_autotune.seatrials.zigzag import zigzag_sheet
from gcs_autotune.trial import Trial

__all__ = ["MANOEUVRES", "ship_figures"]

NAN = math.nan


def ship_figures(run: Trial, ship: Particulars | None = None, manoeuvre: str | None = None) -> tuple[Sheet, ...]:
    """Return one sheet of figures for every manoeuvre that *run* contains.

    Parameters
    ----------
    run : run with psi and delta (or N). The channels r, x, y, u, v and U are used if present.
    ship : data of the ship, for figures in ship lengths and criteria that depend on L/V.
    manoeuvre : name in :data:`MANOEUVRES`. None recognises the manoeuvre. A reverse spiral or a stop is recognised only
        from the run's metadata.

    Raises
    ------
    NotInformative
        The run contains no known manoeuvre. The message states what each manoeuvre lacks.
    MissingChannel, BadFile
        :func:`gcs_autotune.identify.open_loop.ship_log.ship_log` raised the error.
    UnknownName
        There is no such manoeuvre.
    """
    doubts = tuple(Doubt(CONTRADICTION, c.cause, c.cure) for c in contradictions(run))
    return tuple(replace(sheet, doubts=(*doubts, *sheet.doubts)) for sheet in _figures(run, ship, manoeuvre))


def _figures(run: Trial, ship: Particulars | None, manoeuvre: str | None) -> tuple[Sheet, ...]:
    particulars = ship or Particulars()
    recorded = run.meta.get("manoeuvre")
    chosen = manoeuvre or next((name for name in MANOEUVRES if same_name(name, recorded)), None)
    if chosen is not None:
        sheet = lookup(MANOEUVRES, chosen, "ship manoeuvre")(run, particulars)
        return (sheet, *(() if manoeuvre or chosen not in ENDS_IN else _all_of(ENDS_IN[chosen], run, particulars)[0]))
    ship_log(run)  # its errors are about the run, not about one manoeuvre or another
    found, missing = _all_of(("zig-zag", "spiral", "turning-circle", "pull-out"), run, particulars)
    if not found:
        raise NotInformative("; ".join(dict.fromkeys(missing)))
    return tuple(found)


def _all_of(names: Sequence[str], run: Trial, ship: Particulars) -> tuple[list[Sheet], list[str]]:
    """Return the sheets of the manoeuvres in a run, and the reasons why the others are not recognised."""
    found: list[Sheet] = []
    missing: list[str] = []
    for name in names:
        if found and name in ("spiral", "turning-circle"):
            continue
        try:
            found.append(MANOEUVRES[name](run, ship))
        except (NotInformative, MissingChannel) as error:
            missing.append(str(error))
    return found, missing


def _turning_sheet(run: Trial, ship: Particulars) -> Sheet:
    log = ship_log(run)
    c = read_turning_circle(log, [m.t for m in run.marks if m.kind == "execute"])
    unit = log.steering.unit
    advance, diameter = in_lengths(c.advance, ship), in_lengths(c.tactical_diameter, ship)
    figures = known(
        judged("helm", "helm", Reading(abs(c.rudder), NAN, unit)),
        judged("turned", "total heading change", Reading(c.turned, NAN, "rad")),
        judged("advance", "advance", c.advance),
        judged("advance-lengths", "advance", advance, _turning_limit(c, unit, advance, ADVANCE), "5.3.1"),
        judged("transfer", "transfer", c.transfer),
        judged("transfer-lengths", "transfer", in_lengths(c.transfer, ship)),
        judged("tactical-diameter", "tactical diameter", c.tactical_diameter),
        judged(
            "tactical-diameter-lengths",
            "tactical diameter",
            diameter,
            _turning_limit(c, unit, diameter, TACTICAL_DIAMETER),
            "5.3.1",
        ),
        judged("time-90", "time to 90 degrees", c.time_90),
        judged("time-180", "time to 180 degrees", c.time_180),
        judged("steady-diameter", "steady turning diameter", c.steady_diameter),
        judged("approach", "approach speed", c.approach),
        judged("steady-speed", "speed in the steady turn", c.steady),
        judged("speed-loss", "speed loss", c.speed_loss),
        judged("drift", "drift angle, bow inside", c.drift),
        judged("rate", "yaw rate in the steady turn", c.rate),
        *(
            (judged("current", "estimated current (removed)", Reading(c.current.speed, c.current.std, "m/s")),)
            if math.isfinite(c.current.std)
            else ()
        ),
    )
    side = "starboard" if c.starboard else "port"
    return Sheet(log.name, "turning-circle", f"turning circle to {side}", figures, "", c.doubts, _circle(c))


FULL_RUDDER = {"rad": math.radians(35.0), "1": 1.0}
"""Rudder angle of the turning test, per unit of the helm. Source: MSC.137(76), 4.2: 35 degrees, or the greatest that
the speed allows.
"""
NEARLY_FULL = 0.95
"""Least helm, relative to :data:`FULL_RUDDER`, of a turning test. Project choice."""


def _turning_limit(c: TurningCircle, unit: str, reading: Reading, limit: float) -> float | None:
    """Return the *limit* of the turning test for *reading*, or None if the helm was too small to fail it.

    A craft that meets the limit with a smaller helm also meets it with full helm.
    """
    full = abs(c.rudder) >= NEARLY_FULL * FULL_RUDDER.get(unit, 0.0)
    return limit if full or reading.value <= limit else None


def _circle(c: TurningCircle) -> Shape:
    """Return the track from the execute, with the points of 90 and 180 degrees."""
    ahead, abeam = c.track
    points = []
    if math.isfinite(c.advance.value) and math.isfinite(c.transfer.value):
        points.append((f"90°: advance {c.advance.value:.3g} m", c.transfer.value, c.advance.value))
    if math.isfinite(c.tactical_diameter.value):
        nearest = int(np.argmin(np.abs(abeam - c.tactical_diameter.value) - 1e-9 * ahead))
        label = f"180°: tactical diameter {c.tactical_diameter.value:.3g} m"
        points.append((label, c.tactical_diameter.value, float(ahead[nearest])))
    return Shape("track", (("track", abeam, ahead),), tuple(points))


def _spiral_sheet(run: Trial, ship: Particulars) -> Sheet:
    log = ship_log(run)
    return _sheet_of(read_spiral(run, log), log)


def _reverse_spiral_sheet(run: Trial, ship: Particulars) -> Sheet:
    log = ship_log(run)
    return _sheet_of(read_reverse_spiral(run, log), log)


_STABILITY: Mapping[str, str] = {
    "stable": "directionally stable: with the helm amidships a turn dies out",
    "unstable": "directionally unstable: with the helm amidships the craft keeps turning",
    "undecided": "directional stability: not determined by this run",
}


_WAYS: Mapping[float, str] = {0.0: "", 1.0: ", raised", -1.0: ", lowered"}


def _sheet_of(s: Spiral, log: ShipLog) -> Sheet:
    figures = known(
        judged("residual-rate", "half the height of the hysteresis loop", s.residual_rate),
        judged("loop-width", "width of the hysteresis loop", s.width),
        judged(
            "slope",
            f"yaw rate {per_helm_words(log.steering.unit)}, at amidships",
            Reading(s.slope, NAN, per_helm("rad/s", log.steering.unit)),
        ),
        *(
            judged(
                f"point-{i}",
                f"at helm {helm_text(p.helm.value, log.steering.unit)}{_WAYS[p.way]}",
                p.rate,
            )
            for i, p in enumerate(s.points, start=1)
        ),
    )
    kind = "spiral" if s.kind == "direct" else "reverse-spiral"
    return Sheet(
        log.name, kind, f"{s.kind} spiral", figures, _STABILITY[s.verdict], s.doubts, _curve(s, log.steering.unit)
    )


def _curve(s: Spiral, unit: str) -> Shape:
    """Return the yaw rate over the helm, one line per direction in which the helm was changed."""
    lines = []
    for way, name in _CURVES.items():
        chosen = [p for p in s.points if p.way == way]
        if s.kind == "direct":
            chosen.sort(key=lambda p: p.helm.value)
        if chosen:
            helm, rate = np.array([p.helm.value for p in chosen]), np.array([p.rate.value for p in chosen])
            lines.append((name, helm, rate))
    return Shape("curve", tuple(lines), (), unit)


_CURVES: Mapping[float, str] = {0.0: "steady turn rate", 1.0: "helm raised", -1.0: "helm lowered"}


def _zigzag_sheet(run: Trial, ship: Particulars) -> Sheet:
    return zigzag_sheet(run, ship_log(run), ship)


def _pull_out_sheet(run: Trial, ship: Particulars) -> Sheet:
    log = ship_log(run)
    p = read_pull_out(run, log)
    figures = known(
        judged("turning", "yaw rate of the turns", p.turning),
        judged("after-starboard", "residual rate after a turn to starboard", p.after_starboard),
        judged("after-port", "residual rate after a turn to port", p.after_port),
        judged("residual-rate", "half the difference of the residual rates", p.residual),
        judged("offset", "mean of the residual rates (trim, wind)", p.offset),
    )
    return Sheet(log.name, "pull-out", "pull-out", figures, _STABILITY[p.verdict], p.doubts)


MANOEUVRES: Mapping[str, Callable[[Trial, Particulars], Sheet]] = {
    "zig-zag": _zigzag_sheet,
    "turning-circle": _turning_sheet,
    "spiral": _spiral_sheet,
    "reverse-spiral": _reverse_spiral_sheet,
    "pull-out": _pull_out_sheet,
    "stopping": stopping_sheet,
    "set-point-relay": closed_loop_sheet,
    "hand-release": free_decay_sheet,
    **dict.fromkeys(("hover", "goto", "orientation", "trajectory", "plane", "follow-wall"), layered_sheet),
}
"""Name of a manoeuvre -> function that returns its sheet."""

ENDS_IN: Mapping[str, Sequence[str]] = {"turning-circle": ("pull-out",)}
"""Manoeuvre -> manoeuvres with which a complete run of it ends."""
