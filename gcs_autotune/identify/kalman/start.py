"""Calculate start values of a filter: smooth the motion, then regress the equations of motion on it.

The smoother uses no craft model: velocities are random walks whose intensity is fitted by maximum likelihood. It
accepts positions alone, or positions and velocities, at any stamps. The equations of motion are linear in the
derivatives (Miskovic2007 (10)-(12), ZhaoUSV (25)). Least squares therefore provides the first parameters.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.free_run import first_state
from gcs_autotune.identify.kalman.filter_bank import FilterBank, Levels, Prior, tuned
from gcs_autotune.identify.problems.initial_guess import SPECIAL_START, RecordedMotion, regression_of
from gcs_autotune.identify.problems.likelihood import Limits
from gcs_autotune.identify.signals.segment import Segment, Signal
from gcs_autotune.models import (
    RIGID_BODY,
    SPECIAL,
    Balance,
    Form,
    balance_of,
    inertia_matrix,
    inertia_of,
    program_of,
    states_of,
)
from gcs_autotune.sname import DOFS

__all__ = ["Start", "begin"]

Array = NDArray[np.float64]

ROUNDS = 12
"""Number of rounds that fit the random walk of the velocities. Project choice: start values need no more accuracy."""


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """Initial values of a filter.

    - ``theta`` (all,): parameters.
    - ``scale`` (p,): value of each free parameter at which its term is as large as all others together.
    - ``states`` (records, n): states at the start of every record.
    - ``spread``: standard deviations of ``states``.
    - ``levels``: noise levels, with a high intensity of the process noise.
    - ``floors`` (m,): smallest noise variances of the signals.
    - ``paths`` (s, n): smoothed states of every record.
    - ``cautious`` (all,): start values that cannot diverge, in case ``theta`` does. The inertia is input divided by
      acceleration, and there is no drag.
    """

    theta: Array
    scale: Array
    states: Array
    spread: Array
    levels: Levels
    floors: Array
    paths: tuple[Array, ...]
    cautious: Array


def begin(bank: FilterBank, given: Mapping[str, float]) -> Start:
    """Return the start values of a filter.

    given : name -> value that overrides the result of the regression.
    """
    form = bank.form
    walked = [_walked(form, track.record, bank.signals) for track in bank.tracks]
    motions = [m for m, _ in walked]
    given = _possible(form, given)
    theta, scale, left = _regression(form, motions, given)
    dt = float(np.median(np.concatenate([np.diff(t.stamps) for t in bank.tracks])))
    k, n = len(form.dofs), len(bank.states)
    drive = np.zeros(n)
    drive[k : 2 * k] = left**2 * dt
    noise = np.mean([n for _, n in walked], axis=0)
    steps = [max((t.record.signals[s].step for t in bank.tracks if s in t.record.signals), default=0.0)
             for s in bank.signals]  # fmt: skip
    floors = np.maximum(np.array(steps) ** 2 / 12.0, 1e-6 * noise)
    states = np.array([m.X[0] for m in motions])
    spread = np.array([_spread(form, t.record, m) for t, m in zip(bank.tracks, motions, strict=True)])
    levels = Levels(np.maximum(noise, floors), drive, np.zeros(len(form.free)))
    return Start(
        theta,
        scale,
        states,
        spread,
        levels,
        floors,
        tuple(m.X for m in motions),
        _cautious(form, theta, motions, given),
    )


def _rough_noise(signal: Signal) -> float:
    """Return the standard deviation of a signal's noise.

    It is estimated from the distances of samples from the line through their neighbours.
    """
    t, y = signal.t, signal.values
    w = (t[2:] - t[1:-1]) / (t[2:] - t[:-2])
    off = (y[1:-1] - w * y[:-2] - (1.0 - w) * y[2:]) / np.sqrt(1.0 + w**2 + (1.0 - w) ** 2)
    least = max(1e-4 * float(np.std(y)), signal.step / math.sqrt(12.0), 1e-12)
    return max(1.4826 * float(np.median(np.abs(off))), least)


def _walked(form: Form, record: Segment, signals: Sequence[str]) -> tuple[RecordedMotion, Array]:
    """Smooth one record, modelling its velocities as random walks.

    Also return the noise variances (m,) of *signals*. A velocity counts as known if the record determines it, because
    this smoother also accepts positions alone.
    """
    walk = Form(
        name="walk",
        title="velocities as random walks",
        dofs=form.dofs,
        free=(),
        known={"m": 1.0, "I_x": 1.0, "I_y": 1.0, "I_z": 1.0},
        inputs={},
        coriolis=False,
    )
    bank = FilterBank(walk, [record], ())
    k, names = len(form.dofs), bank.states
    first, spread = first_state(record, names), _spread_of(names, record)
    prior = Prior(first[None, :], spread[None, :], np.zeros(0), np.zeros((0, 0)))
    noise = np.array([_rough_noise(record.signals[s]) ** 2 for s in bank.signals])
    drive = np.concatenate([np.zeros(k), np.maximum(spread[k:] ** 2, 1e-12)])
    levels = Levels(noise, drive, np.zeros(0))
    theta = np.array([walk.known[n] for n in walk.parameters])
    smoothed = None
    for _ in range(ROUNDS):
        result = bank.run(theta, prior, levels, full=True)
        if result is None:
            break
        smoothed = bank.smooth(result, levels)
        levels = tuned(levels, smoothed, 0.25 * noise)
    t = bank.tracks[0].stamps
    n = len(states_of(form))
    X, seen = np.zeros((len(t), n)), np.zeros(k, dtype=bool)
    row = np.maximum(np.searchsorted(record.t_in, t, side="right") - 1, 0)
    inputs = np.ascontiguousarray(record.inputs[row])
    if smoothed is not None:
        X[:, : 2 * k] = smoothed.trajectories[0]
        seen = np.mean(smoothed.variances[0][:, k:], axis=0) < 0.25 * np.maximum(np.var(X[:, k : 2 * k], axis=0), 1e-12)
    X[:, 2 * k :] = inputs if n > 2 * k else 0.0
    nu_dot = np.gradient(X[:, k : 2 * k], t, axis=0)
    by_name = dict(zip(bank.signals, levels.noise, strict=True))
    order = np.array([by_name.get(s, np.nan) for s in signals])
    return RecordedMotion(t, X, nu_dot, inputs, seen), order


def _regression(
    form: Form, motions: Sequence[RecordedMotion], given: Mapping[str, float]
) -> tuple[Array, Array, Array]:
    """Return all parameters, the scales of the free ones, and the unexplained accelerations (k,)."""
    names = form.parameters
    seen = np.any([m.known for m in motions], axis=0)
    begun = replace(form, start=dict(given))
    regression = regression_of(begun, [replace(m, known=seen) for m in motions])
    base, by = _balance(form, regression.theta, motions)
    theta = regression.solve(Limits({}, {}))
    left = base + by @ (theta - regression.theta)
    J = by[:, :, [names.index(n) for n in form.free]] * np.array([n not in SPECIAL for n in form.free])
    size = np.sqrt(np.mean(J**2, axis=0))
    _make_inertia_positive(form, theta, motions, given)
    M = inertia_matrix(form, theta)
    active = program_of(form).active
    inertia = np.abs(np.diag(M[np.ix_(active, active)]))
    force = np.sqrt(np.mean(base**2, axis=0)) + np.sqrt(np.mean((base - left) ** 2, axis=0))
    acceleration = np.sqrt(np.mean(np.vstack([m.nu_dot for m in motions]) ** 2, axis=0))
    force = np.maximum(force, inertia * acceleration)
    scale = np.array([
        SPECIAL_START[n].spread if n in SPECIAL else _scale(force, size[:, i], theta[names.index(n)])
        for i, n in enumerate(form.free)
    ])  # fmt: skip
    unexplained = np.sqrt(np.mean(left**2, axis=0)) / np.maximum(inertia, 1e-12)
    return theta, scale, np.clip(unexplained, 0.05 * acceleration, 3.0 * acceleration + 1e-9)


def _possible(form: Form, given: Mapping[str, float]) -> dict[str, float]:
    """Return *given* without its inertias if they make the inertia matrix indefinite.

    A filter cannot correct this: the inertia would pass through zero, where accelerations are infinite.
    """
    named = {**given, **form.known}
    inertias = [n for n in given if inertia_of(n) is not None or n in RIGID_BODY]
    if set(inertias) >= {n for n in form.free if inertia_of(n) is not None or n in RIGID_BODY} and inertias:
        active = program_of(form).active
        M = inertia_matrix(form, np.array([named.get(n, 0.0) for n in form.parameters]))[np.ix_(active, active)]
        if np.any(np.linalg.eigvalsh(0.5 * (M + M.T)) <= 0.0):
            return {n: v for n, v in given.items() if n not in inertias}
    return dict(given)


def _scale(force: Array, size: Array, value: float) -> float:
    rows = size > 1e-9 * max(float(size.max()), 1e-300)
    natural = float(np.max(force[rows] / size[rows])) if rows.any() else 1.0
    return max(natural, abs(value), 1e-9)


def _balance(form: Form, theta: Array, motions: Sequence[RecordedMotion]) -> Balance:
    """Return the force balance of the equations at all stamps."""
    balances = [balance_of(program_of(form), theta, m.X, m.nu_dot, m.inputs) for m in motions]
    return Balance(np.vstack([b.values for b in balances]), np.vstack([b.by for b in balances]))


def _make_inertia_positive(
    form: Form, theta: Array, motions: Sequence[RecordedMotion], given: Mapping[str, float]
) -> None:
    """Replace the free inertias by input divided by acceleration if the inertia matrix is not positive definite."""
    active = program_of(form).active
    M = inertia_matrix(form, theta)[np.ix_(active, active)]
    if not np.all(np.linalg.eigvalsh(0.5 * (M + M.T)) > 1e-3 * np.max(np.abs(M))):
        _rough_inertia(form, theta, motions, given)


def _cautious(form: Form, theta: Array, motions: Sequence[RecordedMotion], given: Mapping[str, float]) -> Array:
    names, cautious = form.parameters, theta.copy()
    gains = {g.lstrip("-") for pairs in form.inputs.values() for _, g in pairs if isinstance(g, str)}
    for name in form.free:
        if name not in SPECIAL and name not in RIGID_BODY and name not in gains and inertia_of(name) is None:
            cautious[names.index(name)] = 0.0
    _rough_inertia(form, cautious, motions, given)
    return cautious


def _rough_inertia(form: Form, theta: Array, motions: Sequence[RecordedMotion], given: Mapping[str, float]) -> None:
    """Set the free inertias not in *given* to input divided by acceleration, and coupling inertias to zero."""
    names, active = form.parameters, program_of(form).active
    acceleration = np.sqrt(np.mean(np.vstack([m.nu_dot for m in motions]) ** 2, axis=0))
    still = theta.copy()
    for name in form.free:
        if name not in given and name not in SPECIAL:
            still[names.index(name)] = 0.0
    zero = [RecordedMotion(m.t, 0.0 * m.X, 0.0 * m.nu_dot, m.inputs, m.known) for m in motions]
    force = np.sqrt(np.mean(_balance(form, still, zero).values ** 2, axis=0))
    rough = force / np.maximum(acceleration, 1e-12)
    rough[rough <= 0.0] = float(np.max(rough)) if np.any(rough > 0.0) else 1.0
    without = inertia_matrix(form, still)[np.ix_(active, active)]
    for name in form.free:
        entry = inertia_of(name)
        if entry is None or name in given:
            continue
        place = int(np.flatnonzero(active == entry.row)[0])
        diagonal = entry.row == entry.column
        theta[names.index(name)] = -max(rough[place] - without[place, place], 0.1 * rough[place]) if diagonal else 0.0


def _spread(form: Form, record: Segment, motion: RecordedMotion) -> Array:
    names = states_of(form)
    k = 2 * len(form.dofs)
    spread = np.zeros(len(names))
    spread[:k] = _spread_of(names[:k], record)
    spread[k:] = 0.5 * np.ptp(motion.inputs, axis=0) if len(names) > k else 0.0
    return spread


def _spread_of(names: Sequence[str], record: Segment) -> Array:
    """Return the assumed standard deviations (n,) of the first state.

    They are as large as the motion, and large compared with noise.
    """
    spread = np.zeros(len(names))
    speed = 0.0
    for name in ("x", "y"):
        if name in record.signals:
            signal = record.signals[name]
            speed = max(speed, float(np.sqrt(np.mean(np.gradient(signal.values, signal.t) ** 2))))
    for i, name in enumerate(names):
        own = next(d for d in DOFS.values() if name in (d.velocity, d.position))
        if name in record.signals:
            spread[i] = np.std(record.signals[name].values) + 10.0 * _rough_noise(record.signals[name])
        elif name == own.velocity:
            rate = speed if own.along_ground else 0.0
            if own.position in record.signals:
                signal = record.signals[own.position]
                rate = max(rate, float(np.sqrt(np.mean(np.gradient(signal.values, signal.t) ** 2))))
            others = [float(np.std(s.values)) for n, s in record.signals.items() if n in ("u", "v")]
            spread[i] = rate if rate > 0.0 else max([*others, 0.1])
        elif name == "psi" and {"x", "y"} & set(record.signals):
            spread[i] = 3.0
    return spread
