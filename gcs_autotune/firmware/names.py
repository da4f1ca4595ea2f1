"""The parameter names of one vehicle, determined by asking it, never by its version."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from gcs_autotune.firmware.aliases import ALIASES, Alias

__all__ = ["AlternativesSource", "Names", "read_named"]


class AlternativesSource(Protocol):
    """A vehicle that can be asked for several alternative names of a parameter at once."""

    def read_any(self, groups: Iterable[Sequence[str]]) -> dict[str, float]:
        """Return, for each group of names, the existing one (the first, if several) with its value."""
        ...


@dataclass(frozen=True, slots=True)
class Names:
    """Canonical name -> the name on this vehicle. A name that is missing is the same on the vehicle.

    In laws and gains, names and values are canonical. In messages, journals, files and output they are the vehicle's
    own.
    """

    spelled: Mapping[str, Alias] = field(default_factory=dict)

    def own(self, name: str) -> str:
        """Return the vehicle's name for the canonical *name*."""
        alias = self.spelled.get(name)
        return name if alias is None else alias.name

    def own_value(self, name: str, value: float) -> float:
        """Return the vehicle's value for the canonical *value* of *name*."""
        alias = self.spelled.get(name)
        return value if alias is None else alias.to_own(value)

    def to_own(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return *values* under the vehicle's names, in its units."""
        return {self.own(name): self.own_value(name, value) for name, value in values.items()}

    def to_canonical(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return the vehicle's *values* under canonical names, in canonical units."""
        back = {alias.name: (name, alias) for name, alias in self.spelled.items()}
        found = {}
        for own, value in values.items():
            name, alias = back.get(own, (own, None))
            found[name] = value if alias is None else alias.to_canonical(value)
        return found

    def limits(self, name: str, low: float, high: float) -> tuple[float, float]:
        """Return the documented range of *name* on this vehicle, in canonical units; otherwise *low*, *high*."""
        alias = self.spelled.get(name)
        if alias is None or alias.low is None or alias.high is None:
            return low, high
        return alias.to_canonical(alias.low), alias.to_canonical(alias.high)

    def worded(self, text: str) -> str:
        """Return *text* with every canonical name replaced by the vehicle's name."""
        if not self.spelled:
            return text
        return re.sub(r"\b[A-Z][A-Z0-9_]+\b", lambda match: self.own(match[0]), text)


def read_named(parameters: AlternativesSource, names: Iterable[str]) -> tuple[Names, dict[str, float]]:
    """Request the canonical *names* under all their possible names. Return the names that exist and the vehicle's
    values.

    A parameter that the vehicle does not have is missing in the values.
    """
    wanted = list(dict.fromkeys(names))
    found = parameters.read_any([(name, *(alias.name for alias in ALIASES.get(name, ()))) for name in wanted])
    spelled = {
        name: alias for name in wanted if name not in found for alias in ALIASES.get(name, ()) if alias.name in found
    }
    return Names(spelled), found
