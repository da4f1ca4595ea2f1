"""Filter one degree of freedom that is linear in its own velocity, with exact transitions.

The equation stays linear in the craft's own velocity if an effect distorts, delays or scales the commands. The same
holds for forces from measured flow, and for damping that depends on measured flow. The motion between two stamps is
then an exponential, and neither Runge-Kutta steps nor sensitivities are needed. The drifting force is held over an
interval between samples, as in :func:`.sweep.forward`. Likelihoods of both passes are therefore comparable.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gcs_autotune.identify.kalman.waves import rough, wave_transition
from gcs_autotune.models import INPUT, INPUT_SIZE, STATES, Form, term_of
from gcs_autotune.sname import DOFS

__all__ = ["LinearTerms", "linear_pass", "linear_terms"]

Array = NDArray[np.float64]


Term = tuple[str, float, tuple[tuple[str, bool], ...]]
"""A product in the equation: parameter, sign, and factors. Each factor is an input and whether its magnitude is used.
"""


@dataclass(frozen=True, slots=True)
class LinearTerms:
    """Terms of an equation that is linear in its own velocity.

    - ``forces``: terms that add up to the force.
    - ``dampings``: terms multiplied by the velocity.
    """

    forces: tuple[Term, ...]
    dampings: tuple[Term, ...]

    def rows(self, values: Mapping[str, float], channels: Mapping[str, Array]) -> tuple[Array, Array]:
        """Return the force per inertia and the damping rate (j,) for the parameters *values* and the inputs *channels*
        (j,).
        """
        return _added_up(self.forces, values, channels), -_added_up(self.dampings, values, channels)

    def share_of(self, name: str, values: Mapping[str, float], channels: Mapping[str, Array]) -> Array:
        """Return the part of the force per inertia (j,) that is proportional to the parameter *name*."""
        return _added_up([f for f in self.forces if f[0] == name], values, channels)


def _added_up(terms: Sequence[Term], values: Mapping[str, float], channels: Mapping[str, Array]) -> Array:
    row = np.zeros(len(next(iter(channels.values()))))
    for name, sign, factors in terms:
        product: Array | float = sign * values.get(name, 0.0)
        for channel, by_size in factors:
            product = product * (np.abs(channels[channel]) if by_size else channels[channel])
        row += product
    return row


def linear_terms(form: Form, added: Sequence[str]) -> LinearTerms | None:
    """Return the terms of *form*, which has one degree of freedom, or None if they are not linear in its velocity.

    The terms include the derivatives *added*. *form* must use all of its inputs. The result is None if

    - a term is not linear in the velocity,
    - a term depends on a position, or
    - an input has no free gain.
    """
    d, inputs = DOFS[form.dofs[0]], list(form.inputs)
    own = STATES.index(d.velocity)  # velocities come first among a term's factors
    forces: list[Term] = []
    dampings: list[Term] = []
    for channel, pairs in form.inputs.items():
        for force, gain in pairs:
            if not isinstance(gain, str):
                return None
            if force == d.force:
                forces.append((gain.lstrip("-"), -1.0 if gain.startswith("-") else 1.0, ((channel, False),)))
    for name in dict.fromkeys((f"{d.force}_{d.velocity}", *added)):
        if not name.startswith(f"{d.force}_"):  # a current, a wall: no force of this equation
            return None
        factors, products, velocities = term_of(name, inputs).factors, [], 0
        for code in factors:
            if code == own:
                velocities += 1
            elif code >= INPUT:
                by_size = code >= INPUT_SIZE
                products.append((inputs[code - (INPUT_SIZE if by_size else INPUT)], by_size))
            else:
                return None
        if velocities > 1:
            return None
        (dampings if velocities else forces).append((name, 1.0, tuple(products)))
    return LinearTerms(tuple(forces), tuple(dampings))


NEAR_ZERO = 1e-3
"""Product of damping and interval below which the exponential is calculated by a series.

The direct formula would lose digits by cancellation. Project choice.
"""


@njit(cache=True, nogil=True)
def linear_pass(
    t_in: Array,
    force: Array,
    damping: Array,
    stamps: Array,
    y: Array,
    of_velocity: bool,
    size: float,
    memory: float,
    noise: float,
    waves: Array,
    start: Array,
    spread: Array,
    e: Array,
    S: Array,
) -> bool:
    """Filter one record in place, and return whether the motion stayed finite.

    The first row of *force* drives the craft. For each further row the pass returns the response of the innovations to
    that force, from rest and with all samples zero. The innovations are linear in each force (DeJong1991).

    t_in, force (c, j), damping (j,) : stamps, forces and damping rates per inertia, each held until the next stamp.
    y : (s,) position at *stamps* (s,), NaN for a missing sample.
    of_velocity : whether *y* is the velocity instead.
    size, memory : standard deviation and time constant [s] of the drifting force (Ornstein-Uhlenbeck).
    noise : standard deviation of *y*.
    waves : (4,) parameters of the waves, see :mod:`.waves`. Zero size means no waves.
    start, spread : (2,) velocity and position at the first stamp, and their standard deviations.
    e (c, s), S (s,) : filled with innovations and their variances, unchanged without a sample.
    """
    rows, m = len(force), 5 if rough(waves) else 3
    # Velocity, position, the drifting force; two of the waves.
    x, P, H, K, g = np.zeros((rows, m)), np.zeros((m, m)), np.zeros(m), np.zeros(m), np.zeros(m)
    x[0, 0], x[0, 1] = start[0], start[1]
    P[0, 0], P[1, 1], P[2, 2] = spread[0] ** 2, spread[1] ** 2, size**2
    H[0 if of_velocity else 1] = 1.0
    if m > 3:
        P[3, 3] = P[4, 4] = 1.0
        H[4] = waves[0]
    F, FP = np.zeros((m, m)), np.zeros((m, m))
    row, last = 0, len(t_in) - 1
    while row < last and t_in[row + 1] <= stamps[0]:
        row += 1
    for s in range(len(stamps)):
        if s > 0:
            now, stop = stamps[s - 1], stamps[s]
            # Of the whole interval: v <- E v + a w, x <- x + p v + q w beside what the commands do.
            E, a, p, q = 1.0, 0.0, 0.0, 0.0
            while True:
                end = stop if row == last or t_in[row + 1] >= stop else t_in[row + 1]
                h, b = end - now, damping[row]
                bh = b * h
                kept = np.exp(-bh)
                if abs(bh) < NEAR_ZERO:
                    one = h * (1.0 - 0.5 * bh * (1.0 - bh / 3.0))
                    two = 0.5 * h * h * (1.0 - bh / 3.0 * (1.0 - 0.25 * bh))
                else:
                    one = (1.0 - kept) / b
                    two = (h - one) / b
                for c in range(rows):
                    f = force[c, row] + x[c, 2]
                    if m > 3:
                        f += waves[1] * x[c, 4]
                    x[c, 1] += one * x[c, 0] + two * f
                    x[c, 0] = kept * x[c, 0] + one * f
                q += one * a + two
                p += one * E
                a = kept * a + one
                E *= kept
                now = end
                if row < last and t_in[row + 1] <= stop:
                    row += 1
                if now >= stop:
                    break
            h = stop - stamps[s - 1]
            F[2, 2] = np.exp(-h / memory)
            if m > 3:
                wave_transition(waves, h, F[3:, 3:])
            for c in range(rows):
                x[c, 2] *= F[2, 2]
                if m > 3:
                    x[c, 3], x[c, 4] = F[3, 3] * x[c, 3] + F[3, 4] * x[c, 4], F[4, 3] * x[c, 3] + F[4, 4] * x[c, 4]
            for j in range(m):
                push = P[2, j] + (waves[1] * P[4, j] if m > 3 else 0.0)
                FP[0, j] = E * P[0, j] + a * push
                FP[1, j] = p * P[0, j] + P[1, j] + q * push
                FP[2, j] = F[2, 2] * P[2, j]
                for i in range(3, m):
                    FP[i, j] = F[i, 3] * P[3, j] + F[i, 4] * P[4, j]
            for i in range(m):
                push = FP[i, 2] + (waves[1] * FP[i, 4] if m > 3 else 0.0)
                P[i, 0] = FP[i, 0] * E + push * a
                P[i, 1] = FP[i, 0] * p + FP[i, 1] + push * q
                P[i, 2] = FP[i, 2] * F[2, 2]
                for j in range(3, m):
                    P[i, j] = FP[i, 3] * F[j, 3] + FP[i, 4] * F[j, 4]
                    if i > 2:  # a stationary process regains the lost variance
                        P[i, j] += (1.0 if i == j else 0.0) - F[i, 3] * F[j, 3] - F[i, 4] * F[j, 4]
            P[2, 2] += size**2 * (1.0 - F[2, 2] * F[2, 2])
            if not (abs(x[0, 0]) < 1e9 and abs(x[0, 1]) < 1e9):
                return False
        if np.isnan(y[s]):
            continue
        variance = noise**2
        for i in range(m):
            g[i] = 0.0
            for j in range(m):
                g[i] += P[i, j] * H[j]
        for i in range(m):
            variance += H[i] * g[i]
        S[s] = variance
        for i in range(m):
            K[i] = g[i] / variance
        for c in range(rows):
            error = y[s] if c == 0 else 0.0
            for i in range(m):
                error -= H[i] * x[c, i]
            e[c, s] = error
            for i in range(m):
                x[c, i] += K[i] * error
        # Joseph's form, (I - K H) P (I - K H)' + K r K', multiplied out; errors in K then count by their squares alone.
        for i in range(m):
            for j in range(i, m):
                P[i, j] -= K[i] * g[j] + K[j] * (g[i] - variance * K[i])
                P[j, i] = P[i, j]
    return True
