"""Sensors that contradict each other: how many are identified, and how many clean records raise nothing.

Run: ``python3 -m benchmarks.contradictory_sensors [--seeds 4] [--first 1]``. Each seed makes one spoilt record of every
kind and the clean ones, from hulls of :mod:`sitl` in open loop with currents, leeway and sensors of this file.
It prints the share of spoilt records identified by pair and kind (goal 95 %), the clean records that raise nothing
(goal all), and every miss.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.results import count, headline
from gcs_autotune.crosscheck import Contradiction, contradictions
from gcs_autotune.trial import Channel, Trial
from sitl.open_loop import Hull, open_loop

Array = NDArray[np.float64]

UNITS: Mapping[str, str] = {
    "x": "m", "y": "m", "z": "m", "psi": "rad", "r": "rad/s", "u": "m/s", "v": "m/s", "w": "m/s", "U": "m/s",
    "X": "1", "Y": "1", "Z": "1", "N": "1", "N_ref": "1",
}  # fmt: skip
DOFS = ("surge", "sway", "heave", "yaw")


@dataclass(frozen=True, slots=True)
class Conditions:
    """Conditions of a record: current [m/s], leeway [m] per turn rate, interval, noise and lag of the sensors."""

    current: tuple[float, float] = (0.0, 0.0)
    leeway: float = 0.0
    interval: float = 0.1
    heading_noise: float = math.radians(0.5)
    rate_noise: float = 0.005
    place_noise: float = 0.05
    speed_noise: float = 0.03
    quantum: float = 0.0
    late: float = 0.0
    wrapped: bool = False
    holes: tuple[tuple[float, float], ...] = ()


def hull_of(rng: np.random.Generator, *, fast: bool = True) -> Hull:
    """Return a craft whose full output drives it at 1.4 to 3 m/s and turns it at 10 to 50 deg/s."""
    pace = 1.0 if fast else 4.0
    linear = {"surge": 1.0 / rng.uniform(1.4, 3.0), "sway": 1.0 / rng.uniform(0.5, 1.0), "heave": 2.5}
    linear["yaw"] = pace / math.radians(rng.uniform(10.0, 50.0))
    times = {"surge": rng.uniform(1.0, 4.0), "sway": 1.5, "heave": 2.0, "yaw": pace * rng.uniform(0.3, 1.5)}
    return Hull(DOFS, {n: times[n] * linear[n] for n in DOFS}, linear, bottom=60.0)


def switched(rng: np.random.Generator, duration: float, size: float, shortest: float, longest: float) -> list:
    """Return steps to alternating sides, each of a random length, the mean near zero."""
    t, side, steps = 0.0, 1.0, []
    while t < duration:
        steps.append((t, side * size * rng.uniform(0.7, 1.0)))
        t += rng.uniform(shortest, longest)
        side = -side
    return steps


def commands_of(rng: np.random.Generator, duration: float, what: str) -> dict[str, list]:
    """Return the commands of a craft."""
    ahead = rng.uniform(0.6, 0.9)
    turning = switched(rng, duration, 0.6, 1.5, 5.0)
    rest = {"Y": [(0.0, 0.0)], "Z": [(0.0, 0.0)]}
    if what == "circle":
        return {"X": [(0.0, ahead)], "N": [(0.0, 0.05), (5.0, 0.5)], **rest}
    if what == "straight":
        return {"X": [(0.0, ahead)], "N": [(0.0, 0.01), (10.0, 0.08), (12.0, -0.08), (14.0, 0.0)], **rest}
    if what == "astern":
        return {"X": [(0.0, -ahead)], "N": turning, **rest}
    if what == "sideways":
        return {"X": [(0.0, 0.0)], "Y": switched(rng, duration, 0.8, 5.0, 12.0), "N": turning, "Z": [(0.0, 0.0)]}
    if what == "on the spot":
        return {"X": [(0.0, 0.0)], "N": turning, **rest}
    if what == "at rest":
        return {"X": [(0.0, 0.0)], "N": [(0.0, 0.0), (8.0, 0.02), (9.0, 0.0)], **rest}
    if what == "dive":
        return {"X": [(0.0, 0.0)], "Y": [(0.0, 0.0)], "N": turning, "Z": switched(rng, duration, 0.9, 4.0, 9.0)}
    return {"X": [(0.0, ahead)], "N": turning, **rest}


def record(rng: np.random.Generator, what: str, conditions: Conditions, duration: float) -> dict[str, Array]:
    """Return the columns of one run."""
    hull = hull_of(rng)
    fine = min(0.05, conditions.interval)
    commands = commands_of(rng, duration, what)
    start = {"z": 20.0, "psi": rng.uniform(-3.0, 3.0)}
    truth = open_loop(
        hull, commands, duration=duration, interval=fine,
        measured=("x", "y", "z", "psi", "u", "v", "w", "r"), initial=start,
    )  # fmt: skip
    t = truth["t"]
    v = truth["v"] - conditions.leeway * truth["r"]
    north = truth["u"] * np.cos(truth["psi"]) - v * np.sin(truth["psi"]) + conditions.current[0]
    east = truth["u"] * np.sin(truth["psi"]) + v * np.cos(truth["psi"]) + conditions.current[1]
    truth["x"], truth["y"] = (np.concatenate([[0.0], np.cumsum(fine * s[:-1])]) for s in (north, east))
    truth["U"] = np.hypot(north, east)
    truth["u"] = np.cos(truth["psi"]) * north + np.sin(truth["psi"]) * east
    truth["v"] = np.cos(truth["psi"]) * east - np.sin(truth["psi"]) * north
    truth["N_ref"] = truth["N"].copy()
    stamps = np.arange(0.0, duration - 1e-9, conditions.interval)
    columns = {"t": stamps}
    noise = {
        "psi": conditions.heading_noise,
        "r": conditions.rate_noise,
        **dict.fromkeys("xy", conditions.place_noise),
        "z": 0.5 * conditions.place_noise,
        **dict.fromkeys("wuvU", conditions.speed_noise),
    }
    for name in UNITS:
        late = conditions.late if name in ("psi", "x", "y", "z", "U") else 0.0
        if name in ("X", "Y", "Z", "N", "N_ref"):
            at = np.clip(np.searchsorted(t, stamps + 1e-9, side="right") - 1, 0, len(t) - 1)
            columns[name] = truth[name][at]
        else:
            columns[name] = np.interp(stamps - late, t, truth[name]) + noise[name] * rng.normal(size=len(stamps))
    if conditions.quantum:
        columns["psi"] = conditions.quantum * np.round(columns["psi"] / conditions.quantum)
    return columns


def trial_of(columns: Mapping[str, Array], names: tuple[str, ...], conditions: Conditions, name: str) -> Trial:
    """Return the run with the columns *names*, wrapped and with the gaps of *conditions*."""
    t = columns["t"]
    keep = np.ones(len(t), dtype=bool)
    for start, end in conditions.holes:
        keep &= (t < start) | (t > end)
    channels = {}
    for n in names:
        values = columns[n]
        if n == "psi" and conditions.wrapped:
            values = np.mod(values, 2.0 * math.pi)
        channels[n] = Channel(n, UNITS[n], t[keep], values[keep])
    return Trial(name, channels)


EVERY = ("psi", "r", "x", "y", "U", "z", "w", "X", "Y", "N", "N_ref")
DEG = math.pi / 180.0

CLEAN: tuple[tuple[str, str, Conditions, float, tuple[str, ...]], ...] = (
    ("noisy compass", "turning", Conditions(heading_noise=3.0 * DEG, rate_noise=0.03), 60.0, EVERY),
    ("coarse compass", "turning", Conditions(quantum=5.0 * DEG, heading_noise=0.0, wrapped=True), 60.0, EVERY),
    ("one sample a second", "turning", Conditions(interval=1.0, wrapped=True), 180.0, EVERY),
    ("holes", "turning", Conditions(holes=((10.0, 16.0), (30.0, 33.0)), wrapped=True), 60.0, EVERY),
    ("late compass and GPS", "turning", Conditions(late=0.3), 60.0, EVERY),
    ("short", "turning", Conditions(), 12.0, EVERY),
    ("circle with leeway", "circle", Conditions(leeway=1.0, current=(0.2, 0.1), wrapped=True), 60.0, EVERY),
    ("current", "turning", Conditions(current=(0.35, -0.3), leeway=0.4), 60.0, EVERY),
    ("current, straight", "straight", Conditions(current=(-0.3, 0.35)), 40.0, EVERY),
    ("astern", "astern", Conditions(leeway=0.2), 60.0, EVERY),
    ("sideways", "sideways", Conditions(current=(0.1, 0.0)), 60.0, (*EVERY, "u", "v")),
    ("on the spot in a current", "on the spot", Conditions(current=(0.3, 0.2)), 60.0, EVERY),
    ("at rest", "at rest", Conditions(current=(0.1, 0.1)), 40.0, EVERY),
    ("dive", "dive", Conditions(place_noise=0.02), 60.0, EVERY),
    ("fast and densely sampled", "turning", Conditions(interval=0.02, rate_noise=0.01), 40.0, EVERY),
    ("speeds of its own", "turning", Conditions(leeway=0.3), 60.0, ("psi", "r", "x", "y", "u", "v", "N")),
)
"""Name, manoeuvre, conditions, duration [s] and columns."""


Spoil = Callable[[dict[str, Array], np.random.Generator], None]


def scaled(name: str, factor: float) -> Spoil:
    def spoil(c: dict[str, Array], rng: np.random.Generator) -> None:
        c[name] = c[name][0] + factor * (c[name] - c[name][0]) if name in ("psi", "z") else factor * c[name]

    return spoil


def moved_track(factor: float) -> Spoil:
    def spoil(c: dict[str, Array], rng: np.random.Generator) -> None:
        c["x"], c["y"] = factor * c["x"], factor * c["y"]

    return spoil


def dead(name: str, noise: float) -> Spoil:
    def spoil(c: dict[str, Array], rng: np.random.Generator) -> None:
        c[name] = c[name][0] + noise * rng.normal(size=len(c[name]))

    return spoil


def random(name: str, size: float) -> Spoil:
    def spoil(c: dict[str, Array], rng: np.random.Generator) -> None:
        c[name] = size * rng.normal(size=len(c[name]))

    return spoil


def late(name: str, seconds: float) -> Spoil:
    def spoil(c: dict[str, Array], rng: np.random.Generator) -> None:
        c[name] = np.interp(c["t"] - seconds, c["t"], c[name])

    return spoil


def turned(degrees: float) -> Spoil:
    def spoil(c: dict[str, Array], rng: np.random.Generator) -> None:
        c["psi"] = c["psi"] + degrees * DEG

    return spoil


def exchanged(c: dict[str, Array], rng: np.random.Generator) -> None:
    c["x"], c["y"] = c["y"], c["x"]


SPOILT: tuple[tuple[str, str, str, str, Spoil, float], ...] = (
    ("psi x 0.4", "turning", "psi against r", "factor", scaled("psi", 0.4), 0.4),
    ("psi x 0.8", "turning", "psi against r", "factor", scaled("psi", 0.8), 0.8),
    ("psi x 1.3", "turning", "psi against r", "factor", scaled("psi", 1.3), 1.3),
    ("r x 0.5", "turning", "psi against r", "factor", scaled("r", 0.5), 2.0),
    ("r x 2.5", "circle", "psi against r", "factor", scaled("r", 2.5), 0.4),
    ("r x 57.3", "turning", "psi against r", "factor", scaled("r", 57.3), 1 / 57.3),
    ("r / 57.3", "turning", "psi against r", "factor", scaled("r", 1 / 57.3), 57.3),
    ("r turned round", "turning", "psi against r", "sign", scaled("r", -1.0), -1.0),
    ("psi turned round and slow", "circle", "psi against r", "sign", scaled("psi", -0.41), -0.41),
    ("dead r", "turning", "psi against r", "still", dead("r", 0.0), math.nan),
    ("noise for r", "turning", "psi against r", "still", random("r", 0.01), math.nan),
    ("much noise for r", "turning", "psi against r", "still", random("r", 0.2), math.nan),
    ("dead psi", "turning", "psi against r", "still", dead("psi", 0.005), math.nan),
    ("frozen psi", "circle", "psi against r", "still", dead("psi", 0.0), math.nan),
    ("psi 1 s late", "turning", "psi against r", "shift", late("psi", 1.0), 1.0),
    ("psi 2.5 s late", "turning", "psi against r", "shift", late("psi", 2.5), 2.5),
    ("psi 180 deg off", "turning", "psi against track", "turned", turned(180.0), math.pi),
    ("psi 180 deg off, straight", "straight", "psi against track", "turned", turned(180.0), math.pi),
    ("psi 90 deg off", "turning", "psi against track", "turned", turned(90.0), -math.pi / 2),
    ("psi 90 deg off, straight", "straight", "psi against track", "turned", turned(-90.0), math.pi / 2),
    ("psi 135 deg off", "turning", "psi against track", "turned", turned(135.0), -3 * math.pi / 4),
    ("psi 60 deg off", "turning", "psi against track", "turned", turned(60.0), -math.pi / 3),
    ("U in knots", "turning", "x, y against U", "factor", scaled("U", 1.944), 1 / 1.944),
    ("U x 0.6", "straight", "x, y against U", "factor", scaled("U", 0.6), 1 / 0.6),
    ("track x 1.5", "turning", "x, y against U", "factor", moved_track(1.5), 1.5),
    ("dead U", "straight", "x, y against U", "still", dead("U", 0.0), math.nan),
    ("frozen positions", "turning", "x, y against U", "still", moved_track(0.0), math.nan),
    ("w turned round", "dive", "z against w", "sign", scaled("w", -1.0), -1.0),
    ("w x 0.5", "dive", "z against w", "factor", scaled("w", 0.5), 2.0),
    ("z in cm", "dive", "z against w", "factor", scaled("z", 100.0), 100.0),
    ("dead w", "dive", "z against w", "still", dead("w", 0.01), math.nan),
    ("frozen z", "dive", "z against w", "still", dead("z", 0.0), math.nan),
    ("dead N", "turning", "N against N_ref", "still", dead("N", 0.0), math.nan),
    ("N turned round", "turning", "N against N_ref", "sign", scaled("N", -1.0), -1.0),
    ("N x 0.5", "turning", "N against N_ref", "factor", scaled("N", 0.5), 0.5),
    ("unrelated N", "turning", "N against N_ref", "unrelated", random("N", 0.4), math.nan),
    ("x and y exchanged", "turning", "psi against track", "exchanged", exchanged, math.nan),
)
"""Name, manoeuvre, pair and kind to report, fault, and its value."""


def surroundings(rng: np.random.Generator) -> Conditions:
    """Return ordinary conditions for a record with a fault."""
    angle = rng.uniform(0.0, 2.0 * math.pi)
    speed = rng.uniform(0.0, 0.2)
    return Conditions(
        current=(speed * math.cos(angle), speed * math.sin(angle)),
        leeway=rng.uniform(0.0, 0.3),
        interval=float(rng.choice([0.05, 0.1, 0.2])),
        late=rng.uniform(0.0, 0.1),
        wrapped=False,
    )


def clean_trial(seed: int, k: int) -> Trial:
    """Return the *k*-th clean record of a seed."""
    name, what, conditions, duration, names = CLEAN[k]
    rng = np.random.default_rng([seed, k])
    return trial_of(record(rng, what, conditions, duration), names, conditions, name)


def spoilt_trial(seed: int, k: int) -> Trial:
    """Return the *k*-th spoilt record of a seed."""
    name, what, _, _, spoil, _ = SPOILT[k]
    rng = np.random.default_rng([seed, 1000 + k])
    conditions = surroundings(rng)
    columns = record(rng, what, conditions, 60.0)
    spoil(columns, rng)
    return trial_of(columns, EVERY, conditions, name)


def is_named(found: tuple[Contradiction, ...], k: int) -> bool:
    """Return whether pair and kind of the *k*-th spoilt record are reported first, with the value within 10 % or 3 std.

    No other pair may be reported, except for the track after a heading with a wrong scale.
    """
    _, _, pair, kind, _, value = SPOILT[k]
    others = [c for c in found if c.pair not in (pair, "psi against track")]
    if not found or found[0].pair != pair or found[0].kind != kind or others:
        return False
    if math.isnan(value):
        return True
    if kind == "turned":
        return abs(math.remainder(found[0].value - value, 2.0 * math.pi)) < math.radians(25.0)
    if kind == "shift":
        return abs(found[0].value - value) < 0.4
    return abs(found[0].value - value) < max(0.1 * abs(value), 3.0 * found[0].std)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--first", type=int, default=1)
    args = parser.parse_args()
    seeds = range(args.first, args.first + args.seeds)
    named = silent = 0
    for seed in seeds:
        for k, case in enumerate(SPOILT):
            found = contradictions(spoilt_trial(seed, k))
            if is_named(found, k):
                named += 1
            else:
                print(f"seed {seed}, {case[0]}: {[(c.pair, c.kind, round(c.value, 3)) for c in found]}")
        for k, case in enumerate(CLEAN):
            found = contradictions(clean_trial(seed, k))
            if not found:
                silent += 1
            else:
                print(f"seed {seed}, clean, {case[0]}: {[c.cause for c in found]}")
    spoilt, clean = len(seeds) * len(SPOILT), len(seeds) * len(CLEAN)
    figures = [
        count("contradictions identified", named, spoilt, least=0.95),
        count("records without a contradiction, no report", silent, clean, least=1.0),
    ]
    headline("contradictory_sensors", "records whose sensors contradict each other", figures)


if __name__ == "__main__":
    main()
