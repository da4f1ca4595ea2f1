"""What an identification method is: a name, one line for ``--help``, and a function per kind of model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from gcs_autotune.identify.case import Case
from gcs_autotune.identify.result import AxisFit, Fit, Model

__all__ = ["Bears", "Method"]

Bears = Literal["stamps", "rounding", "robust", "delay", "effects", "lever arm"]
"""Input stamps that may all be off (decision 3); a coarse sensor's rounding, exactly; outliers (``loss="soft_l1"``); an
unknown delay, fitted on strong evidence; effects beside the form's own terms; a sensor off the centre."""


@dataclass(frozen=True, slots=True)
class Method:
    """One row of ``METHODS``.

    ``axis`` fits one degree of freedom (:class:`SingleDof`), ``coupled`` several
    (:class:`gcs_autotune.models.coupled.CoupledModel`); None: the method has no answer for that kind. ``options``
    names the keyword arguments of ``fit`` that this method alone understands, each with one line of help.
    ``bears``: what of the runs and of the question it can take; the rest is said as a doubt where it matters.
    """

    name: str
    summary: str
    axis: Callable[[Case], AxisFit] | None = None
    coupled: Callable[[Case], Fit[Model]] | None = None
    options: tuple[tuple[str, str], ...] = ()
    bears: frozenset[Bears] = frozenset()
