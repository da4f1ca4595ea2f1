"""Cases of kind ``rough``: one, two or no hidden effects, a drifting moment, and further disturbances.

Each of :data:`CIRCUMSTANCES` is present or absent. ``waves``: a moment in a narrow frequency band, and a motion of the
bow. ``lag``: the heading is late, or filtered in one direction. ``driving``: a person steers instead of flying
manoeuvres. ``days``: trim and thrust differ between runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.blind.craft import Craft, draw_craft, log_uniform
from benchmarks.blind.flying import driving
from benchmarks.blind.process_noise import CALM, drawn_weather, smoothed
from benchmarks.blind.secret import Hidden
from benchmarks.blind.sizes import RECIPES
from benchmarks.blind.voyage import Case, Flown, Voyage, case_of, draw_voyage, fly

__all__ = ["CIRCUMSTANCES", "EXCUSED", "PAIR", "draw_rough"]

Rng = np.random.Generator

CIRCUMSTANCES = {"waves": 0.4, "lag": 0.3, "driving": 0.4, "days": 0.4}
"""Further disturbance -> its probability. Project choice."""

PAIR = "pair"
"""Name of a case with two effects."""

FAMILIES = (
    ("input-delay", "actuator-lag"),
    ("dead-zone", "asymmetric-thrust", "saturation", "quadratic-actuator"),
    ("input-bias",),
    ("quadratic-drag",),
)
"""Groups of similar effects. The two effects of a pair are from different groups."""

EXCUSED = {
    "input-delay": "except for noise, a late heading looks like the result of late commands",
    "actuator-lag": "except for noise, a heading filtered in one direction looks like the result of filtered commands",
}
"""Causes that do not count as wrong if the heading lags -> reason."""

LEAST_NOISE, MOST_NOISE = 0.003, 0.01
"""Range of the noise of the heading, as a fraction of its motion. Project choice."""


def draw_rough(rng: Rng, slug: str) -> Case | None:
    """Return a case of the effect *slug*, of a :data:`PAIR`, or of none; None where it cannot be."""
    craft = draw_craft("yaw", rng)
    slugs = [] if slug == CALM else _two(rng) if slug == PAIR else [slug]
    hidden = [RECIPES[s].draw(rng, craft) for s in slugs]
    here = tuple(c for c, share in CIRCUMSTANCES.items() if rng.random() < share)
    voyage = draw_voyage(rng, hidden or [Hidden("", "", {}, craft)])
    around = [Hidden("weather", craft.input, drawn_weather(rng, craft), craft)]
    before: list[Hidden] = []
    if "driving" in here:
        voyage, before = _driven(rng, voyage)
    if "days" in here:
        around += _days(rng, craft, len(voyage.commands))
    if "waves" in here:
        around.append(_waves(rng, craft))
    if "lag" in here:
        around.append(_lag(rng, craft))
    noise = log_uniform(rng, LEAST_NOISE, MOST_NOISE)
    levels = {"psi": noise * craft.scale["psi"]}
    width = 1 if "lag" in here else int(rng.integers(1, 4))
    everything = (*before, *hidden, *around)
    flown = Flown(voyage, everything, tuple(fly(voyage, everything, levels)))
    files = [smoothed(f, width) for f in flown.files]
    share = around[0].values["spread"] / craft.full[craft.input]
    case = case_of(rng, voyage, hidden, files, share, noise, levels, keeps=1.0)  # trims come to nothing over all runs
    return replace(case, runs=(*case.runs, *case.unseen), unseen=(), circumstances=here, flown=flown)


def _two(rng: Rng) -> Sequence[str]:
    one, two = rng.choice(len(FAMILIES), 2, replace=False)
    return [str(rng.choice(FAMILIES[i])) for i in (one, two)]


def _waves(rng: Rng, craft: Craft) -> Hidden:
    """Waves of 1.6 to 12 s, whatever the craft; a moment of 5 to 50 % of full command, a swing of 0.2 to 3 deg."""
    values = {
        "moment": craft.full[craft.input] * log_uniform(rng, 0.05, 0.5),
        "swing": np.radians(log_uniform(rng, 0.2, 3.0)),
        "frequency": log_uniform(rng, 0.5, 4.0),
        "damping": log_uniform(rng, 0.05, 0.3),
    }
    return Hidden("waves", craft.input, values, craft)


def _lag(rng: Rng, craft: Craft) -> Hidden:
    """A tenth of a second to one, of a quick craft no more than two time constants; late, or filtered."""
    seconds = min(log_uniform(rng, 0.1, 1.0), 2.0 * craft.pace)
    late = rng.random() < 0.5
    return Hidden("lag", craft.input, {"delay": seconds * late, "time_constant": seconds * (not late)}, craft)


def _days(rng: Rng, craft: Craft, runs: int) -> list[Hidden]:
    """Trims of 2 to 15 % of full command, and thrust that differs by 3 to 8 %, standard deviations each.

    Trims come to nothing over all runs: one that they share would be an input bias.
    """
    trim, thrust = craft.full[craft.input] * log_uniform(rng, 0.02, 0.15), log_uniform(rng, 0.03, 0.08)
    each = rng.normal(0.0, (trim, thrust), (runs, 2))
    moments, shares = each[:, 0] - each[:, 0].mean(), np.exp(each[:, 1])
    return [
        Hidden("day", craft.input, {"moment": float(m), "thrust": float(s)}, craft, in_runs=(k,))
        for k, (m, s) in enumerate(zip(moments, shares, strict=True))
    ]


def _driven(rng: Rng, voyage: Voyage) -> tuple[Voyage, list[Hidden]]:
    """Return the voyage as a person steers it, and the helm of the runs in which the course is kept at times."""
    craft = voyage.craft
    channel, full = craft.input, craft.full[craft.input]
    t, pace = craft.interval * np.arange(craft.samples), max(craft.pace, 3.0 * craft.interval)
    size = full * log_uniform(rng, 0.7, 1.0)
    commands = tuple({**told, channel: size * driving(rng, t, pace)} for told in voyage.commands)
    values = {
        "gain": full / craft.scale["psi"] * log_uniform(rng, 0.2, 1.0),
        "rate": full / craft.top["yaw"] * log_uniform(rng, 0.2, 1.0),
        "every": craft.interval * int(rng.integers(1, 6)),
        "spell": craft.duration * rng.uniform(0.1, 0.3),
        "most": size,
    }
    kept = tuple(k for k in range(len(commands)) if rng.random() < 0.5)
    helm = [Hidden("helm", channel, values, craft, in_runs=kept)] if kept else []
    return replace(voyage, commands=commands), helm
