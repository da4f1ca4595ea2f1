"""What an identification returns: numbers, their uncertainty, and what to doubt about them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.models import SingleDof

__all__ = [
    "Candidate",
    "Decision",
    "Doubt",
    "Fit",
    "IsoEstimate",
    "LimitCycle",
    "Parameter",
    "Structure",
    "Trace",
]

Structure = Literal["linear", "nonlinear", "affine"]
"""Thesis words: ``linear`` = constant drag, ``nonlinear`` = drag linear in |nu|, ``affine`` = both."""

Status = Literal["fitted", "absent", "fixed", "at_bound"]


@dataclass(frozen=True, slots=True)
class Parameter:
    """One identified number. ``std`` is its standard error; 0 when the structure or the user fixed it."""

    name: str
    value: float
    unit: str
    std: float
    status: Status = "fitted"


@dataclass(frozen=True, slots=True)
class Doubt:
    """A reason not to trust a result blindly, with what may have caused it and what would cure it."""

    slug: str
    cause: str
    cure: str


@dataclass(frozen=True, slots=True)
class LimitCycle:
    """Self-oscillation read off one relay experiment (thesis 6.6-6.7).

    ``C`` relay output [input unit], ``x_a`` set and ``x_a_star`` real switching value, ``X_m`` amplitude,
    ``x_0`` bias [rad or m], ``omega`` [rad/s], ``T_H``/``T_L`` [s] times in high and low position,
    ``periods`` used, ``scatter`` largest relative spread of maxima and minima (the 10 % rule),
    ``valid`` condition (7.12). ``C`` is negative when the high position (of ``T_H``, the one that drives the
    position up) has the lower input; ``offset`` is the input midway between the two positions.
    """

    C: float
    x_a: float
    x_a_star: float
    X_m: float
    x_0: float
    omega: float
    T_H: float
    T_L: float
    periods: int
    scatter: float
    valid: bool
    offset: float = 0.0


@dataclass(frozen=True, slots=True)
class IsoEstimate:
    """IS-O's answer for one limit cycle: both drag structures come from the same reading (Table 6.3)."""

    cycle: LimitCycle
    alpha: float
    beta: float
    beta_quadratic: float
    delta: float
    delay: float


@dataclass(frozen=True, slots=True)
class Decision:
    """The two-experiment decision (7.1)-(7.2): percentages and the verdict at the chosen margin lambda."""

    sigma_alpha: float
    sigma_beta: float
    sigma_beta_quadratic: float
    margin: float
    verdict: Literal["linear", "nonlinear", "undecided"]


@dataclass(frozen=True, slots=True)
class Candidate:
    """One drag structure fitted by output error: what the decision between structures rests on."""

    structure: Structure
    model: SingleDof
    rms: float
    log_likelihood: float
    free_parameters: int
    bic: float


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """Fit against measurement for one run, for pictures: all arrays (n,), position in rad or m.

    ``band`` is the half-width of the 95 % band of the *fitted curve plus measurement noise*.
    """

    run: str
    t: NDArray[np.float64]
    measured: NDArray[np.float64]
    fitted: NDArray[np.float64]
    band: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A model of one degree of freedom with its uncertainty.

    ``covariance`` is that of ``(alpha, beta, beta_quadratic, delta, delay)`` with zero rows for what was
    not fitted; ``noise_std`` the measurement noise estimated from the residuals [rad or m];
    ``residual_rms`` that of the free-run simulation; ``fit_percent`` = 100 (1 - rms/std(signal)).
    """

    dof: str
    structure: Structure
    method: str
    model: SingleDof
    parameters: Mapping[str, Parameter]
    covariance: NDArray[np.float64]
    noise_std: float
    residual_rms: float
    fit_percent: float
    used: tuple[str, ...]
    doubts: tuple[Doubt, ...] = ()
    iso: tuple[IsoEstimate, ...] = ()
    decision: Decision | None = None
    candidates: tuple[Candidate, ...] = ()
    traces: tuple[Trace, ...] = ()
    extra: Mapping[str, Any] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form: ``dof``, ``structure``, ``parameters``, ``doubts`` and more."""
        return {
            "schema": 1,
            "dof": self.dof,
            "structure": self.structure,
            "method": self.method,
            "parameters": {
                name: {"value": p.value, "unit": p.unit, "std": p.std, "status": p.status}
                for name, p in self.parameters.items()
            },
            "noise_std": self.noise_std,
            "residual_rms": self.residual_rms,
            "fit_percent": self.fit_percent,
            "used": list(self.used),
            "doubts": [{"slug": d.slug, "cause": d.cause, "cure": d.cure} for d in self.doubts],
            "iso": [_iso_dict(e) for e in self.iso],
            "decision": None if self.decision is None else _slots_dict(self.decision),
            "candidates": [{**_slots_dict(c), "model": c.model.to_dict()} for c in self.candidates],
            "model": self.model.to_dict(),
            **self.extra,
        }


def _slots_dict(thing: Any) -> dict[str, Any]:
    return {name: getattr(thing, name) for name in thing.__slots__}


def _iso_dict(estimate: IsoEstimate) -> dict[str, Any]:
    return {**_slots_dict(estimate), "cycle": _slots_dict(estimate.cycle)}
