"""Duration of a diagnosis over the whole catalogue of effects.

``python3 -m benchmarks.diagnosis_speed [--process-noise|--positions]``. Goals in processor seconds: yaw 10 s, three
degrees of freedom 60 s, also without recorded velocities; with process noise 30 and 180 s. Each is three runs of 600
samples, with a dead zone on every input and with nothing hidden. ``--process-noise`` runs only cases with noise, and
``--positions`` only those in which no velocity was recorded. It also prints wall seconds, the
number of plain simulations by ``scipy.integrate.solve_ivp`` that take as long, and the work in samples, which is the
same on every machine.
"""

from __future__ import annotations

import argparse
import itertools
import time
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from benchmarks.results import Figure, headline
from gcs_autotune.diagnose import WORK, Diagnosis, diagnose
from gcs_autotune.sname import DOFS, SIGNALS
from gcs_autotune.trial import Channel, Trial

Array = NDArray[np.float64]

SAMPLES, STEP = 600, 0.1
CRAFT: Mapping[str, tuple[float, float, float, float]] = {
    "surge": (12.0, 8.0, 15.0, 0.01),
    "sway": (16.0, 14.0, 10.0, 0.01),
    "yaw": (0.6, 0.5, 0.8, 0.005),
}
"""Degree of freedom -> inertia, drag, largest command, noise; SI."""

GOALS = {("yaw",): (10.0, 30.0), ("surge", "sway", "yaw"): (60.0, 180.0)}
"""Degrees of freedom -> longest time [s] without and with process noise. Project choice."""

NOISE, CORRELATION_TIME = 0.3, 4.0
"""Process noise: standard deviation as a fraction of the largest command, and correlation time [s]."""


KINDS = (0.0, True), (NOISE, True), (0.0, False)
"""Process noise of each kind of case, and whether velocities are recorded."""


def flown(dofs: tuple[str, ...], width: float, seed: int, noise: float = 0.0, velocities: bool = True) -> Trial:
    """Return a run of uncoupled craft under steps of random size and length.

    width : width of the dead zone. noise : size of a drifting force. Both are fractions of the largest command.
    velocities : whether velocities were recorded.
    """
    rng = np.random.default_rng(seed)
    t = STEP * np.arange(SAMPLES)
    commands = {d: _steps(rng, CRAFT[d][2]) for d in dofs}
    drifts = {d: noise * CRAFT[d][2] * _drift(rng) for d in dofs} if noise else {}

    def rate(s: float, x: Array) -> Array:
        k, n = min(int(s / STEP + 1e-9), SAMPLES - 1), len(dofs)
        nu = dict(zip(dofs, x[n:], strict=True))
        psi = x[n - 1]
        nu_dot = []
        for d in dofs:
            inertia, drag, most, _ = CRAFT[d]
            u = commands[d][k]
            force = np.sign(u) * max(abs(u) - width * most, 0.0)
            if drifts:
                force += drifts[d][k]
            nu_dot.append((force - drag * nu[d]) / inertia)
        if n == 1:
            return np.array([nu["yaw"], *nu_dot])
        u, v = nu["surge"], nu["sway"]
        along, across = u * np.cos(psi) - v * np.sin(psi), u * np.sin(psi) + v * np.cos(psi)
        return np.array([along, across, nu["yaw"], *nu_dot])

    x = np.zeros((SAMPLES, 2 * len(dofs)))
    for k in range(SAMPLES - 1):
        span = (t[k], t[k + 1] - 1e-9)
        x[k + 1] = solve_ivp(rate, span, x[k], rtol=1e-8, atol=1e-10).y[:, -1]
    channels = {}
    for i, d in enumerate(dofs):
        channels[DOFS[d].force] = commands[d]
        recorded = ((DOFS[d].position, x[:, i]), (DOFS[d].velocity, x[:, len(dofs) + i]))
        for name, column in recorded if velocities else recorded[:1]:
            channels[name] = column + rng.normal(0.0, CRAFT[d][3], SAMPLES)
    return Trial(f"run{seed}", {n: Channel(n, SIGNALS[n][0].split(",")[0], t, v) for n, v in channels.items()})


def _steps(rng: np.random.Generator, most: float) -> Array:
    found = np.zeros(SAMPLES)
    at = 0
    while at < SAMPLES:
        held = int(rng.uniform(20, 60))
        found[at : at + held] = most * rng.uniform(-1.0, 1.0)
        at += held
    return found


def _drift(rng: np.random.Generator) -> Array:
    """Return an Ornstein-Uhlenbeck process (SAMPLES,) of standard deviation one."""
    kept, found = np.exp(-STEP / CORRELATION_TIME), np.zeros(SAMPLES)
    found[0] = rng.normal()
    for k in range(1, SAMPLES):
        found[k] = kept * found[k - 1] + rng.normal(0.0, np.sqrt(1.0 - kept**2))
    return found


def timed(runs: list[Trial]) -> tuple[Diagnosis, float, float]:
    """Return a diagnosis, its wall seconds and its CPU seconds."""
    wall, cpu = time.perf_counter(), time.process_time()
    found = diagnose(runs)
    return found, time.perf_counter() - wall, time.process_time() - cpu


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python3 -m benchmarks.diagnosis_speed", description=__doc__)
    only = parser.add_mutually_exclusive_group()
    only.add_argument("--process-noise", action="store_true", help="run only the cases with process noise")
    only.add_argument("--positions", action="store_true", help="run only the cases without recorded velocities")
    options = parser.parse_args(arguments)
    kinds = [(noise, velocities) for noise, velocities in KINDS if not options.process_noise or noise]
    if options.positions:
        kinds = [(0.0, False)]
    figures = []
    for dofs, goals in GOALS.items():
        begun = time.process_time()
        flown(dofs, 0.0, 0)
        peer = time.process_time() - begun
        for (noise, velocities), width in itertools.product(kinds, (0.15, 0.0)):
            runs = [flown(dofs, width, seed, noise, velocities) for seed in range(3)]
            diagnose(runs[:1], effects=["input-bias"])  # compiles the code
            found, wall, cpu = timed(runs)
            causes = ", ".join(c.effect.slug for c in found.causes) or "nothing"
            hidden = "dead zone" if width else "nothing"
            hidden += (" with process noise" if noise else "") + ("" if velocities else ", positions only")
            figures.append(Figure(f"{', '.join(dofs)}, {hidden}", cpu, "s of processor", most=goals[bool(noise)]))
            print(
                f"{', '.join(dofs):18} {hidden:27} hidden: {wall:6.1f} s wall, {cpu:6.1f} s CPU (goal "
                f"{goals[bool(noise)]:g}), {cpu / peer:5.1f} simulations by solve_ivp; work {found.work:.3g} samples "
                f"({100.0 * found.work / WORK:.1f} % of the budget), {found.work / cpu:.2g} per CPU second; "
                f"{found.verdict}: {causes}",
                flush=True,
            )
    headline("diagnosis_speed", "duration of a diagnosis over the whole catalogue", figures)


if __name__ == "__main__":
    main()
