"""Where a coupled fit begins: the regression, and sturdier starts for when the regression leads nowhere."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.coupled.limits import physical
from gcs_autotune.identify.coupled.regression import Regression, regression_of
from gcs_autotune.identify.coupled.smoothing import Motion, smoothed_motion
from gcs_autotune.identify.first_look import first_levels
from gcs_autotune.identify.least_squares import descend
from gcs_autotune.identify.likelihood import Limits, Objective, first_input
from gcs_autotune.identify.noise import gaussian_noise
from gcs_autotune.identify.problem import Problem
from gcs_autotune.identify.segment import Segment
from gcs_autotune.models.coupled import Form
from gcs_autotune.models.coupled.derivatives import inertia_of

__all__ = ["InitialGuess", "initial_guess_of"]

Array = NDArray[np.float64]

PIECES = 15
"""Pieces a record is cut into for a start: each begins where the craft was measured to be, so nothing runs away."""

SHORTEST = 12
"""Fewest stamps of a piece."""

TRIALS, ROUGH = 25, 1e-4
"""Trials on the pieces, and the relative decrease that ends them: a start need not be exact."""

FEW = 2
"""Trials that tell whether a form suits the pieces at all."""

LIGHTEST = 0.02
"""Smallest inertia of a start, in units of that whose acceleration takes all of the known forces."""

SHARE = 0.1
"""Noise to begin with, in shares of a signal's standard deviation."""


@dataclass(frozen=True, slots=True, eq=False)
class InitialGuess:
    """What is known before any simulation: smoothed motions, the regression, first states.

    ``rough``: each signal's scatter about its neighbours, the least noise a fit can leave; ``levels``: noise to begin
    with, a share of the motion itself, for a model that does not hold to the last digit leaves far more than scatter.
    """

    form: Form
    records: tuple[Segment, ...]
    motions: tuple[Motion, ...]
    regression: Regression
    initial: tuple[Array, ...]
    rough: Mapping[str, float]
    levels: Mapping[str, float]

    def starts(self, limits: Limits) -> Iterator[Array]:
        """Yield start values (p,), the likeliest first.

        The regression; the regression with positive inertia and drag that damps, made better on short pieces; a craft
        of the right size without any coupling, likewise.
        """
        yield self.regression.solve(limits)
        sturdy = self.sturdy(limits)
        for theta in (self.regression.solve(sturdy), self._plain(sturdy)):
            better = self.on_pieces(theta, sturdy)
            if better is not None:
                yield better[0]

    def misfit(self, limits: Limits) -> float:
        """Return what the form leaves of short pieces after a few trials: comparable between records of one size."""
        sturdy = self.sturdy(limits)
        end = self.on_pieces(self.regression.solve(sturdy), sturdy, FEW)
        return math.inf if end is None else end[1]

    def sturdy(self, limits: Limits) -> Limits:
        """Return *limits* cut down to a craft that can be simulated: drag that damps, inertia not near zero."""
        high = {}
        for name, scale in zip(self.regression.names, self.regression.scales.tolist(), strict=True):
            inertia = inertia_of(name) if name.endswith("dot") else None
            if inertia is not None and inertia.row == inertia.column and not _has_rigid_body(self.form):
                high[name] = -LIGHTEST * (scale or 1.0)
        return limits.within(Limits({}, high)).within(physical(self.form))

    def pieces(self) -> tuple[tuple[Segment, ...], tuple[Array, ...]]:
        """Return the records cut into short pieces, and the smoothed state each begins with."""
        pieces, initial = [], []
        for record, motion in zip(self.records, self.motions, strict=True):
            for piece in _pieces(record):
                pieces.append(piece)
                x_0 = np.array([np.interp(piece.start, motion.t, column) for column in motion.X.T])
                initial.append(_lagged(x_0, piece, self.form))
        return tuple(pieces), tuple(initial)

    def on_pieces(self, theta: Array, limits: Limits, trials: int = TRIALS) -> tuple[Array, float] | None:
        """Fit the parameters from *theta* on to short pieces that begin at smoothed states, and return them and the
        cost; None if even these fail.
        """
        pieces, initial = self.pieces()
        objective = Objective(Problem(self.form, pieces, None, limits), theta, initial, fixed_states=True)
        at = partial(objective.at, noise=gaussian_noise(self.levels, robust=True))
        found = descend(at, objective.pack(), *objective.limits(), trials=trials, tolerance=ROUGH)
        return None if found is None else (objective.unpack(found.x)[0], found.cost)

    def _plain(self, limits: Limits) -> Array:
        """Return values (p,) of a craft without coupling whose inertia and drag are of the size of its forces."""
        r = self.regression
        low, high = limits.of(r.names)
        values = np.where(high <= 0.0, -0.5, np.where(low >= 0.0, 0.5, 0.0)) * r.scales
        return r.with_values(np.clip(values, low, high))


def initial_guess_of(form: Form, records: Sequence[Segment], delay: float | None = None) -> InitialGuess:
    """Look at *records* once; *delay* [s] is where a free delay begins."""
    known = form.known.get("delay", 0.0) if delay is None else delay
    motions = tuple(smoothed_motion(form, record, known) for record in records)
    initial = tuple(_lagged(m.X[0].copy(), r, form) for r, m in zip(records, motions, strict=True))
    regression = regression_of(form, motions, delay)
    rough = first_levels(records)
    spread = {n: max(float(np.std(r.signals[n].values)) for r in records if n in r.signals) for n in rough}
    levels = {n: max(level, SHARE * spread[n]) for n, level in rough.items()}
    return InitialGuess(form, tuple(records), motions, regression, initial, rough, levels)


def _lagged(x_0: Array, record: Segment, form: Form) -> Array:
    k = 2 * len(form.dofs)
    if len(x_0) > k:
        x_0[k:] = first_input(record)
    return x_0


def _has_rigid_body(form: Form) -> bool:
    return any(name in form.known for name in ("m", "I_x", "I_y", "I_z"))


def _pieces(record: Segment) -> list[Segment]:
    return record.pieces(max(1, min(PIECES, len(record.stamps) // SHORTEST)))
