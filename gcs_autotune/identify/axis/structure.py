"""Choose drag structure and delay by comparing output-error fits (:mod:`gcs_autotune.identify.axis.evidence`)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.axis.evidence import choose, damps, possible_second_drag
from gcs_autotune.identify.axis.form import FREE, Explicit, ExplicitForm, Structure
from gcs_autotune.identify.axis.start import Bounds, start_from_scan
from gcs_autotune.identify.axis.uncertainty import numbers_of
from gcs_autotune.identify.problems.delay import SEARCHED_DELAYS, weigh_delay
from gcs_autotune.identify.problems.problem import Problem
from gcs_autotune.identify.problems.quick_fit import first_levels, first_states, quanta_of
from gcs_autotune.identify.problems.reweighting import NOISE_ROUNDS
from gcs_autotune.identify.problems.solution import Solution, solve
from gcs_autotune.identify.result import Decision, StructureFit
from gcs_autotune.identify.signals.segment import Segment

__all__ = ["Selection", "select"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Selection:
    """The chosen drag structure, and the fits from which it was chosen.

    - ``structure``, ``solution``: the chosen structure and its fit.
    - ``solutions``: fit per structure.
    - ``correlation``: correlation time of the residuals [samples].
    - ``undecided``: whether the choice was close.
    - ``records``: the fitted records. If there is a delay, their beginning is left out.
    - ``with_delay``: the fit with a delay that was tried, whether the delay was kept or not.
    - ``rival``: the fit with both drags if the record does not exclude it, else None.
    """

    structure: Structure
    solution: Solution
    solutions: Mapping[Structure, Solution]
    candidates: tuple[StructureFit, ...]
    correlation: float
    undecided: bool
    delay_evidence: float
    records: tuple[Segment, ...]
    with_delay: Solution | None
    rival: Solution | None


def select(
    records: Sequence[Segment],
    names: Sequence[str],
    start: Explicit,
    bounds: Bounds,
    structure: Structure | None,
    delay: float | None,
    decision: Decision | None,
    *,
    robust: bool = False,
) -> Selection:
    """Fit the candidate drag structures, with and without a delay, and return the chosen one with all fits.

    Parameters
    ----------
    structure : the only structure to fit. None compares all three.
    delay : fixed value [s]. None fits one and keeps it only if the evidence is strong.
    decision : the two-experiment decision, used if the fits do not decide clearly.

    Raises
    ------
    NotInformative
        No candidate can be simulated.
    """
    base: Structure = structure or "affine"
    quanta = quanta_of([r.only(names) for r in records])
    fitter = _Fitter(records, tuple(names), bounds, robust, quanta)
    fitter, first, tried, correlation, evidence = _with_delay(fitter, base, start, delay)
    solutions: dict[Structure, Solution] = {base: first}
    began = numbers_of(first)
    if structure is None:
        other: Structure
        for other in ("linear", "nonlinear"):
            solution = fitter.fit(other, began, "delay" in first.free, first)
            if solution is None or not solution.converged or not damps(solution):
                again = fitter.fit(other, start._replace(delay=began.delay), "delay" in first.free, None)
                solution = _better(solution, again)
            if solution is not None:
                solutions[other] = solution
    criterion = {s: f.bic(correlation) for s, f in solutions.items()}
    chosen, undecided = (structure, False) if structure is not None else choose(solutions, criterion, decision)
    candidates = tuple(_candidate(records[0], s, f, criterion[s]) for s, f in solutions.items())
    return Selection(
        chosen,
        solutions[chosen],
        solutions,
        candidates,
        correlation,
        undecided,
        evidence,
        tuple(fitter.records),
        tried,
        possible_second_drag(chosen, solutions, correlation) if structure is None else None,
    )


@dataclass(frozen=True, slots=True)
class _Fitter:
    records: Sequence[Segment]
    names: tuple[str, ...]
    bounds: Bounds
    robust: bool
    quanta: Mapping[str, float]

    def fit(self, structure: Structure, begin: Explicit, with_delay: bool, near: Solution | None) -> Solution | None:
        """Return the fit of *structure*, which starts at *begin*, or None if it fails.

        near : solution whose initial states and noise levels are used as start values, or None.
        """
        free = [n for n, on in zip(Explicit._fields, (*FREE[structure], with_delay), strict=True) if on]
        segments = [r.only(self.names) for r in self.records]
        levels = first_levels(segments) if near is None else near.noise
        return solve(
            Problem(ExplicitForm.of(self.records[0].dof), segments, None, self.bounds.limits, free),
            np.array(_translated(begin, structure, self.bounds.speed)),
            first_states(segments) if near is None else near.initial,
            levels=levels,
            quanta=self.quanta,
            shift=0.0 if near is None else near.shift,
            robust=self.robust,
            rounds=NOISE_ROUNDS if len(levels) > 1 or self.robust else 1,
            effort=None,
        )

    def must_fit(self, structure: Structure, begin: Explicit) -> Solution:
        """Return the fit of *structure* with the delay of *begin*; raise NotInformative if no start can be simulated.

        A fit of both drags starts from the better fit of a single drag. From other starts the two drags may diverge
        with opposite signs.
        """
        solution: Solution | None = None
        if structure == "affine":
            one = self.fit("linear", begin, False, None)
            other = self.fit("nonlinear", begin, False, one)
            start = _better(one, other)
            begin = begin if start is None else numbers_of(start)
            solution = self.fit(structure, begin, False, start)
        solution = solution or self.fit(structure, begin, False, None)
        if solution is None:
            raise NotInformative(
                "no model of this form could be simulated on these runs. Check that input and output are from the same "
                "run. A dead zone or a thrust curve of the actuator is another reason (--effects)"
            )
        return solution

    def without(self, seconds: float) -> _Fitter:
        """Return a fitter for the same records without their first *seconds* [s]."""
        return replace(self, records=[r.after(seconds) for r in self.records])


def _with_delay(
    fitter: _Fitter, base: Structure, start: Explicit, delay: float | None
) -> tuple[_Fitter, Solution, Solution | None, float, float]:
    """Return fitter and fit of *base*, with a delay only if the evidence is strong.

    Also return the fit with a delay, the correlation time, and the evidence for the delay.
    """
    if delay is not None:
        plain = fitter.without(delay).must_fit(base, start._replace(delay=delay))
        return fitter.without(delay), plain, None, plain.correlation, 0.0
    step = float(np.median(np.diff(fitter.records[0].main.t)))
    begin = min(max(start.delay, step), fitter.bounds.delay)

    def fits(margin: float) -> tuple[Solution, Solution | None]:
        late = fitter.without(margin)
        plain = late.must_fit(base, start._replace(delay=0.0))
        lagged = late.fit(base, numbers_of(plain)._replace(delay=begin), True, plain)
        return plain, lagged if (lagged or plain).white else _better(lagged, _scanned_fit(late, base))

    verdict = weigh_delay(fits)
    lagged = verdict.lagged
    if verdict.kept and lagged is not None:
        return fitter.without(verdict.margin), lagged, lagged, lagged.correlation, verdict.evidence
    assert verdict.plain is not None
    begin_again = numbers_of(verdict.plain)._replace(delay=0.0)
    whole = fitter.fit(base, begin_again, False, None) or fitter.must_fit(base, begin_again)
    return fitter, whole, lagged, whole.correlation, verdict.evidence


def _scanned_fit(fitter: _Fitter, base: Structure) -> Solution | None:
    """Fit with a delay that starts from a scan over delays.

    From a start far from the true delay, the fit ends in a local minimum.
    """
    return fitter.fit(base, start_from_scan(fitter.records, fitter.bounds, SEARCHED_DELAYS), True, None)


def _translated(numbers: Explicit, structure: Structure, speed: float) -> Explicit:
    """Return *numbers* in another structure, with the same loss at the first harmonic, Miskovic2010 (6.43)."""
    share = 8.0 / (3.0 * math.pi) * speed
    if structure == "linear":
        return numbers._replace(a=numbers.a + share * numbers.c, c=0.0)
    if structure == "nonlinear":
        return numbers._replace(a=0.0, c=numbers.c + numbers.a / share)
    return numbers


def _better(one: Solution | None, other: Solution | None) -> Solution | None:
    if one is None or other is None:
        return one or other
    return one if one.log_likelihood >= other.log_likelihood else other


def _candidate(record: Segment, structure: Structure, solution: Solution, bic: float) -> StructureFit:
    return StructureFit(
        structure=structure,
        model=numbers_of(solution).model(record.dof, record.input_units[0]),
        rms=solution.rms(solution.rests[0].signal),
        log_likelihood=solution.log_likelihood,
        free_parameters=solution.unknowns,
        bic=bic,
    )
