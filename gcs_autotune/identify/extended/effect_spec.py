"""Effects to fit, requested by name: ``dead-zone``, ``dead-zone@N``."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from gcs_autotune.effects import EFFECTS, DataSummary, EffectInstance
from gcs_autotune.errors import UsageError
from gcs_autotune.registry import lookup

__all__ = ["EffectSpec", "effect_spec_of"]


@dataclass(frozen=True, slots=True)
class EffectSpec:
    """An effect to fit, as the user requested it.

    - ``slug``: name of the effect.
    - ``place``: where the effect acts. None chooses the place at which the effect explains most.
    """

    slug: str
    place: str | None = None

    def candidates(self, data_summary: DataSummary) -> Iterator[EffectInstance]:
        """Yield the effect at every place and with every set of start values that the runs of *data_summary* allow.

        Raises
        ------ UsageError These runs cannot identify the effect, or not at the requested place.
        """
        entry = EFFECTS[self.slug]
        places = entry.places(data_summary)
        if not places:
            raise UsageError(f"these runs cannot identify '{self.slug}' ({entry.meaning}). Omit it")
        if self.place is not None and self.place not in places:
            raise UsageError(
                f"'{self.slug}' cannot act on '{self.place}' in these runs. Use one of these places: "
                f"{', '.join(places)}"
            )
        for place in places if self.place is None else (self.place,):
            constants = entry.constants(place, data_summary)
            for start in entry.starts(place, data_summary):
                yield EffectInstance(self.slug, place, dict(start), dict(constants))


def effect_spec_of(text: str) -> EffectSpec:
    """Return the effect written as ``slug`` or ``slug@place``.

    Raises
    ------
    UnknownName
        There is no effect of this name.
    """
    slug, _, place = text.strip().partition("@")
    return EffectSpec(lookup(EFFECTS, slug, "effect").slug, place or None)
