"""Miskovic2010, section 7.5: 120 self-oscillations of the boat Charlie on two days, by IS-O and by least squares.

Run: ``python3 -m benchmarks.thesis_7_5 [--workers 2]``. It is the study ``benchmarks/studies/thesis_7_5.toml``; a
stopped run continues. Each case flies one relay and identifies yaw by IS-O and by least squares, with linear and with
quadratic drag, at Charlie's sampling time of 0.5 s.

The figures are those of the section, with its numbers as goals:

* valid experiments of each day: five periods that satisfy (7.12). Thesis: 60 and 48 of 60.
* pairs of valid experiments of one day with different relay outputs, whose decision (7.1)-(7.2) is the linear model,
  without margin (criterion 1). Thesis: about 90 %. The drag of table 7.12, which the simulated boat has, depends on the
  speed. For this boat the exact limit cycles, without wind, waves, noise and sampling, decide 83 % of all pairs and
  94 % of the pairs of one speed for the linear model (:func:`exact_cycle`). So the pairs of one speed are a figure of
  their own.
* the same decision, with drag over inertia in the pairs of two speeds. In table 7.12 both change with the speed by
  nearly the same factor, as by a rudder of another effect. This factor cancels.
* error of the drag of IS-O against least squares, mean of each day and speed (7.15). Thesis: at most 22 %.
* the same error of the time constant alpha/beta (7.11), at most two sampling times. Thesis: more than 90 %.

Wind and waves of the two days were chosen, because the section shows the wind only as a figure.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations, product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import brentq

from benchmarks.results import Figure, count, headline
from benchmarks.studies import FOLDER, rows_of
from gcs_autotune.errors import ManoeuvreError
from gcs_autotune.identify import Structure, fit_axis
from gcs_autotune.identify.relay.iso import MARGINS, decide, estimate
from gcs_autotune.identify.relay.limit_cycle import find_cycles
from gcs_autotune.identify.result import IsoEstimate, LimitCycle
from gcs_autotune.link import Session, open_craft, open_link
from gcs_autotune.manoeuvres import Envelope, Relay, RelaySettings, Sequencer
from gcs_autotune.observer import SilentObserver
from gcs_autotune.study import Plan, load_plan
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.connection import telemetry_rates
from sitl import load_vehicle

T_S = 0.5
"""Sampling time [s] of the identification on Charlie: Miskovic2010, section 3.3."""
RATE = 10.0
"""Rate [Hz] of attitude and relay; the firmware does not accept 2 Hz."""
FULL_RUDDER, FULL_N = 30.0, 8.0
"""Largest rudder angle [deg], and propeller voltage at full throttle [V]: the vehicle file of Charlie."""
STRUCTURES: tuple[Structure, ...] = ("linear", "nonlinear")


def flown(seed: int, uri: str, n2: float, C: float, x_a: float) -> dict[str, Any]:
    """Fly one relay of *C* [deg of rudder] and *x_a* [deg] at the squared voltage *n2* [V^2], and identify yaw.

    Returns ``valid``; the readings of the limit cycle and the result of IS-O (``cycle.*``, ``iso.*``); least squares
    with both drags (``linear.*``, ``nonlinear.*``). Inputs are normalised (-1 to 1).
    """
    trial, why = _relay(seed, uri, n2, C, x_a)
    cycles = find_cycles(trial, "yaw")
    found: dict[str, Any] = {"valid": not why and bool(cycles) and cycles[-1].valid, "ending": why or "completed"}
    if cycles:
        found |= _readings(estimate(cycles[-1]))
    for structure in STRUCTURES:
        by = fit_axis(trial, dof="yaw", structure=structure, delay=0.0, method="least-squares")
        drag = by.model.beta if structure == "linear" else by.model.beta_quadratic
        found |= {f"{structure}.alpha": by.model.alpha, f"{structure}.beta": drag, f"{structure}.fit": by.fit_percent}
    return found


CYCLE = ("C", "x_a", "x_a_star", "X_m", "x_0", "omega", "T_H", "T_L", "periods", "scatter")
"""Readings of a limit cycle that are stored."""


def _readings(own: IsoEstimate) -> dict[str, Any]:
    found = {f"cycle.{name}": getattr(own.cycle, name) for name in CYCLE}
    return found | {f"iso.{name}": getattr(own, name) for name in ("alpha", "beta", "beta_quadratic", "delta")}


def _relay(seed: int, uri: str, n2: float, C: float, x_a: float) -> tuple[Trial, str]:
    """Return the record of a relay, and why it did not end by five equal periods."""
    kept: list[Trial] = []
    settings = RelaySettings(
        signal="psi",
        force="N",
        output=C / FULL_RUDDER,
        hysteresis=math.radians(x_a),
        throttle=math.sqrt(n2) / FULL_N,
        keep_still=False,
    )
    with open_link(uri, seed=seed) as link, Session(link) as session:
        craft = open_craft(session, wanted_rates=telemetry_rates(RATE))
        craft.arm()
        sequencer = Sequencer(craft, Envelope(distance=2000.0), SilentObserver(), kept.append)
        try:
            sequencer.fly(Relay(settings, "relay"))
        except ManoeuvreError as error:
            return kept[-1], str(error)
    return kept[-1], ""


def estimate_of(row: Mapping[str, Any]) -> IsoEstimate:
    """Return the result of IS-O in a *row* of the study."""
    cycle = LimitCycle(**{name: row[f"cycle.{name}"] for name in CYCLE}, valid=bool(row["valid"]))
    return IsoEstimate(cycle, row["iso.alpha"], row["iso.beta"], row["iso.beta_quadratic"], row["iso.delta"], 0.0)


def exact_cycle(alpha: float, beta: float, C: float, x_a: float) -> LimitCycle:
    """Return the limit cycle of ``alpha rdot + beta r = +/- C`` with a relay that switches at ``+/- x_a`` [rad]."""
    u, constant = C / beta, alpha / beta

    def turned(T: float) -> float:
        r_0 = -u * math.tanh(0.5 * T / constant)
        return u * T + (r_0 - u) * constant * (1.0 - math.exp(-T / constant)) - 2.0 * x_a

    T = float(brentq(turned, 1e-3, 1e3))
    r_0 = -u * math.tanh(0.5 * T / constant)
    still = constant * math.log((u - r_0) / u)  # the heading is at its extreme
    X_m = x_a - u * still - (r_0 - u) * constant * (1.0 - math.exp(-still / constant))
    return LimitCycle(
        C=C,
        x_a=x_a,
        x_a_star=x_a,
        X_m=X_m,
        x_0=0.0,
        omega=math.pi / T,
        T_H=T,
        T_L=T,
        periods=5,
        scatter=0.0,
        valid=True,
    )


def exact_rows(plan: Plan) -> list[dict[str, Any]]:
    """Return the rows of one day without wind, waves, noise and sampling, as :func:`decisions` reads them."""
    yaw = load_vehicle("charlie").tables["yaw"]
    drags = {n2: (a, b) for n2, a, b in zip(*(yaw[name]["value"] for name in ("n2", "alpha", "beta")), strict=True)}
    rows = []
    for n2, C, x_a in product(*(plan.vary[f"argument.{name}"].values for name in ("n2", "C", "x_a"))):
        own = estimate(exact_cycle(*drags[float(n2)], math.radians(float(C)), math.radians(float(x_a))))
        rows.append({"argument.n2": n2, "argument.C": C, "argument.x_a": x_a, **_readings(own), "valid": True})
    return rows


def decisions(
    valid: Sequence[Mapping[str, Any]], margin: str, *, one_speed: bool = False, over_inertia: bool = False
) -> tuple[int, int, int]:
    """Return how many pairs with different outputs decide for linear drag, for quadratic drag, and for neither.

    one_speed : only pairs of one speed. over_inertia : in pairs of two speeds, compare the drag over the inertia.
    """
    found = []
    for a, b in combinations(valid, 2):
        two_speeds = a["argument.n2"] != b["argument.n2"]
        if a["argument.C"] != b["argument.C"] and not (one_speed and two_speeds):
            pair = [_over_inertia(estimate_of(r)) if over_inertia and two_speeds else estimate_of(r) for r in (a, b)]
            found.append(decide(*pair, margin).verdict)
    return found.count("linear"), found.count("nonlinear"), found.count("undecided")


def _over_inertia(own: IsoEstimate) -> IsoEstimate:
    return replace(own, alpha=1.0, beta=own.beta / own.alpha, beta_quadratic=own.beta_quadratic / own.alpha)


def compared(rows: Sequence[Mapping[str, Any]]) -> list[tuple[float, float]]:
    """Return (error of the drag [%], error of the time constant [s]) of every valid experiment of one day.

    The reference is the mean of least squares over the experiments of the same speed.
    """
    found = []
    for row in (r for r in rows if r["valid"]):
        alike = [r for r in rows if r["argument.n2"] == row["argument.n2"]]
        alpha, beta = (float(np.mean([r[f"linear.{name}"] for r in alike])) for name in ("alpha", "beta"))
        drag = 100.0 * abs(row["iso.beta"] / beta - 1.0)
        found.append((drag, abs(row["iso.alpha"] / row["iso.beta"] - alpha / beta)))
    return found


def figures_of(day: str, rows: Sequence[Mapping[str, Any]], valid: float) -> list[Figure]:
    """Print what the section prints of one day, and return its figures. valid : fraction valid in Miskovic2010."""
    good = [row for row in rows if row["valid"]]
    print(f"\n{day}: valid experiments of 15 (five speeds, three hystereses) by relay output [deg]")
    for C in sorted({row["argument.C"] for row in rows}):
        print(f"  C = {C:2.0f}: {sum(bool(row['valid']) for row in rows if row['argument.C'] == C)}")
    for row in (r for r in rows if not r["valid"]):
        print(f"  not valid: {_named(row)}: {row['ending']}")
    print(f"  decisions of {day} (correct, false, undecided) by margin: all pairs, and pairs of one speed")
    for margin in MARGINS:
        print(f"  {margin:9s} {decisions(good, margin)}   {decisions(good, margin, one_speed=True)}")
    errors = compared(rows)
    for row, (drag, constant) in zip(good, errors, strict=True):
        if drag > MOST_DRAG or constant > 2.0 * T_S:
            print(f"  apart: {_named(row)}: drag by {drag:.1f} %, time constant by {constant:.2f} s")
    right, wrong, neither = decisions(good, "none")
    alike = decisions(good, "none", one_speed=True)
    scaled = decisions(good, "none", over_inertia=True)
    drags, constants = (np.array(column) for column in zip(*errors, strict=True))
    linear, nonlinear = (float(np.mean([row[f"{name}.fit"] for row in rows])) for name in STRUCTURES)
    return [
        count(f"{day}: valid experiments", len(good), len(rows), least=valid),
        count(f"{day}: pairs decided for the linear model, no margin", right, right + wrong + neither, least=0.9),
        count(f"{day}: the same, pairs of one speed", alike[0], sum(alike), least=0.9),
        count(f"{day}: all pairs, of two speeds by drag over inertia", scaled[0], sum(scaled), least=0.9),
        Figure(f"{day}: error of beta against least squares, largest", float(drags.max()), "%", most=MOST_DRAG),
        count(f"{day}: error of beta below 15 %", int((drags < 15.0).sum()), len(drags), least=0.9),
        count(f"{day}: time constant within two samples", int((constants <= 2 * T_S).sum()), len(good), least=0.9),
        Figure(f"{day}: fit of least squares, linear less quadratic drag", linear - nonlinear, "%", least=0.0),
    ]


MOST_DRAG = 22.0
"""Largest error of the drag [%]: Miskovic2010, section 7.5.3."""


def _named(row: Mapping[str, Any]) -> str:
    return f"n2 = {row['argument.n2']:.0f} V^2, C = {row['argument.C']:.0f} deg, x_a = {row['argument.x_a']:.0f} deg"


def main() -> None:
    """Print the tables and figures."""
    parser = argparse.ArgumentParser(prog="python3 -m benchmarks.thesis_7_5", description=__doc__.splitlines()[0])
    parser.add_argument("--workers", type=int, default=2)
    args = parser.parse_args()
    plan = load_plan(FOLDER / "thesis_7_5.toml", Path.cwd())
    days = plan.vary["effect"].values
    rows = rows_of("thesis_7_5", args.workers)
    exact, alike = (decisions(exact_rows(plan), "none", one_speed=one) for one in (False, True))
    scaled = decisions(exact_rows(plan), "none", over_inertia=True)
    figures = list[Figure]()
    for number, (day, valid) in enumerate(zip(days, (1.0, 0.8), strict=True), 1):
        figures += figures_of(f"day {number}", [row for row in rows if row["effect"] == day], valid)
    figures += [
        count("exact limit cycles: pairs decided for the linear model", exact[0], sum(exact)),
        count("exact limit cycles: the same, pairs of one speed", alike[0], sum(alike)),
        count("exact limit cycles: all pairs, of two speeds by drag over inertia", scaled[0], sum(scaled)),
    ]
    headline("thesis_7_5", "Miskovic2010, section 7.5: 120 relays of Charlie by IS-O and least squares", figures)


if __name__ == "__main__":
    main()
