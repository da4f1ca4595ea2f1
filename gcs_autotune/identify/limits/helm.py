"""The form's inputs as thrust, steering and the rest, within what the runs have used.

Whatever the channels are (thrust and moment, a rudder, a pair of thrusters), a manoeuvre asks for shares of full force
per equation; this turns them into channel values that never exceed those seen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.coupled.record import CoupledRecord
from gcs_autotune.models.coupled import Form
from gcs_autotune.models.coupled.derivatives import FORCES

__all__ = ["ROLES", "Helm", "helm_of"]

Array = NDArray[np.float64]

ROLES: Mapping[str, str] = {"N": "steer", "X": "thrust", "Z": "heave", "Y": "sway", "K": "roll", "M": "pitch"}
"""Force letter -> role. In this order roles are given to channels: a rudder, which also pushes sideways, steers."""


@dataclass(frozen=True, slots=True, eq=False)
class Helm:
    """``columns[role]`` (m,): channel values of a role at full share; ``low``, ``high`` (m,) what may be commanded."""

    channels: tuple[str, ...]
    columns: Mapping[str, Array]
    low: Array
    high: Array

    def inputs(self, shares: Mapping[str, float]) -> Array:
        """Return channel values (m,) for shares in -1..1 per role; together they stay within the limits."""
        total = np.zeros(len(self.channels))
        for role, share in shares.items():
            total += share * self.columns[role]
        held: Array = np.clip(total, self.low, self.high)
        return held


def helm_of(form: Form, theta: Array, records: Sequence[CoupledRecord]) -> Helm:
    """Return the helm of a form whose gains have the values *theta*, limited to the inputs of *records*.

    A channel that drives surge and was never negative stays so; any other may go to both sides.

    Raises
    ------
    NotInformative
        No input was ever used.
    """
    used = np.vstack([r.inputs for r in records])
    most = np.abs(used).max(axis=0)
    if not np.any(most > 0.0):
        raise NotInformative("no input was ever used in these runs: there is nothing to take the next one's size from")
    gains = _gains(form, theta)
    ahead_only = (gains[FORCES.index("X")] != 0.0) & (used.min(axis=0) >= 0.0)
    chosen: list[str] = []
    rows: list[Array] = []
    for letter in ROLES:
        row = gains[FORCES.index(letter)] * (most > 0.0)
        if not row.any():
            continue
        row = row / np.linalg.norm(row)
        if np.linalg.matrix_rank(np.array([*rows, row]), tol=1e-6) > len(rows):
            chosen.append(ROLES[letter])
            rows.append(row)
    columns = {}
    for role, column in zip(chosen, np.linalg.pinv(np.array(rows)).T, strict=True):
        busy = np.abs(column) > 1e-12
        columns[role] = column * float(np.min(most[busy] / np.abs(column[busy])))
    return Helm(tuple(form.inputs), columns, np.where(ahead_only, 0.0, -most), most)


def _gains(form: Form, theta: Array) -> Array:
    """Return the force per channel value (6, m); a derivative with more factors (``N_uudelta``) counts by its sign."""
    gains = np.zeros((6, len(form.inputs)))
    named = {g.lstrip("-") for pairs in form.inputs.values() for _, g in pairs if isinstance(g, str)}
    for j, (channel, pairs) in enumerate(form.inputs.items()):
        for force, gain in pairs:
            row = FORCES.index(force)
            if isinstance(gain, str):
                value = float(theta[form.parameters.index(gain.lstrip("-"))])
                gains[row, j] += -value if gain.startswith("-") else value
            else:
                gains[row, j] += gain
        for name, value in zip(form.parameters, theta.tolist(), strict=True):
            if name not in named and name[0] in FORCES and name[1:2] == "_" and name[2:].endswith(channel):
                gains[FORCES.index(name[0]), j] += value
    return gains
