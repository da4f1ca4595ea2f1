"""Six degrees of freedom: invariants of every body, and comparison with an independent integrator."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from sitl import load_vehicle
from sitl.plants import GRAVITY, AxisDynamics, Ballast, RigidBody, Water, Wrench, coupling_of
from sitl.plants.rigid_body import DOFS, angles_of, quaternion_of, rotate

SPEEDS = "uvwpqr"
FEW = settings(max_examples=40, deadline=None)
SPEED, ANGLE = st.floats(-2.0, 2.0), st.floats(-1.2, 1.2)
NU = st.tuples(*6 * (SPEED,))


@st.composite
def ballasts(draw):
    """A mass that is small relative to the inertia about the origin, so that the inertia is positive."""
    offset = st.floats(-0.1, 0.1)
    centre, lift = draw(st.tuples(*3 * (offset,))), draw(st.tuples(*3 * (offset,)))
    return Ballast(
        10.0, centre, draw(st.tuples(*3 * (st.floats(-0.1, 0.1),))), 98.0, draw(st.floats(90.0, 106.0)), lift
    )


def body(ballast: Ballast | None = None, *, drag: float = 1.0, coriolis: bool = True, **more) -> RigidBody:
    sizes = {"surge": 14.0, "sway": 18.0, "heave": 25.0, "roll": 0.9, "pitch": 1.1, "yaw": 1.3}
    axes = {dof: AxisDynamics(alpha, drag * 0.2 * alpha, drag * 0.5 * alpha) for dof, alpha in sizes.items()}
    derivatives = {"Y_rdot": -0.4, "M_w": -0.3 * drag, "Y_|v|r": -0.5 * drag} if not more.pop("bare", False) else {}
    coupling = coupling_of(derivatives, coriolis=coriolis, speeds=SPEEDS)
    return RigidBody(axes, Water(), coupling=coupling, ballast=ballast, **more)


def place(hull: RigidBody, nu, angles=(0.0, 0.0, 0.0), depth: float = 50.0) -> RigidBody:
    at = hull.state
    at.u, at.v, at.w, at.p, at.q, at.r = nu
    at.phi, at.theta, at.psi = angles
    at.z = depth
    return hull


def velocity(hull: RigidBody) -> np.ndarray:
    return np.array([getattr(hull.state, name) for name in SPEEDS])


def energy(hull: RigidBody) -> float:
    """Kinetic energy, and that of weight and buoyancy at their centres."""
    at, held, nu = hull.state, hull.ballast, velocity(hull)
    q = quaternion_of(at.phi, at.theta, at.psi)
    low, high = (at.z + rotate(q, point)[2] for point in (held.centre, held.centre_of_lift))
    sunk, (roll, pitch) = high - held.centre_of_lift[2], held.metacentric
    (down_x, _, down_z), square = (rotate(q, axis)[2] for axis in np.eye(3)), 0.5 * held.waterplane * sunk**2
    righted = 0.5 * (pitch - roll) * down_x**2 - roll * down_z
    return 0.5 * nu @ hull.body[:6] @ nu - held.weight * low + held.buoyancy * high + square + righted


@FEW
@given(ballasts())
def test_the_inertia_is_symmetric_and_positive(ballast):
    inertia = body(ballast).body[:6]
    assert np.array_equal(inertia, inertia.T)
    assert np.linalg.eigvalsh(inertia).min() > 0.0


@FEW
@given(ballasts(), NU)
def test_coriolis_forces_do_no_work(ballast, nu):
    bare = Ballast(ballast.mass, ballast.centre, ballast.products)
    hull = place(body(bare, drag=0.0), nu)
    power = np.array(nu) @ hull.body[:6] @ hull.acceleration(nu, Wrench())
    assert power == pytest.approx(0.0, abs=1e-10 * (1.0 + 100.0 * np.dot(nu, nu) ** 1.5))


@FEW
@given(ballasts(), NU, st.tuples(ANGLE, ANGLE, ANGLE))
def test_a_body_without_input_never_gains_energy(ballast, nu, angles):
    hull = place(body(ballast, bare=True), nu, angles)
    before = energy(hull)
    for _ in range(200):
        hull.step(Wrench(), 0.005)
        now = energy(hull)
        assert now <= before + 1e-9
        before = now


@FEW
@given(ballasts(), NU, st.tuples(ANGLE, ANGLE, ANGLE))
def test_a_body_without_drag_keeps_its_energy(ballast, nu, angles):
    hull = place(body(ballast, drag=0.0, bare=True), nu, angles)
    before = energy(hull)
    for _ in range(200):
        hull.step(Wrench(), 0.005)
    assert energy(hull) == pytest.approx(before, abs=1e-5)


@FEW
@given(ballasts(), NU, st.tuples(ANGLE, ANGLE, ANGLE))
def test_a_floating_body_without_drag_keeps_its_energy(ballast, nu, angles):
    afloat = replace(ballast, waterplane=400.0, metacentric=(5.0, 40.0))
    hull = place(body(afloat, drag=0.0, bare=True), nu, angles, depth=0.1)
    hull.water.floats = True
    before = energy(hull)
    for _ in range(200):
        hull.step(Wrench(), 0.005)
    assert energy(hull) == pytest.approx(before, abs=1e-5)


def test_righting_moments_do_not_turn_a_tilted_hull_about_the_vertical():
    hull = place(body(Ballast(metacentric=(5.0, 40.0)), bare=True), 6 * (0.0,), (0.3, -0.2, 0.7))
    moment = (hull.body[:6] @ hull.acceleration(6 * (0.0,), Wrench()))[3:]
    assert rotate(quaternion_of(0.3, -0.2, 0.7), moment)[2] == pytest.approx(0.0, abs=1e-12)


@given(st.tuples(ANGLE, ANGLE, st.floats(-3.1, 3.1)))
def test_angles_and_quaternion_are_the_same_attitude(angles):
    assert angles_of(quaternion_of(*angles)) == pytest.approx(angles, abs=1e-12)


def skew(a) -> np.ndarray:
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


class Written:
    """Miskovic2010, (2.13) to (2.26), as matrices written out: an independent implementation."""

    def __init__(self) -> None:
        self.m, self.r_G, self.r_B = 11.0, np.array([0.03, -0.01, 0.04]), np.array([0.01, 0.0, -0.05])
        self.I = np.array([[0.5, -0.02, -0.03], [-0.02, 0.6, 0.01], [-0.03, 0.01, 0.7]])
        self.added = np.array([5.0, 8.0, 14.0, 0.3, 0.4, 0.5])
        self.linear, self.quadratic = np.array([4.0, 6, 7, 0.3, 0.4, 0.5]), np.array([18.0, 30, 40, 0.5, 0.6, 0.7])
        self.W, self.B = 11.0 * GRAVITY, 11.3 * GRAVITY
        self.tau = np.array([6.0, -2.0, 3.0, 0.4, -0.5, 0.6])
        rigid = np.block([[self.m * np.eye(3), -self.m * skew(self.r_G)], [self.m * skew(self.r_G), self.I]])
        self.rigid, self.M = rigid, rigid + np.diag(self.added)

    def ours(self) -> RigidBody:
        axes = {dof: AxisDynamics(self.M[i, i], self.linear[i], self.quadratic[i]) for i, dof in enumerate(DOFS)}
        products = (-self.I[0, 1], -self.I[0, 2], -self.I[1, 2])
        ballast = Ballast(self.m, tuple(self.r_G), products, self.W, self.B, tuple(self.r_B))
        return RigidBody(axes, Water(), coupling=coupling_of({}, coriolis=True, speeds=SPEEDS), ballast=ballast)

    def nudot(self, nu: np.ndarray, down: np.ndarray) -> np.ndarray:
        """Return the acceleration; *down* is the direction of gravity in body axes."""
        v1, v2, m = nu[:3], nu[3:], self.m
        corner = -m * skew(v1) - m * skew(skew(v2) @ self.r_G)
        C_RB = np.block([[np.zeros((3, 3)), corner], [corner, m * skew(skew(v1) @ self.r_G) - skew(self.I @ v2)]])
        a1, a2 = self.added[:3] * v1, self.added[3:] * v2
        C_A = np.block([[np.zeros((3, 3)), -skew(a1)], [-skew(a1), -skew(a2)]])
        weight, lift = self.W * down, -self.B * down
        restoring = np.concatenate([weight + lift, np.cross(self.r_G, weight) + np.cross(self.r_B, lift)])
        drag = (self.linear + self.quadratic * np.abs(nu)) * nu
        return np.linalg.solve(self.M, self.tau + restoring - drag - (C_RB + C_A) @ nu)

    def by_angles(self, _, s: np.ndarray) -> np.ndarray:
        (phi, theta, psi), nu = s[3:6], s[6:]
        (c, d, e), (f, g, h) = np.cos(s[3:6]), np.sin(s[3:6])
        J1 = np.array(
            [[e * d, -h * c + e * g * f, h * f + e * c * g], [h * d, e * c + f * g * h, -e * f + g * h * c],
             [-g, d * f, d * c]]
        )  # fmt: skip
        J2 = np.array([[1.0, f * g / d, c * g / d], [0.0, c, -f], [0.0, f / d, c / d]])
        del phi, theta, psi
        return np.concatenate([J1 @ nu[:3], J2 @ nu[3:], self.nudot(nu, J1[2])])

    def by_matrix(self, _, s: np.ndarray) -> np.ndarray:
        R, nu = s[3:12].reshape(3, 3), s[12:]
        return np.concatenate([R @ nu[:3], (R @ skew(nu[3:])).ravel(), self.nudot(nu, R[2])])


def flown(hull: RigidBody, tau: np.ndarray, seconds: float, dt: float) -> RigidBody:
    X, Y, Z, K, M, N = tau
    for _ in range(round(seconds / dt)):
        hull.step(Wrench(X, Y, Z, N, M, K), dt)
    return hull


def test_the_body_agrees_with_the_printed_matrices_and_another_integrator():
    written, nu = Written(), [0.8, -0.3, 0.2, 0.5, -0.4, 0.6]
    hull = flown(place(written.ours(), nu, (0.3, -0.4, 1.0)), written.tau, 6.0, 0.002)
    start = np.concatenate([[0.0, 0.0, 50.0, 0.3, -0.4, 1.0], nu])
    end = solve_ivp(written.by_angles, (0.0, 6.0), start, "DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    at = hull.state
    assert [at.x, at.y, at.z, at.phi, at.theta, at.psi, *velocity(hull)] == pytest.approx(end, abs=1e-8)


def test_the_body_passes_ninety_degrees_of_pitch_like_a_rotation_matrix():
    written = Written()
    written.r_B = written.r_G.copy()
    written.tau = np.array([1.0, 0.0, 0.0, 0.0, 2.5, 0.1])
    hull = place(written.ours(), [0.5, 0.0, 0.0, 0.0, 0.5, 0.0])
    pitches = []
    for _ in range(8):
        flown(hull, written.tau, 1.0, 0.002)
        pitches.append(hull.state.theta)
    start = np.concatenate([[0.0, 0.0, 50.0], np.eye(3).ravel(), [0.5, 0.0, 0.0, 0.0, 0.5, 0.0]])
    path = solve_ivp(written.by_matrix, (0.0, 8.0), start, "DOP853", rtol=1e-11, atol=1e-12, dense_output=True)
    steep = np.degrees(np.arcsin(-path.sol(np.linspace(0.0, 8.0, 2001))[9]))
    assert steep.max() > 88.0 and steep.min() < -80.0  # over the top, and on
    end, at = path.y[:, -1], hull.state
    assert [at.x, at.y, at.z] == pytest.approx(end[:3], abs=1e-7)
    assert velocity(hull) == pytest.approx(end[12:], abs=1e-7)
    q = quaternion_of(at.phi, at.theta, at.psi)
    assert np.column_stack([rotate(q, axis) for axis in np.eye(3)]) == pytest.approx(end[3:12].reshape(3, 3), abs=1e-7)


def test_halving_the_time_step_reduces_the_error_sixteenfold():
    written, ends = Written(), []
    for dt in (0.04, 0.02, 0.00125):
        hull = flown(place(written.ours(), [0.8, -0.3, 0.2, 0.5, -0.4, 0.6]), written.tau, 2.0, dt)
        ends.append(np.array([hull.state.x, hull.state.y, hull.state.z, *velocity(hull)]))
    coarse, fine = (np.abs(end - ends[2]).max() for end in ends[:2])
    assert coarse / fine == pytest.approx(16.0, rel=0.3)


def test_one_degree_of_freedom_is_the_same_body_with_the_others_held():
    hull = RigidBody({"roll": AxisDynamics(2.0, 0.3, 0.1)}, ballast=Ballast(weight=50.0, centre=(0.0, 0.0, 0.1)))
    hull.state.phi = 0.4
    end = solve_ivp(
        lambda _, s: [s[1], (-50.0 * 0.1 * math.sin(s[0]) - (0.3 + 0.1 * abs(s[1])) * s[1]) / 2.0],
        (0.0, 5.0), [0.4, 0.0], "DOP853", rtol=1e-11, atol=1e-12,
    ).y[:, -1]  # fmt: skip
    flown(hull, np.zeros(6), 5.0, 0.005)
    assert (hull.state.phi, hull.state.p) == pytest.approx(end, abs=1e-9)
    assert (hull.state.x, hull.state.z, hull.state.theta) == (0.0, 0.0, 0.0)


def test_at_rest_an_accelerometer_measures_gravity_along_the_tilted_axes():
    hull = body(Ballast(10.0))
    hull.state.theta = 0.5
    assert hull.specific_force() == pytest.approx((GRAVITY * math.sin(0.5), 0.0, -GRAVITY * math.cos(0.5)))


def test_the_specific_force_adds_up_to_the_velocity_over_ground_of_a_tilting_body():
    hull = place(body(Ballast(10.0, (0.0, 0.0, 0.05), (0.0, 0.0, 0.0), 98.0, 98.0, (0.0, 0.0, -0.05))), 6 * (0.0,))
    gained = np.zeros(3)
    for _ in range(2000):
        before = quaternion_of(hull.state.phi, hull.state.theta, hull.state.psi)
        hull.step(Wrench(5.0, 2.0, 1.0, 0.3, 0.8, -0.5), 0.0025)
        after = quaternion_of(hull.state.phi, hull.state.theta, hull.state.psi)
        way = math.copysign(1.0, np.dot(before, after))
        mean = np.array(before) + way * np.array(after)
        force = rotate(tuple(mean / np.linalg.norm(mean)), hull.specific_force())
        gained += 0.0025 * (np.array(force) + np.array([0.0, 0.0, GRAVITY]))
    at = hull.state
    assert max(abs(at.phi), abs(at.theta)) > 0.1
    assert gained == pytest.approx(rotate(after, (at.u, at.v, at.w)), abs=1e-9)


def test_copies_of_a_body_in_one_call_agree_with_single_runs():
    written = Written()
    start = [0.1, 0.0, 0.0, 0.2, 0.1, -0.3]
    hull, drags, inertias = place(written.ours(), start), 2.0 + np.arange(5.0), np.linspace(1.0, 1.4, 5)
    before = dict(hull.parameters)
    numbers = {"surge.beta": drags, "yaw.alpha": inertias}
    out = hull.fly_copies(numbers, np.zeros((4, 0)), np.tile(written.tau, (4, 1)), dt=0.01, steps=25)
    assert hull.parameters == before and velocity(hull).tolist() == start
    for k, (drag, inertia) in enumerate(zip(drags, inertias, strict=True)):
        alone = place(written.ours(), start)
        alone.parameters.update({"surge.beta": drag, "yaw.alpha": inertia})
        flown(alone, written.tau, 1.0, 0.01)
        assert out[k, -1, 7:] == pytest.approx(velocity(alone), abs=1e-12)
        assert out[k, -1, :3] == pytest.approx([alone.state.x, alone.state.y, alone.state.z], abs=1e-12)


def test_copies_of_a_vehicle_turn_their_propellers_by_the_commands_of_each_interval():
    rov = load_vehicle("ies-rov").make_plant()
    commands = np.zeros((2, len(rov.commands)))
    commands[1] = 0.5
    out = rov.fly_copies({"yaw.beta": np.ones(3)}, commands, np.zeros((2, 6)), dt=0.01, steps=100)
    assert (out[0] == out[2]).all()
    assert abs(out[0, 0, 7:]).max() < 1e-9 < 0.01 < abs(out[0, 1, 7:]).max()
    assert not rov.rotors.any()


@pytest.mark.parametrize(
    ("numbers", "shapes", "words"),
    [
        ({"surge.gamma": np.ones(3)}, ((4, 0), (4, 6)), "no parameter surge.gamma"),
        ({"surge.beta": np.ones(3), "yaw.beta": np.ones(2)}, ((4, 0), (4, 6)), "must have one shape"),
        ({}, ((4, 0), (4, 6)), "must have one shape"),
        ({"surge.beta": np.ones(3)}, ((4, 1), (4, 6)), r"must have the shapes \(n, 0\) and \(n, 6\)"),
        ({"surge.beta": np.ones(3)}, ((4, 0), (3, 6)), "must have the shapes"),
    ],
)
def test_inputs_that_do_not_fit_a_batch_are_reported(numbers, shapes, words):
    with pytest.raises(ValueError, match=words):
        Written().ours().fly_copies(numbers, *(np.zeros(shape) for shape in shapes), dt=0.01, steps=1)
