"""What a plan gives: each step's fit, what the steps agree on, and the whole model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.plan.combine import Agreement
from gcs_autotune.identify.plan.plan import Plan, Step
from gcs_autotune.identify.result import Doubt, Fit, Parameter
from gcs_autotune.identify.validate import Validation
from gcs_autotune.models.coupled import CoupledModel

__all__ = ["PlanResult", "StepResult"]


@dataclass(frozen=True, slots=True, eq=False)
class StepResult:
    """One step done. ``unseen``: the validation ran on runs kept from the fit, not on one of its own."""

    step: Step
    fit: Fit
    validation: Validation | None
    unseen: bool

    def to_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "name": self.step.name,
            "isolated": list(self.step.isolated),
            "shared": list(self.step.shared),
            "held": list(self.step.held),
            "fit": self.fit.to_dict(),
            "validation": None if self.validation is None else self.validation.to_dict(),
            "validated_on_unseen_runs": self.unseen,
        }


@dataclass(frozen=True, slots=True, eq=False)
class PlanResult:
    """Everything a plan found.

    ``parameters`` after the joint fit of all runs, ``covariance`` (k, k) in their order; ``combined`` before it, from
    the steps' estimates weighted by information; ``agreements`` per shared parameter; ``model`` the final form with the
    values, ``final`` its free run on runs nothing was fitted to; ``skipped``: steps without runs.
    """

    plan: Plan
    steps: tuple[StepResult, ...]
    parameters: Mapping[str, Parameter]
    covariance: NDArray[np.float64]
    combined: Mapping[str, float]
    agreements: tuple[Agreement, ...]
    model: CoupledModel | None
    final: Validation | None
    skipped: tuple[str, ...]
    doubts: tuple[Doubt, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "schema": 1,
            "plan": self.plan.name,
            "steps": [s.to_dict() for s in self.steps],
            "parameters": {
                n: {"value": p.value, "unit": p.unit, "std": p.std, "status": p.status}
                for n, p in self.parameters.items()
            },
            "covariance": self.covariance.tolist(),
            "combined": dict(self.combined),
            "agreements": [
                {
                    "name": a.name,
                    "steps": dict(zip(a.steps, a.values, strict=True)),
                    "stds": list(a.stds),
                    "combined": a.combined,
                    "plain_mean": a.mean,
                    "probability": a.probability,
                }
                for a in self.agreements
            ],
            "model": None if self.model is None else self.model.to_dict(),
            "final": None if self.final is None else self.final.to_dict(),
            "skipped": list(self.skipped),
            "doubts": [{"slug": d.slug, "cause": d.cause, "cure": d.cure} for d in self.doubts],
        }
