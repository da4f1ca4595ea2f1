"""What the plan of a step takes from experiments: the noise it has to stand out from."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.identify.surge import fit_surge
from gcs_autotune.models import SingleDof
from gcs_autotune.models.simulation import simulate
from gcs_autotune.trial import Channel, Trial
from gcs_autotune.workflow.experiments import noise_in
from gcs_autotune.workflow.identification import Identified
from gcs_autotune.workflow.proof import known_of


def stepped(seed: int) -> Trial:
    """Throttle steps of a boat whose receiver filters its speed: noise of 0.05 m/s that lasts for a second."""
    model = SingleDof("surge", "1", 4.0, 2.0, 0.0)
    t = np.arange(0.0, 120.0, 0.1)
    thrust = np.repeat(np.random.default_rng(seed).uniform(0.2, 0.9, 20), 60)
    u = simulate(model, t, thrust, t, nu_0=model.steady_velocity(float(thrust[0]))).nu
    slow = lfilter([np.sqrt(1.0 - 0.9**2)], [1.0, -0.9], np.random.default_rng(seed + 9).standard_normal(len(t)))
    return Trial(f"run{seed}", {"X": Channel("X", "1", t, thrust), "u": Channel("u", "m/s", t, u + 0.05 * slow)})


@pytest.mark.slow
def test_a_speed_step_has_to_stand_out_from_noise_that_the_receiver_has_filtered() -> None:
    runs = [stepped(0), stepped(1)]
    known = known_of(Identified(fit_surge(runs), runs), FIRMWARE["ardurover"].axes["speed"])
    assert known.noise_std == pytest.approx(0.05, rel=0.3)
    assert noise_in(runs[0], "u") < 0.02
