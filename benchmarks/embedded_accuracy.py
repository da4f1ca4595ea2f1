"""How accurate: relay experiments flown over MAVLink on the embedded vehicles, against their hidden truth.

Run: ``python3 -m benchmarks.embedded_accuracy [--seeds 50] [--workers 2]``. For every vehicle and noise seed two
relay experiments are flown and identified just as ``tune`` does it. Printed per parameter: the refined fit's mean
error (in units of its standard error over the seeds), its RMS error over the Cramer-Rao bound (goal 1.3), the
share of 95 % intervals that cover the truth, and plain IS-O's RMS error beside it.
"""

from __future__ import annotations

import argparse
import math
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np

from gcs_autotune.firmware import Axis
from gcs_autotune.identify import Fit, cramer_rao, identify
from gcs_autotune.link import MemoryLink, Session, open_craft
from gcs_autotune.manoeuvres import Envelope, Sequencer
from gcs_autotune.models import SingleDof
from gcs_autotune.trial import Trial
from gcs_autotune.watch import SilentWatcher
from gcs_autotune.workflow.aboard import telemetry_rates
from gcs_autotune.workflow.experiments import relay_for, second_output, speed_for
from gcs_autotune.workflow.settings import Connection, TuneSettings
from sitl import load_vehicle, open_vehicle

CASES = (
    ("charlie", "heading"),
    ("videoray", "heading"),
    ("automarine", "heading"),
    ("falcon", "heading"),
    ("videoray", "depth"),
    ("falcon", "depth"),
)


@dataclass(frozen=True)
class Result:
    """One seed: name -> (truth, refined, its standard error, bound, plain IS-O)."""

    rows: dict[str, tuple[float, float, float, float, float]]
    structure: str


def truth_of(vehicle: str, dof: str, trials: list[Trial]) -> tuple[SingleDof, float]:
    """Return the hidden model in fractions of full output, and the standard deviation of its position noise."""
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
    if dof == "heave":
        return model, sensors.depth_noise
    return model, math.hypot(sensors.heading_noise, sensors.heading_quantum / math.sqrt(12.0))


def fly(vehicle: str, axis_name: str, seed: int) -> tuple[Axis, list[Trial]]:
    """Fly the two relay experiments of a tune; return their records."""
    link = MemoryLink(open_vehicle(vehicle, seed=seed))
    kept: list[Trial] = []
    with link, Session(link) as session:
        craft = open_craft(session, wanted_rates=telemetry_rates(10.0))
        axis = craft.firmware.axes[axis_name]
        settings = TuneSettings(axis_name, Connection("memory"), None)  # type: ignore[arg-type]
        throttle, _ = speed_for(settings, axis, craft.parameters.read_existing(axis.context))
        craft.arm()
        sequencer = Sequencer(craft, Envelope(), SilentWatcher(), kept.append)
        kind = craft.firmware.kind
        first = sequencer.fly(relay_for(settings, axis.dof, kind, throttle, None, "relay-1")).trial
        output = second_output(float(first.meta["C"]))
        second = sequencer.fly(relay_for(settings, axis.dof, kind, throttle, output, "relay-2")).trial
    return axis, [first, second]


def one(case: tuple[str, str, int]) -> Result:
    """Fly and identify one seed."""
    vehicle, axis_name, seed = case
    axis, trials = fly(vehicle, axis_name, seed)
    truth, noise = truth_of(vehicle, axis.dof, trials)
    fit: Fit = identify(trials, dof=axis.dof)
    free = ["alpha", "delta"] + [n for n in ("beta", "beta_quadratic") if getattr(truth, n) != 0.0]
    bound = cramer_rao(truth, trials, noise, free)
    names = dict(zip(("alpha", "beta", "beta_quadratic", "delta"), truth.axis.parameter_names(), strict=True))
    rows = {}
    for field in free:
        parameter = fit.parameters[names[field]]
        iso = float(np.mean([getattr(e, field) for e in fit.iso])) if fit.iso else math.nan
        rows[names[field]] = (getattr(truth, field), parameter.value, parameter.std, bound[field], iso)
    return Result(rows, fit.structure)


def report(title: str, results: list[Result]) -> None:
    """Print one vehicle's lines."""
    structures = sorted({r.structure for r in results})
    shown = ", ".join(f"{s} {sum(r.structure == s for r in results)}" for s in structures)
    print(f"\n{title}: {len(results)} seeds; structure decided: {shown}")
    print("  parameter      truth    mean error [s.e.]   RMS/bound   95 % cover   RMS refined   RMS IS-O")
    for name in results[0].rows:
        truth, value, std, bound, iso = np.array([r.rows[name] for r in results]).T
        error = value - truth
        rms = float(np.sqrt(np.mean(error**2)))
        bias = float(error.mean() / (error.std(ddof=1) / math.sqrt(len(error))))
        cover = float(np.mean(np.abs(error) < 1.96 * np.where(std > 0, std, np.inf)))
        scale = abs(float(truth.mean()))
        iso_rms = float(np.sqrt(np.mean((iso - truth) ** 2)))
        print(
            f"  {name:9s} {truth.mean():10.5g} {bias:15.2f} {rms / float(np.sqrt(np.mean(bound**2))):16.2f} "
            f"{100 * cover:10.0f} % {100 * rms / scale:10.3f} % {100 * iso_rms / scale:9.2f} %"
        )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", help="one vehicle")
    args = parser.parse_args()
    with ProcessPoolExecutor(args.workers) as pool:
        for vehicle, axis in CASES:
            if args.only in (None, vehicle):
                cases = [(vehicle, axis, seed) for seed in range(1, args.seeds + 1)]
                report(f"{vehicle} {axis}", list(pool.map(one, cases, chunksize=4)))


if __name__ == "__main__":
    main()
