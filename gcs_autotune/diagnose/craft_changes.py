"""Compare two identifications of a craft: changes of inertia, drag, thrust and trim.

If the input is a command, a model contains inertia and drag per thrust. More mass raises only the inertia, and fouling
only the drag. A weaker thruster raises both in proportion. Trim changes the constant force. Generalised least squares
with both covariances finds the single change that explains all differences. If no single change does, pairs of changes
are tried.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.chi_square import threshold
from gcs_autotune.effects import effect_words
from gcs_autotune.errors import UsageError
from gcs_autotune.identify import AxisFit
from gcs_autotune.notebook import Displayed
from gcs_autotune.rounding import format_number

__all__ = ["CHANGES", "RUN_SPREAD", "CraftChange", "CraftComparison", "compare_craft"]

Array = NDArray[np.float64]

FALSE_ALARM = 0.01
"""Probability, per comparison, of reporting an unchanged craft as changed."""
LEAST_KNOWN = 0.5
"""Standard error of the logarithm of a number above which the number counts as unknown."""
RUN_SPREAD = 0.02
"""Standard deviation of the usual difference between two runs of an unchanged craft (water, load, battery).

It applies to logarithms of inertia and drag, and to trim relative to the force. Standard errors include noise only.
"""


@dataclass(frozen=True, slots=True)
class CraftChange:
    """One kind of change of a craft, as its effect on (ln inertia, ln drag, trim).

    ``slug``: the corresponding effect in a diagnosis.
    """

    name: str
    direction: tuple[float, float, float]
    slug: str
    more: str
    less: str


CHANGES: Sequence[CraftChange] = (
    CraftChange("inertia", (1.0, 0.0, 0.0), "mass-change", "payload added, or flooding", "payload removed"),
    CraftChange("drag", (0.0, 1.0, 0.0), "linear-drag", "fouled hull, or something in tow", "hull cleaned"),
    CraftChange(
        "thrust", (-1.0, -1.0, 0.0), "gain-drift", "stronger thruster, fuller battery", "weak thruster, flat battery"
    ),
    CraftChange(
        "trim",
        (0.0, 0.0, 1.0),
        "input-bias",
        "larger constant force in the positive direction",
        "larger constant force in the negative direction",
    ),
)


@dataclass(frozen=True, slots=True)
class CraftComparison(Displayed):
    """Comparison of a fit with the reference fit of the same motion.

    Attributes
    ----------
    ratios : inertia and drag as multiples of the reference's, with standard errors. Trim is a change of the constant
        force [input unit]. Quantities that one of the fits does not determine are omitted.
    changed : whether the fits differ by more than noise explains.
    causes : the changes that explain the difference, each with its size (a factor; trim: a change of force [input
        unit]).
    outside : the ``ratios`` that are outside their own interval.
    """

    dof: str
    used: tuple[str, ...]
    ratios: Mapping[str, tuple[float, float]]
    changed: bool
    causes: tuple[tuple[CraftChange, float], ...]
    outside: tuple[str, ...]

    @property
    def summary(self) -> str:
        """Return a summary of the comparison in one sentence."""
        if not self.changed:
            alone = f", although {' and '.join(self.outside)} alone would be outside the 99 % interval"
            return f"no change found{alone if self.outside else ''}"
        if not self.causes:
            return f"different ({', '.join(self.outside) or 'all together'}). No single cause explains the difference"
        return " and ".join(_change_words(change, size) for change, size in self.causes)

    def to_dict(self) -> dict[str, object]:
        """Return the comparison as plain data for a JSON file."""
        return {
            "dof": self.dof,
            "used": list(self.used),
            "changed": self.changed,
            "outside": list(self.outside),
            "ratios": {n: {"value": v, "std": s} for n, (v, s) in self.ratios.items()},
            "causes": [{"name": c.name, "effect": c.slug, "size": size} for c, size in self.causes],
            "told": self.summary,
        }


def _change_words(change: CraftChange, size: float) -> str:
    """Return the number that changed and its size, with causes that would have this effect."""
    if change.name == "trim":
        return (
            f"trim by {size:+.3g} ({change.more if size > 0.0 else change.less}; effect: {effect_words(change.slug)})"
        )
    example = change.more if size > 1.0 else change.less
    return f"{change.name} x {format_number(size, 3)} (for example: {example}; effect: {effect_words(change.slug)})"


NAMES = ("inertia", "drag", "trim")


def compare_craft(reference: AxisFit, now: AxisFit) -> CraftComparison:
    """Return the comparison of the fit *now* with the fit *reference*. Drag is compared at a speed that both reached.

    Raises
    ------
    UsageError
        The fits are of different motions, or of inputs in different units.
    """
    if (reference.dof, reference.model.input_unit) != (now.dof, now.model.input_unit):
        raise UsageError(
            f"cannot compare a model of {reference.dof} [{reference.model.input_unit}] with one of {now.dof} "
            f"[{now.model.input_unit}]. Compare fits of the same axis and input unit"
        )
    speed = min(_speed(reference), _speed(now))
    scale = reference.model.equivalent_drag(speed) * speed or 1.0
    (y_0, C_0), (y_1, C_1) = (_numbers(f, speed, scale) for f in (reference, now))
    y, C = y_1 - y_0, C_0 + C_1 + RUN_SPREAD**2 * np.eye(3)
    known = np.array([math.isfinite(v) and math.isfinite(c) for v, c in zip(y, np.diag(C), strict=True)])
    known &= np.sqrt(np.where(known, np.diag(C), 0.0)) < LEAST_KNOWN
    index = np.flatnonzero(known)
    weight = np.asarray(np.linalg.inv(C[np.ix_(index, index)]), dtype=np.float64)
    left = float(y[index] @ weight @ y[index]) if len(index) else 0.0
    changed = len(index) > 0 and left > threshold(FALSE_ALARM, len(index))
    std = np.sqrt(np.diag(C))
    limit = math.sqrt(threshold(FALSE_ALARM / max(len(index), 1), 1))
    ratios = {
        NAMES[i]: (scale * y[i], scale * std[i]) if i == 2 else (math.exp(y[i]), math.exp(y[i]) * std[i]) for i in index
    }
    return CraftComparison(
        now.dof,
        now.used,
        {n: (float(v), float(s)) for n, (v, s) in ratios.items()},
        changed,
        _causes(y[index], weight, index, scale) if changed else (),
        tuple(NAMES[i] for i in index if abs(y[i]) > limit * std[i]),
    )


def _speed(fit: AxisFit) -> float:
    """Return a typical size of the velocity [m/s or rad/s] in the runs of *fit*."""
    own = fit.model.axis
    seen = [t.measured for t in fit.traces if t.signal == own.velocity]
    seen += [np.gradient(t.fitted, t.t) for t in fit.traces if t.signal == own.position and len(t.t) > 2]
    return float(np.median([np.sqrt(np.mean(s**2)) for s in seen])) if seen else 0.0


def _numbers(fit: AxisFit, speed: float, scale: float) -> tuple[Array, Array]:
    """Return (ln inertia, ln drag, constant force relative to *scale*) with their covariance (3, 3)."""
    m, P = fit.model, fit.craft_covariance[:4, :4]
    drag, slope = m.equivalent_drag(speed), 8.0 / (3.0 * math.pi) * abs(speed)
    if not (m.alpha > 0.0 and drag > 0.0):
        return np.full(3, np.nan), np.full((3, 3), np.nan)
    J = np.array([[1 / m.alpha, 0, 0, 0], [0, 1 / drag, slope / drag, 0], [0, 0, 0, 1 / scale]], dtype=np.float64)
    return np.array([math.log(m.alpha), math.log(drag), m.delta / scale]), J @ P @ J.T


def _causes(y: Array, weight: Array, index: NDArray[np.intp], scale: float) -> tuple[tuple[CraftChange, float], ...]:
    """Return the smallest set of changes that explains *y*; empty if even two changes do not.

    Of several sets of that size, the one that fits best is returned.
    """
    usable = [c for c in CHANGES if np.any(np.array(c.direction)[index])]
    for count in (1, 2):
        best: tuple[float, tuple[CraftChange, ...], Array] | None = None
        for chosen in itertools.combinations(usable, count):
            H = np.array([np.array(c.direction)[index] for c in chosen]).T
            if np.linalg.matrix_rank(H) < count:
                continue
            size = np.linalg.solve(H.T @ weight @ H, H.T @ weight @ y)
            rest = y - H @ size
            left = float(rest @ weight @ rest)
            if best is None or left < best[0]:
                best = left, chosen, size
        freedom = len(index) - count
        if best is not None and (freedom == 0 or best[0] < threshold(FALSE_ALARM, freedom)):
            return tuple(
                (c, float(scale * s if c.name == "trim" else math.exp(s)))
                for c, s in zip(best[1], best[2], strict=True)
            )
    return ()
