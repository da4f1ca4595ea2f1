"""Distance and angle by two laser dots, and Miskovic2007's whole chain from pictures of a pool to its matrices.

The pictures are rendered by ``sitl.camera``, which shares no code with the reader::

    python3 -m benchmarks.vision --quick         # 3 seeds, 2 dives: three minutes
    python3 -m benchmarks.vision                 # 20 seeds, 6 dives
    python3 -m benchmarks.vision --part pool     # one part: lasers, pool or diagnosis
    python3 -m benchmarks.vision --page          # update the table of docs/vision.md from the recorded figures

In the last part ``diagnose`` gets runs in which an effect is hidden, from pictures as well. It examines yaw only.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.published.water import DOFS, HORIZONTAL_INPUTS
from benchmarks.results import Figure, count, headline, load
from gcs_autotune.diagnose import diagnose
from gcs_autotune.identify import fit
from gcs_autotune.logs import load_runs
from gcs_autotune.models.coupled import CoupledModel, Form
from gcs_autotune.smoothing import local_polynomials
from gcs_autotune.trial import Trial
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

Array = NDArray[np.float64]

TABLE_3_1 = {"right": (230.2, -0.03876, 83.3, -0.007234), "left": (507.7, -0.03745, 88.71, -0.007085)}
"""Miskovic2010, table 3.1: a [cm], b, c [cm], d."""
TRUTH = {"M": (8.2372, 8.2372, 0.0372), "D": (4.4283, 14.9571, 0.0997)}
"""Miskovic2007, final matrices."""
PRINTED = {
    "I": {"r": 0.045, "u": 0.485, "v": 0.434, "alpha_3": 31.969},
    "II": {"r": 0.041, "u": 0.489, "v": 0.399, "alpha_3": 0.0},
}
"""Miskovic2007, tables I and II: J of each velocity, and the free coupling of yaw [kg/(kg m^2)]."""
COUPLED = {"u": ("v", "r"), "v": ("u", "r"), "r": ("u", "v")}
"""The product in the equation of each velocity, Miskovic2007 (5)-(7)."""
TIED = {"u": 1.0, "v": -1.0, "r": 0.0}
"""Factors of these products in table II."""
PAGE = Path(__file__).parents[1] / "docs" / "vision.md"
BEGIN, END = "<!-- J: made by python3 -m benchmarks.vision --page -->\n", "<!-- end -->\n"
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
    return figures + errors_of_tables(runs)


HIDDEN = {
    "input-delay@N.delay=0.3": 1,
    "input-bias@yaw.bias=0.015": 3,
    "quadratic-drag@yaw.coefficient=0.05": 1,
    "dead-zone@N.width=0.02": 3,
    "": 1,
}
"""Hidden effect -> dives of one diagnosis.

A dead zone and a bias show in commands of different sizes: one size per dive. Two sizes also fit other laws of the
thruster, and with one size a bias is the same as an unequal thrust to both sides.
"""
SECONDS = 25
"""Length of these dives [s]."""


WIDTH = 320
"""Width of their pictures [pixels]. Half of the usual width takes a third of the time."""


class Answer(NamedTuple):
    """What was found in the dives of one seed. ``error``: relative error of the effect's size, None if not found."""

    effect: str
    seed: int
    right: bool
    grouped: bool
    error: float | None
    summary: str


def hidden(seeds: int, level: str, jobs: int) -> list[Figure]:
    """Hide an effect in dives, and diagnose the runs that ``track`` writes."""
    with ProcessPoolExecutor(jobs) as workers:
        futures = [workers.submit(answer, effect, seed, level) for seed in range(seeds) for effect in HIDDEN]
        answers = []
        for future in as_completed(futures):
            answers.append(future.result())
            print(answers[-1].summary, flush=True)
    figures = []
    for effect in HIDDEN:
        own, name = [a for a in answers if a.effect == effect], effect.partition("@")[0]
        summary = f"{name} hidden and reported alone" if effect else "nothing hidden and nothing reported"
        figures.append(count(summary, sum(a.right for a in own), len(own)))
        if any(a.grouped for a in own):
            figures.append(count(f"{name} reported in a group", sum(a.grouped for a in own), len(own)))
    errors = [a.error for a in answers if a.error is not None]
    return [*figures, Figure("largest error of a reported effect's size", 100.0 * max(errors, default=math.nan), "%")]


def answer(effect: str, seed: int, level: str) -> Answer:
    """Render the dives of *seed* with *effect* hidden, track and diagnose them."""
    runs, camera = [], None
    for k in range(HIDDEN[effect]):
        with tempfile.TemporaryDirectory() as at:
            drawn = ["--seed", str(100 + 10 * seed + k), "--noise", level, "--seconds", str(SECONDS)]
            render(["pool", at, *drawn, "--width", str(WIDTH), *(["--effect", effect] if effect else [])])
            camera = camera or calibrate_camera(Path(at) / "floor.csv", str(Path(at) / "boards"))[0]
            runs.append(joined(track(at, camera), load_runs(Path(at) / "log.csv")[0]).run)
    found = diagnose(runs, dof="yaw")
    slug, _, rest = effect.partition("@")
    name, _, true = rest.partition(".")[2].partition("=")
    causes = [cause.effect.slug for cause in found.causes]
    groups = [group for group in found.indistinguishable if set(group) & set(causes)]
    right = causes == ([slug] if slug else [])
    error = abs(found.causes[0].parameters[name].value / float(true) - 1.0) if right and slug else None
    grouped = not right and len(causes) == 1 and any(slug in group for group in groups)
    size = "" if error is None else f", size wrong by {100.0 * error:.1f} %"
    summary = f"{effect or 'nothing'}, seed {seed}: {found.verdict} {causes} {groups or ''}{size}"
    return Answer(effect, seed, right, grouped, error, summary)


def errors_of_tables(runs: Sequence[Trial]) -> list[Figure]:
    """Return J of Miskovic2007's tables I and II by its own formula, identified and simulated as there.

    J is the mean of ``e^2`` over all samples of all runs (section IV.B), in SI, with e the difference between simulated
    and measured velocity. The measured one comes from a local polynomial of 7 samples ("Goley filter", length not
    printed), and the numbers are the means over the runs of the regression (8). The three equations are simulated
    together, without its constant.
    """
    measured = [velocities(run) for run in runs]
    figures = []
    for table, tied in (("I", {}), ("II", TIED)):
        thetas = [regression(run, nu, tied) for run, nu in zip(runs, measured, strict=True)]
        theta = {n: np.mean([t[n] for t in thetas], axis=0) for n in "uvr"}
        error = np.concatenate([nu - simulated(run, nu[0], theta) for run, nu in zip(runs, measured, strict=True)])
        figures += [
            Figure(f"table {table}, J of {n}", float(np.mean(error[:, i] ** 2)), UNITS[n]) for i, n in enumerate("uvr")
        ]
        if not tied:
            figures.append(Figure(f"table {table}, alpha_3", float(theta["r"][2])))
    speeds = np.concatenate(measured)
    return figures + [
        Figure(f"mean square of {n}", float(np.mean(speeds[:, i] ** 2)), UNITS[n]) for i, n in enumerate("uvr")
    ]


UNITS = {"u": "m^2/s^2", "v": "m^2/s^2", "r": "rad^2/s^2"}


def velocities(run: Trial) -> Array:
    """Return u, v, r (n, 3) of *run* from its positions."""
    t, psi = run["psi"].t, run["psi"].values
    rate = {n: local_polynomials(t, run[n].values, t, 7, 2).derivative(1) for n in ("x", "y", "psi")}
    c, s = np.cos(psi), np.sin(psi)
    return np.column_stack([c * rate["x"] + s * rate["y"], c * rate["y"] - s * rate["x"], rate["psi"]])


def regression(run: Trial, nu: Array, tied: Mapping[str, float]) -> dict[str, Array]:
    """Return damping, gain and coupling of each velocity by (8) of Miskovic2007, with *tied* couplings held."""
    t, found = run["psi"].t, {}
    rate, held = np.diff(nu, axis=0) / np.diff(t)[:, None], commands(run, t)
    for i, n in enumerate("uvr"):
        product = np.prod([nu[:-1, "uvr".index(other)] for other in COUPLED[n]], axis=0)
        columns = {0: nu[:-1, i], 1: held[:-1, i], 2: product, 3: np.ones(len(rate))}
        theta = np.zeros(4)
        theta[2] = tied.get(n, 0.0)
        free = [k for k in columns if not (k == 1 and n == "v") and not (k == 2 and n in tied)]
        rest = rate[:, i] - theta[2] * product
        theta[free] = np.linalg.lstsq(np.column_stack([columns[k] for k in free]), rest, rcond=None)[0]
        found[n] = theta[:3]
    return found


def commands(run: Trial, t: Array) -> Array:
    """Return the force ahead, to the side and the moment (n, 3) of *run* at *t*."""
    held = {n: run[n].values[np.maximum(np.searchsorted(run[n].t, t, side="right") - 1, 0)] for n in "XN"}
    return np.column_stack([held["X"], np.zeros(len(t)), held["N"]])


def simulated(run: Trial, start: Array, theta: Mapping[str, Array]) -> Array:
    """Return u, v, r (n, 3) of the model *theta*, from *start* and the commands of *run*."""
    t, parts = run["psi"].t, 20
    fine = np.interp(np.arange(parts * (len(t) - 1) + 1) / parts, np.arange(len(t)), t)
    damping, gain, coupling = np.array([theta[n] for n in "uvr"]).T
    nu, rows = start.copy(), [start]
    for k, (h, tau) in enumerate(zip(np.diff(fine), commands(run, fine), strict=False), start=1):
        u, v, r = nu
        nu = nu + h * (damping * nu + gain * tau + coupling * np.array([v * r, u * r, u * v]))
        if k % parts == 0:
            rows.append(nu)
    return np.array(rows)


def page() -> str:
    """Return :data:`PAGE` with the table of the recorded J beside the printed ones."""
    (result,) = (r for r in load() if r.benchmark == "vision-pool")
    ours = {f.name: f.value for f in result.figures}
    lines = ["| table | motion | printed J | our J | mean square of the velocity |\n", "|---|---|---|---|---|\n"]
    for table, printed in PRINTED.items():
        for n, motion in (("r", "yaw"), ("u", "surge"), ("v", "sway")):
            unit = UNITS[n].replace("^2", "²")
            row = (f"{ours[f'table {table}, J of {n}']:.2g} {unit}", f"{ours[f'mean square of {n}']:.2g} {unit}")
            lines.append(f"| {table} | {motion} | {printed[n]:g} | {row[0]} | {row[1]} |\n")
    lines.append(f"| I | α3, truth 0 | {PRINTED['I']['alpha_3']:g} | {ours['table I, alpha_3']:.3g} | |\n")
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    return before + BEGIN + "".join(lines) + END + rest.partition(END)[2]


PARTS = {
    "pool": "pictures of a pool: tracker, matrices and J of Miskovic2007",
    "lasers": "distance and angle by two laser dots, from rendered pictures",
    "diagnosis": "diagnosis of runs from pictures of a pool, with a hidden effect",
}
"""Part -> what it measures."""


def main() -> int:
    """Measure, and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="3 seeds and 2 dives")
    parser.add_argument("--noise", choices=list(NOISE), default="turbid", help="noise of the pool (default turbid)")
    parser.add_argument("--part", choices=list(PARTS), action="append", help="measure this part only; may be repeated")
    parser.add_argument("--jobs", type=int, default=2, help="processes of the diagnosis (default 2)")
    parser.add_argument("--page", action="store_true", help="update docs/vision.md from the recorded figures, and end")
    args = parser.parse_args()
    if args.page:
        PAGE.write_text(page(), encoding="utf-8")
        return 0
    quick = args.quick
    for part in args.part or PARTS:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            if part == "pool":
                figures = pool(folder, 2 if quick else 6, args.noise)
            elif part == "lasers":
                figures = table_3_1(folder) + lasers(folder, 3 if quick else 20)
            else:
                figures = hidden(1 if quick else 5, args.noise, args.jobs)
        headline(f"vision-{part}", PARTS[part], figures)
    return 0


if __name__ == "__main__":
    sys.exit(main())
