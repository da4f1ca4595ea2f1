"""What runs cannot tell, in sentences that name the parameters, the manoeuvre and the cure."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from gcs_autotune.identify.limits.findings import Direction, Unseen
from gcs_autotune.identify.limits.reach import Reach
from gcs_autotune.identify.result import Doubt
from gcs_autotune.models.coupled.derivatives import STATES, inertia_of
from gcs_autotune.sname import SIGNALS

__all__ = ["SLUG", "direction_doubt", "joined", "percent", "unseen_doubt"]

SLUG = "cannot-tell"

_HUGE = 10.0
"""Relative change from which a number says less than words."""


def direction_doubt(direction: Direction, seen: Reach) -> Doubt:
    """Return the doubt about parameters that move together."""
    names = joined(direction.members)
    if direction.scaling:
        return Doubt(
            SLUG,
            f"{names} can all be scaled together by any factor: the motion stays exactly the same",
            "no manoeuvre helps: give one of them as known, from weighing the craft or a bollard pull, or normalise",
        )
    if direction.exact and len(direction.members) == 1:
        return Doubt(SLUG, f"nothing in {_here(seen)} answers to {names}", _cure(direction.derivatives, seen))
    if direction.exact:
        cause = f"{names} cannot be told apart in {_here(seen)} at all: {_exchange(direction)} changes nothing measured"
        return Doubt(SLUG, cause, _cure(direction.derivatives, seen))
    cause = f"{names} move together in {_here(seen)}: {_exchange(direction)} stays within the noise"
    return Doubt(SLUG, cause, _cure(_leading(direction), seen))


def unseen_doubt(unseen: Unseen, seen: Reach) -> Doubt:
    """Return the doubt about a parameter whose standard error exceeds its value."""
    size = f"{unseen.value:.2g} ± {percent(unseen.std / abs(unseen.value))}" if unseen.value else "zero"
    why = _why(unseen.derivative, seen)
    if math.isinf(unseen.std):
        return Doubt(SLUG, f"{_here(seen)} cannot tell {unseen.name}{why}", _cure((unseen.derivative,), seen))
    if unseen.slight:
        return Doubt(
            SLUG,
            f"{_here(seen)} hardly sees {unseen.name} ({size}){why}; its force stays below what would be felt",
            f"leave {unseen.name} out for motion like this; otherwise {_cure((unseen.derivative,), seen)}",
        )
    return Doubt(SLUG, f"{_here(seen)} hardly sees {unseen.name} ({size}){why}", _cure((unseen.derivative,), seen))


def joined(names: Sequence[str]) -> str:
    """Return ``a, b and c``."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def percent(share: float) -> str:
    """Return a share as per cent, with two digits; past ten times, as a factor."""
    if math.isinf(share):
        return "any amount"
    if abs(share) >= _HUGE:
        return f"{share:.0f} times"
    return f"{100.0 * share:.{0 if abs(share) >= 0.095 else 1}f} %"


def _here(seen: Reach) -> str:
    return f"this {seen.kind}"


def _leading(direction: Direction) -> tuple[str, ...]:
    """Return the SNAME names of the members that change most, two at least."""
    changes = [abs(direction.changes[n]) for n in direction.members]
    floor = min(0.3 * max(changes), sorted(changes)[-2])
    return tuple(d for d, c in zip(direction.derivatives, changes, strict=True) if c >= floor)


def _exchange(direction: Direction) -> str:
    up = [n for n in direction.members if direction.changes[n] > 0.0]
    down = [n for n in direction.members if direction.changes[n] < 0.0]
    shown = {n: abs(c) for n, c in direction.changes.items()}
    if direction.exact:
        most = max(shown.values())
        shown = {n: 0.1 * c / most for n, c in shown.items()}
    grow = joined([f"{n} by {percent(shown[n])}" for n in up])
    if not down:
        return f"raising {grow}"
    return f"raising {grow} and lowering {joined([f'{n} by {percent(shown[n])}' for n in down])}"


def _letters(derivative: str) -> set[str]:
    """Return the velocities a derivative multiplies."""
    rest = re.sub(r"^[XYZKMN]_", "", derivative).removesuffix("dot")
    return {c for c in rest if c in STATES} if "_" in derivative and rest != "0" else set()


def _why(derivative: str, seen: Reach) -> str:
    parts = []
    for letter in sorted(_letters(derivative), key=STATES.index):
        if letter in seen.largest:
            value, unit = seen.largest[letter], SIGNALS[letter][0]
            if "rad" in unit:
                value, unit = math.degrees(value), unit.replace("rad", "deg")
            parts.append(f"{SIGNALS[letter][1].removesuffix(' velocity')} stays below {_above(value)} {unit}")
    return f": {joined(parts)}" if parts else ""


def _above(value: float) -> str:
    """Return *value* rounded up to two digits."""
    if value <= 0.0:
        return "0"
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return f"{math.ceil(value / step - 1e-9) * step:.2g}"


def _cure(derivatives: Sequence[str], seen: Reach) -> str:
    letters = set().union(*(_letters(d) for d in derivatives))
    inertia = any("_" in d and inertia_of(d) is not None for d in derivatives)
    lines = {re.sub(r"dot$", "", d) for d in derivatives}
    squares = {d for d in derivatives if re.search(r"_([uvwpqr])\|?\1$|_\|([uvwpqr])\|\2$", d)}
    if {"delay", "lag"} & set(derivatives):
        return "switch the input more often and record it and the motion at a higher rate"
    if {"v", "r"} <= letters and seen.kind != "zig-zag":
        return "fly a zig-zag: sway and yaw rate then change out of step"
    if {"v", "r"} <= letters:
        return "fly turns of different tightness at different speeds"
    if any(d.endswith("_0") for d in lines):
        return "fly the same manoeuvre to both sides, so that a constant force does not look like drag"
    if squares and len(derivatives) > 1 and not inertia and letters & {"v", "r"}:
        return "fly gentle and tight turns: linear and quadratic drag then part"
    if squares and len(derivatives) > 1 and not inertia:
        return "fly at clearly different speeds and coast down from the fastest: linear and quadratic drag then part"
    if inertia and len(derivatives) > 1:
        return "fly steps and reversals faster than the craft settles: inertia and drag then part"
    if letters & {"v", "r"}:
        return "fly a zig-zag or tight turns at higher speed" if seen.kind != "zig-zag" else "fly tighter turns, faster"
    if letters & {"u"}:
        return "fly throttle steps up to full speed and coast down"
    return "excite this motion by steps or pulses of the input nearest to it"
