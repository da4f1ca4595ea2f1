"""Analysis of a designed loop: poles, margins, disk margins and responses, against python-control and by geometry."""

from __future__ import annotations

import math

import control
import numpy as np
import pytest

from gcs_autotune.control import Uncertainty, design_own
from gcs_autotune.design import LoopAnalysis, Spec, analyse_own, analyse_proposal, design
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.models import SingleDof

YAW = SingleDof("yaw", "1", 2.0, 1.5, 0.5, 0.0, 0.3)
COVARIANCE = np.diag([0.1, 0.15, 0.05, 0.0, 0.0]) ** 2
SPAN = 15.0


def own_loop() -> LoopAnalysis:
    found = design_own(YAW, Uncertainty(0.1, 0.2), step=math.radians(30.0), limits=(-0.9, 0.9))
    return analyse_own(found, COVARIANCE, math.radians(30.0), SPAN)


def test_poles_and_margins_of_a_loop_match_python_control() -> None:
    found = own_loop()
    loop = found.loop.to_control(8)
    gain, phase, _, _, crossover, _ = control.stability_margins(loop)
    assert found.margins.gain == pytest.approx(max(gain, 1.0 / gain), rel=0.01)
    assert math.degrees(found.margins.phase) == pytest.approx(phase, rel=0.01)
    assert found.margins.delay == pytest.approx(math.radians(phase) / crossover, rel=0.01)
    slow = sorted(found.poles, key=abs)[:4]
    assert np.abs(slow) == pytest.approx(sorted(np.abs(control.feedback(loop, 1).poles()))[:4], rel=0.01)
    assert all(pole.real < 0.0 for pole in found.poles)


def test_the_nyquist_plot_touches_the_disk_of_the_disk_margin() -> None:
    found = own_loop()
    gain = found.disk.gain
    centre, radius = -0.5 * (gain + 1.0 / gain), 0.5 * (gain - 1.0 / gain)
    distance = np.abs(found.loop.response(np.logspace(-2.0, 2.0, 4000)) - centre)
    assert float(np.min(distance)) == pytest.approx(radius, rel=0.02)
    assert found.disk.gain < found.margins.gain
    assert found.disk.phase < found.margins.phase


def test_a_disk_margin_matches_python_control() -> None:
    found = own_loop()
    size, decibels, degrees = control.disk_margins(found.loop.to_control(8), np.logspace(-3.0, 2.7, 500))
    assert found.disk.size == pytest.approx(float(size), rel=1e-3)
    assert 20.0 * math.log10(found.disk.gain) == pytest.approx(float(decibels), rel=1e-3)
    assert math.degrees(found.disk.phase) == pytest.approx(float(degrees), rel=1e-3)


def test_the_worst_case_is_no_better_than_the_model_and_the_band_contains_its_response() -> None:
    found = own_loop()
    assert found.worst_disk.size < found.disk.size
    assert found.worst_margins.phase < found.margins.phase
    r = found.response
    assert np.all(r.low <= r.position) and np.all(r.position <= r.high)
    before = r.t < r.push_at
    assert r.position[before][-1] == pytest.approx(r.step, rel=0.02)
    assert np.max(np.abs(r.position[~before] - r.step)) > 0.005
    assert r.position[-1] == pytest.approx(r.step, rel=0.02)  # the integral removes the disturbance


def test_the_analysis_of_a_proposal_has_the_margins_of_the_proposal() -> None:
    axis = FIRMWARE["ardurover"].axes["heading"]
    present = {gain.parameter: gain.default for gain in axis.gains}
    question = (YAW, COVARIANCE, axis, present, Spec(speed=1.5, omega_0=0.8))
    proposal = design(*question)
    before, after = analyse_proposal(proposal, *question)
    assert after.margins.phase == pytest.approx(proposal.margins.phase, rel=1e-6)
    assert after.worst_margins.gain == pytest.approx(proposal.worst_margins.gain, rel=1e-6)
    assert before.disk.size < after.disk.size


def test_an_unstable_loop_has_no_margin() -> None:
    axis = FIRMWARE["ardurover"].axes["heading"]
    present = {gain.parameter: gain.default for gain in axis.gains} | {"ATC_STR_RAT_P": 2.0, "ATC_STR_ANG_P": 10.0}
    question = (YAW, COVARIANCE, axis, present, Spec(speed=1.5, omega_0=0.8))
    before, _ = analyse_proposal(design(*question), *question)
    assert not before.margins.stable
    assert (before.disk.size, before.disk.gain, before.disk.phase) == (0.0, 1.0, 0.0)
    assert max(pole.real for pole in before.poles) > 0.0
