"""Sentences about a cause: its name, log-likelihood gain and alternatives, and effects that the runs do not
distinguish.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping

from gcs_autotune.diagnose import Cause, Diagnosis, Ranked
from gcs_autotune.effects import EFFECTS, effect_words
from gcs_autotune.report.diagnosis.wording import base_words, gain_sentence, named, place_words
from gcs_autotune.report.toolkit.document import Note
from gcs_autotune.report.toolkit.wording import format_share, listed, sentence

__all__ = ["cause_notes", "cause_title", "evidence_notes", "not_distinguished"]


def cause_title(diagnosis: Diagnosis, cause: Cause) -> str:
    """Return the heading of a cause: its effect and place. A hypothesis is marked as such."""
    text = f"missing from {base_words(diagnosis)}: {named(cause)}" if cause.is_structural else named(cause)
    if cause.is_slight:
        text = f"slight: {text}"
    return f"Hypothesis: {text}" if diagnosis.verdict == "partly-explained" else text[0].upper() + text[1:]


NEARLY_ALL = 0.99
"""Explained fraction above which a rounded 100 % would contradict a verdict that part of the error remains."""
STRENGTHS: Mapping[float, str] = {5.0: "very strong", 3.0: "strong", 1.0: "positive"}
"""Least penalised gain in log-likelihood -> adjective for the strength of evidence. Kass1995, section 3.2, state twice
these values.
"""


def evidence_notes(diagnosis: Diagnosis, cause: Cause) -> Iterator[Note]:
    """Yield sentences on how much a cause explains, on its gain in log-likelihood, and on the best alternative."""
    if cause.gain is not None and not cause.gain.is_felt:
        text = "The cause is slight: adding it to the model hardly changes the prediction. "
        if cause.gain.is_uncertain:
            text = "It is not certain that this cause improves the prediction. "
        yield Note(text + gain_sentence(cause.gain), "Effect in practice")
    place = next(i for i, c in enumerate(diagnosis.causes) if c is cause)
    if cause.share > 0.0:
        before = itertools.takewhile(lambda c: c.share == 0.0, reversed(diagnosis.causes[:place]))
        beside = [named(c) for c in reversed(list(before))]
        subject = f"This cause, together with {listed(beside)}," if beside else "This cause"
        partly = diagnosis.verdict == "partly-explained" and cause.share > NEARLY_ALL
        share = "nearly all" if partly else format_share(cause.share)
        if diagnosis.missing is None:
            text = f"{subject} removes {share} of the squared prediction error above the noise."
            yield Note(text, "Explained on held-out data")
        else:
            yield Note(f"{subject} explains {share} of the power of the slowly varying force.", "Explained")
    elif cause.share == 0.0 and any(c.share > 0.0 for c in diagnosis.causes[place + 1 :]):
        yield Note("This cause improves the prediction only together with the next ones.", "Explained on held-out data")
        return  # what it gained alone, and its rivals then, do not hold beside the causes that it needs
    of_cause = [r for r in diagnosis.ranking if (r.cause, r.place) == (cause.effect.slug, cause.effect.place)]
    if of_cause and math.isfinite(of_cause[-1].evidence):
        others = [r for r in diagnosis.ranking if r.step == of_cause[-1].step and r.cause != cause.effect.slug]
        rival = max((r for r in others if r.evidence > 0.0), key=lambda r: r.evidence, default=None)
        yield Note(f"{_strength(of_cause[-1])} {_rival_words(rival, of_cause[-1])}", "Evidence")


def _strength(ranked: Ranked) -> str:
    """Return a text with the strength of evidence for a candidate, and its origin."""
    gained = 0.5 * ranked.evidence
    word = next((w for least, w in STRENGTHS.items() if gained > least), "weak")
    if not ranked.unseen:
        return f"{word.capitalize()}: log-likelihood {gained:+.1f}, after the penalty for the added parameters."
    parts, (low, high) = ", ".join(f"{v:+.1f}" for v in ranked.unseen), ranked.ci90
    interval = f"; 90 % interval {low:+.1f} to {high:+.1f}" if math.isfinite(high - low) else ""
    return f"{word.capitalize()}: log-likelihood of the held-out data {gained:+.1f} (per part {parts}{interval})."


def _rival_words(rival: Ranked | None, accepted: Ranked) -> str:
    if rival is None:
        return "There is no evidence for an alternative effect."
    where = "" if rival.place == accepted.place else f" at {place_words(rival.place)}"
    shown, own = (f"{0.5 * each.evidence:+.1f}" for each in (rival, accepted))
    is_worse = rival.evidence < accepted.evidence and shown != own
    head = "Best alternative" if is_worse else "These runs support another cause as well"
    return f"{head}: {effect_words(rival.cause)}{where}, log-likelihood {shown}."


def cause_notes(diagnosis: Diagnosis, cause: Cause) -> Iterator[Note]:
    """Yield sentences on the meaning of a cause's effect, its gain in log-likelihood, and effects that it is easily
    mistaken for.
    """
    yield Note(sentence(cause.meaning), "Meaning")
    yield from evidence_notes(diagnosis, cause)
    entry = EFFECTS.get(cause.effect.slug)
    if entry is None:
        return
    yield Note(sentence(entry.shown_by), "Where it shows", detail=True)
    if entry.mistaken_for:
        others = ", ".join(effect_words(slug) for slug in entry.mistaken_for)
        yield Note(sentence(others), "Easily mistaken for", detail=True)
        yield Note(sentence(entry.separated_by), "How to distinguish them", detail=True)


def not_distinguished(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return one sentence per group of effects that the runs of *diagnosis* do not distinguish."""
    groups = (listed([effect_words(s) for s in group]) for group in diagnosis.indistinguishable)
    return tuple(sentence(f"{names} explain these runs about equally well") for names in groups)
