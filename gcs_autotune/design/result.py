"""Results of a design: old and new gains, their prediction, and its uncertainty."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.notebook import html_block, html_table, pandas_module
from gcs_autotune.rounding import format_number

if TYPE_CHECKING:
    from gcs_autotune.control import ReferenceModel
    from gcs_autotune.design.actuator import Actuator
    from gcs_autotune.design.effect_reduction import Remark
    from gcs_autotune.design.open_loop import OpenLoop

__all__ = [
    "Beside",
    "Change",
    "Hunting",
    "Margins",
    "Prediction",
    "Proposal",
    "Ruler",
    "StepHalf",
    "StepMetrics",
]


@dataclass(frozen=True, slots=True)
class Hunting:
    """The residual motion after a step: ``amplitude`` and ``offset`` [rad or m], ``period`` [s].

    ``period`` is infinite if there is no oscillation. ``travel``: output travel [normalised per s].
    """

    amplitude: float
    period: float
    offset: float
    travel: float

    @property
    def swings(self) -> bool:
        """Whether there is a limit cycle."""
        return math.isfinite(self.period)


@dataclass(frozen=True, slots=True)
class Change:
    """Change of one parameter, with the vehicle's own name and unit: old and new value, documented range, and
    reason."""

    parameter: str
    old: float
    new: float
    low: float
    high: float
    reason: str

    @property
    def at_limit(self) -> bool:
        """Whether the new value is on a limit of its documented range."""
        return self.new in (self.low, self.high)

    @property
    def beyond(self) -> bool:
        """Whether the new value is outside its documented range."""
        return not self.low <= self.new <= self.high


@dataclass(frozen=True, slots=True)
class Margins:
    """Stability of a loop opened at the actuator: gain margin (ratio), phase margin [rad], delay margin [s]."""

    gain: float
    phase: float
    delay: float
    stable: bool


@dataclass(frozen=True, slots=True)
class StepMetrics:
    """Metrics of a step; lower is better for all.

    ``itae`` [rad s^2 or m s^2] is normalised by the step size (so per unit step, [s^2]). ``overshoot`` is a fraction of
    the step. ``rise`` (10-90 %) and ``settling`` (to 5 %) are in s, NaN if never reached. ``steady_error`` is a
    fraction of the step. ``travel`` is the total variation of the actuator [fraction of full] per second.
    ``hidden_by_noise``: ``settling`` is NaN because the noise of single readings exceeds the band, although the motion
    ended inside it.
    """

    itae: float
    overshoot: float
    rise: float
    settling: float
    steady_error: float
    travel: float
    oscillation: float = 0.0
    hidden_by_noise: bool = False


class Beside(NamedTuple):
    """Prediction for another mode that uses the same gains.

    - ``law``: control law of that mode.
    - ``before``, ``after``: ITAE of its step relative to that of a craft that does not follow.
    - ``given_up``: relative increase of the ITAE of the axis' own step, because that mode is considered.
    """

    law: str
    before: float
    after: float
    given_up: float


class StepHalf(NamedTuple):
    """Half of a flown step: one step of *size* [rad or m].

    It contains t (n,) [s] from the step on, the position relative to its start, and the output.
    """

    size: float
    t: NDArray[np.float64]
    position: NDArray[np.float64]
    output: NDArray[np.float64]


class Ruler(NamedTuple):
    """Measurement properties of flown positions.

    They are white noise [rad or m], the time ``noise_time`` [s] for which one value of it lasts, and the quantum.
    """

    noise_std: float = 0.0
    quantum: float = 0.0
    noise_time: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """A step simulated on the identified model with given gains: arrays (n,), position in rad or m.

    ``halves``: step and step back as far as simulated, if they are flown one after the other.
    """

    t: NDArray[np.float64]
    target: NDArray[np.float64]
    position: NDArray[np.float64]
    wanted: NDArray[np.float64]
    output: NDArray[np.float64]
    metrics: StepMetrics
    halves: tuple[StepHalf, StepHalf] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Proposal:
    """New gains for one axis, not yet written to a vehicle.

    - ``margins``: at the identified parameters.
    - ``worst_margins``: over the 95 % region of the parameters.
    - ``bound``: (left side, right side) of Miskovic2010 (8.22)-(8.27), stable if left < right. For a model with
      effects, ``remarks`` describe each, and ``left`` is the residual motion after a small step with the old and the
      new gains.

    - ``loops``: with the old and with the new gains, opened at the actuator, one for each state of the craft;
      ``margins`` are the smallest of these.
    - ``actuator``: the actuator effects of the model between output and force.

    - ``windows`` [s]: duration of step and step back for the predicted metrics (after a proof: what both its steps
      recorded); empty: as long as the predictions.
    - ``ruler``: measurement properties for these metrics.
    - ``spread``: largest relative increase of the predicted error over time within the 95 % region.
    - ``beside``: another mode that uses the same gains.
    """

    axis: str
    law: str
    changes: tuple[Change, ...]
    wanted: ReferenceModel
    margins: Margins
    worst_margins: Margins
    bound: tuple[float, float]
    before: Prediction
    after: Prediction
    notes: tuple[str, ...] = ()
    remarks: tuple[Remark, ...] = ()
    left: tuple[Hunting, ...] = ()
    loops: tuple[tuple[OpenLoop, ...], tuple[OpenLoop, ...]] = ((), ())
    actuator: Actuator | None = None
    windows: tuple[float, ...] = ()
    spread: float = math.nan
    ruler: Ruler = field(default_factory=Ruler)
    beside: Beside | None = None

    @property
    def new(self) -> Mapping[str, float]:
        """New values by parameter."""
        return {c.parameter: c.new for c in self.changes}

    @property
    def old(self) -> Mapping[str, float]:
        """Old values by parameter."""
        return {c.parameter: c.old for c in self.changes}

    def to_pandas(self) -> Any:
        """Return the gains as a pandas DataFrame, a row per parameter: ``old``, ``new``, ``low``, ``high``, ``reason``.

        Raises
        ------
        UsageError
            pandas is not installed.

        Examples
        --------
        >>> from gcs_autotune.api import design, example_run, fit
        >>> gains = {f"ATC_STR_RAT_{term}": 0.1 for term in ("FF", "P", "I", "D")} | {"ATC_STR_ANG_P": 2.0}
        >>> proposal = design(fit(example_run(), "linear", dof="yaw"), "heading", gains, speed=1.5)
        >>> bool(proposal.to_pandas().loc["ATC_STR_ANG_P", "new"] == proposal.new["ATC_STR_ANG_P"])
        True
        """
        names = ("parameter", "old", "new", "low", "high", "reason")
        rows = [{n: getattr(c, n) for n in names} for c in self.changes]
        return pandas_module().DataFrame(rows, columns=list(names)).set_index("parameter")

    def _repr_html_(self) -> str:
        changes = [(c.parameter, format_number(c.old), format_number(c.new), c.reason) for c in self.changes]
        metrics = [
            (words, *(format_number(scale * getattr(p.metrics, name), 3) for p in (self.before, self.after)))
            for words, name, scale in (
                ("tracking error, ITAE [s^2]", "itae", 1.0),
                ("overshoot [%]", "overshoot", 100.0),
                ("rise [s]", "rise", 1.0),
                ("settling [s]", "settling", 1.0),
            )
        ]
        tables = [html_table(("predicted step", "old gains", "new gains"), metrics)]
        if changes:
            tables.insert(0, html_table(("gain", "old", "new", "why"), changes))
        title = f"{self.axis} ({self.law}): " + ("new gains, not written" if changes else "the present gains stay")
        return html_block(title, tables, self.notes)

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form (without the prediction's time series).

        Examples
        --------
        >>> from gcs_autotune.api import design, example_run, fit
        >>> gains = {f"ATC_STR_RAT_{term}": 0.1 for term in ("FF", "P", "I", "D")} | {"ATC_STR_ANG_P": 2.0}
        >>> proposal = design(fit(example_run(), "linear", dof="yaw"), "heading", gains, speed=1.5)
        >>> [change["parameter"] for change in proposal.to_dict()["changes"]] == list(proposal.new)
        True
        """
        return {
            "schema": 1,
            "axis": self.axis,
            "law": self.law,
            "changes": [
                {
                    "parameter": c.parameter,
                    "old": c.old,
                    "new": c.new,
                    "range": [c.low, c.high],
                    "at_limit": c.at_limit,
                    "reason": c.reason,
                }
                for c in self.changes
            ],
            "wanted": {n: getattr(self.wanted, n) for n in ("kind", "omega_0", "a1", "a2", "a3")},
            "margins": _plain(self.margins),
            "worst_margins": _plain(self.worst_margins),
            "bound": [b if math.isfinite(b) else None for b in self.bound],
            "predicted": {"before": _plain(self.before.metrics), "after": _plain(self.after.metrics)},
            **({"spread": self.spread} if math.isfinite(self.spread) else {}),
            **({"windows": list(self.windows)} if self.windows else {}),
            "notes": list(self.notes),
            **({"effects": [_plain(r) for r in self.remarks]} if self.remarks else {}),
            **(
                {"left_alone": dict(zip(("before", "after"), map(_finite, self.left), strict=True))}
                if self.left
                else {}
            ),
        }


def _finite(thing: Hunting) -> dict[str, float | None]:
    return {n: v if math.isfinite(v) else None for n, v in _plain(thing).items()}


def _plain(thing: Any) -> dict[str, Any]:
    return {name: getattr(thing, name) for name in thing.__slots__}
