"""Messages on why a relay experiment failed, and what to try."""

from __future__ import annotations

import math

from gcs_autotune.manoeuvres.relay_settings import RelaySettings
from gcs_autotune.sname import SIGNALS

__all__ = [
    "improper",
    "link_too_slow",
    "never_settled",
    "no_oscillation",
    "overwhelmed",
    "room_ends",
    "too_fast",
    "wrong_way",
]


def never_settled(settings: RelaySettings, scatter: float) -> str:
    """Return the message for a relay whose periods still differ by *scatter* [fraction]."""
    return (
        f"the limit cycle did not settle in {settings.most_periods} periods: the last periods differ by "
        f"{100 * scatter:.0f} % (limit {100 * settings.tolerance:.0f} %). Waves, gusts or a tether may disturb it. "
        f"Wait for calmer water, or use a larger {settings.names.output} or {settings.names.hysteresis}"
    )


def room_ends(reversals: int, where: str) -> str:
    """Return the message for a relay that has not settled at the space limit *where*."""
    return f"out of space, not settled after {reversals} reversals: {where}. The record so far is used"


def link_too_slow(settings: RelaySettings, period: float) -> str:
    """Return the message for an oscillation of *period* [s] that is too fast for the link."""
    return (
        f"the link is too slow for this craft: it oscillates with a period of {period:.2f} s. Periods below "
        f"{settings.least_period:.2f} s depend on the link's delay and sampling, not on the craft. Use a faster "
        f"link, a higher --control-rate, or a larger {settings.names.hysteresis}"
    )


def wrong_way(settings: RelaySettings, output: float) -> str:
    """Return the message for a first relay pulse that moved the craft in the wrong direction."""
    did = "turned" if SIGNALS[settings.signal].angular else "moved"
    return (
        f"{output:.2f} of full {settings.force} output {did} the craft the wrong way. "
        "The actuator is reversed (check SERVOn_REVERSED or MOT_n_DIRECTION), or a constant disturbance is "
        "stronger"
    )


def overwhelmed(settings: RelaySettings, output: float) -> str:
    """Return the message for a signal that keeps drifting against the relay."""
    return (
        f"a constant disturbance seems stronger than {output:.2f} of full {settings.force} output: "
        f"{settings.signal} keeps drifting. Trim the craft, wait for less wind or current, or use a "
        f"larger {settings.names.output}"
    )


def no_oscillation(settings: RelaySettings, output: float) -> str:
    """Return the message for a craft whose signal did not reach the hysteresis in time."""
    return (
        f"no oscillation at relay output {output:.2f}: the craft did not cross the hysteresis within "
        f"{settings.patience:.0f} s. Check that the actuator moves the craft, or use a larger {settings.names.output} "
        f"or a smaller {settings.names.hysteresis}"
    )


def too_fast(settings: RelaySettings, output: float, least_ticks: float, tick: float) -> str:
    """Return the message for a half period that is shorter than *least_ticks* control ticks of *tick* [s]."""
    return (
        f"the craft crosses the hysteresis within {least_ticks:g} control ticks of {tick:.2f} s at "
        f"relay output {output:.2f}, too fast for the relay. Use a higher --control-rate, a larger "
        f"{settings.names.hysteresis} or a smaller {settings.names.output}"
    )


def improper(settings: RelaySettings, output: float) -> str:
    """Return the message for an oscillation that does not fulfil condition (7.12) of Miskovic2010."""
    return (
        f"the oscillation did not fulfil condition (7.12), x_a* + |x_0| < X_m, up to relay output "
        f"{output:.2f}. Use a larger {settings.names.output} or a smaller {settings.names.hysteresis}"
    )


def no_wall(distance: float, least: float) -> str:
    """Return the message for a relay on the distance to a wall that ends because the wall is too near or not
    detected."""
    if math.isfinite(distance):
        return (
            f"the wall ahead is {distance:.2f} m away, nearer than {least:g} m (--least-distance). Start further away"
        )
    return (
        "the rangefinder stopped reporting the distance ahead. Face the wall at a right angle, within the sensor's "
        "range"
    )
