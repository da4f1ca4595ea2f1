"""Surge and sway of runs with a track: along the craft, not north; before a wall by the distance to it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from gcs_autotune.identify import fit_axis, validate
from gcs_autotune.identify.relay.limit_cycle import find_cycles
from gcs_autotune.identify.signals import prepare
from gcs_autotune.report.study.tables import unseen_table
from gcs_autotune.trial import Channel, Mark, Trial

ALPHA, BETA = 8.0, 100.0
"""The craft: alpha du/dt + beta |u| u = X, X a normalised output."""
TICK, C, X_A = 0.1, 0.3, 0.1


def swung(period: float = TICK, heading: float = 1.2, noise: float = 0.02, seed: int = 3, seconds: float = 100.0):
    """A relay on the distance ahead, measured every *period* [s] and sent every tick; its switches are marked."""
    rng = np.random.default_rng(seed)
    u = ahead = seen = 0.0
    side, rows, marks = 1.0, [], []
    every = round(period / TICK)
    for i in range(round(seconds / TICK)):
        t = i * TICK
        if i % every == 0:
            seen = round(ahead, 2)
        if side * seen >= X_A - 1e-9:
            side = -side
            marks.append(Mark(t, "switch", {"x": seen, "X": side * C}))
        rows.append((t, side * C, u, ahead, seen))
        for _ in range(20):
            u += TICK / 20 * (side * C - BETA * abs(u) * u) / ALPHA
            ahead += TICK / 20 * u
    t, X, u_true, way, d = np.array(rows).T
    psi = heading + rng.normal(0.0, 0.01, len(t))
    place = rng.normal(0.0, noise, (2, len(t)))
    channels = {
        "X": Channel("X", "1", t, X),
        "u": Channel("u", "m/s", t, u_true + rng.normal(0.0, noise, len(t))),
        "x": Channel("x", "m", t, way * math.cos(heading) + place[0]),
        "y": Channel("y", "m", t, way * math.sin(heading) + place[1]),
        "psi": Channel("psi", "rad", t, psi),
        "d": Channel("d", "m", t, 2.0 - d),
    }
    meta = {"manoeuvre": "wall-relay", "dof": "surge", "signal": "d", "x_a": X_A, "C": C}
    return Trial("wall", channels, tuple(marks), meta=meta)


def without(trial: Trial, *names: str) -> Trial:
    return replace(trial, channels={n: c for n, c in trial.channels.items() if n not in names})


@pytest.mark.parametrize("heading", [0.0, 1.2, math.pi / 2.0, 3.0])
def test_a_correct_surge_model_predicts_the_distance_ahead_on_any_heading(heading: float) -> None:
    run = without(swung(heading=heading), "d")
    fit = fit_axis(run, dof="surge")
    found = validate(fit.model, run)
    predicted = {t.signal: s.fit_percent for t, s in zip(found.traces, found.statistics, strict=True)}
    assert predicted["x"] > 75.0
    (row,) = [r for r in unseen_table(found, "surge").rows if r[1].startswith("x")]
    assert row[1] == "x, distance ahead"


def test_a_curved_track_is_left_out_if_the_speed_shows_surge() -> None:
    run = without(swung(), "d")
    t = run["psi"].t
    turning = replace(run, channels={**run.channels, "psi": Channel("psi", "rad", t, 0.05 * t)})
    (segment,) = prepare(turning, "surge")
    assert set(segment.signals) == {"u"}
    assert not [n for n in segment.notes if n.slug == "not-straight"]


def test_a_relay_on_the_distance_is_analysed_by_distance_although_speed_was_recorded() -> None:
    run = swung(period=1.0)
    (cycle,) = find_cycles(run, "surge")
    switched = [abs(float(m.detail["x"])) for m in run.marks][-2 * cycle.periods :]
    assert cycle.x_a_star == pytest.approx(sum(switched) / len(switched), abs=1e-6)
    assert cycle.valid and cycle.scatter < 0.1
    fit = fit_axis(run, dof="surge")
    assert not {d.slug for d in fit.doubts} & {"unsettled", "not-self-oscillation", "poor-fit"}
    assert fit.parameters["alpha_u"].value == pytest.approx(ALPHA, abs=4.0 * fit.parameters["alpha_u"].std)
    by_iso = fit_axis(run, dof="surge", method="iso", structure="nonlinear")
    assert by_iso.parameters["beta_uu"].value == pytest.approx(BETA, rel=0.25)


def test_repeated_messages_of_a_slow_rangefinder_are_not_measurements() -> None:
    run = without(swung(period=1.0), "u", "x", "y")
    (segment,) = prepare(run, "surge")
    assert len(segment.signals["x"].t) == pytest.approx(100, abs=1)
    fit = fit_axis(run, dof="surge")
    assert fit.parameters["alpha_u"].value == pytest.approx(ALPHA, rel=0.05)
    assert fit.parameters["beta_uu"].value == pytest.approx(BETA, rel=0.05)
    quick = without(swung(), "u", "x", "y")
    (segment,) = prepare(quick, "surge")
    assert len(segment.signals["x"].t) == len(quick["d"])
