"""Improvement of the log-likelihood by the true effect over the best plain craft, with known disturbances [nats].

This measures how visible an effect is, independent of the diagnosis. Known are the craft, the effect with its
parameters, the noise, the statistics of the disturbances, the times of bursts, the run-to-run differences and the lag
of the heading. The disturbances themselves are not known. A Kalman filter of the heading (:mod:`.disturbance_filter`)
computes the likelihood of the runs for two motions: the true one without disturbances, and that of the plain craft with
the best gain and damping. Nothing is fitted for the true effect. A fit gains half a nat per parameter more, on average.

Approximations:

* Quadratic drag is linearised about the simulated motion, as an iterated smoother does in the end (Bell1994).
* The commands of the helm depend on the heading. This information is not used. With a late heading, they are known at
  the samples only.
* The heading motion of waves is not late, even if the heading is. Its waves are then independent of those of the
  moment.

Smoothing and filtering of the heading can be inverted exactly, so the files before them hold the same information. The
runs are of yaw alone and start at rest.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from benchmarks.blind.disturbance_filter import disturbance_model, whitened
from benchmarks.blind.flight_plan import Case, FlownRuns, fly
from sitl.effects import HiddenEffect, Setting
from sitl.plants import Wrench

__all__ = ["improvement", "visible"]

Array = NDArray[np.float64]

WIDEST, TRIED = math.log(8.0), 9
"""Logarithm of the largest factor between the plain craft's and the true damping, and the number of grid points."""


def visible(case: Case) -> float | None:
    """Return the improvement by the one hidden effect of *case* in the supplied runs [nats].

    None without an effect, with two effects, and without process noise.
    """
    supplied = len(case.runs) + len(case.unseen)
    return (
        None
        if case.flown is None or len(case.truth) != 1
        else improvement(case.flown.first(supplied), case.levels["psi"])
    )


def improvement(flown: FlownRuns, noise: float) -> float:
    """Return the log-likelihood of the true motion minus that of the best plain craft [nats].

    *noise*: standard deviation of the noise of the heading [rad].

    Raises
    ------
    ValueError
        The craft has other degrees of freedom than yaw.
    """
    craft = flown.plan.craft
    if craft.dofs != ("yaw",):
        raise ValueError("only craft with yaw alone are supported")
    values_of = {h.slug: h.values for h in flown.hidden}
    late = values_of.get("lag", {}).get("delay", 0.0)
    inertia, plain_damping = craft.inertia["yaw"], craft.linear["yaw"] / craft.inertia["yaw"]
    headings = np.stack(
        [_unfiltered(f, values_of.get("lag", {}).get("time_constant", 0.0)) for f in flown.files], axis=1
    )
    inputs = np.stack([f[craft.input] for f in flown.files], axis=1) / inertia
    differences = {k: h.values for h in flown.hidden if h.slug == "run-to-run" for k in h.in_runs or ()}
    thrust = np.array([differences[k]["thrust"] if k in differences else 1.0 for k in range(len(flown.files))])
    trim = np.array([differences[k]["moment"] if k in differences else 0.0 for k in range(len(flown.files))]) / inertia
    initial = np.array([start.get("psi", 0.0) for start in flown.plan.initial])

    motion, damping = _true_motion(flown, late)
    z, scale = whitened(disturbance_model(flown, thrust, damping, noise), (headings - motion)[..., None])
    true = -0.5 * (float(np.sum(z**2)) + scale)

    def plain(factor: float) -> float:
        """Return minus the log-likelihood of a plain craft; *factor*: logarithm of its damping over the true one."""
        rate = plain_damping * math.exp(factor)
        still = initial + _turned(np.broadcast_to(trim, inputs.shape), rate, craft.interval, late)
        turned = _turned(thrust * inputs, rate, craft.interval, late)
        model = disturbance_model(flown, thrust, np.full((1, len(thrust)), rate), noise)
        z, scale = whitened(model, np.stack([headings - still, turned], axis=-1))
        left, moved = z[..., 0].ravel(), z[..., 1].ravel()
        gain = float(moved @ left) / float(moved @ moved)
        return 0.5 * (float(np.sum((left - gain * moved) ** 2)) + scale)

    grid = np.linspace(-WIDEST, WIDEST, TRIED)
    costs = [plain(float(g)) for g in grid]
    best, apart = float(grid[int(np.argmin(costs))]), float(grid[1] - grid[0])
    found = minimize_scalar(plain, bounds=(best - apart, best + apart), method="bounded", options={"xatol": 1e-3})
    return true + min(float(found.fun), min(costs))


def _unfiltered(file: Mapping[str, Array], time_constant: float) -> Array:
    """Return the heading (n,) before the filter."""
    psi = file["psi"].copy()
    if time_constant > 0.0:
        kept = np.exp(-np.diff(file["t"]) / time_constant)
        psi[1:] = (psi[1:] - kept * psi[:-1]) / (1.0 - kept)
    return psi


def _true_motion(flown: FlownRuns, late: float) -> tuple[Array, Array]:
    """Return heading (n, runs) and damping (steps or 1, runs) [1/s] of the true craft without disturbances."""
    craft, files = flown.plan.craft, flown.files
    known = [
        h
        for h in flown.hidden
        if h.slug not in ("drifting-moment", "waves", "helm") and (h.slug != "lag" or late > 0.0)
    ]
    inputs = [{craft.input: f[craft.input]} for f in files]
    drag = next((h.values["coefficient"] for h in known if h.slug == "quadratic-drag"), 0.0)
    damping = np.full((1, len(files)), craft.linear["yaw"])
    tangents: Sequence[Tangent] = ()
    if drag:
        known = [h for h in known if h.slug != "quadratic-drag"]
        tangents = [Tangent(drag, np.append(-late - 1e-9, f["t"]), np.append(0.0, f["r"])) for f in files]
        between = files[0]["t"][:-1] + 0.5 * craft.interval - late
        damping = damping + 2.0 * drag * np.abs(np.stack([t.at(between) for t in tangents], axis=1))
    flights = fly(flown.plan, known, commands=inputs, beside=tangents)
    return np.stack([f["psi"] for f in flights], axis=1), damping / craft.inertia["yaw"]


class Tangent(HiddenEffect):
    """Quadratic drag of yaw, linearised about the turn rates *r* [rad/s] at the times *t* [s]."""

    slug = "tangent-drag"

    def __init__(self, coefficient: float, t: Array, r: Array) -> None:
        super().__init__()
        self._coefficient, self._t, self._r = coefficient, t, r

    def at(self, t: Array) -> Array:
        """Return the turn rate at other times."""
        return np.interp(t, self._t, self._r)

    def begin(self, setting: Setting) -> None:
        """Keep the state."""
        self._state = setting.state

    def alter_force(self, t: float, wrench: Wrench) -> None:
        """Add the drag."""
        about = float(np.interp(t, self._t, self._r))
        wrench.N += self._coefficient * abs(about) * (about - 2.0 * self._state.r)

    def quickness(self, setting: Setting) -> float:
        """Return the time constant at the largest turn rate."""
        fastest = max(float(np.abs(self._r).max()), 1e-9)
        return setting.parameters["yaw.alpha"] / (2.0 * self._coefficient * fastest)


def _turned(push: Array, damping: float, interval: float, late: float) -> Array:
    """Return the heading of a plain craft from rest (n, runs), with a delay *late* [s].

    *push* (n, runs) [rad/s^2] is held between samples. As in the simulator, the first one starts by the delay earlier.
    """
    whole = math.ceil(late / interval - 1e-9)
    second = whole * interval - late  # part of every step with the next push
    first = interval - second

    def once(time: float) -> float:
        return -math.expm1(-damping * time) / damping

    def twice(time: float) -> float:
        return (time - once(time)) / damping

    step = np.arange(len(push) - 1) - whole
    before, after = push[np.maximum(step, 0)], push[np.maximum(step + 1, 0)]
    fade = math.exp(-damping * second)
    gained = fade * once(first) * before + once(second) * after
    rate = lfilter([1.0], [1.0, -math.exp(-damping * interval)], gained, axis=0)
    rate = np.concatenate([np.zeros_like(push[:1]), rate[:-1]])
    moved = once(interval) * rate + (twice(first) + once(second) * once(first)) * before + twice(second) * after
    return np.concatenate([np.zeros_like(push[:1]), np.cumsum(moved, axis=0)])
