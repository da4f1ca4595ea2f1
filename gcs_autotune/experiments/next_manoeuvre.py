"""Rank manoeuvres by the information that each would add to the existing runs.

Every candidate is simulated with the identified model, within the range of inputs in the runs. Its information is added
to that of the runs. The sum determines the expected standard errors. The ranking uses the largest expected standard
error relative to the parameter's size (``worst``, close to E-optimality) or the volume of the confidence region
(``volume``, D-optimality; Goodwin1977, chapter 6). The expectation holds at the present estimates and noise. Repeat the
ranking after each run.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.experiments.identifiability import Identifiability, check_identifiability, percent
from gcs_autotune.experiments.preview import (
    CONTROL_STEP,
    ROLES,
    Flight,
    ManoeuvringRoom,
    allocation_of,
    allocation_of_shares,
    fly,
)
from gcs_autotune.identify import Fit, Model
from gcs_autotune.identify.problems import FittedModel, Information, fitted_model_of, information_on
from gcs_autotune.manoeuvres import MANOEUVRES, Preset
from gcs_autotune.notebook import Displayed
from gcs_autotune.registry import lookup
from gcs_autotune.trial import Trial

__all__ = [
    "Criterion",
    "PrecisionGain",
    "RankedManoeuvre",
    "Ranking",
    "plan_next",
    "rank_by_precision",
    "ranking_of",
    "relative_errors",
    "shortfall",
]

Array = NDArray[np.float64]

PRESETS: Mapping[str, Preset] = {p.name: p for kind in MANOEUVRES.values() for p in kind.presets}
"""Name -> manoeuvre of a given size, for every kind in the table."""

Criterion = Literal["worst", "volume"]

FAR = 1.5
"""Ratio of a motion to that in the runs above which the motion is flagged. Project choice."""


@dataclass(frozen=True, slots=True, eq=False)
class Ranking:
    """One candidate manoeuvre with its expected result.

    - ``std`` (p,): standard errors expected from the runs and this manoeuvre together.
    - ``worst``: largest of these standard errors, relative to the size of the parameter.
    - ``gain``: factor by which standard errors decrease on (geometric) average, correlations included. It is infinite
      if a parameter becomes identifiable.
    - ``flags``: quantities of the motion that exceed those in the runs.
    """

    candidate: Preset
    flight: Flight
    information: Information
    std: Array
    worst: float
    gain: float
    flags: tuple[str, ...]

    @property
    def reach(self) -> ManoeuvringRoom:
        """Expected speeds, turning and space of the manoeuvre."""
        return self.flight.reach


@dataclass(frozen=True, slots=True, eq=False)
class RankedManoeuvre(Displayed):
    """Ranked manoeuvres, best first.

    - ``now``: identifiability from the existing runs.
    - ``seconds``: duration of the next run [s].
    - ``plans``: the manoeuvres with their expected results.
    - ``hopeless``: parameters that no candidate identifies. The ranking ignores them.
    """

    now: Identifiability
    seconds: float
    plans: tuple[Ranking, ...]
    hopeless: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the fitted parameters."""
        return self.now.names

    @property
    def best(self) -> Ranking:
        """The highest-ranked manoeuvre, with its expected result."""
        return self.plans[0]

    def factors(self, plan: Ranking) -> Mapping[str, float]:
        """Return name -> factor by which the standard error of the parameter decreases with *plan*."""
        before = self.now.information.std
        with np.errstate(invalid="ignore"):
            ratio = np.where(np.isfinite(plan.std), before / plan.std, 1.0)
        return dict(zip(self.names, ratio.tolist(), strict=True))

    def say(self, plan: Ranking) -> str:
        """Return one sentence on *plan*: the manoeuvre, the standard errors it reduces most, and the space it needs."""
        before, after = self.now.relative, plan.std / self.now.scales.size
        order = [i for i in np.argsort(-before) if self.names[i] not in self.hopeless][:3]
        reductions = [f"{self.names[i]} from {percent(float(before[i]))} to {percent(float(after[i]))}" for i in order]
        reach = plan.reach
        room = [f"{math.degrees(reach.turned):.0f} deg of turning"] if reach.turned > 0.0 else []
        room += [f"{reach.room:.0f} m of space"] if reach.room > 0.0 else []
        room += [f"{reach.deep:.1f} m of depth"] if reach.deep > 0.0 else []
        needs = f"; space needed: {' and '.join(room)}" if room else ""
        flags = f"; beyond the runs so far: {', '.join(plan.flags)}" if plan.flags else ""
        return f"{plan.candidate.title} for {self.seconds:.0f} s: std of {', '.join(reductions)}{needs}{flags}"

    @property
    def words(self) -> tuple[str, ...]:
        """Sentences on the three best manoeuvres, and on the parameters that no manoeuvre identifies."""
        lines = [self.say(plan) for plan in self.plans[:3]]
        if self.hopeless:
            lines.append(
                f"no candidate manoeuvre identifies {', '.join(self.hopeless)}. Supply these with --known, or measure "
                "other signals"
            )
        return tuple(lines)


def plan_next(
    fit: Fit[Model],
    trials: Trial | Sequence[Trial],
    candidates: Sequence[str | Preset] | None = None,
    *,
    seconds: float = 60.0,
    criterion: Criterion = "worst",
) -> RankedManoeuvre:
    """Return manoeuvres ranked by the information that they would add to *trials* on the parameters of *fit*.

    Parameters
    ----------
    candidates : names in :data:`PRESETS`, or user-defined manoeuvres. None takes all that the inputs permit.
    seconds : length of the next run, including its approach.

    Raises
    ------
    UnknownName
        An unknown candidate.
    UsageError
        A length out of range, no candidate for these inputs; and as :func:`fitted_model_of`.
    NotInformative
        The model diverges in every candidate.
    """
    if not 5.0 <= seconds <= 3600.0:
        raise UsageError(f"a run of {seconds} s is too short or too long to plan. Use 5 to 3600 s")
    subject = fitted_model_of(fit, trials)
    allocation = allocation_of(subject.form, subject.theta, subject.records)
    wanted = PRESETS.values() if candidates is None else [_candidate(c) for c in candidates]
    able = [c for c in wanted if {ROLES[force] for force in c.drives} <= set(allocation.columns)]
    if not able:
        raise UsageError(
            f"no candidate manoeuvre can be flown with the inputs of these runs ({', '.join(allocation.channels)}): "
            f"they drive only {', '.join(allocation.columns)}"
        )
    now = check_identifiability(subject)
    plans = [p for c in able if (p := ranking_of(subject, now, fly(subject, allocation, c, seconds), c)) is not None]
    if not plans:
        raise NotInformative(
            f"the model '{subject.form.name}' diverges in every candidate manoeuvre. Identify it again with "
            "--option physical=true, which keeps inertia positive and drag damping"
        )
    hopeless = ~np.any([np.isfinite(p.std) for p in plans], axis=0)
    ranked = sorted(plans, key=lambda p: _key(p, now, hopeless, criterion))
    names = tuple(n for n, h in zip(now.names, hopeless, strict=True) if h)
    return RankedManoeuvre(now, seconds, tuple(ranked), names)


ROUGHLY = 0.4
"""Interval [s] of commands and samples for the first, approximate ranking of all manoeuvres.

Project choice: four times the interval with which they are flown.
"""
FINALISTS = 12
"""Number of manoeuvres that are ranked again with the flown interval. Project choice."""
UNTOLD = 1e3
"""Relative standard error assumed for a parameter that is not yet identified. Project choice."""


@dataclass(frozen=True, slots=True, eq=False)
class PrecisionGain(Displayed):
    """Expected effect of a manoeuvre on the required precision.

    - ``relative``: name -> expected standard error divided by the value of the parameter.
    - ``rate``: improvement per minute, in natural logarithms of the standard errors that are still too large.
    - ``seconds``: total duration [s].
    """

    candidate: Preset
    flight: Flight
    relative: Mapping[str, float]
    rate: float
    seconds: float


def shortfall(relative: Mapping[str, float], wanted: Mapping[str, float]) -> float:
    """Return the distance from the required precision: the sum over parameters of ln(relative standard error /
    required one), each at least 0.
    """
    return sum(math.log(max(min(relative[n], UNTOLD) / share, 1.0)) for n, share in wanted.items())


def relative_errors(fit: Fit[Model], names: Iterable[str]) -> Mapping[str, float]:
    """Return name -> standard error divided by value, for each of *names*.

    It is infinite for a parameter that was not fitted.
    """
    found = {}
    for name in names:
        p = fit.parameters.get(name)
        is_known = p is not None and p.status == "fitted" and p.value != 0.0 and math.isfinite(p.std)
        found[name] = p.std / abs(p.value) if is_known and p is not None else math.inf
    return found


def rank_by_precision(
    fit: Fit[Model],
    trials: Trial | Sequence[Trial],
    wanted: Mapping[str, float],
    candidates: Sequence[Preset],
    *,
    longest: float,
    overhead: float,
    most: Mapping[str, float] | None = None,
) -> tuple[PrecisionGain, ...]:
    """Return simulated manoeuvres ranked by how quickly they reach the precision *wanted*.

    Parameters
    ----------
    fit : a model on *trials*, with normalised inputs.
    wanted : parameter -> required standard error divided by its value.
    longest : longest simulated duration [s].
    overhead : additional time [s] of each manoeuvre.
    most : force -> normalised output at which its actuators saturate, if known.

    Expected standard errors follow from the information (Goodwin1977, chapter 6). They are multiplied by the ratio of
    the present standard errors to those of the information, which exceeds 1 for coloured residuals. The expected
    precision of an incomplete model is then not too optimistic. All manoeuvres are first ranked approximately
    (:data:`ROUGHLY`). The :data:`FINALISTS` best manoeuvres are ranked again with the flown interval and come first.

    Raises
    ------
    NotInformative, UsageError
        :func:`gcs_autotune.identify.problems.information.fitted_model_of` raised the error.
    """
    subject = fitted_model_of(fit, trials)
    allocation = allocation_of_shares(subject.form, most or {})
    now, present = check_identifiability(subject), relative_errors(fit, wanted)

    def weighed(candidates: Iterable[Preset], step: float) -> list[PrecisionGain]:
        found = []
        for candidate in candidates:
            flight = fly(subject, allocation, candidate, longest, to_its_end=True, step=step)
            plan = ranking_of(subject, now, flight, candidate)
            if plan is not None:
                found.append(_gain_of(plan, subject, now, present, wanted, overhead))
        return sorted(found, key=lambda w: -w.rate)

    able = [c for c in candidates if {ROLES[force] for force in c.drives} & set(allocation.columns)]
    roughly = weighed(able, ROUGHLY) if len(able) > FINALISTS else []
    best = [w.candidate for w in roughly[:FINALISTS]] if roughly else able
    return (*weighed(best, CONTROL_STEP), *roughly[FINALISTS:])


def _gain_of(
    plan: Ranking,
    subject: FittedModel,
    now: Identifiability,
    present: Mapping[str, float],
    wanted: Mapping[str, float],
    overhead: float,
) -> PrecisionGain:
    """Return the expected effect of *plan* on the precision *wanted*; arguments as in :func:`rank_by_precision`."""
    expected, ideal = dict(present), now.information.std
    for i, name in enumerate(now.names):
        if name in wanted and math.isfinite(plan.std[i]) and subject.values[i] != 0.0:
            is_finite = math.isfinite(ideal[i]) and math.isfinite(present[name])
            excess = max(present[name] * abs(subject.values[i]) / ideal[i], 1.0) if is_finite else 1.0
            expected[name] = min(present[name], excess * plan.std[i] / abs(float(subject.values[i])))
    seconds = plan.flight.reach.seconds + overhead
    rate = 60.0 * (shortfall(present, wanted) - shortfall(expected, wanted)) / seconds
    return PrecisionGain(plan.candidate, plan.flight, expected, rate, seconds)


def ranking_of(subject: FittedModel, now: Identifiability, flight: Flight | None, candidate: Preset) -> Ranking | None:
    """Return the expected result of *flight*, or None without a flight or if the sensitivities diverge."""
    if flight is None:
        return None
    try:
        added = information_on(flight.as_fitted_model(subject))
    except NotInformative:
        return None
    both = now.information.plus(added)
    std = both.std
    p = len(std)
    gained = both.log_determinant - now.information.log_determinant if math.isfinite(both.log_determinant) else 0.0
    return Ranking(
        candidate=candidate,
        flight=flight,
        information=both,
        std=std,
        worst=float((std / now.scales.size).max()),
        gain=math.exp(min(0.5 * gained / p, 700.0)) if math.isfinite(gained) else math.inf,
        flags=flight.reach.beyond(now.seen, FAR),
    )


def _candidate(given: str | Preset) -> Preset:
    return given if isinstance(given, Preset) else lookup(PRESETS, given, "manoeuvre")


def _key(plan: Ranking, now: Identifiability, hopeless: NDArray[np.bool_], criterion: Criterion) -> float:
    if criterion == "worst":
        return float(np.where(hopeless, 0.0, plan.std / now.scales.size).max())
    rest = plan.information.root[:, ~hopeless]
    sign, value = np.linalg.slogdet(np.linalg.qr(rest, mode="r"))
    return -float(value) if sign != 0.0 else math.inf
