"""Where a coupled fit begins: the regression, and sturdier starts for when the regression leads nowhere."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.axis.likelihood import gaussian_laws
from gcs_autotune.identify.coupled.limits import physical
from gcs_autotune.identify.coupled.objective import CoupledObjective, Limits, first_input
from gcs_autotune.identify.coupled.record import CoupledRecord, pieces_of
from gcs_autotune.identify.coupled.regression import Regression, regression_of
from gcs_autotune.identify.coupled.smoothing import Motion, first_levels_of, smoothed_motion
from gcs_autotune.identify.least_squares import descend
from gcs_autotune.models.coupled import Form
from gcs_autotune.models.coupled.derivatives import inertia_of

__all__ = ["Ground", "ground_of"]

Array = NDArray[np.float64]

PIECES = 15
"""Pieces a record is cut into for a start: each begins where the craft was measured to be, so nothing runs away."""

SHORTEST = 12
"""Fewest stamps of a piece."""

TRIALS, ROUGH = 25, 1e-4
"""Trials on the pieces, and the relative decrease that ends them: a start need not be exact."""

MOST = 3.0
"""Mean cost per sample (1: the signal's roughness times :data:`LOOSE`) above which the pieces are not explained."""

LOOSE = 5.0
"""How much larger than its roughness a signal's noise is taken while the pieces begin at smoothed states."""


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """What is known before any simulation: smoothed motions, the regression, first states and noise levels."""

    form: Form
    records: tuple[CoupledRecord, ...]
    motions: tuple[Motion, ...]
    regression: Regression
    initial: tuple[Array, ...]
    levels: Mapping[str, float]

    def starts(self, limits: Limits) -> Iterator[Array]:
        """Yield start values (p,), the likeliest first.

        The regression; the regression with positive inertia and drag that damps, made better on short pieces; a craft
        of the right size without any coupling, likewise. What cannot explain even short pieces is not worth a start.
        """
        yield self.regression.solve(limits)
        sturdy = limits.within(physical(self.form))
        for theta in (self.regression.solve(sturdy), self._plain(sturdy)):
            better, excess = self.on_pieces(theta, sturdy)
            if excess < MOST:
                yield better

    def pieces(self) -> tuple[tuple[CoupledRecord, ...], tuple[Array, ...]]:
        """Return the records cut into short pieces, and the smoothed state each begins with."""
        pieces, initial = [], []
        for record, motion in zip(self.records, self.motions, strict=True):
            for piece in _pieces(record):
                pieces.append(piece)
                x_0 = np.array([np.interp(piece.start, motion.t, column) for column in motion.X.T])
                initial.append(_lagged(x_0, piece, self.form))
        return tuple(pieces), tuple(initial)

    def on_pieces(self, theta: Array, limits: Limits) -> tuple[Array, float]:
        """Fit short pieces that begin at smoothed states, from *theta* on; return values and mean cost per sample.

        The cost is infinite when even the pieces run away.
        """
        pieces, initial = self.pieces()
        objective = CoupledObjective(self.form, pieces, self.form.free, theta, initial, fixed_states=True)
        at = partial(objective.at, laws=gaussian_laws({n: LOOSE * v for n, v in self.levels.items()}, robust=True))
        found = descend(at, objective.pack(), *objective.limits(limits), trials=TRIALS, tolerance=ROUGH)
        if found is None:
            return theta, np.inf
        n = sum(len(s.t) for piece in pieces for s in piece.signals.values())
        return objective.unpack(found.x)[0], found.cost / n

    def _plain(self, limits: Limits) -> Array:
        """Return values (p,) of a craft without coupling whose inertia and drag are of the size of its forces."""
        r = self.regression
        low, high = limits.of(r.names)
        values = np.where(high <= 0.0, -0.5, np.where(low >= 0.0, 0.5, 0.0)) * r.scales
        for i, name in enumerate(r.names):
            inertia = inertia_of(name) if name.endswith("dot") else None
            if inertia is not None and inertia.row == inertia.column and values[i] == 0.0:
                values[i] = -1e-3
        return r.with_values(np.clip(values, low, high))


def ground_of(form: Form, records: Sequence[CoupledRecord], delay: float | None = None) -> Ground:
    """Look at *records* once; *delay* [s] is where a free delay begins."""
    known = form.known.get("delay", 0.0) if delay is None else delay
    motions = tuple(smoothed_motion(form, record, known) for record in records)
    initial = tuple(_lagged(m.X[0].copy(), r, form) for r, m in zip(records, motions, strict=True))
    regression = regression_of(form, motions, delay)
    return Ground(form, tuple(records), motions, regression, initial, first_levels_of(records))


def _lagged(x_0: Array, record: CoupledRecord, form: Form) -> Array:
    k = 2 * len(form.dofs)
    if len(x_0) > k:
        x_0[k:] = first_input(record)
    return x_0


def _pieces(record: CoupledRecord) -> Iterator[CoupledRecord]:
    return pieces_of(record, max(1, min(PIECES, len(record.stamps) // SHORTEST)))
