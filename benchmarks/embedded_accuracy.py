"""Accuracy of relay experiments flown over MAVLink on the simulated vehicles, against their hidden truth.

Run: ``python3 -m benchmarks.embedded_accuracy [--seeds 50] [--first 1] [--workers 2] [--only videoray]``. It is the
study ``benchmarks/studies/embedded_accuracy.toml``; a stopped run continues. For every vehicle and seed two relay
experiments are flown and identified as in ``tune``: with the true drag structure supplied
("given"), where the fit must be unbiased and reach the bound, and with the structure chosen ("decided").

It prints per parameter the mean error in standard errors over the seeds, the rms error over the Cramer-Rao bound (goal
1.3; the chance range is printed), the coverage of 95 % intervals, and the rms error of plain IS-O. The bound includes
the signals used, the sensor's rounding and the unknown shift of input stamps. Beside it, in percent, are the bound with
rounding as noise of q**2/12 (Gauss), and the bound for exact input stamps.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from benchmarks.results import Figure, headline
from benchmarks.studies import FOLDER, rows_of
from gcs_autotune.firmware import Axis
from gcs_autotune.identify import AxisFit, Structure, fit_axis
from gcs_autotune.identify.cramer_rao import cramer_rao
from gcs_autotune.link import MemoryLink, Session, open_craft
from gcs_autotune.manoeuvres import Envelope, Sequencer
from gcs_autotune.models import SingleDof
from gcs_autotune.observer import SilentObserver
from gcs_autotune.study import load_plan
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.connection import telemetry_rates
from gcs_autotune.workflow.experiments import Relays, second_output, speed_for
from gcs_autotune.workflow.settings import Connection, TuneSettings
from sitl import load_vehicle, open_vehicle

Array = NDArray[np.float64]


WIRE = {"w": 0.01}
"""Step [m/s] in which GLOBAL_POSITION_INT carries a velocity."""

CASE = "argument.vehicle_axis"

FIELDS = ("alpha", "beta", "beta_quadratic", "delta")


@dataclass(frozen=True)
class Noise:
    """Per signal: standard deviation before rounding, and the step."""

    sigma: dict[str, float]
    quantum: dict[str, float]

    @property
    def as_gaussian(self) -> dict[str, float]:
        """Rounding taken for noise."""
        return {n: math.hypot(s, self.quantum[n] / math.sqrt(12.0)) for n, s in self.sigma.items()}


@dataclass(frozen=True)
class Row:
    """One parameter of one seed; ``given`` and ``decided`` are (value, standard error)."""

    truth: float
    given: tuple[float, float]
    decided: tuple[float, float]
    bound: float
    gauss: float
    exact: float
    iso: float


@dataclass(frozen=True)
class Result:
    """One seed: name -> row, what was decided, which signals were used, the time shift found [s]."""

    rows: dict[str, Row]
    structure: str
    signals: tuple[str, ...]
    shift: float


def truth_of(vehicle: str, dof: str, trials: list[Trial]) -> tuple[SingleDof, Noise]:
    """Return the hidden model in fractions of full output, and the noise of every signal."""
    data = load_vehicle(vehicle)
    table = {k: v["value"] for k, v in data.tables[dof].items()}
    sensors = data.sensors
    if data.is_boat:
        throttle = float(np.median(trials[0]["X"].values))
        n = data.tables["propeller"]["full_n"]["value"] * throttle
        alpha, beta = (float(np.interp(n * n, table["n2"], table[name])) for name in ("alpha", "beta"))
        full, quadratic = table["full_rudder"], 0.0
    else:
        alpha, beta, quadratic, full = table["alpha"], table["beta"], table["beta2"], table["authority"]
    model = SingleDof(dof, "1", alpha / full, beta / full, quadratic / full, table["bias"] / full)
    sigma = {
        "psi": sensors.heading_noise,
        "r": sensors.gyro_noise,
        "z": sensors.depth_noise,
        "w": sensors.climb_noise,
    }
    return model, Noise(sigma, {"psi": sensors.heading_quantum, "r": 0.0, "z": 0.0, **WIRE})


def fly(vehicle: str, axis_name: str, seed: int) -> tuple[Axis, list[Trial]]:
    """Fly the two relay experiments of a tune; return their records."""
    link = MemoryLink(open_vehicle(vehicle, seed=seed))
    kept: list[Trial] = []
    with link, Session(link) as session:
        craft = open_craft(session, wanted_rates=telemetry_rates(10.0))
        axis = craft.firmware.axes[axis_name]
        settings = TuneSettings(Connection("memory"), Path(), axis=axis_name)
        throttle, _ = speed_for(settings, axis, craft.parameters.read_existing(axis.context))
        craft.arm()
        sequencer = Sequencer(craft, Envelope(), SilentObserver(), kept.append)
        relays = Relays(settings, axis.dof, throttle, keep_still=not craft.firmware.needs_way)
        first = sequencer.fly(relays.relay("relay-1", None))
        output = second_output(first)
        second = sequencer.fly(relays.relay("relay-2", output))
    return axis, [first, second]


def flown(seed: int, vehicle_axis: str) -> dict[str, Any]:
    """Fly and identify one seed; return the numbers of :class:`Result` by name, for a row of the study."""
    found = one(*vehicle_axis.split(), seed)
    numbers = {f"{name}.{key}": value for name, row in found.rows.items() for key, value in asdict(row).items()}
    return {**numbers, "structure": found.structure, "signals": "+".join(found.signals), "shift": found.shift}


def result_of(row: Mapping[str, Any]) -> Result:
    """Return what :func:`flown` stored."""
    known = {key: value for key, value in row.items() if not (isinstance(value, float) and math.isnan(value))}
    names = [key.removesuffix(".truth") for key in known if key.endswith(".truth")]
    rows = {
        name: Row(
            given=(row[f"{name}.given.0"], row[f"{name}.given.1"]),
            decided=(row[f"{name}.decided.0"], row[f"{name}.decided.1"]),
            **{key: row.get(f"{name}.{key}", math.nan) for key in ("truth", "bound", "gauss", "exact", "iso")},
        )
        for name in names
    }
    return Result(rows, row["structure"], tuple(row["signals"].split("+")), row["shift"])


def one(vehicle: str, axis_name: str, seed: int) -> Result:
    """Fly and identify one seed."""
    axis, trials = fly(vehicle, axis_name, seed)
    truth, noise = truth_of(vehicle, axis.dof, trials)
    decided = fit_axis(trials, dof=axis.dof)
    given = fit_axis(trials, dof=axis.dof, structure=structure_of(truth))
    free = [n for n in FIELDS if n in ("alpha", "delta") or getattr(truth, n) != 0.0]
    signals = tuple(given.extra["signals"])
    sigma, quantum = {n: noise.sigma[n] for n in signals}, {n: noise.quantum[n] for n in signals}
    bound = cramer_rao(truth, trials, sigma, free, quantum)
    gauss = cramer_rao(truth, trials, {n: noise.as_gaussian[n] for n in signals}, free)
    stamped = [replace(t, meta={}) for t in trials]
    exact = cramer_rao(truth, stamped, sigma, free, quantum)
    names = dict(zip(FIELDS, truth.axis.parameter_names(), strict=True))
    rows = {
        names[f]: Row(
            getattr(truth, f),
            _estimate(given, names[f]),
            _estimate(decided, names[f]),
            bound[f],
            gauss[f],
            exact[f],
            float(np.mean([getattr(e, f) for e in given.iso])) if given.iso else math.nan,
        )
        for f in free
    }
    return Result(rows, decided.structure, signals, given.extra["time_shift"])


def structure_of(truth: SingleDof) -> Structure:
    """Return the drag structure of the hidden model."""
    if truth.beta_quadratic == 0.0:
        return "linear"
    return "nonlinear" if truth.beta == 0.0 else "affine"


def _estimate(fit: AxisFit, name: str) -> tuple[float, float]:
    return fit.parameters[name].value, fit.parameters[name].std


def report(title: str, results: list[Result]) -> None:
    """Print one vehicle's lines."""
    structures, signals = Counter(r.structure for r in results), Counter("+".join(r.signals) for r in results)
    low, high = (math.sqrt(chi2.ppf(p, len(results)) / len(results)) for p in (0.025, 0.975))
    shifts = 1e3 * np.array([r.shift for r in results])
    print(
        f"\n{title}: {len(results)} seeds; decided {_shown(structures)}; signals {_shown(signals)}; "
        f"stamps off by {shifts.mean():.1f} +- {shifts.std():.1f} ms; chance range of RMS/bound {low:.2f}..{high:.2f}"
    )
    print(
        "  parameter      truth | given: bias   RMS/bound  cover  RMS     | decided: bias  cover  RMS     "
        "| IS-O RMS | Gauss, exact stamps"
    )
    for name in results[0].rows:
        _print_row(name, [r.rows[name] for r in results])


def _figures(title: str, results: list[Result]) -> list[Figure]:
    figures = []
    for name in results[0].rows:
        rows = [r.rows[name] for r in results]
        _, rms, _ = _judged(np.array([r.given for r in rows]), np.array([r.truth for r in rows]))
        figures.append(
            Figure(
                f"{title}, {name}, rms error / Cramér-Rao bound, {len(results)} seeds",
                rms / _rms([r.bound for r in rows]),
            )
        )
    return figures


def _print_row(name: str, rows: list[Row]) -> None:
    truth = np.array([r.truth for r in rows])
    scale = float(abs(truth.mean()))

    def shown(rms: float) -> str:
        return f"{100 * rms / scale:7.3f} %" if scale > 0.0 else f"{rms:9.2g}"

    bound = _rms([r.bound for r in rows])
    given, decided = (_judged(np.array([getattr(r, kind) for r in rows]), truth) for kind in ("given", "decided"))
    iso = _rms([r.iso - r.truth for r in rows])
    gauss, exact = (100.0 * _rms([getattr(r, kind) for r in rows]) / bound for kind in ("gauss", "exact"))
    print(
        f"  {name:9s} {truth.mean():10.5g} | {given[0]:11.2f} {given[1] / bound:11.2f} {given[2]:5.0f} % "
        f"{shown(given[1])} | {decided[0]:13.2f} {decided[2]:5.0f} % "
        f"{shown(decided[1])} | {shown(iso)} | {gauss:5.0f} % {exact:5.0f} %"
    )


def _judged(estimates: Array, truth: Array) -> tuple[float, float, float]:
    """Return bias in standard errors of the mean, RMS error, percentage of 95 % intervals that cover."""
    error, std = estimates[:, 0] - truth, estimates[:, 1]
    bias = float(error.mean() / max(error.std(ddof=1) / math.sqrt(len(error)), 1e-300))
    return bias, _rms(error), 100.0 * float(np.mean(np.abs(error) <= 1.96 * std))


def _rms(values: Array | list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _shown(counts: Counter[str]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counts.most_common())


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", help="one vehicle")
    args = parser.parse_args()
    plan = load_plan(FOLDER / "embedded_accuracy.toml")
    cases = [c for c in plan.vary[CASE].values if args.only in (None, str(c).split()[0])]
    rows = rows_of("embedded_accuracy", args.workers, only={CASE: tuple(cases)}, repeats=args.seeds, seed=args.first)
    figures = list[Figure]()
    for case in cases:
        flights = [result_of(row) for row in rows if row[CASE] == case]
        report(str(case), flights)
        figures += _figures(str(case), flights)
    headline("embedded_accuracy", "the tuner's identification on simulated vehicles", figures)


if __name__ == "__main__":
    main()
