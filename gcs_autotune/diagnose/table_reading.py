"""The physical reading of what a table of parameters shows."""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["reading_of_level", "reading_of_order", "reading_of_sign", "reading_of_trend"]

ALIKE = 0.5
"""Shares are alike when the smaller is at least this part of the larger, and of one sign."""


def reading_of_level(shares: Mapping[str, float], answers: Mapping[str, str], *, smallest: bool) -> str:
    """Return what it means that *shares* of inertia and drag are off at one input level."""
    off = [n for n, a in answers.items() if a == "yes"]
    if not off:
        hidden = [n for n, a in answers.items() if a == "cannot tell"]
        return f"the scatter of {' and '.join(hidden)} hides a difference of this size" if hidden else ""
    both = [shares["inertia"], shares["drag"]]
    if min(both) * max(both) > 0.0 and min(map(abs, both)) >= ALIKE * max(map(abs, both)):
        if both[0] > 0.0:
            lost = 1.0 - 1.0 / (1.0 + sum(both) / 2.0)
            cause = "dead zone or static friction" if smallest else "saturation, sagging voltage, a stalled propeller"
            return f"inertia and drag alike: {100 * lost:.0f} % of the stated thrust does not arrive ({cause})"
        return "inertia and drag alike: more thrust than stated (wrong calibration of this level)"
    if off == ["inertia"]:
        return (
            "inertia alone: another load or trapped water in these runs, or an actuator that needs longer to reverse "
            "at this input (rate limit); not the thrust, or drag would be off alike"
        )
    if off == ["drag"]:
        more = shares["drag"] > 0.0
        if smallest and more:
            return "drag alone: a linear share of drag, or friction, that the quadratic law does not have"
        return "drag alone: another drag law than assumed, or water that moved in these runs"
    return "inertia and drag are off in different ways: no single cause known here does that"


def reading_of_sign(shares: Mapping[str, float], answers: Mapping[str, str]) -> str:
    """Return what a dependence on the input's sign means."""
    off = [n for n, a in answers.items() if a == "yes"]
    if not off:
        return "no asymmetry that these pairs are sure of"
    both = [shares["inertia"], shares["drag"]]
    if len(off) == 2 and both[0] * both[1] > 0.0:
        return "inertia and drag alike: the actuator pushes less one way (asymmetric thrust)"
    if off == ["drag"]:
        return "drag alone: a steady moment (trim, tether, current) or a hull that is not symmetric"
    return "inertia alone, which no asymmetric thrust does: how the transient was read, or a steady moment"


def reading_of_order(order: float, half: float) -> str:
    """Return what the exponent of rate in the drag force means."""
    told = f"the drag force goes as rate to the power {order:.2f} +- {half:.2f}: "
    if abs(order - 2.0) <= half and abs(order - 1.0) <= half:
        return told + "linear or quadratic, these rows cannot tell"
    if abs(order - 2.0) <= half:
        return told + "quadratic drag"
    if abs(order - 1.0) <= half:
        return told + "linear drag"
    if 1.0 < order < 2.0:
        return told + "a linear and a quadratic share; either alone drifts with the input"
    return told + "neither linear nor quadratic"


def reading_of_trend(slopes: Mapping[str, float], answers: Mapping[str, str]) -> str:
    """Return what it means that inertia or drag go with the size of the input."""
    off = [n for n, a in answers.items() if a == "yes"]
    if not off:
        return "no trend that these levels are sure of"
    if len(off) == 2 and slopes["inertia"] * slopes["drag"] > 0.0:
        if slopes["drag"] < 0.0:
            return "both fall with the input: part of small commands does not arrive (dead zone, static friction)"
        return "both rise with the input: the thrust falls behind the command (saturation, thrust not linear)"
    if "drag" in off and slopes["drag"] < 0.0:
        told = "the quadratic drag falls with the input: a linear share, or friction, that its law does not have"
        return told if off == ["drag"] else told + "; the inertia rises: a delay or lag not accounted for"
    if "drag" in off:
        return "the drag rises with the input: a law steeper than assumed, or thrust that falls behind the command"
    if slopes["inertia"] > 0.0:
        return "the inertia rises with the input: an actuator that needs longer for larger reversals (rate limit)"
    return "the inertia falls with the input: part of small commands does not arrive, or a drag law that shifts the fit"
