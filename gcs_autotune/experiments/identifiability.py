"""Identifiability: groups of correlated parameters, poorly identifiable parameters, and sentences about them.

The root of the information matrix, with columns scaled to length one, is decomposed into singular values and vectors. A
value of zero is a joint change without any effect on the measured signals. Such a change is *exact*: it is due to the
model, the inputs or the signals, and does not depend on noise. A singular value below ``1/TOGETHER`` indicates a group
whose members can replace one another ("collinearity index" above 10: Brun2001, (11)). The group is reported if the
change within the noise is relevant. A parameter whose standard error exceeds its value is *poorly identifiable*.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.experiments.preview import ManoeuvringRoom, room_of_runs
from gcs_autotune.experiments.scales import Scales, scales_of
from gcs_autotune.identify import Doubt, Fit, Model
from gcs_autotune.identify.problems import BLIND, FittedModel, Information, fitted_model_of, information_on
from gcs_autotune.models import STATES, inertia_of
from gcs_autotune.notebook import Displayed
from gcs_autotune.rounding import HALF_WIDTH
from gcs_autotune.sname import SIGNALS
from gcs_autotune.trial import Trial

__all__ = [
    "SLUG",
    "Direction",
    "Identifiability",
    "Unseen",
    "check_identifiability",
    "direction_doubt",
    "identifiability",
    "joined",
    "percent",
    "unseen_doubt",
]


@dataclass(frozen=True, slots=True)
class Direction:
    """A joint change of parameters with little or no effect on the measured signals.

    - ``derivatives``: SNAME names of the members.
    - ``changes``: change of each member relative to its value (0.4: 40 % larger in magnitude). For a practical
      direction they are within 95 % of the noise. For an ``exact`` direction only their ratios matter.
    - ``scaling``: whether all members change by the same factor.
    """

    members: tuple[str, ...]
    derivatives: tuple[str, ...]
    changes: Mapping[str, float]
    exact: bool
    scaling: bool


@dataclass(frozen=True, slots=True)
class Unseen:
    """A parameter whose standard error exceeds its value.

    - ``derivative``: SNAME name of the parameter.
    - ``slight``: whether the force of the parameter is negligible in these runs.
    """

    name: str
    derivative: str
    value: float
    std: float
    unit: str
    slight: bool


SLUG = "cannot-tell"

_HUGE = 10.0
"""Relative change above which words replace the number."""


def direction_doubt(direction: Direction, seen: ManoeuvringRoom) -> Doubt:
    """Return a doubt about parameters that cannot be identified separately."""
    names = joined(direction.members)
    if direction.scaling:
        return Doubt(
            SLUG,
            f"multiplying {names} by a common factor leaves the motion unchanged",
            "no manoeuvre distinguishes them. Weigh the craft or measure a bollard pull, and supply one value with "
            "--known",
        )
    if direction.exact and len(direction.members) == 1:
        return Doubt(
            SLUG, f"the motion in {_here(seen)} does not depend on {names}", _cure(direction.derivatives, seen)
        )
    if direction.exact:
        cause = f"{_here(seen)} cannot distinguish {names}: {_exchange(direction)} changes no measurement"
        return Doubt(SLUG, cause, _cure(direction.derivatives, seen))
    cause = f"{names} are strongly correlated in {_here(seen)}: {_exchange(direction)} stays within the noise"
    return Doubt(SLUG, cause, _cure(_leading(direction), seen))


def unseen_doubt(unseen: Unseen, seen: ManoeuvringRoom) -> Doubt:
    """Return a doubt about a parameter whose standard error exceeds its value."""
    size = f"{unseen.value:.2g} ± {percent(unseen.std / abs(unseen.value))}" if unseen.value else "zero"
    why = _why(unseen.derivative, seen)
    if math.isinf(unseen.std):
        return Doubt(
            SLUG, f"{unseen.name} is not identifiable from {_here(seen)}{why}", _cure((unseen.derivative,), seen)
        )
    if unseen.slight:
        return Doubt(
            SLUG,
            f"{unseen.name} is poorly identifiable from {_here(seen)} ({size}){why}: its force is negligible",
            f"omit {unseen.name} for motion like this, or {_cure((unseen.derivative,), seen)}",
        )
    return Doubt(
        SLUG,
        f"{unseen.name} is poorly identifiable from {_here(seen)} ({size}){why}",
        _cure((unseen.derivative,), seen),
    )


def joined(names: Sequence[str]) -> str:
    """Return the words in *names* as a list in a sentence, such as ``a, b and c``."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def percent(share: float) -> str:
    """Return the fraction *share* as text: in percent with two digits, or as a factor above ten."""
    if math.isinf(share):
        return "any amount"
    if abs(share) >= _HUGE:
        return f"{share:.0f} times"
    return f"{100.0 * share:.{0 if abs(share) >= 0.095 else 1}f} %"


def _here(seen: ManoeuvringRoom) -> str:
    return f"this {seen.kind}"


def _leading(direction: Direction) -> tuple[str, ...]:
    """Return the SNAME names of the members that change most, at least two."""
    changes = [abs(direction.changes[n]) for n in direction.members]
    floor = min(0.3 * max(changes), sorted(changes)[-2])
    return tuple(d for d, c in zip(direction.derivatives, changes, strict=True) if c >= floor)


def _exchange(direction: Direction) -> str:
    up = [n for n in direction.members if direction.changes[n] > 0.0]
    down = [n for n in direction.members if direction.changes[n] < 0.0]
    shown = {n: abs(c) for n, c in direction.changes.items()}
    if direction.exact:
        most = max(shown.values())
        shown = {n: 0.1 * c / most for n, c in shown.items()}
    grow = joined([f"{n} by {percent(shown[n])}" for n in up])
    if not down:
        return f"raising {grow}"
    return f"raising {grow} and lowering {joined([f'{n} by {percent(shown[n])}' for n in down])}"


def _letters(derivative: str) -> set[str]:
    """Return the velocities a derivative multiplies."""
    rest = re.sub(r"^[XYZKMN]_", "", derivative).removesuffix("dot")
    return {c for c in rest if c in STATES} if "_" in derivative and rest != "0" else set()


def _why(derivative: str, seen: ManoeuvringRoom) -> str:
    parts = []
    for letter in sorted(_letters(derivative), key=STATES.index):
        if letter in seen.largest:
            value, unit = seen.largest[letter], SIGNALS[letter][0]
            if "rad" in unit:
                value, unit = math.degrees(value), unit.replace("rad", "deg")
            parts.append(f"{SIGNALS[letter][1].removesuffix(' velocity')} stays below {_above(value)} {unit}")
    return f": {joined(parts)}" if parts else ""


def _above(value: float) -> str:
    """Return *value* rounded up to two digits."""
    if value <= 0.0:
        return "0"
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return f"{math.ceil(value / step - 1e-9) * step:.2g}"


def _cure(derivatives: Sequence[str], seen: ManoeuvringRoom) -> str:
    letters = set().union(*(_letters(d) for d in derivatives))
    inertia = any("_" in d and inertia_of(d) is not None for d in derivatives)
    lines = {re.sub(r"dot$", "", d) for d in derivatives}
    squares = {d for d in derivatives if re.search(r"_([uvwpqr])\|?\1$|_\|([uvwpqr])\|\2$", d)}
    if {"delay", "lag"} & set(derivatives):
        return "switch the input more often and record it and the motion at a higher rate"
    if {"v", "r"} <= letters and seen.kind != "zig-zag":
        return "fly a zig-zag, in which sway velocity and yaw rate change out of phase"
    if {"v", "r"} <= letters:
        return "fly turns of different radius at different speeds"
    if any(d.endswith("_0") for d in lines):
        return "fly the same manoeuvre to both sides, to distinguish a constant force from drag"
    if squares and len(derivatives) > 1 and not inertia and letters & {"v", "r"}:
        return "fly gentle and tight turns, to distinguish linear and quadratic drag"
    if squares and len(derivatives) > 1 and not inertia:
        return (
            "fly at clearly different speeds and coast down from the fastest, to distinguish linear and quadratic drag"
        )
    if inertia and len(derivatives) > 1:
        return "fly steps and reversals faster than the craft settles, to distinguish inertia and drag"
    if letters & {"v", "r"}:
        return "fly a zig-zag or tight turns at higher speed" if seen.kind != "zig-zag" else "fly tighter turns, faster"
    if letters & {"u"}:
        return "fly throttle steps up to full speed and coast down"
    return "excite this motion by steps or pulses of its main input"


Array = NDArray[np.float64]

TOGETHER = 10.0
"""Collinearity index above which parameters count as a group. Brun2001 states 10 to 15."""

MATTERS = 0.2
"""Joint change, relative to the parameters' sizes, that must be possible within the noise for a group to be reported.

Project choice.
"""

MEMBER = 0.05
"""Smallest change, relative to the largest in its group, of a parameter that is listed as a member. Project choice."""


@dataclass(frozen=True, slots=True, eq=False)
class Identifiability(Displayed):
    """Identifiability of a fit's parameters from runs.

    - ``relative`` (p,): standard errors divided by sizes (see :mod:`.scales`).
    - ``directions``: joint changes with little effect, the least identifiable first.
    """

    information: Information
    scales: Scales
    seen: ManoeuvringRoom
    relative: Array
    directions: tuple[Direction, ...]
    unseen: tuple[Unseen, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the fitted parameters."""
        return self.information.names

    @property
    def correlation(self) -> Array:
        """Correlation matrix (p, p) of an efficient estimate from these runs."""
        return self.information.correlation

    @property
    def doubts(self) -> tuple[Doubt, ...]:
        """The result as doubts, one for each group and one for each poorly identifiable parameter (slug
        ``cannot-tell``).
        """
        groups = [direction_doubt(d, self.seen) for d in self.directions]
        return (*groups, *(unseen_doubt(u, self.seen) for u in self.unseen))


def identifiability(fit: Fit[Model], trials: Trial | Sequence[Trial]) -> Identifiability:
    """Return the identifiability of the parameters of *fit* from *trials*.

    Raises
    ------
    UsageError, NotInformative
        Exceptions are those of :func:`gcs_autotune.identify.problems.information.fitted_model_of`.
    """
    return check_identifiability(fitted_model_of(fit, trials))


def check_identifiability(subject: FittedModel) -> Identifiability:
    """Return the identifiability of the fitted parameters of *subject* from its runs."""
    information = information_on(subject)
    scales = scales_of(subject)
    seen, _ = room_of_runs(subject)
    std = information.std
    relative = std / scales.size
    directions = (*_exact(subject, information, scales), *_practical(subject, information, scales))
    unseen = _unseen(subject, information, scales, std, {n for d in directions if d.exact for n in d.members})
    return Identifiability(information, scales, seen, relative, directions, unseen)


def _exact(subject: FittedModel, information: Information, scales: Scales) -> tuple[Direction, ...]:
    """Return the joint changes without effect, each with as few members as possible."""
    sigma, vectors, seen = information.modes()
    null = vectors[:, sigma <= BLIND]
    if not null.shape[1]:
        return ()
    alone = np.where(seen, information.alone, 0.0)
    basis = _sparse((null * alone[:, None] / scales.size[:, None]).T)
    directions = []
    for row in basis:
        members = np.flatnonzero(np.abs(row) > 1e-4 * np.abs(row).max())
        by_value = row * scales.size / np.where(information.values != 0.0, information.values, math.inf)
        common = by_value[members[0]]
        together = bool(len(members) > 1 and common != 0.0 and np.allclose(by_value[members], common, rtol=1e-3))
        directions.append(_direction(subject, members, _changes(information, scales, row, members), True, together))
    return tuple(directions)


def _practical(subject: FittedModel, information: Information, scales: Scales) -> tuple[Direction, ...]:
    """Return the joint changes that the noise permits, worst first.

    Singular vectors of similar singular values may be mixed. They are recombined so that each has few members.
    """
    sigma, vectors, seen = information.modes()
    alone = np.where(seen, information.alone, 0.0)
    open_to = HALF_WIDTH * vectors * alone[:, None] / (np.maximum(sigma, BLIND) * scales.size[:, None])
    weak = (sigma > BLIND) & (sigma < 1.0 / TOGETHER) & (np.abs(open_to).max(axis=0) > MATTERS)
    if not weak.any():
        return ()
    found = []
    for row in _sparse((vectors[:, weak] * alone[:, None] / scales.size[:, None]).T):
        change = HALF_WIDTH * row / float(np.linalg.norm(information.root @ (row * scales.size)))
        members = np.flatnonzero(np.abs(change) >= MEMBER * np.abs(change).max())
        if len(members) < 2 or np.abs(change).max() < MATTERS:
            continue
        members = members[np.argsort(-np.abs(change[members]), kind="stable")]
        changes = _changes(information, scales, change, members)
        found.append((float(np.abs(change).max()), _direction(subject, members, changes, False, False)))
    return tuple(d for _, d in sorted(found, key=lambda pair: -pair[0]))


def _direction(
    subject: FittedModel, members: NDArray[np.int64], changes: Mapping[str, float], exact: bool, scaling: bool
) -> Direction:
    names, own = (tuple(whole[i] for i in members) for whole in (subject.names, subject.free))
    return Direction(names, own, changes, exact, scaling)


def _changes(
    information: Information, scales: Scales, relative: Array, members: NDArray[np.int64]
) -> Mapping[str, float]:
    """Return each member's change relative to its value, if it has a noticeable one; the first one increases."""
    values = information.values
    share = relative * scales.size / np.where(np.abs(values) >= 0.5 * scales.size, values, scales.size)
    sign = -1.0 if share[members[0]] < 0.0 else 1.0
    return {information.names[i]: float(sign * share[i]) for i in members}


def _sparse(basis: Array) -> Array:
    """Return another basis (d, p) of the same space, in reduced form: every row has a parameter of its own."""
    rows = basis / np.abs(basis).max(axis=1, keepdims=True)
    free = list(range(len(rows)))
    for _ in range(len(rows)):
        block = np.abs(rows[free])
        i, j = np.unravel_index(int(block.argmax()), block.shape)
        pivot = free.pop(int(i))
        rows[pivot] /= rows[pivot, j]
        for other in range(len(rows)):
            if other != pivot:
                rows[other] -= rows[other, j] * rows[pivot]
        if not free:
            break
    result: Array = np.where(np.abs(rows) < 1e-7, 0.0, rows)
    return result


def _unseen(
    subject: FittedModel, information: Information, scales: Scales, std: Array, reported: set[str]
) -> tuple[Unseen, ...]:
    """Return the parameters whose standard error exceeds their value, except those already *reported*."""
    found = []
    for i, (name, own) in enumerate(zip(subject.names, subject.free, strict=True)):
        if own.endswith("_0") and std[i] <= scales.felt[i]:
            continue  # a constant force of about zero is an answer
        value = float(information.values[i])
        if std[i] > abs(value) and name not in reported:
            slight = bool(std[i] <= scales.felt[i])
            found.append(Unseen(name, own, value, float(std[i]), subject.units[i], slight))
    return tuple(found)
