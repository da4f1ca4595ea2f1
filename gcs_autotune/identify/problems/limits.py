"""Lower and upper limits of the parameters of a model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.models import FORCES, RIGID_BODY, STATES, Form, inertia_of

__all__ = ["Limits"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Limits:
    """Lower and upper limits of parameters.

    - ``low``: name -> lower limit. Parameters that are not listed have none.
    - ``high``: name -> upper limit. Parameters that are not listed have none.
    """

    low: Mapping[str, float]
    high: Mapping[str, float]

    @classmethod
    def physical(cls, form: Form) -> Limits:
        """Return the limits of *form* that keep inertia positive and drag damping."""
        sides = {n: _physical_side(n) for n in form.free}
        return cls({n: 0.0 for n, s in sides.items() if s > 0}, {n: 0.0 for n, s in sides.items() if s < 0})

    def of(self, names: Sequence[str]) -> tuple[Array, Array]:
        """Return the lower and the upper limits (p,) in the order of *names*."""
        low = np.array([self.low.get(n, -np.inf) for n in names])
        return low, np.array([self.high.get(n, np.inf) for n in names])

    def within(self, other: Limits) -> Limits:
        """Return limits that satisfy both these limits and *other*.

        If the two contradict each other, these limits apply.
        """
        low, high = dict(self.low), dict(self.high)
        for name in {*other.low, *other.high}:
            least = max(self.low.get(name, -np.inf), other.low.get(name, -np.inf))
            most = min(self.high.get(name, np.inf), other.high.get(name, np.inf))
            if least < most:
                low[name], high[name] = least, most
        return Limits(low, high)


def _physical_side(name: str) -> int:
    """Return the sign of a parameter that physics requires: -1, 1, or 0 for either sign."""
    if name in ("m", "I_x", "I_y", "I_z"):
        return 1
    if name in RIGID_BODY or "_" not in name or name[0] not in FORCES:
        return 0
    inertia = inertia_of(name)
    if inertia is not None:
        return -1 if inertia.row == inertia.column else 0
    own = STATES[FORCES.index(name[0])]
    return -1 if name[2:] in (own, own * 2, f"|{own}|{own}", own * 3) else 0
