"""Sensor effects on the noise: rounding and outliers, with their likelihoods.

The contaminated normal distribution is that of Tukey1960; the algorithm that fits it is that of Dempster1977.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.special import log_ndtr, ndtri_exp

from gcs_autotune.effects.effect import SIGNAL, Array, Effect, EffectCurve, EffectInstance, EffectResidual, Quantity
from gcs_autotune.effects.summary import DataSummary
from gcs_autotune.slow_imports import scipy_stats

__all__ = ["Outliers", "Quantisation", "contamination", "grid_step"]


MATTERS = 0.15
"""Least fraction of the residual's mean square that rounding, ``step^2 / 12`` (Widrow1961), must explain.

The value is set by hand.
"""
FINEST = 0.02
"""Noise before rounding, in steps, below which it is not resolved."""
FEWEST = 20
"""Minimum number of samples of a run to look for a grid of values."""
HEADINGS = ("psi", "phi", "theta")
VISIBLE = 2.0 * math.log(2.0)
"""Evidence per sample that it lies on the grid: without a grid, it would lie between two values as often."""


class Quantisation(Effect):
    """Values are rounded to multiples of ``step``, because of few bits or few digits.

    No simulation predicts the noise before rounding, so no parameter is fitted. A reading means that the sum of
    prediction and noise lies within half a step of it. The likelihood is that of this interval.
    """

    slug = "quantisation"
    family = "sensor"
    meaning = "a signal is recorded in coarse steps, because it has few bits or few digits"
    plain = "Your {signal} is recorded in coarse steps, but that of {simulation} is smooth."
    parameters = (Quantity("step", SIGNAL, "distance between two successive levels of the reading"),)
    shown_by = "few distinct values, all on one grid. The residual against the signal is a saw-tooth"
    mistaken_for = ("outliers", "backlash", "dead-zone")
    separated_by = "the slowest motion of the craft. The reading then changes in visible steps"
    fixed = ("step",)

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return every signal."""
        return tuple(data.signals)

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return a step of zero; :meth:`learn` estimates it from the readings."""
        return ({"step": 0.0},)

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return bounds: at most three standard deviations of the signal."""
        return {"step": (0.0, 3.0 * data.spread[place])}

    def learn(self, effect: EffectInstance, left: Sequence[EffectResidual]) -> EffectInstance:
        """Estimate the step from the readings, if rounding explains enough of the residual; also estimate the noise
        before it."""
        mine = [x for x in left if x.signal == effect.place and len(x.error) >= FEWEST]
        steps = [_step(x) for x in mine]
        step = min(steps, default=0.0)
        error = np.concatenate([x.error for x in mine]) if step > 0.0 else np.zeros(0)
        if len(error) == 0 or step**2 / 12.0 < MATTERS * float(np.mean(error**2)):
            return effect.with_values({"step": 0.0})
        return replace(effect.with_values({"step": step}), constants={"level": _level(error, step)})

    def judge(self, effect: EffectInstance, left: EffectResidual, columns: Array) -> tuple[Array, Array, float]:
        """Return the expected noise before rounding, scaled to the level of the noise.

        The expectation is smaller than the noise, so it is stretched, and the columns are shrunk by the same factor.
        Cost, step of a fit and standard errors are then those of the interval likelihood, at whatever residual the
        level was estimated.
        """
        step, n = effect["step"], len(left.error)
        if left.signal != effect.place or step <= 0.0 or n == 0:
            return left.error, columns, 0.0
        level = effect.constants["level"]
        noise, log_chance = _noise(left.error, step, level)
        stretch = level / max(float(np.sqrt(np.mean(noise**2))), 1e-3 * level)
        gaussian = 1.0 + math.log(2.0 * math.pi) + 2.0 * math.log(level)
        penalty = float(np.sum(2.0 * math.log(step) - 2.0 * log_chance - gaussian - VISIBLE))
        return stretch * noise, columns / stretch, penalty

    def normal(self, effect: EffectInstance, left: EffectResidual) -> Array:
        """Return noise drawn from each reading's interval, on the scale of a standard normal distribution (Dunn1996).

        The expected noise is mostly zero and sometimes large, which is heavy-tailed by construction. A random draw is
        not.
        """
        step, level = effect["step"], effect.constants.get("level", 0.0)
        if left.signal != effect.place or step <= 0.0 or level <= 0.0:
            return left.error
        side = np.where(left.error > 0.0, -1.0, 1.0)
        low, high = ((side * left.error + way * 0.5 * step) / level for way in (-1.0, 1.0))
        chance = np.random.default_rng(len(left.error)).uniform(size=len(left.error))
        below, upper = log_ndtr(low), log_ndtr(high)
        return side * ndtri_exp(upper + np.log1p((chance - 1.0) * -np.expm1(np.minimum(below - upper, 0.0))))

    def uncertainty(self, effect: EffectInstance, left: Sequence[EffectResidual]) -> Mapping[str, float]:
        """Return the uncertainty of the step: the tolerance of the grid."""
        return {"step": TOLERANCE * effect["step"]}

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve:
        """Return the staircase of rounded over true values, about zero."""
        x = np.linspace(-5.0, 5.0, 1001) * effect["step"]
        y = np.round(x / effect["step"]) * effect["step"] if effect["step"] > 0.0 else x
        unit = data.signals[effect.place]
        return EffectCurve(
            x, y, f"{effect.place} true [{unit}]", f"{effect.place} read [{unit}]", "Steps of the reading", plain=x
        )


def _step(x: EffectResidual) -> float:
    """Return the grid step of a run's readings; a heading is also tried before unwrapping."""
    turn = 2.0 * math.pi
    ways = (x.measured, np.mod(x.measured, turn), np.mod(x.measured + math.pi, turn) - math.pi)
    return next((step for y in ways[: 3 if x.signal in HEADINGS else 1] if (step := grid_step(y)) > 0.0), 0.0)


def _noise(error: Array, step: float, level: float) -> tuple[Array, Array]:
    """Return the noise (n,) expected within half a *step* of *error*, and the log probability (n,) of that interval."""
    side = np.where(error > 0.0, -1.0, 1.0)  # the far tail is computed from below, where it does not cancel
    low, high = (side * error - 0.5 * step) / level, (side * error + 0.5 * step) / level
    upper = log_ndtr(high)
    log_chance = upper + np.log1p(-np.exp(np.minimum(log_ndtr(low) - upper, -1e-12)))
    half_log = 0.5 * math.log(2.0 * math.pi)
    mean = np.exp(-0.5 * low**2 - half_log - log_chance) - np.exp(-0.5 * high**2 - half_log - log_chance)
    return side * level * mean, log_chance


def _level(error: Array, step: float) -> float:
    """Return the noise level before rounding, by maximum likelihood."""
    low, high = math.log(FINEST * step), math.log(max(2.0 * float(np.sqrt(np.mean(error**2))), step))
    found = minimize_scalar(
        lambda log_level: -float(np.sum(_noise(error, step, math.exp(log_level))[1])),
        bounds=(low, high),
        method="bounded",
    )
    return math.exp(float(found.x))


TOLERANCE = 0.02
"""Largest deviation of a reading from the grid, in steps; it allows for rounded numbers in files."""
FINEST_GRID = 1e-5
"""Finest grid that is searched for, relative to the range of the values."""


def grid_step(values: Array) -> float:
    """Return the step of the coarsest grid that contains all *values* (n,) as recorded; 0 if there is none.

    An angle must be given as recorded, before unwrapping, because a full turn need not be a multiple of the step.
    """
    ordered = np.sort(values[np.isfinite(values)])
    if len(ordered) < 10 or ordered[-1] == ordered[0]:
        return 0.0
    gaps = np.diff(ordered)
    gaps = gaps[gaps > FINEST_GRID * (ordered[-1] - ordered[0])]
    # A grid brings readings together: of so many, some are equal.
    if len(gaps) == 0 or len(gaps) > 0.9 * (len(ordered) - 1):
        return 0.0
    for parts in (1, 2, 3):
        step = float(gaps.min()) / parts
        counts = np.round(gaps / step)
        step = float(gaps @ counts / (counts @ counts))
        if float(np.max(np.abs(gaps / step - np.round(gaps / step)))) < TOLERANCE:
            return step
    return 0.0


class Outliers(Effect):
    """A ``share`` of the samples has errors of about ``size`` (rms): lost bits, reflections, a fix that jumps.

    Outliers occur independently of the motion. Errors that come in groups, or with changes of the motion, indicate a
    wrong model instead.
    """

    slug = "outliers"
    family = "sensor"
    meaning = "single samples are outliers, because of lost bits, reflections or position jumps"
    plain = "Your {signal} has single wrong samples, but that of {simulation} has none."
    parameters = (
        Quantity("share", "1", "fraction of samples that are outliers"),
        Quantity("size", SIGNAL, "rms error of these samples"),
    )
    shown_by = "single spikes in the residual, in both directions, unrelated to command or motion"
    mistaken_for = ("quantisation", "measurement-delay", "backlash")
    separated_by = "one minute at rest with the recorder running. Outliers of the sensor remain"
    fixed = ("share", "size")

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return every signal."""
        return tuple(data.signals)

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return a share of zero; :meth:`learn` estimates share and size."""
        return ({"share": 0.0, "size": 0.1 * data.spread[place]},)

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return bounds: at most 30 % of the samples, because more are not exceptions."""
        return {"share": (0.0, 0.3), "size": (0.0, 1e3 * data.spread[place])}

    def learn(self, effect: EffectInstance, left: Sequence[EffectResidual]) -> EffectInstance:
        """Estimate share and size of single large errors; the share is zero if they depend on the motion or come in
        groups."""
        mine = [x for x in left if x.signal == effect.place]
        found = contamination(np.concatenate([stray(x.error) for x in mine])) if mine else None
        if found is None or not without_motion(
            [found.flags(stray(x.error)) for x in mine], [x.measured - x.error for x in mine]
        ):
            return effect.with_values({"share": 0.0})
        effect = effect.with_values({"share": found.share, "size": found.size})
        return replace(effect, constants={**effect.constants, "level": found.level})

    def judge(self, effect: EffectInstance, left: EffectResidual, columns: Array) -> tuple[Array, Array, float]:
        """Weight outliers by their expected size, with a penalty for that size and for selecting them."""
        if left.signal != effect.place or effect["share"] <= 0.0:
            return left.error, columns, 0.0
        law = Contamination(effect["share"], effect["size"], effect.constants["level"])
        off = law.flags(stray(left.error))
        broader = 1.0 + (law.size / law.level) ** 2
        weight = np.where(off, 1.0 / math.sqrt(broader), 1.0)
        count = float(np.sum(off))
        odds = count * math.log(law.share) + (len(off) - count) * math.log1p(-law.share)
        return weight * left.error, weight[:, None] * columns, count * math.log(broader) - 2.0 * odds

    def uncertainty(self, effect: EffectInstance, left: Sequence[EffectResidual]) -> Mapping[str, float]:
        """Return the standard errors of the fraction, and of the rms of that many values."""
        n = sum(len(x.error) for x in left if x.signal == effect.place)
        count = max(effect["share"] * n, 1.0)
        return {"share": math.sqrt(effect["share"] / max(n, 1)), "size": effect["size"] / math.sqrt(2.0 * count)}

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve | None:
        """Return the distribution of the errors: a narrow core with broad tails."""
        level = effect.constants.get("level", 0.0)
        if level <= 0.0:
            return None
        law = Contamination(effect["share"], effect["size"], level)
        x = np.linspace(-3.0, 3.0, 1201) * max(law.size, 2.0 * level)
        core = np.exp(-0.5 * (x / level) ** 2) / (level * math.sqrt(2.0 * math.pi))
        unit = data.signals[effect.place]
        label = f"density [1/({unit})]"
        return EffectCurve(
            x, law.density(x), f"error of {effect.place} [{unit}]", label, "Distribution of the errors", plain=core
        )


Flags = NDArray[np.bool_]

WINDOW = 7
"""Width, in samples, of the median filter that each error is compared with."""
MOST, LEAST_SIZE = 0.3, 3.0
"""Largest fraction of outliers (MOST), and their least size relative to the noise (LEAST_SIZE). Both are set by
hand."""
DOUBT = 1e-3
"""Probability of rejecting real outliers as dependent on the motion."""
SWEEPS = 60


@dataclass(frozen=True, slots=True)
class Contamination:
    """A fraction ``share`` of the errors has an additional rms ``size``, beside the noise ``level`` of all."""

    share: float
    size: float
    level: float

    def odds(self, error: Array) -> Array:
        """Return the log odds (n,) that an error is an outlier."""
        variance = self.level**2 + self.size**2
        narrow = math.log1p(-self.share) - math.log(self.level) - 0.5 * (error / self.level) ** 2
        broad = math.log(self.share) - 0.5 * math.log(variance) - 0.5 * error**2 / variance
        odds: Array = broad - narrow
        return odds

    def flags(self, error: Array) -> Flags:
        """Return which errors (n,) are more likely outliers than not."""
        return np.asarray(self.odds(error) > 0.0)

    def density(self, error: Array) -> Array:
        """Return the probability density (n,) of the mixture."""
        variances = (self.level**2, self.level**2 + self.size**2)
        bells = [np.exp(-0.5 * error**2 / v) / math.sqrt(2.0 * math.pi * v) for v in variances]
        return np.asarray((1.0 - self.share) * bells[0] + self.share * bells[1])


def stray(error: Array) -> Array:
    """Return errors (n,) relative to the median of their neighbours; only isolated errors remain large."""
    from scipy.ndimage import median_filter  # here: a fifth of a second to import, at every command's start

    return np.asarray(error - median_filter(error, size=min(WINDOW, len(error)), mode="nearest"))


def contamination(error: Array) -> Contamination | None:
    """Return the mixture fitted to *error* (n,); return None if there is no fraction of larger errors."""
    error = error[np.isfinite(error)]
    if len(error) < 20:
        return None
    # Kept off zero: of noise-free readings with a few off, the rest is rounding.
    floor = 1e-9 * float(np.max(np.abs(error)))
    level = max(1.4826 * float(np.median(np.abs(error))), floor)
    far = np.abs(error) > 4.0 * level
    if floor == 0.0 or not far.any():
        return None
    share = float(np.mean(far))
    size = math.sqrt(float(np.mean(error[far] ** 2)))
    for _ in range(SWEEPS):
        if share > MOST or share * len(error) < 1.0 or size < LEAST_SIZE * level:
            return None
        law = Contamination(share, size, level)
        broad = 0.5 * (1.0 + np.tanh(0.5 * np.clip(law.odds(error), -600.0, 600.0)))
        share = float(np.mean(broad))
        level = max(math.sqrt(float((1.0 - broad) @ error**2) / float(np.sum(1.0 - broad))), floor)
        variance = float(broad @ error**2) / max(float(np.sum(broad)), 1e-300)
        size = math.sqrt(max(variance - level**2, 0.0))
    return Contamination(share, size, level) if 0.0 < share <= MOST and size >= LEAST_SIZE * level else None


def without_motion(flags: Sequence[Flags], motion: Sequence[Array]) -> bool:
    """Return whether flagged samples are independent of the motion (n,) and do not come in groups.

    The tests are the rank test of Mann and Whitney on the change of the motion, and the number of flagged neighbours.
    """
    change = np.concatenate([_rank(np.abs(np.gradient(m))) for m in motion])
    off = np.concatenate(list(flags))
    if off.sum() < 3 or off.all():
        return bool(off.any()) and not bool(off.all())
    neighbours = sum(int(np.sum(f[1:] & f[:-1])) for f in flags)
    expected = sum(max(float(f.mean()) ** 2, float(off.mean()) ** 2) * len(f) for f in flags)
    if float(scipy_stats().poisson.sf(neighbours - 1, expected)) < DOUBT:
        return False
    return float(scipy_stats().mannwhitneyu(change[off], change[~off], alternative="greater").pvalue) > DOUBT


def _rank(x: Array) -> Array:
    return np.asarray(np.argsort(np.argsort(x)) / max(len(x), 1), dtype=np.float64)
