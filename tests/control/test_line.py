"""Line following on Charlie's yaw model: Miskovic2010, section 8.3, figures 8.20 to 8.26."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from gcs_autotune.control import (
    STRUCTURES,
    AdaptiveLineOfSight,
    DirectLine,
    FeedbackLaw,
    IntegralLineOfSight,
    Line,
    LineGuidance,
    LineOfHeading,
    LineState,
    design_direct,
    design_indirect,
    design_ipd,
    reference_model,
    simplify,
)
from gcs_autotune.errors import NoGainsMeetSpec
from gcs_autotune.models import SingleDof, TransferFunction

YAW = SingleDof("yaw", "rad", 8.2, 2.465)
"""Charlie at n^2 = 36 V^2: Miskovic2010, table 7.12."""
SPEED, RUDDER, EAST = 0.9, math.radians(30.0), math.radians(90.0)
LINE = Line(0.0, 0.0, EAST)

IPD = design_ipd(YAW, reference_model("bessel", 0.45)).with_limits(-RUDDER, RUDDER)
PD = FeedbackLaw(STRUCTURES["P-D"], K_P=1.0, K_D=2.0, is_angle=True, limits=(-RUDDER, RUDDER))

Steer = Callable[[LineState, float, float, float], float]


def sail(
    steer: Steer, d: float, *, current: float = 0.0, seconds: float = 400.0, heading: float = EAST
) -> NDArray[np.float64]:
    """Return (t, d, psi, rudder) per tick of 0.5 s; *current* [m/s] sets to starboard of the line."""
    x, y, psi, r, rows, dt = -d, 0.0, heading, 0.0, [], 0.5
    across = EAST + math.pi / 2
    for k in range(round(seconds / dt)):
        velocity = (
            SPEED * math.cos(psi) + current * math.cos(across),
            SPEED * math.sin(psi) + current * math.sin(across),
        )
        state = LINE.state(x, y, psi, r, velocity)
        rudder = steer(state, psi, r, k * dt)
        rows.append((k * dt, state.d, psi, rudder))
        for _ in range(10):
            r += dt / 10 * (rudder - YAW.beta * r) / YAW.alpha
            psi += dt / 10 * r
            x += dt / 10 * (SPEED * math.cos(psi) + current * math.cos(across))
            y += dt / 10 * (SPEED * math.sin(psi) + current * math.sin(across))
    return np.array(rows)


def direct(law: DirectLine) -> Steer:
    controller = law.rate.with_limits(-RUDDER, RUDDER).started()
    return lambda state, psi, r, t: controller.update(law.turn_rate(state), r, r, t)


def guided(law: LineOfHeading, inner: FeedbackLaw) -> Steer:
    guidance, controller = LineGuidance(law, LINE), inner.started()
    return lambda state, psi, r, t: controller.update(guidance.update(state, t), psi, r, t)


def loop_of(inner: FeedbackLaw) -> TransferFunction:
    loop = inner.closed_loop(YAW)
    return simplify(loop) if len(loop.denominator) == 4 else loop


def test_direct_control_far_from_the_line_needs_a_limit_to_approach() -> None:
    law = design_direct(YAW, SPEED, "bessel", 0.5)
    free = sail(direct(replace(law, d_limit=math.inf)), 75.0)
    assert np.abs(free[:, 2] - EAST).max() > 2.0 * math.pi
    assert free[-1, 1] > 60.0
    limited = sail(direct(law), 75.0)
    assert np.all(np.diff(limited[:, 1]) < 0.02)
    assert np.abs(limited[:, 2] - EAST).max() == pytest.approx(math.radians(45.0), abs=math.radians(1.0))
    assert abs(limited[-1, 1]) < 1e-3


@pytest.mark.parametrize("inner", [IPD, PD], ids=["I-PD", "P-D"])
def test_indirect_control_far_from_the_line_needs_a_limit_to_approach(
    inner: FeedbackLaw,
) -> None:
    law = design_indirect(loop_of(inner), SPEED, "bessel", 0.211, approach=math.radians(30.0))
    free = sail(guided(replace(law, approach=math.inf), inner), 70.0)
    assert np.abs(free[:, 2] - EAST).max() > math.pi
    limited = sail(guided(law, inner), 70.0)
    assert np.abs(limited[:, 2] - EAST).max() < math.radians(32.0)
    assert limited[:, 1].min() > -0.5
    assert abs(limited[-1, 1]) < 0.01


@pytest.mark.parametrize("inner", [IPD, PD], ids=["I-PD", "P-D"])
def test_the_closed_line_loop_has_the_required_poles(inner: FeedbackLaw) -> None:
    """Small motions on the simplified loop itself: (8.53) against the eigenvalues of the system written out."""
    loop, omega = loop_of(inner), 0.3
    law = design_indirect(loop, SPEED, "butterworth", omega)
    b = loop.numerator[1] if len(loop.numerator) > 1 else 0.0
    _, p1, p2 = loop.denominator
    # p2 psi'' + p1 psi' + psi = psi_ref + b psi_ref'; psi_ref = I - K_psi psi - K_r psi' - K_d d
    s = np.poly1d([1.0, 0.0])
    feedback = law.K_psi + law.K_r * s
    left = (p2 * s**2 + p1 * s + 1.0) * s**2
    right = (b * s + 1.0) * (feedback * s**2 + law.K_d * SPEED * s + law.K_I * SPEED)
    poles = np.sort_complex((left + right).roots)
    expected = np.sort_complex(omega * np.exp(1j * math.pi * (2 * np.arange(1, 5) + 3) / 8))
    assert poles == pytest.approx(expected, abs=1e-6)


def test_a_u_turn_onto_the_line_ends_on_it_within_the_rudder_limit() -> None:
    law = design_indirect(loop_of(IPD), SPEED, "bessel", 0.211, approach=math.radians(30.0))
    flown = sail(guided(law, IPD), 20.0, heading=EAST + math.pi)
    assert np.abs(flown[:, 3]).max() <= RUDDER + 1e-12
    assert abs(flown[-1, 1]) < 0.01


@pytest.mark.parametrize(
    "law",
    [
        design_indirect(loop_of(IPD), SPEED, "bessel", 0.211),
        IntegralLineOfSight(lookahead=6.0, gain=0.05),
        AdaptiveLineOfSight(lookahead=6.0, gain=0.0005),
    ],
    ids=["indirect", "integral", "adaptive"],
)
def test_a_current_across_leaves_no_steady_error(law: LineOfHeading) -> None:
    flown = sail(guided(law, IPD), 10.0, current=0.18, seconds=900.0)
    assert np.abs(flown[-100:, 1]).max() < 0.15


def test_a_slower_reference_model_moves_the_rudder_less() -> None:
    """Figure 8.27: omega_c = 0.5 against 0.211 rad/s, with noise on heading and position."""
    activity = []
    for omega in (0.5, 0.211):
        noise = np.random.default_rng(5)
        law = design_direct(YAW, SPEED, "bessel", omega)
        inner = direct(law)

        def steer(
            state: LineState, psi: float, r: float, t: float, inner: Steer = inner, noise: np.random.Generator = noise
        ) -> float:
            noisy = replace(state, d=state.d + noise.normal(0.0, 0.03), d_rate=state.d_rate + noise.normal(0.0, 0.02))
            return inner(noisy, psi, r, t)

        activity.append(float(np.std(sail(steer, 0.0)[100:, 3])))
    assert activity[1] < 0.5 * activity[0]


def test_a_current_too_strong_for_the_approach_is_rejected_with_the_limit() -> None:
    with pytest.raises(NoGainsMeetSpec, match=r"must be below 0\.64 m/s"):
        design_direct(YAW, SPEED, "bessel", 0.3, current=0.7)


@pytest.mark.parametrize("d", [4.0, 8.0, 20.0])
def test_indirect_control_takes_over_at_its_heading_and_does_not_overshoot_the_line(d: float) -> None:
    law = design_indirect(simplify(IPD.closed_loop(YAW)), SPEED, "bessel", 0.211, approach=math.radians(45.0))
    guidance = LineGuidance(law, LINE)
    assert guidance.update(LINE.state(-d, 0.0, EAST + 0.1, 0.0, (0.0, SPEED)), 0.0) == pytest.approx(EAST + 0.1)
    guidance, heading = LineGuidance(law, LINE), IPD.started()
    flown = sail(lambda state, psi, r, t: heading.update(guidance.update(state, t), psi, r, t), d)
    beyond = -float(np.min(flown[:, 1] * math.copysign(1.0, flown[0, 1])))
    assert beyond < 0.1 * d
