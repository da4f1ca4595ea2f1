"""Common base of all fits: segments, a form with limits, and the vector of free parameters.

:class:`.Problem`, :class:`.NoisyProblem` (with process noise) and their objectives build on these. This module contains
no simulation and no fit. An objective takes the data of a problem. The ``fit`` method of a problem minimises an
objective.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import EFFECTS, DataSummary, EffectInstance
from gcs_autotune.identify.problems.limits import Limits
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.kept_results import fingerprint
from gcs_autotune.models import Form

__all__ = ["DIAGNOSTIC", "WEAK", "FreeNumbers", "ModelFit", "ModelProblem", "StampPrior", "StampedProblem"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

Held = tuple[str, str, str]
"""Slug, place and name of an effect's parameter that stays fixed."""


class ModelProblem:
    """Segments and a form, to be fitted with any effects.

    Parameters
    ----------
    data_summary : summary of the runs for effects; None if no effects are fitted.
    limits : lower and upper limits of the base parameters.
    free : names of the base parameters to fit; None for all free ones of the form.
    held : parameters of effects that stay fixed, as (slug, place, name).
    """

    def __init__(
        self,
        form: Form,
        segments: Sequence[Segment],
        data_summary: DataSummary | None,
        limits: Limits,
        free: Sequence[str] | None = None,
        held: Collection[Held] = (),
    ) -> None:
        self.form = form
        self.segments = tuple(segments)
        self.summary = data_summary
        self.limits = limits
        self.free = tuple(form.free if free is None else free)
        self.held = frozenset(held)

    @property
    def data_summary(self) -> DataSummary:
        """Summary of the runs that is passed to the effects."""
        assert self.summary is not None, "effects cannot be fitted without it"
        return self.summary

    @property
    def known(self) -> tuple[object, ...]:
        """All data that define the problem, from which :attr:`fingerprint` is calculated."""
        return self.form, self.segments, self.summary, self.limits, self.free, self.held

    @cached_property
    def fingerprint(self) -> str:
        """Hash of the problem, used to look up cached results."""
        return fingerprint(*self.known)

    def edges(self, effects: Sequence[EffectInstance], free_effects: Sequence[tuple[int, str]]) -> tuple[Array, Array]:
        """Return the lower and upper limits (f,) of the free base parameters, then of the parameters *free_effects*."""
        low, high = self.limits.of(self.free)
        if not free_effects:
            return low, high
        own = [EFFECTS[effects[i].slug].bounds(effects[i].place, self.data_summary) for i, _ in free_effects]
        pairs = [e.get(n, (-np.inf, np.inf)) for e, (_, n) in zip(own, free_effects, strict=True)]
        return np.concatenate([low, [p[0] for p in pairs]]), np.concatenate([high, [p[1] for p in pairs]])


@dataclass(frozen=True, slots=True)
class StampPrior:
    """Prior for the common shift of input stamps.

    - ``std``: standard deviation, in units of ``Segment.dating``.
    - ``reach``: largest shift, in units of ``Segment.dating``.
    """

    std: float
    reach: float


WEAK = StampPrior(2.0, 8.0)
"""Prior of an identification: twice the range that the stamps allow, because the true shift may be at its limit.

Project choice: the prior changes the shift by less than a tenth of its standard error.
"""

DIAGNOSTIC = StampPrior(1.0, 1.5)
"""Prior of a diagnosis: just above the range that the stamps allow.

Project choice. It assumes that the autopilot acts on its next loop.

A delay is among the possible causes, so the shift must not absorb it.
"""


class StampedProblem(ModelProblem):
    """A problem in which the stamps of all inputs may have a common shift.

    Parameters
    ----------
    As for :class:`ModelProblem`, and

    stamps : prior of the shift of input stamps. The default with a *data_summary* is that of a diagnosis.
        If the delay is free, there is no shift, because both have the same effect.
    """

    def __init__(
        self,
        form: Form,
        segments: Sequence[Segment],
        data_summary: DataSummary | None,
        limits: Limits,
        free: Sequence[str] | None = None,
        held: Collection[Held] = (),
        stamps: StampPrior | None = None,
    ) -> None:
        super().__init__(form, segments, data_summary, limits, free, held)
        self.stamps = stamps or (WEAK if data_summary is None else DIAGNOSTIC)
        dating = max((s.dating for s in self.segments), default=0.0)
        self.dating = 0.0 if "delay" in self.free else dating

    @property
    def known(self) -> tuple[object, ...]:
        """All data that define the problem, including the prior of the stamps."""
        return *super().known, self.stamps

    @property
    def shift_std(self) -> float:
        """Prior standard deviation [s] of the shift of stamps; 0 if stamps are exact."""
        return self.stamps.std * self.dating


class FreeNumbers:
    """Vector of the parameters common to all segments: free base parameters, then those of effects.

    Parameters
    ----------
    theta : all base parameters, with values for those not free.
    places : indices of the free ones in *theta*.
    effects : in the order in which they act.
    held : further parameters of effects that stay fixed, in addition to those of the problem.
    fixed_effects : whether all parameters of effects stay fixed.
    """

    def __init__(
        self,
        problem: ModelProblem,
        theta: Array,
        places: Index,
        effects: Sequence[EffectInstance],
        *,
        held: Collection[Held] = (),
        fixed_effects: bool = False,
    ) -> None:
        self.theta, self.places, self.effects = theta, places, tuple(effects)
        self.free_effects = tuple(
            (i, name)
            for i, own in enumerate(self.effects)
            for name in own.values
            if not fixed_effects and name not in EFFECTS[own.slug].fixed and not EFFECTS[own.slug].is_disturbance
            if (own.slug, own.place, name) not in problem.held and (own.slug, own.place, name) not in held
        )
        self.shared = len(places) + len(self.free_effects)

    def pack_shared(self) -> Array:
        """Return the free parameters (f,) as a vector."""
        return np.concatenate([self.theta[self.places], [self.effects[i].values[n] for i, n in self.free_effects]])

    def unpack_shared(self, x: Array) -> tuple[Array, tuple[EffectInstance, ...]]:
        """Return all base parameters (p,) and the effects for a vector *x* that begins with the free parameters."""
        p = len(self.places)
        theta = self.theta.copy()
        theta[self.places] = x[:p]
        values: list[dict[str, float]] = [{} for _ in self.effects]
        for (i, name), value in zip(self.free_effects, x[p : self.shared].tolist(), strict=True):
            values[i][name] = value
        return theta, tuple(e.with_values(v) for e, v in zip(self.effects, values, strict=True))


@dataclass(frozen=True, slots=True, eq=False)
class ModelFit:
    """A model fitted to a problem: :class:`.Fitted` by least squares, or :class:`.NoisyFit` with process noise.

    - ``theta`` (p,): base parameters.
    - ``free``: names of the fitted base parameters.
    - ``effects``: effects with their values.
    - ``free_effects``: (index of the effect, name) of each fitted parameter of an effect. Their order is that of
      :class:`FreeNumbers`.
    """

    form: Form
    theta: Array
    effects: tuple[EffectInstance, ...]
    free: tuple[str, ...]
    free_effects: tuple[tuple[int, str], ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names (f,) of the fitted base parameters, then labels of the fitted parameters of effects."""
        return (*self.free, *(self.effects[i].label_of(n) for i, n in self.free_effects))

    def own(self, effect: EffectInstance) -> EffectInstance:
        """Return the effect of this fit that has the slug and place of *effect*."""
        return next(e for e in self.effects if (e.slug, e.place) == (effect.slug, effect.place))

    def without(self, effect: EffectInstance) -> tuple[EffectInstance, ...]:
        """Return all effects of this fit except the one with the slug and place of *effect*."""
        return tuple(e for e in self.effects if (e.slug, e.place) != (effect.slug, effect.place))

    def errors_in(self, covariance: Array, effect: EffectInstance) -> dict[str, float]:
        """Return name -> standard error of the fitted parameters of *effect*.

        covariance : (q, q) covariance of the fitted values.
        """
        i = self.effects.index(self.own(effect))
        variances = np.diag(covariance)[len(self.free) :]
        pairs = zip(self.free_effects, variances, strict=False)
        return {name: float(np.sqrt(max(v, 0.0))) for (k, name), v in pairs if k == i}
