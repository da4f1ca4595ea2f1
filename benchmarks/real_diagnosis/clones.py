"""Runs read from clones of the repositories that publish them, in their own formats.

A clone lies at ``$REAL_DIAGNOSIS_CLONES/<owner>+<name>``: a work tree, a git directory, or a folder ``repo`` that is
either. Files are read by ``git show`` of the newest commit there. Nothing of them is kept.
"""

from __future__ import annotations

import io
import os
import subprocess
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.trial import Channel, Trial

__all__ = ["FERRY", "KVLCC2", "READERS", "TANK", "clone_of"]

Array = NDArray[np.float64]

FERRY, TANK, KVLCC2 = (
    "Andeshog/milliampere_data",
    "SAABmarine-MEX/saabmarineMEX_learning",
    "martinlarsalbert/System-identification-of-Vessel-Manoeuvring-Models",
)
"""Repositories: a passenger ferry that keeps its place, a BlueROV2 in a tank, a tanker model free running."""

STEP = 0.1
"""Interval [s] that the ferry's topics, each with stamps of its own, are brought to."""

UNITS = {"psi": "rad", "x": "m", "y": "m", "u": "m/s", "v": "m/s", "w": "m/s", "r": "rad/s", "X": "N", "Y": "N"}


def clone_of(repository: str) -> Path | None:
    """Return the git directory of a clone, None where there is none."""
    place = os.environ.get("REAL_DIAGNOSIS_CLONES")
    if not place:
        return None
    own = Path(place) / repository.replace("/", "+")
    found = (own, own / "repo", own / "repo" / ".git", own / ".git")
    return next((p for p in reversed(found) if (p / "HEAD").is_file()), None)


def _shown(repository: str, path: str) -> bytes:
    """Return a file of the newest commit; FileNotFoundError where there is no clone."""
    place = clone_of(repository)
    if place is None:
        raise FileNotFoundError(f"no clone of {repository} below $REAL_DIAGNOSIS_CLONES")
    return subprocess.run(["git", f"--git-dir={place}", "show", f"HEAD:{path}"], capture_output=True, check=True).stdout


def _trial(name: str, t: Array, values: Mapping[str, Array], units: Mapping[str, str]) -> Trial:
    return Trial(name, {n: Channel(n, units[n], t, v) for n, v in values.items()})


# -- a ferry (ROS topics as tables)


def _topic(test: str, topic: str) -> tuple[Array, dict[str, Array]]:
    """Return stamps [s] and columns (n,) of a topic, a stamp once."""
    lines = _shown(FERRY, f"{test}/{topic}.csv").decode().splitlines()
    heads = lines[0].split(",")
    numbers = [i for i, head in enumerate(heads) if head not in ("time", "header_frame_id")]
    rows = np.array([[float(cells[i]) for i in numbers] for cells in (line.split(",") for line in lines[1:])])
    columns = {heads[i]: rows[:, k] for k, i in enumerate(numbers)}
    stamps = columns["header_stamp_secs"] + 1e-9 * columns["header_stamp_nsecs"]
    order = np.argsort(stamps, kind="stable")
    once = order[np.append(True, np.diff(stamps[order]) > 0.0)]
    return stamps[once], {head: column[once] for head, column in columns.items()}


def ferry(name: str) -> Trial:
    """Return a test of the ferry: heading and velocities interpolated, the wrench that its thrusters gave held."""
    test = f"physical_tests/{name}/{name}"
    (at, pose), (by, twist), (on, wrench) = (
        _topic(test, topic) for topic in ("navigation/pose", "navigation/twist_body", "tau_actual")
    )
    t = np.arange(max(at[0], by[0], on[0]), min(at[-1], by[-1], on[-1]), STEP)
    qx, qy, qz, qw = (pose[f"pose_orientation_{n}"] for n in "xyzw")
    psi = np.unwrap(np.arctan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz)))
    velocities = {"u": "linear_x", "v": "linear_y", "r": "angular_z"}
    values = {
        "psi": np.interp(t, at, psi),
        **{n: np.interp(t, by, twist[f"twist_{head}"]) for n, head in velocities.items()},
        "N": wrench["wrench_torque_z"][np.searchsorted(on, t, side="right") - 1],
    }
    return _trial(name, t - t[0], values, {**UNITS, "N": "N m"})


# -- a BlueROV2 in a tank (arrays of a motion-capture system)

RECORDED = "residual_modelling/data_and_plots/dictfiles_plot_noacc/rosbag2_2025_05_27-{}_data_all.npz"
COLUMNS = {"u": 0, "v": 1, "w": 2, "r": 5}
"""Velocity -> column of ``velocities``."""
CONTROLS = {"X": 4, "Z": 2, "N": 5}
"""Channel -> column of ``scaled_controls``, of full output: each goes with its own velocity by 0.5 to 0.8."""


def tank(name: str) -> Trial:
    """Return a run in the tank: velocities, and the commands as shares of full output."""
    data = np.load(io.BytesIO(_shown(TANK, RECORDED.format(name))), allow_pickle=False)
    n = len(data["scaled_controls"])
    t = 1e-9 * (data["timestamps"][:n] - data["timestamps"][0])
    once = np.append(True, np.diff(t) > 0.0)
    values = {own: data["velocities"][:n, k][once] for own, k in COLUMNS.items()}
    values |= {own: data["scaled_controls"][:, k][once] for own, k in CONTROLS.items()}
    return _trial(name, t[once], values, {**UNITS, "X": "1", "Z": "1", "N": "1"})


# -- a tanker model (tables at full scale)


def marin(name: str) -> Trial:
    """Return a zig-zag of the KVLCC2 at MARIN: the file's speeds are rates of x and y, here turned to the ship."""
    lines = _shown(KVLCC2, f"data/01_raw/kvlcc2/MARIN_FREE_KVLCC2_zz_{name}_m.dat").decode("latin-1").splitlines()[3:]
    rows = np.array([[float(cell) for cell in line.split()] for line in lines if line.strip()])
    psi, r, delta = (np.radians(rows[:, k]) for k in (4, 8, 9))
    north, east = rows[:, 5], rows[:, 6]
    values = {
        "psi": np.unwrap(psi),
        "u": north * np.cos(psi) + east * np.sin(psi),
        "v": east * np.cos(psi) - north * np.sin(psi),
        "r": r,
        "delta": delta,
    }
    return _trial(f"zz_{name}", rows[:, 0], values, {**UNITS, "delta": "rad"})


READERS: Mapping[str, Callable[[str], Trial]] = {FERRY: ferry, TANK: tank, KVLCC2: marin}
"""Repository -> how one of its runs is read."""
