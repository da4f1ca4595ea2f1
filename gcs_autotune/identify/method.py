"""Definition of an identification method: a name, one line for ``--help``, and a function per kind of model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from gcs_autotune.identify.case import Case
from gcs_autotune.identify.result import AxisFit, Fit, Model

__all__ = ["Bears", "Method"]

Bears = Literal["stamps", "rounding", "robust", "delay", "effects", "lever arm"]
"""Features that a method supports.

Input stamps with a common shift (decision 3); a coarse sensor's rounding, exactly; outliers (``loss="soft_l1"``); an
unknown delay, fitted on strong evidence; effects in addition to the form's terms; a sensor off the centre.
"""


@dataclass(frozen=True, slots=True)
class Method:
    """One row of ``METHODS``.

    ``axis`` fits one degree of freedom (:class:`SingleDof`), ``coupled`` several
    (:class:`gcs_autotune.models.coupled.CoupledModel`). None: the method does not support that kind. ``options``:
    keyword arguments of ``fit`` for this method alone, each with one line of help. ``bears``: supported features. A
    missing one raises a doubt where it matters.
    """

    name: str
    summary: str
    axis: Callable[[Case], AxisFit] | None = None
    coupled: Callable[[Case], Fit[Model]] | None = None
    options: tuple[tuple[str, str], ...] = ()
    bears: frozenset[Bears] = frozenset()
