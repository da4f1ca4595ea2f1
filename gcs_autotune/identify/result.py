"""Define the result of an identification: parameters, their uncertainty, and doubts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, Literal, Protocol, TypeAlias, TypeGuard, TypeVar

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import EffectInstance, ExtendedModel, may_be_none
from gcs_autotune.identify.axis.form import Structure, as_extended
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.signals.whiteness import Remainder, remainder_of
from gcs_autotune.models import SingleDof
from gcs_autotune.notebook import Display, Displayed, Table, pandas_module, parameter_tables
from gcs_autotune.plain_json import json_text, plain_data
from gcs_autotune.rounding import HALF_WIDTH, format_number
from gcs_autotune.sname import SIGNALS

__all__ = [
    "AxisFit",
    "Decision",
    "Fit",
    "IsoEstimate",
    "LimitCycle",
    "Model",
    "Parameter",
    "Residuals",
    "Structure",
    "StructureFit",
    "Trace",
    "is_of_one_axis",
    "plain_data",
]


Status = Literal["fitted", "absent", "fixed", "at_bound"]


@dataclass(frozen=True, slots=True)
class Parameter(Displayed):
    """One identified parameter.

    - ``std``: standard error, 0 if the structure or the user fixed the value.
    - ``status``: whether the value was fitted, fixed or absent, or is on a limit.
    - ``bound``: Cramer-Rao bound, NaN if unknown. No unbiased method can have a smaller standard error on these runs
      with their noise.
    """

    name: str
    value: float
    unit: str
    std: float
    status: Status = "fitted"
    bound: float = math.nan


@dataclass(frozen=True, slots=True)
class LimitCycle(Displayed):
    """Limit cycle of one relay experiment (Miskovic2010, 6.6-6.7).

    - ``C``: relay output [input unit]. It is negative if the high position of the relay has the lower input.
    - ``x_a``: switching value as set [rad or m].
    - ``x_a_star``: actual switching value [rad or m].
    - ``X_m``: amplitude [rad or m].
    - ``x_0``: bias [rad or m].
    - ``omega``: frequency [rad/s].
    - ``T_H``, ``T_L``: times in the high and the low position of the relay [s].
    - ``periods``: number of periods used.
    - ``scatter``: largest relative spread of maxima and minima (the 10 % rule).
    - ``valid``: whether condition (7.12) is satisfied.
    - ``offset``: input midway between the two positions.
    - ``nu_0``: mean velocity, if the relay acts on an integrated velocity (surge, Miskovic2010, eq. (6.48)), else 0.

    The high position is the one that makes the measured position increase.
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
    nu_0: float = 0.0


@dataclass(frozen=True, slots=True)
class IsoEstimate(Displayed):
    """Result of IS-O for one limit cycle. Both drag structures come from the same reading (Miskovic2010, Table 6.3).

    - ``cycle``: the limit cycle.
    - ``alpha``: inertia.
    - ``beta``: drag of the linear structure.
    - ``beta_quadratic``: drag of the structure with quadratic drag.
    - ``delta``: constant force, which applies together with ``beta``. It depends on the drag only if the limit cycle
      has a mean velocity.
    - ``delay`` [s]: known delay.
    """

    cycle: LimitCycle
    alpha: float
    beta: float
    beta_quadratic: float
    delta: float
    delay: float


@dataclass(frozen=True, slots=True)
class Decision(Displayed):
    """Decision between linear and quadratic drag from two experiments (Miskovic2010 (7.1)-(7.2)).

    - ``sigma_*`` [%]: relative differences of the parameters between the experiments.
    - ``margin`` [%]: the chosen lambda.
    - ``verdict``: ``linear``, ``nonlinear`` or ``undecided``.
    """

    sigma_alpha: float
    sigma_beta: float
    sigma_beta_quadratic: float
    margin: float
    verdict: Literal["linear", "nonlinear", "undecided"]


@dataclass(frozen=True, slots=True)
class StructureFit(Displayed):
    """One drag structure fitted by output error, with the numbers by which the structures are compared."""

    structure: Structure
    model: SingleDof
    rms: float
    log_likelihood: float
    free_parameters: int
    bic: float


@dataclass(frozen=True, slots=True, eq=False)
class Trace(Displayed):
    """Measured and fitted values of one signal in one run, for plots.

    All arrays are (n,), in SI units.

    - ``t``: stamps [s].
    - ``measured``, ``fitted``: values.
    - ``band``: half-width of the 95 % band of the *fitted curve plus measurement noise*.
    """

    run: str
    t: NDArray[np.float64]
    measured: NDArray[np.float64]
    fitted: NDArray[np.float64]
    band: NDArray[np.float64]
    signal: str = ""
    unit: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Residuals:
    """Residuals of one signal in one run.

    - ``t`` (n,): stamps [s].
    - ``values`` (n,): measured minus fitted values, in SI units.
    """

    run: str
    signal: str
    unit: str
    t: NDArray[np.float64]
    values: NDArray[np.float64]


class Model(Protocol):
    """Common interface of all identified models."""

    def to_dict(self) -> dict[str, Any]:
        """Return the model as data for a model file."""
        ...


ModelT = TypeVar("ModelT", bound=Model, covariant=True)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Fit(Displayed, Generic[ModelT]):
    """An identified model with its uncertainty, for any method and structure. ``print`` shows a table of it.

    - ``covariance`` (p, p): in the order of ``parameters``, with zero rows for fixed parameters.
    - ``fit_percent``: 100 (1 - rms/std) of the free-run simulation, averaged over signals.
    - ``used``: names of the runs.
    - ``noise``: name of the signal -> standard deviation (SI) that the fit treats as noise; :attr:`remainder` shows how
      much of it is noise.

    For one degree of freedom, ``parameters`` are ``(alpha, beta, beta_quadratic, delta, delay)``. The parameters of the
    actuator's ``effects`` (thrust curve, dead zone) follow, if fitted. For several degrees of freedom the next fields
    are empty or NaN.

    - ``noise_std``: standard deviation [rad or m] of the noise in the main signal.
    - ``residual_rms``: root mean square residual [rad or m] of the free-run simulation.
    - ``iso``: readings of limit cycles.
    - ``decision``, ``candidates``: comparisons by which the drag structure was chosen.
    """

    dof: str
    structure: str
    method: str
    model: ModelT
    parameters: Mapping[str, Parameter]
    covariance: NDArray[np.float64]
    fit_percent: float
    used: tuple[str, ...]
    noise: Mapping[str, float] = field(default_factory=dict)
    doubts: tuple[Doubt, ...] = ()
    traces: tuple[Trace, ...] = ()
    extra: Mapping[str, Any] = field(default_factory=dict)
    noise_std: float = math.nan
    residual_rms: float = math.nan
    iso: tuple[IsoEstimate, ...] = ()
    decision: Decision | None = None
    candidates: tuple[StructureFit, ...] = ()
    effects: tuple[EffectInstance, ...] = ()

    @property
    def craft_covariance(self) -> NDArray[np.float64]:
        """Covariance (5, 5) of ``(alpha, beta, beta_quadratic, delta, delay)`` for one degree of freedom."""
        return self.covariance[:5, :5]

    @property
    def correlation(self) -> NDArray[np.float64]:
        """Correlation (p, p) of the estimates, in the order of ``parameters``; zero for those not fitted."""
        std = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        scale = np.where(std > 0.0, std, np.inf)
        result: NDArray[np.float64] = self.covariance / np.outer(scale, scale)
        return result

    @property
    def residuals(self) -> tuple[Residuals, ...]:
        """Measured minus fitted values, one element per run and signal."""
        return tuple(Residuals(t.run, t.signal, t.unit, t.t, t.measured - t.fitted) for t in self.traces)

    @property
    def unexplained(self) -> float:
        """Fraction of the motion that the model does not explain [%]."""
        return 100.0 - self.fit_percent

    @property
    def significant_effects(self) -> tuple[EffectInstance, ...]:
        """The ``effects`` whose 95 % intervals exclude the case of no effect, so no thrust curve that may be
        straight."""
        return tuple(
            own
            for own in self.effects
            if not may_be_none(
                own,
                {n: self.parameters[label].std for n in own.values if (label := own.label_of(n)) in self.parameters},
            )
        )

    @property
    def whole_model(self: Fit[Model]) -> Model:
        """Model of the fit. For one axis it includes the effects of the actuator, if fitted."""
        if not is_of_one_axis(self) or not self.effects:
            return self.model
        plain = as_extended(self.model)
        inputs = plain.base.form.inputs
        full_scale = {str(k): float(v) for k, v in self.extra.get("swing", {}).items() if k in inputs}
        units = dict.fromkeys(inputs, self.model.input_unit)
        return ExtendedModel(plain.base, (*plain.effects, *self.effects), full_scale, units)

    @property
    def remainder(self) -> Mapping[str, Remainder]:
        """Name of the signal -> its residual, and how much of the residual is noise."""
        steps = self.extra.get("quantum") or {}
        rounding = self.extra.get("rounding") or {n: float(q) / math.sqrt(12.0) for n, q in steps.items()}
        signals = dict.fromkeys(t.signal for t in self.traces)
        residuals = {s: [t.measured - t.fitted for t in self.traces if t.signal == s] for s in signals}
        return {s: remainder_of(errors, float(rounding.get(s) or 0.0)) for s, errors in residuals.items()}

    @property
    def lacks_a_term(self) -> bool:
        """Whether more than noise is unexplained in a signal, so that the model lacks a term."""
        return any(left.unexplained > left.noise for left in self.remainder.values())

    def to_pandas(self) -> Any:
        """Return a pandas DataFrame in SI units, one row per parameter.

        Columns: ``value``, ``std``, ``low`` and ``high`` of the 95 % interval, ``bound`` (Cramér-Rao), ``unit``,
        ``status``.

        Raises
        ------
        UsageError
            pandas is not installed.

        Examples
        --------
        >>> from gcs_autotune.api import example_run, fit
        >>> table = fit(example_run(), "linear", dof="yaw", delay=0.0).to_pandas()
        >>> table.loc["beta_r", "unit"], bool(table.loc["beta_r", "low"] < 0.5 < table.loc["beta_r", "high"])
        ('s/rad', True)
        """
        rows = [
            {
                "value": p.value,
                "std": p.std,
                "low": p.value - HALF_WIDTH * p.std,
                "high": p.value + HALF_WIDTH * p.std,
                "bound": p.bound,
                "unit": p.unit,
                "status": p.status,
            }
            for p in self.parameters.values()
        ]
        table = pandas_module().DataFrame(rows, index=list(self.parameters))
        table.index.name = "parameter"
        return table

    def _display(self) -> Display:
        title = f"{self.dof}, {self.structure} ({self.method}), fit {self.fit_percent:.1f} %: {', '.join(self.used)}"
        residuals = [(s, f"{format_number(r.rms, 3)} {SIGNALS[s][0]}") for s, r in self.remainder.items()]
        parameters, correlations = parameter_tables(self.parameters, self.covariance)
        fitted = sum(p.std > 0.0 for p in self.parameters.values())
        samples = sum(len(t.t) for t in self.traces)
        counts = (str(len(self.used)), str(samples), str(fitted)) if samples else ()
        tables = (
            Table(("runs", "samples", "fitted parameters"), (counts,) if counts else ()),
            parameters,
            Table(("signal", "residual (rms)"), tuple(residuals)),
            correlations,
        )
        left_out = [f"{s} was not used: {why}" for s, why in self.extra.get("signals_left_out", {}).items()]
        doubts = (f"{d.cause}. Cure: {d.cure}" for d in self.doubts)
        return Display(title, tuple(t for t in tables if t.rows), (*left_out, *doubts))

    def to_json(self) -> str:
        """Return :meth:`to_dict` as JSON text, with unknown numbers as null.

        Examples
        --------
        >>> import json
        >>> from gcs_autotune.api import example_run, fit
        >>> json.loads(fit(example_run(), "linear", dof="yaw", delay=0.0).to_json())["dof"]
        'yaw'
        """
        return json_text(self.to_dict()).rstrip("\n")

    def to_dict(self) -> dict[str, Any]:
        """Return the data of the fit: ``dof``, ``structure``, ``parameters``, ``correlation``, ``doubts`` and more.

        ``model`` has the format of a model file. For one axis it includes the effects of the actuator, if fitted.

        Examples
        --------
        >>> from gcs_autotune.api import example_run, fit
        >>> data = fit(example_run(), "linear", dof="yaw", delay=0.0).to_dict()
        >>> round(data["parameters"]["beta_r"]["value"], 1), data["doubts"]
        (0.5, [])
        """
        data = {
            "schema": 1,
            "dof": self.dof,
            "structure": self.structure,
            "method": self.method,
            "parameters": {
                name: {"value": p.value, "unit": p.unit, "std": p.std, "bound": p.bound, "status": p.status}
                for name, p in self.parameters.items()
            },
            "correlation": self.correlation.tolist(),
            "noise": dict(self.noise),
            "remainder": {
                n: {"rms": r.rms, "noise": r.noise, "unexplained": r.unexplained} for n, r in self.remainder.items()
            },
            "fit_percent": self.fit_percent,
            "used": list(self.used),
            "doubts": [{"slug": d.slug, "cause": d.cause, "cure": d.cure} for d in self.doubts],
            "model": self.whole_model.to_dict(),
            **self.extra,
        }
        if is_of_one_axis(self):
            data |= {
                "noise_std": self.noise_std,
                "residual_rms": self.residual_rms,
                "iso": [_iso_dict(e) for e in self.iso],
                "decision": None if self.decision is None else _slots_dict(self.decision),
                "candidates": [{**_slots_dict(c), "model": c.model.to_dict()} for c in self.candidates],
            }
        plain: dict[str, Any] = plain_data(data)
        return plain


AxisFit: TypeAlias = Fit[SingleDof]
"""A :class:`Fit` of one degree of freedom."""


def is_of_one_axis(fit: object) -> TypeGuard[Fit[SingleDof]]:
    """Return whether *fit* is a :class:`Fit` of one degree of freedom."""
    return isinstance(fit, Fit) and isinstance(fit.model, SingleDof)


def _slots_dict(thing: Any) -> dict[str, Any]:
    return {name: getattr(thing, name) for name in thing.__slots__}


def _iso_dict(estimate: IsoEstimate) -> dict[str, Any]:
    return {**_slots_dict(estimate), "cycle": _slots_dict(estimate.cycle)}
