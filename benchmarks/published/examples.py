"""Miskovic2010, examples 6.2, 6.3 and 7.1 to 7.3: simulated relays, identified by our functions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from benchmarks.published.section import Row, Section, rows_of
from benchmarks.published.water import DEG, Plant, Relay, relay_run
from gcs_autotune.identify import fit_axis
from gcs_autotune.identify.relay.iso import decide, estimate
from gcs_autotune.identify.relay.limit_cycle import find_cycles
from gcs_autotune.identify.relay.linear_process import identify_process
from gcs_autotune.identify.result import LimitCycle, Structure
from gcs_autotune.trial import Trial

__all__ = ["delay_and_sampling", "falcon", "nonlinear_yaw"]

GOAL = 6.0
"""Largest error [%]. The printed cycles come from Miskovic2010's simulation with an unknown step."""

PROCESS: Plant = (0.3 / 50.0, 1.0 / 50.0, 0.0, 0.0)
"""50 / (s (0.3 s + 1)) of examples 6.2 and 6.3."""

FALCON: Mapping[str, Plant] = {"yaw": (80.0, 300.0, 10.0, 0.0), "heave": (130.0, 200.0, 20.0, 10.0)}
NONLINEAR: Plant = (1.018, 0.0, 1.257, 0.0)

PRINTED_ERRORS = {"K, no delay correction": 53.96, "T, no delay correction": 101.2, "K": 10.0, "T": 15.0}
"""Example 6.2 [%], Table 6.1. K without correction is printed as +156.6 %, but its value 76.98 is +54 %."""

PRINTED_SAMPLED = {"K, switching as set": 35.0, "T, switching as set": 75.0, "K": 6.0, "T": 4.0}
"""Example 6.3 [%]."""


def _errors(cycle: LimitCycle, delay: float = 0.0) -> tuple[float, float]:
    found = identify_process([cycle], n=1, m=0, integrators=1, delay=delay)
    return 100.0 * (found.numerator[0] / 50.0 - 1.0), 100.0 * (found.denominator[1] / 0.3 - 1.0)


def delay_and_sampling(_: Mapping[str, Any]) -> list[Section]:
    """Examples 6.2 (delay 0.1 s) and 6.3 (sampled every 0.1 s): errors of K and T, without and with the correction."""
    (late,) = find_cycles(relay_run(PROCESS, Relay(1.0, 10.0), 40.0, "heave", delay=0.1), "heave")
    (coarse,) = find_cycles(relay_run(PROCESS, Relay(1.0, 16.0), 40.0, "heave", dt=0.1, h=0.01), "heave")
    ours = (*_errors(late), *_errors(late, 0.1))
    sampled = (*_errors(replace(coarse, x_a_star=16.0)), *_errors(coarse))
    return [
        Section(title, "simulated here; errors in percentage points", _points(printed, found), 4.0)
        for title, printed, found in (
            ("Example 6.2: relay with delay", PRINTED_ERRORS, ours),
            ("Example 6.3: relay sampled", PRINTED_SAMPLED, sampled),
        )
    ]


def _points(printed: Mapping[str, float], ours: Sequence[float]) -> tuple[Row, ...]:
    """Return errors as final values (100 % + error), so that a few points are a few percent."""
    return tuple(
        Row(f"100 % + error of {n}", 100.0 + p, 100.0 + o) for (n, p), o in zip(printed.items(), ours, strict=True)
    )


def _flown(plant: Plant, rows: Sequence[Sequence[float]], dof: str) -> tuple[list[Row], list[Trial]]:
    """Fly and read the experiments of one table; rows (x_a, C, X_m, omega, alpha, beta, beta_quadratic)."""
    scale = DEG if dof == "yaw" else 1.0
    names = ("X_m", "omega", "alpha", "beta", "beta_quadratic")
    found, runs = [], []
    for x_a, C, *printed in rows:
        run = relay_run(plant, Relay(C, x_a * scale), 30.0, dof)
        (cycle,) = find_cycles(run, dof)
        got = estimate(cycle)
        ours = (cycle.X_m / scale, cycle.omega, got.alpha, got.beta, got.beta_quadratic)
        found += rows_of(f"{dof} C {C:g}", names, printed, ours)
        runs.append(run)
    return found, runs


def _verdict(runs: Sequence[Trial], dof: str) -> str:
    one, other = (estimate(cycle) for run in runs for cycle in find_cycles(run, dof))
    return decide(one, other, "sigma").verdict


def _refined(plant: Plant, runs: Sequence[Trial], dof: str, structure: Structure) -> Section:
    """Return the fit of the same runs by output error, compared with the true parameters."""
    model = fit_axis([_thinned(r) for r in runs], dof=dof, structure=structure, delay=0.0).model
    ours = (model.alpha, model.beta, model.beta_quadratic)
    rows = [r for r in rows_of(dof, ("alpha", "beta", "beta_quadratic"), plant[:3], ours) if r.published]
    return Section(f"the same {dof} runs refined, against the truth", "simulated here, output error", tuple(rows), 0.8)


def _thinned(run: Trial) -> Trial:
    """Return the run with its position at 10 Hz."""
    names = [n for n in run.channels if n in ("psi", "z", "x")]
    thin = {n: replace(run[n], t=run[n].t[::50], values=run[n].values[::50]) for n in names}
    return replace(run, channels={**run.channels, **thin})


def falcon(tables: Mapping[str, Any]) -> list[Section]:
    """Return examples 7.1 and 7.2."""
    sections = []
    for dof, title in (("yaw", "Example 7.1: FALCON yaw"), ("heave", "Example 7.2: FALCON heave")):
        rows, runs = _flown(FALCON[dof], tables["falcon_seed_002"][f"{dof}_iso"], dof)
        basis = f"relay simulated here; decided: {_verdict(runs, dof)} (Miskovic2010: linear)"
        sections += [Section(title, basis, tuple(rows), GOAL), _refined(FALCON[dof], runs, dof, "affine")]
    return sections


def nonlinear_yaw(tables: Mapping[str, Any]) -> list[Section]:
    """Return example 7.3, tables 7.5 and 7.6."""
    rows, runs = _flown(NONLINEAR, tables["nonlinear_yaw_tables_7_5_7_6"]["iso"], "yaw")
    basis = f"relay simulated here; decided: {_verdict(runs, 'yaw')} (Miskovic2010: nonlinear)"
    title = "Example 7.3: nonlinear yaw, tables 7.5 and 7.6"
    return [Section(title, basis, tuple(rows), GOAL), _refined(NONLINEAR, runs, "yaw", "nonlinear")]
