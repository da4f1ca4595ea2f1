"""What is said of a cause: its name, what speaks for it, its rivals, and what these runs cannot tell apart."""

from __future__ import annotations

import math
from collections.abc import Mapping

from gcs_autotune.diagnose import Cause, Diagnosis, Ranked
from gcs_autotune.effects import EFFECTS
from gcs_autotune.report.diagnosis.wording import base_words, effect_words, gain_sentence, named, place_words
from gcs_autotune.report.toolkit.wording import format_share, listed, sentence

__all__ = ["cannot_tell", "cause_remarks", "cause_title", "evidence_remarks"]


def cause_title(diagnosis: Diagnosis, cause: Cause) -> str:
    """Return the heading over a cause: a hypothesis is called one."""
    text = f"{base_words(diagnosis)} lacks {named(cause)}" if cause.is_structural else named(cause)
    if cause.is_slight:
        text = f"slight: {text}"
    return f"Hypothesis: {text}" if diagnosis.verdict == "partly-explained" else text[0].upper() + text[1:]


STRENGTHS: Mapping[float, str] = {5.0: "very strong", 3.0: "strong", 1.0: "positive"}
"""Log-likelihood gained, less the price of the numbers -> words (Kass1995, section 3.2: half of their table)."""


def evidence_remarks(diagnosis: Diagnosis, cause: Cause) -> tuple[tuple[str, str], ...]:
    """Return (label, sentence): how much a cause explains, how strong the evidence for it is, its best rival."""
    said = []
    if cause.gain is not None and cause.is_slight:
        text = "Its effect is slight: what it adds to the model hardly changes the prediction. "
        said.append(("What a user notices", text + gain_sentence(cause.gain)))
    if math.isfinite(cause.share):
        share = format_share(cause.share)
        if diagnosis.missing is None:
            text = f"It removes {share} of the squared error that noise does not account for."
            said.append(("What it explains on held-out data", text))
        else:
            said.append(("What it explains", f"Of the square of the force that wanders it explains {share}."))
    own = [r for r in diagnosis.ranking if (r.cause, r.place) == (cause.effect.slug, cause.effect.place)]
    if own and math.isfinite(own[-1].evidence):
        others = [r for r in diagnosis.ranking if r.step == own[-1].step and r.cause != cause.effect.slug]
        rival = max((r for r in others if r.evidence > 0.0), key=lambda r: r.evidence, default=None)
        said.append(("How strong the evidence is", f"{_strength(own[-1])} {_rival_words(rival, cause)}"))
    return tuple(said)


def _strength(ranked: Ranked) -> str:
    """Return in words how strong the evidence for a candidate is, and what that rests on."""
    gained = 0.5 * ranked.evidence
    word = next((w for least, w in STRENGTHS.items() if gained > least), "weak")
    if not ranked.unseen:
        return f"{word.capitalize()}: {gained:+.1f} in log-likelihood, the price of its numbers taken off."
    parts, (low, high) = ", ".join(f"{v:+.1f}" for v in ranked.unseen), ranked.ci90
    interval = f"; 90 % interval {low:+.1f} to {high:+.1f}" if math.isfinite(high - low) else ""
    return f"{word.capitalize()}: {gained:+.1f} in log-likelihood on data left out (part by part {parts}{interval})."


def _rival_words(rival: Ranked | None, cause: Cause) -> str:
    if rival is None:
        return "No other effect in its place gains anything."
    where = "" if rival.place == cause.effect.place else f" at {place_words(rival.place)}"
    return f"The best rival, {effect_words(rival.cause)}{where}, gains {0.5 * rival.evidence:+.1f}."


def cause_remarks(diagnosis: Diagnosis, cause: Cause) -> tuple[tuple[str, str], ...]:
    """Return (label, sentence): what the effect is, what speaks for it, what it is easily mistaken for."""
    said = [("What it is", sentence(cause.meaning)), *evidence_remarks(diagnosis, cause)]
    entry = EFFECTS.get(cause.effect.slug)
    if entry is not None:
        said.append(("Where it shows", sentence(entry.shown_by)))
        if entry.mistaken_for:
            others = ", ".join(effect_words(s) for s in entry.mistaken_for)
            said.append(("Easily mistaken for", sentence(others)))
            said.append(("What tells them apart", sentence(entry.separated_by)))
    return tuple(said)


def cannot_tell(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return one sentence per group of effects these runs cannot tell apart."""
    groups = (listed([effect_words(s) for s in group]) for group in diagnosis.indistinguishable)
    return tuple(sentence(f"{names}: each explains these runs about as well as the others") for names in groups)
