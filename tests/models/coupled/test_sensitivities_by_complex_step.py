"""The kernels' sensitivities against a second derivation of the same motion, by the complex step.

The equations of motion are written here once more, in plain Python on complex numbers, from the derivatives' names
alone (Fossen2011, (2.18), (2.39), (3.44), (3.46)). A parameter raised by ``i h`` gives its sensitivity as the
imaginary part over ``h``, without the cancellation of difference quotients (Squire1998), so that a wrong
derivative of 1e-6 of its column shows. Jumps of the input move in (complex) time with the delay.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
import pytest

from gcs_autotune.models import FORMS, Form, Simulator, simulate_explicit
from gcs_autotune.models.simulation import COLUMNS

STEP = 1e-30
LONGEST, FINE = 0.01, 0.0002
"""Longest steps [s] here; fine where the kernel under test is exact even where drag has a kink."""
CLOSE = 2e-6
T_IN = np.array([0.0, 0.51, 1.13, 1.8, 2.47])
T_OUT = np.linspace(0.0, 3.0, 301) + 0.0003
LETTERS = {"surge": "uX", "sway": "vY", "heave": "wZ", "roll": "pK", "pitch": "qM", "yaw": "rN"}
VELOCITIES, POSITIONS, FORCES = "uvwpqr", ("x", "y", "z", "phi", "theta", "psi"), "XYZKMN"
SHAPES, COMPASS = ("sinphi", "sintheta", "sinpsi", "cospsi", "near"), ("A_psi", "B_psi", "C_psi")
RIGID_BODY = ("m", "I_x", "I_y", "I_z", "I_xz", "x_G", "y_G", "z_G")
NO_FORCE = (*RIGID_BODY, "delay", "lag", "V_x", "V_y", "drift_x", "drift_y", "A_psi", "B_psi", "C_psi", "reach",
            "bottom", *(f"wall_{f}" for f in FORCES))  # fmt: skip

Complex = np.ndarray
Values = Mapping[str, Complex]
"""Every number is (k,): the same craft k times over, each with another of its numbers raised."""


def modulus(z: Complex) -> Complex:
    """The analytic continuation of |x| off x = 0: what a complex step needs instead of abs."""
    return np.where(z.real >= 0.0, z, -z)


def inertia(values: Values, k: int) -> Complex:
    """M = M_RB + M_A (k, 6, 6)."""
    none = np.zeros(k, dtype=complex)
    m, (gx, gy, gz) = values.get("m", none), [values.get(n, none) for n in ("x_G", "y_G", "z_G")]
    M = np.zeros((k, 6, 6), dtype=complex)
    for i, name in enumerate(("I_x", "I_y", "I_z")):
        M[:, i, i], M[:, 3 + i, 3 + i] = m, values.get(name, none)
    cross = {(0, 1): -gz, (0, 2): gy, (1, 0): gz, (1, 2): -gx, (2, 0): -gy, (2, 1): gx}
    for (i, j), lever in cross.items():
        M[:, i, 3 + j], M[:, 3 + i, j] = -m * lever, m * lever
    for i, j in ((3, 5), (5, 3)):
        M[:, i, j] -= values.get("I_xz", none)
    named = {}
    for name, value in values.items():
        found = re.fullmatch(r"([XYZKMN])_([uvwpqr])dot", name)
        if found:
            named[FORCES.index(found[1]), VELOCITIES.index(found[2])] = value
    for (i, j), value in named.items():
        M[:, i, j] -= value
        if (j, i) not in named:
            M[:, j, i] -= value
    return M


def factors(rest: str, words: Sequence[str]) -> list[tuple[str, bool]]:
    """Read ``uu``, ``|v|r``, ``sinphi`` ... as (word, with modulus); two equal letters carry a modulus."""
    if rest == "0":
        return []
    found, whole = [], rest
    while rest:
        bar = rest.startswith("|")
        word = next(w for w in sorted(words, key=len, reverse=True) if rest[bar:].startswith(w))
        found.append((word, bar))
        rest = rest[len(word) + 2 * bar :]
    plain = [w for w, bar in found if not bar]
    if len(found) == 2 and plain == [found[0][0]] * 2:
        return [(found[0][0], True), (found[1][0], False)]
    if len(found) == 3 and len(plain) == 3 and len(set(plain)) == 2:  # a pair beside another factor: uudelta
        pair = next(w for w in plain if plain.count(w) == 2)
        first = plain.index(pair)
        return [(w, i == first) for i, w in enumerate(plain)]
    assert found, whole
    return found


class Craft:
    """A form's motion on complex numbers."""

    def __init__(self, form: Form, values: Values) -> None:
        self.form, self.values = form, values
        self.k = len(next(iter(values.values())))
        self.rows = [FORCES.index(LETTERS[d][1]) for d in form.dofs]
        self.channels = tuple(form.inputs)
        self.gains = {g.lstrip("-") for pairs in form.inputs.values() for _, g in pairs if isinstance(g, str)}
        self.M = inertia(values, self.k)
        outside = [i for i in range(6) if i not in self.rows]
        self.M[:, outside, :], self.M[:, :, outside] = 0.0, 0.0
        self.inverse = np.linalg.inv(self.M[np.ix_(range(self.k), self.rows, self.rows)])
        self.terms = [
            (name, factors(name[2:], (*VELOCITIES, *POSITIONS, *SHAPES, *self.channels)))
            for name in values
            if name not in NO_FORCE and name not in self.gains and not name.endswith("dot")
        ]

    def rate(self, y: Complex, held: np.ndarray) -> Complex:
        """Rates (12 + lagged, k) of the positions, velocities and lagged inputs."""
        eta, nu, lagged = y[:6].copy(), y[6:12], y[12:]
        u = dict(zip(self.channels, lagged if len(lagged) else held[:, None] + np.zeros(self.k), strict=True))
        if "depth" in u and 2 not in self.rows:
            eta[2] = u["depth"]
        force = self._forces(eta, nu, u)
        for row, letter in enumerate("XYZKMN"):
            name = next((n for n in (f"payload_{letter}", "payload") if n in u), "")
            force[row] = force[row] / (held[self.channels.index(name)] if name else 1.0)
        if self.form.coriolis:
            momentum = np.einsum("kij,jk->ik", self.M, nu)
            a, b = momentum[:3], momentum[3:]
            turned = [np.cross(p, q, axis=0) for p, q in ((nu[3:], a), (nu[:3], a), (nu[3:], b))]
            force -= np.concatenate([turned[0], turned[1] + turned[2]])
        nu_dot = np.zeros_like(nu)
        nu_dot[self.rows] = np.einsum("kij,jk->ik", self.inverse, force[self.rows])
        late = (held[:, None] - lagged) / self.values["lag"] if len(lagged) else lagged
        return np.concatenate([self._turned(eta, nu), nu_dot, late])

    def _forces(self, eta: Complex, nu: Complex, u: Mapping[str, Complex]) -> Complex:
        known = {**dict(zip(VELOCITIES, nu, strict=True)), **dict(zip(POSITIONS, eta, strict=True)), **u}
        known |= {"sinphi": np.sin(eta[3]), "sintheta": np.sin(eta[4])}
        known |= {"sinpsi": np.sin(eta[5]), "cospsi": np.cos(eta[5])}
        if "reach" in self.values:
            known["near"] = np.exp((eta[2] - self.values["bottom"]) / self.values["reach"])
        force = np.zeros((6, self.k), dtype=complex)
        for channel, pairs in self.form.inputs.items():
            for letter, gain in pairs:
                sign = -1.0 if isinstance(gain, str) and gain.startswith("-") else 1.0
                size = self.values[gain.lstrip("-")] if isinstance(gain, str) else gain
                force[FORCES.index(letter)] += sign * size * u[channel]
        for name, read in self.terms:
            row, product = FORCES.index(name[0]), self.values[name]
            for word, bar in read:
                product = product * (modulus(known[word]) if bar else known[word])
            force[row] += product
            wall = f"wall_{name[0]}"
            if wall in self.values and 1 <= len(read) <= 2 and {w for w, _ in read} == {VELOCITIES[row]}:
                force[row] += self.values[wall] * known["near"] * product
        return force

    def _turned(self, eta: Complex, nu: Complex) -> Complex:
        """Rates of the position: about roll first, then pitch, then heading."""
        phi, theta, psi = eta[3:]
        x, y, z = nu[:3]
        y, z = y * np.cos(phi) - z * np.sin(phi), y * np.sin(phi) + z * np.cos(phi)
        x, z = x * np.cos(theta) + z * np.sin(theta), z * np.cos(theta) - x * np.sin(theta)
        x, y = x * np.cos(psi) - y * np.sin(psi), x * np.sin(psi) + y * np.cos(psi)
        p, q, r = nu[3:]
        across = q * np.sin(phi) + r * np.cos(phi)
        turn = [p + across * np.tan(theta), q * np.cos(phi) - r * np.sin(phi), across / np.cos(theta)]
        drift = [sum(self.values.get(n, 0.0) for n in names) for names in (("V_x", "drift_x"), ("V_y", "drift_y"))]
        return np.array([x + drift[0], y + drift[1], z, *turn])

    def run(self, start: Values, inputs: np.ndarray) -> dict[str, Complex]:
        """What is measured at ``T_OUT``, (s, k) each: classical Runge-Kutta, steps ending at every jump and stamp."""
        none = np.zeros(self.k, dtype=complex)
        names = (*POSITIONS, *VELOCITIES, *((f"lagged {c}" for c in self.channels) if "lag" in self.values else ()))
        y = np.array([start.get(n, none) for n in names])
        delay = self.values.get("delay", none)
        seen: dict[str, list[Complex]] = {}
        for span, held, is_stamp in passage(delay, inputs):
            y = advanced(lambda at, held=held: self.rate(at, held), y, span, LONGEST)
            if is_stamp:
                for name, value in self._measured(y).items():
                    seen.setdefault(name, []).append(value)
        return {n: np.array(v) for n, v in seen.items()}

    def _measured(self, y: Complex) -> dict[str, Complex]:
        shown = dict(zip((*POSITIONS, *VELOCITIES), y[:12], strict=True))
        psi, (V_x, V_y, A, B, C) = shown["psi"], (self.values.get(n, 0.0) for n in ("V_x", "V_y", *COMPASS))
        u = shown["u"] + V_x * np.cos(psi) + V_y * np.sin(psi)
        v = shown["v"] - V_x * np.sin(psi) + V_y * np.cos(psi)
        d = A + B * np.sin(psi) + C * np.cos(psi)
        return {**shown, "psi": psi + d, "u": np.cos(d) * u + np.sin(d) * v, "v": np.cos(d) * v - np.sin(d) * u}


def passage(delay: Complex, inputs: np.ndarray) -> Iterator[tuple[Complex, np.ndarray, bool]]:
    """Yield (span (k,), input held over it, whether a stamp ends it) from the first stamp to the last."""
    jumps = [(t + delay, row) for t, row in zip(T_IN, inputs, strict=True)]
    held = inputs[max((i for i, (t, _) in enumerate(jumps) if t[0].real <= T_OUT[0]), default=0)]
    later = [(t, row) for t, row in jumps if t[0].real > T_OUT[0]]
    now = T_OUT[0] + 0.0 * delay
    for t, row in sorted([*((t + 0.0 * delay, None) for t in T_OUT), *later], key=lambda e: float(e[0][0].real)):
        yield t - now, held, row is None
        now, held = t, held if row is None else row


def advanced(rate: Callable[[Complex], Complex], y: Complex, span: Complex, longest: float) -> Complex:
    """Return *y* (n, k) a *span* (k,) later."""
    steps = max(1, int(np.ceil(float(span[0].real) / longest)))
    h = span / steps
    for _ in range(steps):
        one = rate(y)
        two = rate(y + 0.5 * h * one)
        three = rate(y + 0.5 * h * two)
        y = y + h / 6.0 * (one + 2.0 * two + 2.0 * three + rate(y + h * three))
    return y


def raised(values: Mapping[str, float], required: Sequence[str], first: int, k: int) -> dict[str, Complex]:
    """Return *values* (k,), the copies from *first* on each with one of *required* raised by ``i STEP``."""
    found = {n: np.full(k, v, dtype=complex) for n, v in values.items()}
    for i, name in enumerate(required):
        found[name][first + i] += STEP * 1j
    return found


def numbers_for(form: Form, rng: np.random.Generator) -> dict[str, float]:
    """Values of a craft that damps: inertia and drag of the right sign, everything else small and either way."""
    values = {}
    for name in form.free:
        letter, rest = name[0], name[2:]
        own = VELOCITIES[FORCES.index(letter)] if letter in FORCES else ""
        if rest == f"{own}dot":
            values[name] = -rng.uniform(1.0, 2.0)
        elif rest.endswith("dot"):
            values[name] = 0.1 * rng.normal()
        elif rest in (own, own * 2, f"|{own}|{own}"):
            values[name] = -rng.uniform(0.3, 1.0)
        else:
            values[name] = 0.15 * rng.normal()
    return values


SURROUNDINGS = {"delay": 0.17, "lag": 0.4, "V_x": 0.2, "V_y": -0.15, "A_psi": 0.05, "B_psi": 0.1, "C_psi": -0.08}


def extended(name: str) -> Form:
    """A shipped form with every other kind of parameter of the kernel."""
    form = FORMS[name]
    return form.freeing(*(n for n in SURROUNDINGS if n not in form.parameters))


def heavy(coriolis: bool = True) -> Form:
    """A rigid body with its centre of gravity aside, near the bottom, with a payload."""
    body = {"m": 2.0, "I_x": 0.8, "I_y": 0.9, "I_z": 0.7, "I_xz": 0.1}
    free = ["x_G", "y_G", "z_G", "X_udot", "Y_rdot", "X_u", "Y_vv", "Z_w", "Z_ww", "K_p", "M_q", "N_r", "N_rrr",
            "K_sinphi", "M_theta", "N_sinpsi", "X_xcospsi", "Y_|v|r", "N_uv", "N_uudelta", "N_|delta|delta", "wall_Z",
            "reach", "bottom", "drift_x", "drift_y"]  # fmt: skip
    inputs = {"X": (("X", 1.0),), "delta": (("N", 0.5),), "payload": (), "payload_N": ()}
    return Form("heavy", "heavy", tuple(LETTERS), tuple(free), body, inputs, coriolis=coriolis)


HEAVY = {"x_G": 0.1, "y_G": -0.05, "z_G": 0.08, "X_udot": -0.5, "Y_rdot": 0.1, "wall_Z": 0.7, "reach": 0.9,
         "bottom": 1.2, "drift_x": 0.1, "drift_y": -0.1, "K_sinphi": -2.0, "M_theta": -2.0}  # fmt: skip


def cases() -> list[tuple[str, Form, dict[str, float]]]:
    found = [(name, extended(name), SURROUNDINGS) for name in FORMS]
    found += [("rigid body", heavy(), HEAVY), ("rigid body, no Coriolis", heavy(coriolis=False), HEAVY)]
    depth = {"wall_N": 0.6, "reach": 0.5, "bottom": 5.0}
    diver = Form("diver", "diver", ("surge", "yaw"), ("X_udot", "N_rdot", "X_u", "N_r", "N_nearr", *depth), {},
                 {"X": (("X", 1.0),), "N": (("N", 1.0),), "depth": ()})  # fmt: skip
    return [*found, ("recorded depth", diver, depth)]


@pytest.mark.slow
@pytest.mark.parametrize(("form", "given"), [c[1:] for c in cases()], ids=[c[0] for c in cases()])
def test_motion_and_sensitivities_match_a_complex_step_derivation(form: Form, given: dict[str, float]) -> None:
    rng = np.random.default_rng(11)
    values = {**numbers_for(form, rng), **{n: v for n, v in given.items() if n in form.free}, **form.known}
    simulator = Simulator(form, form.free, Simulator(form).states)
    start = dict(zip(simulator.states, rng.uniform(-0.3, 0.3, len(simulator.states)).tolist(), strict=True))
    inputs = rng.uniform(-1.0, 1.0, (len(T_IN), len(form.inputs)))
    for i, channel in enumerate(form.inputs):
        if channel.startswith("payload"):
            inputs[:, i] = rng.uniform(0.7, 1.5, len(T_IN))
        if channel == "depth":
            inputs[:, i] = rng.uniform(4.0, 5.0, len(T_IN))
    theta = np.array([values[n] for n in form.parameters])
    for _ in range(2):  # the first settles the length of its steps
        found = simulator.run(theta, np.array(list(start.values())), T_IN, inputs, T_OUT)
    assert found is not None
    signals = [s for s in simulator.states if not s.startswith("lagged ")]
    required = (*form.free, *simulator.states)
    shown = Craft(form, raised(values, form.free, 0, len(required))).run(
        raised(start, simulator.states, len(form.free), len(required)), inputs
    )
    for s in signals:
        value, by = simulator.outputs(theta, *found, s)
        assert value == pytest.approx(shown[s][:, 0].real, abs=CLOSE * max(1.0, float(np.ptp(value)))), s
        for column, name in enumerate(required):
            exact = shown[s][:, column].imag / STEP
            assert by[:, column] == pytest.approx(exact, abs=CLOSE * max(1.0, float(np.abs(exact).max()))), (s, name)
    felt = np.max([np.abs(shown[s].imag).max(axis=0) for s in signals], axis=0)
    assert (felt > 0.0).all(), [n for n, size in zip(required, felt, strict=True) if size == 0.0]


AXES = {
    "affine": (2.0, 0.8, 1.5, 0.1, 0.137, 0.2, -0.5),
    "linear": (2.0, 0.8, 0.0, 0.1, 0.05, 0.2, -0.5),
    "quadratic": (20.0, 0.0, 15.0, -0.3, 0.05, 0.0, 3.0),
    "reversed": (-3.0, 0.5, 0.4, 0.1, 0.1, 0.0, 0.3),
}
FORCE = np.array([1.0, -1.0, 0.4, -0.7, 1.2])


def axis_motion(p: Complex) -> Complex:
    """Position and velocity (s, 2, k) of ``nu_dot = b tau(t - delay) - (a + c |nu|) nu + d``; p (7, k)."""
    b, a, c, d, delay, eta, nu = p
    y, rows = np.array([eta, nu]), []
    for span, held, is_stamp in passage(delay, FORCE[:, None]):
        y = advanced(
            lambda at, held=held: np.array([at[1], b * held[0] - (a + c * modulus(at[1])) * at[1] + d]), y, span, FINE
        )
        if is_stamp:
            rows.append(y)
    return np.array(rows)


@pytest.mark.slow
@pytest.mark.parametrize("case", AXES)
def test_the_kernel_of_one_degree_of_freedom_matches_a_complex_step_derivation(case: str) -> None:
    p = np.array(AXES[case])
    found = simulate_explicit(p, T_IN, FORCE, T_OUT)
    moved = axis_motion(p[:, None] + STEP * 1j * np.eye(len(COLUMNS)))
    assert np.column_stack([found.eta, found.nu]) == pytest.approx(moved[:, :, 0].real, abs=1e-6)
    for column, name in enumerate(COLUMNS):
        exact, own = moved[:, :, column].imag / STEP, np.column_stack([found.eta_by[:, column], found.nu_by[:, column]])
        assert own == pytest.approx(exact, abs=CLOSE * max(1.0, float(np.abs(exact).max()))), name
