"""The eight structures of a controller of one motion, and the closed loops they make: Miskovic2010, table 8.1."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from gcs_autotune.models import SingleDof, TransferFunction
from gcs_autotune.notebook import Displayed

__all__ = ["STRUCTURES", "Structure"]

ActsOn = Literal["error", "output"]


@dataclass(frozen=True, slots=True)
class Structure(Displayed):
    """Which channels a controller has, and what each acts on.

    A channel on the *error* passes a step of the set-point on to the actuator; one on the *output* does not, which
    spares a rudder. Without an integral a constant disturbance leaves a steady error.
    """

    name: str
    proportional: ActsOn
    derivative: ActsOn | None = None
    integral: bool = False

    def closed_loop(self, model: SingleDof, K_P: float, K_I: float = 0.0, K_D: float = 0.0) -> TransferFunction:
        """Return set-point to position on ``alpha s^2 + beta s``, with unit static gain.

        Miskovic2010, table 8.1, whose ``K/(s (T s + 1))`` has ``alpha = T/K`` and ``beta = 1/K``. Errata of the table:
        P-D has ``(1 + K K_D) s``, and K_P where PD prints K_R. Gains of channels that the structure lacks are ignored;
        quadratic drag and delay are left out.
        """
        K_I, K_D = K_I if self.integral else 0.0, K_D if self.derivative else 0.0
        rising = [K_P, model.beta + K_D, model.alpha]
        zeros = [
            K_P if self.proportional == "error" else 0.0,
            K_D if self.derivative == "error" else 0.0,
        ]
        if self.integral:
            rising, zeros = [K_I, *rising], [K_I, *zeros]
        while len(zeros) > 1 and zeros[-1] == 0.0:
            zeros.pop()
        scale = rising[0]
        return TransferFunction(tuple(b / scale for b in zeros), tuple(a / scale for a in rising))


STRUCTURES: Mapping[str, Structure] = {
    structure.name: structure
    for structure in (
        Structure("P", "error"),
        Structure("PD", "error", "error"),
        Structure("P-D", "error", "output"),
        Structure("PI", "error", integral=True),
        Structure("I-P", "output", integral=True),
        Structure("PID", "error", "error", integral=True),
        Structure("PI-D", "error", "output", integral=True),
        Structure("I-PD", "output", "output", integral=True),
    )
}
"""Name -> structure: the rows of the table. Letters after the hyphen act on the output."""
