"""Definition of an identification method: its name, its line in ``--help``, and its functions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from gcs_autotune.identify.case import Case
from gcs_autotune.identify.result import AxisFit, Fit, Model

__all__ = ["Bears", "Method"]

Bears = Literal["stamps", "rounding", "robust", "delay", "effects", "lever arm"]
"""Features that a method may support.

- ``stamps``: a common shift of input stamps (decision 3).
- ``rounding``: the exact rounding of a coarse sensor.
- ``robust``: outliers (``loss="soft_l1"``).
- ``delay``: an unknown delay, kept only on strong evidence.
- ``effects``: effects in addition to the form's terms.
- ``lever arm``: a sensor away from the centre.
"""


@dataclass(frozen=True, slots=True)
class Method:
    """One row of ``METHODS``.

    - ``summary``: line for ``--help``.
    - ``axis``: function that fits one degree of freedom (:class:`SingleDof`), None if the method does not support this.
    - ``coupled``: function that fits several degrees of freedom (:class:`gcs_autotune.models.coupled.CoupledModel`),
      None if the method does not support this.
    - ``options``: keyword arguments of ``fit`` for this method only, each with one line of help.
    - ``bears``: supported features. If a run needs an unsupported feature, the fit has a doubt.
    """

    name: str
    summary: str
    axis: Callable[[Case], AxisFit] | None = None
    coupled: Callable[[Case], Fit[Model]] | None = None
    options: tuple[tuple[str, str], ...] = ()
    bears: frozenset[Bears] = frozenset()
