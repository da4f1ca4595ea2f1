"""The precision that a self-planned trial has to reach, for example ``N_r 5%, Y_v 10%``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from gcs_autotune.errors import UsageError
from gcs_autotune.models import FORMS
from gcs_autotune.registry import lookup
from gcs_autotune.sname import DOFS
from gcs_autotune_files import Refused, number, shown

__all__ = ["Precision", "precision_of"]

FORMS_FLOWN = ("horizontal",)
"""Coupled forms for which trials can be planned: their inputs are the forces that a flight records."""
MOST_PERCENT = 100.0
_ITEM = re.compile(r"\s*([A-Za-z][A-Za-z_0-9|]*)\s*[= ]\s*([0-9.]+)\s*%\s*")


@dataclass(frozen=True, slots=True)
class Precision:
    """The required precision of a ``form``, to be reached within ``seconds`` of runs.

    It maps a parameter to its standard error divided by its value. ``typed`` contains the user's name of a parameter if
    the fit uses another one.
    """

    wanted: Mapping[str, float]
    form: str
    seconds: float
    typed: Mapping[str, str] = field(default_factory=dict)

    @property
    def dofs(self) -> tuple[str, ...]:
        """Degrees of freedom of the form."""
        return (self.form,) if self.form in DOFS else tuple(FORMS[self.form].dofs)

    def reached(self, relative: Mapping[str, float]) -> bool:
        """Return whether the relative standard errors are as small as required."""
        return all(relative[name] <= share for name, share in self.wanted.items())

    def told(self, relative: Mapping[str, float]) -> str:
        """Return a sentence with the present precision of each parameter."""
        return ", ".join(
            f"{self.called(n)} {_shown(relative[n])} (required {_shown(share)})" for n, share in self.wanted.items()
        )

    def called(self, name: str) -> str:
        """Return the text that names a parameter as the user and the fit do."""
        return f"{self.typed[name]} = {name}" if name in self.typed else name

    @property
    def title(self) -> str:
        """Text of the required precision."""
        return ", ".join(f"{self.called(n)} to {_shown(share)}" for n, share in self.wanted.items())


def precision_of(text: str, form: str, seconds: float) -> Precision:
    """Parse a precision such as ``N_r 5%, Y_v 10%``. Without a *form*, choose the smallest one with all these
    parameters.

    A derivative of one degree of freedom may be called by its SNAME name or by the fit's (``N_r``, ``beta_r``).

    Raises
    ------
    UsageError, UnknownName
        The text cannot be read, or no form, or not this *form*, has such a parameter.
    """
    asked: dict[str, float] = {}
    for item in text.split(","):
        found = _ITEM.fullmatch(item)
        if found is None:
            raise UsageError(f"{shown(item.strip())} is not NAME PERCENT. Write e.g. --until 'N_r 5%, Y_v 10%'")
        try:
            asked[found[1]] = number(found[2]) / 100.0
        except Refused as error:
            raise UsageError(f"{error}. Write e.g. --until 'N_r 5%, Y_v 10%'") from None
    wrong = [n for n, share in asked.items() if not 0.0 < 100.0 * share <= MOST_PERCENT]
    if wrong:
        raise UsageError(f"the precision of {wrong[0]} must be above 0 and at most {MOST_PERCENT:g} %")
    if form:
        known = {name: name for name in (*DOFS, *FORMS_FLOWN)}
        chosen = lookup(known, form, "form")
        return _asked({_name_in(chosen, n): n for n in asked}, asked, form, seconds)
    for candidate in (*DOFS, *FORMS_FLOWN):
        if all(n in _names(candidate) for n in asked):
            return _asked({_names(candidate)[n]: n for n in asked}, asked, candidate, seconds)
    everything = {n: n for candidate in (*DOFS, *FORMS_FLOWN) for n in _names(candidate)}
    for name in asked:
        lookup(everything, name, "parameter")
    raise UsageError(
        f"no single form has all of {', '.join(asked)}. Use the parameters of one form: {', '.join(FORMS_FLOWN)}"
    )


def _asked(typed: Mapping[str, str], asked: Mapping[str, float], form: str, seconds: float) -> Precision:
    wanted = {name: asked[said] for name, said in typed.items()}
    return Precision(wanted, form, seconds, {name: said for name, said in typed.items() if name != said})


def _names(form: str) -> Mapping[str, str]:
    """Return a table from the names by which a form's parameters may be called to the names in its fit."""
    if form not in DOFS:
        return {n: n for n in FORMS[form].free}
    nu = DOFS[form].velocity
    called = (f"alpha_{nu}", f"beta_{nu}", f"beta_{nu}{nu}")
    return {**dict(zip(DOFS[form].derivative_names(), called, strict=False)), **{n: n for n in called}}


def _name_in(form: str, name: str) -> str:
    return lookup(_names(form), name, f"parameter of '{form}'")


def _shown(share: float) -> str:
    return "unknown" if not share < 10.0 else f"{100.0 * share:.2g} %"
