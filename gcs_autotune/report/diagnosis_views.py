"""Which picture of a residual tells a story: against a channel, against a lagged channel, or over frequency."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.diagnose import Portrait
from gcs_autotune.effects import Effect
from gcs_autotune.sname import DOFS

__all__ = ["BINS", "View", "bin_means", "telling_view", "views_of"]

Array = NDArray[np.float64]

BINS = 15
"""Equally filled bins a residual is averaged in. Chosen: enough for a kink either side of zero."""

Kind = Literal["against", "cross", "spectrum"]

_VELOCITIES = frozenset(d.velocity for d in DOFS.values())
_FORCES = frozenset({*(d.force for d in DOFS.values()), "delta", "n"})

_FAMILY: Mapping[str, tuple[tuple[Kind, frozenset[str]], ...]] = {
    "data errors": (("cross", _FORCES), ("against", frozenset({"time"}))),
    "actuator": (("against", _FORCES), ("cross", _FORCES)),
    "hydrodynamics": (("against", _VELOCITIES),),
    "environment": (("against", frozenset({"psi", "time", "x", "y", "z"})), ("spectrum", frozenset({""}))),
    "sensor": (("against", frozenset({"psi", "time"}) | _VELOCITIES),),
}
"""Where each family of effects usually shows."""

_WORDS: tuple[tuple[str, Kind, frozenset[str]], ...] = (
    (r"command|input|thrust|rudder", "against", _FORCES),
    (r"against heading|with (the )?heading", "against", frozenset({"psi"})),
    (r"speed|rate\b|velocit", "against", _VELOCITIES),
    (r"\btime\b|drift", "against", frozenset({"time"})),
    (r"position", "against", frozenset({"x", "y", "z"})),
    (r"spectr|frequen|narrow|peak", "spectrum", frozenset({""})),
    (r"correlat|delay|\blate\b|\blag", "cross", _FORCES | _VELOCITIES),
)
"""What an effect's ``shown_by`` speaks of, and where that is drawn."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One way to look at one signal's residual; ``name`` the channel, empty for a spectrum.

    ``share``: of the residual's variance, how much this view accounts for (0: nothing, 1: all of it).
    """

    kind: Kind
    portrait: Portrait
    name: str
    share: float


def bin_means(x: Array, y: Array, bins: int = BINS) -> tuple[Array, Array, Array, Array]:
    """Return centre, mean, standard error and count (k,) of *y* in equally filled bins of *x*; k <= bins."""
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, bins + 1)))
    place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, max(len(edges) - 2, 0))
    used = np.unique(place)
    groups = [place == k for k in used]
    count = np.array([np.count_nonzero(g) for g in groups], dtype=np.float64)
    centre = np.array([x[g].mean() for g in groups])
    mean = np.array([y[g].mean() for g in groups])
    error = np.array([y[g].std() for g in groups]) / np.sqrt(np.maximum(count - 1.0, 1.0))
    return centre, mean, error, count


def views_of(portrait: Portrait) -> Iterator[View]:
    """Yield every view a portrait has data for."""
    for name, (x, y, _) in portrait.against.items():
        keep = np.isfinite(x) & np.isfinite(y)
        if np.count_nonzero(keep) > 2 * BINS and np.ptp(x[keep]) > 0.0:
            yield View("against", portrait, name, _explained(_folded(name, x[keep]), y[keep]))
    for name, (_, rho) in portrait.cross.items():
        if len(rho) > 1:
            floor = portrait.limit**2 if np.isfinite(portrait.limit) else 0.0
            yield View("cross", portrait, name, max(float(np.nanmax(rho**2)) - floor, 0.0))
    if portrait.spectrum is not None and len(portrait.spectrum[0]) > 8:
        yield View("spectrum", portrait, "", _peak(*portrait.spectrum))


def _folded(name: str, x: Array) -> Array:
    """Return headings as they stand on a compass; all else unchanged."""
    return x % (2.0 * np.pi) if name == "psi" else x


def _explained(x: Array, y: Array) -> float:
    """Return the share of the mean square of *y* that its means over bins of *x* account for, less what luck gives."""
    _, mean, _, count = bin_means(x, y)
    total = float(np.mean(y**2))
    if total <= 0.0 or len(y) <= len(mean):
        return 0.0
    plain = float(np.sum(count * mean**2)) / len(y) / total
    return max(1.0 - (1.0 - plain) * len(y) / (len(y) - len(mean)), 0.0)


def _peak(frequency: Array, power: Array) -> float:
    """Return the share of power within a tenth of the strongest frequency, beyond what an even spread gives."""
    total = float(np.nansum(power))
    if total <= 0.0:
        return 0.0
    near = np.abs(frequency - frequency[int(np.nanargmax(power))]) <= 0.1 * frequency[int(np.nanargmax(power))]
    return max(float(np.nansum(power[near])) / total - float(np.mean(near)), 0.0)


def telling_view(portraits: Sequence[Portrait], effect: Effect | None = None, place: str = "") -> View | None:
    """Return the view that shows most, preferring where an effect of this kind at this place usually shows."""
    best: tuple[float, View] | None = None
    for portrait in portraits:
        for view in views_of(portrait):
            weight = view.share * (1.0 if effect is None else _fit(view, effect, place))
            if best is None or weight > best[0]:
                best = weight, view
    return None if best is None else best[1]


def _fit(view: View, effect: Effect, place: str) -> float:
    """Return how much a view is what one would look at: by family, the effect's own words and its place."""
    weight = 1.0
    if any(view.kind == kind and view.name in names for kind, names in _FAMILY[effect.family]):
        weight += 1.0
    if any(view.kind == k and view.name in names and re.search(w, effect.shown_by) for w, k, names in _WORDS):
        weight += 2.0
    parts = place.split("+")
    if view.name in parts:
        weight += 1.0
    touched = {
        s
        for d in DOFS.values()
        for s in (d.velocity, d.position)
        if {d.name, d.force, d.velocity, d.position} & {*parts}
    }
    return weight * (2.0 if view.portrait.signal in touched or view.portrait.signal in parts else 1.0)
