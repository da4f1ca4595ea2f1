"""The two dataflash messages that a script of ``gcs-autotune aboard`` writes with ``logger:write``.

Most columns are whole numbers with a scale, because a slow link has to carry the log.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["ENDS", "ROWS", "Field", "Layout", "sources_of"]

Array = NDArray[np.float64]
UNKNOWN = -32768
"""Whole number of an unknown value. An unknown position is infinite."""


class Field(NamedTuple):
    """One column: its label, its letter in FMT, its source in the sample store, and SI units per count."""

    label: str
    letter: str
    source: str
    scale: float = 1.0


class Layout(NamedTuple):
    """One message: its name and its columns."""

    name: str
    fields: tuple[Field, ...]

    @property
    def labels(self) -> str:
        """The labels as ``logger:write`` takes them."""
        return ",".join(field.label for field in self.fields)

    @property
    def letters(self) -> str:
        """The format letters as ``logger:write`` takes them."""
        return "".join(field.letter for field in self.fields)


ROWS = Layout(
    "AXP",
    (
        Field("Ph", "B", "part"),
        Field("FX", "h", "X", 1e-4),
        Field("FZ", "h", "Z", 1e-4),
        Field("FN", "h", "N", 1e-4),
        Field("Yaw", "h", "psi", 1e-4),
        Field("R", "h", "r", 1e-3),
        Field("PN", "f", "x"),
        Field("PE", "f", "y"),
        Field("PD", "f", "z"),
        Field("U", "h", "u", 1e-3),
        Field("V", "h", "v", 1e-3),
        Field("W", "h", "w", 1e-3),
    ),
)
"""One row per control tick or two: part of the plan, commanded forces [fraction of full output], motion [SI, rad]."""
ENDS = Layout(
    "AXE",
    (
        Field("Ph", "B", "end.part"),
        Field("End", "B", "end.ending"),
        Field("C", "f", "end.C"),
        Field("Xa", "f", "end.x_a"),
        Field("Ref", "f", "end.reference"),
        Field("Ns", "f", "end.noise_std"),
        Field("Sp", "f", "end.speed"),
    ),
)
"""One row at the end of each relay or step: its amplitude, hysteresis, reference, noise and speed.

``End``: 0 completed, 1 out of space, 2 ended early.
"""


def sources_of(layout: Layout, columns: Mapping[str, Any]) -> dict[str, Array]:
    """Return source (``aboard.psi``) -> values (n,) in SI of the messages of *layout*; NaN if unknown."""
    found: dict[str, Array] = {}
    for field in layout.fields:
        values = np.asarray(columns[field.label], dtype=np.float64)
        unknown = ~np.isfinite(values) | ((field.letter == "h") & (values == UNKNOWN))
        found[f"aboard.{field.source}"] = np.where(unknown, np.nan, values * field.scale)
    return found
