"""Two independent implementations of the same physics: the tuner's kernel and the simulator's body, effects off.

Identifying with the code that made the data proves nothing; this test catches errors of sign.
"""

from __future__ import annotations

import numpy as np
import pytest

from gcs_autotune.models import SingleDof, simulate
from sitl import load_vehicle
from sitl.plants import Wrench

TICK = 0.02


@pytest.mark.parametrize("name", ["videoray", "automarine", "falcon"])
@pytest.mark.parametrize(
    ("dof", "load", "state", "rate"), [("yaw", "N", "psi", "r"), ("heave", "Z", "z", "w"), ("surge", "X", "x", "u")]
)
def test_tuner_and_simulator_predict_the_same_motion(name, dof, load, state, rate):
    data = load_vehicle(name)
    body, table = data.make_plant(), data.tables[dof]
    alpha, beta, quadratic = (table[k]["value"] for k in ("alpha", "beta", "beta2"))
    body.state.psi, body.state.z = 0.0, 5.0
    rng = np.random.default_rng(4)
    force = table["authority"]["value"] * 0.3 * rng.choice([-1.0, 1.0, 0.4], size=12).repeat(25)
    start, positions, rates = getattr(body.state, state), [], []
    for tau in force:
        positions.append(getattr(body.state, state) - start)
        rates.append(getattr(body.state, rate))
        wrench = Wrench()
        setattr(wrench, load, tau)
        body.step(wrench, TICK)
    t = TICK * np.arange(len(force))
    model = SingleDof(dof, "N m" if dof == "yaw" else "N", alpha, beta, quadratic)
    found = simulate(model, t, force, t)
    assert np.ptp(positions) > 0.05
    np.testing.assert_allclose(found.eta, positions, atol=2e-5 * np.ptp(positions))
    np.testing.assert_allclose(found.nu, rates, atol=2e-5 * np.ptp(rates))
