"""Maximise the likelihood of a fitted model, and refit it with one parameter fixed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.problems.information import FittedModel
from gcs_autotune.identify.problems.least_squares import descend
from gcs_autotune.identify.problems.noise import NoiseModel, gaussian_noise
from gcs_autotune.identify.problems.reweighting import alternate

__all__ = ["MostLikely"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class MostLikely:
    """A fitted model at its maximum of likelihood.

    - ``subject``: the model and its runs.
    - ``noise_models``: name of the signal -> noise model.
    - ``cost``: minus twice the log-likelihood at the maximum.
    """

    subject: FittedModel
    noise_models: Mapping[str, NoiseModel]
    cost: float

    @classmethod
    def of(cls, subject: FittedModel, rounds: int) -> MostLikely:
        """Return *subject* at the maximum of its likelihood.

        The model and the noise of its signals are fitted in turn, for at most *rounds*.

        Raises
        ------
        NotInformative
            The model diverges.
        """
        objective = subject.objective()
        wide = np.full(objective.size, np.inf)
        fitted = alternate(objective, objective.pack(), gaussian_noise(subject.noise), -wide, wide, rounds)
        if fitted is None:
            raise NotInformative(f"the model '{subject.form.name}' diverges on its runs")
        minimum, laws = fitted
        theta, _, initial, _ = objective.unpack(minimum.x)
        local = objective.at(minimum.x, laws)
        assert local is not None
        return cls(replace(subject, theta=theta, initial=initial), laws, local.cost)

    def holding(
        self, place: int, value: float, theta: Array, initial: tuple[Array, ...]
    ) -> tuple[float, Array, tuple[Array, ...]] | None:
        """Return the refit with the fitted parameter at index *place* fixed at *value*.

        The fit starts at *theta* and *initial*. The result is the cost, theta and the initial states, or None if the
        model diverges.
        """
        subject, theta = self.subject, theta.copy()
        own = subject.free[place]
        theta[subject.form.parameters.index(own)] = value * subject.signs[place]
        others = tuple(n for n in subject.free if n != own)
        objective = replace(subject, theta=theta, initial=initial).objective(others)
        wide = np.full(objective.size, np.inf)
        minimum = descend(partial(objective.at, noise=self.noise_models), objective.pack(), -wide, wide)
        if minimum is None:
            return None
        there, _, states, _ = objective.unpack(minimum.x)
        return minimum.cost, there, states
