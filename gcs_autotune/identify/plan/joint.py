"""All steps fitted at once: every step's own equations and runs, one vector of parameters.

What a step held is free here, so its uncertainty reaches the other parameters, and the covariance is that of all runs
together. The steps' estimates are the start; the noise of each signal is the one its step found.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.axis.likelihood import Law, gaussian_laws
from gcs_autotune.identify.coupled.objective import CoupledObjective
from gcs_autotune.identify.coupled.record import CoupledRecord
from gcs_autotune.identify.coupled.start import first_states, motions_of
from gcs_autotune.identify.least_squares import Local, descend, inverse_of
from gcs_autotune.models.coupled import Form

__all__ = ["Joint", "Part", "fit_jointly"]

Array = NDArray[np.float64]



@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """One step in the joint fit: its form, all parameters free that any step identifies, and what they are called.

    ``names`` (f,) the joint names of ``form.free``; ``noise`` standard deviation per signal.
    """

    form: Form
    names: tuple[str, ...]
    records: tuple[CoupledRecord, ...]
    noise: Mapping[str, float]


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """Values (k,) of ``names``, covariance (k, k), misfit per sample (1 when the noise is what the steps found)."""

    names: tuple[str, ...]
    values: Array
    covariance: Array
    misfit: float
    converged: bool


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    objective: CoupledObjective
    laws: Mapping[str, Law]
    columns: NDArray[np.int64]


def fit_jointly(parts: Sequence[Part], start: Mapping[str, float]) -> Joint | None:
    """Minimise the sum of all parts' misfits from *start* (joint name -> value); None when that start runs away."""
    names = tuple(dict.fromkeys(n for part in parts for n in part.names))
    places, x = _placed(parts, names, start)

    def local(vector: Array) -> Local | None:
        cost, gradient, curvature = 0.0, np.zeros(len(vector)), np.zeros((len(vector),) * 2)
        for place in places:
            own = place.objective.at(vector[place.columns], place.laws)
            if own is None:
                return None
            cost += own.cost
            gradient[place.columns] += own.gradient
            curvature[np.ix_(place.columns, place.columns)] += own.curvature
        return Local(cost, gradient, curvature)

    still = np.concatenate([x[: len(names)], np.full(len(x) - len(names), np.inf)])
    settled = descend(local, x, np.where(np.isinf(still), -np.inf, still), still)
    if settled is None:
        return None
    everywhere = np.full(len(x), np.inf)
    found = descend(local, settled.x, -everywhere, everywhere)
    here = None if found is None else local(found.x)
    if found is None or here is None:
        return None
    covariance = inverse_of(here.curvature)[: len(names), : len(names)]
    samples = sum(len(s.t) for p in parts for r in p.records for s in r.signals.values())
    return Joint(names, found.x[: len(names)], covariance, here.cost / max(samples - len(x), 1), found.converged)


def _placed(parts: Sequence[Part], names: Sequence[str], start: Mapping[str, float]) -> tuple[list[_Place], Array]:
    """Return every part's objective with its columns of the joint vector, and that vector at the start."""
    places, used, states = [], len(names), []
    for part in parts:
        form = part.form
        theta = np.array(
            [start[part.names[form.free.index(n)]] if n in form.free else form.known[n] for n in form.parameters]
        )
        initial = first_states(form, part.records, motions_of(form, part.records, form.known.get("delay", 0.0)))
        objective = CoupledObjective(form, part.records, form.free, theta, initial)
        own = objective.size - len(form.free)
        shared = np.array([names.index(n) for n in part.names], dtype=np.int64)
        columns = np.concatenate([shared, used + np.arange(own)])
        places.append(_Place(objective, gaussian_laws(part.noise, robust=False), columns))
        states.append(objective.pack()[len(form.free) :])
        used += own
    return places, np.concatenate([np.array([start[n] for n in names]), *states])
