"""Causes beneath weather: named where they hold on runs left out, and nothing invented; what is missing is told."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from runs_in_the_tank import towed

from gcs_autotune.diagnose import diagnose
from gcs_autotune.diagnose.process_noise import weathered_form
from gcs_autotune.identify import data_summary_of, plain_form, prepare_form
from gcs_autotune.trial import Channel, Trial

Array = NDArray[np.float64]

SOME = ("quadratic-drag", "dead-zone", "input-bias", "asymmetric-thrust")


def weathered(seed: int, *, square: float = 0.0, size: float = 0.15, count: int = 3) -> list[Trial]:
    """Return relay runs of 60 s of a craft of inertia one, and a push that wanders."""
    rng = np.random.default_rng(seed)
    found = []
    for k in range(count):
        fine, samples = 0.02, 3000
        t = fine * np.arange(samples)
        command = (0.5, 1.0, 1.5)[k % 3] * np.where(np.floor(t / (3.0 + k)) % 2 == 0, 1.0, -1.0)
        psi, r, push, keep = 0.0, 0.0, rng.normal(0.0, size), math.exp(-fine / 2.0)
        path = np.empty(samples)
        for i in range(samples):
            path[i] = psi
            psi += fine * r
            r += fine * (command[i] - 0.8 * r - square * abs(r) * r + push)
            push = keep * push + rng.normal(0.0, size * math.sqrt(1.0 - keep * keep))
        at, seen = t[::10], path[::10] + rng.normal(0.0, 1e-3, samples // 10)
        channels = {
            "psi": Channel("psi", "rad", at, seen),
            "N": Channel("N", "N m", at, command[::10]),
        }
        found.append(Trial(f"run{k}", channels))
    return found


def test_one_motion_of_runs_that_other_forces_drive_too_knows_its_own_input() -> None:
    """A diagnosis of positions, driven by X and N, ended in a traceback when it looked for weather in yaw."""
    run = weathered(1, count=1)[0]
    psi, N = run["psi"], run["N"]
    along = {n: Channel(n, "m", psi.t, psi.values) for n in ("x", "y")}
    run = Trial("run", {"psi": psi, **along, "X": replace(N, name="X", unit="N"), "N": N})
    segments = prepare_form(run, plain_form([run]), None)
    alone = weathered_form(plain_form([run]), "yaw")
    assert alone is not None and segments[0].input_names == ("X", "N")
    data = data_summary_of(alone, segments)
    assert data.inputs == {"N": "N m"}
    assert data.amplitude == {"N": pytest.approx(0.5)}


@pytest.mark.slow
def test_a_square_law_beneath_the_weather_is_named_and_nothing_on_top_of_it() -> None:
    found = diagnose(weathered(1, square=1.0), effects=SOME)
    assert [c.effect.slug for c in found.causes] == ["quadratic-drag"]
    assert found.verdict == "partly-explained"
    value = found.causes[0].parameters["coefficient"]
    assert abs(value.value - 1.0) < 3.5 * value.std
    assert found.gain is not None
    assert found.gain.metric.endswith("s ahead")
    assert found.gain.ratio < 1.0
    assert found.missing is not None
    assert 0.05 < found.missing.size < 0.3
    assert "process-noise" in {d.slug for d in found.doubts}
    assert any("quadratic-drag of yaw: very strong evidence on each of 3 runs" in f for f in found.left.findings)


@pytest.mark.slow
def test_weather_alone_names_nothing_and_is_told_as_a_force() -> None:
    found = diagnose(weathered(2), effects=SOME)
    assert found.causes == ()
    assert found.verdict == "unexplained"
    assert found.missing is not None
    assert 0.05 < found.missing.size < 0.3
    assert any("is missing in yaw" in line for line in found.left.findings)
    assert found.to_dict()["missing"]["curves"]


@pytest.mark.slow
def test_calm_water_ends_as_it_did_without_process_noise() -> None:
    found = diagnose(towed(("dead-zone", "N", {"width": 0.2})), effects=["quadratic-drag", "dead-zone"])
    assert found.verdict == "effect-found"
    assert found.missing is None
