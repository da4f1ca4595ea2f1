"""Find degrees of freedom that moved in a run and are not part of a model."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import MissingChannel
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.problems.base_model import plain_form
from gcs_autotune.identify.signals.preparation import INPUTS
from gcs_autotune.identify.signals.segment import MIN_SAMPLES
from gcs_autotune.models import FORMS
from gcs_autotune.sensor import noise_of, quantum
from gcs_autotune.sname import DOFS
from gcs_autotune.trial import Channel, Trial

__all__ = ["MOVED_TOO", "dof_option", "moved_besides", "moved_too"]

Array = NDArray[np.float64]

MOVED_TOO = "moved-too"
"""Slug of the doubt about motion in degrees of freedom that the model does not include."""

CLEAR = 3.0
"""Ratio of a velocity's standard deviation to that of its noise, above which the velocity counts as motion.

Project choice.
"""

DRIVEN = 0.1
"""Range of a normalised output (10th to 90th percentile) above which it counts as an active input. Project choice."""

WINDOW, TURN = 2.0, 0.4
"""Longest interval for differences of a track, in time [s] and in change of heading [rad]. Project choice.

The differences are used if no velocities were recorded. At this change of heading the chord is 0.7 % shorter than the
track.
"""


def moved_besides(runs: Iterable[Trial], dofs: Collection[str]) -> Mapping[str, list[str]]:
    """Return degree of freedom -> names of the runs in which it moved, for those not in *dofs*.

    Sway counts if it moved, and surge counts together with sway, because both are coupled with yaw. Any other degree of
    freedom counts only if its own input varied too. Without an input it cannot be identified.
    """
    run_names: dict[str, list[str]] = {}
    for run in runs:
        moved = {name for name in DOFS if name not in dofs and _moved(run, name)}
        if "sway" not in moved:
            moved = {name for name in moved if _driven(run, name)}
        for name in sorted(moved):
            if name in ("surge", "sway") or _driven(run, name):
                run_names.setdefault(name, []).append(run.name)
    return run_names


def dof_option(runs: Sequence[Trial], dofs: Collection[str], besides: Collection[str]) -> str:
    """Return the value of ``--dof`` that includes the degrees of freedom *dofs* and *besides*.

    The value is empty if the recorded channels do not support such a model.
    """
    wanted = {*dofs, *besides}
    horizontal = wanted <= set(FORMS["horizontal"].dofs) and "sway" in wanted
    option = "horizontal" if horizontal else ",".join(name for name in DOFS if name in wanted)
    try:
        return option if set(besides) <= set(plain_form(runs, option).dofs) else ""
    except MissingChannel:
        return ""


def moved_too(runs: Sequence[Trial], dofs: Collection[str]) -> list[Doubt]:
    """Return a list with a doubt about motion in *runs* outside *dofs*, or an empty list without such motion.

    The doubt states the value of ``--dof`` that includes the motion.
    """
    besides = moved_besides(runs, dofs)
    if not besides:
        return []
    names = " and ".join(besides)
    option = dof_option(runs, dofs, besides)
    inputs = ", ".join(INPUTS[name][0] for name in besides if name != "sway")
    return [
        Doubt(
            MOVED_TOO,
            f"only {' and '.join(dofs)} was analysed, but {names} moved too",
            f"repeat the command with --dof {option}" if option else f"record their inputs ({inputs})",
        )
    ]


def _moved(run: Trial, dof: str) -> bool:
    velocity = _velocity(run, dof)
    if velocity is None:
        return False
    values, noise = velocity
    return len(values) >= MIN_SAMPLES and float(np.std(values)) > CLEAR * noise


def _velocity(run: Trial, dof: str) -> tuple[Array, float] | None:
    """Return a velocity (n,) and the standard deviation of its noise.

    If no velocity was recorded, it is derived from the track.
    """
    measured = _finite(run, DOFS[dof].velocity)
    if measured is not None:
        return measured.values, _floor(measured.values)
    x, y, psi = (_finite(run, name) for name in ("x", "y", "psi"))
    if not DOFS[dof].along_ground or x is None or y is None or psi is None:
        return None
    turned = np.unwrap(psi.values)
    rate = float(np.quantile(np.abs(np.gradient(turned, psi.t)), 0.95))
    window = min(WINDOW, TURN / max(rate, 1e-9))
    steps = max(round(window / max(float(np.median(np.diff(x.t))), 1e-9)), 1)
    if len(x) <= 2 * steps:
        return None
    seconds = x.t[steps:] - x.t[:-steps]
    north, east = x.values, np.interp(x.t, y.t, y.values)
    north, east = (north[steps:] - north[:-steps]) / seconds, (east[steps:] - east[:-steps]) / seconds
    heading = np.interp(0.5 * (x.t[steps:] + x.t[:-steps]), psi.t, turned)
    ahead = north * np.cos(heading) + east * np.sin(heading)
    starboard = east * np.cos(heading) - north * np.sin(heading)
    noise = math.sqrt(2.0) * max(_floor(x.values), _floor(y.values)) / float(np.median(seconds))
    return (ahead if dof == "surge" else starboard), noise


def _floor(values: Array) -> float:
    """Return the standard deviation of the noise, at least that caused by rounding."""
    return max(noise_of(values), quantum(values) / math.sqrt(12.0))


def _driven(run: Trial, dof: str) -> bool:
    """Return whether an input of *dof* took more than one level."""
    for name in INPUTS[dof]:
        drive = _finite(run, name)
        if drive is not None:
            span = float(np.ptp(np.quantile(drive.values, (0.1, 0.9))))
            if span > (DRIVEN if drive.unit == "1" else 0.0):
                return True
    return False


def _finite(run: Trial, name: str) -> Channel | None:
    """Return the finite samples of a channel, or None if there are too few."""
    if name not in run:
        return None
    channel = run[name]
    good = np.isfinite(channel.values) & np.isfinite(channel.t)
    if int(good.sum()) < MIN_SAMPLES:
        return None
    return Channel(name, channel.unit, channel.t[good], channel.values[good])
