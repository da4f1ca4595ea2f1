"""Compare commands with outputs, if a run contains both: ``N_ref`` and ``N``, or ``delta_ref`` and ``delta``.

An output follows its command with delay, at a limited rate and within its limits. Only an output that is constant, has
the opposite sign, is unrelated, or always has another size is therefore reported as a contradiction.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.crosscheck.contradiction import Contradiction
from gcs_autotune.trial import Channel, Trial

__all__ = ["command_contradictions"]

Array = NDArray[np.float64]

OUTPUTS = ("X", "Y", "Z", "K", "M", "N", "delta", "n")
SUFFIXES = ("_ref", "_cmd", "_command", "_set", "_c")
LATEST = 10.0
"""Longest delay [s] of an output that is tried.

Project choice: a ship's rudder may take that long from one side to the other.
"""
CHANGES = 4
"""Minimum number of changes of a command for a comparison. Project choice."""
FOLLOWS, APART, STILL = 0.85, 0.4, 0.1
"""Limits for the comparison of an output with its command. Project choice.

- ``FOLLOWS``: least correlation of an output that follows its command.
- ``APART``: largest correlation of an output that does not follow its command.
- ``STILL``: scatter of an output, relative to that of its command, below which the output counts as constant.
"""
FACTOR = 0.25
"""Ratio of output to command below which rate limits do not explain the difference. Project choice."""
LEAST = 0.02
"""Least scatter of a command for a comparison [fraction of full output or rad]. Project choice."""


def command_contradictions(trial: Trial) -> Iterator[Contradiction]:
    """Yield one contradiction for every output of *trial* that does not follow its command."""
    for output in OUTPUTS:
        command = next((f"{output}{s}" for s in SUFFIXES if f"{output}{s}" in trial), None)
        if output in trial and command is not None:
            found = _compared(trial.name, trial[command], trial[output])
            if found is not None:
                yield found


def _compared(run: str, command: Channel, output: Channel) -> Contradiction | None:
    if len(command) < CHANGES or len(output) < CHANGES:
        return None
    start, end = max(command.t[0], output.t[0]), min(command.t[-1], output.t[-1])
    step = max(float(np.median(np.diff(output.t))), (end - start) / 20000.0)
    if not (end - start > 20.0 * step > 0.0):
        return None
    grid = np.arange(start, end, step)
    commanded, came = _held(command, grid), _held(output, grid)
    if np.std(commanded) < LEAST or int(np.count_nonzero(np.diff(commanded))) < CHANGES:
        return None
    pair = f"{output.name} against {command.name}"
    columns = (output.name, command.name)
    same_unit = command.unit == output.unit
    if np.std(came) == 0.0 or (same_unit and np.std(came) < STILL * np.std(commanded)):
        cause = (
            f"{output.name} does not change while {command.name} does (run '{run}'). {output.name} is more likely wrong"
        )
        cure = "check the servo, its power and linkage, SERVOn_FUNCTION and the safety switch"
        return Contradiction(pair, "still", 0.0, 0.0, output.name, columns, cause, _used(cure, command.name))
    lags = np.unique(np.round(np.linspace(0.0, min(LATEST, 0.2 * (end - start)), 60) / step)).astype(int)
    cosines = [_correlation(commanded[: len(commanded) - k], came[k:]) for k in lags]
    best = int(np.argmax(np.abs(cosines)))
    negative = cosines[0] < -APART and -cosines[0] > 0.9 * max(cosines)
    k = int(lags[0 if negative else best])
    rho = cosines[0 if negative else best]
    a, b = commanded[: len(commanded) - k], came[k:]
    factor = float(np.std(b) / np.std(a)) * math.copysign(1.0, rho)
    std = abs(factor) * math.sqrt(max(1.0 - rho**2, 0.0) / max(int(np.count_nonzero(np.diff(commanded))), 1))
    if rho < -FOLLOWS or (negative and rho < -FOLLOWS + 0.15):
        cause = f"{output.name} moves in the opposite direction to its command {command.name} (run '{run}')"
        cure = "check SERVOn_REVERSED, RCn_REVERSED and the sign of both columns"
        return Contradiction(pair, "sign", factor, std, "", columns, cause, _used(cure, ""))
    if max(map(abs, cosines)) < APART:
        cause = f"{output.name} does not follow {command.name} (run '{run}')"
        cure = "check SERVOn_FUNCTION, and that no other station was steering"
        return Contradiction(pair, "unrelated", math.nan, math.nan, "", columns, cause, _used(cure, ""))
    if same_unit and rho > 0.95 and abs(math.log(abs(factor))) > math.log1p(FACTOR):
        size = f"{factor:.2g} times as far as {command.name} commands (+- {max(std, 0.01):.1g})"
        cause = f"{output.name} moves {size} (run '{run}')"
        cure = "check SERVOn_MIN, TRIM and MAX, and the units of both columns"
        return Contradiction(pair, "factor", factor, std, "", columns, cause, _used(cure, ""))
    return None


def _held(channel: Channel, grid: Array) -> Array:
    good = np.isfinite(channel.values)
    t, values = channel.t[good], channel.values[good]
    found: Array = values[np.clip(np.searchsorted(t, grid, side="right") - 1, 0, len(t) - 1)]
    return found


def _correlation(a: Array, b: Array) -> float:
    a, b = a - a.mean(), b - b.mean()
    size = math.sqrt(float(a @ a) * float(b @ b))
    return float(a @ b) / size if size > 0.0 else 0.0


def _used(cure: str, right: str) -> str:
    wrong = f"identify from {right} instead" if right else "omit the wrong column"
    return f"{cure}. Until then {wrong} (--columns)"
