"""Quantisation: a signal comes in steps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import log_ndtr, ndtri_exp

from gcs_autotune.effects.effect import SIGNAL, Applied, Array, Curve, Effect, Family, Leftover, Quantity, Scene
from gcs_autotune.effects.grid import TOLERANCE, grid_step

__all__ = ["Quantisation"]

MATTERS = 0.15
"""Chosen: rounding counts from this share of the residual's mean square on; it is ``step^2 / 12`` (Widrow1961)."""
FINEST = 0.02
"""Noise before rounding, in steps, below which it is not resolved."""
FEWEST = 20
"""Samples of a run whose grid is looked for."""
HEADINGS = ("psi", "phi", "theta")
VISIBLE = 2.0 * math.log(2.0)
"""Evidence per sample that it lies on the grid: without one it lay half-way between at least as often."""


class Quantisation(Effect):
    """Values are rounded to multiples of ``step``: few bits, few digits.

    No simulation foretells the noise before rounding, so nothing is fitted: given the prediction, a reading says that
    prediction and noise together lie within half a step of it, and the likelihood is that of this interval.
    """

    slug: ClassVar[str] = "quantisation"
    family: ClassVar[Family] = "sensor"
    meaning: ClassVar[str] = "a signal comes in steps: few bits, few digits"
    parameters: ClassVar[tuple[Quantity, ...]] = (Quantity("step", SIGNAL, "distance of two neighbouring readings"),)
    shown_by: ClassVar[str] = "few distinct values, all on one grid; the residual is a saw-tooth over the signal"
    mistaken_for: ClassVar[tuple[str, ...]] = ("outliers", "backlash", "dead-zone")
    separated_by: ClassVar[str] = "the slowest motion the craft can do: the reading then moves in visible stairs"
    fixed: ClassVar[tuple[str, ...]] = ("step",)

    def places(self, scene: Scene) -> tuple[str, ...]:
        """Every signal."""
        return tuple(scene.signals)

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """None yet; :meth:`learn` looks at the readings."""
        return ({"step": 0.0},)

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """Steps as large as the signal leave nothing of it."""
        return {"step": (0.0, 3.0 * scene.spread[place])}

    def learn(self, own: Applied, left: Sequence[Leftover]) -> Applied:
        """Take the readings' grid for the cause when it is a fair share of what is left; size the noise before it."""
        mine = [x for x in left if x.signal == own.place and len(x.error) >= FEWEST]
        steps = [_step(x) for x in mine]
        step = min(steps, default=0.0)
        error = np.concatenate([x.error for x in mine]) if step > 0.0 else np.zeros(0)
        if len(error) == 0 or step**2 / 12.0 < MATTERS * float(np.mean(error**2)):
            return own.with_values({"step": 0.0})
        return replace(own.with_values({"step": step}), constants={"level": _level(error, step)})

    def judge(self, own: Applied, left: Leftover, columns: Array) -> tuple[Array, Array, float]:
        """Return the expected noise before rounding, at its own size.

        It is stretched from the size it has as an expectation, here and now, to that of the noise, and the columns
        shrunk likewise: so cost, step of a fit and standard errors are those of the interval likelihood, wherever the
        level was learnt.
        """
        step, n = own["step"], len(left.error)
        if left.signal != own.place or step <= 0.0 or n == 0:
            return left.error, columns, 0.0
        level = own.constants["level"]
        noise, log_chance = _noise(left.error, step, level)
        stretch = level / max(float(np.sqrt(np.mean(noise**2))), 1e-3 * level)
        gaussian = 1.0 + math.log(2.0 * math.pi) + 2.0 * math.log(level)
        penalty = float(np.sum(2.0 * math.log(step) - 2.0 * log_chance - gaussian - VISIBLE))
        return stretch * noise, columns / stretch, penalty

    def normal(self, own: Applied, left: Leftover) -> Array:
        """Return noise drawn from within each reading's interval, on the scale of a standard normal (Dunn1996).

        What is expected there is mostly nothing, sometimes much: heavy tails by construction. A draw has none.
        """
        step, level = own["step"], own.constants.get("level", 0.0)
        if left.signal != own.place or step <= 0.0 or level <= 0.0:
            return left.error
        side = np.where(left.error > 0.0, -1.0, 1.0)
        low, high = ((side * left.error + way * 0.5 * step) / level for way in (-1.0, 1.0))
        chance = np.random.default_rng(len(left.error)).uniform(size=len(left.error))
        below, upper = log_ndtr(low), log_ndtr(high)
        return side * ndtri_exp(upper + np.log1p((chance - 1.0) * -np.expm1(np.minimum(below - upper, 0.0))))

    def uncertainty(self, own: Applied, left: Sequence[Leftover]) -> Mapping[str, float]:
        """How exactly a grid is read off."""
        return {"step": TOLERANCE * own["step"]}

    def curve(self, own: Applied, scene: Scene) -> Curve:
        """The stairs, about zero."""
        x = np.linspace(-5.0, 5.0, 1001) * own["step"]
        y = np.round(x / own["step"]) * own["step"] if own["step"] > 0.0 else x
        unit = scene.signals[own.place]
        return Curve(x, y, f"{own.place} true [{unit}]", f"{own.place} read [{unit}]", "Stairs of the reading", plain=x)


def _step(x: Leftover) -> float:
    """Return the grid of a run's readings; of a heading also as it was before it was made continuous."""
    turn = 2.0 * math.pi
    ways = (x.measured, np.mod(x.measured, turn), np.mod(x.measured + math.pi, turn) - math.pi)
    return next((step for y in ways[: 3 if x.signal in HEADINGS else 1] if (step := grid_step(y)) > 0.0), 0.0)


def _noise(error: Array, step: float, level: float) -> tuple[Array, Array]:
    """Return the noise (n,) expected within half a *step* of *error*, and the log chance (n,) of that interval."""
    side = np.where(error > 0.0, -1.0, 1.0)  # the far tail is computed from below, where it does not cancel
    low, high = (side * error - 0.5 * step) / level, (side * error + 0.5 * step) / level
    upper = log_ndtr(high)
    log_chance = upper + np.log1p(-np.exp(np.minimum(log_ndtr(low) - upper, -1e-12)))
    half_log = 0.5 * math.log(2.0 * math.pi)
    mean = np.exp(-0.5 * low**2 - half_log - log_chance) - np.exp(-0.5 * high**2 - half_log - log_chance)
    return side * level * mean, log_chance


def _level(error: Array, step: float) -> float:
    """Return the noise before rounding, by maximum likelihood."""
    low, high = math.log(FINEST * step), math.log(max(2.0 * float(np.sqrt(np.mean(error**2))), step))
    found = minimize_scalar(
        lambda log_level: -float(np.sum(_noise(error, step, math.exp(log_level))[1])),
        bounds=(low, high),
        method="bounded",
    )
    return math.exp(float(found.x))
