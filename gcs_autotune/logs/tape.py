"""What any ArduPilot log holds between two boots, whatever its format: samples, parameters, modes, arming.

Readers fill a :class:`Tape` with *named sources* (``attitude.psi``, ``local.x``, ``ekf.z``, ``servo.1``); which source
becomes which channel is decided afterwards, in :mod:`.channels`. Angles are in radians, the rest in SI, positions on
the globe in degrees.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import ParameterMissing
from gcs_autotune.firmware import Firmware

__all__ = ["Note", "RecordedParameters", "Tape"]

Array = NDArray[np.float64]
Note = tuple[str, str, str]
"""Slug, cause and cure: becomes a ``Doubt`` of whatever is identified from the run."""


class RecordedParameters:
    """Parameters as a log tells them; a ``ParameterSource``."""

    def __init__(self, values: Mapping[str, float]) -> None:
        self.values = dict(values)

    def read(self, name: str) -> float:
        """Return one value."""
        return self.read_all([name])[name]

    def read_all(self, names: Iterable[str]) -> dict[str, float]:
        """Return all of them.

        Raises
        ------
        ParameterMissing
            The log does not tell one of them.
        """
        wanted = list(names)
        missing = [n for n in wanted if n not in self.values]
        if missing:
            raise ParameterMissing(f"the log does not tell the parameter {', '.join(missing)}", name=missing[0])
        return {n: self.values[n] for n in wanted}

    def read_existing(self, names: Iterable[str]) -> dict[str, float]:
        """Return those of *names* that the log tells."""
        return {n: self.values[n] for n in names if n in self.values}


@dataclass(eq=False)
class Tape:
    """One vehicle from one boot to the next; times [s] since that boot.

    Attributes
    ----------
    name : of the file. vehicle : in words. firmware : its profile, None when unknown.
    parameters : last recorded value of each. texts, modes, arming : what was said or became so, with its time.
    clock : whose stamps these are. late : samples left out because they came after younger ones.
    """

    name: str
    clock: str
    vehicle: str = "unknown vehicle"
    firmware: Firmware | None = None
    parameters: dict[str, float] = field(default_factory=dict)
    modes: list[tuple[float, int]] = field(default_factory=list)
    arming: list[tuple[float, bool]] = field(default_factory=list)
    texts: list[tuple[float, str]] = field(default_factory=list)
    notes: list[Note] = field(default_factory=list)
    late: int = 0
    _samples: dict[str, tuple[list[float], list[float]]] = field(default_factory=dict)

    def take(self, t: float, values: Mapping[str, float]) -> None:
        """Add samples stamped *t*; one older than the last of its source is counted and left out."""
        for name, value in values.items():
            stamps, column = self._samples.setdefault(name, ([], []))
            if stamps and t < stamps[-1]:
                self.late += 1
                continue
            stamps.append(t)
            column.append(value)

    def __contains__(self, source: object) -> bool:
        return source in self._samples

    def series(self, source: str) -> tuple[Array, Array]:
        """Return stamps and values of a source, both empty when the log has none of it."""
        stamps, column = self._samples.get(source, ([], []))
        return np.array(stamps, dtype=np.float64), np.array(column, dtype=np.float64)

    def numbered(self, source: str) -> list[int]:
        """Return the numbers *n* of all sources called ``source.n``, in order."""
        prefix = source + "."
        return sorted(int(n.removeprefix(prefix)) for n in self._samples if n.startswith(prefix))

    @property
    def span(self) -> tuple[float, float]:
        """First and last stamp [s]; (0, 0) when there is nothing."""
        ends = [(s[0], s[-1]) for s, _ in self._samples.values() if s]
        return (min(a for a, _ in ends), max(b for _, b in ends)) if ends else (0.0, 0.0)
