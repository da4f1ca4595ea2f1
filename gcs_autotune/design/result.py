"""Results of a design: old and new gains, the predicted steps with them, and the uncertainty of the prediction."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.notebook import Display, Displayed, Table, pandas_module
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
class Hunting(Displayed):
    """Residual motion long after a step.

    - ``amplitude``, ``offset`` [rad or m]: amplitude of the oscillation, and offset from the target.
    - ``period`` [s]: period of the oscillation, infinite if there is none.
    - ``travel``: motion of the output [normalised per s].
    """

    amplitude: float
    period: float
    offset: float
    travel: float

    @property
    def is_limit_cycle(self) -> bool:
        """Whether the residual motion is a limit cycle."""
        return math.isfinite(self.period)


@dataclass(frozen=True, slots=True)
class Change(Displayed):
    """Change of one parameter.

    It contains the vehicle's own name and unit, old and new value, documented range, and reason.
    """

    parameter: str
    old: float
    new: float
    low: float
    high: float
    reason: str

    @property
    def at_limit(self) -> bool:
        """Whether the new value is on a limit of its documented range. A gain of 0 is off, and not limited by it."""
        return self.new != 0.0 and self.new in (self.low, self.high)

    @property
    def beyond(self) -> bool:
        """Whether the new value is outside its documented range."""
        return not self.low <= self.new <= self.high


@dataclass(frozen=True, slots=True)
class Margins(Displayed):
    """Stability of a loop opened at the actuator: gain margin (ratio), phase margin [rad], delay margin [s]."""

    gain: float
    phase: float
    delay: float
    stable: bool


@dataclass(frozen=True, slots=True)
class StepMetrics(Displayed):
    """Metrics of a step. A lower value is better for all.

    - ``itae`` [s^2]: integral of time times absolute error, per unit step.
    - ``overshoot``: fraction of the step.
    - ``rise`` [s]: time from 10 to 90 %, NaN if never reached.
    - ``settling`` [s]: time to 5 %, NaN if never reached.
    - ``steady_error``: fraction of the step.
    - ``oscillation``: half the peak-to-peak value at the end, as a fraction of the step.
    - ``travel``: total variation of the actuator [fraction of full] per second.
    - ``hidden_by_noise``: whether ``settling`` is NaN because the noise of single readings exceeds the band, although
      the motion ended inside it.
    - ``span`` [s]: length of the record after the step, of several steps the shortest. A NaN of ``rise`` or
      ``settling`` means "not within this time".
    """

    itae: float
    overshoot: float
    rise: float
    settling: float
    steady_error: float
    travel: float
    oscillation: float = 0.0
    hidden_by_noise: bool = False
    span: float = math.nan


class Beside(NamedTuple):
    """Prediction for another mode that uses the same gains.

    - ``law``: control law of the other mode.
    - ``before``, ``after``: ITAE of the other mode's step with the old and new gains, relative to that of a craft that
      does not move.
    - ``given_up``: relative increase of the ITAE of the axis' own step, because the other mode is considered.
    """

    law: str
    before: float
    after: float
    given_up: float


class StepHalf(NamedTuple):
    """Half of a flown step: one step of *size* [rad or m].

    It contains the time (n,) [s] since the step, the position relative to its start, and the output.
    """

    size: float
    t: NDArray[np.float64]
    position: NDArray[np.float64]
    output: NDArray[np.float64]


class Ruler(NamedTuple):
    """Measurement properties of flown positions.

    - ``noise_std`` [rad or m]: standard deviation of white noise.
    - ``quantum`` [rad or m]: smallest step of the sensor.
    - ``noise_time`` [s]: time for which one value of the noise lasts.
    """

    noise_std: float = 0.0
    quantum: float = 0.0
    noise_time: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Prediction(Displayed):
    """A step simulated on the identified model with one set of gains: arrays (n,), position in rad or m.

    ``halves``: step and step back up to the end of the simulation, if they are flown one after the other.
    """

    t: NDArray[np.float64]
    target: NDArray[np.float64]
    position: NDArray[np.float64]
    wanted: NDArray[np.float64]
    output: NDArray[np.float64]
    metrics: StepMetrics
    halves: tuple[StepHalf, StepHalf] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Proposal(Displayed):
    """New gains for one axis, not yet written to a vehicle.

    - ``margins``: margins at the identified parameters.
    - ``worst_margins``: smallest margins over the 95 % region of the parameters.
    - ``bound``: (left side, right side) of Miskovic2010 (8.22)-(8.27), stable if left < right. For a model with
      effects, ``remarks`` describe each effect. ``left`` is the residual motion after a small step with the old and the
      new gains.

    - ``loops``: open loops with the old and with the new gains, opened at the actuator, one for each state of the
      craft. ``margins`` are the smallest of their margins.
    - ``actuator``: the actuator effects of the model between output and force.

    - ``windows`` [s]: duration of step and step back for the predicted metrics (after a proof: the durations that both
      flown steps have in common). Empty: as long as the predictions.
    - ``ruler``: measurement properties with which the metrics are calculated.
    - ``spread``: largest relative increase of the predicted ITAE within the 95 % region.
    - ``is_matched``: whether the gains follow ``wanted``. Otherwise they minimise the ITAE, and ``wanted`` only started
      the search.
    - ``beside``: prediction for another mode that uses the same gains, or None.
    - ``unmet``: which requirements of the specification the new gains do not meet, in words.
    - ``limit``: why the margins miss the specification, if a slow loop of the autopilot is the reason.
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
    unmet: tuple[str, ...] = ()
    limit: str = ""
    is_matched: bool = True

    @property
    def new(self) -> Mapping[str, float]:
        """Parameter name -> new value."""
        return {c.parameter: c.new for c in self.changes}

    @property
    def old(self) -> Mapping[str, float]:
        """Parameter name -> old value."""
        return {c.parameter: c.old for c in self.changes}

    def to_pandas(self) -> Any:
        """Return a pandas DataFrame with one row per parameter, and columns ``old``, ``new``, ``low``, ``high``,
        ``reason``.

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

    def _display(self) -> Display:
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
        tables = [Table(("predicted step", "old gains", "new gains"), tuple(metrics))]
        if changes:
            tables.insert(0, Table(("gain", "old", "new", "why"), tuple(changes)))
        title = f"{self.axis} ({self.law}): " + ("new gains, not written" if changes else "the present gains stay")
        return Display(title, tuple(tables), self.notes)

    def to_dict(self) -> dict[str, Any]:
        """Return the proposal as data for JSON, without the time series of the predictions.

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
