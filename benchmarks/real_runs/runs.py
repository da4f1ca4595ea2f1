"""The craft: their files, training and held-out runs, and model forms."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.trial import Trial, load_trial

__all__ = ["CRAFTS", "DATA", "FIRST", "OUTPUTS", "STEP", "Craft", "Run", "gridded"]

Array = NDArray[np.float64]

DATA = Path(__file__).parents[3] / "shared" / "data"
STEP = 0.1
"""Sampling interval of both data sets [s]."""

FIRST = 10
"""Samples of a held-out run that a method gets: one second."""

OUTPUTS = ("u", "v", "r")


@dataclass(frozen=True, slots=True)
class Craft:
    """A data set: *train* and *held* are file names without ending; *form* a name in ``FORMS``."""

    folder: str
    train: tuple[str, ...]
    held: tuple[str, ...]
    inputs: tuple[str, ...]
    form: str


CRAFTS: Mapping[str, Craft] = {
    "blueboat": Craft(
        "blueboat",
        ("run218", "run220", "run224", "run228", "run230", "run234"),
        ("run225", "run216", "run235"),
        ("force_left", "force_right"),
        "twin-thruster",
    ),
    "kvlcc2": Craft(
        "kvlcc2_hsva",
        ("Z_05_01", "Z_10_05", "Z_20_10_P", "Z_30_05"),
        ("Z_10_01", "Z_10_10_S", "Z_20_05"),
        ("delta",),
        "rudder",
    ),
}
"""Name -> craft. BlueBoat: trained on ahead, pulses, two zig-zags, two turns on the spot; held out one zig-zag (225),
the mixed run (216) and free driving (235). KVLCC2: trained on zig-zags from 5 to 30 deg of rudder; held out
other pairs of rudder and heading, one to the other side."""


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """One run on the common grid: t (n,), U (n, m), Y (n, 3) u v r, psi (n,), seen (n, 3) which of Y was measured."""

    name: str
    t: Array
    U: Array
    Y: Array
    psi: Array
    seen: NDArray[np.bool_]


def load(craft: Craft, name: str) -> Trial:
    """Read one run."""
    return load_trial(DATA / craft.folder / f"{name}.csv")


def gridded(trial: Trial, inputs: tuple[str, ...]) -> Run:
    """Return *trial* on the grid: inputs held, motion interpolated; longer gaps than three steps are not measured."""
    psi = trial["psi"]
    t = np.arange(psi.t[0], psi.t[-1] + 1e-9, STEP)
    held = [np.maximum(np.searchsorted(trial[c].t, t + 1e-9, side="right") - 1, 0) for c in inputs]
    U = np.column_stack([trial[c].values[i] for c, i in zip(inputs, held, strict=True)])
    Y = np.column_stack([np.interp(t, trial[n].t, trial[n].values) for n in OUTPUTS])
    seen = np.column_stack([_near(t, trial[n].t) for n in OUTPUTS])
    return Run(trial.name, t, U, Y, np.interp(t, psi.t, np.unwrap(psi.values)), seen)


def _near(t: Array, stamps: Array) -> NDArray[np.bool_]:
    after = np.clip(np.searchsorted(stamps, t), 1, len(stamps) - 1)
    near: NDArray[np.bool_] = np.minimum(np.abs(stamps[after] - t), np.abs(t - stamps[after - 1])) < 3.0 * STEP
    return near
