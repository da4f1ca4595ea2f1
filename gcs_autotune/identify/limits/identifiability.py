"""What runs cannot tell: parameters that move together, and parameters they hardly see.

The root of the information, its columns scaled to length one, is decomposed into singular values and vectors. A value
of zero is a joint change the measured signals do not answer to at all (*exact*: a matter of the model, the inputs or
the signals, whatever the noise). A value below ``1/TOGETHER`` is a group whose members could stand in for one another
("collinearity index" above 10: Brun2001, (11)); it is reported when
the change the noise leaves open matters. A parameter whose standard error exceeds its value is *hardly seen*.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.limits.findings import Direction, Unseen
from gcs_autotune.identify.limits.information import BLIND, Information, information_on
from gcs_autotune.identify.limits.reach import Reach, reach_of_runs
from gcs_autotune.identify.limits.scales import Scales, scales_of
from gcs_autotune.identify.limits.subject import Subject, subject_of
from gcs_autotune.identify.limits.words import direction_doubt, unseen_doubt
from gcs_autotune.identify.result import Doubt, Fit
from gcs_autotune.trial import Trial

__all__ = ["Direction", "Identifiability", "Unseen", "identifiability", "look_into"]

Array = NDArray[np.float64]

TOGETHER = 10.0
"""Collinearity index from which parameters count as moving together; Brun et al. name 10 to 15."""

MATTERS = 0.2
"""Joint change, relative to the parameters' size, that must be open within the noise to be reported."""

MEMBER = 0.05
"""Smallest change, relative to the largest in its group, that makes a parameter a member worth naming."""


@dataclass(frozen=True, slots=True, eq=False)
class Identifiability:
    """What runs tell and cannot tell of a fit's parameters.

    ``relative`` (p,) standard errors over sizes (see :mod:`.scales`); ``directions`` worst first.
    """

    information: Information
    scales: Scales
    seen: Reach
    relative: Array
    directions: tuple[Direction, ...]
    unseen: tuple[Unseen, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """The fitted parameters."""
        return self.information.names

    @property
    def correlation(self) -> Array:
        """Correlation (p, p) of an efficient estimate from these runs."""
        return self.information.correlation

    @property
    def doubts(self) -> tuple[Doubt, ...]:
        """The same in words: ``cannot-tell`` per group and per unseen parameter."""
        groups = [direction_doubt(d, self.seen) for d in self.directions]
        return (*groups, *(unseen_doubt(u, self.seen) for u in self.unseen))


def identifiability(fit: Fit, trials: Trial | Sequence[Trial]) -> Identifiability:
    """Return what *trials* tell of the fitted parameters of *fit*.

    Raises
    ------
    UsageError, NotInformative
        As :func:`gcs_autotune.identify.limits.subject.subject_of`.
    """
    return look_into(subject_of(fit, trials))


def look_into(subject: Subject) -> Identifiability:
    """Return what the subject's runs tell of its parameters."""
    information = information_on(subject)
    scales = scales_of(subject)
    seen, _ = reach_of_runs(subject)
    std = information.std
    relative = std / scales.size
    directions = (*_exact(subject, information, scales), *_practical(subject, information, scales))
    unseen = _unseen(subject, information, scales, std, {n for d in directions if d.exact for n in d.members})
    return Identifiability(information, scales, seen, relative, directions, unseen)


def _exact(subject: Subject, information: Information, scales: Scales) -> tuple[Direction, ...]:
    """Return the joint changes nothing answers to, each with as few members as possible."""
    sigma, vectors, seen = information.modes()
    null = vectors[:, sigma <= BLIND]
    if not null.shape[1]:
        return ()
    alone = np.where(seen, information.alone, 0.0)
    basis = _sparse((null * alone[:, None] / scales.size[:, None]).T)
    found = []
    for row in basis:
        members = np.flatnonzero(np.abs(row) > 1e-4 * np.abs(row).max())
        by_value = row * scales.size / np.where(information.values != 0.0, information.values, math.inf)
        common = by_value[members[0]]
        together = bool(len(members) > 1 and common != 0.0 and np.allclose(by_value[members], common, rtol=1e-3))
        found.append(_direction(subject, members, _changes(information, scales, row, members), True, together))
    return tuple(found)


def _practical(subject: Subject, information: Information, scales: Scales) -> tuple[Direction, ...]:
    """Return the joint changes the noise leaves open, worst first.

    Weak vectors of like singular values may come mixed; they are recombined so that each has few members.
    """
    sigma, vectors, seen = information.modes()
    alone = np.where(seen, information.alone, 0.0)
    open_to = 1.96 * vectors * alone[:, None] / (np.maximum(sigma, BLIND) * scales.size[:, None])
    weak = (sigma > BLIND) & (sigma < 1.0 / TOGETHER) & (np.abs(open_to).max(axis=0) > MATTERS)
    if not weak.any():
        return ()
    found = []
    for row in _sparse((vectors[:, weak] * alone[:, None] / scales.size[:, None]).T):
        change = 1.96 * row / float(np.linalg.norm(information.root @ (row * scales.size)))
        members = np.flatnonzero(np.abs(change) >= MEMBER * np.abs(change).max())
        if len(members) < 2 or np.abs(change).max() < MATTERS:
            continue
        members = members[np.argsort(-np.abs(change[members]), kind="stable")]
        changes = _changes(information, scales, change, members)
        found.append((float(np.abs(change).max()), _direction(subject, members, changes, False, False)))
    return tuple(d for _, d in sorted(found, key=lambda pair: -pair[0]))


def _direction(
    subject: Subject, members: NDArray[np.int64], changes: Mapping[str, float], exact: bool, scaling: bool
) -> Direction:
    names, own = (tuple(whole[i] for i in members) for whole in (subject.names, subject.free))
    return Direction(names, own, changes, exact, scaling)


def _changes(
    information: Information, scales: Scales, relative: Array, members: NDArray[np.int64]
) -> Mapping[str, float]:
    """Return each member's change relative to its value where it has one of its size, the first one growing."""
    values = information.values
    share = relative * scales.size / np.where(np.abs(values) >= 0.5 * scales.size, values, scales.size)
    sign = -1.0 if share[members[0]] < 0.0 else 1.0
    return {information.names[i]: float(sign * share[i]) for i in members}


def _sparse(basis: Array) -> Array:
    """Return another basis (d, p) of the same space: reduced, so that every row has a parameter of its own."""
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
    subject: Subject, information: Information, scales: Scales, std: Array, told: set[str]
) -> tuple[Unseen, ...]:
    """Return the parameters whose standard error exceeds their value, but for those *told* of already."""
    found = []
    for i, (name, own) in enumerate(zip(subject.names, subject.free, strict=True)):
        if own.endswith("_0") and std[i] <= scales.felt[i]:
            continue  # a constant force of about zero is an answer
        value = float(information.values[i])
        if std[i] > abs(value) and name not in told:
            slight = bool(std[i] <= scales.felt[i])
            found.append(Unseen(name, own, value, float(std[i]), subject.units[i], slight))
    return tuple(found)
