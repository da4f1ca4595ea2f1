"""Runs in gusts: a horizon cuts them into pieces, which yield hypotheses at most; calm runs are not cut."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_autotune.diagnose import diagnose
from gcs_autotune.errors import UsageError
from gcs_autotune.identify.problems import plain_form
from gcs_autotune.identify.signals import prepare_as_recorded, within_horizon
from gcs_autotune.trial import Channel, Trial

pytestmark = pytest.mark.slow

FEW = ("dead-zone", "input-bias", "quadratic-drag", "compass-deviation")


def sailed(seed: int, gusts: float, width: float, n: int = 900) -> Trial:
    """Return a yaw run of *n* samples under steps, with a drifting moment and a dead zone."""
    rng = np.random.default_rng(seed)
    t = 0.1 * np.arange(n)
    N = np.repeat(rng.uniform(-0.6, 0.6, n // 30 + 1), 30)[:n]
    acting = np.sign(N) * np.maximum(np.abs(N) - width, 0.0)
    gust, r, psi = 0.0, np.zeros(n), np.zeros(n)
    for k in range(n - 1):
        gust += -0.02 * gust + gusts * rng.normal()
        end = 0.8 * (acting[k] + gust)
        r[k + 1] = end + math.exp(-0.1) * (r[k] - end)
        psi[k + 1] = psi[k] + 0.05 * (r[k] + r[k + 1])
    columns = {"N": ("N m", N), "r": ("rad/s", r + rng.normal(0.0, 0.003, n)), "psi": ("rad", psi)}
    columns["psi"] = ("rad", psi + rng.normal(0.0, 0.003, n))
    return Trial(f"run{seed}", {c: Channel(c, unit, t, x) for c, (unit, x) in columns.items()})


def test_pieces_are_no_longer_than_the_horizon_and_keep_every_sample_and_command() -> None:
    run = sailed(1, 0.0, 0.0)
    segments, _ = prepare_as_recorded([run], plain_form([run]))
    pieces = within_horizon(segments, 25.0)
    assert len(pieces) == 4
    assert all(p.stamps[-1] - p.start <= 25.0 for p in pieces)
    assert sum(len(p.signals["r"].t) for p in pieces) == len(run["r"])
    assert all(np.array_equal(p.passage.t_in, segments[0].passage.t_in) for p in pieces)
    assert within_horizon(segments, math.inf)[0] is segments[0]


def test_an_invalid_horizon_is_rejected() -> None:
    with pytest.raises(UsageError, match="horizon"):
        diagnose(sailed(1, 0.0, 0.0), effects=FEW, horizon=0.0)


def test_in_gusts_a_cause_is_a_hypothesis_at_most() -> None:
    diagnosis = diagnose([sailed(seed, 0.02, 0.15) for seed in (2, 3)], effects=FEW)
    assert diagnosis.verdict in ("partly-explained", "unexplained")
    named = {c.effect.slug for c in diagnosis.causes}
    short = any(d.slug == "short-horizon" for d in diagnosis.doubts)
    assert named <= {"dead-zone"}
    assert not short or named


def test_runs_without_process_noise_are_not_cut() -> None:
    diagnosis = diagnose([sailed(seed, 0.0, 0.15) for seed in (2, 3)], effects=FEW)
    assert diagnosis.verdict == "effect-found"
    assert all(d.slug != "short-horizon" for d in diagnosis.doubts)
    assert diagnosis.gain is not None
    assert "pieces" not in diagnosis.gain.held_out


def test_a_cause_found_with_a_requested_horizon_is_certain_only_if_whole_runs_are_predicted() -> None:
    calm = diagnose([sailed(seed, 0.0, 0.15) for seed in (2, 3)], effects=("dead-zone",), horizon=30.0)
    assert (calm.verdict, [c.effect.slug for c in calm.causes]) == ("effect-found", ["dead-zone"])
    gusty = diagnose([sailed(seed, 0.0003, 0.15) for seed in (2, 3)], effects=("dead-zone",), horizon=3.0)
    assert [c.effect.slug for c in gusty.causes] == ["dead-zone"]
    assert gusty.verdict == "partly-explained"
