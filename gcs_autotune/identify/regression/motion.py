"""Derive the velocities and accelerations of a record on one even grid of times, from the measured signals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import MissingChannel, NotInformative
from gcs_autotune.identify.regression.smoothing import SMOOTHERS, Smooth
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.models import Form, program_of
from gcs_autotune.models.coupled import kernel
from gcs_autotune.registry import lookup
from gcs_autotune.sname import DOFS

__all__ = ["GriddedMotion", "motion_of"]

Array = NDArray[np.float64]

NU = ("u", "v", "w", "p", "q", "r")
ETA = ("x", "y", "z", "phi", "theta", "psi")

LEAST_POINTS = 12
"""Smallest number of grid points that a stretch of a record needs for a regression."""

MOST_POINTS = 20_000
"""Maximum number of grid points of a stretch. A longer stretch gets a coarser grid."""


@dataclass(frozen=True, slots=True, eq=False)
class GriddedMotion:
    """A stretch of motion on an even grid.

    - ``t`` (n,): times, with interval ``step`` [s].
    - ``nu``, ``nu_dot`` (n, 6): velocity through the water and its rate.
    - ``eta`` (n, 6): position and angles. All three are 0 for an absent degree of freedom.
    - ``noise``, ``settings``: noise and setting of the smoother, per signal.
    - ``reach`` [s]: largest half-width of a smoother.
    """

    run: str
    t: Array
    step: float
    nu: Array
    nu_dot: Array
    eta: Array
    noise: Mapping[str, float] = field(default_factory=dict)
    settings: Mapping[str, float] = field(default_factory=dict)
    reach: float = 0.0


def motion_of(
    record: Segment,
    form: Form,
    derivative: str = "smoothing",
    settings: Mapping[str, float] | None = None,
) -> GriddedMotion:
    """Return the smoothed motion of *record*.

    Parameters
    ----------
    derivative : name in ``SMOOTHERS``.
    settings : per signal, to smooth it as another record; None chooses them.

    Raises
    ------
    MissingChannel
        A velocity of the form was not measured and cannot be derived from positions.
    NotInformative
        The signals do not overlap in time.
    """
    smoother = lookup(SMOOTHERS, derivative, "way to differentiate")
    given = settings or {}
    smooth = {
        name: smoother(signal, 1 if name in NU else 2, given.get(name)) for name, signal in record.signals.items()
    }
    t, step = _grid(record)
    eta, nu, nu_dot = np.zeros((len(t), 6)), np.zeros((len(t), 6)), np.zeros((len(t), 6))
    for j, name in enumerate(ETA):
        if name in smooth:
            eta[:, j] = smooth[name].at(t, 0)
    _angles_needed(record, form)
    _turning(form, record, smooth, t, step, eta, nu, nu_dot)
    _moving(form, record, smooth, t, eta, nu, nu_dot)
    reach = max((s.reach for s in smooth.values()), default=0.0)
    return GriddedMotion(
        record.run,
        t,
        step,
        nu,
        nu_dot,
        eta,
        {n: s.noise for n, s in smooth.items()},
        {n: s.setting for n, s in smooth.items()},
        reach,
    )


def _grid(record: Segment) -> tuple[Array, float]:
    signals = record.signals.values()
    begin, end = max(float(s.t[0]) for s in signals), min(float(s.t[-1]) for s in signals)
    step = min(float(np.median(np.diff(s.t))) for s in signals)
    if not end - begin >= LEAST_POINTS * step:
        raise NotInformative(
            f"the signals {', '.join(record.signals)} of run '{record.run}' overlap for only "
            f"{max(end - begin, 0.0):.3g} s. Least squares needs them at the same time. Fit fewer signals or use "
            "output-error"
        )
    n = min(int((end - begin) / step + 1e-6) + 1, MOST_POINTS)
    return np.linspace(begin, end, n), (end - begin) / (n - 1)


def _angles_needed(record: Segment, form: Form) -> None:
    """Raise MissingChannel if the form needs a position or an angle that was not measured."""
    program = program_of(form)
    codes = {int(c) for c in program.factors.ravel()}
    needed = [ETA[c - kernel.ETA] for c in codes if kernel.ETA <= c < kernel.ETA + 6]
    needed += ["phi"] * (kernel.SIN_PHI in codes) + ["theta"] * (kernel.SIN_THETA in codes)
    missing = [n for n in needed if n not in record.signals]
    if missing:
        raise MissingChannel(
            f"least squares of '{form.name}' needs measurements of {', '.join(missing)}. Run '{record.run}' has "
            f"{', '.join(record.signals)}. Use output-error, which needs no velocities"
        )


def _turning(
    form: Form,
    record: Segment,
    smooth: Mapping[str, Smooth],
    t: Array,
    step: float,
    eta: Array,
    nu: Array,
    nu_dot: Array,
) -> None:
    """Fill p, q, r with the measured rates, or else from the angles (Fossen2011, (2.26), inverted)."""
    rates = np.zeros((len(t), 3))
    for j, name in enumerate(ETA[3:]):
        if name in smooth:
            rates[:, j] = smooth[name].at(t, 1)
    level = not {"roll", "pitch"} & set(form.dofs)
    if level:
        from_angles = rates
    else:
        phi, theta = eta[:, 3], eta[:, 4]
        from_angles = np.column_stack(
            [
                rates[:, 0] - np.sin(theta) * rates[:, 2],
                np.cos(phi) * rates[:, 1] + np.sin(phi) * np.cos(theta) * rates[:, 2],
                -np.sin(phi) * rates[:, 1] + np.cos(phi) * np.cos(theta) * rates[:, 2],
            ]
        )
    for dof in (DOFS[d] for d in form.dofs if DOFS[d].angular):
        j = NU.index(dof.velocity)
        if dof.velocity in smooth:
            nu[:, j], nu_dot[:, j] = smooth[dof.velocity].at(t, 0), smooth[dof.velocity].at(t, 1)
            continue
        if dof.position not in smooth:
            raise _unseen(record, form, dof.velocity, dof.position)
        nu[:, j] = from_angles[:, j - 3]
        nu_dot[:, j] = smooth[dof.position].at(t, 2) if level else np.gradient(nu[:, j], step)


def _moving(
    form: Form,
    record: Segment,
    smooth: Mapping[str, Smooth],
    t: Array,
    eta: Array,
    nu: Array,
    nu_dot: Array,
) -> None:
    """Fill u, v, w with the measured velocities, or else from positions rotated to body axes.

    The known current is subtracted.
    """
    wanted = [DOFS[d] for d in form.dofs if not DOFS[d].angular]
    if not wanted:
        return
    R = _rotation(eta)
    current = np.array([form.known.get("V_x", 0.0), form.known.get("V_y", 0.0), 0.0])
    omega = nu[:, 3:]
    absent = [d for d in wanted if d.velocity not in smooth]
    if absent:
        needed = _positions_needed(form, absent[0].name)
        missing = [n for n in needed if n not in smooth]
        if missing:
            raise _unseen(record, form, absent[0].velocity, " and ".join(missing))
        first, second = np.zeros((len(t), 3)), np.zeros((len(t), 3))
        for j, name in enumerate(ETA[:3]):
            if name in smooth:
                first[:, j], second[:, j] = smooth[name].at(t, 1), smooth[name].at(t, 2)
        body = np.einsum("nij,ni->nj", R, first - current)
        turned = np.einsum("nij,ni->nj", R, second) - np.cross(omega, body)
    drift = np.einsum("nij,i->nj", R, current)
    for dof in wanted:
        j = NU.index(dof.velocity)
        if dof.velocity in smooth:
            nu[:, j] = smooth[dof.velocity].at(t, 0) - drift[:, j]
            nu_dot[:, j] = smooth[dof.velocity].at(t, 1) + np.cross(omega, drift)[:, j]
        else:
            nu[:, j], nu_dot[:, j] = body[:, j], turned[:, j]


def _positions_needed(form: Form, dof: str) -> tuple[str, ...]:
    """Return the names of the positions from which the velocity of *dof* can be derived."""
    if {"roll", "pitch"} & set(form.dofs):
        return ("x", "y", "z")
    if dof == "heave" or not ({"sway", "yaw"} & set(form.dofs) and {"surge", "sway"} & set(form.dofs)):
        return (DOFS[dof].position,)
    return ("x", "y", "psi")


def _rotation(eta: Array) -> Array:
    """Return the rotation matrices R (n, 3, 3) from body axes to NED; Fossen2011, (2.18)."""
    c, s = np.cos(eta[:, 3:]), np.sin(eta[:, 3:])
    (cp, ct, cy), (sp, st, sy) = c.T, s.T
    rows = [
        [cy * ct, -sy * cp + cy * st * sp, sy * sp + cy * cp * st],
        [sy * ct, cy * cp + sp * st * sy, -cy * sp + st * sy * cp],
        [-st, ct * sp, ct * cp],
    ]
    return np.array(rows).transpose(2, 0, 1)


def _unseen(record: Segment, form: Form, velocity: str, position: str) -> MissingChannel:
    return MissingChannel(
        f"least squares of '{form.name}' needs the velocity {velocity}, or {position} to derive it from. Run "
        f"'{record.run}' has {', '.join(record.signals)}. Select more signals (--use), or use output-error"
    )
