"""What an identification method is handed, and the small things every method needs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.relay.iso import decide, most_different_pair
from gcs_autotune.identify.result import Decision, IsoEstimate, LimitCycle, Parameter, Status, Structure
from gcs_autotune.identify.segment import Segment
from gcs_autotune.models import SingleDof
from gcs_autotune.trial import Trial

__all__ = ["Case", "named_parameters", "two_experiment_decision"]


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """One question: these stretches, these limit cycles in them, what to assume.

    ``structure`` None: decide. ``delay`` None: fit one if there is strong evidence. ``use`` None: choose the
    signals. ``robust``: soft-L1 weights. ``names`` of the runs; ``dropped_rows`` in the files they came from;
    ``trials`` the runs as recorded; ``options`` what the method alone understands.
    """

    records: Sequence[Segment]
    cycles: Sequence[LimitCycle]
    structure: Structure | None
    delay: float | None
    use: Sequence[str] | None
    robust: bool
    names: tuple[str, ...]
    dropped_rows: int
    trials: tuple[Trial, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def largest(self) -> dict[str, float]:
        """The largest input of all runs, by its name."""
        return {self.records[0].input_names[0]: max(float(np.max(np.abs(r.tau))) for r in self.records)}

    @property
    def relay_flown(self) -> bool:
        """Whether a relay was flown: a zig-zag by hand also switches at two headings, but nobody ran a relay there."""
        return any(t.by_relay for t in self.trials)

    @property
    def cut_short(self) -> bool:
        """Whether a relay was ended on purpose, as enough was known: it has few periods, and need not have settled."""
        return any(t.by_relay and bool(t.meta.get("enough")) for t in self.trials)

    @property
    def more_levels(self) -> str:
        """What to do so that kinds of damping, or damping and delay, can be told apart."""
        if self.relay_flown:
            return "fly a second relay with a clearly different C"
        return "record a run with clearly larger or smaller inputs as well"


def two_experiment_decision(estimates: Sequence[IsoEstimate]) -> Decision | None:
    """Return the decision from the two most different limit cycles, None when there are no two."""
    pair = most_different_pair(tuple(estimates))
    return None if pair is None else decide(*pair)


def named_parameters(
    model: SingleDof, covariance: NDArray[np.float64], status: Sequence[Status], bounds: Sequence[float] = ()
) -> dict[str, Parameter]:
    """Return the four parameters and ``delay`` under their names.

    covariance : (5, 5) of (alpha, beta, beta_quadratic, delta, delay). status, bounds : one per parameter.
    """
    names = (*model.axis.parameter_names(), "delay")
    units = (*model.axis.parameter_units(model.input_unit), "s")
    values = (model.alpha, model.beta, model.beta_quadratic, model.delta, model.delay)
    stds = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    least = tuple(bounds) or (math.nan,) * len(names)
    return {
        n: Parameter(n, float(v), u, float(s), state, float(bound))
        for n, v, u, s, state, bound in zip(names, values, units, stds, status, least, strict=True)
    }
