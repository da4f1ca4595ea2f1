"""The hull against closed-form solutions of its equation of motion."""

from __future__ import annotations

import math

import pytest

from sitl.plants import AxisDynamics, PlanarHull, RigidBody, Water, Wrench

DT = 0.02


def _run(axis: AxisDynamics, force: float, seconds: float, nu: float = 0.0) -> tuple[float, float]:
    return _flown(axis, force, round(seconds / DT), DT, nu)


def _flown(axis: AxisDynamics, force: float, steps: int, dt: float, nu: float = 0.0) -> tuple[float, float]:
    """Return velocity and distance of a body that only surges."""
    body = RigidBody({"surge": axis})
    body.state.u = nu
    for _ in range(steps):
        body.step(Wrench(X=force), dt)
    return body.state.u, body.state.x


def _body(world: Water | None = None) -> PlanarHull:
    return PlanarHull(
        AxisDynamics(8.0, 4.0, 0.0), AxisDynamics(8.0, 15.0, 0.0), AxisDynamics(0.04, 0.0, 0.07), world or Water()
    )


def test_linear_drag_follows_the_exponential():
    a, b, force, t = 8.0, 4.0, 6.0, 3.0
    nu, travelled = _run(AxisDynamics(a, b, 0.0), force, t)
    fall = math.exp(-b * t / a)
    assert nu == pytest.approx(force / b * (1.0 - fall), rel=1e-9)
    assert travelled == pytest.approx(force / b * (t - a / b * (1.0 - fall)), rel=1e-9)


def test_quadratic_drag_follows_the_hyperbolic_tangent():
    a, c, force, t = 0.04, 0.07, 0.06, 1.5
    nu, travelled = _run(AxisDynamics(a, 0.0, c), force, t)
    rate = math.sqrt(force * c) / a
    assert nu == pytest.approx(math.sqrt(force / c) * math.tanh(rate * t), rel=1e-7)
    assert travelled == pytest.approx(a / c * math.log(math.cosh(rate * t)), rel=1e-7)


def test_quadratic_drag_alone_decays_as_one_over_time():
    a, c, start, t = 300.0, 33.0, 1.5, 10.0
    nu, _ = _run(AxisDynamics(a, 0.0, c), 0.0, t, start)
    assert nu == pytest.approx(start / (1.0 + c * start * t / a), rel=1e-9)


def test_affine_drag_settles_where_force_and_drag_balance():
    nu, _ = _run(AxisDynamics(80.0, 300.0, 10.0), -400.0, 30.0)
    assert 300.0 * nu + 10.0 * abs(nu) * nu == pytest.approx(-400.0, rel=1e-9)


def test_the_step_is_of_fourth_order():
    axis = AxisDynamics(0.04, 0.0, 0.07)
    exact = math.sqrt(0.06 / 0.07) * math.tanh(math.sqrt(0.06 * 0.07) / 0.04 * 0.8)

    def error(steps: int) -> float:
        return abs(_flown(axis, 0.06, steps, 0.8 / steps)[0] - exact)

    assert error(4) / error(8) > 12.0


def test_a_steady_turn_is_a_circle():
    body = _body()
    body.state.u, body.state.r = 1.5, 0.3
    for dof in ("surge", "yaw"):
        body.set_axis(dof, AxisDynamics(1.0, 0.0, 0.0))
    for _ in range(500):
        body.step(Wrench(), DT)
    radius, angle = 5.0, 0.3 * 10.0
    assert body.state.psi == pytest.approx(angle)
    assert body.state.x == pytest.approx(radius * math.sin(angle), abs=1e-4)
    assert body.state.y == pytest.approx(radius * (1.0 - math.cos(angle)), abs=1e-4)


def test_a_downward_force_makes_the_body_sink():
    body = _body(Water(bottom=100.0))
    for _ in range(250):
        body.step(Wrench(Z=3.0), DT)
    assert body.state.z > 0.5
    assert body.state.w == pytest.approx(3.0 / 15.0, rel=1e-3)


def test_a_boat_stays_at_the_surface():
    body = _body(Water(floats=True))
    body.step(Wrench(Z=100.0), DT)
    assert body.state.z == 0.0


@pytest.mark.parametrize(("start", "force"), [(0.3, -3.0), (9.7, 3.0)])
def test_surface_and_bottom_stop_the_body_softly(start, force):
    body = _body(Water(bottom=10.0))
    body.state.z = start
    fastest = 0.0
    for _ in range(1500):
        body.step(Wrench(Z=force), DT)
        fastest = max(fastest, abs(body.state.wdot))
    rest = force / (8.0 * 3.0**2)
    assert body.state.z == pytest.approx((0.0 if force < 0 else 10.0) + rest, abs=1e-3)
    assert abs(body.state.w) < 1e-3
    assert fastest < 3.0


def test_roll_and_pitch_stay_small_and_decay():
    body = _body()
    body.state.u, body.state.r = 1.5, 0.5
    for _ in range(50):
        body.step(Wrench(N=0.02), DT)
    assert 0.0 < abs(body.state.phi) < 0.1
    for _ in range(1500):
        body.step(Wrench(), DT)
    assert abs(body.state.phi) < 2e-3
    assert abs(body.state.theta) < 2e-3
