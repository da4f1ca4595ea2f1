"""Currents that change within a run, on records of a craft that moves ahead and turns."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_autotune.diagnose import diagnose
from gcs_autotune.trial import Channel, Trial

DT, DURATION = 0.1, 40.0
V_NORTH, V_EAST = 0.12, -0.05
NOISE = {"u": 0.02, "r": 0.02, "psi": 0.01}


def drifting(seed: int, growth: float = 0.0, turn: float = 0.0) -> Trial:
    """Speed over ground in a current ``(1 + growth t) V`` that turns: 10 kg, drag 8 N s/m, 2 kg m^2, 1.5 N m s."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, DURATION, DT)
    X, N = (np.repeat(rng.choice(levels, len(t) // 40 + 1), 40)[: len(t)] for levels in ((2.0, 5.0), (-0.6, 0.0, 0.6)))
    u, r, psi = np.zeros(len(t)), np.zeros(len(t)), np.zeros(len(t))
    fade_u, fade_r = np.exp(-0.8 * DT), np.exp(-0.75 * DT)
    for k in range(len(t) - 1):
        end_u, end_r = X[k] / 8.0, N[k] / 1.5
        u[k + 1] = end_u + (u[k] - end_u) * fade_u
        r[k + 1] = end_r + (r[k] - end_r) * fade_r
        psi[k + 1] = psi[k] + end_r * DT + (r[k] - end_r) * (1.0 - fade_r) / 0.75
    seen_from = psi - turn * t
    over_ground = u + (1.0 + growth * t) * (V_NORTH * np.cos(seen_from) + V_EAST * np.sin(seen_from))
    seen = {"u": over_ground, "r": r, "psi": psi}
    units = {"u": "m/s", "r": "rad/s", "psi": "rad"}
    channels = {n: Channel(n, units[n], t, x + rng.normal(0.0, NOISE[n], len(t))) for n, x in seen.items()}
    return Trial(f"run{seed}", channels | {"X": Channel("X", "N", t, X), "N": Channel("N", "N m", t, N)})


def test_a_current_that_reverses_halfway_is_identified_although_its_mean_is_zero() -> None:
    growth = -2.0 / DURATION
    found = diagnose([drifting(seed, growth) for seed in (1, 2, 3)], effects=["steady-current", "changing-current"])
    assert [cause.effect.slug for cause in found.causes] == ["changing-current"]
    numbers = {n: v.value for n, v in found.causes[0].parameters.items()}
    assert numbers["V_x"] == pytest.approx(V_NORTH, abs=0.01)
    assert numbers["V_y"] == pytest.approx(V_EAST, abs=0.01)
    assert numbers["growth"] == pytest.approx(growth, rel=0.1)


def test_a_steady_current_is_replaced_by_the_changing_one_that_explains_it() -> None:
    turn = 1.6 / DURATION
    found = diagnose([drifting(seed, turn=turn) for seed in (1, 2, 3)], effects=["steady-current", "changing-current"])
    assert [step.cause for step in found.ranking if step.step == 2][:1] == ["changing-current"]
    assert [cause.effect.slug for cause in found.causes] == ["changing-current"]
    numbers = {n: v.value for n, v in found.causes[0].parameters.items()}
    assert numbers["V_x"] == pytest.approx(V_NORTH, abs=0.01)
    assert numbers["turn"] == pytest.approx(turn, rel=0.1)
