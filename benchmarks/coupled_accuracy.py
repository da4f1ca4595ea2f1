"""Accuracy of output error over noise seeds, against the Cramer-Rao bound: axes and coupled horizontal motion.

Run from the repository root: ``python -m benchmarks.coupled_accuracy [seeds] [processes]``. It is the study
``benchmarks/studies/coupled_accuracy.toml``; a stopped run continues. All fits use
:func:`gcs_autotune.identify.fit`. SciPy integrates the runs from hand-written equations. The bound is that of the true
motion: sensitivities by central differences of the same integration, initial states unknown.
Goals: rms error within 1.2 of the bound, 92 to 98 % of the 95 % intervals contain the truth, mean error within chance.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "plants"))

from coupled_plants import BOAT, horizontal, levels, sail

from benchmarks.results import count, headline
from benchmarks.studies import rows_of
from gcs_autotune.identify import fit
from gcs_autotune.models.coupled import FORMS, Form
from gcs_autotune.trial import Channel, Trial

Array = np.ndarray
UNITS = {"u": "m/s", "v": "m/s", "r": "rad/s", "w": "m/s", "psi": "rad", "x": "m", "z": "m", "y": "m"}


@dataclass(frozen=True)
class Setting:
    """One craft and its runs: parameters by the names of the fit, states, noise per measured state."""

    truth: Mapping[str, float]
    rates: Callable[[Mapping[str, float]], Callable[[Array, Array], Array]]
    states: tuple[str, ...]
    noise: Mapping[str, float]
    inputs: tuple[tuple[str, str], ...]
    t: Array
    taus: tuple[Array, ...]
    structure: str | Form


def axis_rates(names: Sequence[str], p: Mapping[str, float]) -> Callable[[Array, Array], Array]:
    """Return the rates of one axis; *names* of inertia, linear and quadratic drag, constant force."""
    alpha, beta, quadratic, delta = (p.get(n, 0.0) for n in names)

    def rates(s: Array, tau: Array) -> Array:
        return np.array([s[1], (tau[0] + delta - (beta + quadratic * abs(s[1])) * s[1]) / alpha])

    return rates


def axis(
    velocity: str, position: str, channel: str, unit: str, truth: Sequence[float], noise: Mapping[str, float],
    structure: str, amplitude: float, hold: float,
) -> Setting:  # fmt: skip
    """Return a setting of one axis: two runs of 60 s at 10 Hz with random levels."""
    names = (f"alpha_{velocity}", f"beta_{velocity}", f"beta_{velocity}{velocity}", "delta")
    t = np.arange(0.0, 60.0, 0.1)
    taus = tuple(levels(np.random.default_rng(s), t, hold, -amplitude, amplitude)[:, None] for s in (1, 2))
    given = {n: v for n, v in zip(names, truth, strict=True) if v}
    if "delta" not in given:
        given["delta"] = 0.0
    return Setting(
        given, partial(axis_rates, names), (position, velocity), noise, ((channel, unit),), t, taus, structure
    )


def settings() -> dict[str, Setting]:
    """Return all settings by name."""
    t = np.arange(0.0, 60.0, 0.1)
    taus = []
    for seed in (11, 12, 13):
        rng = np.random.default_rng(seed)
        taus.append(np.column_stack([levels(rng, t, 6.0, 5.0, 40.0), levels(rng, t, 4.0, -8.0, 8.0)]))
    noise = {"u": 0.02, "v": 0.02, "r": 0.005, "psi": 0.005}
    return {
        "yaw, linear": axis("r", "psi", "N", "N m", (0.36, 0.12, 0.0, 0.01), {"psi": 0.01}, "linear", 0.5, 3.0),
        "yaw, nonlinear": axis("r", "psi", "N", "N m", (0.031, 0.0, 0.069, 0.0), {"psi": 0.01}, "nonlinear", 0.1, 3.0),
        "surge, linear + quadratic": axis("u", "x", "X", "N", (30.0, 6.0, 14.0, 0.5), {"u": 0.03}, "affine", 40.0, 6.0),
        "heave with buoyancy": axis("w", "z", "Z", "N", (22.0, 9.0, 30.0, -6.0), {"z": 0.02}, "affine", 30.0, 5.0),
        "horizontal, 14 parameters": Setting(
            BOAT,
            horizontal,
            ("x", "y", "psi", "u", "v", "r"),
            noise,
            (("X", "N"), ("N", "N m")),
            t,
            tuple(taus),
            FORMS["horizontal"].without("Y_0"),
        ),
    }


def clean_runs(s: Setting, p: Mapping[str, float], starts: Sequence[Array]) -> list[Array]:
    """Return the true states of every run."""
    return [sail(s.rates(p), s_0, s.t, s.t, tau) for s_0, tau in zip(starts, s.taus, strict=True)]


def bound(s: Setting) -> dict[str, float]:
    """Return the Cramer-Rao bound of every parameter, initial states and noise levels unknown."""
    names, count = list(s.truth), len(s.taus)
    n = len(s.states)
    starts = [np.zeros(n) for _ in range(count)]
    weigh = np.array([1.0 / s.noise[x] if x in s.noise else 0.0 for x in s.states])
    columns: list[Array] = []

    def stacked(p: Mapping[str, float], begin: Sequence[Array]) -> Array:
        return np.concatenate([(run * weigh).ravel() for run in clean_runs(s, p, begin)])

    for name in names:
        h = 1e-4 * max(abs(s.truth[name]), 1e-2 * max(map(abs, s.truth.values())) * 0.1)
        up, down = ({**s.truth, name: s.truth[name] + side * h} for side in (1.0, -1.0))
        columns.append((stacked(up, starts) - stacked(down, starts)) / (2.0 * h))
    for run in range(count):
        for state in range(n):
            h = 1e-4
            moved = [[x + side * h * np.eye(n)[state] * (i == run) for i, x in enumerate(starts)] for side in (1, -1)]
            columns.append((stacked(s.truth, moved[0]) - stacked(s.truth, moved[1])) / (2.0 * h))
    J = np.column_stack(columns)
    # An initial state without effect on the measurements changes only the steps of the integrator.
    scale = np.sqrt(np.sum(J * J, axis=0))
    J, scale = J[:, scale > 1e-5 * scale.max()], scale[scale > 1e-5 * scale.max()]
    covariance = np.linalg.inv((J / scale).T @ (J / scale)) / np.outer(scale, scale)
    return dict(zip(names, np.sqrt(np.diag(covariance)).tolist(), strict=False))


def noisy(s: Setting, clean: Sequence[Array], seed: int) -> list[Trial]:
    """Return the runs as recorded under one seed."""
    rng = np.random.default_rng(1000 + seed)
    trials = []
    for i, (states, tau) in enumerate(zip(clean, s.taus, strict=True)):
        channels = {
            name: Channel(name, UNITS[name], s.t, states[:, s.states.index(name)] + rng.normal(0.0, std, len(s.t)))
            for name, std in s.noise.items()
        }
        channels |= {c: Channel(c, unit, s.t, tau[:, k]) for k, (c, unit) in enumerate(s.inputs)}
        trials.append(Trial(f"run {i + 1}", channels))
    return trials


@cache
def clean_of(name: str) -> list[Array]:
    """Return the true states of every run of a setting, from rest."""
    s = settings()[name]
    return clean_runs(s, s.truth, [np.zeros(len(s.states))] * len(s.taus))


def fitted(seed: int, setting: str) -> dict[str, Any]:
    """Return value and standard error of every parameter under one seed, and the slugs of the doubts."""
    s = settings()[setting]
    found = fit(noisy(s, clean_of(setting), seed), s.structure)
    numbers = {n: {"value": found.parameters[n].value, "std": found.parameters[n].std} for n in s.truth}
    return {**numbers, "doubts": " ".join(d.slug for d in found.doubts)}


def assess(name: str, seeds: int, workers: int) -> bool:
    """Print one setting's table; return whether all goals are met."""
    s = settings()[name]
    least = bound(s)
    rows = rows_of("coupled_accuracy", workers, only={"argument.setting": (name,)}, repeats=seeds)
    seconds = sum(row["seconds"] for row in rows)
    slugs = [slug for row in rows for slug in row["doubts"].split()]
    listed = ", ".join(f"{slug} {slugs.count(slug)}x" for slug in sorted(set(slugs))) or "none"
    print(f"\n{name}: {seeds} seeds, {seconds:.0f} s of fits; doubts: {listed}")
    print(f"{'':>9} {'truth':>9} {'bound':>9} {'rms/bound':>9} {'bias/se':>8} {'in 95 %':>8} {'std/rms':>8}")
    fine, hits = True, []
    for n, truth in s.truth.items():
        errors = np.array([row[f"{n}.value"] for row in rows]) - truth
        stds = np.array([row[f"{n}.std"] for row in rows])
        rms = float(np.sqrt(np.mean(errors**2)))
        bias = float(errors.mean() / (errors.std(ddof=1) / np.sqrt(seeds)))
        inside = np.abs(errors) <= 1.96 * stds
        hits.append(inside)
        share = 100.0 * float(np.mean(inside))
        fine &= rms <= 1.2 * least[n] and abs(bias) < 4.0
        print(
            f"{n:>9} {truth:9.4g} {least[n]:9.2g} {rms / least[n]:9.2f} {bias:8.1f} {share:7.1f}% "
            f"{float(np.mean(stds)) / rms:8.2f}"
        )
    whole = 100.0 * float(np.mean(hits))
    print(f"{'all':>9} {'':>38} {whole:7.1f}%")
    return fine and 92.0 <= whole <= 98.0


def main() -> None:
    """Print the tables; exit 1 when a goal is missed."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 30
    workers = int(sys.argv[2]) if len(sys.argv) > 2 else 2
    print("rms/bound: goal 1.2 at most; in 95 %: goal 92-98 %; bias/se: mean error over its own standard error")
    names = list(settings())
    missed = [name for name in names if not assess(name, seeds, workers)]
    met = count(f"settings with all goals met, {seeds} seeds", len(names) - len(missed), len(names), least=1.0)
    headline("coupled_accuracy", "coupled fits: bias, scatter against the Cramér-Rao bound, coverage", [met])
    print(f"\nmissed: {', '.join(missed)}" if missed else "\nall goals met")
    sys.exit(bool(missed))


if __name__ == "__main__":
    main()
