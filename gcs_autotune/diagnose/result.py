"""Result of a diagnosis: a verdict, causes with their numbers and doubts, and plot data."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import EFFECTS, EffectCurve, EffectInstance, ExtendedModel, effect_at
from gcs_autotune.identify import Doubt, Trace
from gcs_autotune.identify.kalman import RunOffset
from gcs_autotune.notebook import Display, Displayed, Table, pandas_module
from gcs_autotune.plain_json import json_text, plain_data
from gcs_autotune.rounding import format_number, format_value

__all__ = [
    "Cause",
    "Diagnosis",
    "ErrorReduction",
    "Hint",
    "Lack",
    "MissingCurve",
    "MissingForce",
    "Number",
    "Numbers",
    "Portrait",
    "Ranked",
    "Signature",
    "Value",
    "Verdict",
    "Waves",
]

Array = NDArray[np.float64]

Verdict = Literal[
    "wrong-numbers",
    "wrong-numbers-and-effect",
    "effect-found",
    "partly-explained",
    "unexplained",
    "no-effect",
    "unfinished",
]
"""Verdicts of a diagnosis.

``wrong-numbers``: the supplied model is complete once its numbers are corrected. ``wrong-numbers-and-effect``: it is
complete with corrected numbers and the identified causes. ``partly-explained``: corrected numbers or causes improve the
prediction of held-out data, but more than noise remains. ``unfinished``: the search was stopped and reports no cause.
"""


FELT = 0.95
"""Ratio of held-out errors with and without a cause, below which a user notices the cause."""

Lack = Literal["weak", "not-on-each", "not-sure", "no-gain", "brief", "no-model", "uncertain"]
"""Condition that a hint does not meet, so that it is not identified as a cause.

``weak``: too little support for the number of candidates tried. ``not-on-each``: it lowers the likelihood of too many
of the held-out folds. ``not-sure``: its held-out gain may be luck. ``no-gain``: it does not lower the held-out
prediction error.

``brief``: its time constant, or the craft's, is shorter than the sampling interval. A sensor's filter or the craft's
inertia then looks the same. ``no-model``: the fit is not a model of the craft. The drifting force is about as large as
the commanded force, or the craft's time constant is below the sampling interval. ``uncertain``: the 95 % intervals of
its numbers include no effect, so it is not a hint either.
"""


@dataclass(frozen=True, slots=True)
class Value(Displayed):
    """One number of an effect, with its standard error (NaN if unknown)."""

    value: float
    unit: str
    std: float


@dataclass(frozen=True, slots=True)
class ErrorReduction(Displayed):
    """Held-out simulation error of one signal before and after a change of the model: rms [unit], their ratio and its
    95 % interval.

    ``held_out`` describes the held-out runs or blocks. ``each``: run -> error before and after, if whole runs were held
    out.
    """

    metric: str
    signal: str
    unit: str
    before: float
    after: float
    ratio: float
    ci95: tuple[float, float]
    held_out: str = ""
    each: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def is_felt(self) -> bool:
        """Whether the error is significantly below :data:`FELT` times its former value.

        If no interval is known, the ratio itself is compared.
        """
        upper = self.ci95[1]
        return (self.ratio if math.isnan(upper) else upper) < FELT

    @property
    def is_uncertain(self) -> bool:
        """Whether the error is below :data:`FELT` times its former value, but not significantly."""
        return self.ratio < FELT and not self.is_felt


@dataclass(frozen=True, slots=True)
class Number(Displayed):
    """One number of the supplied model compared with the runs, with name, sign and unit of the owner's file.

    ``given``: the model's value. ``given_std``: its standard error if the model states one, else 0. ``value``: the
    value from the runs, with ``std`` and 95 % interval. ``wrong``: whether the two contradict each other. NaN: unknown.
    """

    name: str
    unit: str
    meaning: str
    given: float
    given_std: float
    value: float
    std: float
    ci95: tuple[float, float]
    wrong: bool
    explained: bool = False
    """Whether an identified cause explains the difference between the model's value and that from the runs."""

    @property
    def of_record(self) -> bool:
        """Whether the number describes a simulation's file (clock, sign, unit), where the right value is known
        exactly."""
        return self.ci95[0] == self.ci95[1]


@dataclass(frozen=True, slots=True)
class Numbers(Displayed):
    """The supplied model's numbers compared with the runs, the wrong ones first.

    ``of``: numbers of a ``"model"``, or of the plain model fitted to a ``"simulation"`` and to the runs. ``gains``:
    held-out error of the model as supplied (``before``) and with corrected numbers (``after``), before any cause is
    added. It is empty if no number is wrong, or if the model as supplied diverges.
    """

    of: Literal["model", "simulation"]
    rows: tuple[Number, ...]
    gains: tuple[ErrorReduction, ...] = ()
    over: Literal["given", "fitted"] = "fitted"
    """Model to which the gains of the causes are relative: the better of the supplied model and the same model with
    fitted numbers.
    """

    @property
    def wrong(self) -> tuple[Number, ...]:
        """The compared numbers that are wrong."""
        return tuple(r for r in self.rows if r.wrong)

    @property
    def gain(self) -> ErrorReduction | None:
        """Error reduction, by corrected numbers, of the signal with the largest reduction; None if none was
        measured.
        """
        return min(self.gains, key=lambda g: g.ratio, default=None)


@dataclass(frozen=True, slots=True)
class Ranked(Displayed):
    """One candidate compared with the base model and the causes found before it.

    ``gain``: relative reduction of the held-out error, all signals together (0.3: by 30 %). ``p_value``: corrected for
    the number of candidates tried. ``evidence``: twice the log-likelihood ratio, less the cost of its parameters.
    ``step``: 1 for the first cause, 2 for the second, and so on. With process noise, ``unseen`` is the log-likelihood
    gained on each held-out fold. ``ci90`` is the 90 % interval of the sum of these gains, which is half the
    ``evidence``.
    """

    cause: str
    place: str
    gain: float
    p_value: float
    evidence: float
    parameters: Mapping[str, Value]
    step: int = 1
    unseen: tuple[float, ...] = ()
    ci90: tuple[float, float] = (math.nan, math.nan)


@dataclass(frozen=True, slots=True)
class Cause(Displayed):
    """An identified cause: an accepted effect with its numbers and its reduction of the held-out error."""

    effect: EffectInstance
    parameters: Mapping[str, Value]
    meaning: str
    share: float
    """Fraction of the held-out mean square error above noise that this cause removed. The fractions of all causes add
    up to what they removed together; 0 for a cause that helps only together with a later one."""
    curve: EffectCurve | None = None
    gain: ErrorReduction | None = None
    """Reduction of the held-out error relative to the model without the cause; None if it was not measured."""

    @property
    def is_slight(self) -> bool:
        """Whether the effect is too small to notice: its error ratio is not below :data:`FELT`."""
        return self.gain is not None and not self.gain.is_felt and not self.gain.is_uncertain

    @property
    def is_structural(self) -> bool:
        """Whether a first model of such a craft usually omits the effect. Otherwise the effect is a fault of the craft
        or of the record.
        """
        return self.effect.slug in EFFECTS and EFFECTS[self.effect.slug].is_structural


@dataclass(frozen=True, slots=True)
class Hint(Displayed):
    """A possible cause that the runs support too weakly to identify it.

    ``gained``: log-likelihood gained on the fitted runs. ``unseen``: log-likelihood gained on each held-out fold, if
    measured. ``held_out`` describes the parts. ``chance``: probability that noise makes some candidate look as strong,
    counting all tried. ``lacks``: the condition of a cause that it does not meet. ``alike``: other hints that these
    runs do not distinguish from it. ``seconds``: length of the runs. ``needed`` [s]: total length of the same
    manoeuvres that would support the cause sufficiently. ``separated_by``: the manoeuvre that would confirm or reject
    it.
    """

    cause: str
    place: str
    meaning: str
    parameters: Mapping[str, Value]
    gained: float
    unseen: tuple[float, ...]
    held_out: str
    chance: float
    lacks: Lack
    alike: tuple[str, ...]
    seconds: float
    needed: float
    separated_by: str


@dataclass(frozen=True, slots=True)
class Signature(Displayed):
    """Description of the residuals: one finding per line, the strongest first, with its test statistic."""

    findings: tuple[str, ...] = ()
    whiteness_p: float = math.nan
    """P-value of the whiteness test over all signals and tests."""


@dataclass(frozen=True, slots=True, eq=False)
class Portrait(Displayed):
    """Plot data of one model's residuals: free-run traces, and per signal the residual against related quantities.

    ``against``: name (``"time"``, ``"psi"``, ``"r"``, ``"N"`` ...) -> (x (n,), residual (n,), unit of x) of the signal
    ``signal``. ``spectrum``: frequency [Hz] and power. ``correlation``: lag [s], autocorrelation. ``cross``: input or
    state -> (lag [s], cross-correlation). ``one_step``: time and one-step residual. ``limit``: 95 % bound of a white
    residual's correlations.
    """

    signal: str
    unit: str
    traces: tuple[Trace, ...]
    against: Mapping[str, tuple[Array, Array, str]] = field(default_factory=dict)
    one_step: tuple[Array, Array] | None = None
    spectrum: tuple[Array, Array] | None = None
    correlation: tuple[Array, Array] | None = None
    cross: Mapping[str, tuple[Array, Array]] = field(default_factory=dict)
    limit: float = math.nan


@dataclass(frozen=True, slots=True, eq=False)
class MissingCurve(Displayed):
    """The missing force (n,) over ``over`` with a 95 % band between runs.

    ``over``: a recorded quantity, ``command`` (as force) or ``time``. ``share``: fraction of the force's power about
    its mean that the other runs' curve predicts. It is negative if the curve predicts less than the mean of the other
    runs. ``others``: the data used for this prediction, the other ``runs`` or the other ``half`` of a single run.
    """

    over: str
    unit: str
    x: Array
    force: Array
    band: Array
    share: float
    others: Literal["runs", "half"] = "runs"

    @property
    def predicted_by(self) -> str:
        """Description of the data that predict the fraction ``share``."""
        return "the other runs" if self.others == "runs" else "the other half of the run"

    @property
    def varies(self) -> bool:
        """Whether the force depends on the quantity: no constant lies within the band everywhere."""
        return bool(np.max(self.force - self.band) > np.min(self.force + self.band))


@dataclass(frozen=True, slots=True)
class Waves(Displayed):
    """Waves during the runs.

    ``period`` [s] and ``damping`` (ratio): those of the frequency band. ``swing`` [m, rad]: standard deviation of the
    measured oscillation. ``force``: standard deviation of the force.
    """

    period: float
    damping: float
    swing: float
    force: float


@dataclass(frozen=True, slots=True, eq=False)
class MissingForce(Displayed):
    """The force or moment that the model lacks in one degree of freedom and that no cause explains.

    ``size`` [unit]: its standard deviation. ``memory`` [s]: its time constant. ``share``: its size relative to the
    commanded force (both rms). ``curves``: the force over related quantities, the most informative first. ``days``:
    offsets of each run; empty if the runs do not differ. ``waves``: waves during the runs, or None. ``size95`` and
    ``memory95``: 95 % intervals. ``longest`` [s]: duration of the longest run. If the time constant may be longer than
    that, the force may be constant.
    """

    dof: str
    unit: str
    size: float
    memory: float
    share: float
    curves: Mapping[str, MissingCurve]
    days: tuple[RunOffset, ...] = ()
    waves: Waves | None = None
    size95: tuple[float, float] = (0.0, math.inf)
    memory95: tuple[float, float] = (0.0, math.inf)
    longest: float = math.inf

    def to_dict(self) -> dict[str, Any]:
        """Return the missing force as plain data for the JSON report."""
        curves = {
            n: {"unit": c.unit, "x": c.x.tolist(), "force": c.force.tolist(), "band": c.band.tolist(), "share": c.share}
            for n, c in self.curves.items()
        }
        own = {"dof": self.dof, "unit": self.unit, "size": self.size}
        days = [asdict(day) for day in self.days]
        waves = None if self.waves is None else asdict(self.waves)
        intervals = {
            name: [low, high if math.isfinite(high) else None]
            for name, (low, high) in (("size95", self.size95), ("memory95", self.memory95))
        }
        optional = {"memory": self.memory, "share": self.share, **intervals}
        return {**own, **optional, "curves": curves, "days": days, "waves": waves}


@dataclass(frozen=True, slots=True, eq=False)
class Diagnosis(Displayed):
    """What the simulation gets wrong.

    ``causes`` are in the order found, ``ranking`` is best first within each step. ``indistinguishable``: groups of
    slugs that these runs do not distinguish. ``next_manoeuvre``: the manoeuvre that would distinguish them. ``before``
    and ``after`` contain one portrait per signal. ``noise``: signal -> rms of its remaining residual. ``tried``:
    candidates examined.

    ``gain`` and ``gains`` are those of the causes alone. For a supplied model the gains are relative to the same model
    with fitted numbers. The gain of fitting its numbers is in ``numbers`` (None if no model was given). ``base_model``
    is the model as supplied.
    """

    verdict: Verdict
    causes: tuple[Cause, ...]
    ranking: tuple[Ranked, ...]
    indistinguishable: tuple[tuple[str, ...], ...]
    gain: ErrorReduction | None
    gains: tuple[ErrorReduction, ...]
    base_model: ExtendedModel
    extended_model: ExtendedModel
    next_manoeuvre: str
    left: Signature
    gave_away: Signature
    before: tuple[Portrait, ...]
    after: tuple[Portrait, ...]
    used: tuple[str, ...]
    held_out: tuple[str, ...]
    noise: Mapping[str, float]
    tried: int
    seconds: float
    work: float = 0.0
    """Number of samples that simulations and filters processed."""
    doubts: tuple[Doubt, ...] = ()
    numbers: Numbers | None = None
    missing: MissingForce | None = None
    """The remaining force that no cause explains, if the runs show a slowly varying one."""
    hints: tuple[Hint, ...] = ()
    """Causes supported too weakly to be identified, the likeliest first."""

    @property
    def wrong_numbers(self) -> tuple[Number, ...]:
        """Numbers of the supplied model that the runs contradict."""
        return () if self.numbers is None else self.numbers.wrong

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form of ``diagnose --json``.

        Examples
        --------
        >>> from gcs_autotune.api import diagnose, example_run
        >>> diagnose(example_run(), dof="yaw", effects=["quadratic-drag"]).to_dict()["verdict"]
        'no-effect'
        """
        plain: dict[str, Any] = plain_data(
            {
                "schema": 1,
                "verdict": self.verdict,
                "numbers": None if self.numbers is None else _numbers(self.numbers),
                "missing": None if self.missing is None else self.missing.to_dict(),
                "causes": [c.effect.slug for c in self.causes],
                "ranking": [
                    {
                        "cause": r.cause,
                        "place": r.place,
                        "step": r.step,
                        "gain": r.gain,
                        "p_value": r.p_value,
                        "evidence": r.evidence,
                        "unseen": list(r.unseen),
                        "ci90": list(r.ci90),
                        "parameters": {n: _value(v) for n, v in r.parameters.items()},
                    }
                    for r in self.ranking
                ],
                "indistinguishable": [list(group) for group in self.indistinguishable],
                "gain": None if self.gain is None else _gain(self.gain),
                "gains": [_gain(g) for g in self.gains],
                "found": [
                    {
                        "cause": c.effect.slug,
                        "place": c.effect.place,
                        "meaning": c.meaning,
                        "structural": c.is_structural,
                        "share": c.share,
                        "slight": c.is_slight,
                        "gain": None if c.gain is None else _gain(c.gain),
                        "parameters": {n: _value(v) for n, v in c.parameters.items()},
                    }
                    for c in self.causes
                ],
                "hints": [_hint(h) for h in self.hints],
                "base_model": self.base_model.to_dict(),
                "extended_model": self.extended_model.to_dict(),
                "next_manoeuvre": self.next_manoeuvre,
                "left": {"findings": list(self.left.findings), "whiteness_p": self.left.whiteness_p},
                "gave_away": {"findings": list(self.gave_away.findings), "whiteness_p": self.gave_away.whiteness_p},
                "used": list(self.used),
                "held_out": list(self.held_out),
                "noise": dict(self.noise),
                "tried": self.tried,
                "seconds": self.seconds,
                "work": self.work,
                "doubts": [{"slug": d.slug, "cause": d.cause, "cure": d.cure} for d in self.doubts],
            }
        )
        return plain

    def to_pandas(self) -> Any:
        """Return the ranking as a pandas DataFrame, one row per candidate tried to the end.

        Raises
        ------
        UsageError
            pandas is not installed.

        Examples
        --------
        >>> from gcs_autotune.api import diagnose, example_run
        >>> table = diagnose(example_run(), dof="yaw", effects=["quadratic-drag"]).to_pandas()
        >>> list(table["cause"])
        ['quadratic-drag']
        """
        names = ("step", "cause", "place", "gain", "p_value", "evidence")
        return pandas_module().DataFrame([{n: getattr(r, n) for n in names} for r in self.ranking], columns=list(names))

    def _display(self) -> Display:
        causes = [
            (
                effect_at(c.effect),
                name,
                format_value(v.value, v.std),
                v.unit,
                c.meaning if i == 0 else "",
            )
            for c in self.causes
            for i, (name, v) in enumerate(c.parameters.items())
        ]
        heads = ("cause", "parameter", "value ± standard error", "unit", "meaning")
        tables = [Table(heads, tuple(causes))] if causes else []
        wrong = [
            (n.name, format_value(n.given, n.given_std), format_value(n.value, n.std), n.unit, n.meaning)
            for n in self.wrong_numbers
        ]
        if wrong:
            tables.append(Table(("wrong number", "given", "from these runs", "unit", "meaning"), tuple(wrong)))
        gains = [
            f"{g.metric} of {g.signal}: {format_number(g.before)} {g.unit} without the causes, "
            f"{format_number(g.after)} {g.unit} with them" + f" ({g.held_out})" * bool(g.held_out)
            for g in self.gains
        ]
        doubts = (f"{d.cause}. Cure: {d.cure}" for d in self.doubts)
        return Display(f"{self.verdict.replace('-', ' ')}: {', '.join(self.used)}", tuple(tables), (*gains, *doubts))

    def to_json(self) -> str:
        """Return :meth:`to_dict` as JSON text, unknown numbers as null.

        Examples
        --------
        >>> from gcs_autotune.api import diagnose, example_run
        >>> '"verdict": "no-effect"' in diagnose(example_run(), dof="yaw", effects=["quadratic-drag"]).to_json()
        True
        """
        return json_text(self.to_dict()).rstrip("\n")


def _value(value: Value) -> dict[str, Any]:
    return {"value": value.value, "unit": value.unit, "std": value.std}


def _hint(hint: Hint) -> dict[str, Any]:
    return {
        "cause": hint.cause,
        "place": hint.place,
        "meaning": hint.meaning,
        "parameters": {n: _value(v) for n, v in hint.parameters.items()},
        "gained": hint.gained,
        "unseen": list(hint.unseen),
        "held_out": hint.held_out,
        "chance": hint.chance,
        "lacks": hint.lacks,
        "alike": list(hint.alike),
        "seconds": hint.seconds,
        "needed": hint.needed,
        "separated_by": hint.separated_by,
    }


def _numbers(numbers: Numbers) -> dict[str, Any]:
    return {
        "of": numbers.of,
        "wrong": [r.name for r in numbers.wrong],
        "rows": [
            {
                "name": r.name,
                "unit": r.unit,
                "meaning": r.meaning,
                "given": r.given,
                "given_std": r.given_std,
                "value": r.value,
                "std": r.std,
                "ci95": list(r.ci95),
                "wrong": r.wrong,
                "explained": r.explained,
            }
            for r in numbers.rows
        ],
        "gain": None if numbers.gain is None else _gain(numbers.gain),
        "gains": [_gain(g) for g in numbers.gains],
        "causes_counted_over": numbers.over,
    }


def _gain(gain: ErrorReduction) -> dict[str, Any]:
    return {
        "metric": gain.metric,
        "signal": gain.signal,
        "unit": gain.unit,
        "before": gain.before,
        "after": gain.after,
        "ratio": gain.ratio,
        "ci95": list(gain.ci95),
        "held_out": gain.held_out,
    }
