"""Compare two models of one degree of freedom by their step responses: steady state and rise time.

With a coarse or slow sensor, the parameters of two models can differ much although their motions hardly differ
(Miskovic2010, section 7.2, (7.4)-(7.11)). In (7.11) the factor is ``1/sqrt(|tau|)``; in (7.10) the fraction is tanh(1)
= 76 %.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.design import reduce
from gcs_autotune.effects import ExtendedModel, grid_step
from gcs_autotune.errors import UsageError
from gcs_autotune.models import SingleDof
from gcs_autotune.notebook import Displayed
from gcs_autotune.sname import DOFS
from gcs_autotune.trial import Trial

__all__ = ["DofComparison", "compare_dof", "compare_models"]

Array = NDArray[np.float64]

SETTLING = 1.0 - math.exp(-1.0)
"""Fraction of the steady state reached after ``alpha / beta`` with linear drag."""
SETTLING_QUADRATIC = math.tanh(1.0)
"""Fraction of the steady state reached after ``alpha / sqrt(beta_nn |tau|)`` with quadratic drag."""

SMALLEST = 0.05
"""Quantile of the applied inputs that counts as the smallest input.

Project choice: single samples during a step then do not count.
"""


@dataclass(frozen=True, slots=True)
class DofComparison(Displayed):
    """Step responses of two models to the largest and to the smallest applied input, SI and radians.

    - ``steady``: steady velocity of each model under ``largest``.
    - ``quantum``: resolution of the velocity, 0 if negligible.
    - ``rise`` [s]: time of each model to the fraction ``share`` of its steady state under ``smallest``.
    - ``interval`` [s]: time between samples.
    """

    dof: str
    input_unit: str
    largest: float
    smallest: float
    steady: tuple[float, float]
    quantum: float
    rise: tuple[float, float]
    share: float
    interval: float

    @property
    def steady_apart(self) -> float:
        """Difference of the two steady velocities (Miskovic2010, (7.5), (7.7))."""
        return abs(self.steady[0] - self.steady[1])

    @property
    def rise_apart(self) -> float:
        """Difference of the two rise times [s] (Miskovic2010, (7.9), (7.11))."""
        return abs(self.rise[0] - self.rise[1])

    @property
    def same_steady(self) -> bool:
        """Whether the sensor cannot resolve the difference of the two steady states."""
        return self.steady_apart <= self.quantum

    @property
    def samples(self) -> float:
        """Difference of the two rise times, in samples."""
        return self.rise_apart / self.interval

    def to_dict(self) -> dict[str, object]:
        """Return the comparison as data for JSON, in SI units and radians."""
        return {
            "dof": self.dof,
            "input_unit": self.input_unit,
            "largest_input": self.largest,
            "smallest_input": self.smallest,
            "steady_state": list(self.steady),
            "steady_state_apart": self.steady_apart,
            "sensor_step": self.quantum,
            "time_constant": list(self.rise),
            "time_constant_apart": self.rise_apart,
            "share_of_steady_state": self.share,
            "samples_apart": self.samples,
        }


def compare_dof(
    models: tuple[SingleDof, SingleDof], largest: float, smallest: float, *, quantum: float = 0.0, interval: float = 0.1
) -> DofComparison:
    """Return a comparison of two models of one degree of freedom, without their constant forces.

    If both models have linear drag only, or both quadratic drag only, time constants are those of Miskovic2010. Any
    other pair is compared by the time to 63 % of the steady state.

    largest, smallest : inputs of the two steps.
    quantum : resolution of the velocity, 0 if negligible.
    interval : time between samples [s].

    Raises
    ------
    UsageError
        The models differ in degree of freedom or input unit, or the input is zero.
    """
    one, other = models
    if (one.dof, one.input_unit) != (other.dof, other.input_unit):
        raise UsageError(
            f"a model of {one.dof} per [{one.input_unit}] and one of {other.dof} per [{other.input_unit}] cannot be "
            "compared: their forces have no common unit. Use --full-scale to convert normalised outputs into forces"
        )
    if not largest >= smallest > 0.0:
        raise UsageError(
            f"inputs {largest:g} and {smallest:g} cannot be compared. Give two inputs above 0, the larger one first"
        )
    both_quadratic = all(m.beta == 0.0 and m.beta_quadratic != 0.0 for m in models)
    share = SETTLING_QUADRATIC if both_quadratic else SETTLING
    steady, rise = [], []
    for model in (replace(m, delta=0.0) for m in models):
        steady.append(abs(model.steady_velocity(largest)))
        rise.append(model.rise_time(smallest, share))
    return DofComparison(
        dof=one.dof,
        input_unit=one.input_unit,
        largest=largest,
        smallest=smallest,
        steady=(steady[0], steady[1]),
        quantum=quantum,
        rise=(rise[0], rise[1]),
        share=share,
        interval=interval,
    )


def compare_models(
    one: ExtendedModel,
    other: ExtendedModel,
    units: tuple[Mapping[str, str], Mapping[str, str]],
    runs: Sequence[Trial],
) -> tuple[DofComparison, ...]:
    """Return a comparison of two models for each degree of freedom, under the inputs of *runs* and without coupling.

    units : name -> unit of the inputs, for each of the two models.

    Raises
    ------
    UsageError
        The models have no common degree of freedom that a recorded input drives.
    """
    found = []
    for dof in (d for d in one.base.form.dofs if d in other.base.form.dofs):
        try:
            pair = tuple(reduce(m, dof, u) for m, u in zip((one, other), units, strict=True))
        except UsageError:
            continue  # nothing drives it in one of them
        inputs = [np.abs(run[pair[0].channel].values) for run in runs if pair[0].channel in run]
        pushes = np.concatenate([u[np.isfinite(u) & (u > 0.0)] for u in inputs]) if inputs else np.zeros(0)
        if not len(pushes):
            continue
        quantum, interval = _resolved(dof, runs)
        found.append(
            compare_dof(
                (pair[0].model, pair[1].model),
                float(pushes.max()),
                float(np.quantile(pushes, SMALLEST)),
                quantum=quantum,
                interval=interval,
            )
        )
    if not found:
        raise UsageError(
            f"a model of {', '.join(one.base.form.dofs)} and one of {', '.join(other.base.form.dofs)} cannot be "
            "compared: no degree of freedom that these runs drive is in both"
        )
    return tuple(found)


def _resolved(dof: str, runs: Sequence[Trial]) -> tuple[float, float]:
    """Return the resolution of a velocity, 0 if it is fine, and the time between samples [s].

    A velocity that is not measured is a difference of positions. Its resolution is one position step per sample
    interval.
    """
    axis = DOFS[dof]
    for name in (axis.velocity, axis.position):
        channels = [run[name] for run in runs if name in run and len(run[name]) > 2]
        if channels:
            interval = float(np.median(np.concatenate([np.diff(c.t) for c in channels])))
            step = max(grid_step(c.values) for c in channels)
            return (step if name == axis.velocity else step / interval), interval
    return 0.0, float("nan")
