"""What the true effect is worth to who knows the weather: nats that the true numbers gain over the best plain craft.

The measure of what can be seen at all, that asks nobody's search. It knows the craft, the effect's numbers, how strong
weather and waves are and how long they last, when bursts come and go, trim and thrust of every day, noise, and how the
heading lags; what happened it does not know. A filter of the heading (:mod:`.astray`) tells how likely the runs are
about the motion that the tank has without weather, and about that of a plain craft whose gain and damping are the best
there are. Nothing is fitted for the true effect: who fits it as well gains half a nat more for every number, on
average.

Where it is not exact:

* Quadratic drag is linearised along the motion that there was, as an iterated smoother does in the end (Bell1994).
* The helm looks at the heading. What its commands say of the heading beyond the record is not used, and of a heading
  that comes late they are known at the samples only.
* The swing of a bow amid waves does not come late, even where the heading does; then it counts as other waves' than
  those that push.

Smoothing over samples, forwards and backwards, can be undone exactly, and so can a filter that ran one way: files
before them tell as much. Runs of yaw alone, that begin at rest.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from benchmarks.blind.astray import water_of, whitened
from benchmarks.blind.voyage import Case, Flown, fly
from sitl.effects import HiddenEffect, Setting
from sitl.plants import Wrench

__all__ = ["visible", "worth"]

Array = NDArray[np.float64]

WIDEST, TRIED = math.log(8.0), 9
"""Damping of the plain craft is sought within this factor of the true one, from so many values on."""


def visible(case: Case) -> float | None:
    """Return what the one effect hidden in *case* is worth in the runs that were given [nats].

    None for no effect, for two, and without weather.
    """
    given = len(case.runs) + len(case.unseen)
    return None if case.flown is None or len(case.truth) != 1 else worth(case.flown.first(given), case.levels["psi"])


def worth(flown: Flown, noise: float) -> float:
    """Return log-likelihood of the true motion less that of the best plain craft [nats]; *noise* [rad] of the heading.

    Raises
    ------
    ValueError
        This is no voyage of a craft that only turns.
    """
    craft = flown.voyage.craft
    if craft.dofs != ("yaw",):
        raise ValueError("known is the weather of craft that only turn")
    around = {h.slug: h.values for h in flown.hidden}
    late = around.get("lag", {}).get("delay", 0.0)
    inertia, damping = craft.inertia["yaw"], craft.linear["yaw"] / craft.inertia["yaw"]
    seen = np.stack([_unfiltered(f, around.get("lag", {}).get("time_constant", 0.0)) for f in flown.files], axis=1)
    told = np.stack([f[craft.input] for f in flown.files], axis=1) / inertia
    days = {k: h.values for h in flown.hidden if h.slug == "day" for k in h.in_runs or ()}
    thrust = np.array([days[k]["thrust"] if k in days else 1.0 for k in range(len(flown.files))])
    trim = np.array([days[k]["moment"] if k in days else 0.0 for k in range(len(flown.files))]) / inertia
    begun = np.array([start.get("psi", 0.0) for start in flown.voyage.initial])

    motion, slowing = _true_motion(flown, late)
    z, scale = whitened(water_of(flown, thrust, slowing, noise), (seen - motion)[..., None])
    true = -0.5 * (float(np.sum(z**2)) + scale)

    def plain(factor: float) -> float:
        """Return minus the log-likelihood of a plain craft of that damping (logarithm, of the true one)."""
        rate = damping * math.exp(factor)
        still = begun + _turned(np.broadcast_to(trim, told.shape), rate, craft.interval, late)
        turned = _turned(thrust * told, rate, craft.interval, late)
        water = water_of(flown, thrust, np.full((1, len(thrust)), rate), noise)
        z, scale = whitened(water, np.stack([seen - still, turned], axis=-1))
        left, moved = z[..., 0].ravel(), z[..., 1].ravel()
        gain = float(moved @ left) / float(moved @ moved)
        return 0.5 * (float(np.sum((left - gain * moved) ** 2)) + scale)

    grid = np.linspace(-WIDEST, WIDEST, TRIED)
    costs = [plain(float(g)) for g in grid]
    best, apart = float(grid[int(np.argmin(costs))]), float(grid[1] - grid[0])
    found = minimize_scalar(plain, bounds=(best - apart, best + apart), method="bounded", options={"xatol": 1e-3})
    return true + min(float(found.fun), min(costs))


def _unfiltered(file: Mapping[str, Array], time_constant: float) -> Array:
    """Return the heading (n,) before a filter that ran one way."""
    psi = file["psi"].copy()
    if time_constant > 0.0:
        kept = np.exp(-np.diff(file["t"]) / time_constant)
        psi[1:] = (psi[1:] - kept * psi[:-1]) / (1.0 - kept)
    return psi


def _true_motion(flown: Flown, late: float) -> tuple[Array, Array]:
    """Return heading (n, runs) of the true craft without weather, and how it is damped (steps or 1, runs) [1/s]."""
    craft, files = flown.voyage.craft, flown.files
    known = [h for h in flown.hidden if h.slug not in ("weather", "waves", "helm") and (h.slug != "lag" or late > 0.0)]
    told = [{craft.input: f[craft.input]} for f in files]
    drag = next((h.values["coefficient"] for h in known if h.slug == "quadratic-drag"), 0.0)
    slowing = np.full((1, len(files)), craft.linear["yaw"])
    tangents: Sequence[Tangent] = ()
    if drag:
        known = [h for h in known if h.slug != "quadratic-drag"]
        tangents = [Tangent(drag, np.append(-late - 1e-9, f["t"]), np.append(0.0, f["r"])) for f in files]
        between = files[0]["t"][:-1] + 0.5 * craft.interval - late
        slowing = slowing + 2.0 * drag * np.abs(np.stack([t.at(between) for t in tangents], axis=1))
    flights = fly(flown.voyage, known, told=told, beside=tangents)
    return np.stack([f["psi"] for f in flights], axis=1), slowing / craft.inertia["yaw"]


class Tangent(HiddenEffect):
    """Quadratic drag of yaw, linear about a turn rate *r* [rad/s] at times *t* [s]."""

    slug = "tangent-drag"

    def __init__(self, coefficient: float, t: Array, r: Array) -> None:
        super().__init__()
        self._coefficient, self._t, self._r = coefficient, t, r

    def at(self, t: Array) -> Array:
        """Return that turn rate at other times."""
        return np.interp(t, self._t, self._r)

    def begin(self, setting: Setting) -> None:
        """Find the motion."""
        self._state = setting.state

    def alter_force(self, t: float, wrench: Wrench) -> None:
        """Brake."""
        about = float(np.interp(t, self._t, self._r))
        wrench.N += self._coefficient * abs(about) * (about - 2.0 * self._state.r)

    def quickness(self, setting: Setting) -> float:
        """Return the time constant at the fastest turn."""
        fastest = max(float(np.abs(self._r).max()), 1e-9)
        return setting.parameters["yaw.alpha"] / (2.0 * self._coefficient * fastest)


def _turned(push: Array, damping: float, interval: float, late: float) -> Array:
    """Return how far a plain craft turns from rest (n, runs), seen *late* [s], under *push* (n, runs) [rad/s^2].

    Exactly, pushes being held from sample to sample; as in the tank it was under the first one that much longer.
    """
    whole = math.ceil(late / interval - 1e-9)
    second = whole * interval - late  # of every step seen: so long under the next push
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
