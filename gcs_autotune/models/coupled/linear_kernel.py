"""One degree of freedom with an equation linear in its velocity, solved with exact transitions.

The equation is ``nu_dot = a nu + f``, with ``a`` and ``f`` constant between the jumps of the inputs. Most simulations
of a search have this form, because modified, delayed or scaled commands do not change it. Motion and sensitivities are
then exponentials. They are ten times as fast as the Runge-Kutta steps of :mod:`.kernel`, and no step is too long for a
fast craft.

Over a time *h*, with ``z = a h``, the exponential is ``E = exp(z)``. ``A1`` is the integral of ``E``, ``A2`` that of
``A1``, ``C1`` that of ``s exp(a s)``, and ``D1`` that of ``C1``. A sensitivity obeys ``s_dot = a s + b0 + b1 nu``, so
that ``s(h) = E s + A1 b0 + b1 (h E nu + C1 f)``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.jit import entry_without_lock, pasted
from gcs_autotune.models.coupled.kernel import INPUT, INPUT_SIZE, RUNAWAY, Program

__all__ = ["LinearProgram", "linear_program_of", "linear_sweep"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

NEAR = 0.5
"""Size of ``z`` (rate times time) below which the series are summed.

Project choice. Below it the closed forms lose a digit for every factor of ten.
"""

ORDER = 14
"""Number of terms of the series. The first omitted term is ``NEAR**14 / 14!``, which is below rounding."""


class LinearProgram(NamedTuple):
    """The terms of a :class:`.kernel.Program` that act on its only velocity, with the corresponding elements of the
    inertia.

    - ``moving`` (T,): 1 if a term is proportional to the velocity.
    - ``factors`` (T, 3): codes of inputs, -1 for none.
    - ``inertia`` (E,): indices of the parameters of the inertia.
    - ``inertia_coefs`` (E,): coefficients of these parameters.
    - ``delay``: index of the parameter for the delay, -1 if absent.
    """

    pars: Index
    scales: Index
    coefs: Array
    moving: Index
    factors: Index
    inertia: Index
    inertia_coefs: Array
    delay: int


def linear_program_of(P: Program) -> LinearProgram | None:
    """Return the linear form of *P*, or None if *P* has more than one velocity or is not linear in that velocity
    alone.
    """
    others = (P.lag, P.current_x, P.current_y, P.drift_x, P.drift_y, P.reach, P.bottom, P.payload.max(), P.depth)
    if len(P.active) != 1 or max(others) >= 0 or P.coriolis or P.spatial:
        return None
    own = int(P.active[0])
    here = P.rows == own
    factors, moving = P.factors[here].copy(), np.zeros(int(here.sum()), dtype=np.int64)
    for term, row in enumerate(factors):
        for place, code in enumerate(row.tolist()):
            if code == own and not moving[term]:
                moving[term], row[place] = 1, -1
            elif 0 <= code < INPUT:
                return None
    entries = (P.inertia[:, 0] == own) & (P.inertia[:, 1] == own)
    return LinearProgram(
        P.pars[here], P.scales[here], P.coefs[here], moving, factors, P.inertia[entries, 2].copy(),
        P.inertia_coefs[entries], P.delay,
    )  # fmt: skip


def _equation(
    P: LinearProgram, theta: Array, inverse: float, values: Array, free: Index, b: Array
) -> tuple[float, float]:
    """Return ``a`` and ``f`` for the inputs *values* (m,), and fill their derivatives *b* (2, q).

    *b* is empty if no sensitivity is requested.
    """
    a, f = 0.0, 0.0
    wanted = b.shape[1] > 0
    b[:, :] = 0.0
    for k in range(len(P.pars)):
        par, scale, moving = P.pars[k], P.scales[k], P.moving[k]
        product = inverse * P.coefs[k]
        for place in range(3):
            code = P.factors[k, place]
            if code >= INPUT_SIZE:
                product *= abs(values[code - INPUT_SIZE])
            elif code >= INPUT:
                product *= values[code - INPUT]
        first = theta[par] if par >= 0 else 1.0
        second = theta[scale] if scale >= 0 else 1.0
        a += first * second * product * moving
        f += first * second * product * (1 - moving)
        if wanted and par >= 0 and free[par] >= 0:
            b[moving, free[par]] += second * product
        if wanted and scale >= 0 and free[scale] >= 0:
            b[moving, free[scale]] += first * product
    for k in range(len(P.inertia)):
        par = P.inertia[k]
        if wanted and par >= 0 and free[par] >= 0:  # more inertia takes its share of the rate, a nu + f
            weight = inverse * P.inertia_coefs[k]
            b[0, free[par]] -= weight * f
            b[1, free[par]] -= weight * a
    return a, f


def _sweep(
    P: LinearProgram, theta: Array, inverse: float, x: Array, S: Array, row: int, t_in: Array, inputs: Array,
    t_out: Array, free: Index, X: Array, S_out: Array, b: Array,
) -> bool:  # fmt: skip
    """Fill *X* (s, 2) and *S_out* (s, 2, q) from *x* (position, velocity) at ``t_out[0]`` on.

    inverse : one over the inertia.
    row : index of the present inputs.
    b (2, q) : work array.

    Return False if the motion diverged.
    """
    q = S.shape[1]
    delay = theta[P.delay] if P.delay >= 0 else 0.0
    column = free[P.delay] if P.delay >= 0 and q > 0 else -1
    t = t_out[0]
    a, f = _equation(P, theta, inverse, inputs[row], free, b)
    h_made, a_made = -1.0, 0.0
    E, A1, A2, C1, D1 = 1.0, 0.0, 0.0, 0.0, 0.0
    for s in range(len(t_out)):
        while t < t_out[s]:
            jump = row + 1 < len(t_in) and t_in[row + 1] + delay <= t_out[s]
            until = t_in[row + 1] + delay if jump else t_out[s]
            if until > t:
                h = until - t
                if h != h_made or a != a_made:
                    h_made, a_made, z = h, a, a * h
                    if abs(z) < NEAR:
                        E, A1, A2, C1, D1, term = 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
                        for n in range(ORDER):
                            E += term
                            A1 += term * h / (n + 1.0)
                            A2 += term * h * h / ((n + 1.0) * (n + 2.0))
                            C1 += term * h * h / (n + 2.0)
                            D1 += term * h * h * h / ((n + 2.0) * (n + 3.0))
                            term *= z / (n + 1.0)
                    else:
                        E = np.exp(z)
                        A1 = (E - 1.0) / a
                        A2, C1 = (A1 - h) / a, (h * E - A1) / a
                        D1 = (C1 - A2) / a
                nu = x[1]
                for o in range(q):
                    before = S[1, o]
                    S[0, o] += A1 * before + A2 * b[0, o] + b[1, o] * (C1 * nu + D1 * f)
                    S[1, o] = E * before + A1 * b[0, o] + b[1, o] * (h * E * nu + C1 * f)
                x[0] += A1 * nu + A2 * f
                x[1] = E * nu + A1 * f
                if not (abs(x[0]) < RUNAWAY and abs(x[1]) < RUNAWAY):
                    return False
                t = until
            if jump:
                rate = a * x[1] + f
                row += 1
                a, f = _equation(P, theta, inverse, inputs[row], free, b)
                if column >= 0:  # with a longer delay the rate before lasts longer, in the place of the one after
                    S[1, column] += rate - (a * x[1] + f)
        X[s, 0], X[s, 1] = x[0], x[1]
        for o in range(q):
            S_out[s, 0, o], S_out[s, 1, o] = S[0, o], S[1, o]
    return True


# Compiled in place, as those of models/simulation.py: the one is pasted into the other, which is compiled once.
_equation = pasted(_equation)
_compiled: Callable[..., bool] = entry_without_lock(_sweep)


def linear_sweep(
    P: LinearProgram, theta: Array, inverse: float, x_0: Array, t_in: Array, inputs: Array, t_out: Array, free: Index,
    state_column: Index, X: Array, S_out: Array,
) -> bool:  # fmt: skip
    """Simulate like :func:`.kernel.sweep` with the linear equation *P*, and return whether the motion stayed finite.

    inverse : inverse of the inertia.
    """
    q = S_out.shape[2]
    S = np.zeros((2, q))
    for i, column in enumerate(state_column):
        if 0 <= column < q:
            S[i, column] = 1.0
    delay = theta[P.delay] if P.delay >= 0 else 0.0
    row = max(int(np.searchsorted(t_in + delay, t_out[0], side="right")) - 1, 0)
    b = np.zeros((2, q))
    return bool(_compiled(P, theta, inverse, x_0.copy(), S, row, t_in, inputs, t_out, free, X, S_out, b))
