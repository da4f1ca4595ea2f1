"""Free run on runs the model has not seen: what ``Fit.validate`` does, for every kind of model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gcs_autotune.effects import ExtendedModel
from gcs_autotune.errors import UsageError
from gcs_autotune.identify.axis import validation as axis
from gcs_autotune.identify.axis.validation import ResidualStatistics, residual_statistics
from gcs_autotune.identify.coupled import free_run as coupled
from gcs_autotune.identify.extended import free_run as extended
from gcs_autotune.identify.result import Trace
from gcs_autotune.models import SingleDof
from gcs_autotune.models.coupled import CoupledModel
from gcs_autotune.trial import Trial

__all__ = ["Validation", "join", "validate"]


@dataclass(frozen=True, slots=True, eq=False)
class Validation:
    """How well a model predicts: one trace and its statistics per run and signal."""

    traces: tuple[Trace, ...]
    statistics: tuple[ResidualStatistics, ...]

    @property
    def fit_percent(self) -> float:
        """100 (1 - rms/std), averaged over runs and signals; 0 is as good as the mean, below 0 worse."""
        return float(np.mean([s.fit_percent for s in self.statistics])) if self.statistics else math.nan

    def to_dict(self) -> dict[str, Any]:
        """Return the statistics as plain data."""
        rows = [
            {"run": t.run, "signal": t.signal, "unit": t.unit, "rms": s.rms, "fit_percent": s.fit_percent, "n": s.n}
            for t, s in zip(self.traces, self.statistics, strict=True)
        ]
        return {"fit_percent": self.fit_percent, "runs": rows}


def validate(model: Any, runs: Trial | Sequence[Trial]) -> Validation:
    """Simulate *runs* with *model*, only initial states fitted to them.

    Raises
    ------
    UsageError
        The model is of a kind that cannot be simulated on a run.
    NotInformative
        The model runs away on a run's input; and as the preparation of the runs.
    """
    together = (runs,) if isinstance(runs, Trial) else tuple(runs)
    if isinstance(model, SingleDof):
        traces = [trace for run in together for trace in axis.free_runs(model, run)]
    elif isinstance(model, CoupledModel):
        traces = [trace for run in together for trace in coupled.free_runs(model, run)]
    elif isinstance(model, ExtendedModel):
        traces = [trace for run in together for trace in extended.free_runs(model, run)]
    else:
        raise UsageError(f"a {type(model).__name__} cannot be validated on runs")
    return Validation(tuple(traces), tuple(residual_statistics(t) for t in traces))


def join(parts: Sequence[Validation]) -> Validation:
    """Return several validations as one."""
    return Validation(
        tuple(t for part in parts for t in part.traces), tuple(s for part in parts for s in part.statistics)
    )
