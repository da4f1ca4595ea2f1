"""The tugboat of Erunsal2017 in own plants: 6-DOF equations of its (1) in matrices, fixed-step Runge-Kutta.

Shares nothing with the code under test. All runs of a batch are integrated side by side.

The truth is table 1 where it can be one. As printed it cannot: I_x is negative, and with I_z = 0.0894 the inertia of
sway and yaw is not positive (12.05 * 0.137 < 1.435^2). The columns are shifted by a row there: I_x = 0.0894 is what an
11 kg hull of 0.29 m beam has (m B^2/10 = 0.093) and I_z = 2.1493 makes the inertia positive. The value left over, -2.5,
cannot be I_xz (I_xz^2 < I_x I_z); 0.05 is chosen. Roll, pitch and heave are not printed: stiffness from the
hydrostatics of a box of that size (GM_T 0.05 m, GM_L 0.7 m, waterplane 0.8 L B), damping 5 to 10 % of critical with a
quadratic part.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from gcs_autotune.trial import Channel, Trial

Array = np.ndarray

TUG = {
    "X_u": -5.6128, "X_uu": -2.3136, "X_udot": -1.0946, "Y_v": -3.5059, "Y_r": -0.0001, "Y_vv": -3.9310,
    "Y_rdot": -1.4353, "Y_vdot": -1.0536, "N_r": -0.1039, "N_v": -1.0005, "N_rr": -0.2605, "N_rdot": -0.0474,
    "I_x": 0.0894, "I_z": 2.1493, "I_xz": 0.05, "C_DA": 0.6487,
    "I_y": 0.64, "K_p": -0.11, "K_pp": -0.05, "M_q": -0.97, "M_qq": -0.5, "Z_w": -30.0, "Z_ww": -60.0,
}  # fmt: skip
"""The 23 parameters."""

HULL = {"m": 11.0, "K_phi": -5.4, "M_theta": -75.0, "Z_z": -2050.0}
AIR, AREA_AHEAD, AREA_ABEAM = 1.225, 0.29 * 0.15, 0.9 * 0.15
SWING = -6.0

NOISE = {
    "u": 0.02, "v": 0.02, "p": 0.01, "q": 0.01, "r": 0.01, "z": 0.001, "phi": 0.005, "theta": 0.005, "psi": 0.005,
}  # fmt: skip
"""Standard deviations: Doppler log or filtered GNSS, gyro, ultrasonic gauge, attitude of a small inertial unit."""
WIND_NOISE = 0.1

NAMES = ("x", "y", "z", "phi", "theta", "psi", "u", "v", "w", "p", "q", "r")
UNITS = dict(zip(NAMES, ["m"] * 3 + ["rad"] * 3 + ["m/s"] * 3 + ["rad/s"] * 3, strict=True))


def skew(a: Array) -> Array:
    """(R, 3) -> (R, 3, 3), the cross product's matrix."""
    S = np.zeros((len(a), 3, 3))
    S[:, 0, 1], S[:, 0, 2], S[:, 1, 2] = -a[:, 2], a[:, 1], -a[:, 0]
    return S - np.swapaxes(S, 1, 2)


def inertia(p: dict[str, float]) -> Array:
    M = np.diag(
        [HULL["m"] - p["X_udot"], HULL["m"] - p["Y_vdot"], HULL["m"], p["I_x"], p["I_y"], p["I_z"] - p["N_rdot"]]
    )
    M[1, 5] = M[5, 1] = -p["Y_rdot"]
    M[3, 5] = M[5, 3] = -p["I_xz"]
    return M


def rotation(eta: Array) -> tuple[Array, Array]:
    """Body to earth: matrices of velocities and of Euler rates, (R, 3, 3) each."""
    phi, theta, psi = eta[:, 3], eta[:, 4], eta[:, 5]
    one, zero = np.ones(len(eta)), np.zeros(len(eta))

    def about(axis: int, angle: Array) -> Array:
        c, s = np.cos(angle), np.sin(angle)
        rows = {
            0: [[one, zero, zero], [zero, c, -s], [zero, s, c]],
            1: [[c, zero, s], [zero, one, zero], [-s, zero, c]],
        }
        rows[2] = [[c, -s, zero], [s, c, zero], [zero, zero, one]]
        return np.moveaxis(np.array(rows[axis]), 2, 0)

    R = about(2, psi) @ about(1, theta) @ about(0, phi)
    W = np.array(
        [
            [one, zero, -np.sin(theta)],
            [zero, np.cos(phi), np.cos(theta) * np.sin(phi)],
            [zero, -np.sin(phi), np.cos(theta) * np.cos(phi)],
        ]
    )
    return R, np.linalg.inv(np.moveaxis(W, 2, 0))


@dataclass
class Run:
    """One run to sail: name, manoeuvre, initial state (by name), thrust(t, state) -> (X, N), wind (north, east)(t)."""

    name: str
    manoeuvre: str
    seconds: float
    initial: dict[str, float] = field(default_factory=dict)
    thrust: Callable[[float, Array], tuple[float, float]] = lambda t, s: (0.0, 0.0)
    wind: Callable[[float], tuple[float, float]] = lambda t: (0.0, 0.0)
    signals: tuple[str, ...] = ("u", "v", "r", "psi")
    driven: bool = True


class Tug:
    """The boat with its parameters; ``sail`` integrates a batch of runs, sampled every *dt*."""

    def __init__(self, p: dict[str, float] = TUG) -> None:
        self.p, self.M = p, inertia(p)
        assert np.all(np.linalg.eigvalsh(self.M) > 0.0), "an inertia must be positive"
        self.inverse = np.linalg.inv(self.M)
        self.linear = np.zeros((6, 6))
        for name in ("X_u", "Y_v", "Z_w", "K_p", "M_q", "N_r", "Y_r", "N_v"):
            self.linear["XYZKMN".index(name[0]), "uvwpqr".index(name[2])] = p[name]
        self.quadratic = np.array([p[n] for n in ("X_uu", "Y_vv", "Z_ww", "K_pp", "M_qq", "N_rr")])

    def apparent(self, eta: Array, nu: Array, wind: Array) -> Array:
        """Apparent wind (R, 2) [m/s] in body axes: where the air goes, seen from aboard."""
        R = rotation(eta)[0]
        air = np.einsum("rji,rj->ri", R, np.column_stack([wind, np.zeros(len(wind))]))
        return air[:, :2] - nu[:, :2]

    def rates(self, s: Array, tau: Array, wind: Array) -> Array:
        eta, nu = s[:, :6], s[:, 6:]
        momentum = nu @ self.M.T
        C = np.zeros((len(s), 6, 6))
        C[:, :3, 3:] = C[:, 3:, :3] = -skew(momentum[:, :3])
        C[:, 3:, 3:] = -skew(momentum[:, 3:])
        V = self.apparent(eta, nu, wind)
        force = nu @ self.linear.T + self.quadratic * np.abs(nu) * nu - np.einsum("rij,rj->ri", C, nu)
        force[:, 0] += tau[:, 0] + 0.5 * AIR * AREA_AHEAD * self.p["C_DA"] * np.abs(V[:, 0]) * V[:, 0]
        force[:, 1] += 0.5 * AIR * AREA_ABEAM * self.p["C_DA"] * np.abs(V[:, 1]) * V[:, 1]
        force[:, 5] += tau[:, 1]
        force[:, 2] += HULL["Z_z"] * eta[:, 2]
        force[:, 3] += HULL["K_phi"] * eta[:, 3]
        force[:, 4] += HULL["M_theta"] * eta[:, 4]
        R, T = rotation(eta)
        return np.hstack(
            [np.einsum("rij,rj->ri", R, nu[:, :3]), np.einsum("rij,rj->ri", T, nu[:, 3:]), force @ self.inverse.T]
        )

    def sail(self, runs: Sequence[Run], dt: float, rng: np.random.Generator, h: float = 0.01) -> list[Trial]:
        count, inner = round(max(r.seconds for r in runs) / dt), round(dt / h)
        s = np.array([[r.initial.get(n, 0.0) for n in NAMES] for r in runs])
        states, taus, winds = [], [], []
        for k in range(count):
            t = k * dt
            tau = np.array([r.thrust(t, s[i]) for i, r in enumerate(runs)])
            wind = np.array([r.wind(t) for r in runs])
            states.append(s)
            taus.append(tau)
            winds.append(self.apparent(s[:, :6], s[:, 6:], wind))
            for _ in range(inner):
                k1 = self.rates(s, tau, wind)
                k2 = self.rates(s + 0.5 * h * k1, tau, wind)
                k3 = self.rates(s + 0.5 * h * k2, tau, wind)
                s = s + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + self.rates(s + h * k3, tau, wind))
        history, tau, wind = np.array(states), np.array(taus), np.array(winds)
        wind = wind + rng.normal(0.0, WIND_NOISE, wind.shape)
        out = []
        for i, run in enumerate(runs):
            n = round(run.seconds / dt)
            t = dt * np.arange(n)
            channels = {
                c: Channel(c, UNITS[c], t, history[:n, i, NAMES.index(c)] + rng.normal(0.0, NOISE[c], n))
                for c in run.signals
            }
            if run.driven:
                channels["X"], channels["N"] = (
                    Channel("X", "N", t, tau[:n, i, 0]),
                    Channel("N", "N m", t, tau[:n, i, 1]),
                )
                # an input channel holds its value to its next stamp: what varies smoothly is dated half a sample early
                for c, j, area in (("W_x", 0, AREA_AHEAD), ("W_y", 1, AREA_ABEAM)):
                    V = wind[:n, i, j]
                    channels[c] = Channel(c, "N", t - 0.5 * dt, 0.5 * AIR * area * np.abs(V) * V)
            out.append(Trial(run.name, channels, meta={"manoeuvre": run.manoeuvre}))
        return out


def swing_in_air(rng: np.random.Generator, seconds: float, amplitude: float, name: str) -> Trial:
    """The craft on two lines: I_z psi_ddot = SWING psi - a little friction; its exact solution."""
    t = np.arange(0.0, seconds, 0.05)
    I_z, friction = TUG["I_z"], 0.03
    a = friction / (2.0 * I_z)
    omega = np.sqrt(-SWING / I_z - a * a)
    psi = amplitude * np.exp(-a * t) * (np.cos(omega * t) + a / omega * np.sin(omega * t))
    r = -amplitude * np.exp(-a * t) * (a * a + omega * omega) / omega * np.sin(omega * t)
    channels = {
        "psi": Channel("psi", "rad", t, psi + rng.normal(0.0, NOISE["psi"], len(t))),
        "r": Channel("r", "rad/s", t, r + rng.normal(0.0, NOISE["r"], len(t))),
    }
    return Trial(name, channels, meta={"manoeuvre": "yaw_swing"})


def levels(values: Sequence[float], hold: float) -> Callable[[float], float]:
    return lambda t: float(values[min(int(t / hold), len(values) - 1)])


class ZigZag:
    """Moment one way until the heading passes *angle*, then the other way."""

    def __init__(self, X: float, N: float, angle: float) -> None:
        self.X, self.N, self.angle, self.side = X, N, angle, 1.0

    def __call__(self, t: float, s: Array) -> tuple[float, float]:
        if self.side * s[5] > self.angle:
            self.side = -self.side
        return self.X, self.side * self.N


def gusts(rng: np.random.Generator, speed: float) -> Callable[[float], tuple[float, float]]:
    own, way = rng.uniform(0.4, 1.4, 200), rng.uniform(-0.5, 0.5, 200) + rng.uniform(0.0, 6.28)
    return lambda t: (
        speed * own[int(t / 5.0)] * np.cos(way[int(t / 5.0)]),
        speed * own[int(t / 5.0)] * np.sin(way[int(t / 5.0)]),
    )


def sea_trials(seed: int, *, each: int = 3, scale: float = 1.0, free: float = 60.0) -> list[Trial]:
    """Every manoeuvre of the plan, *each* times (the last kept by the plan for validation); *scale* shortens them."""
    rng = np.random.default_rng(seed)
    tug = Tug()
    decays, sails = [], []
    for i in range(each):
        lift = 1.0 - 0.25 * i
        decays += [
            Run(f"heave {i}", "heave_decay", 4.0, {"z": 0.05 * lift}, signals=("z",), driven=False),
            Run(f"pitch {i}", "pitch_decay", 4.0, {"theta": 0.15 * lift}, signals=("theta", "q"), driven=False),
            Run(f"roll {i}", "roll_decay", 8.0, {"phi": 0.35 * lift}, signals=("phi", "p", "r", "v"), driven=False),
        ]
        speed = levels(rng.uniform(0.0, 16.0, 40) * (rng.uniform(size=40) > 0.25), 6.0)
        sails.append(
            Run(f"line {i}", "speed_steps", 60.0 * scale, thrust=lambda t, s, f=speed: (f(t), 0.0), signals=("u",))
        )
        turn = levels(rng.uniform(-0.5, 0.5, 60), 3.0)
        sails.append(Run(f"turn {i}", "yaw_turn", 80.0 * scale, thrust=lambda t, s, f=turn: (0.0, f(t))))
        push, side = 6.0 + 4.0 * i, (-1.0) ** i
        sails.append(
            Run(
                f"spiral {i}",
                "spiral",
                100.0 * scale,
                thrust=lambda t, s, X=push, g=side, T=100.0 * scale: (
                    X,
                    g * 1.2 * (1.0 - 2.0 * np.floor(10.0 * t / T) / 9.0),
                ),
            )
        )
        sails.append(
            Run(f"zig-zag {i}", "zigzag", 100.0 * scale, thrust=ZigZag(6.0 + 3.0 * i, 1.2, np.radians(20.0 + 10.0 * i)))
        )
        drift = levels(rng.uniform(-0.3, 0.3, 60), 5.0)
        sails.append(
            Run(
                f"drift {i}", "wind_drift", 80.0 * scale, thrust=lambda t, s, f=drift: (0.0, f(t)), wind=gusts(rng, 8.0)
            )
        )
    for i in range(2):
        X, N = levels(rng.uniform(0.0, 14.0, 60), 6.0), levels(rng.uniform(-1.0, 1.0, 60), 4.0)
        sails.append(
            Run(f"free {i}", "free_motion", free, thrust=lambda t, s, f=X, g=N: (f(t), g(t)), wind=gusts(rng, 3.0))
        )
    swings = [swing_in_air(rng, 20.0, 0.3 - 0.05 * i, f"swing {i}") for i in range(each)]
    return [*swings, *tug.sail(decays, 0.02, rng), *tug.sail(sails, 0.1, rng, h=0.02)]
