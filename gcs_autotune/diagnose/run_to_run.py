"""What differs from run to run, with process noise modelled: a constant force and the thrust of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from gcs_autotune.diagnose.score import WORTH
from gcs_autotune.identify import (
    Day,
    Doubt,
    NoisyFit,
    NoisyProblem,
    ProcessNoise,
    RunSays,
    common_gain,
    spread_between,
)

__all__ = ["alike_in", "days_of", "differing", "doubt_of_days"]

FEWEST_RUNS = 3
"""Runs of which a scatter between them tells something; of fewer nothing differs."""

OF_THE_DRIFT = 0.25
"""Chosen: least spread of a run's constant force, in shares of the drifting force. Where there are gusts there is a
mean wind, and three or four runs are alike by accident too often for their scatter to tell it."""

THRUST_AT_FIRST, FORCE_AT_FIRST = 0.05, 0.1
"""Chosen: spread of thrust, and of a constant force in shares of the largest commanded, at which a fit that knows of
days begins: beside none a day's force has gone into the one that wanders, and made it slow."""


def alike_in(noise: ProcessNoise, runs: int) -> ProcessNoise:
    """Return the noise where *runs* are as much alike as runs ever are."""
    least = OF_THE_DRIFT * noise.size if runs >= FEWEST_RUNS else 0.0
    return replace(noise, day_force=least, day_thrust=0.0)


def differing(problem: NoisyProblem, fit: NoisyFit) -> NoisyFit:
    """Return *fit* again with the spread of force and thrust between runs that suits it.

    Of thrust there is none, and of force no more than the weather has of itself, but where that makes the runs likelier
    by three nats, what they have in common left free: a bias of every run is no difference between them.
    """
    if problem.runs < FEWEST_RUNS:
        return fit
    none = problem.fit(fit.theta, fit.effects, alike_in(fit.noise, problem.runs)) or fit
    full = abs(float(fit.theta[0])) * sum(problem.data_summary.amplitude.values())
    other: NoisyFit | None = fit
    if not fit.noise.day_thrust:
        apart = replace(fit.noise, day_force=FORCE_AT_FIRST * full, day_thrust=THRUST_AT_FIRST)
        other = problem.fit(fit.theta, fit.effects, apart)
    says, told = _says(problem, none), None if other is None else _says(problem, other)
    if says is None or told is None or other is None:
        return none
    least = OF_THE_DRIFT * other.noise.size
    best, sizes = says[1] + common_gain(says[0], none.noise.day_force, 0.0) + WORTH, (0.0, 0.0)
    for force, thrust in ((True, False), (False, True), (True, True)):
        found = spread_between(told[0], least, full, force=force, thrust=thrust)
        likelier = told[1] + common_gain(told[0], *found) - WORTH * (force and thrust)
        if likelier > best:
            best, sizes = likelier, found
    if not any(sizes):
        return none
    end = problem.fit(other.theta, fit.effects, replace(other.noise, day_force=sizes[0], day_thrust=sizes[1]))
    return end if end is not None and end.total > none.total + WORTH else none


def _says(problem: NoisyProblem, fit: NoisyFit) -> tuple[tuple[RunSays, ...], float] | None:
    """Return what runs say of their days at *fit*, and their log-likelihood were there none."""
    says = problem.says(fit)
    bare = problem.fit(
        fit.theta, fit.effects, replace(fit.noise, day_force=0.0, day_thrust=0.0), only_log_likelihood=True
    )
    return None if says is None or bare is None else (says, bare.total)


# -- for the report

SURE = 3.0
"""Standard deviations from which on what a run has of its own is told: of four runs there are eight such numbers."""

SIDES: Mapping[str, tuple[str, str]] = {
    "surge": ("ahead", "astern"),
    "sway": ("to starboard", "to port"),
    "heave": ("down", "up"),
    "roll": ("to starboard", "to port"),
    "pitch": ("bow up", "bow down"),
    "yaw": ("to starboard", "to port"),
}
"""Where a positive and a negative force of each degree of freedom push."""


def days_of(problem: NoisyProblem, fit: NoisyFit, inertia: float) -> tuple[Day, ...]:
    """Return what each run had of its own, forces times *inertia*; nothing where runs are alike."""
    says = problem.says(fit) if fit.noise.differs else None
    found = [one.day(fit.noise.day_force, fit.noise.day_thrust) for one in says or ()]
    return tuple(replace(d, force=d.force * inertia, force_std=d.force_std * abs(inertia)) for d in found)


def doubt_of_days(dof: str, unit: str, days: Sequence[Day]) -> list[Doubt]:
    """Return the doubt that the runs differ, with each run's own bias and gain; empty if they agree."""
    unit = "of full output" if unit == "1" else unit
    told = [f"{d.run}: {' and '.join(own)}" for d in days if (own := _own(dof, unit, d))]
    if not told:
        return []
    return [
        Doubt(
            "day-to-day",
            f"the runs differ in {dof} by more than their commands explain ({'; '.join(told)})",
            "note battery, load and wind of each run: run-to-run differences are not attributed to the craft",
        )
    ]


def _own(dof: str, unit: str, day: Day) -> list[str]:
    found = []
    if abs(day.thrust) > SURE * day.thrust_std > 0.0:
        found.append(f"thrust {100.0 * abs(day.thrust):.0f} % {'more' if day.thrust > 0.0 else 'less'}")
    if abs(day.force) > SURE * day.force_std > 0.0:
        found.append(f"{abs(day.force):.2g} {unit} {SIDES[dof][day.force < 0.0]}")
    return found
