"""Describe contradictions as text: the difference, the column that is more likely wrong, checks and remedy."""

from __future__ import annotations

import math
from collections.abc import Mapping

from gcs_autotune.crosscheck.agreement import Comparison
from gcs_autotune.crosscheck.contradiction import Contradiction

__all__ = ["contradiction_from", "unit_of"]

UNITS: Mapping[str, Mapping[float, str]] = {
    "angle": {180.0 / math.pi: "degrees", 2.0 * math.pi: "revolutions", 60.0: "per minute"},
    "length": {1000.0: "mm", 100.0: "cm", 3.6: "km/h", 1.0 / 0.3048: "feet", 3600.0 / 1852.0: "knots"},
}
"""Kind of quantity -> factor that a wrong unit causes -> name of that unit."""
CLOSE = 0.08
"""Largest relative difference of a ratio from the factor of a unit for which the unit is reported. Project choice."""
EXACT = 0.02
"""Largest relative difference from the factor of a unit if the ratio is known more accurately.

Project choice: 2, for example, is not knots.
"""
SAME = 0.01
"""Relative difference below which a unit is preferred to others with similar factors, such as 60 and 57.3.

Project choice.
"""
MISTAKABLE = 5.0
"""Ratio below which other causes than a wrong unit are possible. Project choice."""
_LENGTHS = ("x", "y", "z", "U", "u", "v", "w")

_CHECKS: Mapping[str, str] = {
    "psi": "the compass (COMPASS_ORIENT, its calibration, iron and motor currents near it)",
    "r": "the turn rate (its unit and scale, AHRS_ORIENTATION, the mount of the gyro)",
    "phi": "the roll angle (AHRS_ORIENTATION)",
    "p": "the roll rate (its unit and scale, AHRS_ORIENTATION)",
    "theta": "the pitch angle (AHRS_ORIENTATION)",
    "q": "the pitch rate (its unit and scale, AHRS_ORIENTATION)",
    "z": "the depth sensor (its unit, BARO_SPEC_GRAV, water in the sensor)",
    "w": "the vertical speed (its unit and sign, down is positive)",
    "x, y": "the positions (the GPS, the unit and the projection of x and y)",
    "U": "the speed (its unit, and whether it is over ground)",
    "u": "the speed (its unit, the scale of the log, and whether it is over ground)",
    "u, v": "the speeds (their unit, the scale of the log, and whether they are over ground)",
}


def contradiction_from(
    run: str, position: str, rate: str, verb: str, comparison: Comparison, suspect: str
) -> Contradiction:
    """Return the result of *comparison* as a :class:`Contradiction`.

    verb : text for the motion of the position.
    """
    does = verb if "," not in position else verb.removesuffix("s")
    statement, value, std, kind = _statement(position, rate, does, comparison)
    factor, unit = unit_of(position, comparison) if kind in ("factor", "sign") else (1.0, "")
    cause = f"{statement} (run '{run}')"
    if unit:
        sure = f"so one of the columns is in {unit} and its header states another unit"
        perhaps = f"so perhaps one of the columns is in {unit}"
        cause += f". The factor of {unit} is {factor:.3g}, {sure if factor > MISTAKABLE else perhaps}"
    elif suspect and kind == "still":
        cause += f". {suspect} is more likely wrong, from a dead, disturbed or wrongly scaled sensor"
    elif suspect:
        other = rate if suspect == position else position
        cause += f". {suspect} is more likely wrong, because the rest of the run agrees with {other}"
    else:
        cause += f". Nothing else in the run shows which of {position} and {rate} is wrong"
    pair, columns = f"{position} against {rate}", _columns(position, rate)
    return Contradiction(pair, kind, value, std, suspect, columns, cause, _cure(position, rate, suspect, kind), unit)


def _statement(position: str, rate: str, does: str, comparison: Comparison) -> tuple[str, float, float, str]:
    when = "" if comparison.during is None else f" from {comparison.during[0]:.0f} to {comparison.during[1]:.0f} s"
    if comparison.kind == "still-rate":
        stands = "stands" if "," not in rate else "stand"
        return f"{rate} {stands} still{when} while {position} {does}", 0.0, comparison.std, "still"
    if comparison.kind == "still-position":
        still = "stands" if "," not in position else "stand"
        moves = "turns" if does.startswith("turn") else "moves"
        return f"{position} {still} still{when} while {rate} {moves}", comparison.factor, comparison.std, "still"
    if comparison.kind == "unrelated":
        return f"{position} and {rate} change, but independently of each other", math.nan, math.nan, "unrelated"
    integrates = "integrates" if "," not in rate else "integrate"
    if comparison.kind == "shift":
        late = f"{abs(comparison.shift):.2g} s {'later' if comparison.shift > 0.0 else 'earlier'}"
        does_not = f"{position} {does} {late} than {rate} {integrates} to (+- {max(comparison.shift_std, 0.01):.2g} s)"
        return does_not, comparison.shift, comparison.shift_std, "shift"
    digits = (
        f"{comparison.factor:.3g} times as much as {rate} {integrates} to (+- "
        f"{max(comparison.std, 0.0005 * abs(comparison.factor)):.1g})"
    )
    if comparison.kind == "sign":
        return f"{position} {does} {digits}, so they have opposite signs", comparison.factor, comparison.std, "sign"
    return f"{position} {does} {digits}", comparison.factor, comparison.std, "factor"


def unit_of(position: str, comparison: Comparison) -> tuple[float, str]:
    """Return the factor and the name of the unit that explains *comparison*, or (1, "") if there is none."""
    kind = "length" if position[0] in _LENGTHS else "angle"
    size = abs(comparison.factor)
    own = 2.0 * comparison.std / size
    known = [(abs(size / value - 1.0), f, unit) for f, unit in UNITS[kind].items() for value in (f, 1.0 / f)]
    near = [k for k in known if k[0] < (CLOSE if k[1] > MISTAKABLE else min(CLOSE, max(EXACT, own)))]
    best = next(iter([k for k in near if k[0] < SAME] or near), (0.0, 1.0, ""))
    return best[1], best[2]


def _cure(position: str, rate: str, suspect: str, kind: str) -> str:
    checks = [_CHECKS[n] for n in ((suspect,) if suspect else (position, rate)) if n in _CHECKS]
    check = f"check {' and '.join(checks)}"
    if kind == "shift":
        check = f"check the stamps of {position} and {rate}, and the filters of both"
        if position == "psi":
            check = f"check the stamps and filters of psi and {rate}, and whether motor currents deflect the compass"
    kept = rate if suspect == position else position
    wrong = suspect or "the wrong column"
    use = f"--use {kept}" if suspect and "," not in kept else "--use with the names of the other columns"
    return f"{check}. Until then omit {wrong} ({use})"


def _columns(*names: str) -> tuple[str, ...]:
    return tuple(part.strip() for name in names for part in name.split(","))
