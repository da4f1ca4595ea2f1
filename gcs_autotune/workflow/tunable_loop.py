"""A loop whose gains can be tuned, and the order of every tune: propose, ask, apply, prove, keep or restore.

The gains may be an autopilot's parameters or numbers of a controller of our own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self

from gcs_autotune.design import Change, Verdict
from gcs_autotune.link import Journal
from gcs_autotune.observer import Fact, NewValue, ProposedGains

__all__ = ["GainLoan", "Offer", "ProofResult", "TunableLoop", "TuneObserver", "tune_loop"]


class GainLoan(Protocol):
    """Gains changed for a while: they are restored when the context ends, unless they are kept."""

    def set(self, values: Mapping[str, float]) -> None:
        """Apply all of *values*, or none and raise."""

    def keep(self) -> object:
        """Leave the applied values in place for good."""

    def __enter__(self) -> Self:
        """Begin."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Restore what was there before, unless it was kept."""


@dataclass(frozen=True, slots=True)
class Offer:
    """New gains and their prediction.

    Attributes
    ----------
    changes : by the names that the operator knows; empty when there is nothing better.
    refusal : why they are not to be applied; empty when they are.
    promise : what they are predicted to do, one sentence; empty when nothing predicts it.
    costs : cost of the proof predicted with the present gains, with the new ones, and with the new ones at the worst of
        the model's confidence region; NaN where nothing predicts it.
    """

    changes: Sequence[Change]
    refusal: str = ""
    promise: str = ""
    costs: tuple[float, float, float] = (math.nan, math.nan, math.nan)

    @property
    def new(self) -> dict[str, float]:
        """The new values by name."""
        return {change.parameter: change.new for change in self.changes}


@dataclass(frozen=True, slots=True)
class ProofResult:
    """The new gains compared with the old ones in the proof; ``remarks`` are for the operator if they are kept."""

    verdict: Verdict
    remarks: Sequence[str] = ()


class TunableLoop(Protocol):
    """One loop of one craft.

    A method that flies raises what flying raises; :func:`tune_loop` then restores the gains.
    """

    @property
    def name(self) -> str:
        """What the loop controls, one word."""

    def read(self) -> Mapping[str, float]:
        """Return the gains that are in place now, and what else the proof depends on, by name."""

    def lend(self, journal: Journal) -> GainLoan:
        """Return what applies new gains and restores the present ones; it keeps the *journal* that a crash needs."""

    def experiment(self) -> None:
        """Fly the proof with the present gains, and what identifies the craft where that is needed."""

    def propose(self) -> Offer:
        """Return new gains from the experiments. May fly further ones where these do not suffice."""

    def fly_baseline(self) -> None:
        """Fly with the present gains what else the proof compares; nothing has been applied yet."""

    def prove(self) -> ProofResult:
        """Fly the proof with the new gains and compare it with the present ones' proof."""


class TuneObserver(Protocol):
    """What reports the progress of a tune, and keeps its ending for the report."""

    verdict: tuple[bool | None, tuple[str, ...]]

    def say(self, text: str) -> None:
        """Receive an event, in one sentence."""

    def note(self, fact: Fact) -> None:
        """Receive a fact."""

    def end(self, ending: str, reason: str) -> None:
        """Receive the ending."""


def tune_loop(
    loop: TunableLoop, observer: TuneObserver, agrees: Callable[[str], bool], journal: Journal, *, dry_run: bool = False
) -> None:
    """Tune *loop*: on every ending its gains are the present ones, or new ones that proved better.

    agrees : asks the operator. dry_run : apply nothing.

    Raises
    ------
    ParameterNotAccepted, LinkError, NotAchieved, ...
        Flying, or applying the new gains, failed; by then the present ones are restored.
    """
    loop.experiment()
    offer = loop.propose()
    if offer.promise:
        observer.say(offer.promise)
    if offer.changes:
        values = tuple(NewValue(c.parameter, c.old, c.new, c.reason) for c in offer.changes)
        observer.note(ProposedGains(values, *offer.costs))
    if offer.refusal or not offer.changes:
        observer.end("unchanged", f"{offer.refusal or 'no better gains were found'}; nothing was written")
    elif dry_run:
        observer.end("dry-run", "dry run: nothing was written")
    elif not agrees(f"Write {_shown(offer.changes)} and prove it by the same step?"):
        observer.end("declined", "the new gains were declined; nothing was written")
    else:
        loop.fly_baseline()
        _prove(loop, offer, observer, journal)


def _prove(loop: TunableLoop, offer: Offer, observer: TuneObserver, journal: Journal) -> None:
    with loop.lend(journal) as loan:
        observer.say("writing " + ", ".join(f"{name} {value:g}" for name, value in offer.new.items()))
        loan.set(offer.new)
        observer.say("written and read back")
        result = loop.prove()
        better = result.verdict.better
        observer.verdict = (better, tuple(result.verdict.reasons))
        if better:
            loan.keep()
            for remark in result.remarks:
                observer.say(remark)
            observer.end("kept", "the new gains are better and stay")
    if not better:
        observer.end("restored", "the new gains are not better; the old ones were restored, verified by reading back")


def _shown(changes: Sequence[Change]) -> str:
    return ", ".join(f"{c.parameter} {c.old:g} -> {c.new:g}" for c in changes)
