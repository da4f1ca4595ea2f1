"""Distance and angle by two laser dots, and Miskovic2007's whole chain from pictures of a pool to its matrices.

The pictures are rendered by ``sitl.camera``, which shares no code with the reader::

    python3 -m benchmarks.vision --quick     # 3 seeds, 2 dives: three minutes
    python3 -m benchmarks.vision             # 20 seeds, 6 dives

At the end ``diagnose`` gets runs in which an effect is hidden, from pictures as well. It examines yaw only.
"""

from __future__ import annotations

import argparse
import math
import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.published.water import DOFS, HORIZONTAL_INPUTS
from benchmarks.results import Figure, count, headline
from gcs_autotune.diagnose import diagnose
from gcs_autotune.identify import fit
from gcs_autotune.logs import load_runs
from gcs_autotune.models.coupled import CoupledModel, Form
from gcs_autotune.smoothing import local_polynomials
from gcs_autotune.vision import (
    DotFinder,
    LaserCurve,
    calibrate_camera,
    calibrate_laser,
    joined,
    load_camera,
    save_camera,
    track,
)
from sitl.camera import NOISE, WallCamera, pool_dive, write_png
from sitl.camera.__main__ import main as render

TABLE_3_1 = {"right": (230.2, -0.03876, 83.3, -0.007234), "left": (507.7, -0.03745, 88.71, -0.007085)}
"""Miskovic2010, table 3.1: a [cm], b, c [cm], d."""
TRUTH = {"M": (8.2372, 8.2372, 0.0372), "D": (4.4283, 14.9571, 0.0997)}
"""Miskovic2007, final matrices."""
PRINTED_J = {"r": 0.041, "u": 0.489, "v": 0.399}
"""Miskovic2007, table II."""
OBLIQUE = 10.0
"""Largest angle to the wall [deg]."""


def lasers(folder: Path, seeds: int) -> list[Figure]:
    """Measure distances of 10 to 100 cm at three levels of noise."""
    render(["wall", str(folder / "wall")])
    module = calibrate_laser(folder / "wall" / "truth.csv", str(folder / "wall"), apart=0.2).module
    figures = []
    for level in NOISE:
        errors, missed, total, spent = [], 0, 0, {"windows": [0.0, 0], "picture": [0.0, 0]}
        for seed in range(seeds):
            camera, rng = WallCamera(level, seed=1000 + seed), np.random.default_rng(seed)
            finder = DotFinder("red", module.lines)
            for distance in np.arange(0.1, 1.001, 0.05):
                angle = math.radians(rng.uniform(-OBLIQUE, OBLIQUE))
                if min(camera.beams(distance, angle)) < 0.1 or max(camera.beams(distance, angle)) > 1.0:
                    angle = 0.0  # the lasers are calibrated for 10 to 100 cm
                picture = np.ascontiguousarray(camera.picture(distance, angle)[:, :, ::-1])
                begun = time.process_time()
                dots = finder.find(picture)
                spent[dots.searched][0] += time.process_time() - begun
                spent[dots.searched][1] += 1
                total += 1
                port, starboard = module.beams(dots)
                if math.isnan(port + starboard):
                    missed += 1
                    continue
                seen = math.atan2(starboard - port, 0.2)
                errors.append((100.0 * (0.5 * (port + starboard) - distance), math.degrees(seen - angle)))
        rms, worst = np.sqrt(np.mean(np.square(errors), axis=0)), np.max(np.abs(errors), axis=0)
        figures += [
            Figure(f"{level}: rms error of distance", float(rms[0]), "cm"),
            Figure(f"{level}: largest error of distance", float(worst[0]), "cm"),
            Figure(f"{level}: rms error of angle", float(rms[1]), "deg"),
            Figure(f"{level}: largest error of angle", float(worst[1]), "deg"),
            count(f"{level}: pictures with a distance", total - missed, total),
        ]
        for searched, (seconds, pictures) in spent.items():
            if pictures:
                figures.append(Figure(f"{level}: time per picture, {searched}", 1000.0 * seconds / pictures, "ms"))
    return figures


def table_3_1(folder: Path) -> list[Figure]:
    """Calibrate from pictures whose dots are where the printed curves put them.

    The pairs are not printed in Miskovic2010: figure 3.9 shows them as dots without numbers. The published tables have
    only the curves. So this shows only that pictures lose nothing.
    """
    tape = np.arange(10.0, 100.1, 5.0)
    curves = {side: LaserCurve(*row) for side, row in TABLE_3_1.items()}
    camera = WallCamera("clear", width=1200, seed=3)
    (folder / "printed").mkdir()
    for number, distance in enumerate(tape):
        x = [-curves["left"].pixels(distance), curves["right"].pixels(distance)]
        dots = np.array([(599.5 + v, 239.5) for v in x])
        write_png(folder / "printed" / f"{number:02d}.png", camera.with_dots(dots, [4.0, 4.0]))
    (folder / "printed.csv").write_text("d[cm]\n" + "".join(f"{v:g}\n" for v in tape), encoding="utf-8")
    module = calibrate_laser(folder / "printed.csv", str(folder / "printed"), apart=0.2).module
    figures = []
    for side, got in (("right", module.starboard), ("left", module.port)):
        ours = (100.0 * got.a, got.b, 100.0 * got.c, got.d)
        worst = max(abs(o / p - 1.0) for o, p in zip(ours, TABLE_3_1[side], strict=True))
        print(f"table 3.1, {side}: {ours[0]:.1f} {ours[1]:.5f} {ours[2]:.2f} {ours[3]:.6f}; printed {TABLE_3_1[side]}")
        figures.append(Figure(f"table 3.1, {side}: largest error of a coefficient", 100.0 * worst, "%", most=3.0))
    return figures


def pool(folder: Path, dives: int, level: str) -> list[Figure]:
    """Render S-manoeuvres, track them, and identify the model."""
    runs, place, heading, clock, spent, pictures = [], [], [], [], 0.0, 0
    for seed in range(dives):
        at = folder / f"dive-{seed}"
        render(["pool", str(at), "--seed", str(seed), "--noise", level])
        if seed == 0:
            save_camera(calibrate_camera(at / "floor.csv", str(at / "boards"))[0], folder / "camera.json")
        begun = time.process_time()
        seen = track(str(at), load_camera(folder / "camera.json"))
        spent += time.process_time() - begun
        pictures += len(seen.t) + seen.lost
        found = joined(seen, load_runs(at / "log.csv")[0])
        dive = pool_dive(seed)
        clock.append(found.offset - dive.offset)
        true = dive.seen[np.searchsorted(dive.video_t, seen.t - 1e-6)]
        place += np.hypot(seen.x - true[:, 0], seen.y - true[:, 1]).tolist()
        turned = seen.psi - true[:, 2]
        heading += np.degrees(turned - math.pi * np.round(turned / math.pi)).tolist()
        runs.append(found.run)
        for file in at.glob("*.png"):
            file.unlink()
    tied = Form("tied", "", DOFS, ("m", "N_rdot", "X_u", "Y_v", "N_r"), {}, HORIZONTAL_INPUTS)
    model = fit(runs, tied, "least-squares").model
    assert isinstance(model, CoupledModel)
    ours = {"M": np.diag(model.inertia), "D": np.diag(model.linear_damping)}
    for name, row in ours.items():
        print(f"{name} = diag({', '.join(f'{v:.4f}' for v in row)}), flown {TRUTH[name]}")
    worst = max(float(np.abs(ours[n] / np.array(TRUTH[n]) - 1.0).max()) for n in TRUTH)
    figures = [
        Figure("matrices: largest error of an entry", 100.0 * worst, "%", most=3.0),
        Figure("tracker: rms error of position", 1000.0 * float(np.sqrt(np.mean(np.square(place)))), "mm"),
        Figure("tracker: rms error of heading", float(np.sqrt(np.mean(np.square(heading)))), "deg"),
        Figure("tracker: largest error of the clock", 1000.0 * float(np.abs(clock).max()), "ms"),
        Figure("tracker: time per picture, with reading the file", 1000.0 * spent / pictures, "ms"),
    ]
    for name, value in costs(runs, ours["M"], ours["D"]).items():
        printed = f"table II prints {PRINTED_J[name]:g}, without a unit"
        figures.append(Figure(f"J of {name} over its variance ({printed})", value))
    return figures


HIDDEN = {"input-delay@N.delay=0.3": 1, "dead-zone@N.width=0.02": 3, "": 1}
"""Hidden effect -> dives of one diagnosis.

A dead zone shows in commands of different sizes: one size per dive. Two sizes also fit other laws of the thruster.
"""
SECONDS = 25
"""Length of these dives [s]."""


def hidden(folder: Path, seeds: int, level: str) -> list[Figure]:
    """Hide an effect in dives, and diagnose the runs that ``track`` writes."""
    camera, right, errors = None, dict.fromkeys(HIDDEN, 0), []
    for seed in range(seeds):
        for effect, dives in HIDDEN.items():
            runs = []
            for k in range(dives):
                at = folder / f"hidden-{seed}-{len(errors)}-{k}-{effect[:5]}"
                more = ["--effect", effect] if effect else []
                drawn = ["--seed", str(100 + 10 * seed + k), "--noise", level, "--seconds", str(SECONDS)]
                render(["pool", str(at), *drawn, *more])
                camera = camera or calibrate_camera(at / "floor.csv", str(at / "boards"))[0]
                runs.append(joined(track(str(at), camera), load_runs(at / "log.csv")[0]).run)
                shutil.rmtree(at)
            found = diagnose(runs, dof="yaw")
            slug, _, rest = effect.partition("@N.")
            causes = [cause.effect.slug for cause in found.causes]
            right[effect] += causes == ([slug] if slug else [])
            print(f"hidden {effect or 'nothing'}, seed {seed}: {found.verdict} {causes}", flush=True)
            if slug and causes == [slug]:
                name, _, true = rest.partition("=")
                errors.append(abs(found.causes[0].parameters[name].value / float(true) - 1.0))
    figures = [
        count(f"diagnose from pictures: {effect.partition('@')[0] or 'nothing'} hidden and found", n, seeds)
        for effect, n in right.items()
    ]
    if errors:
        figures.append(Figure("diagnose from pictures: largest error of the effect's size", 100.0 * max(errors), "%"))
    return figures


def costs(runs, inertia, damping) -> dict[str, float]:
    """Return J of Miskovic2007 for each velocity, over the variance of that velocity: its unit is not printed.

    The velocities are those of local polynomials; the model is simulated over the whole run.
    """
    sums = {"r": [], "u": [], "v": []}
    for run in runs:
        t = run["psi"].t
        rate = {n: local_polynomials(t, run[n].values, t, 7, 2).derivative(1) for n in ("x", "y", "psi")}
        c, s = np.cos(run["psi"].values), np.sin(run["psi"].values)
        measured = np.column_stack([c * rate["x"] + s * rate["y"], c * rate["y"] - s * rate["x"], rate["psi"]])
        nu, simulated = measured[0].copy(), [measured[0].copy()]
        for k in range(len(t) - 1):
            for part in range(20):
                at = t[k] + (t[k + 1] - t[k]) * part / 20
                tau = np.array([run["X"].held_at(at), 0.0, run["N"].held_at(at)])
                u, v, r = nu
                coriolis = np.array([-inertia[1] * v * r, inertia[0] * u * r, (inertia[1] - inertia[0]) * u * v])
                nu = nu + (t[k + 1] - t[k]) / 20 * (tau - coriolis - damping * nu) / inertia
            simulated.append(nu.copy())
        error = measured - np.array(simulated)
        for i, name in enumerate("uvr"):
            sums[name].append(float(np.mean(error[:, i] ** 2) / np.var(measured[:, i])))
    return {name: float(np.mean(values)) for name, values in sums.items()}


def main() -> int:
    """Measure, and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="3 seeds and 2 dives")
    parser.add_argument("--noise", choices=list(NOISE), default="turbid", help="noise of the pool (default turbid)")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        figures = pool(folder, 2 if args.quick else 6, args.noise)
        figures += table_3_1(folder) + lasers(folder, 3 if args.quick else 20)
        figures += hidden(folder, 1 if args.quick else 5, args.noise)
    headline("vision", "laser dots and a camera above a pool, from rendered pictures", figures)
    return 0


if __name__ == "__main__":
    sys.exit(main())
