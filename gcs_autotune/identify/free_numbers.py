"""What any fit is of: segments and a form with limits, and the free numbers of a model in a row.

Both problems (:class:`.Problem`, :class:`.NoisyProblem` with process noise) and their objectives build on these.
Nothing here simulates or fits: an objective takes the data of a problem, a problem's ``fit`` takes an objective.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import EFFECTS, DataSummary, EffectInstance
from gcs_autotune.identify.limits import Limits
from gcs_autotune.identify.segment import Segment
from gcs_autotune.kept_results import fingerprint
from gcs_autotune.models import Form

__all__ = ["DIAGNOSTIC", "WEAK", "FreeNumbers", "ModelFit", "ModelProblem", "StampPrior", "StampedProblem", "label_of"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

Held = tuple[str, str, str]
"""Slug, place and name of an effect's number that stays as it is."""


class ModelProblem:
    """Segments and a form, ready to be fitted with any effects.

    Parameters
    ----------
    data_summary : what effects are told of the runs; None where none will be fitted. limits : of the base's parameters.
    free : base parameters to fit (all free ones when None). held : numbers of effects that stay as they are.
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
        """What effects are told of the runs."""
        assert self.summary is not None, "effects cannot be fitted without it"
        return self.summary

    @property
    def known(self) -> tuple[object, ...]:
        """All that the problem is made of."""
        return self.form, self.segments, self.summary, self.limits, self.free, self.held

    @cached_property
    def fingerprint(self) -> str:
        """What tells this problem from others, for results that are kept."""
        return fingerprint(*self.known)

    def edges(self, effects: Sequence[EffectInstance], free_effects: Sequence[tuple[int, str]]) -> tuple[Array, Array]:
        """Return the limits (f,) of the base parameters fitted, then of the effects' parameters *free_effects*."""
        low, high = self.limits.of(self.free)
        if not free_effects:
            return low, high
        own = [EFFECTS[effects[i].slug].bounds(effects[i].place, self.data_summary) for i, _ in free_effects]
        pairs = [e.get(n, (-np.inf, np.inf)) for e, (_, n) in zip(own, free_effects, strict=True)]
        return np.concatenate([low, [p[0] for p in pairs]]), np.concatenate([high, [p[1] for p in pairs]])


@dataclass(frozen=True, slots=True)
class StampPrior:
    """Standard deviation of the shift of stamps, and how far it may go, in units of ``Segment.dating``."""

    std: float
    reach: float


WEAK = StampPrior(2.0, 8.0)
"""Of an identification. Chosen: the shift may well stand at the very end of what the stamps allow, and twice that is
weak enough not to pull it back by a tenth of its standard error."""

DIAGNOSTIC = StampPrior(1.0, 1.5)
"""Of a diagnosis, where a delay is among the causes looked for and must not be taken by the shift: to the end of what
the messages allow, and a little beyond for an autopilot that acts on its next loop only."""


class StampedProblem(ModelProblem):
    """A problem in which the stamps of all inputs may be off by one shift.

    Parameters
    ----------
    As of :class:`ModelProblem`, and

    stamps : what is known of the shift of input stamps; by default as for a diagnosis when there is a *data_summary*.
        With a free delay there is no shift: the two are one number.
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
        """All that the problem is made of."""
        return *super().known, self.stamps

    @property
    def shift_std(self) -> float:
        """Standard deviation [s] with which the shift of stamps is known to be none; 0 when stamps are exact."""
        return self.stamps.std * self.dating


class FreeNumbers:
    """The numbers a fit shares between segments, in a row: free base parameters, then those of effects.

    Parameters
    ----------
    theta : base parameters: what is not free stays. places : of the free ones in it. effects : in the order in which
    they act. held : numbers of effects that stay, besides the problem's; fixed_effects : all of them do.
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
        """Return these numbers (f,)."""
        return np.concatenate([self.theta[self.places], [self.effects[i].values[n] for i, n in self.free_effects]])

    def unpack_shared(self, x: Array) -> tuple[Array, tuple[EffectInstance, ...]]:
        """Return all base parameters, and the effects, of a vector that begins with these numbers."""
        p = len(self.places)
        theta = self.theta.copy()
        theta[self.places] = x[:p]
        values: list[dict[str, float]] = [{} for _ in self.effects]
        for (i, name), value in zip(self.free_effects, x[p : self.shared].tolist(), strict=True):
            values[i][name] = value
        return theta, tuple(e.with_values(v) for e, v in zip(self.effects, values, strict=True))


@dataclass(frozen=True, slots=True, eq=False)
class ModelFit:
    """A model fitted to a problem: :class:`.Fitted` by least squares, :class:`.NoisyFit` with process noise.

    ``theta`` (p,) base parameters, ``free`` names of those that were fitted; ``effects`` with their values,
    ``free_effects``: (index, name) of their numbers that were fitted, in the order of :class:`FreeNumbers`.
    """

    form: Form
    theta: Array
    effects: tuple[EffectInstance, ...]
    free: tuple[str, ...]
    free_effects: tuple[tuple[int, str], ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names (f,) of the fitted numbers: base parameters, then those of the effects as a fit calls them."""
        return (*self.free, *(label_of(self.effects[i], n) for i, n in self.free_effects))

    def own(self, effect: EffectInstance) -> EffectInstance:
        """Return the effect of the same slug and place with this fit's values."""
        return next(e for e in self.effects if (e.slug, e.place) == (effect.slug, effect.place))

    def without(self, effect: EffectInstance) -> tuple[EffectInstance, ...]:
        """Return the effects but that of the same slug and place."""
        return tuple(e for e in self.effects if (e.slug, e.place) != (effect.slug, effect.place))

    def errors_in(self, covariance: Array, effect: EffectInstance) -> dict[str, float]:
        """Return the standard errors of those of an effect's numbers that were fitted. covariance : (q, q)."""
        i = self.effects.index(self.own(effect))
        variances = np.diag(covariance)[len(self.free) :]
        found = zip(self.free_effects, variances, strict=False)
        return {name: float(np.sqrt(max(v, 0.0))) for (k, name), v in found if k == i}


def label_of(own: EffectInstance, name: str) -> str:
    """Return what a fit calls a parameter of an effect: ``dead-zone@N.width``."""
    return f"{own.slug}@{own.place}.{name}"
