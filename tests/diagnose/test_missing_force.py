"""The force that no cause explains, as curves over the quantities it may depend on."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_autotune.diagnose import diagnose
from gcs_autotune.diagnose.missing_force import _curve_over, _Estimate
from gcs_autotune.identify.problems import plain_form
from gcs_autotune.trial import Channel, Trial


def estimates(beside, force, runs=3):
    """What *force* makes of a recorded quantity, with noise, in some runs."""
    found = []
    for k in range(runs):
        rng = np.random.default_rng(k)
        x = beside(rng, 400)
        y = force(x) + 0.1 * rng.normal(size=400)
        found.append(_Estimate(f"run{k}", np.arange(400.0), y, np.full(400, 0.1), {"x": x}))
    return found


def test_commands_of_two_sizes_have_a_curve_of_two_points():
    """Of a relay's commands the quantiles are two values; it had no curve at all."""
    found = estimates(lambda rng, n: rng.choice([-1.0, 1.0], n), lambda x: np.where(x > 0.0, 0.5, -0.1))
    curve = _curve_over("x", "N", found)
    assert curve is not None
    assert curve.unit == "N"
    assert curve.x.tolist() == [-1.0, 1.0]
    assert np.all(np.abs(curve.force - [-0.1, 0.5]) < 3.0 * curve.band)
    assert curve.share > 0.8


def test_a_continuous_quantity_has_a_curve_of_means():
    curve = _curve_over("x", "", estimates(lambda rng, n: rng.normal(size=n), lambda x: 0.3 * x))
    assert curve is not None
    assert len(curve.x) == 9
    assert np.all(np.diff(curve.force) > 0.0)


def test_a_single_run_is_predicted_by_its_other_half():
    found = estimates(lambda rng, n: rng.normal(size=n), lambda x: 0.3 * x)
    assert _curve_over("x", "", found).predicted_by == "the other runs"
    assert _curve_over("x", "", found[:1]).predicted_by == "the other half of the run"


def test_a_constant_quantity_has_no_curve():
    assert _curve_over("x", "", estimates(lambda rng, n: np.ones(n), lambda x: x)) is None


@pytest.mark.parametrize("swapped", [False, True])
def test_thrusters_with_exchanged_labels_are_reported(swapped):
    """A lake boat turned opposite to its labels, and nothing was reported."""
    step, samples = 0.1, 600
    t, rng = step * np.arange(samples), np.random.default_rng(3)
    push = 2.0 * np.sign(np.sin(0.5 * t))
    r = np.zeros(samples)
    for k in range(samples - 1):
        r[k + 1] = r[k] + step * ((-1.0 if swapped else 1.0) * 0.4 * push[k] - 0.8 * r[k])
    channels = {
        "r": Channel("r", "rad/s", t, r + 0.01 * rng.normal(size=samples)),
        "force_left": Channel("force_left", "N", t, push),
        "force_right": Channel("force_right", "N", t, -push),
    }
    run = Trial("lake", channels)
    assert plain_form([run], "yaw").inputs["force_right"] == (("N", "-k_N"),)
    text = {d.slug: d.cause for d in diagnose(run, dof="yaw", effects=["quadratic-drag"]).doubts}
    assert ("reversed-input" in text) == swapped
    if swapped:
        assert text["reversed-input"].endswith("force_left, force_right act opposite to their names")
