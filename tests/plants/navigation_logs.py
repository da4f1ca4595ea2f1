"""Logs of sensors with hidden biases, lever arms and delays, on the simulator's bodies; no code of the filter."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from gcs_autotune.trial import Channel, Trial
from sitl.catalogue import load_vehicle
from sitl.plants.plant import Wrench

FINE = 0.005
"""Step of the simulation [s]."""
NOISE = {"gyro": 0.002, "accelerometer": 0.03, "gps": 0.5, "gps_v": 0.08, "compass": 0.02, "dvl": 0.01, "depth": 0.02}


@dataclass(frozen=True)
class Motion:
    """True motion of the centre of gravity: t (n,), position, Euler angles, body velocity, rates (n, 3), rotation;
    specific force, and force applied by letter (n,), each until the next sample."""

    t: np.ndarray
    at: np.ndarray
    angles: np.ndarray
    velocity: np.ndarray
    rates: np.ndarray
    R: np.ndarray
    force: np.ndarray
    applied: dict[str, np.ndarray]


@functools.lru_cache(maxsize=16)
def motion(vehicle: str, seed: int, seconds: float, letters: str = "XYZKMN", waves: float = 0.5) -> Motion:
    """Return the motion of a vehicle of the simulator under forces that change every few seconds, with waves."""
    rng = np.random.default_rng(seed)
    plant = load_vehicle(vehicle).make_plant()
    own = {dof: plant.parameters[f"{dof}.alpha"] for dof in plant.dofs}
    size = {"surge": 0.45, "sway": 0.15, "heave": 0.15, "roll": 0.5, "pitch": 0.25, "yaw": 0.35}
    names = dict(zip(("surge", "sway", "heave", "roll", "pitch", "yaw"), "XYZKMN", strict=True))
    n = round(seconds / FINE)
    force = {letter: np.zeros(n) for letter in "XYZKMN"}
    t = np.arange(n) * FINE
    for dof, letter in names.items():
        if dof in own and letter in letters:
            levels = rng.uniform(-1.0, 1.0, int(seconds / 3.0) + 2) + (0.6 if dof == "surge" else 0.0)
            wave = waves * np.sin(2.0 * np.pi * rng.uniform(0.25, 0.6) * t + rng.uniform(0.0, 6.0))
            force[letter] = own[dof] * size[dof] * (levels[(t / 3.0).astype(int)] + wave)
    rows = np.zeros((n, 15))
    s = plant.state
    for i in range(n):
        plant.step(Wrench(**{letter: force[letter][i] for letter in "XYZKMN"}), FINE)
        rows[i] = (s.x, s.y, s.z, s.phi, s.theta, s.psi, s.u, s.v, s.w, s.p, s.q, s.r, *plant.specific_force())
    R = Rotation.from_euler("ZYX", rows[:, [5, 4, 3]]).as_matrix()
    force_mid = rows[:, 12:15].copy()
    force_mid[:-1] = 0.5 * (rows[:-1, 12:15] + rows[1:, 12:15])  # means over the steps before and after
    return Motion(t + FINE, rows[:, 0:3], rows[:, 3:6], rows[:, 6:9], rows[:, 9:12], R, force_mid, force)


def hidden(seed: int, devices: tuple[str, ...]) -> dict[str, np.ndarray | float]:
    """Return biases, lever arms from the inertial sensor, delays, declination and the compass's turn in its mount."""
    rng = np.random.default_rng([seed, 7])
    found = {
        "gyro bias": rng.normal(0.0, 0.01, 3),
        "accelerometer bias": rng.normal(0.0, 0.1, 3),
        "compass offset": float(rng.normal(0.0, 0.07)),
        "centre": rng.normal(0.0, 0.1, 3),
    }
    for device in devices:
        found[f"{device} delay"] = float(rng.uniform(0.02, 0.3))
        if device != "compass":
            found[f"{device} arm"] = rng.normal(0.0, 0.25, 3)
    found["compass turn"] = rng.normal(0.0, 0.035, 3)  # a mount about 2 degrees off on each axis
    return found


def log(
    vehicle: str,
    seed: int,
    seconds: float = 100.0,
    devices: tuple[str, ...] = ("gps", "compass"),
    driven: str = "",
):
    """Return (run, hidden constants, true motion) of a log with sensors at different rates.

    driven : letters of the only forces, without waves, which the run then contains too.
    """
    true = motion(vehicle, seed, seconds, driven, 0.0) if driven else motion(vehicle, seed, seconds)
    told = hidden(seed, devices)
    rng = np.random.default_rng([seed, 8])
    imu = -np.asarray(told["centre"])  # where the inertial sensor is, from the centre of gravity
    turning = np.gradient(true.rates, FINE, axis=0)
    w = true.rates

    def at(place):
        return true.at + np.einsum("nij,j->ni", true.R, place)

    def speed(place):
        return true.velocity + np.cross(w, place)

    inertial = np.arange(20, len(true.t) - 4, 4)  # 50 Hz
    f = true.force + np.cross(turning, imu) + np.cross(w, np.cross(w, imu))
    gyro = w[inertial] + told["gyro bias"] + rng.normal(0.0, NOISE["gyro"], (len(inertial), 3))
    accelerometer = (
        f[inertial] + told["accelerometer bias"] + rng.normal(0.0, NOISE["accelerometer"], (len(inertial), 3))
    )
    columns = {
        "imu": (true.t[inertial], ("p", "q", "r", "ax", "ay", "az"), np.hstack([gyro, accelerometer])),
    }
    rates = {"gps": 0.2, "compass": 0.1, "dvl": 0.25, "depth": 0.1}
    for device in devices:
        start = 0.35 + 0.013 * list(rates).index(device)
        stamps = np.arange(start, true.t[-1], rates[device])
        when = stamps - float(told[f"{device} delay"])

        def seen(values, when=when):
            return np.column_stack([np.interp(when, true.t, column) for column in values.T])

        place = imu + told[f"{device} arm"] if device != "compass" else imu
        if device == "gps":
            ned = np.einsum("nij,nj->ni", true.R, speed(place))
            values = np.hstack([seen(at(place)[:, :2]), seen(ned)])
            values += rng.normal(0.0, 1.0, values.shape) * np.array([NOISE["gps"]] * 2 + [NOISE["gps_v"]] * 3)
            columns["gps"] = (stamps, ("x", "y", "vn", "ve", "vd"), values)
        elif device == "compass":
            offset = float(told["compass offset"])
            field = np.array([20.0 * np.cos(offset), -20.0 * np.sin(offset), 40.0])  # an unknown declination
            mount = Rotation.from_rotvec(told["compass turn"]).as_matrix()
            body = seen(np.einsum("nji,j->ni", true.R, field)) @ mount  # from the craft's axes to the compass's
            columns["compass"] = (
                stamps,
                ("mx", "my", "mz"),
                body + rng.normal(0.0, 20.0 * NOISE["compass"], body.shape),
            )
        elif device == "dvl":
            values = seen(speed(place))
            columns["dvl"] = (stamps, ("u", "v", "w"), values + rng.normal(0.0, NOISE["dvl"], values.shape))
        else:
            values = seen(at(place)[:, 2:])
            columns["depth"] = (stamps, ("z",), values + rng.normal(0.0, NOISE["depth"], values.shape))
    channels = {
        f"{group}.{name}": Channel(f"{group}.{name}", "", t, np.ascontiguousarray(values[:, i]))
        for group, (t, names, values) in columns.items()
        for i, name in enumerate(names)
    }
    for letter in driven:
        unit = "N" if letter in "XYZ" else "N m"
        channels[letter] = Channel(letter, unit, (true.t - FINE)[::20], true.applied[letter][::20])
    return Trial(f"{vehicle}-{seed}", channels), told, true
