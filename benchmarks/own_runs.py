"""What ``diagnose`` reports of our own runs: tunes, experiments and flown manoeuvres of the simulated vehicles.

Run: ``python3 -m benchmarks.own_runs [VEHICLE ...] [--only WORD,..] [--seeds 5] [--whole] [--numbers] [--keep DIR]``.

The truth is the vehicle file, read as TOML; :func:`truth_of` lists the causes that may be reported. The default is
one seed, the manoeuvres of :data:`DEFAULT_KINDS`. ``--whole``: every manoeuvre by every force. ``--numbers``: the model
file of each tune with one parameter changed by 20 and by 50 %; exactly this one must be reported as wrong. ``--keep``:
folder that keeps the run directories, to use them again.

It prints a line per miss (``--verbose``: per case), the rate with its 95 % bound, causes of motions that the hull
cannot make, and the processor time. The exit status is 1 below 95 % or with one such cause.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta as beta_law

from benchmarks.every_manoeuvre import SLOW_LOOP, cases, tunes
from benchmarks.results import Figure, count, headline
from gcs_autotune.diagnose import diagnose
from gcs_autotune.errors import AutotuneError
from gcs_autotune.executor import executor_for
from gcs_autotune.identify import load_model
from gcs_autotune.link import MemoryLink
from gcs_autotune.logs import load_runs
from gcs_autotune.observer import SilentObserver
from gcs_autotune.sname import DOFS
from gcs_autotune.trial import Trial
from gcs_autotune.workflow import (
    CommonSettings,
    Connection,
    FlySettings,
    TuneSettings,
    Unattended,
    experiment,
    fly,
    tune,
)
from sitl import VEHICLES, open_vehicle

GOAL = 0.95
FOLDER = Path(__file__).parents[1] / "sitl" / "vehicles"
DEFAULT_VEHICLES = ("charlie", "blueboat", "videoray", "bluerov2", "automarine", "falcon", "cybership2")
DEFAULT_KINDS = ("tune heading", "tune speed", "tune depth", "experiment heading", "experiment surge", "zig-zag")
NOT_DIAGNOSED = ("bollard-staircase", "wall-relay")
"""Pulls against a rope and distances to a wall: neither record holds a free motion."""

SLIDING = frozenset({"sway-moment", "munk-moment", "sway-yaw-coupling", "coriolis-coupling"})
"""Causes that take a motion sideways."""

SEEN = 0.02
"""Least share of the largest force in the run that a constant force, or a drag's curvature, must be to be demanded."""


@dataclass(frozen=True, slots=True)
class Fact:
    """What a vehicle file has of a degree of freedom: the slugs it may be named by, each of which is right.

    ``shown``: whether these runs must show it; ``where``: the columns it may be at, any of its degree of freedom where
    none are listed.
    """

    dof: str
    slugs: frozenset[str]
    shown: bool = False
    where: frozenset[str] = frozenset()

    def covers(self, slugs: Iterable[str], place: str) -> bool:
        """Whether a cause of one of these names (those of a group) at *place* is this."""
        here = place in self.where if self.where else dof_of(place) == self.dof
        return here and bool(self.slugs & set(slugs))


@dataclass(frozen=True, slots=True)
class Truth:
    """All facts about the degrees of freedom looked at, and those in which the hull can move."""

    facts: tuple[Fact, ...]
    moves: frozenset[str]


def file_of(vehicle: str) -> dict[str, Any]:
    """Return the tables of a vehicle file, numbers without units and sources."""
    with (FOLDER / VEHICLES[vehicle]).open("rb") as file:
        own = tomllib.load(file)
    tables = file_of(own["like"]) if "like" in own else {}
    for heading, table in own.items():
        if not isinstance(table, dict):
            tables[heading] = table
            continue
        plain = {n: e["value"] if isinstance(e, dict) else e for n, e in table.items()}
        tables[heading] = {**tables.get(heading, {}), **plain}
    return tables


LETTERS = {"surge": "X", "sway": "Y", "heave": "Z", "yaw": "N"}
SPEEDS = {"surge": "u", "sway": "v", "heave": "w", "yaw": "r"}


def dof_of(place: str) -> str:
    """Return the degree of freedom that a cause's place is about: ``yaw`` of ``N``, ``N+X``, ``N_|u|r``, ``psi``."""
    head = place.partition("+")[0].partition("_")[0].partition("@")[0]
    own = (d.name for d in DOFS.values() if head in (d.name, d.force, d.velocity, d.position))
    return next(own, head)


def truth_of(vehicle: str, dofs: Sequence[str], runs: Sequence[Trial]) -> Truth:
    """Return what may, and what must, be named of *dofs*.

    Commands in a record are the outputs of the servos and both they and the motion are dated by the vehicle's clock, so
    the delays of the link are in no record.
    """
    file = file_of(vehicle)
    facts = [fact for dof in dofs for fact in _facts(file, dof, runs)]
    couplings = file.get("coupling", {})
    if couplings.get("coriolis") or any(isinstance(v, float) and v for v in couplings.values()):
        slides = _most("v", runs) > 2.0 * SPEED_NOISE * file["sensors"]["speed_noise"]
        facts += [Fact(dof, SLIDING, slides and dof == "yaw") for dof in dofs]
    boat = file["actuators"] in ("rudder", "twin-thruster")
    moves = {"surge", "yaw"} | {"sway"} & set(file) | (set() if boat else {"heave"})
    return Truth(tuple(facts), frozenset(moves))


SPEED_NOISE = 3.0
"""Standard deviations of a sensor's noise within which all but a few of its samples lie."""


def _facts(file: Mapping[str, Any], dof: str, runs: Sequence[Trial]) -> Iterator[Fact]:
    table, command, speed = file.get(dof, {}), _most(LETTERS[dof], runs), _most(SPEEDS[dof], runs)
    # Trim, or weight less buoyancy. Along the heave axis both are the same force.
    bias, full = abs(table.get("bias", 0.0)), _authority(file, dof)
    if bias:
        slugs = {"net-buoyancy", "input-bias"} if dof == "heave" else {"input-bias"}
        yield Fact(dof, frozenset(slugs), bias > SEEN * full * max(command, 1e-9))
    beta2 = float(np.max(table.get("beta2", 0.0)))
    if beta2 > 0.0:
        yield Fact(dof, frozenset({"quadratic-drag"}), speed > 0.0 and beta2 * speed > 0.5 * table["beta"])
    if file["actuators"] == "rudder" and dof == "yaw":
        # Inertia and drag per rudder angle go with the propeller's speed (table 7.12).
        yield Fact(dof, frozenset({"propeller-wash"}))
    if "rudder" in file and dof == "yaw":
        # Blades or an outboard on a servo of limited speed; their moment goes with the propeller's thrust.
        yield Fact(dof, frozenset({"rate-limit"}), where=frozenset({"N"}))
        yield Fact(dof, frozenset({"propeller-wash", "speed-dependent-steering"}))
    if "motor" in file and dof == "surge":
        yield Fact(dof, frozenset({"actuator-lag"}), where=frozenset({"X"}))
    if file["actuators"] == "rudder" and dof == "surge":
        # Thrust goes with n|n|. One size of command shows no curve.
        yield Fact(dof, frozenset({"quadratic-actuator"}), _levels("X", runs) > 1)
    if file["actuators"] == "twin-thruster" and file["thruster"]["astern"] != 1.0:
        yield from _weaker_astern(dof, runs)
    odd = file.get("thruster", {}).get("odd")
    if odd:
        # A dead zone, and then a force that grows faster than the command: both need two sizes of command.
        yield Fact(dof, frozenset({"dead-zone", "quadratic-actuator"}), _levels(LETTERS[dof], runs) > 1)
        if command > _flattens(odd):
            yield Fact(dof, frozenset({"saturation"}))
    if file["sensors"].get("heading_quantum") and dof == "yaw":
        yield Fact(dof, frozenset({"quantisation"}), where=frozenset({"psi"}))
    if dof == "heave":  # MAVLink sends the rate of climb in whole centimetres a second
        yield Fact(dof, frozenset({"quantisation"}), where=frozenset({"w"}))


def _weaker_astern(dof: str, runs: Sequence[Trial]) -> Iterator[Fact]:
    """Yield the facts of two thrusters that are weaker astern.

    A turn command larger than that of surge takes the inner one astern. In surge this also weakens all commands astern.
    """
    both = [run for run in runs if "N" in run and "X" in run]
    hard = np.concatenate([_harder(run) for run in both]) if both else np.zeros(0, dtype=bool)
    slugs = frozenset({"asymmetric-thrust"})
    if dof == "surge":
        X = np.concatenate([run["X"].values for run in both]) if both else np.zeros(1)
        yield Fact(dof, slugs, min(-X.min(), X.max()) > 0.1 * np.abs(X).max(), frozenset({"X", "N+X"}))
    elif hard.any() and not hard.all():
        shown = 0.1 < float(np.mean(hard)) < 0.9 and _levels("N", runs) > 1
        yield Fact(dof, slugs, shown, frozenset({"N+X"}))


def _harder(run: Trial) -> NDArray[np.bool_]:
    """Return for each turn command whether it was larger than the surge command."""
    N, X = run["N"], run["X"]
    ahead = X.values[np.maximum(np.searchsorted(X.t, N.t, side="right") - 1, 0)]
    turning = (np.abs(N.values) > 0.0) & (np.abs(ahead) > 0.0)
    return np.asarray(np.abs(N.values) > np.abs(ahead))[turning]


def _flattens(odd: Sequence[float]) -> float:
    """Return the command with the largest slope of a thruster's curve."""
    u = np.linspace(0.0, 1.0, 201)
    force = sum(c * u ** (2 * k + 1) for k, c in enumerate(odd))
    slope = np.gradient(force, u)
    return float(u[np.argmax(slope)])


def _most(name: str, runs: Sequence[Trial]) -> float:
    sizes = [np.nanmax(np.abs(r[name].values)) for r in runs if name in r and len(r[name])]
    return float(max(sizes, default=0.0))


def _levels(name: str, runs: Sequence[Trial]) -> int:
    """Return the number of non-zero sizes of a command (to a tenth) with at least a twentieth of the samples."""
    sizes = np.concatenate([np.round(np.abs(run[name].values), 1) for run in runs if name in run])
    values, counts = np.unique(sizes, return_counts=True)
    return int(np.sum((values > 0.0) & (counts > len(sizes) / 20)))


def _authority(file: Mapping[str, Any], dof: str) -> float:
    """Return the force, or rudder angle, at full command."""
    if file["actuators"] == "rudder" and dof == "yaw":
        return float(file["yaw"]["full_rudder"])
    if file["actuators"] == "twin-thruster":
        each = file["thruster"]
        return float(each["full_thrust"] * (each["arm"] * (1.0 + each["astern"]) if dof == "yaw" else 2.0))
    return float(file.get(dof, {}).get("authority", 1.0))


@dataclass(frozen=True, slots=True)
class Case:
    """A flight: ``kind`` as in ``every_manoeuvre``. ``change``: a parameter of its model, changed by ``factor``."""

    vehicle: str
    kind: str
    force: str
    seed: int
    change: str = ""
    factor: float = 1.0

    @property
    def name(self) -> str:
        """Return the name of the folder."""
        return "-".join([self.vehicle, *self.kind.split(), *[self.force][: bool(self.force)], str(self.seed)])

    def __str__(self) -> str:
        changed = f" {self.change} x {self.factor:g}" if self.change else ""
        return f"{self.vehicle} {self.kind}{f' {self.force}' if self.force else ''} seed {self.seed}{changed}"


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of a case. ``miss``: reason if wrong. ``rejected``: no diagnosis. ``claims``: impossible causes."""

    case: Case
    summary: str
    miss: str = ""
    claims: str = ""
    rejected: bool = False
    seconds: float = 0.0


class RejectedBefore(AutotuneError):
    """The vehicle rejected this flight in an earlier run; the message is the one of that run."""


def flown(case: Case, folder: Path) -> Path:
    """Fly *case* into a run directory of *folder*, unless it exists, and return the directory.

    Raises
    ------
    AutotuneError
        The vehicle cannot fly it. The reason is kept, and the flight is not tried again.
    """
    place = folder / case.name
    if (place / "flown").exists():
        return place
    if (place / "refused").exists():
        raise RejectedBefore((place / "refused").read_text(encoding="utf-8"))
    shutil.rmtree(place, ignore_errors=True)  # of a flight that was stopped
    try:
        _fly(case, place)
    except AutotuneError as error:
        place.mkdir(parents=True, exist_ok=True)
        (place / "refused").write_text(reason_of(error), encoding="utf-8")
        raise
    (place / "flown").touch()
    return place


def reason_of(error: Exception) -> str:
    """Return the kind of an error and the first line of its message."""
    kind = "" if isinstance(error, RejectedBefore) else f"{type(error).__name__}: "
    return f"{kind}{error}".splitlines()[0]


def _fly(case: Case, place: Path) -> None:
    boat = open_vehicle(case.vehicle, seed=1).vehicle.data.is_boat
    link = MemoryLink(open_vehicle(case.vehicle, seed=case.seed, parameters={} if boat else SLOW_LOOP))
    link.is_simulated = True
    verb, _, axis = case.kind.rpartition(" ")
    connection = Connection("memory", opened=link)
    if verb == "tune":
        tune(TuneSettings(connection, place, axis=axis), Unattended(), SilentObserver(), "")
    elif verb:
        experiment(TuneSettings(connection, place, axis=axis), Unattended(), SilentObserver(), "")
    else:
        fly(
            FlySettings(case.kind, CommonSettings(connection, place), force=case.force),
            Unattended(),
            SilentObserver(),
            "",
        )


def run_case(case: Case, folder: Path) -> Outcome:
    """Fly and diagnose one case."""
    began = time.process_time()
    try:
        place = flown(case, folder)
        runs = load_runs(place)
        began = time.process_time()
        if case.change:
            return _numbers(case, place, runs, began)
        diagnosis = diagnose(runs)
    except (AutotuneError, FileNotFoundError) as error:
        return Outcome(case, reason_of(error), rejected=True)
    seconds = time.process_time() - began
    report = json.loads(diagnosis.to_json())
    truth = truth_of(case.vehicle, diagnosis.base_model.base.form.dofs, runs)
    groups = [set(group) for group in report["indistinguishable"]]
    found = [(f["cause"], f["place"]) for f in report["found"]]
    names = [{s}.union(*(g for g in groups if s in g)) for s, _ in found]
    named = list(zip(names, (p for _, p in found), strict=True))
    right = [any(fact.covers(*own) for fact in truth.facts) for own in named]
    wrong = [f"{s} of {p}" for (s, p), good in zip(found, right, strict=True) if not good]
    lacking = [f for f in truth.facts if f.shown and not any(f.covers(*own) for own in named)]
    claims = [f"{s} of {p}" for s, p in found if dof_of(p) in DOFS and dof_of(p) not in truth.moves]
    if "sway" not in truth.moves:
        text = " ".join(report["gave_away"]["findings"] + report["left"]["findings"])
        claims += [s for s, _ in found if s in SLIDING]
        claims += [w for w in ("speed sideways", "drift angle") if w in text]
    sizes = [" ".join(f"{v['value']:.3g}" for v in f["parameters"].values()) for f in report["found"]]
    numbers = ", ".join(f"{s}@{p}({own})" for (s, p), own in zip(found, sizes, strict=True))
    summary = f"{report['verdict']}: {numbers or 'nothing'} {[d['slug'] for d in report['doubts']]}"
    miss = "; ".join([*(f"reports {w}" for w in wrong), *(f"lacks {' or '.join(sorted(f.slugs))}" for f in lacking)])
    return Outcome(case, summary, miss, ", ".join(claims), seconds=seconds)


NUMBERS = {"inertia": ("alpha",), "damping": ("beta", "beta_quadratic"), "gain": (), "delay": ("delay",)}


def _numbers(case: Case, place: Path, runs: Sequence[Trial], began: float) -> Outcome:
    """Diagnose with one parameter of the run's model file changed; a gain changes all parameters per gain."""
    file = json.loads((place / "model.json").read_text())
    keys = NUMBERS[case.change] or ("alpha", "beta", "beta_quadratic")
    changed = [k for k in keys if file.get(k)]
    if file.get("model") != "single-dof" or not changed:
        return Outcome(case, "no such parameter in the file", rejected=True)
    factor = 1.0 / case.factor if case.change == "gain" else case.factor
    other = place / f"model-{case.change}-{case.factor:g}.json"
    own = {**file, **{k: factor * file[k] for k in changed}}
    own.pop("known_from", None)
    other.write_text(json.dumps(own))
    diagnosis = diagnose(runs, model=load_model(other))
    report = json.loads(diagnosis.to_json())
    rows = [r["name"] for r in (report["numbers"] or {}).get("rows", ()) if r["wrong"]]
    causes = [f"{f['cause']}@{f['place']}" for f in report["found"]]
    vehicle, dof = file_of(case.vehicle), diagnosis.base_model.base.form.dofs[0]
    true = vehicle.get(dof, {}).get("bias", 0.0) / _authority(vehicle, dof)
    # The trim of the tune may be wrong. It may then be reported, too.
    own_fault = {"delta"} if abs(file["delta"] - true) > SEEN * abs(true) else set()
    right = set(rows) - own_fault == set(changed)
    summary = f"{report['verdict']}: wrong {rows}, causes {causes}"
    truth = truth_of(case.vehicle, diagnosis.base_model.base.form.dofs, runs)
    groups = [set(group) for group in report["indistinguishable"]]
    false = [
        f["cause"]
        for f in report["found"]
        if not any(
            x.covers({f["cause"]}.union(*(g for g in groups if f["cause"] in g)), f["place"]) for x in truth.facts
        )
    ]
    miss = "" if right and not false else f"wrong should be {changed}"
    return Outcome(case, summary, miss, seconds=time.process_time() - began)


def chosen(args: argparse.Namespace) -> Iterator[Case]:
    """Yield the chosen cases."""
    words = [w for w in args.only.split(",") if w]
    for seed in range(1, args.seeds + 1):
        for vehicle in args.vehicles or (sorted(VEHICLES) if args.whole else DEFAULT_VEHICLES):
            for kind, force in (*tunes(vehicle), *cases(vehicle, set(), set())):
                case = Case(vehicle, kind, force, seed)
                if kind in NOT_DIAGNOSED or (not args.whole and not words and kind not in DEFAULT_KINDS):
                    continue
                if words and not any(w in str(case) for w in words):
                    continue
                if not args.numbers:
                    yield case
                elif kind.startswith("tune"):
                    yield from (replace(case, change=c, factor=f) for c in NUMBERS for f in (1.2, 1.5))


def lower_bound(right: int, of: int) -> float:
    """Return the lower 95 % bound of a rate (Clopper and Pearson)."""
    return float(beta_law.ppf(0.05, right, of - right + 1)) if right else 0.0


def main() -> int:
    """Run the cases, and print the misses and the rates."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("vehicles", nargs="*", metavar="VEHICLE")
    parser.add_argument(
        "--only", default="", metavar="WORD,..", help="only cases with one of these words in their name"
    )
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--whole", action="store_true", help="every vehicle, every manoeuvre by every force")
    parser.add_argument(
        "--numbers", action="store_true", help="check the model file of each tune with one parameter changed"
    )
    parser.add_argument("--keep", type=Path, help="folder that keeps the run directories, to use them again")
    parser.add_argument("--verbose", action="store_true", help="print a line per case, not only per miss")
    args = parser.parse_args()
    todo = list(chosen(args))
    outcomes: list[Outcome] = []
    with tempfile.TemporaryDirectory() as scratch:
        run = partial(run_case, folder=args.keep or Path(scratch))
        for done in executor_for(args.jobs).map(run, todo):
            outcomes.append(done)
            if done.miss or done.claims or args.verbose:
                mark = "rejected" if done.rejected else "MISS" if done.miss else "CLAIM" if done.claims else "right"
                why = "; ".join(w for w in (done.miss, done.claims) if w)
                print(f"{mark:9}{done.case}: {why}{' | ' * bool(why)}{done.summary} ({done.seconds:.0f} s)", flush=True)
    judged = [o for o in outcomes if not o.rejected]
    right, claims = sum(not o.miss for o in judged), sum(bool(o.claims) for o in judged)
    seconds = [o.seconds for o in judged] or [0.0]
    what = "model files with exactly the changed number wrong" if args.numbers else "our runs with the right diagnosis"
    figures = [
        count(what, right, len(judged), least=GOAL),
        Figure("lower 95 % bound of that rate", lower_bound(right, len(judged))),
        Figure("causes reported for motions that the hull cannot make", claims, most=0),
        Figure("processor time of a diagnosis, median", float(np.median(seconds)), "s"),
        Figure("processor time of a diagnosis, longest", max(seconds), "s"),
        count("runs rejected by the vehicle or by the diagnosis", len(outcomes) - len(judged), len(outcomes)),
    ]
    headline(f"own_runs{'-numbers' * args.numbers}", "our own runs diagnosed, compared with the vehicle file", figures)
    return 0 if judged and right >= GOAL * len(judged) and not claims else 1


if __name__ == "__main__":
    sys.exit(main())
