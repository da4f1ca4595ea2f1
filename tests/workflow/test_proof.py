"""What the plan of a step takes from experiments: the noise it has to stand out from."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from gcs_autotune.design import Actuator
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.identify.thrust import fit_surge
from gcs_autotune.manoeuvres import STOPPING, StepSettings
from gcs_autotune.models import SingleDof, simulate
from gcs_autotune.trial import Channel, Mark, Trial
from gcs_autotune.workflow import Connection, TuneSettings
from gcs_autotune.workflow.experiments import noise_in
from gcs_autotune.workflow.identification import Identified
from gcs_autotune.workflow.proof import Known, Proof, known_of, proof_of_turn_rate


def stepped(seed: int) -> Trial:
    """Throttle steps of a boat whose receiver filters its speed: noise of 0.05 m/s that lasts for a second."""
    model = SingleDof("surge", "1", 4.0, 2.0, 0.0)
    t = np.arange(0.0, 120.0, 0.1)
    thrust = np.repeat(np.random.default_rng(seed).uniform(0.2, 0.9, 20), 60)
    u = simulate(model, t, thrust, t, nu_0=model.steady_velocity(float(thrust[0]))).nu
    slow = lfilter([np.sqrt(1.0 - 0.9**2)], [1.0, -0.9], np.random.default_rng(seed + 9).standard_normal(len(t)))
    return Trial(f"run{seed}", {"X": Channel("X", "1", t, thrust), "u": Channel("u", "m/s", t, u + 0.05 * slow)})


@pytest.mark.slow
def test_the_noise_of_a_speed_step_includes_noise_filtered_by_the_receiver() -> None:
    runs = [stepped(0), stepped(1)]
    known = known_of(Identified(fit_surge(runs), runs), FIRMWARE["ardurover"].axes["speed"])
    assert known.noise_std == pytest.approx(0.05, rel=0.3)
    assert noise_in(runs[0], "u") < 0.02


def test_the_residual_of_a_poor_model_is_not_the_noise_of_a_speed_step() -> None:
    runs = [stepped(0)]
    fit = fit_surge(runs)
    poor = replace(fit, noise={**fit.noise, "u": 0.5})
    known = known_of(Identified(poor, runs), FIRMWARE["ardurover"].axes["speed"])
    assert known.noise_std < 0.02


def test_the_second_step_is_held_as_long_as_the_first() -> None:
    proof = Proof(StepSettings("psi", 0.5, 30.0, hold=10.0), None, {})
    marks = [Mark(t, "target") for t in (2.0, 15.5, 45.5)]
    flown = Trial("step-before", {}, marks, meta={"signal": "psi"})
    assert proof.after(flown).settings.hold == pytest.approx(13.5)
    assert proof.after(Trial("stopped while held", {}, marks[:1])).settings.hold == 10.0
    assert proof.after(flown).settings.least_hold == math.inf


@pytest.mark.parametrize("held", [4.5, 13.5])
def test_the_second_step_is_held_no_shorter_than_the_first_with_early_holds(held: float) -> None:
    proof = Proof(StepSettings("psi", 0.5, 30.0, hold=10.0, least_hold=3.0), None, {})
    marks = [Mark(t, "target") for t in (2.0, 2.0 + held, 45.5)]
    after = proof.after(Trial("step-before", {}, marks, meta={"signal": "psi"})).settings
    assert after.least_hold == pytest.approx(held)
    assert after.hold == pytest.approx(max(held, 10.0))
    stopped = proof.after(Trial("stopped while held", {}, marks[:1])).settings
    assert stopped.least_hold == stopped.hold == 10.0


@pytest.mark.parametrize("slowness", [0.5, 1.0, 5.0])
def test_a_turn_rate_step_at_rest_is_large_and_stays_within_the_heading_limit(slowness: float) -> None:
    """A BlueROV2 and craft that answer more slowly; the bow is farthest off at the end of the hold."""
    known = Known(SingleDof("yaw", "1", 0.026 * slowness, 0.0, 0.065), Actuator(), 0.004)
    settings = TuneSettings(Connection("sitl:bluerov2"), Path("run"), axis="yaw")
    s = proof_of_turn_rate(settings, 0.0, known).settings
    assert s.base == -0.5 * s.size and s.hold == s.settle
    assert s.size > math.radians(50.0) or slowness > 1.0
    rate = 0.5 * s.size
    farthest = max(rate * s.hold, abs(rate * (s.hold - s.duration)))
    assert farthest + rate * STOPPING <= 0.86 * settings.envelope.heading_excursion
    under_way = proof_of_turn_rate(settings, 1.0, known).settings
    assert under_way.size <= math.radians(30.0) and under_way.hold == 0.0
