"""Speed of the simulator's kernel, and of a session with it, in one run.

Run from the repository root: ``python -m benchmarks.simulator_speed``. Steps are of fourth order. Times are processor
seconds of one core. One ratio is to the same equations written in NumPy matrices, with the same integrator.

PythonVehicleSimulator is not on the package index. With ``--peer FOLDER``, a copy of its repository (and matplotlib),
its Otter is timed too. Both simulators fly the peer's own step of the shaft speeds. The peer has steps of 0.02 s and
first order. Ours are of 0.1 s, and their error must be smaller.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.results import Figure, headline
from sitl import load_vehicle, open_vehicle
from sitl.plants import DOFS, AxisDynamics, Ballast, Coupling, RigidBody, kernel, propeller_rows

Array = np.ndarray

DT = 0.01
STEP_AT, TURN, SEEN, COPIES = 30.0, 60.0, 0.5, 100
"""Time [s] of the peer's step, of the turn after it, and between two readings; copies of our hull that are timed."""
SESSION = 60.0
"""Simulated seconds of the session."""
COLD = (
    "import time\nbegin = time.process_time()\nimport numba\nfrom numba import njit\n"
    "import numpy\nimported = time.process_time()\n"
    "from sitl import load_vehicle\nload_vehicle('ies-rov').make_plant()\n"
    "print(time.process_time() - imported)"
)


def steps_per_second(plant: RigidBody, *, bodies: int = 1, intervals: int = 100, steps: int = 1000) -> float:
    """Return the steps per second of *bodies* copies of *plant* at 0.3 of full command, in one call.

    Linear drag in surge differs between the copies. The time includes the preparation of the copies.
    """
    drag = plant.parameters["surge.beta"] * np.linspace(0.8, 1.2, bodies)
    commands = np.full((intervals, len(plant.commands)), 0.3)
    wrenches = np.tile([5.0, 1.0, 0.0, 0.0, 0.0, 0.5], (intervals, 1))
    begin = time.process_time()
    out = plant.fly_copies({"surge.beta": drag}, commands, wrenches, dt=DT, steps=steps)
    spent = time.process_time() - begin
    assert np.isfinite(out).all()
    return bodies * intervals * steps / spent


def in_matrices(plant: RigidBody, steps: int = 2000) -> float:
    """Return the steps per second of the same body without propellers, in NumPy matrices."""
    body = plant.body
    inverse, momentum = np.linalg.inv(body[:6]), body[6:12]
    linear, quadratic = body[12:18], body[kernel.QUADRATIC]
    g, b, tau = body[kernel.GRAVITY], body[kernel.BUOYANCY], np.array([5.0, 1.0, 0.0, 0.0, 0.0, 0.5])

    def skew(a: Array) -> Array:
        return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])

    def rates(s: Array) -> Array:
        (phi, theta, psi), nu = s[3:6], s[6:]
        (c, d, e), (f, h, k) = np.cos([phi, theta, psi]), np.sin([phi, theta, psi])
        J1 = np.array(
            [[e * d, -k * c + e * h * f, k * f + e * c * h], [k * d, e * c + f * h * k, -e * f + h * k * c],
             [-h, d * f, d * c]]
        )  # fmt: skip
        J2 = np.array([[1.0, f * h / d, c * h / d], [0.0, c, -f], [0.0, f / d, c / d]])
        p = momentum @ nu
        C = np.block([[np.zeros((3, 3)), -skew(p[:3])], [-skew(p[:3]), -skew(p[3:])]])
        weight, lift = g[3] * J1[2], -b[3] * J1[2]
        restoring = np.concatenate([weight + lift, np.cross(g[:3], weight) + np.cross(b[:3], lift)])
        nudot = inverse @ (tau + restoring - linear @ nu - quadratic * np.abs(nu) * nu - C @ nu)
        return np.concatenate([J1 @ nu[:3], J2 @ nu[3:], nudot])

    s = np.zeros(12)
    begin = time.process_time()
    for _ in range(steps):
        k1 = rates(s)
        k2 = rates(s + 0.5 * DT * k1)
        k3 = rates(s + 0.5 * DT * k2)
        k4 = rates(s + DT * k3)
        s = s + DT / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
    return steps / (time.process_time() - begin)


def otter(folder: Path) -> tuple[float, float, float, float]:
    """Return how many times faster our hull flies a manoeuvre of PythonVehicleSimulator's Otter, from its *folder*.

    The other numbers are the largest errors of surge and turn rate by the steps, relative to the peak: ours and the
    peer's, each against a tenth of its step. The last one is the difference of the two craft when they turn steadily.

    The peer is not a dependency of this repository. Its shaft speeds step at 30 s, and it runs with its own step. Its
    cross-flow drag is left out, because our hull has none; this makes the peer faster.
    """
    sys.path.insert(0, str(folder / "src"))
    import python_vehicle_simulator.vehicles as vehicles  # type: ignore[import-not-found]
    from python_vehicle_simulator.lib.mainLoop import simulate  # type: ignore[import-not-found]

    sys.modules[vehicles.otter.__module__].crossFlowDrag = lambda *_: np.zeros(6)  # type: ignore[attr-defined]
    craft = vehicles.otter("stepInput")

    def theirs(dt: float) -> tuple[float, Array]:
        begin = time.process_time()
        with contextlib.redirect_stdout(io.StringIO()):
            _, table = simulate(round((STEP_AT + TURN) / dt), dt, vehicles.otter("stepInput"))
        every = round(SEEN / dt)
        return time.process_time() - begin, table[round(STEP_AT / dt) :: every][:, [6, 11]]

    drag, aft = craft.D, -craft.G[2, 4] / craft.G[2, 2]
    quadratic = [0.0, 0.0, 0.0, 0.0, 0.0, 10.0 * drag[5, 5]]
    axes = {dof: AxisDynamics(craft.M[i, i], drag[i, i], quadratic[i]) for i, dof in enumerate(DOFS)}
    ballast = Ballast(
        craft.m_total,
        (craft.S_rg[2, 1], craft.S_rg[0, 2], craft.S_rg[1, 0]),
        centre_of_lift=(aft, 0.0, 0.0),
        waterplane=craft.G[2, 2],
        metacentric=(craft.G[3, 3], craft.G[4, 4] - craft.G[2, 2] * aft**2),
    )
    twins = {"x": [0.0, 0.0], "y": [craft.l1, craft.l2], "a_ahead": craft.k_pos, "full_n": craft.n_max}
    hull = RigidBody(
        axes,
        ballast=ballast,
        coupling=Coupling(coriolis=True),
        propellers=propeller_rows(twins, {}, {"time_constant": craft.T_n}),
    )
    commands = np.tile(
        np.clip(craft.stepInput(STEP_AT + 1.0), craft.n_min, craft.n_max) / craft.n_max, (round(TURN / SEEN), 1)
    )

    def ours(dt: float) -> tuple[float, Array]:
        begin = time.process_time()
        out = hull.fly_copies(
            {"surge.beta": np.full(COPIES, drag[0, 0])}, commands, np.zeros((len(commands), 6)), dt=dt,
            steps=round(SEEN / dt),
        )  # fmt: skip
        # The peer rests before its step: the time of a whole manoeuvre is that of as many steps.
        return (time.process_time() - begin) / COPIES * (STEP_AT + TURN) / TURN, out[0][:, [7, 12]]

    ours(0.1)
    (own, coarse), (_, fine) = ours(0.1), ours(0.01)
    (peer, rough), (_, smooth) = theirs(0.02), theirs(0.002)

    def error(one: Array, other: Array) -> float:
        return float(np.max(np.abs(one - other) / np.max(np.abs(other), axis=0)))

    n = min(len(rough), len(smooth))
    apart = np.max(np.abs(fine[-1] / smooth[-1] - 1.0))
    return peer / own, error(coarse, fine), error(rough[:n], smooth[:n]), float(apart)


def session() -> float:
    """Return simulated seconds per processor second of a session with a craft in six degrees of freedom."""
    server = open_vehicle("bluerov2-6dof")
    server.advance_to(5.0)
    server.vehicle.autopilot.set_mode(0)
    server.vehicle.autopilot.arm(force=True)
    begin = time.process_time()
    server.advance_to(5.0 + SESSION)
    return SESSION / (time.process_time() - begin)


def cold_start() -> float:
    """Return the processor seconds from an empty cache to a body that can fly, without the import of numba."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "NUMBA_CACHE_DIR": folder, "PYTHONPATH": str(Path.cwd())}
        run = subprocess.run([sys.executable, "-c", COLD], env=environment, capture_output=True, text=True, check=True)
    return float(run.stdout)


def main(argv: Sequence[str] | None = None) -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peer", type=Path, metavar="FOLDER", help="a copy of PythonVehicleSimulator to compare with")
    args = parser.parse_args(argv)
    planar, sub, heavy = (load_vehicle(name).make_plant() for name in ("bluerov2-sway", "ies-rov", "bluerov2-6dof"))
    bare = RigidBody({dof: heavy.axis(dof) for dof in heavy.dofs}, ballast=heavy.ballast, coupling=heavy._coupling)
    for body in (planar, sub, bare):
        steps_per_second(body, intervals=2, steps=2)
    three = max(steps_per_second(planar) for _ in range(3))
    six = max(steps_per_second(sub) for _ in range(3))
    batch = max(steps_per_second(sub, bodies=10_000, intervals=2, steps=50) for _ in range(2))
    alone, matrices = (max(measure(bare) for _ in range(2)) for measure in (steps_per_second, in_matrices))
    aboard, peer = max(session() for _ in range(3)), []
    if args.peer is not None:
        times, error, theirs, apart = otter(args.peer)
        peer = [
            Figure("ratio to PythonVehicleSimulator, Otter's turn", times, "times", least=300.0),
            Figure("error by steps of 0.1 s", 100.0 * error, "%", most=100.0 * theirs),
            Figure("error of PythonVehicleSimulator by its steps of 0.02 s", 100.0 * theirs, "%"),
            Figure("difference of the two craft in a steady turn", 100.0 * apart, "%"),
        ]
    headline(
        "simulator_speed",
        "fourth-order steps of the simulator's hull per second of one core",
        [
            Figure("six degrees of freedom, four propellers with DC motors", six, "steps/s", least=500_000.0),
            Figure("three degrees of freedom", three, "steps/s", least=2e6),
            Figure("batch of 10,000 parameter sets in one call", batch, "steps/s", least=1e6),
            Figure("ratio to the same equations in NumPy matrices", alone / matrices, "times", least=300.0),
            Figure("session of the 6-DOF sub against real time", aboard, "times", least=100.0),
            Figure("compilation from an empty cache", cold_start(), "s", most=2.0),
            *peer,
        ],
    )


if __name__ == "__main__":
    main()
