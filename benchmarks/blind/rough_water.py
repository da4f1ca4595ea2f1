"""Cases of kind ``rough``: one, two or no hidden effects, a drifting moment, and further disturbances.

Each of :data:`CIRCUMSTANCES` is present or absent. ``waves``: a moment in a narrow frequency band, and a motion of the
bow. ``lag``: the heading is late, or filtered in one direction. ``driving``: a person steers instead of flying
manoeuvres. ``run-to-run``: trim and thrust differ between runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.blind.craft import Craft, draw_craft, log_uniform
from benchmarks.blind.flight_plan import Case, FlightPlan, FlownRuns, case_of, draw_flight_plan, fly
from benchmarks.blind.hidden import Hidden
from benchmarks.blind.manoeuvres import driving
from benchmarks.blind.process_noise import CALM, draw_drifting_moment, smoothed
from benchmarks.blind.recipes import RECIPES

__all__ = ["CIRCUMSTANCES", "EXCUSED", "PAIR", "draw_rough"]

Rng = np.random.Generator

CIRCUMSTANCES = {"waves": 0.4, "lag": 0.3, "driving": 0.4, "run-to-run": 0.4}
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
    """Return a case with the effect *slug*, with two (:data:`PAIR`) or with none (:data:`CALM`)."""
    craft = draw_craft("yaw", rng)
    slugs = [] if slug == CALM else _two(rng) if slug == PAIR else [slug]
    hidden = [RECIPES[s].draw(rng, craft) for s in slugs]
    present = tuple(c for c, share in CIRCUMSTANCES.items() if rng.random() < share)
    plan = draw_flight_plan(rng, hidden or [Hidden("", "", {}, craft)])
    disturbances = [Hidden("drifting-moment", craft.input, draw_drifting_moment(rng, craft), craft)]
    helm: list[Hidden] = []
    if "driving" in present:
        plan, helm = _driven(rng, plan)
    if "run-to-run" in present:
        disturbances += _run_to_run(rng, craft, len(plan.commands))
    if "waves" in present:
        disturbances.append(_waves(rng, craft))
    if "lag" in present:
        disturbances.append(_lag(rng, craft))
    noise = log_uniform(rng, LEAST_NOISE, MOST_NOISE)
    levels = {"psi": noise * craft.scale["psi"]}
    width = 1 if "lag" in present else int(rng.integers(1, 4))
    everything = (*helm, *hidden, *disturbances)
    flown = FlownRuns(plan, everything, tuple(fly(plan, everything, levels)))
    files = [smoothed(f, width) for f in flown.files]
    noise_share = disturbances[0].values["spread"] / craft.full[craft.input]
    case = case_of(
        rng, plan, hidden, files, noise_share, noise, levels, keeps=1.0
    )  # the trims are zero on average over all runs
    return replace(case, runs=(*case.runs, *case.unseen), unseen=(), circumstances=present, flown=flown)


def _two(rng: Rng) -> Sequence[str]:
    one, two = rng.choice(len(FAMILIES), 2, replace=False)
    return [str(rng.choice(FAMILIES[i])) for i in (one, two)]


def _waves(rng: Rng, craft: Craft) -> Hidden:
    """Return waves of 1.6 to 12 s with a moment of 5 to 50 % of full command, and 0.2 to 3 deg of heading motion."""
    values = {
        "moment": craft.full[craft.input] * log_uniform(rng, 0.05, 0.5),
        "heading": np.radians(log_uniform(rng, 0.2, 3.0)),
        "frequency": log_uniform(rng, 0.5, 4.0),
        "damping": log_uniform(rng, 0.05, 0.3),
    }
    return Hidden("waves", craft.input, values, craft)


def _lag(rng: Rng, craft: Craft) -> Hidden:
    """Return a delay or a filter of 0.1 to 1 s, at most two time constants of the craft."""
    seconds = min(log_uniform(rng, 0.1, 1.0), 2.0 * craft.pace)
    late = rng.random() < 0.5
    return Hidden("lag", craft.input, {"delay": seconds * late, "time_constant": seconds * (not late)}, craft)


def _run_to_run(rng: Rng, craft: Craft, runs: int) -> list[Hidden]:
    """Return trims and thrust factors of the runs, with standard deviations of 2 to 15 % and 3 to 8 % of full command.

    The trims are zero on average, as a common one is an input bias.
    """
    trim, thrust = craft.full[craft.input] * log_uniform(rng, 0.02, 0.15), log_uniform(rng, 0.03, 0.08)
    each = rng.normal(0.0, (trim, thrust), (runs, 2))
    moments, shares = each[:, 0] - each[:, 0].mean(), np.exp(each[:, 1])
    return [
        Hidden("run-to-run", craft.input, {"moment": float(m), "thrust": float(s)}, craft, in_runs=(k,))
        for k, (m, s) in enumerate(zip(moments, shares, strict=True))
    ]


def _driven(rng: Rng, plan: FlightPlan) -> tuple[FlightPlan, list[Hidden]]:
    """Return the plan with the commands of a person, and the helm of those runs that keep a heading at times."""
    craft = plan.craft
    channel, full = craft.input, craft.full[craft.input]
    t, pace = craft.interval * np.arange(craft.samples), max(craft.pace, 3.0 * craft.interval)
    size = full * log_uniform(rng, 0.7, 1.0)
    commands = tuple({**planned, channel: size * driving(rng, t, pace)} for planned in plan.commands)
    values = {
        "gain": full / craft.scale["psi"] * log_uniform(rng, 0.2, 1.0),
        "rate": full / craft.top["yaw"] * log_uniform(rng, 0.2, 1.0),
        "every": craft.interval * int(rng.integers(1, 6)),
        "spell": craft.duration * rng.uniform(0.1, 0.3),
        "most": size,
    }
    kept = tuple(k for k in range(len(commands)) if rng.random() < 0.5)
    helm = [Hidden("helm", channel, values, craft, in_runs=kept)] if kept else []
    return replace(plan, commands=commands), helm
