"""Figures of the loop and of the craft show what the design and the record contain."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_autotune.design import Actuator, OpenLoop, Spec, design
from gcs_autotune.design.open_loop import Rational
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.identify import Parameter
from gcs_autotune.models import SingleDof
from gcs_autotune.report.toolkit.canvas import new_axes, pens
from gcs_autotune.report.toolkit.figures import draw_inputs, draw_intervals, draw_thrust, draw_track, inputs_of, is_bent
from gcs_autotune.report.tune.bode import OMEGA, draw_bode, loop_margins
from gcs_autotune.trial import Channel, Trial

CRAFT = {
    ("ardurover", "heading"): SingleDof("yaw", "1", alpha=16.4, beta=4.9, beta_quadratic=0.0, delta=0.015, delay=0.1),
    ("ardusub", "depth"): SingleDof("heave", "1", alpha=0.3, beta=0.5, beta_quadratic=0.6, delta=-0.02, delay=0.05),
}


@pytest.fixture(scope="module", params=CRAFT, ids=lambda key: key[1])
def proposal(request):
    """A design as ``tune`` makes it, settling time given so that it is quick."""
    firmware, name = request.param
    model, axis = CRAFT[request.param], FIRMWARE[firmware].axes[name]
    present = {g.parameter: 0.5 * (g.low + g.high) for g in axis.gains}
    spec = Spec(speed=1.2 if axis.needs_speed else None, settling_time=12.0)
    return design(model, np.diag([1e-4, 1e-4, 1e-4, 1e-8, 0.0]), axis, present, spec)


def test_the_margins_are_those_of_the_design_and_of_python_control(proposal):
    import control

    found = loop_margins(proposal.loops[1])
    assert found.stable is proposal.margins.stable is True
    assert found.gain == pytest.approx(proposal.margins.gain, rel=0.02)
    assert found.phase == pytest.approx(proposal.margins.phase, abs=math.radians(0.5))
    gains, phases = [], []
    for loop in proposal.loops[1]:
        assert control.feedback(loop.to_control()).poles().real.max() < 0.0
        response = control.frd(loop.response(OMEGA), OMEGA, smooth=True)
        at_gain, at_phase, _, omega_gain, omega_phase, _ = control.stability_margins(response, returnall=True)
        gains += zip(np.exp(np.abs(np.log(np.abs(at_gain)))), omega_gain, strict=True)
        phases += zip(np.abs(np.radians(at_phase)), omega_phase, strict=True)
    assert (found.gain, found.gain_at) == pytest.approx(min(gains), rel=1e-4)
    assert (found.phase, found.phase_at) == pytest.approx(min(phases), rel=1e-4)


def test_a_delay_beyond_the_delay_margin_is_shown_as_unstable():
    loop = OpenLoop(Rational((1.0,), (1.0, 0.0)), 2.0)
    assert not loop_margins([loop]).stable
    bearable = loop_margins([OpenLoop(loop.rational, 0.5)])
    assert bearable.stable
    assert bearable.phase == pytest.approx(0.5 * math.pi - 0.5, abs=1e-3)
    assert bearable.gain == pytest.approx(math.pi, rel=1e-3)


def test_several_loops_show_their_smallest_margins_and_the_narrowest_is_plotted_bold():
    slow, quick = (OpenLoop(Rational((g,), (1.0, 0.0)), 0.5) for g in (0.5, 1.5))
    found = loop_margins([slow, quick])
    assert found.narrowest == 1
    assert found.gain == pytest.approx(math.pi / 1.5, rel=1e-3)
    with pens("bode"):
        top, _ = draw_bode(([slow, quick], [slow]), [loop_margins(loops) for loops in ([slow, quick], [slow])]).axes
    widths = [line.get_linewidth() for line in top.lines[:2]]
    assert widths[1] > widths[0]


def run(**channels: tuple[str, list[float]]) -> Trial:
    t = np.arange(4.0)
    return Trial("run", {n: Channel(n, u, t, np.array(v)) for n, (u, v) in channels.items()})


def test_a_track_is_plotted_north_up_with_equal_axes():
    trial = run(x=("m", [0.0, 10.0, 20.0, 30.0]), y=("m", [5.0, 5.0, 5.0, 6.0]))
    with pens("track"):
        (axes,) = draw_track({"out": trial}).axes
    assert axes.get_aspect() == 1.0
    line, start, end = axes.lines
    assert (line.get_ydata()[-1], line.get_xdata()[-1]) == (30.0, 6.0)
    assert (start.get_ydata()[0], end.get_ydata()[0]) == (0.0, 30.0)


def test_a_craft_that_does_not_move_or_has_no_position_has_no_track():
    assert draw_track({"still": run(x=("m", [0.0, 0.4, 0.1, 0.2]), y=("m", [0.0] * 4))}) is None
    assert draw_track({"blind": run(psi=("rad", [0.0] * 4))}) is None


def test_an_input_is_plotted_as_steps_in_percent():
    trial = run(N=("1", [0.0, 0.3, -0.3, -0.3]))
    with pens("inputs"):
        _, (axes,) = new_axes((1.0,))
        draw_inputs(axes, trial, ("N",), 0.5, 2.5)
    (line,) = axes.lines
    assert line.get_drawstyle() == "steps-post"
    assert list(line.get_xdata()) == pytest.approx([0.0, 0.5, 1.5, 2.0])
    assert list(line.get_ydata()) == pytest.approx([0.0, 30.0, -30.0, -30.0])
    assert axes.get_ylabel() == "N [% of full output]"


def test_the_input_of_a_rudder_boat_is_its_rudder_angle():
    model = SingleDof("yaw", "rad", alpha=1.0, beta=1.0, beta_quadratic=0.0, delta=0.0, delay=0.0)
    assert inputs_of(model, run(delta=("rad", [0.1] * 4))) == ("delta",)
    assert inputs_of(model, run(X=("1", [0.1] * 4))) == ()
    assert inputs_of(model, None) == ()


def test_a_nonlinear_thrust_curve_is_plotted_with_the_outputs_flown():
    bent = Actuator(square=1.0)
    assert is_bent(bent)
    assert not is_bent(Actuator(lag=0.2, limit=1.0))
    assert not is_bent(None)
    with pens("thrust"):
        (axes,) = draw_thrust(bent, [0.5, -0.5]).axes
    curve = next(line for line in axes.lines if line.get_label() == "found")
    flown = next(line for line in axes.lines if line.get_label() == "flown")
    assert np.interp(50.0, curve.get_xdata(), curve.get_ydata()) == pytest.approx(25.0)
    assert list(flown.get_ydata()) == pytest.approx([-25.0, 25.0])


def test_intervals_are_percentages_and_those_including_zero_are_labelled():
    known = {"a": Parameter("a", 2.0, "1", 0.1), "b": Parameter("b", 0.1, "1", 0.2), "c": Parameter("c", 0.0, "1", 0.0)}
    with pens("intervals"):
        (axes,) = draw_intervals(known).axes
    assert [t.get_text() for t in axes.get_yticklabels()] == ["a", "b"]
    assert list(axes.lines[0].get_xdata()) == pytest.approx([-9.8, 9.8])
    assert [t.get_text() for t in axes.texts] == ["± 9.8 %", "± 392 %, may be zero"]
    assert draw_intervals({"c": known["c"]}) is None
