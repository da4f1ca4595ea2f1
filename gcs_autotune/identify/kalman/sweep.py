"""Compiled functions for one record: the filter forwards in time, and its adjoint backwards.

Forwards: state and free parameters form one augmented vector (ZhaoUSV, (8)-(12)). The time update (14)-(15) covers the
actual interval between stamps. The measurement update (16)-(18) takes one sample after the other, in Joseph's form. Any
subset of the signals may therefore be present at a stamp.

Backwards: the adjoint recursion of Bryson and Frazier smooths without inverting a covariance. It provides the exact
derivatives of the likelihood by every noise level.

Numba's cache identifies a function by its file and line, and named tuples by their class's name. After a class is
renamed, a cache entry at the same line cannot be read. If you rename :class:`FilterHistory`, move the functions or
clear every ``__pycache__`` here.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gcs_autotune.identify.kalman.transition import inertia, measure, sigma_step, step
from gcs_autotune.identify.kalman.waves import renew_waves, rough, turn_waves, wave_transition
from gcs_autotune.models import Program, Scratch

__all__ = ["FilterHistory", "backward", "forward", "new_history"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class FilterHistory(NamedTuple):
    """Results of a forward pass, for s stamps, m signals, n states, N = n + free parameters.

    - ``mean`` (s, N), ``covariance`` (s, N, N): estimate after the samples of each stamp.
    - ``F`` (s, n, N), ``late`` (s, n, n): the transition into each stamp, and that of the second half of the interval.
    - ``e``, ``S`` (s, m): innovations and their variances (NaN without a sample).
    - ``K``, ``H`` (s, m, N): gains and output derivatives, those of :func:`measure`. With waves (:mod:`.waves`) their
      two states come last, and N is larger by two.
    """

    mean: Array
    covariance: Array
    F: Array
    late: Array
    e: Array
    S: Array
    K: Array
    H: Array


def new_history(s: int, m: int, n: int, N: int, *, full: bool) -> FilterHistory:
    """Return empty buffers for a pass. Without *full* only the innovations are stored."""
    k = s if full else 0
    return FilterHistory(
        np.zeros((k, N)),
        np.zeros((k, N, N)),
        np.zeros((k, n, N)),
        np.zeros((k, n, n)),
        np.full((s, m), np.nan),
        np.full((s, m), np.nan),
        np.zeros((k, m, N)),
        np.zeros((k, m, N)),
    )


@njit(cache=True)
def _time_update(cov: Array, F: Array, late: Array, q: Array, walk: Array, decay: Array, h: float) -> None:
    """Propagate *cov* (N, N) over *h* seconds, by ZhaoUSV (15), with the noise by Simpson's rule.

    A parameter with a decay rate is an Ornstein-Uhlenbeck process. It decreases by the factor ``exp(-decay h)``.
    """
    n, N = F.shape
    end = n + len(decay)  # of the parameters; waves come after them
    T = np.dot(F, cov)
    top = np.dot(T, np.ascontiguousarray(F.T))
    for i in range(n):
        for j in range(n, N):
            cov[i, j] = T[i, j] * (np.exp(-decay[j - n] * h) if j < end else 1.0)
            cov[j, i] = cov[i, j]
    for i in range(n):
        for j in range(i, n):
            value = 0.5 * (top[i, j] + top[j, i])
            for o in range(n):
                if q[o] > 0.0:
                    early = F[i, o] * F[j, o] + 4.0 * late[i, o] * late[j, o]
                    value += q[o] * h / 6.0 * (early + (1.0 if i == o and j == o else 0.0))
            cov[i, j] = value
            cov[j, i] = value
    for i in range(n, end):
        if decay[i - n] > 0.0:
            kept = np.exp(-decay[i - n] * h)
            for j in range(n, N):
                cov[i, j] *= kept
                cov[j, i] *= kept
            cov[i, i] += walk[i - n] * (1.0 - kept * kept) / (2.0 * decay[i - n])
        else:
            cov[i, i] += walk[i - n] * h


@njit(cache=True)
def _measurement_update(cov: Array, K: Array, H: Array, r: float) -> None:
    """Update *cov* for one sample in Joseph's form, with N^2 operations.

    The form is (I - K H) P (I - K H)' + K r K'.
    """
    N = len(K)
    HP = np.zeros(N)
    for j in range(N):
        for i in range(N):
            if H[i] != 0.0:
                HP[j] += H[i] * cov[i, j]
    for i in range(N):
        for j in range(N):
            cov[i, j] -= K[i] * HP[j]
    PH = np.zeros(N)
    for i in range(N):
        for j in range(N):
            if H[j] != 0.0:
                PH[i] += cov[i, j] * H[j]
    for i in range(N):
        for j in range(N):
            cov[i, j] += (r * K[i] - PH[i]) * K[j]
    for i in range(N):
        for j in range(i):
            value = 0.5 * (cov[i, j] + cov[j, i])
            cov[i, j] = value
            cov[j, i] = value


@njit(cache=True)
def _keep(matrix: Array, place: Array) -> None:
    """Copy *matrix* to *place*.

    Assignment to a slice would take seconds to compile, because it includes an error message.
    """
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[1]):
            place[i, j] = matrix[i, j]


@njit(cache=True, nogil=True)
def forward(
    P: Program,
    theta: Array,
    places: Index,
    free: Index,
    mean: Array,
    cov: Array,
    t_in: Array,
    inputs: Array,
    stamps: Array,
    Y: Array,
    codes: Index,
    r: Array,
    q: Array,
    walk: Array,
    decay: Array,
    waves: Array,
    reference: Array,
    sigma: bool,
    max_rate: float,
    history: FilterHistory,
    W: Scratch,
) -> float:
    """Filter one record, and replace the prior *mean* (N,) and *cov* (N, N) by the values at the end.

    The prior applies at ``stamps[0]``.

    theta : all parameters.
    places : (p,) indices of the free ones in *theta*.
    free : (all,) column of each parameter in the augmented vector, -1 for known ones.
    Y : (s, m) samples, NaN if missing.
    codes : (m,) kinds of the signals (see :func:`measure`).
    r : (m,) noise variances of the signals.
    q : (n,) intensity of the white noise that drives each state [unit^2/s].
    walk : (p,) intensity of the white noise that drives each free parameter [unit^2/s].
    decay : (p,) [1/s] rate at which each free parameter returns to zero, 0 for constants.
    waves : (4,) parameters of the waves, see :mod:`.waves`. Zero size means no waves. Their states are not part of
        *mean* and *cov*. They appear in the first signal, and their force is added to the first free parameter.
    reference : (s, n) trajectory to linearise about with the parameters in *theta*, or (0, n) to linearise at the
        estimate.
    sigma : whether to propagate mean and covariance by sigma points.
    max_rate : lowest rate [1/s] that the step size is chosen for. If parameters change, the filter uses finer steps
        where necessary.

    Return the fastest rate [1/s], or -1 - (index of the stamp at which the motion diverged).
    """
    n, N, p = len(q), len(mean), len(places)
    theta = theta.copy()
    given = theta.copy()
    fixed, wavy = len(reference) > 0, rough(waves)
    M, M_inverse = np.zeros((6, 6)), np.zeros((len(P.active), len(P.active)))
    if not fixed:
        for i in range(p):
            theta[places[i]] = mean[n + i]
    positive = inertia(P, theta, M, M_inverse)
    massive = False
    for i in range(p):
        for e in range(len(P.inertia_coefs)):
            massive = massive or P.inertia[e, 2] == places[i]
    full = len(history.mean) > 0
    of_waves = np.zeros((2, 2))
    F, late, H, K, g = np.zeros((n, N)), np.zeros((n, n)), np.zeros(N), np.zeros(N), np.zeros(N)
    x, before, moved = np.zeros(n), np.zeros(n), mean.copy()
    delay = theta[P.delay] if P.delay >= 0 else 0.0
    row, now, fastest = 0, max_rate, 0.0
    while row + 1 < len(t_in) and t_in[row + 1] + delay <= stamps[0]:
        row += 1
    for s in range(len(stamps)):
        if s > 0:
            h = stamps[s] - stamps[s - 1]
            for i in range(n):
                x[i] = reference[s - 1, i] if fixed else mean[i]
                before[i] = x[i]
            first = row
            finite, rate = False, 0.0
            if wavy:
                theta[places[0]] += waves[1] * mean[N - 1]
            for _ in range(8):
                finite, rate, row = step(
                    P, theta, M, M_inverse, x, F, late, stamps[s - 1], stamps[s], first, t_in, inputs, free, now, W
                )
                if finite and rate <= 2.0 * now:
                    break
                now = 1.2 * rate if finite else 4.0 * now
                for i in range(n):
                    x[i] = before[i]
            if not finite:
                return -1.0 - s
            now = max(max_rate, 1.5 * rate if rate > now else 0.7 * now)
            fastest = max(fastest, rate)
            if wavy:
                theta[places[0]] -= waves[1] * mean[N - 1]
                for i in range(n):
                    F[i, N - 1] = waves[1] * F[i, n]
            if fixed:
                for i in range(n):
                    for j in range(n):
                        x[i] += F[i, j] * (mean[j] - reference[s - 1, j])
                    for j in range(p):
                        x[i] += F[i, n + j] * (mean[n + j] - given[places[j]])
            if not sigma or not sigma_step(
                P, theta, places, mean, cov, x, F, late, q, walk, stamps[s - 1], stamps[s], first, t_in, inputs,
                now, W,
            ):  # fmt: skip
                _time_update(cov, F, late, q, walk, decay, h)
            if wavy:
                wave_transition(waves, h, of_waves)
                turn_waves(mean, cov, of_waves)
                renew_waves(cov, of_waves)
            for i in range(n):
                mean[i] = x[i]
            for i in range(p):
                if decay[i] > 0.0:
                    mean[n + i] *= np.exp(-decay[i] * h)
                    if not fixed:
                        theta[places[i]] = mean[n + i]
            if full:
                _keep(F, history.F[s])
                _keep(late, history.late[s])
        for i in range(len(codes)):
            if np.isnan(Y[s, i]):
                continue
            value = measure(P, theta, reference[s] if fixed else mean[:n], codes[i], free, H)
            if wavy and i == 0:
                value += waves[0] * mean[N - 1]
                H[N - 1] = waves[0]
            error = Y[s, i] - value
            if fixed:
                for j in range(n):
                    error -= H[j] * (mean[j] - reference[s, j])
                for j in range(p):
                    error -= H[n + j] * (mean[n + j] - given[places[j]])
            g[:] = 0.0
            for j in range(N):
                if H[j] != 0.0:
                    for o in range(N):
                        g[o] += cov[o, j] * H[j]
            variance = r[i]
            for j in range(N):
                variance += H[j] * g[j]
            for j in range(N):
                K[j] = g[j] / variance
                moved[j] = mean[j] + K[j] * error
            _measurement_update(cov, K, H, r[i])
            if p > 0 and not fixed:
                if massive:
                    positive = _move_parameters(P, theta, places, mean, moved, n, M, M_inverse, positive)
                else:
                    for j in range(p):
                        theta[places[j]] = moved[n + j]
            for j in range(N):
                mean[j] = moved[j]
                if not abs(mean[j]) < 1e9:
                    return -1.0 - s
            history.e[s, i] = error
            history.S[s, i] = variance
            if full:
                for j in range(N):
                    history.K[s, i, j] = K[j]
                    history.H[s, i, j] = H[j]
        if full:
            _keep(cov, history.covariance[s])
            for j in range(N):
                history.mean[s, j] = mean[j]
    return fastest


@njit(cache=True)
def _move_parameters(
    P: Program,
    theta: Array,
    places: Index,
    mean: Array,
    moved: Array,
    n: int,
    M: Array,
    M_inverse: Array,
    positive: bool,
) -> bool:
    """Set the parameters to those of *moved*.

    The move is shortened if the inertia would not remain positive definite.
    """
    for _ in range(30):
        for i in range(len(places)):
            theta[places[i]] = moved[n + i]
        good = inertia(P, theta, M, M_inverse)
        if good or not positive:
            return good
        for i in range(len(places)):
            moved[n + i] = 0.5 * (moved[n + i] + mean[n + i])
    for i in range(len(places)):
        moved[n + i] = mean[n + i]
        theta[places[i]] = mean[n + i]
    return inertia(P, theta, M, M_inverse)


@njit(cache=True, nogil=True)
def backward(
    stamps: Array,
    r: Array,
    decay: Array,
    waves: Array,
    history: FilterHistory,
    adjoint: Array,
    information: Array,
    smoothed: Array,
    variances: Array,
    by_noise: Array,
    by_drive: Array,
) -> None:
    """Run the adjoint backwards over a full *history*, and fill the smoothed states and the scores in place.

    adjoint (N,), information (N, N) : on entry those at the start of the next record (states zero), on return those at
        the start of this record.
    smoothed, variances : (s, N) filled with the smoothed means and their variances.
    by_noise : (2, m) to which the score of the noise variances is added.
    by_drive : (2, n) to which the score of the drive intensities is added.

    Row 0 minus row 1 of a score is twice the derivative of the log-likelihood by a variance.
    """
    m, N = history.K.shape[1], history.K.shape[2]
    n = history.F.shape[1]
    carried, of_waves = np.zeros((N, N)), np.zeros((2, 2))
    for s in range(len(stamps) - 1, -1, -1):
        cov = history.covariance[s]
        down = np.dot(cov, adjoint)
        second = np.dot(cov, information)
        for i in range(N):
            smoothed[s, i] = history.mean[s, i] - down[i]
            value = cov[i, i]
            for j in range(N):
                value -= second[i, j] * cov[j, i]
            variances[s, i] = max(value, 0.0)
        for i in range(m - 1, -1, -1):
            S = history.S[s, i]
            if np.isnan(S):
                continue
            K, H, e = history.K[s, i], history.H[s, i], history.e[s, i]
            LK = np.dot(information, K)
            push, weight = np.dot(K, adjoint), np.dot(K, LK)
            u = e / S + push
            by_noise[0, i] += u * u
            by_noise[1, i] += 1.0 / S + weight
            for j in range(N):
                adjoint[j] -= H[j] * u
            for j in range(N):
                for o in range(N):
                    information[j, o] += H[j] * H[o] * (1.0 / S + weight) - H[j] * LK[o] - LK[j] * H[o]
        if s == 0:
            return
        F, late, h = history.F[s], history.late[s], (stamps[s] - stamps[s - 1]) / 6.0
        if rough(waves):
            wave_transition(waves, 6.0 * h, of_waves)
            turn_waves(adjoint, information, np.ascontiguousarray(of_waves.T))
        F_adjoint = np.dot(np.ascontiguousarray(F.T), adjoint[:n])
        F_information = np.dot(np.ascontiguousarray(F.T), information[:n])
        whole = np.dot(np.ascontiguousarray(F_information[:, :n]), F)
        block = np.ascontiguousarray(information[:n, :n])
        late_adjoint = np.dot(np.ascontiguousarray(late.T), adjoint[:n])
        late_block = np.dot(np.ascontiguousarray(late.T), np.dot(block, late))
        for i in range(n):
            by_drive[0, i] += h * (F_adjoint[i] ** 2 + 4.0 * late_adjoint[i] ** 2 + adjoint[i] ** 2)
            by_drive[1, i] += h * (whole[i, i] + 4.0 * late_block[i, i] + information[i, i])
        kept = np.ones(N - n)
        kept[: len(decay)] = np.exp(-decay * 6.0 * h)
        for i in range(n, N):
            F_adjoint[i] += kept[i - n] * adjoint[i]
        for i in range(N):
            for j in range(N):
                value = whole[i, j]
                if j >= n:
                    value += F_information[i, j] * kept[j - n]
                if i >= n:
                    value += F_information[j, i] * kept[i - n]
                if i >= n and j >= n:
                    value += information[i, j] * kept[i - n] * kept[j - n]
                carried[i, j] = value
        for i in range(N):
            adjoint[i] = F_adjoint[i]
            for j in range(N):
                information[i, j] = 0.5 * (carried[i, j] + carried[j, i])
