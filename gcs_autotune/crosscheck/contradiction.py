"""A contradiction between two columns, as numbers and as text."""

from __future__ import annotations

from dataclasses import dataclass

from gcs_autotune.notebook import Displayed

__all__ = ["Contradiction"]


@dataclass(frozen=True, slots=True)
class Contradiction(Displayed):
    """Two columns of one run that report the same motion differently.

    Attributes
    ----------
    pair : names of the columns, joined with " against ", such as ``psi against r``.
    kind : ``factor``, ``sign``, ``shift``, ``still``, ``unrelated``, ``turned`` or ``exchanged``.
    value, std : the factor, the shift [s] or the angle [rad] with its standard error; NaN if there is none.
    suspect : the column that is more likely wrong; empty if nothing shows which.
    columns : all columns of the comparison.
    unit : the unit that explains the factor; empty for any other factor.
    cause, cure : cause and remedy as text.
    """

    pair: str
    kind: str
    value: float
    std: float
    suspect: str
    columns: tuple[str, ...]
    cause: str
    cure: str
    unit: str = ""
