"""Compiled passes of the navigation filter: forwards as an error-state Kalman filter, and its adjoint backwards.

Forwards: the inertial sensors move the nominal state, and a Kalman filter estimates its error (Sola2017, sections 5.3
to 6.2; Groves2013, chapter 14). The attitude error is a rotation vector in NED axes, ``q = exp(error) q_nominal``.
Measurements come one number after the other. Each corrects the nominal state at once.

Backwards: the adjoint recursion of Bryson and Frazier. It gives the same smoothed states as Rauch, Tung and Striebel's,
without the inverse of a covariance. That inverse does not exist here: lever arms and delays are constants.

The velocity is a state in body axes, and the attitude error is in NED axes. So a DVL measures a state, and a turn about
the vertical has the same coordinates at any time. Linearisation then cannot turn samples of a DVL into information
about the heading, which they do not contain.

States (:data:`X_SIZE`): quaternion 0-3 (body to NED), velocity 4-6 (body axes) and position 7-9 (NED) of the inertial
sensor, then the constants. Errors (:data:`SIZE`): attitude 0-2, velocity 3-5, position 6-8, then the constants in the
same order: bias of the gyro, bias of the accelerometer, lever arms of GPS, DVL and depth sensor, offset of the heading,
delays of GPS, compass, DVL and depth sensor, turn of the compass in its mount. SI units and radians.
"""

from __future__ import annotations

from math import atan2, cos, pi, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.jit import called, entry

__all__ = [
    "ACCELEROMETER", "ARMS", "BODY_VELOCITY", "COLUMNS", "COMPASS", "DELAYS", "DEPTH", "GYRO", "HEADING", "MOUNT",
    "MOVING", "NODE", "OFFSET", "POSITION", "SIZE", "STEP", "VELOCITY", "X_SIZE", "backward", "forward",
]  # fmt: skip

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SIZE, X_SIZE = 32, 33
"""Numbers of error states and of nominal states."""
MOVING = 9
"""Number of error states that are not constants. They come first."""
GYRO, ACCELEROMETER, ARMS, OFFSET, DELAYS, MOUNT = 9, 12, 15, 24, 25, 29
"""Places of the constants among the errors. In the nominal state they are one place later."""
POSITION, VELOCITY, BODY_VELOCITY, COMPASS, HEADING, DEPTH = 0, 1, 2, 3, 4, 5
"""Kinds of measurements: position and velocity (NED), velocity (body axes), magnetic field (body axes), heading,
depth."""
COLUMNS = 9
"""Columns of a measurement: kind, component, three values, time after its step [s], variance, place of the lever arm
and place of the delay among the errors (-1: none)."""
STEP = 49
"""Numbers kept per step: the turn back of the errors (9), effect of the attitude error on the velocity (9), effects of
the errors of velocity and attitude on the position (9, 9), velocity after the step (3), duration, effect of the
gyro's bias on the attitude (9)."""
NODE = 6
"""Numbers kept per measurement before its gain and its derivatives: innovation, its variance, whether it was used,
smoothed squared error of the measurement, whether the backward pass has reached it, variance used."""

GATE = 25.0
"""Squared innovation, in its variances, above which a measurement is skipped as an outlier. Project choice: five
standard deviations."""
PATIENCE = 20.0
"""Number of measurements of one kind skipped in a row, after which the next is used. Project choice."""


@called
def _copy(source: Array, out: Array) -> None:
    for i in range(len(source)):
        out[i] = source[i]


@called
def _rotation(q: Array, R: Array) -> None:
    """Write the rotation matrix (3, 3), body to NED, of the quaternion *q*."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    R[0, 0], R[0, 1], R[0, 2] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
    R[1, 0], R[1, 1], R[1, 2] = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
    R[2, 0], R[2, 1], R[2, 2] = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)


@called
def _turn_ned(q: Array, a: float, b: float, c: float) -> None:
    """Turn the quaternion *q* by a rotation vector [rad] in NED axes."""
    q[1], q[2], q[3] = -q[1], -q[2], -q[3]
    _turn(q, -a, -b, -c)
    q[1], q[2], q[3] = -q[1], -q[2], -q[3]


@called
def _turn(q: Array, a: float, b: float, c: float) -> None:
    """Turn the quaternion *q* by a rotation vector [rad] in body axes."""
    angle = sqrt(a * a + b * b + c * c)
    half = 0.5 * angle
    scale = sin(half) / angle if angle > 1e-9 else 0.5
    e, x, y, z = cos(half), a * scale, b * scale, c * scale
    w0, x0, y0, z0 = q[0], q[1], q[2], q[3]
    q[0] = w0 * e - x0 * x - y0 * y - z0 * z
    q[1] = w0 * x + x0 * e + y0 * z - z0 * y
    q[2] = w0 * y - x0 * z + y0 * e + z0 * x
    q[3] = w0 * z + x0 * y - y0 * x + z0 * e
    norm = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for i in range(4):
        q[i] /= norm


@called
def _cross(a: Array, b: Array, out: Array) -> None:
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@called
def _turned_vector(by: Array, a: Array, out: Array, work: Array) -> None:
    """Write *a*, turned by the small rotation vector *by* to second order, into *out*."""
    _cross(by, a, work)
    _cross(by, work, out)
    for i in range(3):
        out[i] = a[i] + work[i] + 0.5 * out[i]


@called
def _across(row: Array, b: Array, H: Array, sign: float) -> None:
    """Add ``sign row [b]x`` (3,) to *H*."""
    H[0] += sign * (row[1] * b[2] - row[2] * b[1])
    H[1] += sign * (row[2] * b[0] - row[0] * b[2])
    H[2] += sign * (row[0] * b[1] - row[1] * b[0])


@called
def _move(x: Array, before: Array, after: Array, gravity: float, step: Array, W: Array, R: Array) -> None:
    """Move the nominal state *x* from one sample of the inertial sensor (7,) to the next, and write the transition."""
    dt = after[0] - before[0]
    w, a, u, q = W[9], W[10], W[4, :3], W[11, :4]
    for i in range(3):
        w[i] = 0.5 * (before[1 + i] + after[1 + i]) - x[10 + i]
        a[i] = 0.5 * (before[4 + i] + after[4 + i]) - x[13 + i]
        u[i] = x[4 + i]
    _rotation(x[:4], R)
    # The errors of attitude and velocity turn back by the step; second order suffices for the angles of one step.
    turned = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    for i in range(3):
        for j in range(3):
            step[3 * i + j] = 0.5 * dt * dt * w[i] * w[j]
            step[18 + 3 * i + j] = dt * R[i, j]
        step[3 * i + i] += 1.0 - 0.5 * dt * dt * turned
    step[1] += dt * w[2]
    step[2] -= dt * w[1]
    step[3] -= dt * w[2]
    step[5] += dt * w[0]
    step[6] += dt * w[1]
    step[7] -= dt * w[0]
    v, f = W[5, :3], W[6, :3]
    for i in range(3):
        v[i] = R[i, 0] * u[0] + R[i, 1] * u[1] + R[i, 2] * u[2]
    for i in range(27, 36):
        step[i] = 0.0
    step[28], step[29], step[30] = dt * v[2], -dt * v[1], -dt * v[2]
    step[32], step[33], step[34] = dt * v[0], dt * v[1], -dt * v[0]
    _copy(x[:4], q)
    _turn(q, 0.5 * dt * w[0], 0.5 * dt * w[1], 0.5 * dt * w[2])
    _rotation(q, R)
    for i in range(3):
        for j in range(3):
            step[40 + 3 * i + j] = dt * R[i, j]
        f[i] = R[i, 0] * a[0] + R[i, 1] * a[1] + R[i, 2] * a[2]
        if i == 2:
            f[i] += gravity
        x[7 + i] += dt * v[i] + 0.5 * dt * dt * f[i]
        v[i] += dt * f[i]
    _turn(x[:4], dt * w[0], dt * w[1], dt * w[2])
    _rotation(x[:4], R)
    for i in range(3):
        x[4 + i] = R[0, i] * v[0] + R[1, i] * v[1] + R[2, i] * v[2]
        step[36 + i] = x[4 + i]
        step[9 + 3 * i], step[10 + 3 * i], step[11 + 3 * i] = dt * gravity * R[1, i], -dt * gravity * R[0, i], 0.0
    step[39] = dt


@called
def _through(step: Array, column: Array, out: Array) -> None:
    """Write the first nine rows of ``F column``; the constants keep their errors."""
    dt, u = step[39], step[36:39]
    for i in range(3):
        angle, speed, place = column[i], 0.0, column[6 + i]
        for j in range(3):
            angle -= step[40 + 3 * i + j] * column[GYRO + j]
            speed += (
                step[3 * i + j] * (column[3 + j] - dt * column[ACCELEROMETER + j]) + step[9 + 3 * i + j] * column[j]
            )
            place += step[18 + 3 * i + j] * column[3 + j] + step[27 + 3 * i + j] * column[j]
        out[i], out[3 + i], out[6 + i] = angle, speed, place
    out[3] -= dt * (u[1] * column[GYRO + 2] - u[2] * column[GYRO + 1])
    out[4] -= dt * (u[2] * column[GYRO] - u[0] * column[GYRO + 2])
    out[5] -= dt * (u[0] * column[GYRO + 1] - u[1] * column[GYRO])


@called
def _back(step: Array, row: Array, out: Array) -> None:
    """Write ``F^T row`` into *out*."""
    dt, u = step[39], step[36:39]
    for i in range(SIZE):
        out[i] = row[i]
    for j in range(3):
        angle, speed = row[j], 0.0
        for i in range(3):
            angle += step[9 + 3 * i + j] * row[3 + i] + step[27 + 3 * i + j] * row[6 + i]
            out[GYRO + j] -= step[40 + 3 * i + j] * row[i]
            speed += step[3 * i + j] * row[3 + i]
        out[j] = angle
        out[ACCELEROMETER + j] -= dt * speed
        out[3 + j] = speed + step[18 + j] * row[6] + step[21 + j] * row[7] + step[24 + j] * row[8]
    out[GYRO] += dt * (u[1] * row[5] - u[2] * row[4])
    out[GYRO + 1] += dt * (u[2] * row[3] - u[0] * row[5])
    out[GYRO + 2] += dt * (u[0] * row[4] - u[1] * row[3])


@called
def _spread(P: Array, step: Array, noise: Array, W: Array) -> None:
    """Advance the covariance (n, n) by one step. noise (5,): standard deviations of gyro and accelerometer samples, and
    the drifts of the two biases and of the compass offset in 1 s."""
    for i in range(SIZE):
        _through(step, P[i], W[12])
        for j in range(9):
            P[i, j] = W[12, j]
    for j in range(SIZE):
        for i in range(SIZE):
            W[11, i] = P[i, j]
        _through(step, W[11], W[12])
        for i in range(9):
            P[i, j] = W[12, i]
    dt, x, y, z = step[39], step[36], step[37], step[38]
    by_gyro, size = (noise[0] * dt) ** 2, x * x + y * y + z * z
    for i in range(3):
        P[i, i] += by_gyro
        P[3 + i, 3 + i] += (noise[1] * dt) ** 2 + by_gyro * size
        for j in range(3):
            P[3 + i, 3 + j] -= by_gyro * step[36 + i] * step[36 + j]
        P[GYRO + i, GYRO + i] += noise[2] ** 2 * dt
        P[ACCELEROMETER + i, ACCELEROMETER + i] += noise[3] ** 2 * dt
    P[OFFSET, OFFSET] += noise[4] ** 2 * dt
    # The gyro's noise turns the axes in which the velocity is expressed.
    for j in range(3):
        a, b, c = by_gyro * step[40 + 3 * j] / dt, by_gyro * step[41 + 3 * j] / dt, by_gyro * step[42 + 3 * j] / dt
        P[3, j] += y * c - z * b
        P[4, j] += z * a - x * c
        P[5, j] += x * b - y * a
    for i in range(3, 6):
        for j in range(3):
            P[j, i] = P[i, j]


@called
def _wrapped(angle: float) -> float:
    turned: float = (angle + pi) % (2.0 * pi) - pi
    return turned


@called
def _compare(
    x: Array, sample: Array, row: Array, gravity: float, declination: float, H: Array, W: Array, R: Array
) -> float:
    """Return measured minus predicted value of the measurement *row*, and write its derivatives *H* (n,).

    sample (7,) : sample of the inertial sensor at the measurement's step. W : work space.
    """
    kind, i = int(row[0]), int(row[1])
    arm, delay = int(row[7]), int(row[8])
    H[:] = 0.0
    w, lever, turning, there, v, u = W[3, :3], W[4, :3], W[5, :3], W[6, :3], W[8, :3], W[9, :3]
    _rotation(x[:4], R)
    for j in range(3):
        w[j] = sample[1 + j] - x[10 + j]
        lever[j] = x[arm + 1 + j] if arm >= 0 else 0.0
        there[j] = sample[4 + j] - x[13 + j]
        v[j] = R[j, 0] * x[4] + R[j, 1] * x[5] + R[j, 2] * x[6]
    _cross(w, lever, turning)
    rate, predicted, e = 0.0, 0.0, W[7, :3]
    e[:] = 0.0
    if kind in (POSITION, DEPTH):
        if kind == DEPTH:
            i = 2
        predicted = x[7 + i]
        rate = v[i]
        for j in range(3):
            predicted += R[i, j] * lever[j]
            rate += R[i, j] * turning[j]
        H[6 + i] = 1.0
        e[i] = 1.0
        for j in range(3):
            u[j] = R[j, 0] * lever[0] + R[j, 1] * lever[1] + R[j, 2] * lever[2]
        _across(e, u, H[0:3], -1.0)
        if arm >= 0:
            _copy(R[i], H[arm : arm + 3])
    elif kind == VELOCITY:
        _cross(w, turning, e)
        predicted = v[i]
        if i == 2:
            rate = gravity
        for j in range(3):
            predicted += R[i, j] * turning[j]
            rate += R[i, j] * (there[j] + e[j])
        _copy(R[i], H[3:6])
        for j in range(3):
            u[j] = v[j] + R[j, 0] * turning[0] + R[j, 1] * turning[1] + R[j, 2] * turning[2]
            e[j] = 0.0
        e[i] = 1.0
        _across(e, u, H[0:3], -1.0)
        if arm >= 0:
            _across(R[i], lever, H[GYRO : GYRO + 3], 1.0)
            _across(R[i], w, H[arm : arm + 3], 1.0)
    elif kind == BODY_VELOCITY:
        e[i] = 1.0
        H[3 + i] = 1.0
        predicted = x[4 + i] + turning[i]
        if arm >= 0:
            _across(e, lever, H[GYRO : GYRO + 3], 1.0)
            _across(e, w, H[arm : arm + 3], 1.0)
        _cross(w, x[4:7], e)
        rate = there[i] + R[2, i] * gravity - e[i]
    elif kind == COMPASS:
        _turned_vector(x[MOUNT + 1 : MOUNT + 4], row[2:5], e, u)
        north = R[0, 0] * e[0] + R[0, 1] * e[1] + R[0, 2] * e[2]
        east = R[1, 0] * e[0] + R[1, 1] * e[1] + R[1, 2] * e[2]
        down = R[2, 0] * e[0] + R[2, 1] * e[1] + R[2, 2] * e[2]
        flat = north * north + east * east
        H[0], H[1], H[2] = -down * north / flat, -down * east / flat, 1.0
        for i in range(3):
            rate += H[i] * (R[i, 0] * w[0] + R[i, 1] * w[1] + R[i, 2] * w[2])
            H[MOUNT + i] = H[0] * R[0, i] + H[1] * R[1, i] + R[2, i]
        H[OFFSET] = 1.0
        H[delay] = -rate
        lead = row[5] - x[delay + 1]
        return _wrapped(declination - atan2(east, north) - x[OFFSET + 1] - rate * lead)
    else:
        flat = R[0, 0] * R[0, 0] + R[1, 0] * R[1, 0]
        H[0], H[1], H[2] = -R[2, 0] * R[0, 0] / flat, -R[2, 0] * R[1, 0] / flat, 1.0
        rate = (R[2, 1] * w[1] + R[2, 2] * w[2]) / flat
        H[OFFSET] = 1.0
        H[delay] = -rate
        lead = row[5] - x[delay + 1]
        return _wrapped(row[2] - atan2(R[1, 0], R[0, 0]) - x[OFFSET + 1] - rate * lead)
    lead = row[5]
    if delay >= 0:
        lead -= x[delay + 1]
        H[delay] = -rate
    error: float = row[2 + i if kind != DEPTH else 2] - predicted - rate * lead
    return error


@called
def _inject(x: Array, error: Array) -> None:
    """Correct the state *x* by an estimated error (SIZE,)."""
    _turn_ned(x[:4], error[0], error[1], error[2])
    for i in range(3, SIZE):
        x[1 + i] += error[i]


@called
def _correct(error: Array, P: Array, y: float, H: Array, variance: float, update: Array, W: Array) -> None:
    """Add the estimate by one number to *error*, update the covariance, and write innovation, variance and gain into
    *update*."""
    PH, K = W[12], update[NODE : NODE + SIZE]
    S = variance
    for i in range(SIZE):
        total = 0.0
        for j in range(SIZE):
            total += P[i, j] * H[j]
        PH[i] = total
        S += H[i] * total
    update[0], update[1], update[2] = y, S, 1.0
    for i in range(SIZE):
        K[i] = PH[i] / S
        update[NODE + SIZE + i] = H[i]
    for i in range(SIZE):
        for j in range(i + 1):
            P[i, j] -= K[i] * PH[j]
            P[j, i] = P[i, j]
    for i in range(SIZE):
        error[i] += K[i] * y


@entry
def forward(
    imu: Array, at: Index, rows: Array, numbers: Array, noise: Array, x: Array, P: Array, every: int, held: float,
    steps: Array, updates: Array, nodes: Array, spreads: Array, W: Array, R: Array,
) -> int:  # fmt: skip
    """Run the filter over all samples of the inertial sensor.

    imu (s, 7) : time, turn rates, specific forces. at (r,) : step of each measurement, ascending. rows (r, COLUMNS).
    numbers (2,) : gravity and declination. noise : as in :func:`_spread`. x (X_SIZE,), P (SIZE, SIZE) : first state,
    then the last. every : steps between kept states. held [s] : time at the start during which the estimated error is
    kept beside the state, which stays the trajectory for linearisation. steps (s, STEP), updates (r, NODE + 2 SIZE),
    nodes (k, X_SIZE), spreads (k, SIZE, SIZE) : results. W (15, SIZE), R (3, 3) : work space. Return the number of
    states kept.
    """
    kept, m = 0, 0
    skipped, error = W[13], W[14]
    skipped[:] = 0.0
    error[:] = 0.0
    for k in range(len(imu)):
        if k > 0:
            _move(x, imu[k - 1], imu[k], numbers[0], steps[k], W, R)
            _spread(P, steps[k], noise, W)
            _through(steps[k], error, W[12])
            for i in range(9):
                error[i] = W[12, i]
        is_held = imu[k, 0] - imu[0, 0] < held
        while m < len(at) and at[m] == k:
            H = updates[m, NODE + SIZE :]
            y = _compare(x, imu[k], rows[m], numbers[0], numbers[1], H, W, R)
            for i in range(SIZE):
                y -= H[i] * error[i]
            kind, variance = int(rows[m, 0]), rows[m, 6]
            if kind == COMPASS:
                # Tilt errors are noise of the compass. Else it would pass for an inclinometer where the field is steep.
                for i in range(2):
                    for j in range(2):
                        variance += H[i] * P[i, j] * H[j]
                H[0], H[1] = 0.0, 0.0
            S = variance
            for i in range(SIZE):
                for j in range(SIZE):
                    S += H[i] * P[i, j] * H[j]
            updates[m, 5] = variance
            updates[m, 0], updates[m, 1], updates[m, 2] = y, S, 0.0
            if y * y <= GATE * S or skipped[kind] >= PATIENCE:
                skipped[kind] = 0.0
                _correct(error, P, y, H, variance, updates[m], W)
                if not is_held:
                    _inject(x, error)
                    error[:] = 0.0
            else:
                skipped[kind] += 1.0
            m += 1
        if k % every == 0:
            _copy(x, nodes[kept])
            _inject(nodes[kept], error)
            for i in range(SIZE):
                _copy(P[i], spreads[kept, i])
            kept += 1
    return kept


@entry
def backward(
    at: Index, rows: Array, noise: Array, every: int, steps: Array, updates: Array, nodes: Array, spreads: Array,
    shifts: Array, levels: Array, lagged: Array, L: Array, W: Array,
) -> None:  # fmt: skip
    """Smooth the kept states backwards.

    shifts (k, SIZE) : errors of the kept states. spreads : covariances, changed to the smoothed ones. levels (4,) :
    sum of squared smoothed noise and number of steps, of gyro and of accelerometer. lagged (k, MOVING) : covariance of
    the smoothed error of each moving state with that in the kept state before, 0 for the first. L (2 SIZE + MOVING,
    SIZE) : work space.
    Column 3 of *updates* becomes the expected squared error of each measurement. For the recursion see Bierman1977.
    """
    A, T, G = L[:SIZE], L[SIZE : 2 * SIZE], L[2 * SIZE :]
    l, c = W[0], W[1]  # noqa: E741
    for i in range(SIZE):
        A[i] = 0.0
    l[:] = 0.0
    levels[:] = 0.0
    lagged[:] = 0.0
    m, node = len(at) - 1, len(nodes) - 1
    for k in range(len(steps) - 1, -1, -1):
        if k % every == 0:
            P = spreads[node]
            for s in range(MOVING):
                # The error moves on by the filter's own transition. What comes after the later state reduces it.
                if node + 1 < len(nodes):
                    for i in range(SIZE):
                        lagged[node + 1, s] += P[s, i] * G[s, i]
                for i in range(SIZE):
                    G[s, i] = 1.0 if i == s else 0.0
                    for j in range(SIZE):
                        G[s, i] -= A[i, j] * P[j, s]
            for i in range(SIZE):
                total = 0.0
                for j in range(SIZE):
                    total += P[i, j] * l[j]
                shifts[node, i] = -total
            for i in range(SIZE):
                for j in range(SIZE):
                    total = 0.0
                    for g in range(SIZE):
                        total += P[i, g] * A[g, j]
                    T[i, j] = total
            for i in range(SIZE):
                for j in range(SIZE):
                    c[j] = 0.0
                    for g in range(SIZE):
                        c[j] += T[i, g] * P[g, j]
                for j in range(SIZE):
                    T[i, j] = c[j]
            for i in range(SIZE):
                for j in range(SIZE):
                    P[i, j] -= T[i, j]
            node -= 1
        while m >= 0 and at[m] == k:
            if updates[m, 2] > 0.0:
                K, H = updates[m, NODE : NODE + SIZE], updates[m, NODE + SIZE :]
                y, S, R = updates[m, 0], updates[m, 1], updates[m, 5]
                by, double = 0.0, 0.0
                for i in range(SIZE):
                    by += K[i] * l[i]
                    total = 0.0
                    for j in range(SIZE):
                        total += A[i, j] * K[j]
                    c[i] = total
                    double += K[i] * total
                u, D = y / S + by, 1.0 / S + double
                updates[m, 3] = (R * u) ** 2 + R - R * R * D
                updates[m, 4] = 1.0
                for i in range(SIZE):
                    l[i] -= H[i] * u
                for s in range(MOVING):
                    by = 0.0
                    for i in range(SIZE):
                        by += K[i] * G[s, i]
                    for i in range(SIZE):
                        G[s, i] -= H[i] * by
                for i in range(SIZE):
                    for j in range(i + 1):
                        A[i, j] += H[i] * H[j] * D - H[i] * c[j] - c[i] * H[j]
                        A[j, i] = A[i, j]
            m -= 1
        if k > 0:
            dt = steps[k, 39]
            q_w, q_a = noise[0] ** 2 * dt, noise[1] ** 2 * dt
            for i in range(3):
                levels[0] += (q_w * l[i]) ** 2 + noise[0] ** 2 - q_w * q_w * A[i, i]
                levels[2] += (q_a * l[3 + i]) ** 2 + noise[1] ** 2 - q_a * q_a * A[3 + i, 3 + i]
            levels[1] += 3.0
            levels[3] += 3.0
            _back(steps[k], l, c)
            _copy(c, l)
            for s in range(MOVING):
                _back(steps[k], G[s], c)
                _copy(c, G[s])
            for i in range(SIZE):
                _back(steps[k], A[i], c)
                _copy(c, A[i])
            for j in range(SIZE):
                for i in range(SIZE):
                    W[2, i] = A[i, j]
                _back(steps[k], W[2], c)
                for i in range(SIZE):
                    A[i, j] = c[i]
