"""Differences between runs with process noise modelled: constant force and thrust of each run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gcs_autotune.diagnose.score import MIN_HELD_OUT_GAIN
from gcs_autotune.identify import Doubt
from gcs_autotune.identify.kalman import NoisyFit, NoisyProblem, ProcessNoise, RunLikelihoods, RunOffset
from gcs_autotune.sname import SIDES

__all__ = ["alike_in", "days_of", "differing", "doubt_of_days"]

FEWEST_RUNS = 3
"""Minimum number of runs to estimate differences between them; with fewer, none is assumed."""

OF_THE_DRIFT = 0.25
"""Smallest spread of the constant force between runs, relative to the drifting force.

Gusts come with a mean wind. Three or four runs are too often alike by chance to estimate a smaller spread.
"""

THRUST_AT_FIRST, FORCE_AT_FIRST = 0.05, 0.1
"""Start values of a fit with differences between runs.

THRUST_AT_FIRST: relative spread of thrust. FORCE_AT_FIRST: spread of the constant force, relative to the largest
command. Without these differences, a run's constant force is attributed to the drifting force, whose time constant is
then overestimated.
"""


def alike_in(noise: ProcessNoise, runs: int) -> ProcessNoise:
    """Return the noise with the smallest spread of constant force between *runs*, and none of thrust."""
    least = OF_THE_DRIFT * noise.size if runs >= FEWEST_RUNS else 0.0
    return replace(noise, day_force=least, day_thrust=0.0)


def differing(problem: NoisyProblem, fit: NoisyFit) -> NoisyFit:
    """Return *fit* refitted with a suitable spread of force and thrust between runs.

    The spread of thrust is zero, and that of force is the smallest, unless a larger one improves the likelihood by
    three nats. The common offset is free, because a bias of all runs is not a difference between them.
    """
    if problem.runs < FEWEST_RUNS:
        return fit
    none = problem.fit(fit.theta, fit.effects, alike_in(fit.noise, problem.runs)) or fit
    full = abs(fit.gain) * sum(problem.data_summary.amplitude.values())
    other: NoisyFit | None = fit
    if not fit.noise.day_thrust:
        apart = replace(fit.noise, day_force=FORCE_AT_FIRST * full, day_thrust=THRUST_AT_FIRST)
        other = problem.fit(fit.theta, fit.effects, apart)
    common, alternative = _likelihoods_at(problem, none), None if other is None else _likelihoods_at(problem, other)
    if common is None or alternative is None or other is None:
        return none
    least = OF_THE_DRIFT * other.noise.size
    best, sizes = common[1] + common[0].gain(none.noise.day_force, 0.0) + MIN_HELD_OUT_GAIN, (0.0, 0.0)
    for force, thrust in ((True, False), (False, True), (True, True)):
        spread = alternative[0].spread(least, full, force=force, thrust=thrust)
        likelier = alternative[1] + alternative[0].gain(*spread) - MIN_HELD_OUT_GAIN * (force and thrust)
        if likelier > best:
            best, sizes = likelier, spread
    if not any(sizes):
        return none
    end = problem.fit(other.theta, fit.effects, replace(other.noise, day_force=sizes[0], day_thrust=sizes[1]))
    return end if end is not None and end.total > none.total + MIN_HELD_OUT_GAIN else none


def _likelihoods_at(problem: NoisyProblem, fit: NoisyFit) -> tuple[RunLikelihoods, float] | None:
    """Return the likelihood of each run's offsets at *fit*, and the log-likelihood without them."""
    run_likelihoods = problem.run_likelihoods(fit)
    bare = problem.fit(
        fit.theta, fit.effects, replace(fit.noise, day_force=0.0, day_thrust=0.0), only_log_likelihood=True
    )
    return None if run_likelihoods is None or bare is None else (run_likelihoods, bare.total)


# -- for the report

SURE = 3.0
"""Number of standard deviations above which a run's own offset is reported; four runs have eight such offsets."""


def days_of(problem: NoisyProblem, fit: NoisyFit, inertia: float) -> tuple[RunOffset, ...]:
    """Return the offsets of each run, with forces multiplied by *inertia*; empty if the runs do not differ."""
    run_likelihoods = problem.run_likelihoods(fit) if fit.noise.differs else None
    offsets = () if run_likelihoods is None else run_likelihoods.offsets(fit.noise.day_force, fit.noise.day_thrust)
    return tuple(replace(d, force=d.force * inertia, force_std=d.force_std * abs(inertia)) for d in offsets)


def doubt_of_days(dof: str, unit: str, days: Sequence[RunOffset]) -> list[Doubt]:
    """Return a doubt that states each run's own bias and gain; empty if the runs do not differ."""
    unit = "of full output" if unit == "1" else unit
    offsets = [f"{d.run}: {' and '.join(own)}" for d in days if (own := _own(dof, unit, d))]
    if not offsets:
        return []
    return [
        Doubt(
            "day-to-day",
            f"the runs differ in {dof} by more than their commands explain ({'; '.join(offsets)})",
            "note battery, load and wind of each run. Differences between runs are not attributed to the craft",
        )
    ]


def _own(dof: str, unit: str, day: RunOffset) -> list[str]:
    differences = []
    if abs(day.thrust) > SURE * day.thrust_std > 0.0:
        differences.append(f"{100.0 * abs(day.thrust):.0f} % {'more' if day.thrust > 0.0 else 'less'} thrust")
    if abs(day.force) > SURE * day.force_std > 0.0:
        differences.append(f"{abs(day.force):.2g} {unit} {SIDES[dof][day.force < 0.0]}")
    return differences
