"""Read runs from clones of the repositories that publish them.

A clone is at ``$REAL_DIAGNOSIS_CLONES/<owner>+<name>``: a work tree, a git directory, or a folder ``repo`` that is
either. Files are read by ``git show`` from the newest commit. They are not stored.
"""

from __future__ import annotations

import io
import os
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.logs import load_runs
from gcs_autotune.trial import Channel, Trial, load_trial

__all__ = ["BASIN", "ESSO", "FERRY", "KVLCC2", "READERS", "ROV", "clone_of"]

Array = NDArray[np.float64]

FERRY, BASIN, KVLCC2, ESSO, ROV = (
    "Andeshog/milliampere_data",
    "SAABmarine-MEX/saabmarineMEX_learning",
    "martinlarsalbert/System-identification-of-Vessel-Manoeuvring-Models",
    "NAOE-5thLab/FRT-DS-ESSO",
    "MrEkelund/ExjobbROV",
)
"""Repositories: a passenger ferry in station keeping, a BlueROV2 in a basin, two free-running tanker models (the second
on a pond in wind), and a BlueROV with randomly switched thrusters."""

STEP = 0.1
"""Common sampling interval [s] of the ferry's topics."""

UNITS = {"psi": "rad", "x": "m", "y": "m", "u": "m/s", "v": "m/s", "w": "m/s", "r": "rad/s", "X": "N", "Y": "N"}


def clone_of(repository: str) -> Path | None:
    """Return the git directory of a clone; None without one."""
    place = os.environ.get("REAL_DIAGNOSIS_CLONES")
    if not place:
        return None
    own = Path(place) / repository.replace("/", "+")
    found = (own, own / "repo", own / "repo" / ".git", own / ".git")
    return next((p for p in reversed(found) if (p / "HEAD").is_file()), None)


def _file_bytes(repository: str, path: str) -> bytes:
    """Return a file of the newest commit; raise FileNotFoundError without a clone."""
    place = clone_of(repository)
    if place is None:
        raise FileNotFoundError(f"no clone of {repository} below $REAL_DIAGNOSIS_CLONES")
    return subprocess.run(["git", f"--git-dir={place}", "show", f"HEAD:{path}"], capture_output=True, check=True).stdout


def _trial(name: str, t: Array, values: Mapping[str, Array], units: Mapping[str, str]) -> Trial:
    return Trial(name, {n: Channel(n, units[n], t, v) for n, v in values.items()})


# -- a ferry (ROS topics as tables)


def _topic(test: str, topic: str) -> tuple[Array, dict[str, Array]]:
    """Return times [s] and columns (n,) of a topic, without repeated times."""
    lines = _file_bytes(FERRY, f"{test}/{topic}.csv").decode().splitlines()
    heads = lines[0].split(",")
    numbers = [i for i, head in enumerate(heads) if head not in ("time", "header_frame_id")]
    rows = np.array([[float(cells[i]) for i in numbers] for cells in (line.split(",") for line in lines[1:])])
    columns = {heads[i]: rows[:, k] for k, i in enumerate(numbers)}
    stamps = columns["header_stamp_secs"] + 1e-9 * columns["header_stamp_nsecs"]
    order = np.argsort(stamps, kind="stable")
    once = order[np.append(True, np.diff(stamps[order]) > 0.0)]
    return stamps[once], {head: column[once] for head, column in columns.items()}


def ferry(name: str) -> Trial:
    """Return a test of the ferry, with interpolated heading and velocities and the held moment of its thrusters."""
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


# -- a BlueROV2 in a basin (arrays of a motion-capture system)

RECORDED = "residual_modelling/data_and_plots/dictfiles_plot_noacc/rosbag2_2025_05_27-{}_data_all.npz"
COLUMNS = {"u": 0, "v": 1, "w": 2, "r": 5}
"""Velocity -> column of ``velocities``."""
CONTROLS = {"X": 4, "Z": 2, "N": 5}
"""Channel -> column of ``scaled_controls`` (normalised output). Its correlation with the velocity is 0.5 to 0.8."""


def basin(name: str) -> Trial:
    """Return a run in the basin: velocities and normalised commands."""
    data = np.load(io.BytesIO(_file_bytes(BASIN, RECORDED.format(name))), allow_pickle=False)
    n = len(data["scaled_controls"])
    t = 1e-9 * (data["timestamps"][:n] - data["timestamps"][0])
    once = np.append(True, np.diff(t) > 0.0)
    values = {own: data["velocities"][:n, k][once] for own, k in COLUMNS.items()}
    values |= {own: data["scaled_controls"][:, k][once] for own, k in CONTROLS.items()}
    return _trial(name, t[once], values, {**UNITS, "X": "1", "Z": "1", "N": "1"})


# -- a tanker model (tables at full scale)


def marin(name: str) -> Trial:
    """Return a zig-zag of the KVLCC2 at MARIN, with the speeds rotated from north and east to the ship."""
    lines = (
        _file_bytes(KVLCC2, f"data/01_raw/kvlcc2/MARIN_FREE_KVLCC2_zz_{name}_m.dat").decode("latin-1").splitlines()[3:]
    )
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


# -- a tanker model on a pond (a table), and an ROV (a ROS bag), read as files of a user

ESSO_COLUMNS = {
    "t [s]": "t[s]",
    "psi_hat [rad]": "psi[rad]",
    "r_angvelo [rad/s]": "r[rad/s]",
    "u_velo [m/s]": "u[m/s]",
    "vm_velo [m/s]": "v[m/s]",
    "delta_rudder [rad]": "delta[rad]",
    "n_prop [rps]": "n",
}


def esso(name: str) -> Trial:
    """Return a zig-zag of the Esso Osaka model, from the time when its propeller turns."""
    with _file(ESSO, f"data/zigzag/zigzag_31-Jul-2020_{name}.csv") as path:
        run = load_trial(path, ESSO_COLUMNS)
    begin = float(run["n"].t[np.flatnonzero(run["n"].values > 0.0)[0]]) + SETTLED
    used = {n: c for n, c in run.channels.items() if n in {*UNITS, "delta"}}
    return Trial(name, {n: replace(c, t=c.t[c.t >= begin], values=c.values[c.t >= begin]) for n, c in used.items()})


SETTLED = 5.0
"""Time [s] in which the propeller speeds up."""

GYRO, LEFT, RIGHT = "sensor_fusion_states_6", "rovio_thrusters_3", "rovio_thrusters_4"
EVERY = 11
"""One of so many samples is used; the file has 224 per second."""


def rov(name: str) -> Trial:
    """Return a test of the ROV: turn rate, and the normalised outputs of the two forward thrusters.

    The compass is not used: it deviates from the gyro when the vehicle pitches by 15 degrees.
    """
    with _file(ROV, f"simulink/Estimation/bag/{name}.bag") as path:
        (run,) = load_runs(path)
    begin, end = run[LEFT].t[0], run[LEFT].t[-1]
    left, right = ((run[n].values - 1500.0) / 400.0 for n in (LEFT, RIGHT))
    gyro, at = run[GYRO], run[LEFT].t - begin
    used = np.flatnonzero((gyro.t >= begin) & (gyro.t <= end))[::EVERY]
    channels = {
        "r": Channel("r", "rad/s", gyro.t[used] - begin, np.radians(gyro.values[used])),
        "N": Channel("N", "1", at, 0.5 * (left - right)),
        "X": Channel("X", "1", at, 0.5 * (left + right)),
    }
    return Trial(name.partition("_2016")[0], channels)


@contextmanager
def _file(repository: str, path: str) -> Iterator[Path]:
    """Write a file of the newest commit to a temporary folder, and yield its path."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / Path(path).name
        place.write_bytes(_file_bytes(repository, path))
        yield place


READERS: Mapping[str, Callable[[str], Trial]] = {FERRY: ferry, BASIN: basin, KVLCC2: marin, ESSO: esso, ROV: rov}
"""Repository -> reader of its runs."""
