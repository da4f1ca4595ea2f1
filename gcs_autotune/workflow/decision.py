"""What becomes of a proposal: left alone, only shown, or written, proved by the same step, and kept or given back."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from gcs_autotune.design import Change, Proposal, StepMetrics, is_better
from gcs_autotune.link import Journal, ParameterTransaction
from gcs_autotune.report import format_factor
from gcs_autotune.workflow.designing import Ruler
from gcs_autotune.workflow.experiments import measure
from gcs_autotune.workflow.voyage import Voyage

__all__ = ["decide", "decide_on_given"]


def decide(voyage: Voyage, proposal: Proposal, before: StepMetrics, ruler: Ruler, journal: Journal) -> None:
    """End the tune with *proposal*, as it deserves and the operator wants; *before* is the step with present gains.

    Raises
    ------
    ParameterNotAccepted, LinkError, NotAchieved, ...
        Writing or flying the new gains failed; by then the old ones are back.
    """
    tale = voyage.tale
    if proposal.changes:
        tale.say(_promise(proposal))
    if not proposal.changes:
        tale.end(
            "unchanged",
            "no gains found inside the documented ranges do better than the present ones; nothing was written",
        )
    elif _is_hopeless(proposal, before):
        tale.end(
            "unchanged",
            "the present gains do better than any that keep the wanted reserve promise to; nothing was written",
        )
    elif voyage.settings.dry_run:
        tale.end("dry-run", "dry run: nothing was written")
    elif not voyage.agrees(f"Write {_shown(proposal.changes)} and prove it by the same step?"):
        tale.end("declined", "the new gains were not wanted; nothing was written")
    else:
        _prove(voyage, proposal.new, before, ruler, journal)


def decide_on_given(voyage: Voyage, before: StepMetrics, ruler: Ruler, journal: Journal) -> None:
    """End the tune with the gains given by file, likewise; errors as those of :func:`decide`."""
    tale, changes = voyage.tale, voyage.tale.given_changes
    if voyage.settings.dry_run:
        tale.end("dry-run", "dry run: nothing was written")
    elif not voyage.agrees(f"Write {_shown(changes)} and prove it by the same step?"):
        tale.end("declined", "the gains of the file were not wanted; nothing was written")
    else:
        _prove(voyage, {c.parameter: c.new for c in changes}, before, ruler, journal)


def _prove(voyage: Voyage, new: Mapping[str, float], before: StepMetrics, ruler: Ruler, journal: Journal) -> None:
    tale = voyage.tale
    with ParameterTransaction(voyage.craft.parameters, journal) as loan:
        tale.say("writing " + ", ".join(f"{n} {v:g}" for n, v in new.items()))
        loan.set(new)
        tale.say("written and read back")
        voyage.come_about("step-after")
        after = voyage.fly(ruler.proof.step("step-after"), "step with new gains")
        tale.metrics_after = measure(after.trial, ruler.noise, ruler.grain)
        verdict = is_better(before, tale.metrics_after, voyage.law.free_overshoot)
        tale.verdict = (verdict.better, verdict.reasons)
        if verdict.better:
            loan.keep()
            for sentence in _on_the_other_axis(voyage):
                tale.say(sentence)
            tale.end("kept", "the new gains are better and stay")
    if not verdict.better:
        tale.end("restored", "the new gains are not better; the old ones are back, verified by reading them")


def _is_hopeless(proposal: Proposal, measured: StepMetrics) -> bool:
    """Whether the new gains promise no better step than the present ones promise and were just seen to give."""
    return proposal.after.metrics.itae >= max(proposal.before.metrics.itae, measured.itae)


HELD_LAST = "heading"
"""Of axes that set the same parameters, the one to tune last (decision 10)."""


def _on_the_other_axis(voyage: Voyage) -> Iterator[str]:
    """Say which of two axes that set the same parameters is to be tuned last, and why."""
    axes, own = voyage.craft.firmware.axes, voyage.axis
    mine = {gain.parameter for gain in axes[own.name].gains}
    for other in axes.values():
        shared = [own.names.own(gain.parameter) for gain in other.gains if gain.parameter in mine]
        if other.name == own.name or not shared or HELD_LAST not in (own.name, other.name):
            continue
        first = other.name if own.name == HELD_LAST else own.name
        then = (
            "" if own.name == HELD_LAST else f": run `tune {HELD_LAST}` now, unless the craft is only steered by hand"
        )
        yield (
            f"`tune {HELD_LAST}` and `tune {first}` both set {', '.join(shared)}, and the later one wins. "
            f"`tune {HELD_LAST}` goes last, because gains that hold a heading follow turn rates as well, and gains for "
            f"turn rates alone may hold a heading several times worse{then}"
        )


def _shown(changes: Sequence[Change]) -> str:
    return ", ".join(f"{c.parameter} {c.old:g} -> {c.new:g}" for c in changes)


def _promise(proposal: Proposal) -> str:
    """Say what the new gains promise on the identified model, before anybody is asked about them."""
    old, new, low = proposal.before.metrics, proposal.after.metrics, proposal.worst_margins
    return (
        f"predicted: error over time {old.itae:.3g} -> {new.itae:.3g} s^2, overshoot {old.overshoot:.0%} -> "
        f"{new.overshoot:.0%}; margins at worst {format_factor(low.gain, 2)} in gain, "
        f"{math.degrees(low.phase):.0f} deg in phase"
    )
