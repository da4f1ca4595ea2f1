"""A loop whose gains can be tuned, and the sequence of every tune: propose, ask, apply, prove, keep or restore.

The gains may be an autopilot's parameters or numbers of this program's own controllers.
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
    """Temporary change of gains. When the context ends, the initial gains are restored, unless the new ones are
    kept.
    """

    def set(self, values: Mapping[str, float]) -> None:
        """Apply all gains in *values* (name -> value). On an error restore all of them and raise it."""

    def keep(self) -> object:
        """Keep the applied values permanently."""

    def __enter__(self) -> Self:
        """Start the temporary change."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Restore the previous values unless the new ones are kept."""


@dataclass(frozen=True, slots=True)
class Offer:
    """New gains and their prediction.

    Attributes
    ----------
    changes : new values by the operator's names; empty if nothing better was obtained.
    refusal : reason why the new gains must not be applied; empty if they may be.
    promise : the predicted effect in one sentence; empty if there is no prediction.
    costs : cost of the proof predicted with the present gains, with the new ones, and with the new ones at the worst of
        the model's confidence region; NaN if there is no prediction.
    """

    changes: Sequence[Change]
    refusal: str = ""
    promise: str = ""
    costs: tuple[float, float, float] = (math.nan, math.nan, math.nan)

    @property
    def new(self) -> dict[str, float]:
        """Gain -> new value."""
        return {change.parameter: change.new for change in self.changes}


@dataclass(frozen=True, slots=True)
class ProofResult:
    """Result of the proof: the new gains compared with the old ones.

    ``remarks`` are for the operator if the new gains are kept.
    """

    verdict: Verdict
    remarks: Sequence[str] = ()


class TunableLoop(Protocol):
    """One control loop of one craft.

    Methods that fly raise the errors of flying; :func:`tune_loop` then restores the gains.
    """

    @property
    def name(self) -> str:
        """Name of the controlled quantity, in one word."""

    def read(self) -> Mapping[str, float]:
        """Return the present gains by name, and the other values that the proof depends on."""

    def lend(self, journal: Journal) -> GainLoan:
        """Return the object that applies new gains and restores the present ones.

        It keeps the *journal* for recovery after a crash.
        """

    def experiment(self) -> None:
        """Fly the proof with the present gains, and the experiments that identify the craft if they are needed."""

    def propose(self) -> Offer:
        """Return new gains from the experiments. It may fly further experiments if these are not sufficient."""

    def fly_baseline(self) -> None:
        """Fly a further manoeuvre for comparison with the present gains, if the loop has one, before new gains are
        applied.
        """

    def prove(self) -> ProofResult:
        """Fly the proof with the new gains. Return the comparison with the proof of the present gains."""


class TuneObserver(Protocol):
    """Reports the progress of a tune, and stores its ending for the report."""

    verdict: tuple[bool | None, tuple[str, ...]]

    def say(self, text: str) -> None:
        """Report an event, in one sentence."""

    def note(self, fact: Fact) -> None:
        """Record a note on the tune."""

    def end(self, ending: str, reason: str) -> None:
        """Store how the tune ended."""


def tune_loop(
    loop: TunableLoop, observer: TuneObserver, agrees: Callable[[str], bool], journal: Journal, *, dry_run: bool = False
) -> None:
    """Tune *loop*. At every ending its gains are the initial ones, or new ones that proved better.

    agrees : function that asks the operator. dry_run : apply nothing.

    Raises
    ------
    ParameterNotAccepted, LinkError, NotAchieved, ...
        Flying or applying the new gains failed. By then the present gains are restored.
    """
    loop.experiment()
    offer = loop.propose()
    if offer.promise:
        observer.say(offer.promise)
    if offer.changes:
        values = tuple(NewValue(c.parameter, c.old, c.new, c.reason) for c in offer.changes)
        observer.note(ProposedGains(values, *offer.costs))
    them = "it" if len(offer.changes) == 1 else "them"
    if offer.refusal or not offer.changes:
        observer.end("unchanged", f"{offer.refusal or 'the design gave no better gains'}; nothing was written")
    elif dry_run:
        observer.end("dry-run", "dry run: nothing was written")
    elif not agrees(f"Write {_shown(offer.changes)} and test {them} by the same manoeuvre?"):
        observer.end("declined", "the new gains were declined; nothing was written")
    else:
        loop.fly_baseline()
        _prove(loop, offer, observer, journal)


def _prove(loop: TunableLoop, offer: Offer, observer: TuneObserver, journal: Journal) -> None:
    with loop.lend(journal) as loan:
        observer.say("writing " + ", ".join(f"{name} {value:g}" for name, value in offer.new.items()))
        loan.set(offer.new)
        observer.say("new gains written and verified by reading back")
        result = loop.prove()
        better = result.verdict.better
        observer.verdict = (better, result.verdict.reasons)
        if better:
            loan.keep()
            for remark in result.remarks:
                observer.say(remark)
            observer.end("kept", "the new gains are better and stay on the vehicle")
    if not better:
        observer.say("the old values were restored, verified by reading back")
        observer.end("restored", f"the measured comparison failed: {'; '.join(result.verdict.against)}")


def _shown(changes: Sequence[Change]) -> str:
    return ", ".join(f"{c.parameter} {c.old:g} -> {c.new:g}" for c in changes)
