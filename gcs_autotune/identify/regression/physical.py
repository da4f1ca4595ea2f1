"""Check that a model is physical, Miskovic2007 (9)-(11).

M must be symmetric and positive definite. C must do no work. D must be positive over the velocities of the runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.regression.motion import GriddedMotion
from gcs_autotune.models import CoupledModel, Form, program_of
from gcs_autotune.models.coupled import kernel

__all__ = ["Check", "check_physics", "damping_slopes", "physics_doubts", "velocities_visited"]

Array = NDArray[np.float64]

DIRECTIONS = 64
"""Number of directions in which the largest velocity is searched.

Project choice. D is linear in the magnitudes of the velocities, so that the extremes are sufficient.
"""

ROUNDING = 1e-9
"""Relative size of an asymmetry or a negative eigenvalue below which it is a rounding error. Project choice."""

POWERLESS = 0.1
"""Largest fraction of the coupling forces' power that may remain in their sum.

Above it, C counts as not skew-symmetric. Project choice.
"""


@dataclass(frozen=True, slots=True)
class Check:
    """Result of one check of the model.

    - ``what``: the condition that is checked.
    - ``holds``: whether the model satisfies the condition.
    - ``margin``: distance from the limit of the condition, which is 0.
    - ``description``: one sentence for the user.
    """

    what: str
    holds: bool
    margin: float
    description: str


def velocities_visited(motions: Sequence[GriddedMotion]) -> Array:
    """Return velocities (m, 6) from the runs. Their magnitudes bound those of all velocities in the runs."""
    nu = np.concatenate([m.nu for m in motions])
    scale = np.maximum(np.abs(nu).max(axis=0), 1e-12)
    directions = np.random.default_rng(0).standard_normal((DIRECTIONS, 6))
    far = np.argmax((np.abs(nu) / scale) @ directions.T, axis=0)
    picked: Array = nu[np.unique(far)]
    return picked


def check_physics(model: CoupledModel, visited: Array) -> tuple[Check, ...]:
    """Return the checks of *model* over the velocities *visited* (m, 6).

    They are ``M symmetric``, ``M positive``, ``C skew`` and ``D positive``. Margins are relative to the diagonals.
    """
    M = model.inertia
    return (
        _symmetric(M),
        _positive("M positive", "inertia M", _least(0.5 * (M + M.T))),
        _skew(model, visited),
        _damping(model, visited),
    )


def _symmetric(M: Array) -> Check:
    size = float(np.max(np.abs(M)))
    off = float(np.max(np.abs(M - M.T))) / max(size, 1e-300)
    holds = off <= ROUNDING
    words = "M is symmetric" if holds else f"M is not symmetric. Mirrored entries differ by up to {off:.1%}"
    return Check("M symmetric", holds, -off, words)


def _positive(what: str, name: str, least: float) -> Check:
    holds = least > -ROUNDING
    words = (
        f"{name} is positive definite"
        if holds
        else f"{name} is not positive definite. Its smallest eigenvalue is {least:.2g} times its diagonal"
    )
    return Check(what, holds, least, words)


def _least(A: Array) -> float:
    """Return the smallest eigenvalue of symmetric A (..., k, k), relative to the magnitude of its diagonal."""
    diagonal = np.abs(np.diagonal(A, axis1=-2, axis2=-1))
    if A.ndim > 2:
        diagonal = diagonal.max(axis=0)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    return float(np.linalg.eigvalsh(A * scale[:, None] * scale).min())


def _skew(model: CoupledModel, visited: Array) -> Check:
    """Check that C does no work.

    The part of C from M is skew-symmetric by construction. Products that the form lists separately may do work
    together.
    """
    powers = []
    for row, par, coefficient, factors in _terms(model.form):
        moving = [c for c in factors if c >= 0]
        if len(moving) == 2 and all(c < kernel.NU_SIZE for c in moving) and moving[0] != moving[1]:
            value = coefficient * (model.theta[par] if par >= 0 else 1.0)
            powers.append(value * visited[:, row] * visited[:, moving[0]] * visited[:, moving[1]])
    if not powers:
        return Check("C skew", True, 0.0, "C is skew-symmetric, so Coriolis forces do no work")
    left, whole = np.abs(np.sum(powers, axis=0)).max(), np.sum(np.abs(powers), axis=0).max()
    share = float(left / max(whole, 1e-300))
    holds = share <= POWERLESS
    words = (
        f"C is skew-symmetric, so coupling forces do no work (to {share:.1%})"
        if holds
        else f"C is not skew-symmetric. The coupling forces do work, {share:.0%} of the sum of their powers"
    )
    return Check("C skew", holds, POWERLESS - share, words)


def _damping(model: CoupledModel, visited: Array) -> Check:
    rows, slopes = damping_slopes(model.form, visited)
    if not len(rows):
        return Check("D positive", True, 0.0, "the form has no damping on its diagonal")
    D = np.tensordot(np.append(model.theta, 1.0), slopes, axes=1)
    return _positive("D positive", "damping D", _least(0.5 * (D + D.transpose(0, 2, 1))))


def damping_slopes(form: Form, visited: Array) -> tuple[tuple[int, ...], Array]:
    """Return the indices (d,) of the damped degrees of freedom, and the derivative (p + 1, m, d, d) of D by every
    parameter.

    The derivative is calculated at each of the velocities *visited* (m, 6). Its last entry along the first axis is the
    constant part of D. D contains the linear derivatives and those with one modulus. Products of two velocities belong
    to C.
    """
    active = [int(a) for a in program_of(form).active]
    entries = []
    for row, par, coefficient, factors in _terms(form):
        moving = [c for c in factors if c >= 0]
        plain = [c for c in moving if c < kernel.NU_SIZE]
        sizes = [c - kernel.NU_SIZE for c in moving if kernel.NU_SIZE <= c < kernel.ETA]
        if len(plain) == 1 and len(plain) + len(sizes) == len(moving):
            entries.append((row, plain[0], par, coefficient, sizes))
    damped = tuple(a for a in active if any(row == a == column for row, column, *_ in entries))
    slopes = np.zeros((len(form.parameters) + 1, len(visited), len(damped), len(damped)))
    for row, column, par, coefficient, sizes in entries:
        if row in damped and column in damped:
            weight = np.prod(np.abs(visited[:, sizes]), axis=1) if sizes else np.ones(len(visited))
            slopes[par, :, damped.index(row), damped.index(column)] -= coefficient * weight
    return damped, slopes


def _terms(form: Form) -> list[tuple[int, int, float, tuple[int, ...]]]:
    program = program_of(form)
    return [
        (int(r), int(p), float(c), tuple(int(x) for x in f))
        for r, p, c, f in zip(program.rows, program.pars, program.coefs, program.factors, strict=True)
    ]


def physics_doubts(checks: Sequence[Check]) -> list[Doubt]:
    """Return a doubt that lists all failed checks, if any."""
    wrong = [c.description for c in checks if not c.holds]
    if not wrong:
        return []
    return [
        Doubt(
            "not-physical",
            "; ".join(wrong),
            "use longer runs with more excitation, fewer terms, or physical=True to keep M and D positive",
        )
    ]
